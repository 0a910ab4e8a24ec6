//! `training.csv`: one row per iteration.

use super::fixed::{exact, exact_or_empty, nan};
use serde::{Deserialize, Serialize};

/// One iteration of a training. Losses are mean squared errors in the loss's own scale.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingRow {
    /// Iterations done, over all phases.
    pub iteration: u64,
    /// Evaluations of loss and gradient so far.
    pub loss_evaluations: u64,
    /// Wall time of the optimizer so far, in s.
    #[serde(serialize_with = "exact")]
    pub elapsed_s: f64,
    /// The loss.
    #[serde(serialize_with = "exact")]
    pub loss: f64,
    /// `mse_gen` on the validation scenarios, in the states' units squared, where it was evaluated.
    #[serde(serialize_with = "exact_or_empty")]
    pub validation_mse: Option<f64>,
    /// Index of the phase, from 0.
    #[serde(default)]
    pub phase: usize,
    /// The loss's term of the initial conditions.
    #[serde(serialize_with = "exact", default = "nan")]
    pub loss_data: f64,
    /// The loss's term of the equation.
    #[serde(serialize_with = "exact", default = "nan")]
    pub loss_physics: f64,
    /// Norm of the loss's gradient.
    #[serde(serialize_with = "exact", default = "nan")]
    pub gradient_norm: f64,
    /// Collocation points in use; 0 if not known.
    #[serde(default)]
    pub collocation_points: usize,
    /// The loss on points that it was not trained on, where it was computed.
    #[serde(serialize_with = "exact_or_empty", default)]
    pub fresh_loss: Option<f64>,
    /// The loss's term of the measurements.
    #[serde(serialize_with = "exact", default = "nan")]
    pub loss_measured: f64,
}

#[cfg(test)]
mod tests {
    use super::super::{fixed_table, read_fixed_table};
    use super::*;
    use crate::error::RecordError;
    use std::path::Path;

    fn read(text: &str) -> Result<Vec<TrainingRow>, RecordError> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("training.csv");
        std::fs::write(&path, text).unwrap();
        Ok(read_fixed_table(&path)?.unwrap())
    }

    #[test]
    fn rows_read_back_bit_for_bit() {
        let row = TrainingRow {
            iteration: 7,
            elapsed_s: 1.25e-5,
            loss: 0.1 + 0.2,
            fresh_loss: Some(1e-300),
            loss_physics: f64::INFINITY,
            ..TrainingRow::default()
        };
        let table = fixed_table(&[row.clone(), TrainingRow::default()]);
        let text = String::from_utf8(table.as_bytes().to_vec()).unwrap();
        assert_eq!(read(&text).unwrap(), [row, TrainingRow::default()]);
        // The interface names the first five columns.
        assert!(
            text.starts_with("iteration,loss_evaluations,elapsed_s,loss,validation_mse,phase,")
        );
        assert!(text.contains("\n7,0,1.25e-5,0.30000000000000004,,0,"), "{text}");
    }

    #[test]
    fn a_table_without_rows_has_its_header() {
        let table = fixed_table::<TrainingRow>(&[]);
        let text = std::str::from_utf8(table.as_bytes()).unwrap();
        assert_eq!(text.lines().count(), 1);
        assert_eq!(text.lines().next().unwrap().split(',').count(), 12);
        assert_eq!(read(text).unwrap(), []);
    }

    #[test]
    fn an_older_table_with_fewer_columns_is_read() {
        let rows = read(
            "iteration,loss_evaluations,elapsed_s,loss,validation_mse\n1,2,0.5,3.0,\n2,3,1,NaN,4\n",
        );
        let rows = rows.unwrap();
        assert_eq!(rows[0].validation_mse, None);
        assert_eq!(rows[1].validation_mse, Some(4.0));
        assert!(rows[1].loss.is_nan() && rows[0].gradient_norm.is_nan());
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line_and_column() {
        let five = "iteration,loss_evaluations,elapsed_s,loss,validation_mse";
        for (text, place) in [
            (format!("{five}\n1,1,0,1,\n2,2,0,many,\n"), "training.csv:3: column `loss`"),
            (format!("{five}\n1,1,0,1,\n2\n"), "training.csv:3: damaged CSV"),
            ("iteration,loss\n1,1\n".to_owned(), "training.csv:1: no column `loss_evaluations`"),
        ] {
            let message = read(&text).unwrap_err().to_string();
            assert!(message.contains(place), "{message}");
        }
        let missing = read_fixed_table::<TrainingRow>(Path::new("nowhere/training.csv"));
        assert!(missing.unwrap().is_none());
    }
}
