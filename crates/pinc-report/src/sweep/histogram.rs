//! A metric over random draws: a histogram for each cell, the models side by side.

use super::metric::Metric;
use super::sizes;
use crate::picture::Picture;
use crate::trials::{Cell, Trials};
use pinc_chart::{
    Area, Axis, Figure, Fill, Key, Kind, Look, Panel, extent, places, state_color, text,
};
use pinc_record::TrialMetric;

const BINS: usize = 20;

/// A panel for each cell, in two columns; `None` if no trial has a number.
pub(super) fn picture(trials: &Trials, metric: &Metric) -> Option<Picture> {
    let mut all = Vec::new();
    for cell in trials.cells() {
        for (column, _) in &metric.columns {
            all.extend(metric.values(trials, cell, *column));
        }
    }
    if all.is_empty() {
        return None;
    }
    let bins = Bins::around(&all);
    let mut panels = Vec::new();
    let mut medians_of_cells = Vec::new();
    for cell in trials.cells() {
        panels.push(panel(trials, metric, cell, &bins));
        medians_of_cells.extend(medians(trials, metric, cell));
    }
    let highest = panels.iter().flat_map(|p| &p.areas).map(|area| area.y.1).fold(1.0, f64::max);
    for panel in &mut panels {
        panel.y.range = Some((0.0, 1.08 * highest));
    }
    let columns = if panels.len() > 1 { vec![1.0, 1.0] } else { vec![1.0] };
    let x = Axis::ranged(&metric.label, Kind::Linear, bins.range());
    let mut figure = Figure::grid(metric.title, x, columns, panels);
    let models = metric.columns.iter().enumerate().filter(|(_, (_, model))| !model.is_empty());
    let key = |(i, (_, model)): (usize, &(TrialMetric, &str))| Key {
        label: (*model).to_owned(),
        look: Look::Area(Fill::solid(state_color(i))),
    };
    figure.keys = models.map(key).collect();
    let caption = format!(
        "How many trials have a value, {}. All panels have the same bins. Medians: {}. From \
         sweep.csv.",
        sizes(trials.cells()),
        medians_of_cells.join("; ")
    );
    Some(Picture::new(metric.stem, metric.title, figure, caption))
}

fn panel(trials: &Trials, metric: &Metric, cell: &Cell, bins: &Bins) -> Panel {
    let mut panel = Panel::new(&trials.name(cell), Axis::new("trials", Kind::Count), 200.0);
    let share = 1.0 / places(metric.columns.len() + 1)[metric.columns.len()];
    let starts = places(metric.columns.len()).into_iter().map(|i| i * share);
    for ((i, (column, model)), start) in metric.columns.iter().enumerate().zip(starts) {
        let values = metric.values(trials, cell, *column);
        if values.is_empty() {
            continue;
        }
        let fill = Fill::solid(state_color(i));
        let name = if model.is_empty() { "trials" } else { model };
        for (bin, count) in bins.counts(&values).into_iter().enumerate() {
            let (from, to) = bins.ends(bin);
            let x = (from + start * (to - from), from + (start + 0.94 * share) * (to - from));
            panel.areas.push(Area {
                name: name.to_owned(),
                x,
                y: (0.0, count),
                fill,
                value: None,
                text: String::new(),
            });
        }
    }
    panel.note = Some("No trial of this cell has a number.".to_owned());
    panel
}

fn medians(trials: &Trials, metric: &Metric, cell: &Cell) -> Option<String> {
    let mut by_model = Vec::new();
    for (column, model) in &metric.columns {
        if let Some(spread) = metric.spread(trials, cell, *column) {
            let median = text::significant(spread.median, 4);
            by_model.push(format!("{median} {model}").trim_end().to_owned());
        }
    }
    (!by_model.is_empty()).then(|| format!("{}: {}", trials.name(cell), by_model.join(", ")))
}

/// Bins of equal width.
struct Bins {
    low: f64,
    width: f64,
    /// Numbers of the bins' left ends.
    places: Vec<f64>,
}

impl Bins {
    /// Bins around all values: the least and the greatest lie in the middle of the outer ones.
    fn around(values: &[f64]) -> Self {
        let (low, high) = extent(values.iter().copied());
        let size = low.abs().max(high.abs()).max(f64::MIN_POSITIVE);
        let span = (high - low).max(1e-6 * size);
        let places = places(BINS);
        let width = span / places[BINS - 1];
        Self { low: low - 0.5 * width, width, places }
    }

    fn ends(&self, bin: usize) -> (f64, f64) {
        let from = self.low + self.places[bin] * self.width;
        (from, from + self.width)
    }

    fn range(&self) -> (f64, f64) {
        (self.ends(0).0, self.ends(BINS - 1).1)
    }

    fn counts(&self, values: &[f64]) -> Vec<f64> {
        let mut counts = vec![0.0; BINS];
        for value in values {
            let place = (value - self.low) / self.width;
            let bin = self.places.iter().rposition(|left| *left <= place).unwrap_or(0);
            counts[bin] += 1.0;
        }
        counts
    }
}
