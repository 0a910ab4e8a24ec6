//! The free run of the net against the truth.

use crate::data::Run;
use crate::picture::Picture;
use crate::variables::{Variables, by_axis};
use pinc_chart::{
    Axis, BLACK, Event, Figure, Kind, Look, Panel, Point, Shape, Style, extent, held_until_next,
    input_color, present, state_color, state_mark, text,
};
use pinc_ode::Variable;
use pinc_record::{PredictionRow, PredictionTable, file};

/// The free run, if there is one.
pub(crate) fn picture(run: &Run, variables: &Variables) -> Option<Picture> {
    let table = run.prediction.as_ref().filter(|table| !table.rows.is_empty())?;
    let mut panels = Vec::new();
    let range = |name: &str| state_range(table, name);
    let states = variables.panels_of(&table.states).into_iter();
    for (title, group) in states.flat_map(|(title, names)| by_axis(run, title, names, &range)) {
        panels.push(state_panel(run, table, &title, &group));
    }
    let range = |name: &str| extent(input(table, name).1.into_iter().map(|point| point.1));
    for (title, group) in by_axis(run, "Inputs".to_owned(), table.inputs.clone(), &range) {
        panels.push(input_panel(run, table, &title, &group));
    }
    panels.push(error_panel(run, variables, table));
    let t = extent(table.rows.iter().map(|row| row.t));
    let axis = run.time_axis(t);
    let mut figure = Figure::stack("Free run of the net against the truth", axis, panels);
    figure.events = horizon(run, t);
    Some(Picture::new("prediction", "Free-run prediction", figure, caption(table)))
}

/// The points of what `value` finds in a row.
pub(crate) fn points(table: &PredictionTable, value: impl Fn(&PredictionRow) -> f64) -> Vec<Point> {
    table.rows.iter().map(|row| (row.t, value(row))).collect()
}

/// The points of a state at the ends of steps.
pub(crate) fn marks(table: &PredictionTable, place: usize) -> Vec<Point> {
    let rows = table.rows.iter().filter(|row| row.mark);
    rows.map(|row| (row.t, row.state[place])).collect()
}

fn state_panel(run: &Run, table: &PredictionTable, title: &str, states: &[String]) -> Panel {
    let height = if states.len() == table.states.len() { 280.0 } else { 200.0 };
    let mut panel = run.panel(title, states, height);
    let places = || states.iter().filter_map(|name| Some((name, table.index_of(name)?)));
    for (name, place) in places() {
        let style = Style::new(BLACK, Shape::Line(4.6)).faint(0.9);
        panel.add(&format!("{name}_truth"), points(table, |row| row.truth[place]), style);
    }
    for (name, place) in places() {
        let color = state_color(place);
        let curve = points(table, |row| row.state[place]);
        panel.tag(name, &curve, color);
        panel.add_named(name, curve, Style::new(color, Shape::Line(2.2)));
        panel.add("", marks(table, place), Style::new(color, state_mark(place)));
    }
    panel.key("truth", Look::Curve(Style::new(BLACK, Shape::Line(4.6)).faint(0.9)));
    if table.rows.iter().any(|row| row.mark) {
        panel.key("end of a step, t = kT", Look::Curve(Style::new(BLACK, Shape::Dots(3.4))));
    }
    panel
}

/// The values that a state takes, predicted and in truth.
fn state_range(table: &PredictionTable, name: &str) -> (f64, f64) {
    let place = table.index_of(name).unwrap_or(0);
    extent(table.rows.iter().flat_map(|row| [row.state[place], row.truth[place]]))
}

/// The place of an input in the plant's order, and its points.
fn input(table: &PredictionTable, name: &str) -> (usize, Vec<Point>) {
    let place = table.inputs.iter().position(|input| input == name).unwrap_or(0);
    (place, points(table, |row| row.input[place]))
}

fn input_panel(run: &Run, table: &PredictionTable, title: &str, names: &[String]) -> Panel {
    let mut panel = run.panel(title, names, 120.0);
    for name in names {
        let (place, points) = input(table, name);
        let style = Style::new(input_color(place), Shape::Line(1.8));
        panel.add_named(name, held_until_next(&points), style);
    }
    panel
}

fn error_panel(run: &Run, variables: &Variables, table: &PredictionTable) -> Panel {
    let label = run.label_in_unit_of("|prediction − truth|", &table.states);
    let mut panel = Panel::new("Absolute error", Axis::new(&label, Kind::Log), 170.0);
    for state in &variables.shown(&table.states) {
        let Some(place) = table.index_of(state) else { continue };
        let style = Style::new(state_color(place), Shape::Line(1.5));
        panel.add_named(state, errors(table, place), style);
    }
    panel
}

fn errors(table: &PredictionTable, place: usize) -> Vec<Point> {
    points(table, |row| (row.state[place] - row.truth[place]).abs())
}

/// Where the controller's prediction ends, N2 steps ahead.
fn horizon(run: &Run, t: (f64, f64)) -> Vec<Event> {
    let (experiment, second) = (&run.experiment, 1.0 / run.time_unit().seconds());
    let control = experiment.control.as_ref().zip(experiment.sample_time_s());
    let end = control.map(|(control, step_s)| t.0 + second * control.horizon_s(step_s));
    let event = end.filter(|end| *end < t.1).map(|end| {
        let label = "horizon of the controller, N₂T".to_owned();
        Event::minor(end, label)
    });
    event.into_iter().collect()
}

fn caption(table: &PredictionTable) -> String {
    let mut worst = Vec::new();
    let names = Variable::grouped_names(&table.states);
    for (places, state) in Variable::groups(&table.states).into_iter().zip(names) {
        let errors: Vec<Point> = places.flat_map(|place| present(errors(table, place))).collect();
        if !errors.is_empty() {
            let largest = extent(errors.iter().map(|p| p.1)).1;
            worst.push(format!("{} in {state}", text::number(largest, 2)));
        }
    }
    let mut caption = "The net predicts from the first state alone: each step of length T starts \
    from \
                       the end of the step before (dots), and the curve between two dots is the \
                       net \
                       evaluated at inner times. The truth, an accurate integration, lies beneath \
                       in \
                       black."
        .to_owned();
    if !worst.is_empty() {
        caption += &format!(" The largest error is {}.", text::listed(&worst));
    }
    format!("{caption} From {}.", file::PREDICTION)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_record::PredictionRow;

    #[test]
    fn an_error_is_of_its_state_without_a_sign() {
        let row = |t: f64, state: [f64; 2], truth: [f64; 2]| PredictionRow {
            t,
            input: vec![0.0],
            state: state.to_vec(),
            truth: truth.to_vec(),
            mark: false,
        };
        let table = PredictionTable {
            inputs: vec!["u".to_owned()],
            states: vec!["a".to_owned(), "b".to_owned()],
            rows: vec![row(0.0, [1.0, 5.0], [1.5, 5.25]), row(2.0, [3.0, -1.0], [2.0, 1.0])],
        };
        assert_eq!(errors(&table, 0), [(0.0, 0.5), (2.0, 1.0)]);
        assert_eq!(errors(&table, 1), [(0.0, 0.25), (2.0, 2.0)]);
    }
}
