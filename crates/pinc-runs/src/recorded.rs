//! Recorded data: the columns `t`, the inputs, and `y_` with the name of what is measured.

use csv::StringRecord;
use pinc_config::Variables;
use pinc_record::columns::{finite, optional, place};

/// Where in a row the columns are, with their names.
pub(super) struct Columns {
    t: usize,
    inputs: Vec<(usize, String)>,
    measured: Vec<(usize, String)>,
    pub(super) states: Option<Vec<(usize, String)>>,
}

/// One row; a measurement that is missing is NaN.
pub(super) struct DataRow {
    pub(super) t: f64,
    pub(super) u: Vec<f64>,
    pub(super) y: Vec<f64>,
    pub(super) truth: Option<Vec<f64>>,
}

impl DataRow {
    /// The steps of T since the time `before`, if they are whole as far as times tell: doubles have
    /// Unix times to 2.4e-7 s.
    pub(super) fn steps_since(&self, before: f64, sample_time_s: f64) -> Option<f64> {
        let steps = (self.t - before) / sample_time_s;
        let resolution = 2.0 * f64::EPSILON * self.t.abs() / sample_time_s;
        let near = steps.max(1.0) * (1e-6 + resolution);
        ((steps - steps.round()).abs() <= near.min(0.1)).then_some(steps.round())
    }
}

impl Columns {
    /// Finds the columns. The header may not name any of `constants`, parameters that do not vary.
    pub(super) fn find(
        header: &StringRecord,
        variables: &Variables,
        measured: &[String],
        constants: &[String],
    ) -> Result<Self, String> {
        if let Some(column) = header.iter().find(|column| constants.iter().any(|c| c == column)) {
            return Err(format!(
                "column `{column}` is a parameter, which is constant here; remove the column"
            ));
        }
        let inputs = variables.input_names();
        let measured: Vec<_> = measured.iter().map(|name| format!("y_{name}")).collect();
        let expected = [&["t".to_owned()][..], &inputs, &measured].concat();
        let column = |name: &String| Ok((place(header, name, &expected)?, name.clone()));
        let all = |names: &[String]| names.iter().map(column).collect::<Result<Vec<_>, String>>();
        Ok(Self {
            t: place(header, "t", &expected)?,
            inputs: all(&inputs)?,
            measured: all(&measured)?,
            states: all(&variables.state_names()).ok(),
        })
    }

    /// The columns without the true states, which do not matter everywhere.
    pub(super) fn without_truth(self) -> Self {
        Self { states: None, ..self }
    }

    pub(super) fn read(&self, cells: &StringRecord) -> Result<DataRow, String> {
        let number = |(place, name): &(usize, String)| finite(&cells[*place], name);
        let measurement = |(place, name): &(usize, String)| match &cells[*place] {
            "NaN" | "nan" | "NAN" => Ok(f64::NAN),
            cell => Ok(optional(cell, name)?.unwrap_or(f64::NAN)),
        };
        let truth = self.states.as_ref().map(|states| states.iter().map(number).collect());
        Ok(DataRow {
            t: finite(&cells[self.t], "t")?,
            u: self.inputs.iter().map(number).collect::<Result<_, String>>()?,
            y: self.measured.iter().map(measurement).collect::<Result<_, String>>()?,
            truth: truth.transpose()?,
        })
    }
}
