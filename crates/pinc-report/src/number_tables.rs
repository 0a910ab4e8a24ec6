//! The tables of numbers.

use crate::data::Run;
use crate::identification;
use pinc_chart::text::{self, MISSING};
use pinc_config::{ModelKind, TimeUnit};
use pinc_record::metric::{self, Better, Metric, Value};
use pinc_record::{ControlMetrics, Metrics, Provenance, ViolationMetrics, WallTimes};
use serde_json::Value as Json;

/// A table of the report: its title, the heads of its columns, its rows.
#[derive(Clone, Debug)]
pub(crate) struct NumberTable {
    pub(crate) title: String,
    pub(crate) heads: Vec<String>,
    pub(crate) rows: Vec<Vec<String>>,
}

impl NumberTable {
    pub(crate) fn new<H: Into<String>>(
        title: impl Into<String>,
        heads: impl IntoIterator<Item = H>,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        let heads = heads.into_iter().map(Into::into).collect();
        Self { title: title.into(), heads, rows: rows.into_iter().collect() }
    }

    /// The same; `None` without rows.
    pub(crate) fn of_any<H: Into<String>>(
        title: impl Into<String>,
        heads: impl IntoIterator<Item = H>,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Option<Self> {
        Some(Self::new(title, heads, rows)).filter(|table| !table.rows.is_empty())
    }
}

/// What `metrics.json` says of training, validation, free run and closed loops.
pub(crate) fn number_tables(run: &Run) -> Vec<NumberTable> {
    let mut tables = Vec::new();
    tables.extend(run.identification.iter().flat_map(identification::number_tables));
    let Some(metrics) = &run.metrics else { return tables };
    tables.extend(of_stage(metrics, "Training", metric::TRAINING));
    tables.extend(of_stage(metrics, "Validation", metric::VALIDATION));
    tables.extend(over_the_domain(metrics));
    tables.extend(of_stage(metrics, "Free run", metric::FREE_RUN));
    tables.extend(control(run, &metrics.control));
    tables
}

/// The few numbers of most weight: how well each closed loop tracked, whether it kept its bounds, and
/// what a step took. `None` without a loop.
pub(crate) fn key_numbers(run: &Run) -> Option<NumberTable> {
    let loops = &run.metrics.as_ref()?.control;
    let metrics = [
        (&metric::IAE_DENSE_SUM, "IAE"),
        (&metric::MAX_VIOLATION, "worst violation of a bound"),
        (&metric::STEP_TIME, "time of a step, median"),
    ];
    // The unit of the metric, with a short name.
    let named = |(metric, name): (&Metric, _)| run.label_of(metric).replace(metric.title, name);
    let heads = ["model".to_owned()].into_iter().chain(metrics.map(named));
    let heads = heads.chain(["failed steps".to_owned()]);
    let row = |of: &ControlMetrics| {
        let name = [run.model_name(Some(of.model)).to_owned()].into_iter();
        let values = metrics.iter().map(|(metric, _)| shown(metric, metric.of_loop(of)));
        let failed = format!("{} of {}", text::count(of.failed_steps()), text::count(of.steps()));
        name.chain(values).chain([failed]).collect()
    };
    NumberTable::of_any("Closed loop", heads, loops.iter().map(row))
}

/// The metrics of a stage of the net; `None` if the run did not get so far.
fn of_stage(metrics: &Metrics, title: &str, stage: &'static [Metric]) -> Option<NumberTable> {
    let row = |metric: &&Metric| {
        let name = metric.row.unwrap_or(metric.title).to_owned();
        let value = match metric.value(metrics, None)? {
            Value::Number(value) => shown(metric, value),
            Value::Name(name) => name,
        };
        Some(vec![name, value])
    };
    NumberTable::of_any(title, [""; 0], Metric::rows(stage).iter().filter_map(row))
}

/// The number of a metric, as reports write it.
pub(crate) fn shown(metric: &Metric, value: f64) -> String {
    match (metric.unit.seconds(), metric.digits) {
        (Some(second), _) => text::duration(second * value),
        (None, 0) => value.to_string(),
        (None, digits) => text::significant(value, digits),
    }
}

fn over_the_domain(metrics: &Metrics) -> Option<NumberTable> {
    let of = metrics.validation.as_ref()?.domain_error.as_ref()?;
    let title = "Error of one step over [domain], in widths of the states' ranges";
    let mut table = of_stage(metrics, title, metric::DOMAIN)?;
    let shown = |value| text::significant(value, 2);
    let state = &of.max_of;
    let became =
        format!("{} instead of {}", text::number(of.predicted, 4), text::number(of.truth, 4));
    let mut rest = vec![
        ("Where", of.max_at.named(&metrics.states, &metrics.inputs)),
        ("What is predicted there", format!("{state} = {became}")),
    ];
    let rk4 = [
        ("RK4 with 1 substep, root mean square", shown(of.rk4.one)),
        ("RK4 with 2 substeps", shown(of.rk4.two)),
        ("RK4 with 4 substeps", shown(of.rk4.four)),
    ];
    rest.extend(rk4.into_iter().filter(|_| of.rk4.are_known()));
    table.rows.extend(rest.into_iter().map(|(label, value)| vec![label.to_owned(), value]));
    Some(table)
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
    let row = |row: LoopRow| {
        let mut cells = vec![row.name().to_owned()];
        cells.extend(models.iter().map(|of| row.show(run, of)));
        cells.extend(both.map(|(pinc, rk4)| row.compare(pinc, rk4)));
        cells
    };
    Some(NumberTable::new("Closed loop", heads, LoopRow::all().map(row)))
}

/// A row of the tables of closed loops.
#[derive(Clone, Copy)]
enum LoopRow {
    /// A metric.
    Of(&'static Metric),
    /// Text that may depend on the config, with its name.
    Text(&'static str, fn(&Run, &ControlMetrics) -> String),
}

/// What is said of a closed loop beside its metrics.
const TEXTS: [LoopRow; 4] = [
    LoopRow::Text("Bounds broken, each at its worst", broken_bounds),
    LoopRow::Text("Steps by status", |_, of| statuses(of)),
    LoopRow::Text("Settled after, per reference", settled),
    LoopRow::Text("Offset at the end, per reference", |_, of| offsets(of)),
];

impl LoopRow {
    /// All rows; the mean of the controller's time is above its median.
    fn all() -> impl Iterator<Item = Self> {
        let mean = Self::Text("Controller, whole run: mean ± sd", |_, of| repeated(&of.wall_s));
        let rows = Metric::rows(metric::LOOP).into_iter().flat_map(move |metric| {
            let above = (*metric == metric::WALL).then_some(mean);
            above.into_iter().chain([Self::Of(metric)])
        });
        rows.chain(TEXTS)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Of(metric) => metric.row.unwrap_or(metric.title),
            Self::Text(name, _) => name,
        }
    }

    fn show(self, run: &Run, of: &ControlMetrics) -> String {
        match self {
            Self::Of(metric) => shown(metric, metric.of_loop(of)),
            Self::Text(_, text) => text(run, of),
        }
    }

    /// A relative difference, or a quotient of times; nothing if no direction is better.
    fn compare(self, of: &ControlMetrics, against: &ControlMetrics) -> String {
        let Self::Of(metric) = self else { return String::new() };
        let (value, against) = (metric.of_loop(of), metric.of_loop(against));
        match (metric.better, metric.unit.seconds()) {
            (Better::Neither, _) => String::new(),
            (Better::Lower, None) => comparison(value, against),
            (Better::Lower, Some(_)) if against > 0.0 => {
                format!("× {}", text::number(value / against, 3))
            }
            (Better::Lower, Some(_)) => String::new(),
        }
    }
}

/// Closed loops in numbers, a row for each quantity: the first loop's numbers, and the other loops'
/// with their differences.
pub(crate) fn loops_side_by_side(loops: &[(&Run, &ControlMetrics)]) -> Vec<Vec<String>> {
    let row = |row: LoopRow| {
        let cell = |(i, (run, of)): (usize, &(&Run, &ControlMetrics))| {
            let difference = if i == 0 { String::new() } else { row.compare(of, loops[0].1) };
            let shown = row.show(run, of);
            if difference.is_empty() { shown } else { format!("{shown} ({difference})") }
        };
        let cells = loops.iter().enumerate().map(cell);
        std::iter::once(row.name().to_owned()).chain(cells).collect()
    };
    LoopRow::all().map(row).collect()
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
    or_dash(of.references.settle_s.iter().map(time).collect::<Vec<_>>().join(", "))
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
    or_dash(each.collect::<Vec<_>>().join("; "))
}

/// What is said of a loop without references.
fn or_dash(text: String) -> String {
    if text.is_empty() { "-".to_owned() } else { text }
}

/// Every value of a provenance with its name, as `provenance.json` has them; a list of texts is one
/// value.
pub(crate) fn flattened(provenance: &Provenance) -> Vec<(String, String)> {
    let value = serde_json::to_value(provenance).expect("a provenance is plain data");
    let mut out = Vec::new();
    flatten("", &value, &mut out);
    out
}

fn flatten(path: &str, value: &Json, out: &mut Vec<(String, String)>) {
    let below = |key: &str| match path {
        "" => key.to_owned(),
        path => format!("{path}.{key}"),
    };
    match value {
        Json::Object(map) => map.iter().for_each(|(key, value)| flatten(&below(key), value, out)),
        Json::Array(list) if list.iter().any(|v| v.is_object() || v.is_array()) => {
            for (i, value) in list.iter().enumerate() {
                flatten(&below(&i.to_string()), value, out);
            }
        }
        Json::Array(list) => {
            let items: Vec<String> = list.iter().map(plain).collect();
            out.push((path.to_owned(), items.join(" ")));
        }
        value => out.push((path.to_owned(), plain(value))),
    }
}

fn plain(value: &Json) -> String {
    match value {
        Json::String(text) => text.clone(),
        Json::Null => MISSING.to_owned(),
        other => other.to_string(),
    }
}
