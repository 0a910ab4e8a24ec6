//! The closed loop: what the plant did under the controller, PINC over RK4.

use crate::data::{OfModel, Run};
use crate::picture::Picture;
use crate::traces::{CloseUp, ControlTrace};
use crate::variables::{EQUAL, Variables, by_axis};
use pinc_chart::{
    AMBER, Axis, Color, Figure, INK, Kind, Look, Panel, Point, Shape, Style, extent,
    held_since_previous, held_until_next, input_color, present, state_color, text,
};
use pinc_config::ControlSpec;
use pinc_mpc::Bounded;
use pinc_ode::Variable;
use pinc_record::ControlRow;

/// A run of more steps than this gets a close-up of its first steps.
const LONG: f64 = 60.0;
/// The form of a reference.
const REFERENCE: Shape = Shape::Dashes(1.4);
/// The key of what plans expect.
const RANGE: &str = "range of plans";

/// The whole closed loop, and parts of it enlarged.
pub(crate) fn pictures(run: &Run, variables: &Variables) -> Vec<Picture> {
    let traces = &run.control.loops;
    if traces.iter().all(|of| of.table.rows.is_empty()) {
        return Vec::new();
    }
    let loops = Loops { run, variables, traces };
    let times = traces.iter().flat_map(|of| &of.table.rows).map(|row| row.t);
    let t = extent(times);
    let axis = run.time_axis(t);
    let figure = Figure::stack("Closed loop", axis, loops.panels());
    let mut pictures = vec![Picture::new("control", "Closed loop", figure, loops.caption())];
    let close_ups = loops.close_ups(&pictures[0].figure, t);
    pictures.extend(close_ups);
    pictures
}

/// What is drawn of a trace.
type Curve = fn(&ControlRow, usize) -> f64;

/// The points of one variable over time.
fn points(table: &ControlTrace, value: Curve, place: usize) -> Vec<Point> {
    table.rows.iter().map(|row| (row.t, value(row, place))).collect()
}

/// A state, or one of the outputs, which follow them.
fn quantity(row: &ControlRow, place: usize) -> f64 {
    let states = row.state.len();
    if place < states { row.state[place] } else { row.output[place - states] }
}

fn input(row: &ControlRow, place: usize) -> f64 {
    row.input[place]
}

/// The closed loops of a run; the last model is drawn first, so that PINC lies over RK4.
struct Loops<'a> {
    run: &'a Run,
    variables: &'a Variables,
    traces: &'a [OfModel<ControlTrace>],
}

impl Loops<'_> {
    fn panels(&self) -> Vec<Panel> {
        let mut groups = self.variables.output_panels();
        groups.extend(self.variables.panels_of(&self.variables.states));
        let range = |name: &str| self.range(name);
        let divide = |(title, names)| by_axis(self.run, title, names, &range);
        let groups: Vec<_> = groups.into_iter().flat_map(divide).collect();
        let mut panels = Vec::new();
        for (i, (title, group)) in groups.iter().enumerate() {
            let height = if i == 0 { 280.0 } else { 180.0 };
            panels.push(self.state_panel(title, group, height));
        }
        let range = |name: &str| self.input_range(name);
        let inputs = by_axis(self.run, "Inputs".to_owned(), self.variables.inputs.clone(), &range);
        panels.extend(inputs.iter().map(|(title, names)| self.input_panel(title, names)));
        panels.extend(self.difference_panel());
        panels
    }

    /// The values that a variable and its reference take.
    fn range(&self, name: &str) -> (f64, f64) {
        let place = self.variables.index_of(name);
        let rows = self.traces.iter().flat_map(|of| &of.table.rows);
        let values = rows.map(|row| quantity(row, place));
        let first = &self.traces[0].table;
        let followed = first.columns.controlled.iter().position(|controlled| controlled == name);
        let rows = first.rows.iter();
        let references =
            followed.into_iter().flat_map(|i| rows.clone().map(move |row| row.reference[i]));
        extent(values.chain(references))
    }

    /// Crosses where control steps failed, on the curves of a state.
    fn add_failures(&self, panel: &mut Panel, place: usize) {
        let Some(length) = self.run.step() else { return };
        let mut failed = Vec::new();
        for (of, steps) in self.traces.iter().zip(&self.run.steps) {
            for step in steps.table.rows.iter().filter(|step| step.failed()) {
                let t = step.step as f64 * length;
                let k = of.table.rows.partition_point(|row| row.t < t - 1e-6 * length);
                failed.extend(of.table.rows.get(k).map(|row| (row.t, quantity(row, place))));
            }
        }
        panel.add_named("failed steps", failed, Style::new(INK, Shape::Crosses(5.0)));
    }

    fn state_panel(&self, title: &str, states: &[String], height: f64) -> Panel {
        let mut panel = self.run.panel(title, states, height);
        self.add_references(&mut panel, states);
        let places = || states.iter().map(|name| (name, self.variables.index_of(name)));
        for (name, place) in places() {
            self.add_curve(&mut panel, name, state_color(place), |table| {
                points(table, quantity, place)
            });
        }
        for (name, place) in places() {
            self.add_range(&mut panel, name, place);
        }
        for (name, place) in places().rev() {
            self.add_beneath(&mut panel, name, |table| points(table, quantity, place));
        }
        if states.iter().any(|state| self.variables.controlled.contains(state)) {
            panel.key("reference", Look::Curve(Style::new(INK, REFERENCE)));
        }
        let controlled = states.iter().filter(|state| self.variables.controlled.contains(state));
        for state in controlled.take(1) {
            self.add_failures(&mut panel, self.variables.index_of(state));
        }
        let states = self.variables.states.len();
        for (name, place) in places() {
            let output = place.checked_sub(states).map(Bounded::Output);
            self.add_limits(&mut panel, name, output.unwrap_or(Bounded::State(place)));
        }
        panel
    }

    /// Adds the ends of what plans with the first model expect of a state.
    fn add_range(&self, panel: &mut Panel, name: &str, place: usize) {
        let Some(plans) = self.run.plans.first() else { return };
        let style = Style::new(state_color(place), Shape::Line(0.9)).faint(0.75);
        for (which, end) in ["low", "high"].into_iter().enumerate() {
            let rows = plans.table.rows.iter();
            let points = rows.filter_map(|row| Some((row.t, *row.values[which].get(place)?)));
            let points: Vec<Point> = points.collect();
            if points.is_empty() {
                return;
            }
            panel.add_beneath(RANGE, &format!("{name}_{end} of plans"), points, style);
        }
    }

    fn add_references(&self, panel: &mut Panel, states: &[String]) {
        let first = &self.traces[0].table;
        for state in states {
            let Some(place) = first.columns.controlled.iter().position(|name| name == state) else {
                continue;
            };
            let color = state_color(self.variables.index_of(state));
            let points = points(first, |row, place| row.reference[place], place);
            let style = Style::new(color, REFERENCE);
            panel.add(&format!("{state}_ref"), held_since_previous(&points), style);
        }
    }

    /// The values that an input takes.
    fn input_range(&self, name: &str) -> (f64, f64) {
        let place = self.variables.input_index_of(name);
        let rows = self.traces.iter().flat_map(|of| &of.table.rows);
        extent(rows.map(|row| input(row, place)))
    }

    fn input_panel(&self, title: &str, inputs: &[String]) -> Panel {
        let mut panel = self.run.panel(title, inputs, 150.0);
        let steps = |table: &ControlTrace, i| held_until_next(&points(table, input, i));
        let places = || inputs.iter().map(|name| (name, self.variables.input_index_of(name)));
        for (name, i) in places() {
            self.add_curve(&mut panel, name, input_color(i), |table| steps(table, i));
        }
        for (name, i) in places().rev() {
            self.add_beneath(&mut panel, name, |table| steps(table, i));
        }
        for (name, i) in places() {
            self.add_limits(&mut panel, name, Bounded::Input(i));
        }
        panel
    }

    /// Adds a variable's curve with the first model.
    fn add_curve(
        &self,
        panel: &mut Panel,
        variable: &str,
        color: Color,
        curve: impl Fn(&ControlTrace) -> Vec<Point>,
    ) {
        let of = &self.traces[0];
        let points = curve(&of.table);
        let label = match self.traces.len() {
            1 => variable.to_owned(),
            _ => format!("{variable} with {}", self.run.model_name(of.model)),
        };
        panel.tag(variable, &points, color);
        panel.add_named(&label, points, Style::new(color, Shape::Line(1.8)));
    }

    /// Adds a variable's curves with the other models, broad and light beneath what is there: the last
    /// one first, so that legends have the models' order.
    fn add_beneath(
        &self,
        panel: &mut Panel,
        variable: &str,
        curve: impl Fn(&ControlTrace) -> Vec<Point>,
    ) {
        for of in self.traces[1..].iter().rev() {
            let label = format!("with {}", self.run.model_name(of.model));
            let style = Style::new(AMBER, Shape::Line(5.0)).faint(0.55);
            panel.add_beneath(&label, &format!("{variable} {label}"), curve(&of.table), style);
        }
    }

    /// Adds the lower and the upper bound of a variable: a level, or a curve if it changes.
    fn add_limits(&self, panel: &mut Panel, name: &str, of: Bounded) {
        let Some(control) = &self.run.experiment.control else { return };
        let second = 1.0 / self.run.time_unit().seconds();
        for (bound, which) in control.bounds_over_time(of, name).iter().zip(["low", "high"]) {
            match &bound[..] {
                [] => {}
                [(_, constant)] => panel.add_limits("limits", &[*constant]),
                [.., (_, last)] => {
                    let all = bound.iter().copied().chain([(control.duration_s, *last)]);
                    let points: Vec<Point> = all.map(|(t, y)| (t * second, y)).collect();
                    let name = format!("{name}_{which}");
                    panel.add_changing_limit("limits", &name, held_until_next(&points));
                }
            }
        }
    }

    /// How far the first two models' loops are apart.
    fn difference_panel(&self) -> Option<Panel> {
        let [one, two, ..] = self.traces else { return None };
        let title =
            format!("|{} − {}|", self.run.model_name(one.model), self.run.model_name(two.model));
        let states = &self.variables.states;
        let label = self.run.label_in_unit_of(&title, states);
        let mut panel = Panel::new("Difference of the states", Axis::new(&label, Kind::Log), 170.0);
        for state in &self.variables.shown(states) {
            let place = self.variables.index_of(state);
            let style = Style::new(state_color(place), Shape::Line(1.4));
            panel.add_named(state, differences(&one.table, &two.table, place), style);
        }
        Some(panel)
    }

    /// Enlarged parts of the picture: those that the config asks for, or else the first steps if
    /// the run has many.
    fn close_ups(&self, whole: &Figure, t: (f64, f64)) -> Vec<Picture> {
        let asked = self.run.experiment.control.as_ref().map_or(0, |spec| spec.close_ups_s.len());
        let (asked, first_steps) = self.run.control.close_ups.split_at(asked);
        let shown = |part: &&CloseUp| part.window.0 < t.1 && part.window.1 > t.0;
        let asked: Vec<&CloseUp> = asked.iter().filter(shown).collect();
        let is_long = self.run.step().is_some_and(|step| t.1 - t.0 > LONG * step);
        let first_steps = first_steps.iter().filter(|_| is_long && asked.is_empty());
        let parts = asked.iter().copied().chain(first_steps);
        parts.map(|part| self.close_up(whole, part, t)).collect()
    }

    fn close_up(&self, whole: &Figure, part: &CloseUp, t: (f64, f64)) -> Picture {
        let (from, to) = (part.window.0.max(t.0), part.window.1.min(t.1));
        let window = format!(
            "{} {unit} to {} {unit}",
            text::number(from, 6),
            text::number(to, 6),
            unit = self.run.time_unit().name()
        );
        let mut figure = whole.clone();
        if let Some(traces) = &part.loops {
            figure.panels = Loops { traces, ..*self }.panels();
        }
        figure.name = format!("Closed loop from {window}");
        figure.x.range = Some((from, to));
        let (stem, title) = (format!("control-{from}-{to}"), format!("Closed loop: {window}"));
        let caption = "A part of the picture above, enlarged. From the same files.";
        Picture::new(stem, title, figure, caption)
    }

    fn caption(&self) -> String {
        let files: Vec<_> = self.traces.iter().map(|of| of.file.clone()).collect();
        let mut caption = "The plant, integrated accurately, under the controller. Dashed: the \
                           references, in the colours of what follows them; grey: the bounds."
            .to_owned();
        if let Some(plans) = self.run.plans.first() {
            let scenarios = |control: &ControlSpec| control.scenarios.as_ref()?.branches();
            let over = match self.run.experiment.control.as_ref().and_then(scenarios) {
                Some(branches) => {
                    format!("over the {branches} combinations of [control.scenarios]")
                }
                None => "by [control.uncertainty]".to_owned(),
            };
            caption += &format!(
                " Faint and thin: the least and the greatest value of each state that plans expect \
                {over}, drawn for plans that do not overlap (from {}).",
                plans.file
            );
        }
        if let [first, second, ..] = self.traces {
            let (one, two) = (self.run.model_name(first.model), self.run.model_name(second.model));
            caption += &format!(
                " Thin curves: with {one} as the controller's model; broad amber curves beneath: \
                with \
                 {two}. Where amber is only a rim, both do the same."
            );
            let mut largest = Vec::new();
            let states = &self.variables.states;
            let names = Variable::grouped_names(states);
            for (places, name) in Variable::groups(states).into_iter().zip(names) {
                let all = places
                    .flat_map(|place| present(differences(&first.table, &second.table, place)));
                let most = extent(all.map(|p| p.1)).1;
                largest.push(format!("{} in {name}", text::number(most, 2)));
            }
            caption += &format!(
                " They differ by at most {} (lowest panel; no curve where they are equal up to \
                rounding).",
                text::listed(&largest)
            );
        }
        if let Some(rows) = self.run.control.taken_of {
            let rows = text::count(rows);
            caption += &format!(
                " Of {rows} rows those are drawn where a curve is at its highest or lowest."
            );
        }
        format!("{caption} From {}.", text::listed(&files))
    }
}

/// By how much a state differs between two loops, as far as both go.
fn differences(one: &ControlTrace, two: &ControlTrace, place: usize) -> Vec<Point> {
    let pairs = one.rows.iter().zip(&two.rows);
    // Times that are the same number were computed alike; one loop may have ended early.
    let together = pairs.take_while(|(a, b)| (a.t - b.t).abs() <= 1e-9 * a.t.abs());
    // What rounding alone makes is no difference, and would stretch a logarithmic axis.
    let differs = |a: f64, b: f64| (a - b).abs() > EQUAL * a.abs().max(b.abs());
    let difference = |a: f64, b: f64| if differs(a, b) { (a - b).abs() } else { 0.0 };
    together.map(|(a, b)| (a.t, difference(a.state[place], b.state[place]))).collect()
}
