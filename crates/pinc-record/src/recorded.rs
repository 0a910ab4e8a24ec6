//! Recorded data: the columns `t`, the inputs, known parameters, and `y_` with the name of what is
//! measured.

use crate::columns::{At, finite, optional, place, too_far};
use ::csv::StringRecord;
use pinc_config::Variables;

/// How many steps may lie between two rows.
const LONGEST_GAP: f64 = 1e6;

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

/// A recorded file with a row for each step.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedSteps {
    /// The file's name.
    pub name: String,
    /// The times, in s.
    pub t: Vec<f64>,
    /// The inputs from then on, step by step.
    pub u: Vec<f64>,
    /// What is measured, step by step, NaN where it is missing.
    pub y: Vec<f64>,
}

impl RecordedSteps {
    /// Fills the steps between rows, which come with their lines: there is no measurement, and the
    /// input holds.
    ///
    /// # Errors
    ///
    /// The line of a row that is no whole number of steps after the one before, or too many.
    pub fn filled(name: &str, rows: &[(u64, RecordedRow)], sample_time_s: f64) -> Result<Self, At> {
        let [t, u, y] = [const { Vec::new() }; 3];
        let mut all = Self { name: name.to_owned(), t, u, y };
        let mut before: Option<&RecordedRow> = None;
        for (line, row) in rows {
            if let Some(before) = before {
                if (row.t - before.t) / sample_time_s > LONGEST_GAP {
                    return Err((*line, too_far(row.t)));
                }
                let steps = row.steps_since(before.t, sample_time_s).filter(|steps| *steps >= 1.0);
                let steps = steps.ok_or_else(|| {
                    let problem = format!(
                        "column `t`: {} s after {} s given, expected a whole number of steps of T \
                         = {sample_time_s} s; identify.step_s sets T for integrators",
                        row.t, before.t
                    );
                    (*line, problem)
                })?;
                for k in (1..).map(f64::from).take_while(|k| *k < steps) {
                    all.u.extend(&before.u);
                    all.y.extend(std::iter::repeat_n(f64::NAN, row.y.len()));
                    all.t.push(before.t + k * sample_time_s);
                }
            }
            all.u.extend(&row.u);
            all.y.extend(&row.y);
            all.t.push(row.t);
            before = Some(row);
        }
        Ok(all)
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
                "column `{column}` is a parameter, which is constant here; remove the column, or \
                 make it an input of the plant if it changes"
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps of 0.1 s of Unix times: a double has these to 2.4e-7 s only.
    #[test]
    fn times_are_whole_steps_apart_as_far_as_doubles_tell() {
        let row =
            |t: f64| RecordedRow { t, u: vec![0.0], known: Vec::new(), y: vec![1.0], truth: None };
        let filled = |times: &[f64], sample_time_s| {
            let rows: Vec<_> = (2..).zip(times.iter().map(|t| row(*t))).collect();
            RecordedSteps::filled("times.csv", &rows, sample_time_s)
        };
        let times = [1700000000.0, 1700000000.1, 1700000000.2, 1700000007.3, 1700000017.5];
        assert_eq!(filled(&times, 0.1).unwrap().t.len(), 176);
        // T as the shortest step in the data has it.
        assert_eq!(filled(&times, times[1] - times[0]).unwrap().t.len(), 176);
        for apart in
            [[1700000000.0, 1700000000.1002], [0.0, 0.100001], [0.0, 1e-9], [1.7e9, 1.7e9 + 0.04]]
        {
            assert!(filled(&apart, 0.1).is_err(), "{apart:?}");
        }
        assert!(filled(&[0.0, 0.4], 0.1).is_ok());
    }

    /// Between two rows 1.5 s apart are two steps of 0.5 s, in which the input stays and nothing is
    /// measured.
    #[test]
    fn gaps_hold_the_input_and_have_no_measurement() {
        let row = |t: f64, u: f64, y: f64| {
            let (u, y) = (vec![u, -u], vec![y, 10.0 * y, 100.0 * y]);
            RecordedRow { t, u, known: Vec::new(), y, truth: None }
        };
        let rows = [(2, row(1.0, 3.0, 5.0)), (3, row(2.5, 4.0, 6.0)), (4, row(3.0, 5.0, 7.0))];
        let filled = RecordedSteps::filled("gaps.csv", &rows, 0.5).unwrap();
        assert_eq!(filled.t, [1.0, 1.5, 2.0, 2.5, 3.0]);
        assert_eq!(filled.u, [3.0, -3.0, 3.0, -3.0, 3.0, -3.0, 4.0, -4.0, 5.0, -5.0]);
        assert_eq!(filled.y.len(), 15);
        assert_eq!(
            (&filled.y[..3], &filled.y[9..12]),
            (&[5.0, 50.0, 500.0][..], &[6.0, 60.0, 600.0][..])
        );
        assert!(filled.y[3..9].iter().all(|y| y.is_nan()));
        assert_eq!((filled.y[12], &*filled.name), (7.0, "gaps.csv"));
        // A fault has the line of the later row.
        let (line, said) = RecordedSteps::filled("", &rows[..2], 1.0).unwrap_err();
        assert_eq!(line, 3);
        assert!(said.starts_with("column `t`: 2.5 s after 1 s given, expected a whole"), "{said}");
        let far = [(2, row(0.0, 1.0, 1.0)), (7, row(1.1e6, 1.0, 1.0))];
        assert_eq!(RecordedSteps::filled("", &far, 1.0).unwrap_err().0, 7);
        let back = [(2, row(1.0, 1.0, 1.0)), (3, row(0.0, 1.0, 1.0))];
        assert_eq!(RecordedSteps::filled("", &back, 1.0).unwrap_err().0, 3);
    }

    /// Columns are found by their names, in any order: the time, inputs, known parameters,
    /// measurements with `y_` before them, and the states themselves if they are there.
    #[test]
    fn cells_are_read_by_the_names_of_their_columns() {
        let plant = pinc_config::Plants::built_in();
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
        let experiment = pinc_config::Experiment::load(path.as_ref(), &[], &plant).unwrap();
        let variables = Variables::of(&*experiment.plant.dyn_plant());
        let names = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let find = |header: &[&str]| {
            let header = StringRecord::from(header.to_vec());
            let known = (&names(&["k"])[..], &names(&["c"])[..]);
            RecordedColumns::find(&header, &variables, &names(&["h"]), known)
        };
        let columns = find(&["h", "y_h", "k", "u", "other", "t"]).unwrap();
        let cells = StringRecord::from(vec!["1.5", "2.5", "3.5", "4.5", "text", "5.5"]);
        let row = columns.read(&cells).unwrap();
        let expected = RecordedRow {
            t: 5.5,
            u: vec![4.5],
            known: vec![3.5],
            y: vec![2.5],
            truth: Some(vec![1.5]),
        };
        assert_eq!(row, expected);
        let row = columns.clone().without_truth().read(&cells).unwrap();
        assert_eq!(row, RecordedRow { truth: None, ..expected.clone() });
        // A measurement may be missing, an input or a known parameter not.
        for missing in ["", "NaN", "nan"] {
            let cells = StringRecord::from(vec!["1.5", missing, "3.5", "4.5", "", "5.5"]);
            assert!(columns.read(&cells).unwrap().y[0].is_nan(), "{missing}");
        }
        for (place, name) in [(2, "k"), (3, "u"), (5, "t"), (0, "h")] {
            let mut cells = vec!["1.5", "2.5", "3.5", "4.5", "", "5.5"];
            cells[place] = "";
            let said = columns.read(&StringRecord::from(cells)).unwrap_err();
            assert!(said.starts_with(&format!("column `{name}`: `` given")), "{said}");
        }
        let columns = find(&["t", "u", "k", "y_h"]).unwrap();
        let row = columns.read(&StringRecord::from(vec!["5.5", "4.5", "3.5", "2.5"])).unwrap();
        assert_eq!(row, RecordedRow { truth: None, ..expected });
        let said = find(&["t", "u", "y_h"]).unwrap_err();
        assert_eq!(said, "column `k` is missing; expected t,u,k,y_h");
        let said = find(&["t", "u", "k", "y_h", "c"]).unwrap_err();
        assert!(said.starts_with("column `c` is a parameter, which is constant here"), "{said}");
    }
}
