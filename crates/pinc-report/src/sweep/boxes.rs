//! A metric of trials that differ by draws, by case: a box from quartile to quartile around the
//! median, a line from extreme to extreme, and every trial.

use super::caption;
use super::curves::side_by_side;
use super::metric::Metric;
use crate::picture::Picture;
use crate::trials::{Cell, Trials, shown};
use pinc_chart::{
    Area, Axis, Figure, Fill, Kind, Look, Panel, Point, Shape, Span, Style, places, state_color,
};

/// From this ratio of the largest value to the least on an axis is logarithmic.
const WIDE: f64 = 30.0;
/// The part of a full turn between the places of one trial and the next: so they spread evenly,
/// however many there are.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// A box for each cell and model; `None` if no trial has a number.
pub(super) fn picture(trials: &Trials, metric: &Metric) -> Option<Picture> {
    let columns = || metric.columns.iter().map(|(column, _)| *column);
    let all = columns().flat_map(|column| {
        trials.cells().iter().flat_map(move |cell| metric.values(trials, cell, column))
    });
    let (low, high) = all.map(|v| (v, v)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
    let kind = if low > 0.0 && high > WIDE * low { Kind::Log } else { Kind::Linear };
    let mut panel = Panel::new("", Axis::new(&metric.label, kind), 340.0);
    let (lefts, width) = side_by_side(metric.columns.len());
    for (i, (column, model)) in metric.columns.iter().enumerate() {
        for (at, cell) in places(trials.cells().len()).into_iter().zip(trials.cells()) {
            let Some(spread) = metric.spread(trials, cell, *column) else { continue };
            // Dots lie beside the middle of their case: the table says which it is.
            let of = [*model, &name(trials, cell)].join(" ").trim().to_owned();
            let x = (at + lefts[i] + 0.1 * width, at + lefts[i] + 0.9 * width);
            let (middle, color) = (0.5 * (x.0 + x.1), state_color(i));
            panel.areas.push(Area {
                name: format!("{of}, quartiles"),
                x,
                y: (spread.q1, spread.q3),
                fill: Fill { opacity: 0.25, ..Fill::solid(color) },
                value: Some(spread.median),
                text: String::new(),
            });
            let (name, y) = (format!("{of}, extremes"), (spread.min, spread.max));
            panel.spans.push(Span { name, x: middle, y, color });
            let values = metric.values(trials, cell, *column);
            let turns = places(values.len()).into_iter().map(|k| (GOLDEN * k).fract() - 0.5);
            let strip = turns.map(|turn| middle + 0.5 * width * turn);
            let points: Vec<Point> = strip.zip(values).collect();
            let dots = Style::new(color, Shape::Dots(2.2)).faint(0.6);
            panel.add(&format!("{of}, trials"), points, dots);
            let median = vec![(x.0, spread.median), (x.1, spread.median)];
            let line = Style::new(color, Shape::Line(2.4));
            panel.add(&format!("{of}, median"), median, line);
        }
        if !model.is_empty() {
            panel.key(model, Look::Area(Fill::solid(state_color(i))));
        }
    }
    let names: Vec<String> = trials.cells().iter().map(|cell| name(trials, cell)).collect();
    let caption = caption(trials, metric, |sizes| {
        format!(
            "A box reaches from quartile to quartile, with a line at the median; a thin line joins \
             the extremes; each dot is a trial, {sizes}"
        )
    });
    let figure = Figure::stack(metric.title, Axis::named("", &names), vec![panel]);
    Some(Picture::new(metric.stem, metric.title, figure, caption))
}

/// What tells a cell apart, without what is the same in all.
fn name(trials: &Trials, cell: &Cell) -> String {
    let differs = |column: &usize| trials.values_of(*column).len() > 1;
    let columns = (0..cell.place.len()).filter(differs);
    let names: Vec<String> = columns.map(|column| shown(&cell.place[column])).collect();
    if names.is_empty() { trials.name(cell) } else { names.join(", ") }
}
