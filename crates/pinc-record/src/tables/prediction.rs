//! `prediction.csv`: the free run of a net beside the truth.

use crate::csv::{CsvFile, CsvText, number};
use crate::error::RecordError;
use std::path::Path;

const TIME: &str = "t";
const MARK: &str = "mark";

fn truth(state: &str) -> String {
    format!("{state}_truth")
}

/// A free run: the columns are `t`, the inputs, the states, `<state>_truth` and `mark`.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionTable {
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// Names of the states.
    pub states: Vec<String>,
    /// The rows, by time.
    pub rows: Vec<PredictionRow>,
}

/// One time of a free run.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictionRow {
    /// Time in s.
    pub t: f64,
    /// The inputs from this time to the next row's, in their units.
    pub input: Vec<f64>,
    /// The states that the net predicts, in their units.
    pub state: Vec<f64>,
    /// The states of an accurate integration.
    pub truth: Vec<f64>,
    /// Whether a step of T ends here.
    pub mark: bool,
}

impl PredictionTable {
    /// The table as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let mut columns = vec![TIME.to_owned()];
        columns.extend(self.inputs.iter().chain(&self.states).cloned());
        columns.extend(self.states.iter().map(|state| truth(state)));
        columns.push(MARK.to_owned());
        let mut table = CsvText::new(columns);
        for row in &self.rows {
            let values = std::iter::once(&row.t).chain(&row.input).chain(&row.state);
            let values = values.chain(&row.truth).copied().map(number);
            table.push(values.chain([u8::from(row.mark).to_string()]));
        }
        table
    }

    /// Reads the table; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path) -> Result<Option<Self>, RecordError> {
        let Some(CsvFile { head: file, rows }) = CsvFile::read(path)? else { return Ok(None) };
        let (t, mark) = (file.place(TIME)?, file.place(MARK)?);
        let header: Vec<&str> = file.header.iter().collect();
        // The states are those in front of as many columns of their truth.
        let is_state = |n: &usize| {
            let states = header.get(mark.checked_sub(2 * n)?..mark - n)?;
            let truths = &header[mark - n..mark];
            Some(states.iter().zip(truths).all(|(state, name)| truth(state) == *name))
        };
        let count = (1..=mark / 2).rev().find(|n| is_state(n) == Some(true));
        let count = count.ok_or_else(|| file.missing(&truth("<state>")))?;
        let (inputs, states) = (t + 1..mark - 2 * count, mark - 2 * count..mark - count);
        let names = |places: &std::ops::Range<usize>| {
            header[places.clone()].iter().map(|n| (*n).to_owned())
        };
        let row = |row| {
            Ok(PredictionRow {
                t: file.number(row, t)?,
                input: file.numbers(row, inputs.clone())?,
                state: file.numbers(row, states.clone())?,
                truth: file.numbers(row, mark - count..mark)?,
                mark: file.number(row, mark)? > 0.5,
            })
        };
        let rows = rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        Ok(Some(Self { inputs: names(&inputs).collect(), states: names(&states).collect(), rows }))
    }

    /// The place of a state.
    #[must_use]
    pub fn index_of(&self, state: &str) -> Option<usize> {
        self.states.iter().position(|name| name == state)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_free_run_reads_back_bit_for_bit() {
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        let row = PredictionRow {
            t: 0.1 + 0.2,
            input: vec![1e-5],
            state: vec![1.0, f64::NAN],
            truth: vec![-0.0, 1e300],
            mark: true,
        };
        // States whose names look like truths.
        let table = PredictionTable {
            inputs: names(&["u"]),
            states: names(&["x", "x_truth"]),
            rows: vec![PredictionRow { mark: false, ..row.clone() }, row],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("prediction.csv");
        assert!(PredictionTable::read(&path).unwrap().is_none());
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        let read = PredictionTable::read(&path).unwrap().unwrap();
        assert_eq!(format!("{read:?}"), format!("{table:?}"));
        std::fs::write(&path, "time,u,x,x_truth,mark\n0,1,2,2,1\n").unwrap();
        let message = PredictionTable::read(&path).unwrap_err().to_string();
        assert!(message.contains("prediction.csv:1: no column `t`"), "{message}");
    }
}
