//! The estimates with their bands, and the innovations.

use crate::data::{OfModel, Run};
use crate::picture::Picture;
use pinc_chart::{
    AMBER, Axis, BLUE, Figure, INK, Kind, Panel, Point, Shape, Style, extent, present, state_color,
    text,
};
use pinc_record::{EstimateRow, EstimateTable};

/// 95 % of a normal distribution lie within so many standard deviations.
const BAND: f64 = 1.96;

/// The estimates of each model, if there was an estimator.
pub(crate) fn pictures(run: &Run) -> Vec<Picture> {
    let tables = || run.estimates.iter().filter(|of| !of.table.rows.is_empty());
    let several = tables().count() > 1;
    tables().map(|of| picture(run, of, several)).collect()
}

/// The estimates of a model, which may be one of several.
fn picture(run: &Run, of: &OfModel<EstimateTable>, several: bool) -> Picture {
    let axis = run.time_axis(extent(of.table.rows.iter().map(|row| row.t)));
    let table = &of.table;
    let mut panels: Vec<Panel> = (0..table.names.len()).map(|i| estimate(run, of, i)).collect();
    panels.extend((0..table.measured.len()).map(|i| innovation(run, table, i)));
    panels.push(consistency(table));
    let (stem, title) = match of.model.filter(|_| several) {
        None => ("estimates".to_owned(), "Estimates".to_owned()),
        Some(model) => {
            (format!("estimates-{model}"), format!("Estimates with {}", run.model_name(of.model)))
        }
    };
    let figure = Figure::stack(&title, axis, panels);
    Picture::new(stem, title, figure, caption(run, of))
}

fn points(table: &EstimateTable, value: impl Fn(&EstimateRow) -> f64) -> Vec<Point> {
    present(table.rows.iter().map(|row| (row.t, value(row))).collect())
}

/// One estimate with its band, and the truth where it is known.
fn estimate(run: &Run, of: &OfModel<EstimateTable>, i: usize) -> Panel {
    let (table, name) = (&of.table, &of.table.names[i]);
    let mut panel = run.panel(name, &[name], 120.0);
    let trace = run.control.loops.iter().find(|trace| trace.model == of.model);
    let truth = trace.and_then(|trace| {
        let place = trace.table.columns.states.iter().position(|state| state == name)?;
        Some(trace.table.rows.iter().map(|row| (row.t, row.state[place])).collect())
    });
    if let Some(truth) = truth {
        panel.add_named("plant", truth, Style::new(INK, Shape::Line(1.2)));
    }
    if let Some(place) = table.measured.iter().position(|measured| measured == name) {
        let measured = points(table, |row| row.measured[place]);
        panel.add_named("measured", measured, Style::new(AMBER, Shape::Dots(1.6)).faint(0.6));
    }
    let color = state_color(i);
    let estimates = points(table, |row| row.estimate[i]);
    panel.add_named("estimate", estimates, Style::new(color, Shape::Line(1.4)));
    let edge = |sign: f64| points(table, move |row| row.estimate[i] + sign * BAND * row.sd[i]);
    let style = Style::new(color, Shape::Dashes(0.9)).faint(0.7);
    panel.add_named("95 % band", edge(1.0), style);
    panel.add("95 % band below", edge(-1.0), style);
    panel
}

/// What is measured less what was expected.
fn innovation(run: &Run, table: &EstimateTable, i: usize) -> Panel {
    let name = &table.measured[i];
    let label = run.label_in_unit_of("innovation", &[name]);
    let title = format!("Innovation of {name}");
    let mut panel = Panel::new(&title, Axis::new(&label, Kind::Linear), 100.0);
    let dots = Style::new(BLUE, Shape::Dots(2.0));
    panel.add(&format!("innovation_{name}"), points(table, |row| row.innovation[i]), dots);
    panel.limits.push(0.0);
    panel
}

/// A column of the table.
type Value = fn(&EstimateRow) -> f64;

/// The normalized squares of innovations and errors.
fn consistency(table: &EstimateTable) -> Panel {
    let axis = Axis::new("normalized square", Kind::Log);
    let mut panel = Panel::new("Consistency", axis, 130.0);
    let squares: [(&str, Value, Style); 2] = [
        ("NIS", |row| row.nis, Style::new(BLUE, Shape::Dots(2.0))),
        ("NEES", |row| row.nees, Style::new(AMBER, Shape::Dots(2.0))),
    ];
    for (name, value, style) in squares {
        let positive = points(table, value).into_iter().filter(|point| point.1 > 0.0);
        panel.add_named(name, positive.collect(), style);
    }
    panel
}

fn caption(run: &Run, of: &OfModel<EstimateTable>) -> String {
    let mut caption = format!(
        "What the estimator with {} as its model makes of the measurements, with bands of 95 %, \
         and d_.. for disturbances. Below, innovations, measured less expected, and the normalized \
         squares of innovations (NIS) and errors (NEES).",
        run.model_name(of.model)
    );
    let metrics = of.model.and_then(|model| run.metrics.as_ref()?.loop_with(model));
    if let Some(estimator) = metrics.and_then(|of| of.estimator.as_ref()) {
        let states = estimator.estimate_rmse.len() as f64;
        caption += &mean("NIS", estimator.nis_mean, estimator.nis_expected);
        caption += &mean("NEES", estimator.nees_mean, states);
        caption += " Larger means say that the estimator trusts itself too much.";
        let ended = estimator.estimator_status.iter().filter(|(status, _)| *status != "updated");
        let ended: Vec<_> = ended.map(|(status, count)| format!("{count} {status}")).collect();
        if !ended.is_empty() {
            caption += &format!(" Steps that did not end as usual: {}.", ended.join(", "));
        }
    }
    format!("{caption} From {}.", of.file)
}

/// A mean of normalized squares, beside the one of a consistent estimator where that is known.
fn mean(name: &str, mean: f64, expected: f64) -> String {
    if mean.is_nan() {
        return format!(" No step has a {name}.");
    }
    let consistent = match expected.is_nan() {
        true => String::new(),
        false => format!(", of a consistent estimator {}", text::significant(expected, 3)),
    };
    format!(" The mean {name} is {}{consistent}.", text::significant(mean, 3))
}
