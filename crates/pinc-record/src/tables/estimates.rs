//! `estimates.csv`: what an estimator made of measurements.

use crate::csv::{CsvFile, CsvText, number};
use crate::error::RecordError;
use std::path::Path;

const TIME: &str = "t";
const NIS: &str = "nis";
const NEES: &str = "nees";
const REJECTED: &str = "rejected";

/// Filtered estimates: the columns are `t`, all that is estimated by name, their `<name>_sd`, and,
/// with the measurements, `y_<measured>`, `innovation_<measured>`, `nis`, `nees` and `rejected`.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimateTable {
    /// The estimated quantities: states, disturbances, parameters.
    pub names: Vec<String>,
    /// The measured quantities.
    pub measured: Vec<String>,
    /// The rows, by time.
    pub rows: Vec<EstimateRow>,
}

/// The estimates of one time.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimateRow {
    /// Time in s.
    pub t: f64,
    /// The estimates, in their units.
    pub estimate: Vec<f64>,
    /// Their standard deviations.
    pub sd: Vec<f64>,
    /// The measured values; NaN where missing.
    pub measured: Vec<f64>,
    /// Measured minus expected; NaN where it was not measured, or rejected.
    pub innovation: Vec<f64>,
    /// The normalized innovation squared.
    pub nis: f64,
    /// The normalized error squared.
    pub nees: f64,
    /// How many measurements the estimator's gate rejected.
    pub rejected: usize,
}

impl EstimateTable {
    /// The table as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let mut columns = self.estimate_columns();
        columns.extend(self.measured.iter().map(|name| format!("y_{name}")));
        columns.extend(self.measured.iter().map(|name| format!("innovation_{name}")));
        columns.extend([NIS, NEES, REJECTED].map(str::to_owned));
        let mut table = CsvText::new(columns);
        for row in &self.rows {
            let values = std::iter::once(&row.t).chain(&row.estimate).chain(&row.sd);
            let values = values.chain(&row.measured).chain(&row.innovation);
            let numbers = values.chain([&row.nis, &row.nees]).map(|value| number(*value));
            table.push(numbers.chain([row.rejected.to_string()]));
        }
        table
    }

    /// The estimates alone as a CSV file.
    #[must_use]
    pub fn estimates_to_csv(&self) -> CsvText {
        let mut table = CsvText::new(self.estimate_columns());
        for row in &self.rows {
            table.push_numbers(std::iter::once(&row.t).chain(&row.estimate).chain(&row.sd));
        }
        table
    }

    fn estimate_columns(&self) -> Vec<String> {
        let mut columns = vec![TIME.to_owned()];
        columns.extend(self.names.iter().cloned());
        columns.extend(self.names.iter().map(|name| format!("{name}_sd")));
        columns
    }

    /// Reads the table; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path) -> Result<Option<Self>, RecordError> {
        let Some(CsvFile { head: file, rows }) = CsvFile::read(path)? else { return Ok(None) };
        let t = file.place(TIME)?;
        let with_partner = |partner: fn(&str) -> Option<String>| -> Vec<String> {
            let columns = file.header.iter();
            let has = |name: &&str| partner(name).is_some_and(|p| file.position(&p).is_some());
            columns.filter(has).map(str::to_owned).collect()
        };
        let names = with_partner(|name| Some(format!("{name}_sd")));
        let innovation = |name: &str| Some(format!("innovation_{}", name.strip_prefix("y_")?));
        let measured = with_partner(innovation);
        let measured: Vec<_> = measured.iter().map(|name| name[2..].to_owned()).collect();
        let estimates = file.places(&names, str::to_owned)?;
        let sd = file.places(&names, |name| format!("{name}_sd"))?;
        let y = file.places(&measured, |name| format!("y_{name}"))?;
        let innovations = file.places(&measured, |name| format!("innovation_{name}"))?;
        let (nis, nees) = (file.place(NIS)?, file.place(NEES)?);
        let rejected = file.position(REJECTED);
        let row = |row| {
            let numbers = |places: &[usize]| file.numbers(row, places.iter().copied());
            Ok(EstimateRow {
                t: file.number(row, t)?,
                estimate: numbers(&estimates)?,
                sd: numbers(&sd)?,
                measured: numbers(&y)?,
                innovation: numbers(&innovations)?,
                nis: file.number(row, nis)?,
                nees: file.number(row, nees)?,
                rejected: rejected.map_or(Ok(0), |place| file.whole(row, place))?,
            })
        };
        let rows = rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        Ok(Some(Self { names, measured, rows }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn estimates_read_back_bit_for_bit() {
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let row = EstimateRow {
            t: 0.1 + 0.2,
            estimate: vec![1.0 / 3.0, -0.15],
            sd: vec![0.01, 0.5],
            measured: vec![0.3],
            innovation: vec![-0.03],
            nis: 1.5,
            nees: 2.5,
            rejected: 1,
        };
        let table =
            EstimateTable { names: names(&["h", "d_u"]), measured: names(&["h"]), rows: vec![row] };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("estimates.csv");
        let read = || EstimateTable::read(&path);
        assert!(read().unwrap().is_none());
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        assert_eq!(read().unwrap().unwrap(), table);
        let text = String::from_utf8(table.to_csv().as_bytes().to_vec()).unwrap();
        let header = "t,h,d_u,h_sd,d_u_sd,y_h,innovation_h,nis,nees,rejected\n";
        assert!(text.starts_with(header) && text.trim_end().ends_with(",1.5,2.5,1"), "{text}");
        let alone = table.estimates_to_csv();
        let text = String::from_utf8(alone.as_bytes().to_vec()).unwrap();
        assert!(text.starts_with("t,h,d_u,h_sd,d_u_sd\n"), "{text}");
    }
}
