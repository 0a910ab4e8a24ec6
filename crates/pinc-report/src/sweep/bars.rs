//! A metric by the cells of a sweep: bars to the median with the quartiles, and every trial.

use super::caption;
use super::curves::side_by_side;
use super::metric::Metric;
use crate::picture::Picture;
use crate::trials::Trials;
use pinc_chart::{
    Area, Axis, BLACK, Figure, Fill, Kind, Look, Panel, Shape, Span, Style, places, state_color,
    text,
};

/// A bar for each cell and model; `None` without cells.
pub(super) fn picture(trials: &Trials, metric: &Metric) -> Option<Picture> {
    let names: Vec<String> = trials.cells().iter().map(|cell| trials.name(cell)).collect();
    if names.is_empty() {
        return None;
    }
    let kind = if metric.log { Kind::Log } else { Kind::Linear };
    let mut panel = Panel::new("", Axis::new(&metric.label, kind), 300.0);
    let (lefts, width) = side_by_side(metric.columns.len());
    for (i, (column, model)) in metric.columns.iter().enumerate() {
        let color = state_color(i);
        let label = if model.is_empty() { "median" } else { model };
        for (at, cell) in places(names.len()).into_iter().zip(trials.cells()) {
            let Some(spread) = metric.spread(trials, cell, *column) else { continue };
            let x = (at + lefts[i], at + lefts[i] + width);
            let middle = 0.5 * (x.0 + x.1);
            panel.areas.push(Area {
                name: label.to_owned(),
                x,
                y: (0.0, spread.median),
                fill: Fill::solid(color),
                value: Some(spread.median),
                text: text::significant(spread.median, 2),
            });
            let values = metric.values(trials, cell, *column);
            if values.len() > 1 {
                let name = format!("{label}, quartiles");
                panel.spans.push(Span { name, x: middle, y: (spread.q1, spread.q3), color: BLACK });
                let dots = values.into_iter().map(|value| (middle, value)).collect();
                let style = Style::new(BLACK, Shape::Rings(2.4)).faint(0.5);
                panel.add(&format!("{label}, trials"), dots, style);
            }
        }
        if !model.is_empty() {
            panel.key(label, Look::Area(Fill::solid(color)));
        }
    }
    panel.note = Some("No trial has a number.".to_owned());
    let figure = Figure::stack(metric.title, Axis::named("", &names), vec![panel]);
    let caption = caption(trials, metric, |sizes| {
        format!(
            "A bar ends at the median over the trials, {sizes}; intervals are the quartiles, rings \
            the \
             trials"
        )
    });
    Some(Picture::new(metric.stem, metric.title, figure, caption))
}
