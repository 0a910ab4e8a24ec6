//! Free runs of conventional PINNs, each trained for its own T, beside that of a net that is chained:
//! a column for each PINN, a row for each state.

use super::super::ReportError;
use super::super::data::Run;
use super::super::picture::Picture;
use super::super::table::Table;
use super::super::variables::states_of_prediction;
use super::trials::Trials;
use pinc_chart::{
    Axis, BLACK, Figure, GREY, Key, Kind, Look, Panel, Shape, Style, extent, state_color,
    state_mark,
};

const TRUTH: Style = Style { color: BLACK, opacity: 0.9, shape: Shape::Line(4.2) };
const PINN: Style = Style { color: GREY, opacity: 1.0, shape: Shape::Dashes(2.0) };

/// A case of the sweep with its free run.
struct Trace {
    name: String,
    /// T, if it is a net of one scenario.
    pinn: Option<f64>,
    table: Table,
}

/// The free runs; `None` if the sweep has no conventional PINNs, or has kept no traces.
pub(super) fn picture(run: &Run, trials: &Trials) -> Result<Option<Picture>, ReportError> {
    let traces = traces(run, trials)?;
    let (pinns, nets): (Vec<&Trace>, Vec<&Trace>) = traces.iter().partition(|t| t.pinn.is_some());
    let (Some(first), Some(net)) = (pinns.first(), nets.first()) else { return Ok(None) };
    let states = states_of_prediction(&first.table);
    let mut panels = Vec::new();
    for (row, state) in states.iter().enumerate() {
        for (column, pinn) in pinns.iter().enumerate() {
            let label = run.axis_label(std::slice::from_ref(state));
            let mut panel = panel(row, state, pinn, net, &label)?;
            panel.y.silent = column > 0;
            panel.title = if row == 0 { pinn.name.clone() } else { String::new() };
            panels.push(panel);
        }
    }
    let end = extent(first.table.numbers("t")?.into_iter()).1;
    let axis = Axis::ranged("t (s)", Kind::Linear, (0.0, end));
    let columns = vec![1.0; pinns.len()];
    let mut figure = Figure::grid("Free runs of PINNs and of a chained net", axis, columns, panels);
    figure.keys = keys(&states, net);
    Ok(Some(Picture {
        stem: "free-runs".to_owned(),
        title: "Long-range simulation".to_owned(),
        figure,
        caption: format!(
            "Each PINN, trained for its own T (vertical line) and one scenario, beyond its T too; in every \
             column the same {}, chained, with a dot at the end of each step. The truth lies beneath. A \
             PINN that leaves the range of the truth is cut off. From the trials' prediction.csv.",
            net.name
        ),
    }))
}

fn panel(
    row: usize,
    state: &str,
    pinn: &Trace,
    net: &Trace,
    label: &str,
) -> Result<Panel, ReportError> {
    let points = |table: &Table, column: &str| {
        Ok::<_, ReportError>(table.points("t", column)?.unwrap_or_default())
    };
    let name = format!("{state}_truth");
    let truth = points(&net.table, &name)?;
    let (low, high) = extent(truth.iter().map(|p| p.1));
    let room = 0.2 * (high - low).max(1e-6);
    let axis = Axis::ranged(label, Kind::Linear, (low - room, high + room));
    let mut panel = Panel::new("", axis, 170.0);
    panel.add(&name, truth, TRUTH);
    let color = state_color(row);
    let curve = points(&net.table, state)?;
    let marks = net.table.numbers("mark")?;
    let marked = curve.iter().zip(marks).filter(|(_, mark)| *mark > 0.5);
    let marked = marked.map(|(point, _)| *point).collect();
    panel.add(&format!("{state}, {}", net.name), curve, Style::new(color, Shape::Line(1.8)));
    panel.add("", marked, Style::new(color, state_mark(row)));
    panel.add(&format!("{state}, {}", pinn.name), points(&pinn.table, state)?, PINN);
    panel.uprights.extend(pinn.pinn);
    panel.note = Some("This trial has no numbers.".to_owned());
    Ok(panel)
}

fn keys(states: &[String], net: &Trace) -> Vec<Key> {
    let key = |label: String, style| Key { label, look: Look::Curve(style) };
    let of_state = |(i, state): (usize, &String)| {
        key(format!("{state}, {}", net.name), Style::new(state_color(i), Shape::Line(1.8)))
    };
    let mut keys: Vec<Key> = states.iter().enumerate().map(of_state).collect();
    keys.push(key("PINN".to_owned(), PINN));
    keys.push(key("truth".to_owned(), TRUTH));
    keys
}

/// The cases whose first finished trial has a free run.
fn traces(run: &Run, trials: &Trials) -> Result<Vec<Trace>, ReportError> {
    let cases = run.setting(&["sweep", "cases"]).and_then(toml::Value::as_array);
    let mut traces = Vec::new();
    for case in cases.into_iter().flatten() {
        let Some(name) = case.get("name").and_then(toml::Value::as_str) else { continue };
        let Some(table) = trials.free_run(name)? else { continue };
        let value = |key: &str| case.get("set")?.get(key);
        let horizon = value("model.sample_time_s").and_then(toml::Value::as_float);
        let pinn = value("model.time_only").and(horizon.or_else(|| run.step_s()));
        traces.push(Trace { name: name.to_owned(), pinn, table });
    }
    Ok(traces)
}
