//! A metric over two axes of a sweep: a map of cells with numbers in them.

use super::metric::Metric;
use super::sizes;
use crate::picture::Picture;
use crate::trials::{Cell, Trials, short, shown};
use pinc_chart::{
    Area, Axis, Figure, Fill, GREY, Look, Panel, color_bar, extent, graded, places, text,
};
use pinc_record::TrialMetric;

/// A cell's height in pixels.
const CELL: f64 = 46.0;

/// A map for each column of the metric and each combination of what is not on the two axes.
pub(super) fn pictures(trials: &Trials, metric: &Metric) -> Vec<Picture> {
    let axes = trials.axes();
    let (rows, columns) = (axes[0], axes[1]);
    let mut pictures = Vec::new();
    for (column, model) in &metric.columns {
        for (i, rest) in rests(trials, [rows, columns]).into_iter().enumerate() {
            let map = Map { trials, metric, column: *column, rows, columns, rest: &rest };
            let of_model = match *model {
                "" => String::new(),
                model => format!(" with {model}"),
            };
            let stem = format!("{}{}", metric.stem, model.to_lowercase());
            let stem = if i == 0 { stem } else { format!("{stem}-{}", i + 1) };
            let title = match rest.is_empty() {
                true => format!("{}{of_model}", metric.title),
                false => format!("{}{of_model}: {}", metric.title, rest.join(", ")),
            };
            pictures.push(Picture::new(stem, title, map.figure(), map.caption()));
        }
    }
    pictures
}

/// The different combinations of values of all columns but two.
fn rests(trials: &Trials, axes: [usize; 2]) -> Vec<Vec<String>> {
    let mut rests: Vec<Vec<String>> = Vec::new();
    for cell in trials.cells() {
        let rest = rest_of(cell, axes);
        if !rests.contains(&rest) {
            rests.push(rest);
        }
    }
    rests
}

fn rest_of(cell: &Cell, axes: [usize; 2]) -> Vec<String> {
    let others = cell.place.iter().enumerate().filter(|(i, _)| !axes.contains(i));
    others.map(|(_, value)| value.clone()).collect()
}

struct Map<'a> {
    trials: &'a Trials,
    metric: &'a Metric,
    column: TrialMetric,
    rows: usize,
    columns: usize,
    rest: &'a [String],
}

impl<'a> Map<'a> {
    fn figure(&self) -> Figure {
        let (rows, columns) =
            (self.trials.values_of(self.rows), self.trials.values_of(self.columns));
        let name = |column: usize| short(&self.trials.columns()[column]);
        let axis = |column: usize, values: &[String]| {
            let values: Vec<String> = values.iter().map(|v| shown(v)).collect();
            Axis::named(&name(column), &values)
        };
        let height = CELL * extent(places(rows.len().max(3) + 1).into_iter()).1;
        let mut panel = Panel::new("", axis(self.rows, &rows), height);
        let values = self.values();
        let ends = extent(values.iter().filter_map(|(_, value)| *value));
        for (y, row) in places(rows.len()).into_iter().zip(&rows) {
            for (x, column) in places(columns.len()).into_iter().zip(&columns) {
                let is_here = |cell: &Cell| {
                    cell.place[self.rows] == *row && cell.place[self.columns] == *column
                };
                if let Some((cell, value)) = values.iter().find(|(cell, _)| is_here(cell)) {
                    panel.areas.push(self.area((x, y), cell, *value, ends));
                }
            }
        }
        if panel.areas.iter().any(|area| area.fill.hatched) {
            panel.key("no number: failed, or not yet run", Look::Area(Fill::hatched(GREY)));
        }
        let x = axis(self.columns, &columns);
        let bar = color_bar(&self.label(), ends, height);
        let name = format!("{} over {} and {}", self.label(), name(self.rows), name(self.columns));
        Figure::grid(&name, x, vec![26.0, 1.0], vec![panel, bar])
    }

    /// The cells of this map, each with its median if it has one.
    fn values(&self) -> Vec<(&'a Cell, Option<f64>)> {
        let here = |cell: &&Cell| rest_of(cell, [self.rows, self.columns]) == self.rest;
        let cells = self.trials.cells().iter().filter(here);
        let value = |cell: &'a Cell| {
            let spread = self.metric.spread(self.trials, cell, self.column);
            let median = spread.map(|s| if self.metric.log { s.median.log10() } else { s.median });
            (cell, median.filter(|v| v.is_finite()))
        };
        cells.map(value).collect()
    }

    fn area(&self, (x, y): (f64, f64), cell: &Cell, value: Option<f64>, ends: (f64, f64)) -> Area {
        let (fill, text) = match value {
            Some(value) => {
                let fraction = (value - ends.0) / (ends.1 - ends.0).max(f64::MIN_POSITIVE);
                let quartiles = self.quartiles(cell);
                (Fill::solid(graded(fraction)), format!("{}\n{quartiles}", self.number(value)))
            }
            None if !cell.failed.is_empty() => (Fill::hatched(GREY), "failed".to_owned()),
            None => (Fill::hatched(GREY), "not run".to_owned()),
        };
        // A hair's breadth between cells.
        let (x, y) = ((x - 0.495, x + 0.495), (y - 0.49, y + 0.49));
        Area { name: self.label(), x, y, fill, value, text }
    }

    /// The quartiles of a cell with several trials.
    fn quartiles(&self, cell: &Cell) -> String {
        let spread = self.metric.spread(self.trials, cell, self.column).filter(|_| cell.done() > 1);
        let scaled = |value: f64| if self.metric.log { value.log10() } else { value };
        let ends = spread.map(|spread| [spread.q1, spread.q3].map(|q| self.number(scaled(q))));
        ends.map_or_else(String::new, |[low, high]| format!("{low} to {high}"))
    }

    fn number(&self, value: f64) -> String {
        match self.metric.log {
            true => text::grouped(&format!("{value:.2}")),
            false => text::number(value, 4),
        }
    }

    fn label(&self) -> String {
        match self.metric.log {
            true => format!("log₁₀ of the median {}", self.metric.label),
            false => format!("median {}", self.metric.label),
        }
    }

    fn caption(&self) -> String {
        let values = self.values();
        let cells: Vec<Cell> = values.iter().map(|(cell, _)| (*cell).clone()).collect();
        let mut caption = format!(
            "In each cell the {}, and below it the quartiles, {}.",
            self.label(),
            sizes(&cells)
        );
        let known = values.iter().filter_map(|(cell, value)| Some((cell, (*value)?)));
        if let Some((cell, value)) = known.min_by(|a, b| a.1.total_cmp(&b.1)) {
            let place = |column: usize| {
                format!("{} {}", shown(&cell.place[column]), short(&self.trials.columns()[column]))
            };
            caption += &format!(
                " The lowest is {}, with {} and {}.",
                self.number(value),
                place(self.rows),
                place(self.columns)
            );
        }
        format!("{caption} From sweep.csv.")
    }
}
