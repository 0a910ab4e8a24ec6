//! `model-error.csv`: the error of the net in each step of a closed loop, estimated and true.

use crate::csv::{CsvFile, CsvText};
use crate::error::RecordError;
use std::path::Path;

const TIME: &str = "t";
const ESTIMATE: &str = "_err";
const TRUTH: &str = "_true_err";

/// The errors of one step of a net along a closed loop: the columns are `t`, and for each state
/// `<state>_err`, estimated, and `<state>_true_err`.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelErrorTable {
    /// Names of the states.
    pub states: Vec<String>,
    /// The steps, by time.
    pub rows: Vec<ModelErrorRow>,
}

/// One step from the state and the input of the loop at its beginning.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelErrorRow {
    /// When it begins, in s.
    pub t: f64,
    /// The estimated errors at its end, in the states' units.
    pub estimate: Vec<f64>,
    /// The true ones; NaN where the equation has no solution.
    pub truth: Vec<f64>,
}

impl ModelErrorTable {
    /// The table as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let of = |state: &String| [format!("{state}{ESTIMATE}"), format!("{state}{TRUTH}")];
        let columns = self.states.iter().flat_map(of);
        let mut table = CsvText::new([TIME.to_owned()].into_iter().chain(columns));
        for row in &self.rows {
            let pairs = row.estimate.iter().zip(&row.truth).flat_map(|(e, true_e)| [e, true_e]);
            table.push_numbers([&row.t].into_iter().chain(pairs));
        }
        table
    }

    /// Reads the table; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path) -> Result<Option<Self>, RecordError> {
        let Some(file) = CsvFile::read(path)? else { return Ok(None) };
        let names = file.head.header.iter().filter_map(|name| name.strip_suffix(TRUTH));
        let states: Vec<String> = names.map(str::to_owned).collect();
        let places = |form: &str| {
            let places = states.iter().map(|name| file.head.place(&format!("{name}{form}")));
            places.collect::<Result<Vec<_>, _>>()
        };
        let (t, estimate, truth) = (file.head.place(TIME)?, places(ESTIMATE)?, places(TRUTH)?);
        let row = |row| {
            let numbers = |places: &[usize]| {
                places.iter().map(|&place| file.head.number(row, place)).collect::<Result<_, _>>()
            };
            Ok(ModelErrorRow {
                t: file.head.number(row, t)?,
                estimate: numbers(&estimate)?,
                truth: numbers(&truth)?,
            })
        };
        let rows = file.rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        Ok(Some(Self { states, rows }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_along_a_loop_read_back_bit_for_bit() {
        let row = |t: f64| ModelErrorRow {
            t,
            estimate: vec![0.1 + 0.2, -1e-300],
            truth: vec![1.0 / 3.0, t],
        };
        let table = ModelErrorTable {
            states: ["x", "v"].map(str::to_owned).to_vec(),
            rows: vec![row(0.0), row(0.5)],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model-error.csv");
        assert_eq!(ModelErrorTable::read(&path).unwrap(), None);
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        assert_eq!(ModelErrorTable::read(&path).unwrap(), Some(table));
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("t,x_err,x_true_err,v_err,v_true_err\n0.0,"), "{text}");
        std::fs::write(&path, "t,x_true_err\n1,2\n").unwrap();
        let message = ModelErrorTable::read(&path).unwrap_err().to_string();
        assert!(message.contains("no column `x_err`"), "{message}");
    }
}
