//! `control.csv`: the dense trace of a closed loop.

use crate::csv::{CsvReader, CsvWriter};
use crate::error::RecordError;
use csv::StringRecord;
use std::fs::File;
use std::ops::Range;
use std::path::Path;

const TIME: &str = "t";

fn reference_column(quantity: &str) -> String {
    format!("{quantity}_ref")
}

/// The columns of a closed loop's trace: `t`, the states, the inputs, `<controlled quantity>_ref`
/// and the outputs that are no states.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ControlColumns {
    /// Names of the states.
    pub states: Vec<String>,
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// Names of the states and outputs that follow a reference.
    pub controlled: Vec<String>,
    /// Names of the outputs that are no states.
    pub outputs: Vec<String>,
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

/// A trace being written row by row; it is at its place once it is finished.
#[derive(Debug)]
pub struct ControlWriter(CsvWriter);

impl ControlWriter {
    /// Begins the file `path`.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`], as of the other methods.
    pub fn create(path: &Path, columns: &ControlColumns) -> Result<Self, RecordError> {
        let mut names = vec![TIME.to_owned()];
        names.extend(columns.states.iter().chain(&columns.inputs).cloned());
        names.extend(columns.controlled.iter().map(|name| reference_column(name)));
        names.extend(columns.outputs.iter().cloned());
        CsvWriter::create(path, names).map(Self)
    }

    /// Adds a row.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn push(&mut self, row: &ControlRow) -> Result<(), RecordError> {
        let values = std::iter::once(&row.t).chain(&row.state).chain(&row.input);
        self.0.push_numbers(values.chain(&row.reference).chain(&row.output))
    }

    /// Puts the file at its place.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn finish(self) -> Result<(), RecordError> {
        self.0.finish()
    }
}

/// A trace being read row by row.
#[derive(Debug)]
pub struct ControlReader {
    file: CsvReader<File>,
    columns: ControlColumns,
    /// The places of the time, and of the first input, reference and output.
    t: usize,
    input: usize,
    reference: usize,
    output: usize,
}

impl ControlReader {
    /// Begins to read the trace of a loop with so many states and inputs in which the quantities
    /// `controlled` follow references; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn open(
        path: &Path,
        [states, inputs]: [usize; 2],
        controlled: &[String],
    ) -> Result<Option<Self>, RecordError> {
        let Some(file) = CsvReader::open(path)? else { return Ok(None) };
        let head = &file.head;
        let t = head.place(TIME)?;
        let wanted: Vec<String> = controlled.iter().map(|name| reference_column(name)).collect();
        let names: Vec<&str> = head.header.iter().collect();
        let input = t + 1 + states;
        let reference = input + inputs;
        let output = reference + wanted.len();
        if names.get(reference..output).is_none_or(|there| there != wanted) {
            let lacks = wanted.iter().find(|name| !names.contains(&name.as_str()));
            let lacks = lacks.or(wanted.first()).map_or("the inputs", String::as_str);
            return Err(head.missing(lacks));
        }
        let names = |places: Range<usize>| names[places].iter().map(|&n| n.to_owned()).collect();
        let columns = ControlColumns {
            states: names(t + 1..input),
            inputs: names(input..reference),
            controlled: controlled.to_vec(),
            outputs: names(output..head.header.len()),
        };
        Ok(Some(Self { file, columns, t, input, reference, output }))
    }

    /// The columns.
    #[must_use]
    pub fn columns(&self) -> &ControlColumns {
        &self.columns
    }

    fn parse(&self, row: &StringRecord) -> Result<ControlRow, RecordError> {
        let head = &self.file.head;
        Ok(ControlRow {
            t: head.number(row, self.t)?,
            state: head.numbers(row, self.t + 1..self.input)?,
            input: head.numbers(row, self.input..self.reference)?,
            reference: head.numbers(row, self.reference..self.output)?,
            output: head.numbers(row, self.output..head.header.len())?,
        })
    }
}

/// The rows by time, each with the line and column of what is wrong.
impl Iterator for ControlReader {
    type Item = Result<ControlRow, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        let row = self.file.next_row()?;
        Some(row.and_then(|row| self.parse(&row)))
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
        let columns = ControlColumns {
            states: names(&["a", "b_ref"]),
            inputs: names(&["u"]),
            controlled: names(&["a"]),
            outputs: names(&["sum", "difference"]),
        };
        let rows = [row(0.0), row(0.1 + 0.2)];
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("control.csv");
        let mut writer = ControlWriter::create(&path, &columns).unwrap();
        assert!(ControlReader::open(&path, [2, 1], &columns.controlled).unwrap().is_none());
        rows.iter().for_each(|row| writer.push(row).unwrap());
        writer.finish().unwrap();
        let reader = ControlReader::open(&path, [2, 1], &columns.controlled).unwrap().unwrap();
        assert_eq!(*reader.columns(), columns);
        assert_eq!(reader.collect::<Result<Vec<_>, _>>().unwrap(), rows);
        let other = ControlReader::open(&path, [2, 1], &["c".to_owned()]).unwrap_err().to_string();
        assert!(other.contains("control.csv:1: no column `c_ref`"), "{other}");
        drop(ControlWriter::create(&path, &ControlColumns::default()).unwrap());

        // Where nothing is controlled, outputs follow the inputs.
        let columns = ControlColumns { controlled: vec![], ..columns };
        let path = dir.path().join("free.csv");
        let mut writer = ControlWriter::create(&path, &columns).unwrap();
        let free = ControlRow { reference: vec![], ..row(0.5) };
        writer.push(&free).unwrap();
        writer.finish().unwrap();
        let reader = ControlReader::open(&path, [2, 1], &[]).unwrap().unwrap();
        assert_eq!(*reader.columns(), columns);
        assert_eq!(reader.collect::<Result<Vec<_>, _>>().unwrap(), [free]);
        assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 2);
    }
}
