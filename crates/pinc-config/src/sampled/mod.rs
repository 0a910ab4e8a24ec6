//! Schedules given as functions of t or as files, sampled at the control steps into lists of steps.
//!
//! Instead of a list of steps, a config may have a table by name,
//!
//! ```toml
//! [control.references]
//! h1 = "10 + 2*sin(t/60)"                                    # a function of t in s, or a number
//! h2 = { file = "day.csv", interpolation = "linear" }        # its column `h2`, by its column `t`
//! ```
//!
//! or a file alone, of which all columns except `t` are taken.

mod file;

pub use file::{CsvProblem, CsvRow, csv_rows};

use crate::validate::rounded;
use file::File;
use pinc_expr::TimeFunction;
use pinc_toml::{Problem, nearest};
use std::collections::BTreeMap;
use std::path::Path;
use toml::{Table, Value};

/// A value, or the key and what is wrong there.
type Checked<T> = Result<T, (String, Problem)>;

/// Steps that a schedule may be written out to at most.
const MOST_STEPS: usize = 100_000;

/// Names of bounds, the lower ones first.
pub(crate) const BOUNDS: [&str; 6] =
    ["state_low", "input_low", "output_low", "state_high", "input_high", "output_high"];

/// At which times of a step a schedule is looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sampling {
    /// At its start: the value is held.
    Start,
    /// At its end, where it is compared with the plant.
    End,
    /// At both: the larger value.
    Larger,
    /// At both: the smaller value.
    Smaller,
}

/// The steps of a closed loop.
#[derive(Clone, Copy, Debug)]
struct Grid {
    sample_time_s: f64,
    steps: usize,
}

/// A value over time.
enum Signal {
    Number(f64),
    Function(TimeFunction),
    Column { times: Vec<f64>, values: Vec<f64>, is_linear: bool },
}

/// Writes all schedules out. Returns the keys of those that were written otherwise, with what was there.
pub(crate) fn write_out(table: &mut Table) -> Checked<Vec<(String, Value)>> {
    let mut written = Vec::new();
    let grid = grid(table);
    let Some(control) = table.get_mut("control").and_then(Value::as_table_mut) else {
        return Ok(written);
    };
    for (key, sampling, field) in [
        ("references", Sampling::End, "value"),
        ("parameter_schedule", Sampling::Start, "values"),
        ("plant_schedule", Sampling::Start, "values"),
    ] {
        let Some(Value::Table(given)) = control.get(key) else { continue };
        let path = format!("control.{key}");
        let grid = grid.clone().map_err(|expected| no_grid(&path, expected))?;
        let sides = [(field, signals(&path, given, grid)?, sampling)];
        let steps = grid.write_out(&path, &sides)?;
        written.extend(control.insert(key.to_owned(), steps).map(|old| (path, old)));
    }
    let (key, path) = ("bound_schedule", "control.bound_schedule");
    if let Some(Value::Table(given)) = control.get(key) {
        let grid = grid.map_err(|expected| no_grid(path, expected))?;
        let steps = bounds(path, given, grid)?;
        written.extend(control.insert(key.to_owned(), steps).map(|old| (path.to_owned(), old)));
    }
    Ok(written)
}

/// The steps of bounds, which are kept at both ends of each step.
fn bounds(path: &str, given: &Table, grid: Grid) -> Checked<Value> {
    let mut sides = Vec::new();
    for (side, value) in given {
        let path = format!("{path}.{side}");
        let Some(&known) = BOUNDS.iter().find(|known| *known == side) else {
            let known: Vec<String> = BOUNDS.map(str::to_owned).to_vec();
            let nearest = nearest(side, &known);
            return Err((path, Problem::Unknown { known, nearest }));
        };
        let Value::Table(value) = value else { return Err((path, wrong_type(value))) };
        let sampling = if side.ends_with("low") { Sampling::Larger } else { Sampling::Smaller };
        sides.push((known, signals(&path, value, grid)?, sampling));
    }
    grid.write_out(path, &sides)
}

fn no_grid(path: &str, expected: String) -> (String, Problem) {
    let found = "functions of t or a file".to_owned();
    (path.to_owned(), Problem::Value { found, expected })
}

/// The steps of the loop of a resolved table, or what there should be for them.
fn grid(table: &Table) -> Result<Grid, String> {
    let number = |value: Option<&Value>| match value? {
        Value::Float(number) => Some(*number),
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    };
    let control = table.get("control");
    let of = |key: &str| control.and_then(|control| control.get(key));
    let first = of("stages_s").and_then(|stages| stages.get(0));
    let model = table.get("model").and_then(|model| model.get("horizon_s"));
    let length = number(first).or_else(|| number(model)).or_else(|| number(of("step_s")));
    let duration = number(of("duration_s"));
    let (Some(sample_time_s), Some(duration_s)) =
        (length.filter(|s| *s > 0.0), duration.filter(|s| *s > 0.0))
    else {
        return Err("a list of steps, or also a step, control.step_s or model.horizon_s, and \
                    control.duration_s, both positive"
            .to_owned());
    };
    let steps = duration_s / sample_time_s;
    let most = MOST_STEPS as f64;
    if steps > most {
        return Err(format!("a run of {MOST_STEPS} steps at most; it has {steps:.0}"));
    }
    #[expect(clippy::cast_possible_truncation, reason = "checked above")]
    Ok(Grid { sample_time_s, steps: (steps.round() as usize).max(1) })
}

impl Grid {
    fn time(self, step: usize) -> f64 {
        rounded(step as f64 * self.sample_time_s)
    }

    /// A list with one entry for each step in which a value differs from the one before. Each of
    /// `sides` is a table of it.
    fn write_out(
        self,
        path: &str,
        sides: &[(&str, BTreeMap<String, Signal>, Sampling)],
    ) -> Checked<Value> {
        let mut steps: Vec<Value> = Vec::new();
        let mut last = Table::new();
        for step in 0..self.steps {
            let ends = [self.time(step), self.time(step + 1)];
            let mut now = Table::new();
            for (field, signals, sampling) in sides {
                let mut values = Table::new();
                for (name, signal) in signals {
                    let value = signal.sample(ends, *sampling).map_err(|found| {
                        let expected = "finite numbers".to_owned();
                        (format!("{path}.{name}"), Problem::Value { found, expected })
                    })?;
                    values.insert(name.clone(), Value::Float(value));
                }
                now.insert((*field).to_owned(), Value::Table(values));
            }
            if step == 0 || now != last {
                last.clone_from(&now);
                now.insert("start_s".to_owned(), Value::Float(ends[0]));
                steps.push(Value::Table(now));
            }
        }
        Ok(Value::Array(steps))
    }
}

/// The signals of a table by name, or of all columns of a file.
fn signals(path: &str, given: &Table, grid: Grid) -> Checked<BTreeMap<String, Signal>> {
    if is_file(given) {
        let file = File::read(path, given, grid)?;
        let columns: Vec<String> = file.columns.keys().cloned().collect();
        return columns
            .into_iter()
            .map(|name| Ok((name.clone(), file.signal(path, &name)?)))
            .collect();
    }
    let mut files: BTreeMap<String, File> = BTreeMap::new();
    let mut all = BTreeMap::new();
    for (name, value) in given {
        let path = format!("{path}.{name}");
        let signal = match value {
            Value::Float(number) => Signal::Number(*number),
            Value::Integer(number) => Signal::Number(*number as f64),
            Value::String(text) => Signal::Function(function(&path, text)?),
            Value::Table(table) if is_file(table) => {
                let key = table.to_string();
                if !files.contains_key(&key) {
                    files.insert(key.clone(), File::read(&path, table, grid)?);
                }
                files[&key].signal(&path, name)?
            }
            other => return Err((path, wrong_type(other))),
        };
        all.insert(name.clone(), signal);
    }
    Ok(all)
}

fn is_file(table: &Table) -> bool {
    let file = table.get("file").and_then(Value::as_str);
    let is_csv = |file: &str| Path::new(file).extension().is_some_and(|end| end == "csv");
    file.is_some_and(|file| table.contains_key("interpolation") || is_csv(file))
}

fn wrong_type(found: &Value) -> Problem {
    let expected = "a number, a function of t as text, or { file, interpolation }";
    Problem::Type(format!("invalid type: {}, expected {expected}", found.type_str()))
}

fn function(path: &str, text: &str) -> Checked<TimeFunction> {
    TimeFunction::parse(text).map_err(|error| {
        let misspelt = error.problem.misspelt();
        let nearest = misspelt.and_then(|(found, known)| nearest(found, known));
        (path.to_owned(), Problem::Expression { error: Box::new(error), nearest })
    })
}

impl Signal {
    /// The value in a step, or what it is where that is no finite number.
    fn sample(&self, [start, end]: [f64; 2], sampling: Sampling) -> Result<f64, String> {
        let at = |t| {
            let value = self.at(t);
            if value.is_finite() { Ok(value) } else { Err(format!("{value} at t = {t}")) }
        };
        // A step function has one value in a step, from its start on.
        if let Self::Column { is_linear: false, .. } = self {
            return at(start);
        }
        match sampling {
            Sampling::Start => at(start),
            Sampling::End => at(end),
            Sampling::Larger => Ok(at(start)?.max(at(end)?)),
            Sampling::Smaller => Ok(at(start)?.min(at(end)?)),
        }
    }

    fn at(&self, t: f64) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Function(function) => function.at(t),
            Self::Column { times, values, is_linear } => {
                // Times differ from the times of steps by rounding.
                let next = times.partition_point(|time| *time <= t + 1e-9 * t.abs());
                let before = next.saturating_sub(1);
                if !is_linear || next == times.len() || next == 0 {
                    return values[before];
                }
                let share = (t - times[before]) / (times[next] - times[before]);
                values[before] + share.clamp(0.0, 1.0) * (values[next] - values[before])
            }
        }
    }
}

impl Grid {
    /// Says what a time between two steps should be.
    fn on_a_step(self, time_s: f64) -> Result<(), String> {
        let steps = time_s / self.sample_time_s;
        if (steps - steps.round()).abs() <= 1e-9 * steps {
            return Ok(());
        }
        let [below, above] =
            [steps.floor(), steps.ceil()].map(|steps| rounded(steps * self.sample_time_s));
        let length = self.sample_time_s;
        Err(format!(
            "a whole number of steps of T = {length} s: {below} or {above}; or interpolation = \
             \"linear\""
        ))
    }
}
