//! The tables of numbers.

use crate::data::Run;
use crate::identification;
use pinc_chart::text::{self, MISSING};
use pinc_config::{ModelKind, TimeUnit};
use pinc_record::{
    ControlMetrics, DomainErrorMetrics, Metrics, PredictionMetrics, Provenance, TrainingMetrics,
    ValidationMetrics, ViolationMetrics, WallTimes,
};
use serde_json::Value;

/// A table of the report: its title, the heads of its columns, its rows.
#[derive(Clone, Debug)]
pub(crate) struct NumberTable {
    pub(crate) title: String,
    pub(crate) heads: Vec<String>,
    pub(crate) rows: Vec<Vec<String>>,
}

/// What `metrics.json` says of training, validation, free run and closed loops.
pub(crate) fn number_tables(run: &Run) -> Vec<NumberTable> {
    let mut tables = Vec::new();
    tables.extend(run.identification.iter().flat_map(identification::number_tables));
    let Some(metrics) = &run.metrics else { return tables };
    tables.extend(metrics.training.as_ref().map(training));
    tables.extend(metrics.validation.as_ref().map(validation));
    let domain = metrics.validation.as_ref().and_then(|of| of.domain_error.as_ref());
    tables.extend(domain.map(|of| over_the_domain(of, metrics)));
    tables.extend(metrics.prediction.as_ref().map(prediction));
    tables.extend(control(run, &metrics.control));
    tables
}

/// A table of names and values.
fn plain<const N: usize>(title: &str, rows: [(&str, String); N]) -> NumberTable {
    let rows = rows.map(|(label, value)| vec![label.to_owned(), value]);
    NumberTable { title: title.to_owned(), heads: Vec::new(), rows: rows.to_vec() }
}

fn training(of: &TrainingMetrics) -> NumberTable {
    plain(
        "Training",
        [
            ("Wall time", text::duration(of.wall_s)),
            ("Optimizer alone", text::duration(of.optimizer_s)),
            ("Iterations", of.iterations.to_string()),
            ("Loss evaluations", of.loss_evaluations.to_string()),
            ("Stopped because", of.stop_reason.clone()),
        ],
    )
}

fn validation(of: &ValidationMetrics) -> NumberTable {
    let shown = |value| text::significant(value, 3);
    plain(
        "Validation",
        [
            ("MSE at the steps t = kT, physical units", shown(of.mse_gen)),
            ("MSE of all rows, normalized", shown(of.mse_all_normalized)),
            ("MSE of one step, from random states in validation.domain", shown(of.one_step_mse)),
        ],
    )
}

fn over_the_domain(of: &DomainErrorMetrics, metrics: &Metrics) -> NumberTable {
    let shown = |value| text::significant(value, 2);
    let state = &of.max_of;
    let became =
        format!("{} instead of {}", text::number(of.predicted, 4), text::number(of.truth, 4));
    plain(
        "Error of one step over [domain], in widths of the states' ranges",
        [
            ("Root mean square", shown(of.rms)),
            ("99th percentile of the points", shown(of.p99)),
            ("Largest", shown(of.max)),
            ("Where", of.max_at.named(&metrics.states, &metrics.inputs)),
            ("What is predicted there", format!("{state} = {became}")),
            ("RK4 with 1 substep, root mean square", shown(of.rk4.one)),
            ("RK4 with 2 substeps", shown(of.rk4.two)),
            ("RK4 with 4 substeps", shown(of.rk4.four)),
        ],
    )
}

fn prediction(of: &PredictionMetrics) -> NumberTable {
    let shown = |value| text::significant(value, 3);
    plain(
        "Free run",
        [
            ("MSE at the steps t = kT, physical units", shown(of.mse_marks)),
            ("MSE of all rows, physical units", shown(of.mse_all)),
        ],
    )
}

fn control(run: &Run, models: &[ControlMetrics]) -> Option<NumberTable> {
    if models.is_empty() {
        return None;
    }
    let mut heads = vec![String::new()];
    heads.extend(models.iter().map(|of| run.model_name(Some(of.model)).to_owned()));
    let with = |model| models.iter().find(|of| of.model == model);
    let both = with(ModelKind::Pinc).zip(with(ModelKind::RK4));
    if both.is_some() {
        heads.push(format!("{} against RK4", run.model_name(Some(ModelKind::Pinc))));
    }
    let row = |(label, quantity): &(&str, Quantity)| {
        let mut cells = vec![(*label).to_owned()];
        cells.extend(models.iter().map(|of| quantity.show(run, of)));
        cells.extend(both.map(|(pinc, rk4)| quantity.compare(pinc, rk4)));
        cells
    };
    let rows = CONTROL.iter().map(row).collect();
    Some(NumberTable { title: "Closed loop".to_owned(), heads, rows })
}

/// A quantity of a closed loop, and how it is written.
#[derive(Clone, Copy)]
enum Quantity {
    /// A number to so many digits.
    Number(fn(&ControlMetrics) -> f64, usize),
    /// A number to so many digits, where a quotient of two models says something.
    Compared(fn(&ControlMetrics) -> f64, usize),
    /// A duration in s.
    Time(fn(&ControlMetrics) -> f64),
    /// Text.
    Text(fn(&ControlMetrics) -> String),
    /// Text that depends on the config.
    OfRun(fn(&Run, &ControlMetrics) -> String),
}

const CONTROL: [(&str, Quantity); 15] = [
    ("RMSE at the steps", Quantity::Compared(|of| of.rmse, 5)),
    ("IAE at the steps, mean over outputs", Quantity::Compared(|of| of.iae, 6)),
    ("RMSE, dense trace", Quantity::Compared(|of| of.rmse_dense, 5)),
    ("IAE, dense trace, sum over outputs", Quantity::Compared(|of| of.iae_dense_sum, 6)),
    ("Controller, whole run: mean ± sd", Quantity::Text(|of| repeated(&of.wall_s))),
    ("Controller, whole run: median", Quantity::Time(|of| of.wall_s.median)),
    ("Controller, one step: median", Quantity::Time(|of| 1e-6 * of.step_us.p50)),
    ("Controller, one step: 99th percentile", Quantity::Time(|of| 1e-6 * of.step_us.p99)),
    ("Controller, one step: longest", Quantity::Time(|of| 1e-6 * of.step_us.max)),
    ("SQP iterations per step", Quantity::Number(|of| of.sqp_iterations_mean, 3)),
    ("Largest KKT residual", Quantity::Number(|of| of.kkt_max, 2)),
    ("Bounds broken, each at its worst", Quantity::OfRun(broken_bounds)),
    ("Steps by status", Quantity::Text(statuses)),
    ("Settled after, per reference", Quantity::OfRun(settled)),
    ("Offset at the end, per reference", Quantity::Text(offsets)),
];

impl Quantity {
    fn show(self, run: &Run, of: &ControlMetrics) -> String {
        match self {
            Self::Number(value, digits) | Self::Compared(value, digits) => {
                text::significant(value(of), digits)
            }
            Self::Time(seconds) => text::duration(seconds(of)),
            Self::Text(text) => text(of),
            Self::OfRun(text) => text(run, of),
        }
    }

    /// A relative difference, or a quotient of times.
    fn compare(self, pinc: &ControlMetrics, rk4: &ControlMetrics) -> String {
        match self {
            Self::Compared(value, _) => comparison(value(pinc), value(rk4)),
            Self::Time(seconds) if seconds(rk4) > 0.0 => {
                format!("× {}", text::number(seconds(pinc) / seconds(rk4), 3))
            }
            _ => String::new(),
        }
    }
}

/// What closed loops are like, a row for each quantity: the first loop's numbers, and those of the
/// others with what they differ by.
pub(crate) fn loops_side_by_side(loops: &[(&Run, &ControlMetrics)]) -> Vec<Vec<String>> {
    let row = |(label, quantity): &(&str, Quantity)| {
        let cell = |(i, (run, of)): (usize, &(&Run, &ControlMetrics))| {
            let difference = if i == 0 { String::new() } else { quantity.compare(of, loops[0].1) };
            let shown = quantity.show(run, of);
            if difference.is_empty() { shown } else { format!("{shown} ({difference})") }
        };
        let cells = loops.iter().enumerate().map(cell);
        std::iter::once((*label).to_owned()).chain(cells).collect()
    };
    CONTROL.iter().map(row).collect()
}

/// " (0.02 % higher)", or a quotient of numbers that differ by more than half; nothing if one of
/// them is none.
pub(crate) fn changed(value: f64, against: f64) -> String {
    let ratio = value / against;
    match ratio {
        ratio if !ratio.is_finite() || ratio <= 0.0 => String::new(),
        ratio if (0.5..=2.0).contains(&ratio) => format!(" ({})", comparison(value, against)),
        ratio => format!(" (× {})", text::number(ratio, 3)),
    }
}

/// "0.02 % higher".
pub(crate) fn comparison(value: f64, against: f64) -> String {
    let percent = 100.0 * (value / against - 1.0);
    let size = format!("{} %", text::significant(percent.abs(), 2));
    match percent {
        p if p > 0.0 => format!("{size} higher"),
        p if p < 0.0 => format!("{size} lower"),
        _ => "the same".to_owned(),
    }
}

fn repeated(wall: &WallTimes) -> String {
    let WallTimes { mean, sd, runs, .. } = wall;
    format!("{} ± {} ({runs} runs)", text::duration(*mean), text::duration(*sd))
}

fn statuses(of: &ControlMetrics) -> String {
    let each = of.status.iter().map(|(status, n)| format!("{status} {n}"));
    each.collect::<Vec<_>>().join(", ")
}

/// The bounds that were broken, by name, amount, unit and time.
fn broken_bounds(run: &Run, of: &ControlMetrics) -> String {
    let shown = |violation: &ViolationMetrics| {
        let softness = if violation.hard { "" } else { ", a soft bound" };
        let shown = violation.shown(run.experiment.time_unit);
        format!("{}: {shown}{softness}", violation.of)
    };
    match &of.violations[..] {
        // Runs of other versions have the number alone.
        [] if of.max_violation > 0.0 => text::significant(of.max_violation, 2),
        [] => "none".to_owned(),
        all => all.iter().map(shown).collect::<Vec<_>>().join("; "),
    }
}

fn settled(run: &Run, of: &ControlMetrics) -> String {
    let shown = |seconds| match run.experiment.time_unit {
        None => text::duration(seconds),
        unit => TimeUnit::shown(seconds, unit),
    };
    let time = |time: &Option<f64>| time.map_or_else(|| "not".to_owned(), shown);
    of.references.settle_s.iter().map(time).collect::<Vec<_>>().join(", ")
}

fn offsets(of: &ControlMetrics) -> String {
    let offset = |offset: &Option<f64>| {
        let undefined = || "undefined (segment too short)".to_owned();
        offset.map_or_else(undefined, |offset| text::significant(offset, 2))
    };
    let each = of.references.offset.iter().map(|(name, offsets)| {
        let offsets: Vec<String> = offsets.iter().map(offset).collect();
        format!("{name}: {}", offsets.join(", "))
    });
    each.collect::<Vec<_>>().join("; ")
}

/// Every value of a provenance with its name, as `provenance.json` has them; a list of texts is one
/// value.
pub(crate) fn flattened(provenance: &Provenance) -> Vec<(String, String)> {
    let value = serde_json::to_value(provenance).expect("a provenance is plain data");
    let mut out = Vec::new();
    flatten("", &value, &mut out);
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
            let items: Vec<String> = list.iter().map(shown).collect();
            out.push((path.to_owned(), items.join(" ")));
        }
        value => out.push((path.to_owned(), shown(value))),
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => MISSING.to_owned(),
        other => other.to_string(),
    }
}
