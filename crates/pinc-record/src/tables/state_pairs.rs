//! Tables with two numbers per state over time.

use crate::csv::{CsvFile, CsvText};
use crate::error::RecordError;
use std::path::Path;

const TIME: &str = "t";

/// What the two numbers of a state are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pair {
    /// `model-error.csv`: the errors of one step of a net along a closed loop, estimated and true,
    /// `<state>_err` and `<state>_true_err`; NaN where the equation has no solution.
    Errors,
    /// `plans.csv`: the least and the greatest value that a plan expects, `<state>_low` and
    /// `<state>_high`. A plan begins at the measured state, or with NaN where it begins later, and
    /// a row of NaN, as empty cells, follows it.
    Range,
}

impl Pair {
    fn suffixes(self) -> [&'static str; 2] {
        match self {
            Self::Errors => ["_err", "_true_err"],
            Self::Range => ["_low", "_high"],
        }
    }
}

/// Two numbers of each state over time.
#[derive(Clone, Debug, PartialEq)]
pub struct StatePairs {
    /// What they are.
    pub of: Pair,
    /// Names of the states.
    pub states: Vec<String>,
    /// The rows, in the order of the file.
    pub rows: Vec<PairRow>,
}

/// Two numbers of each state.
#[derive(Clone, Debug, PartialEq)]
pub struct PairRow {
    /// The time in s.
    pub t: f64,
    /// The first and the second numbers, in the states' units.
    pub values: [Vec<f64>; 2],
}

impl StatePairs {
    /// The table as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let suffixes = self.of.suffixes();
        let of = |state: &String| suffixes.map(|suffix| format!("{state}{suffix}"));
        let columns = self.states.iter().flat_map(of);
        let mut table = CsvText::new([TIME.to_owned()].into_iter().chain(columns));
        for row in &self.rows {
            let [first, second] = &row.values;
            let pairs = first.iter().zip(second).flat_map(|(a, b)| [a, b]);
            let cell = |of: &f64| if of.is_nan() { String::new() } else { format!("{of:?}") };
            table.push([&row.t].into_iter().chain(pairs).map(cell));
        }
        table
    }

    /// Reads the table; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path, of: Pair) -> Result<Option<Self>, RecordError> {
        let Some(CsvFile { head, rows }) = CsvFile::read(path)? else { return Ok(None) };
        let [first, second] = of.suffixes();
        let names = head.header.iter().filter_map(|name| name.strip_suffix(second));
        let states: Vec<String> = names.map(str::to_owned).collect();
        let places = |suffix: &str| head.places(&states, |name| format!("{name}{suffix}"));
        let (t, first, second) = (head.place(TIME)?, places(first)?, places(second)?);
        let row = |row| {
            let numbers = |places: &[usize]| head.numbers(row, places.iter().copied());
            let values = [numbers(&first)?, numbers(&second)?];
            Ok(PairRow { t: head.number(row, t)?, values })
        };
        let rows = rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        Ok(Some(Self { of, states, rows }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_along_a_loop_read_back_bit_for_bit() {
        let row = |t: f64| PairRow { t, values: [vec![0.1 + 0.2, -1e-300], vec![1.0 / 3.0, t]] };
        let table = StatePairs {
            of: Pair::Errors,
            states: ["x", "v"].map(str::to_owned).to_vec(),
            rows: vec![row(0.0), row(0.5)],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("model-error.csv");
        assert_eq!(StatePairs::read(&path, Pair::Errors).unwrap(), None);
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        assert_eq!(StatePairs::read(&path, Pair::Errors).unwrap(), Some(table));
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("t,x_err,x_true_err,v_err,v_true_err\n0.0,"), "{text}");
        let nothing = PairRow { t: 0.9, values: [vec![f64::NAN], vec![f64::NAN]] };
        let table =
            StatePairs { of: Pair::Range, states: vec!["x".to_owned()], rows: vec![nothing] };
        assert_eq!(table.to_csv().as_bytes(), b"t,x_low,x_high\n0.9,,\n");
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        let read = StatePairs::read(&path, Pair::Range).unwrap().unwrap();
        assert!(read.rows[0].values[1][0].is_nan());
        std::fs::write(&path, "t,x_true_err\n1,2\n").unwrap();
        let message = StatePairs::read(&path, Pair::Errors).unwrap_err().to_string();
        assert!(message.contains("no column `x_err`"), "{message}");
    }
}
