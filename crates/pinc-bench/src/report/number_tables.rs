//! The tables of numbers.

use super::data::{Run, find};
use pinc_chart::text::{self, MISSING};
use serde_json::Value;

/// A table of the report: its title, the heads of its columns, its rows.
#[derive(Clone, Debug)]
pub(super) struct NumberTable {
    pub(super) title: String,
    pub(super) heads: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
}

/// What `metrics.json` says of training, validation, free run and closed loops.
pub(super) fn sheets(run: &Run) -> Vec<NumberTable> {
    let mut sheets = Vec::new();
    for (title, section, rows) in [
        ("Training", "training", TRAINING),
        ("Validation", "validation", VALIDATION),
        ("Free run", "prediction", PREDICTION),
    ] {
        if run.metrics[section].is_object() {
            let row = |row: &Row| vec![row.label.to_owned(), row.show(&run.metrics[section])];
            let rows = rows.iter().map(row).collect();
            sheets.push(NumberTable { title: title.to_owned(), heads: Vec::new(), rows });
        }
    }
    sheets.extend(control(run));
    sheets
}

fn control(run: &Run) -> Option<NumberTable> {
    let models = run.metrics["control"].as_array().filter(|m| !m.is_empty())?;
    let name = |m: &Value| run.model_name(m["model"].as_str().unwrap_or(MISSING));
    let mut heads = vec![String::new()];
    heads.extend(models.iter().map(name));
    let both = pinc_and_rk4(run);
    if both.is_some() {
        heads.push(format!("{} against RK4", run.model_name("pinc")));
    }
    let row = |row: &Row| {
        let mut cells = vec![row.label.to_owned()];
        cells.extend(models.iter().map(|m| row.show(m)));
        if let Some((pinc, rk4)) = both {
            cells.push(row.compare(pinc, rk4));
        }
        cells
    };
    let rows = CONTROL.iter().map(row).collect();
    Some(NumberTable { title: "Closed loop".to_owned(), heads, rows })
}

fn pinc_and_rk4(run: &Run) -> Option<(&Value, &Value)> {
    run.control_metrics("pinc").zip(run.control_metrics("rk4"))
}

/// A row of a table: where its value is found, and how it is written.
struct Row {
    label: &'static str,
    path: &'static [&'static str],
    form: Form,
}

#[derive(Clone, Copy)]
enum Form {
    /// A number to so many digits.
    Number(usize),
    /// A whole number.
    Count,
    /// A number to so many digits, where a quotient of two models says something.
    Compared(usize),
    /// A duration, in this many seconds.
    Time(f64),
    Words,
    /// Mean and spread of the time over repetitions.
    Repeated,
    /// A number of steps for each status.
    Statuses,
}

const fn row(label: &'static str, path: &'static [&'static str], form: Form) -> Row {
    Row { label, path, form }
}

const TRAINING: &[Row] = &[
    row("Wall time", &["wall_s"], Form::Time(1.0)),
    row("Optimiser alone", &["optimizer_s"], Form::Time(1.0)),
    row("Iterations", &["iterations"], Form::Count),
    row("Loss evaluations", &["loss_evaluations"], Form::Count),
    row("Stopped because", &["stop_reason"], Form::Words),
];

const VALIDATION: &[Row] = &[
    row("MSE at the steps t = kT, physical units", &["mse_gen"], Form::Number(3)),
    row("MSE of all rows, normalised", &["mse_all_normalized"], Form::Number(3)),
    row("MSE of one step, from random states", &["one_step_mse"], Form::Number(3)),
];

const PREDICTION: &[Row] = &[
    row("MSE at the steps t = kT, physical units", &["mse_marks"], Form::Number(3)),
    row("MSE of all rows, physical units", &["mse_all"], Form::Number(3)),
];

const CONTROL: &[Row] = &[
    row("RMSE at the steps", &["rmse"], Form::Compared(5)),
    row("IAE at the steps, mean over outputs", &["iae"], Form::Compared(6)),
    row("RMSE, dense trace", &["rmse_dense"], Form::Compared(5)),
    row("IAE, dense trace, sum over outputs", &["iae_dense_sum"], Form::Compared(6)),
    row("Controller, whole run: mean ± sd", &["wall_s"], Form::Repeated),
    row("Controller, whole run: median", &["wall_s", "median"], Form::Time(1.0)),
    row("Controller, one step: median", &["step_us", "p50"], Form::Time(1e-6)),
    row("Controller, one step: 99th percentile", &["step_us", "p99"], Form::Time(1e-6)),
    row("Controller, one step: longest", &["step_us", "max"], Form::Time(1e-6)),
    row("SQP iterations per step", &["sqp_iterations_mean"], Form::Number(3)),
    row("Largest KKT residual", &["kkt_max"], Form::Number(2)),
    row("Largest violation of a bound", &["max_violation"], Form::Number(2)),
    row("Steps by status", &["status"], Form::Statuses),
];

impl Row {
    fn show(&self, section: &Value) -> String {
        let Some(value) = find(section, self.path) else {
            return MISSING.to_owned();
        };
        match self.form {
            Form::Number(digits) | Form::Compared(digits) => {
                value.as_f64().map(|v| text::significant(v, digits))
            }
            Form::Count => value.as_f64().map(|v| text::number(v, 9)),
            Form::Time(unit) => value.as_f64().map(|v| text::duration(v * unit)),
            Form::Words => value.as_str().map(str::to_owned),
            Form::Repeated => repeated(value),
            Form::Statuses => value.as_object().map(|statuses| {
                let each = statuses.iter().map(|(status, n)| format!("{status} {n}"));
                each.collect::<Vec<_>>().join(", ")
            }),
        }
        .unwrap_or_else(|| MISSING.to_owned())
    }

    /// A relative difference, or a quotient of times.
    fn compare(&self, pinc: &Value, rk4: &Value) -> String {
        let value = |section| find(section, self.path).and_then(Value::as_f64);
        let (Some(pinc), Some(rk4)) = (value(pinc), value(rk4)) else {
            return String::new();
        };
        match self.form {
            Form::Compared(_) => comparison(pinc, rk4),
            Form::Time(_) if rk4 > 0.0 => format!("× {}", text::number(pinc / rk4, 3)),
            _ => String::new(),
        }
    }
}

/// "0.02 % higher".
pub(super) fn comparison(value: f64, against: f64) -> String {
    let percent = 100.0 * (value / against - 1.0);
    let size = format!("{} %", text::significant(percent.abs(), 2));
    match percent {
        p if p > 0.0 => format!("{size} higher"),
        p if p < 0.0 => format!("{size} lower"),
        _ => "the same".to_owned(),
    }
}

fn repeated(wall: &Value) -> Option<String> {
    let (mean, sd) = (wall.get("mean")?.as_f64()?, wall.get("sd")?.as_f64()?);
    let runs = wall.get("runs").and_then(Value::as_u64);
    let runs = runs.map_or(String::new(), |n| format!(" ({n} runs)"));
    Some(format!("{} ± {}{runs}", text::duration(mean), text::duration(sd)))
}

/// Every value in a JSON document with its path; a plain list is one value.
pub(super) fn flattened(value: &Value) -> Vec<(String, String)> {
    let mut out = Vec::new();
    flatten("", value, &mut out);
    out
}

fn flatten(path: &str, value: &Value, out: &mut Vec<(String, String)>) {
    let below = |key: &str| match path {
        "" => key.to_owned(),
        path => format!("{path}.{key}"),
    };
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| flatten(&below(key), value, out)),
        Value::Array(list) if list.iter().any(|v| v.is_object() || v.is_array()) => {
            for (i, value) in list.iter().enumerate() {
                flatten(&below(&i.to_string()), value, out);
            }
        }
        Value::Array(list) => {
            let items: Vec<String> = list.iter().map(plain).collect();
            out.push((path.to_owned(), items.join(" ")));
        }
        Value::Null if path.is_empty() => {}
        value => out.push((path.to_owned(), plain(value))),
    }
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => MISSING.to_owned(),
        other => other.to_string(),
    }
}
