//! Recorded data: the columns `t`, the inputs, known parameters, and `y_` with the name of what is
//! measured.

use crate::columns::{finite, optional, place};
use ::csv::StringRecord;
use pinc_config::Variables;

/// Where in a row of recorded data the columns are, with their names.
#[derive(Clone, Debug)]
pub struct RecordedColumns {
    t: usize,
    inputs: Vec<(usize, String)>,
    known: Vec<(usize, String)>,
    measured: Vec<(usize, String)>,
    states: Option<Vec<(usize, String)>>,
}

/// A row of recorded data.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedRow {
    /// The time, in s.
    pub t: f64,
    /// The inputs from now on.
    pub u: Vec<f64>,
    /// The known parameters from now on.
    pub known: Vec<f64>,
    /// What is measured, NaN where it is missing.
    pub y: Vec<f64>,
    /// The true states, where the data have them.
    pub truth: Option<Vec<f64>>,
}

impl RecordedRow {
    /// The steps of T since the time `before`, if they are whole as far as times tell: doubles have
    /// Unix times to 2.4e-7 s.
    #[must_use]
    pub fn steps_since(&self, before: f64, sample_time_s: f64) -> Option<f64> {
        let steps = (self.t - before) / sample_time_s;
        let resolution = 2.0 * f64::EPSILON * self.t.abs() / sample_time_s;
        let near = steps.max(1.0) * (1e-6 + resolution);
        ((steps - steps.round()).abs() <= near.min(0.1)).then_some(steps.round())
    }
}

impl RecordedColumns {
    /// Finds the columns, those of the parameters `known` among them. The header may not name any of
    /// `constants`, parameters that do not vary.
    ///
    /// # Errors
    ///
    /// The column that is missing or refused.
    pub fn find(
        header: &StringRecord,
        variables: &Variables,
        measured: &[String],
        (known, constants): (&[String], &[String]),
    ) -> Result<Self, String> {
        if let Some(column) = header.iter().find(|column| constants.iter().any(|c| c == column)) {
            return Err(format!(
                "column `{column}` is a parameter, which is constant here; remove the column"
            ));
        }
        let inputs = variables.input_names();
        let measured: Vec<_> = measured.iter().map(|name| format!("y_{name}")).collect();
        let expected = [&["t".to_owned()][..], &inputs, known, &measured].concat();
        let column = |name: &String| Ok((place(header, name, &expected)?, name.clone()));
        let all = |names: &[String]| names.iter().map(column).collect::<Result<Vec<_>, String>>();
        Ok(Self {
            t: place(header, "t", &expected)?,
            inputs: all(&inputs)?,
            known: all(known)?,
            measured: all(&measured)?,
            states: all(&variables.state_names()).ok(),
        })
    }

    /// The columns without the true states, which do not matter everywhere.
    #[must_use]
    pub fn without_truth(self) -> Self {
        Self { states: None, ..self }
    }

    /// Reads a row.
    ///
    /// # Errors
    ///
    /// The cell that is no number.
    pub fn read(&self, cells: &StringRecord) -> Result<RecordedRow, String> {
        let number = |(place, name): &(usize, String)| finite(&cells[*place], name);
        let measurement = |(place, name): &(usize, String)| match &cells[*place] {
            "NaN" | "nan" | "NAN" => Ok(f64::NAN),
            cell => Ok(optional(cell, name)?.unwrap_or(f64::NAN)),
        };
        let truth = self.states.as_ref().map(|states| states.iter().map(number).collect());
        Ok(RecordedRow {
            t: finite(&cells[self.t], "t")?,
            u: self.inputs.iter().map(number).collect::<Result<_, String>>()?,
            known: self.known.iter().map(number).collect::<Result<_, String>>()?,
            y: self.measured.iter().map(measurement).collect::<Result<_, String>>()?,
            truth: truth.transpose()?,
        })
    }
}
