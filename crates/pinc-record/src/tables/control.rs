//! `control.csv`: the dense trace of a closed loop.

use crate::csv::{CsvFile, CsvText};
use crate::error::RecordError;
use std::path::Path;

const TIME: &str = "t";

fn reference(quantity: &str) -> String {
    format!("{quantity}_ref")
}

/// A closed loop: the columns are `t`, the states, the inputs, `<controlled quantity>_ref` and the outputs
/// that are no states.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlTrace {
    /// Names of the states.
    pub states: Vec<String>,
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// Names of the states and outputs that follow a reference.
    pub controlled: Vec<String>,
    /// Names of the outputs that are no states.
    pub outputs: Vec<String>,
    /// The rows, by time.
    pub rows: Vec<ControlRow>,
}

/// One time of a closed loop.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlRow {
    /// Time in s.
    pub t: f64,
    /// The plant's states, in their units.
    pub state: Vec<f64>,
    /// The inputs from this time to the next row's, in their units.
    pub input: Vec<f64>,
    /// The references of the controlled quantities.
    pub reference: Vec<f64>,
    /// The outputs, in their units.
    pub output: Vec<f64>,
}

impl ControlTrace {
    /// The trace as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let mut columns = vec![TIME.to_owned()];
        columns.extend(self.states.iter().chain(&self.inputs).cloned());
        columns.extend(self.controlled.iter().map(|name| reference(name)));
        columns.extend(self.outputs.iter().cloned());
        let mut table = CsvText::new(columns);
        for row in &self.rows {
            let values = std::iter::once(&row.t).chain(&row.state).chain(&row.input);
            table.push_numbers(values.chain(&row.reference).chain(&row.output));
        }
        table
    }

    /// Reads the trace of a loop with so many inputs in which the quantities `controlled` follow
    /// references; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(
        path: &Path,
        inputs: usize,
        controlled: &[String],
    ) -> Result<Option<Self>, RecordError> {
        let Some(file) = CsvFile::read(path)? else { return Ok(None) };
        let t = file.place(TIME)?;
        // The references stand together after the inputs; what follows them are outputs.
        let wanted: Vec<String> = controlled.iter().map(|name| reference(name)).collect();
        let names: Vec<&str> = file.header.iter().collect();
        let together = |place: &usize| names[*place..].iter().zip(&wanted).all(|(a, b)| a == b);
        let places = (t + 1..=names.len().saturating_sub(wanted.len())).rev();
        let Some(first) = places.into_iter().find(together) else {
            let lacks = wanted.iter().find(|name| !names.contains(&name.as_str()));
            return Err(file.missing(lacks.or(wanted.first()).map_or("", String::as_str)));
        };
        let outputs = first + wanted.len();
        let Some(middle) = first.checked_sub(inputs).filter(|middle| *middle > t) else {
            return Err(file.missing("the inputs"));
        };
        let row = |row| {
            Ok(ControlRow {
                t: file.number(row, t)?,
                state: file.numbers(row, t + 1..middle)?,
                input: file.numbers(row, middle..first)?,
                reference: file.numbers(row, first..outputs)?,
                output: file.numbers(row, outputs..file.header.len())?,
            })
        };
        let rows = file.rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        let names = |places: std::ops::Range<usize>| {
            let names = places.filter_map(|place| file.header.get(place));
            names.map(str::to_owned).collect()
        };
        Ok(Some(Self {
            states: names(t + 1..middle),
            inputs: names(middle..first),
            controlled: controlled.to_vec(),
            outputs: names(outputs..file.header.len()),
            rows,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trace_reads_back_bit_for_bit() {
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let row = |t| ControlRow {
            t,
            state: vec![1.0 / 3.0, 1e-5],
            input: vec![0.25],
            reference: vec![-1.0],
            output: vec![2.5, t],
        };
        let trace = ControlTrace {
            states: names(&["a", "b_ref"]),
            inputs: names(&["u"]),
            controlled: names(&["a"]),
            outputs: names(&["sum", "difference"]),
            rows: vec![row(0.0), row(0.1 + 0.2)],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("control.csv");
        assert!(ControlTrace::read(&path, 1, &trace.controlled).unwrap().is_none());
        std::fs::write(&path, trace.to_csv().as_bytes()).unwrap();
        assert_eq!(ControlTrace::read(&path, 1, &trace.controlled).unwrap().unwrap(), trace);
        let other = ControlTrace::read(&path, 1, &["c".to_owned()]).unwrap_err().to_string();
        assert!(other.contains("control.csv:1: no column `c_ref`"), "{other}");
    }
}
