//! Free runs of conventional PINNs, each trained for its own T, beside the free run of a chained
//! net: a column for each PINN, a row for each state.

use crate::data::Run;
use crate::error::ReportError;
use crate::picture::Picture;
use crate::prediction::{marks, points};
use crate::trials::Trials;
use pinc_chart::{
    Axis, BLACK, Figure, GREY, Key, Kind, Look, Panel, Shape, Style, extent, state_color,
    state_mark,
};
use pinc_config::CaseSpec;
use pinc_record::PredictionTable;

const TRUTH: Style = Style { color: BLACK, opacity: 0.9, shape: Shape::Line(4.2) };
const PINN: Style = Style { color: GREY, opacity: 1.0, shape: Shape::Dashes(2.0) };

/// A case of the sweep with its free run.
struct Trace {
    name: String,
    /// T, if it is a net of one scenario.
    pinn: Option<f64>,
    table: PredictionTable,
}

/// The free runs; `None` if the sweep has no conventional PINNs, or has kept no traces.
pub(super) fn picture(run: &Run, trials: &Trials) -> Result<Option<Picture>, ReportError> {
    let traces = traces(run, trials)?;
    let (pinns, nets): (Vec<&Trace>, Vec<&Trace>) = traces.iter().partition(|t| t.pinn.is_some());
    let (Some(first), Some(net)) = (pinns.first(), nets.first()) else { return Ok(None) };
    let states = first.table.states.clone();
    let mut panels = Vec::new();
    for (row, state) in states.iter().enumerate() {
        for (column, pinn) in pinns.iter().enumerate() {
            let label = run.axis_label(&[state]);
            let mut panel = panel(row, state, pinn, net, &label);
            panel.y.silent = column > 0;
            panel.title = if row == 0 { pinn.name.clone() } else { String::new() };
            panels.push(panel);
        }
    }
    let end = extent(first.table.rows.iter().map(|row| row.t)).1;
    let axis = Axis::ranged("t (s)", Kind::Linear, (0.0, end));
    let columns = vec![1.0; pinns.len()];
    let mut figure = Figure::grid("Free runs of PINNs and of a chained net", axis, columns, panels);
    figure.keys = keys(&states, net);
    let caption = format!(
        "Each PINN, trained for its own T (vertical line) and one scenario, beyond its T too; in \
         every column the same {}, chained, with a dot at the end of each step. The truth lies \
         beneath. A PINN that leaves the range of the truth is cut off. From the trials' \
         prediction.csv.",
        net.name
    );
    Ok(Some(Picture::new("free-runs", "Long-range simulation", figure, caption)))
}

fn panel(row: usize, state: &str, pinn: &Trace, net: &Trace, label: &str) -> Panel {
    let curve = |table: &PredictionTable| points(table, |at| at.state[row]);
    let truth = points(&net.table, |at| at.truth[row]);
    let (low, high) = extent(truth.iter().map(|p| p.1));
    let room = 0.2 * (high - low).max(1e-6);
    let axis = Axis::ranged(label, Kind::Linear, (low - room, high + room));
    let mut panel = Panel::new("", axis, 170.0);
    panel.add(&format!("{state}_truth"), truth, TRUTH);
    let color = state_color(row);
    let line = Style::new(color, Shape::Line(1.8));
    panel.add(&format!("{state}, {}", net.name), curve(&net.table), line);
    panel.add("", marks(&net.table, row), Style::new(color, state_mark(row)));
    panel.add(&format!("{state}, {}", pinn.name), curve(&pinn.table), PINN);
    panel.uprights.extend(pinn.pinn);
    panel.note = Some("This trial has no numbers.".to_owned());
    panel
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
    let cases = run.experiment.sweep.iter().flat_map(|sweep| &sweep.cases);
    let mut traces = Vec::new();
    for CaseSpec { name, set } in cases {
        let Some(table) = trials.free_run(name)? else { continue };
        let sample_time_s = set.get("model.horizon_s").and_then(|value| value.as_float());
        let is_pinn = set.contains_key("model.time_only");
        let pinn = sample_time_s.or_else(|| run.experiment.sample_time_s()).filter(|_| is_pinn);
        traces.push(Trace { name: name.clone(), pinn, table });
    }
    Ok(traces)
}
