//! The free run of the net against the truth.

use super::ReportError;
use super::data::Run;
use super::picture::Picture;
use super::table::Table;
use super::variables::{Variables, states_of_prediction};
use pinc_chart::text;
use pinc_chart::{
    Axis, BLACK, Event, Figure, Kind, Look, Panel, Point, Shape, Style, extent, held_until_next,
    input_color, present, state_color, state_mark,
};

/// The free run, if there is one.
pub(super) fn picture(run: &Run, variables: &Variables) -> Result<Option<Picture>, ReportError> {
    let Some(table) = run.prediction.as_ref().filter(|table| table.len() > 0) else {
        return Ok(None);
    };
    let states = states_of_prediction(table);
    let taken = |h: &String| states.contains(h) || ["t", "mark", "scenario"].contains(&h.as_str());
    let inputs = table.headers().iter().filter(|h| !taken(h) && !h.ends_with("_truth"));
    let inputs: Vec<String> = inputs.cloned().collect();
    let marks = match table.has("mark") {
        true => table.numbers("mark")?,
        false => vec![0.0; table.len()],
    };
    let mut panels = Vec::new();
    for (title, group) in variables.panels_of(&states) {
        panels.push(state_panel(run, table, variables, &title, &group, &marks)?);
    }
    panels.push(input_panel(run, table, &inputs)?);
    panels.push(error_panel(run, table, variables, &states)?);
    let t = extent(table.numbers("t")?.into_iter());
    let axis = Axis::ranged("t (s)", Kind::Linear, t);
    let mut figure = Figure::stack("Free run of the net against the truth", axis, panels);
    figure.events = horizon(run, t);
    Ok(Some(Picture {
        stem: "prediction".to_owned(),
        title: "Free-run prediction".to_owned(),
        caption: caption(table, &states)?,
        figure,
    }))
}

fn state_panel(
    run: &Run,
    table: &Table,
    variables: &Variables,
    title: &str,
    states: &[String],
    marks: &[f64],
) -> Result<Panel, ReportError> {
    let height = if states.len() == variables.states.len() { 280.0 } else { 200.0 };
    let mut panel = Panel::new(title, Axis::new(&run.axis_label(states), Kind::Linear), height);
    for state in states {
        let name = format!("{state}_truth");
        let truth = table.points("t", &name)?;
        let style = Style::new(BLACK, Shape::Line(4.6)).faint(0.9);
        panel.add(&name, truth.unwrap_or_default(), style);
    }
    for state in states {
        let color = state_color(variables.index_of(state));
        let curve = table.points("t", state)?.unwrap_or_default();
        let marked = curve.iter().zip(marks).filter(|(_, m)| **m > 0.5);
        let marked: Vec<Point> = marked.map(|(p, _)| *p).collect();
        panel.tag(state, &curve, color);
        panel.add_named(state, curve, Style::new(color, Shape::Line(2.2)));
        panel.add("", marked, Style::new(color, state_mark(variables.index_of(state))));
    }
    panel.key("truth", Look::Curve(Style::new(BLACK, Shape::Line(4.6)).faint(0.9)));
    if marks.iter().any(|m| *m > 0.5) {
        panel.key("end of a step, t = kT", Look::Curve(Style::new(BLACK, Shape::Dots(3.4))));
    }
    Ok(panel)
}

fn input_panel(run: &Run, table: &Table, inputs: &[String]) -> Result<Panel, ReportError> {
    let label = run.axis_label(inputs);
    let mut panel = Panel::new("Inputs", Axis::new(&label, Kind::Linear), 120.0);
    for (i, input) in inputs.iter().enumerate() {
        let points = table.points("t", input)?.unwrap_or_default();
        let style = Style::new(input_color(i), Shape::Line(1.8));
        panel.add_named(input, held_until_next(&points), style);
    }
    Ok(panel)
}

fn error_panel(
    run: &Run,
    table: &Table,
    variables: &Variables,
    states: &[String],
) -> Result<Panel, ReportError> {
    let label = run.label_in_unit_of("|prediction − truth|", states);
    let mut panel = Panel::new("Absolute error", Axis::new(&label, Kind::Log), 170.0);
    for state in states {
        let color = state_color(variables.index_of(state));
        panel.add_named(state, errors(table, state)?, Style::new(color, Shape::Line(1.5)));
    }
    Ok(panel)
}

fn errors(table: &Table, state: &str) -> Result<Vec<Point>, ReportError> {
    let curve = table.points("t", state)?.unwrap_or_default();
    let truth = table.numbers(&format!("{state}_truth"))?;
    let pairs = curve.into_iter().zip(truth);
    Ok(pairs.map(|((t, y), truth)| (t, (y - truth).abs())).collect())
}

/// Where the controller's prediction ends, N2 steps ahead.
fn horizon(run: &Run, t: (f64, f64)) -> Vec<Event> {
    let steps = run.number(&["control", "n2"]);
    let end = steps.zip(run.step_s()).map(|(n, step)| t.0 + n * step);
    let event = end.filter(|end| *end < t.1).map(|end| {
        let label = "horizon of the controller, N₂T".to_owned();
        Event::minor(end, label)
    });
    event.into_iter().collect()
}

fn caption(table: &Table, states: &[String]) -> Result<String, ReportError> {
    let mut worst = Vec::new();
    for state in states {
        let errors = present(errors(table, state)?);
        if !errors.is_empty() {
            let largest = extent(errors.iter().map(|p| p.1)).1;
            worst.push(format!("{} in {state}", text::number(largest, 2)));
        }
    }
    let mut caption = "The net predicts from the first state alone: each step of length T starts from \
                       the end of the step before (dots), and the curve between two dots is the net \
                       asked at inner times. The truth, an accurate integration, lies beneath in black."
        .to_owned();
    if !worst.is_empty() {
        caption += &format!(" The largest error is {}.", text::listed(&worst));
    }
    Ok(format!("{caption} From {}.", table.file_name()))
}
