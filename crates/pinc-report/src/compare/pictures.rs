//! The traces of runs in one picture: a panel for each variable, a curve for each run and model.

use super::{Compared, differences};
use crate::data::Run;
use crate::picture::Picture;
use crate::traces::ControlTrace;
use pinc_chart::{
    Axis, Figure, INK, Kind, Panel, Point, Shape, Style, extent, held_since_previous,
    held_until_next, present, state_color,
};
use pinc_record::{ControlRow, TrainingRow};

/// The stems of the pictures of loops.
const LOOPS: [&str; 2] = ["control", "differences"];

pub(super) fn all(runs: &[Compared]) -> Vec<Picture> {
    let loops = loops_of(runs);
    let of_loops = [picture(&runs[0].run, &loops), differences::picture(&runs[0].run, &loops)];
    of_loops.into_iter().chain([training(runs), steps(runs)]).flatten().collect()
}

/// Whether a picture shows closed loops, which readers look for first.
pub(super) fn is_of_loops(picture: &Picture) -> bool {
    LOOPS.contains(&picture.stem.as_str())
}

/// The i-th curve: the first is broad and light beneath the others; these differ in color, then in
/// dashes.
pub(super) fn style(i: usize) -> Style {
    if i == 0 {
        return Style::new(state_color(0), Shape::Line(5.0)).faint(0.4);
    }
    let shape = if (i / 6).is_multiple_of(2) { Shape::Line(1.6) } else { Shape::Dashes(1.6) };
    Style::new(state_color(i), shape)
}

/// A loop with its name, and how many of the first run's units of time one of its own is.
pub(super) struct Loop<'a> {
    pub(super) name: String,
    unit: f64,
    pub(super) trace: &'a ControlTrace,
}

impl Loop<'_> {
    fn points(&self, value: impl Fn(&ControlRow) -> Option<f64>) -> Vec<Point> {
        let rows = self.trace.rows.iter();
        rows.map(|row| (self.unit * row.t, value(row).unwrap_or(f64::NAN))).collect()
    }

    /// The place of a variable in the columns of its kind.
    fn place(names: &[String], name: &str) -> Option<usize> {
        names.iter().position(|known| known == name)
    }

    pub(super) fn quantity(&self, name: &str) -> Vec<Point> {
        let columns = &self.trace.columns;
        let state = Self::place(&columns.states, name);
        let output = Self::place(&columns.outputs, name);
        self.points(|row| match (state, output) {
            (Some(place), _) => row.state.get(place).copied(),
            (None, place) => row.output.get(place?).copied(),
        })
    }

    fn reference(&self, name: &str) -> Vec<Point> {
        let place = Self::place(&self.trace.columns.controlled, name);
        held_since_previous(&self.points(|row| row.reference.get(place?).copied()))
    }
}

/// The loops of all runs.
fn loops_of(runs: &[Compared]) -> Vec<Loop<'_>> {
    let second = runs[0].run.time_unit().seconds();
    let mut loops = Vec::new();
    for run in runs {
        let all = &run.run.control.loops;
        loops.extend(all.iter().map(|of| Loop {
            name: run.named(of, all),
            unit: run.run.time_unit().seconds() / second,
            trace: &of.table,
        }));
    }
    loops
}

/// The axis of the times of all loops.
pub(super) fn time_axis(first: &Run, loops: &[Loop<'_>]) -> Axis {
    let times = loops.iter().flat_map(|of| of.trace.rows.iter().map(|row| of.unit * row.t));
    first.time_axis(extent(times))
}

fn picture(first: &Run, loops: &[Loop<'_>]) -> Option<Picture> {
    let columns = &loops.first()?.trace.columns;
    let names = || columns.outputs.iter().chain(&columns.states);
    let controlled = names().filter(|name| columns.controlled.contains(name));
    let others = names().filter(|name| !columns.controlled.contains(name));
    let mut panels: Vec<Panel> =
        controlled.map(|name| quantity(first, loops, name, 200.0)).collect();
    panels.extend(others.map(|name| quantity(first, loops, name, 130.0)));
    panels.extend(columns.inputs.iter().enumerate().map(|(i, name)| input(first, loops, i, name)));
    let axis = time_axis(first, loops);
    let figure = Figure::stack("Closed loops of several runs", axis, panels);
    let caption = "The plants, integrated accurately, under the controllers; dashed in dark grey \
                   the references. The first run is the broad curve: where it is only a rim, the \
                   others do the same.";
    Some(Picture::new(LOOPS[0], "Closed loops", figure, caption))
}

fn quantity(first: &Run, loops: &[Loop<'_>], name: &str, height: f64) -> Panel {
    let mut panel = first.panel(name, &[name], height);
    let mut references: Vec<Vec<Point>> = Vec::new();
    for reference in loops.iter().map(|of| of.reference(name)) {
        let known = references.iter().any(|known| same(known, &reference));
        if !known && reference.iter().any(|point| point.1.is_finite()) {
            references.push(reference);
        }
    }
    for reference in references {
        let style = Style::new(INK, Shape::Dashes(1.4));
        panel.add_named("reference", reference, style);
    }
    for (i, of) in loops.iter().enumerate() {
        panel.add_named(&of.name, of.quantity(name), style(i));
    }
    panel
}

/// Whether two curves are the same numbers.
fn same(one: &[Point], other: &[Point]) -> bool {
    let equal =
        |(a, b): (&Point, &Point)| a.0.total_cmp(&b.0).is_eq() && a.1.total_cmp(&b.1).is_eq();
    one.len() == other.len() && one.iter().zip(other).all(equal)
}

fn input(first: &Run, loops: &[Loop<'_>], place: usize, name: &str) -> Panel {
    let mut panel = first.panel(name, &[name], 130.0);
    for (i, of) in loops.iter().enumerate() {
        let points = of.points(|row| row.input.get(place).copied());
        panel.add_named(&of.name, held_until_next(&points), style(i));
    }
    panel
}

fn training(runs: &[Compared]) -> Option<Picture> {
    let rows = |of: &Compared| of.run.training.clone().unwrap_or_default();
    let curve = |of: &Compared, value: fn(&TrainingRow) -> Option<f64>| {
        let point =
            |row: &TrainingRow| (row.loss_evaluations as f64, value(row).unwrap_or(f64::NAN));
        present(rows(of).iter().map(point).collect())
    };
    let label = runs[0].run.label_in_all_states_unit("validation MSE", "²");
    let mut validation = Panel::new("Validation", Axis::new(&label, Kind::Log), 240.0);
    let mut loss = Panel::new("Loss", Axis::new("mean squared error", Kind::Log), 200.0);
    for (i, of) in runs.iter().enumerate() {
        validation.add_named(&of.name, curve(of, |row| row.validation_mse), style(i));
        loss.add_named(&of.name, curve(of, |row| Some(row.loss)), style(i));
    }
    let end = extent(runs.iter().flat_map(|of| curve(of, |row| Some(row.loss))).map(|p| p.0)).1;
    let axis = Axis::ranged("loss evaluations", Kind::Linear, (0.0, end));
    let any = !validation.series.is_empty() || !loss.series.is_empty();
    let figure = Figure::stack("Training curves of several runs", axis, vec![validation, loss]);
    let caption = "The validation errors and the losses, on logarithmic axes.";
    any.then(|| Picture::new("training", "Trainings", figure, caption))
}

fn steps(runs: &[Compared]) -> Option<Picture> {
    let axis = |label| Axis::new(label, Kind::Log);
    let mut times = Panel::new("Time per step", axis("solve time (µs)"), 200.0);
    let mut residuals = Panel::new("KKT residual", axis("KKT residual"), 160.0);
    let all = runs.iter().flat_map(|run| run.run.steps.iter().map(move |of| (run, of)));
    let mut last: f64 = 0.0;
    for (i, (run, of)) in all.enumerate() {
        let dots = Style::new(state_color(i), Shape::Dots(2.2)).faint(0.7);
        let name = run.named(of, &run.run.steps);
        let points = |value: fn(&pinc_record::StepRow) -> f64| -> Vec<Point> {
            of.table.rows.iter().map(|row| (row.step as f64, value(row))).collect()
        };
        last = points(|row| row.kkt).iter().fold(last, |last, point| last.max(point.0));
        times.add_named(&name, points(|row| row.solve_us), dots);
        residuals.add_named(&name, points(|row| row.kkt), dots);
    }
    let any = !times.series.is_empty() || !residuals.series.is_empty();
    let x = Axis::ranged("control step k", Kind::Linear, (-0.5, last + 0.5));
    let figure = Figure::stack("The controllers step by step", x, vec![times, residuals]);
    let caption = "Time and remaining KKT residual of each control step.";
    any.then(|| Picture::new("steps", "Controllers per step", figure, caption))
}
