//! The controller in each step: time, iterations, residual.

use crate::data::Run;
use crate::picture::Picture;
use pinc_chart::{
    AMBER, Axis, BLACK, BLUE, Figure, Kind, Panel, Shape, Style, extent, present, text,
};
use pinc_config::ModelKind;
use pinc_record::StepRow;

/// The controller step by step, if there was a closed loop.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let steps: Vec<f64> = run.steps.iter().flat_map(|of| &of.table.rows).map(number).collect();
    if steps.is_empty() {
        return None;
    }
    let (first, last) = extent(steps.into_iter());
    let axis = Axis::ranged("control step k", Kind::Linear, (first - 0.5, last + 0.5));
    let panels = vec![times(run), iterations(run), residuals(run)];
    let figure = Figure::stack("The controller step by step", axis, panels);
    Some(Picture::new("steps", "Controller per step", figure, caption(run)))
}

/// A step's number on an axis.
fn number(row: &StepRow) -> f64 {
    row.step as f64
}

fn times(run: &Run) -> Panel {
    let mut all = Vec::new();
    let mut named = Vec::new();
    for (i, of) in run.steps.iter().enumerate() {
        let points = of.table.rows.iter().map(|row| (number(row), row.solve_us));
        let points = present(points.collect());
        all.extend(points.iter().map(|p| p.1));
        let median = of.table.median_us.map(|us| text::duration(1e-6 * us));
        let median = median.unwrap_or_else(|| text::MISSING.to_owned());
        let model = run.model_name(of.model);
        named.push((format!("{model}, median {median}"), model, points, dots(i)));
    }
    let (low, high) = extent(all.into_iter());
    let kind = if low > 0.0 && high > 5.0 * low { Kind::Log } else { Kind::Linear };
    let mut panel = Panel::new("Time per step", Axis::new("solve time (µs)", kind), 190.0);
    for (label, model, points, style) in named {
        panel.add_beneath(&label, model, points, style);
    }
    panel
}

fn iterations(run: &Run) -> Panel {
    let mut panel = Panel::new("SQP iterations", Axis::new("iterations", Kind::Count), 130.0);
    add_with_failures(run, &mut panel, |row| row.sqp_iterations as f64);
    panel
}

fn residuals(run: &Run) -> Panel {
    let mut panel = Panel::new("KKT residual", Axis::new("KKT residual", Kind::Log), 190.0);
    add_with_failures(run, &mut panel, |row| row.kkt);
    if let Some(control) = &run.experiment.control {
        panel.add_limits("tolerance", &[control.sqp.tolerance]);
    }
    panel
}

/// Adds a quantity for each model, with crosses at the steps that did not converge.
fn add_with_failures(run: &Run, panel: &mut Panel, value: fn(&StepRow) -> f64) {
    let mut failed = Vec::new();
    let point = |row: &StepRow| (number(row), value(row));
    for (i, of) in run.steps.iter().enumerate() {
        failed.extend(of.table.rows.iter().filter(|row| !row.converged()).map(point));
        let (model, points) = (run.model_name(of.model), of.table.rows.iter().map(point).collect());
        panel.add_beneath(model, model, points, dots(i));
    }
    let crosses = Style::new(BLACK, Shape::Crosses(5.0));
    panel.add_named("not converged", failed, crosses);
}

/// The first model's dots are small and dark, and lie over the others'.
fn dots(place: usize) -> Style {
    match place {
        0 => Style::new(BLUE, Shape::Dots(2.0)),
        _ => Style::new(AMBER, Shape::Dots(3.6)).faint(0.75),
    }
}

fn caption(run: &Run) -> String {
    let mut caption =
        "Time, SQP iterations and remaining KKT residual of each control step.".to_owned();
    let first = run.steps.first().and_then(|of| of.model);
    let metrics = first.and_then(|model| run.metrics.as_ref()?.loop_with(model));
    if let Some(runs) = metrics.map(|of| of.wall_s.runs).filter(|runs| *runs > 1) {
        caption += &format!(" A time is the median of {runs} repetitions of the loop.");
    }
    for of in &run.steps {
        let steps = &of.table;
        let (all, model) = (text::count(steps.count), run.model_name(of.model));
        caption += &match steps.failed {
            0 if of.model == Some(ModelKind::Policy) => {
                format!(" {model} decided all {all} steps without an optimization.")
            }
            0 => format!(" With {model} all {all} steps converged."),
            bad => format!(
                " With {model} {} of {all} steps did not converge ({}; crosses).",
                text::count(bad),
                steps.reasons.join(", ")
            ),
        };
    }
    if run.steps.iter().any(|of| of.table.rows.len() < of.table.count) {
        caption += " Of so many steps those are drawn that stand out.";
    }
    let files: Vec<_> = run.steps.iter().map(|of| of.file.clone()).collect();
    format!("{caption} From {}.", text::listed(&files))
}
