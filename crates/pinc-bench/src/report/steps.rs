//! What the controller did in each step: time, iterations, residual.

use super::ReportError;
use super::data::{OfModel, Run};
use super::picture::Picture;
use super::table::Table;
use pinc_chart::text;
use pinc_chart::{AMBER, Axis, BLACK, BLUE, Figure, Kind, Panel, Shape, Style, extent, present};

/// The controller step by step, if there was a closed loop.
pub(super) fn picture(run: &Run) -> Result<Option<Picture>, ReportError> {
    let mut steps = Vec::new();
    for of in &run.steps {
        steps.extend(of.table.numbers("step")?);
    }
    if steps.is_empty() {
        return Ok(None);
    }
    let (first, last) = extent(steps.into_iter());
    let axis = Axis::ranged("control step k", Kind::Linear, (first - 0.5, last + 0.5));
    let panels = vec![times(run)?, iterations(run)?, residuals(run)?];
    let figure = Figure::stack("The controller step by step", axis, panels);
    Ok(Some(Picture {
        stem: "steps".to_owned(),
        title: "Controller per step".to_owned(),
        caption: caption(run)?,
        figure,
    }))
}

fn times(run: &Run) -> Result<Panel, ReportError> {
    let mut all = Vec::new();
    let mut named = Vec::new();
    for (i, of) in run.steps.iter().enumerate() {
        let points = present(of.table.points("step", "solve_us")?.unwrap_or_default());
        all.extend(points.iter().map(|p| p.1));
        let median = median(points.iter().map(|p| p.1).collect());
        let median = median.map_or(text::MISSING.to_owned(), |m| text::duration(m * 1e-6));
        let label = format!("{}, median {median}", run.model_name(&of.model));
        named.push((label, run.model_name(&of.model), points, dots(i)));
    }
    let (low, high) = extent(all.into_iter());
    let kind = if low > 0.0 && high > 5.0 * low { Kind::Log } else { Kind::Linear };
    let mut panel = Panel::new("Time per step", Axis::new("solve time (µs)", kind), 190.0);
    for (label, model, points, style) in named {
        panel.add_beneath(&label, &model, points, style);
    }
    Ok(panel)
}

fn iterations(run: &Run) -> Result<Panel, ReportError> {
    let mut panel = Panel::new("SQP iterations", Axis::new("iterations", Kind::Count), 130.0);
    add_with_failures(run, &mut panel, "sqp_iterations")?;
    Ok(panel)
}

fn residuals(run: &Run) -> Result<Panel, ReportError> {
    let mut panel = Panel::new("KKT residual", Axis::new("KKT residual", Kind::Log), 190.0);
    add_with_failures(run, &mut panel, "kkt")?;
    if let Some(tolerance) = run.number(&["control", "sqp", "tolerance"]) {
        panel.add_limits("tolerance", &[tolerance]);
    }
    Ok(panel)
}

/// Adds a column for each model, with crosses at the steps that did not converge.
fn add_with_failures(run: &Run, panel: &mut Panel, column: &str) -> Result<(), ReportError> {
    let mut failed = Vec::new();
    for (i, OfModel { model, table }) in run.steps.iter().enumerate() {
        let points = table.points("step", column)?.unwrap_or_default();
        let statuses = statuses(table)?;
        let failures = points.iter().zip(&statuses).filter(|(_, s)| !converged(s));
        failed.extend(failures.map(|(p, _)| *p));
        panel.add_beneath(&run.model_name(model), &run.model_name(model), points, dots(i));
    }
    let crosses = Style::new(BLACK, Shape::Crosses(5.0));
    panel.add_named("not converged", failed, crosses);
    Ok(())
}

/// The first model's dots are small and dark, and lie over the others'.
fn dots(place: usize) -> Style {
    match place {
        0 => Style::new(BLUE, Shape::Dots(2.0)),
        _ => Style::new(AMBER, Shape::Dots(3.6)).faint(0.75),
    }
}

fn statuses(table: &Table) -> Result<Vec<&str>, ReportError> {
    match table.has("status") {
        true => table.texts("status"),
        false => Ok(vec!["converged"; table.len()]),
    }
}

fn converged(status: &str) -> bool {
    status == "converged"
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n.is_multiple_of(2) => Some(f64::midpoint(values[middle - 1], values[middle])),
        _ => Some(values[middle]),
    }
}

fn caption(run: &Run) -> Result<String, ReportError> {
    let mut caption =
        "Time, SQP iterations and remaining KKT residual of each control step.".to_owned();
    let runs = |of: &OfModel| run.control_metrics(&of.model)?["wall_s"]["runs"].as_u64();
    if let Some(runs) = run.steps.first().and_then(runs).filter(|runs| *runs > 1) {
        caption += &format!(" A time is the median of {runs} repetitions of the loop.");
    }
    let files: Vec<_> = run.steps.iter().map(|of| of.table.file_name()).collect();
    for OfModel { model, table } in &run.steps {
        let statuses = statuses(table)?;
        let mut reasons: Vec<String> = Vec::new();
        for status in statuses.iter().filter(|s| !converged(s)) {
            if !reasons.iter().any(|r| r == status) {
                reasons.push((*status).to_owned());
            }
        }
        let (all, bad) = (statuses.len(), statuses.iter().filter(|s| !converged(s)).count());
        let model = run.model_name(model);
        caption += &match bad {
            0 => format!(" With {model} all {} steps converged.", text::count(all)),
            _ => format!(
                " With {model} {} of {} steps did not converge ({}; crosses).",
                text::count(bad),
                text::count(all),
                reasons.join(", ")
            ),
        };
    }
    Ok(format!("{caption} From {}.", text::listed(&files)))
}
