//! A metric over one axis of a sweep: the median of each cell with its quartiles, and every trial.

use super::metric::Metric;
use super::{bars, caption};
use crate::picture::Picture;
use crate::trials::{Cell, Trials, short, shown};
use pinc_chart::{
    Axis, Figure, Kind, Panel, Point, Shape, Span, Style, places, state_color, state_mark,
};
use pinc_record::TrialMetric;

/// From this ratio of its ends on an axis is logarithmic.
const WIDE: f64 = 8.0;

/// The metric over the one axis, a curve for each case and model. An axis of names has bars.
pub(super) fn picture(trials: &Trials, metric: &Metric) -> Option<Picture> {
    let axis = trials.axes()[0];
    let values = trials.values_of(axis);
    let numbers: Vec<f64> = values.iter().filter_map(|v| v.parse().ok()).collect();
    if numbers.len() < values.len() || numbers.len() < 2 {
        return bars::picture(trials, metric);
    }
    let curves = Curves { trials, metric, axis };
    let figure = curves.figure(&numbers, &values);
    let caption = caption(trials, metric, |sizes| {
        format!(
            "Median over the trials, with the quartiles as intervals; each light dot is a trial, \
            {sizes}"
        )
    });
    Some(Picture::new(metric.stem, metric.title, figure, caption))
}

struct Curves<'a> {
    trials: &'a Trials,
    metric: &'a Metric,
    axis: usize,
}

impl Curves<'_> {
    fn figure(&self, numbers: &[f64], values: &[String]) -> Figure {
        let (first, last) = (numbers[0], numbers[numbers.len() - 1]);
        let kind = if first > 0.0 && last > WIDE * first { Kind::Log } else { Kind::Linear };
        // A little more than from the first to the last.
        let range = match kind {
            Kind::Log => (first / 1.15, last * 1.15),
            _ => (first - 0.04 * (last - first), last + 0.04 * (last - first)),
        };
        let mut x = Axis::ranged(&short(&self.trials.columns()[self.axis]), kind, range);
        x.marks = numbers.iter().zip(values).map(|(at, value)| (*at, shown(value))).collect();
        let kind = if self.metric.log { Kind::Log } else { Kind::Linear };
        let mut panel = Panel::new("", Axis::new(&self.metric.label, kind), 340.0);
        let groups = self.groups();
        let curves = groups.iter().flat_map(|g| self.metric.columns.iter().map(move |c| (g, c)));
        for (i, ((name, cells), (column, model))) in curves.enumerate() {
            let names = [name.as_str(), model].into_iter().filter(|w| !w.is_empty());
            let names: Vec<&str> = names.collect();
            let label = match names.as_slice() {
                [] if self.trials.are_alone() => "trial".to_owned(),
                [] => "median".to_owned(),
                names => names.join(", "),
            };
            self.add(&mut panel, &label, i, cells, *column);
        }
        panel.note = Some("No trial has a number.".to_owned());
        let name = format!("{} over {}", self.metric.label, x.label);
        Figure::stack(&name, x, vec![panel])
    }

    /// The cells by what is not on the axis.
    fn groups(&self) -> Vec<(String, Vec<&Cell>)> {
        let mut groups: Vec<(String, Vec<&Cell>)> = Vec::new();
        for cell in self.trials.cells() {
            let others = cell.place.iter().enumerate().filter(|(i, _)| *i != self.axis);
            let name: Vec<&str> = others.map(|(_, value)| value.as_str()).collect();
            let name = name.join(", ");
            match groups.iter_mut().find(|group| group.0 == name) {
                Some(group) => group.1.push(cell),
                None => groups.push((name, vec![cell])),
            }
        }
        groups
    }

    fn add(
        &self,
        panel: &mut Panel,
        label: &str,
        place: usize,
        cells: &[&Cell],
        column: TrialMetric,
    ) {
        let color = state_color(place);
        let (mut medians, mut trials): (Vec<Point>, Vec<Point>) = (Vec::new(), Vec::new());
        for cell in cells {
            let Ok(x) = cell.place[self.axis].parse() else { continue };
            let values = self.metric.values(self.trials, cell, column);
            trials.extend(values.iter().map(|value| (x, *value)));
            if let Some(spread) = self.metric.spread(self.trials, cell, column) {
                medians.push((x, spread.median));
                let name = format!("{label}, quartiles");
                panel.spans.push(Span { name, x, y: (spread.q1, spread.q3), color });
            }
        }
        medians.sort_by(|a, b| a.0.total_cmp(&b.0));
        panel.add(
            &format!("{label}, trials"),
            trials,
            Style::new(color, Shape::Dots(2.6)).faint(0.35),
        );
        panel.add("", medians.clone(), Style::new(color, Shape::Line(1.8)));
        panel.add_named(label, medians, Style::new(color, state_mark(place)));
    }
}

/// The places of bars side by side in a slot of width 1: their left ends and their width.
pub(super) fn side_by_side(count: usize) -> (Vec<f64>, f64) {
    let all = places(count + 1)[count];
    let width = 0.7 / all;
    (places(count).into_iter().map(|i| -0.35 + i * width).collect(), width)
}
