//! A map of values in boxes of several variables.

use crate::{Area, Axis, Figure, Fill, GREY, Kind, Look, Panel, color_bar, extent, graded};

/// The map's height in pixels.
const HEIGHT: f64 = 380.0;

/// Cells along an axis, and of the grid by which the variables are chosen.
const CELLS: usize = 48;
const COARSE: usize = 8;

/// A box with a positive value, none if that is not known.
#[derive(Clone, Debug, PartialEq)]
pub struct ValuedBox {
    /// The ends of each variable.
    pub ends: Vec<[f64; 2]>,
    /// The value in it.
    pub value: Option<f64>,
}

/// The words of a map.
#[derive(Clone, Copy, Debug)]
pub struct MapLabels<'a> {
    /// The title.
    pub title: &'a str,
    /// The decimal logarithm of a value.
    pub value: &'a str,
    /// A box without a value.
    pub unknown: &'a str,
}

/// Draws the largest values over the two variables with which they vary most, whatever the others
/// are, as an SVG document; none if there are no two variables. `variables` are their names with
/// units, of which the first `preferred` are drawn if there are two of them, and `domain` their ends.
#[must_use]
pub fn box_map(
    labels: MapLabels<'_>,
    (variables, preferred): (&[String], usize),
    domain: &[[f64; 2]],
    boxes: &[ValuedBox],
) -> Option<String> {
    let second = if preferred > 1 { 0..preferred } else { 0..variables.len() };
    let pairs = (0..preferred).flat_map(|a| second.clone().map(move |b| (a, b)));
    let spread = |pair: &(usize, usize)| variance(&largest(domain, boxes, *pair, COARSE));
    let pairs = pairs.filter(|(a, b)| a < b);
    let (across, up) = pairs.max_by(|one, other| {
        // The first of two alike.
        spread(one).total_cmp(&spread(other)).then(other.cmp(one))
    })?;
    let cells = largest(domain, boxes, (across, up), CELLS);
    let label = labels.value;
    let axis = |i: usize| Axis::ranged(&variables[i], Kind::Linear, (domain[i][0], domain[i][1]));
    let side = |variable: usize, place: usize| {
        let [low, high] = domain[variable];
        let at = |place: usize| low + (high - low) * count(place) / count(CELLS);
        (at(place), at(place + 1))
    };
    let logs: Vec<Option<f64>> =
        cells.iter().map(|bound| bound.is_finite().then(|| bound.max(1e-16).log10())).collect();
    let ends = extent(logs.iter().copied().flatten());
    let area = |(i, value): (usize, &Option<f64>)| Area {
        name: label.to_owned(),
        x: side(across, i % CELLS),
        y: side(up, i / CELLS),
        fill: match value {
            Some(value) => {
                let share = (value - ends.0) / (ends.1 - ends.0).max(f64::MIN_POSITIVE);
                Fill::solid(graded(share))
            }
            None => Fill::hatched(GREY),
        },
        value: *value,
        text: String::new(),
    };
    let mut panel = Panel::new("", axis(up), HEIGHT);
    panel.areas = logs.iter().enumerate().map(area).collect();
    if logs.contains(&None) {
        panel.key(labels.unknown, Look::Area(Fill::hatched(GREY)));
    }
    let bar = color_bar(label, ends, HEIGHT);
    Figure::grid(labels.title, axis(across), vec![26.0, 1.0], vec![panel, bar]).svg()
}

/// The largest value of the boxes that touch each cell of a grid over two variables, row by row;
/// infinite where one of them has none.
fn largest(
    domain: &[[f64; 2]],
    boxes: &[ValuedBox],
    (across, up): (usize, usize),
    size: usize,
) -> Vec<f64> {
    let mut cells = vec![0.0_f64; size * size];
    for part in boxes {
        let [columns, rows] = [across, up].map(|i| covered(domain[i], part.ends[i], size));
        for row in rows {
            for cell in &mut cells[row * size + columns.start..row * size + columns.end] {
                *cell = cell.max(part.value.unwrap_or(f64::INFINITY));
            }
        }
    }
    cells
}

/// The cells of a range that a part of it covers, at least one.
fn covered([low, high]: [f64; 2], part: [f64; 2], size: usize) -> std::ops::Range<usize> {
    let share = |value: f64| (value - low) / (high - low) * count(size);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a place on the grid"
    )]
    let [first, last] = [share(part[0]).floor() as usize, share(part[1]).ceil() as usize];
    let first = first.min(size - 1);
    first..last.clamp(first + 1, size)
}

/// How much the logarithms of cells vary.
fn variance(cells: &[f64]) -> f64 {
    let logs = || cells.iter().map(|bound| bound.clamp(1e-16, 1e16).log10());
    let mean = logs().sum::<f64>() / count(cells.len());
    logs().map(|log| (log - mean).powi(2)).sum()
}

#[expect(clippy::cast_precision_loss, reason = "a few thousand")]
fn count(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two halves of a square, one with a bound ten times as large.
    #[test]
    fn boxes_cover_their_cells() {
        let domain = [[0.0, 2.0], [-1.0, 1.0], [0.0, 1.0]];
        let part = |x: [f64; 2], value: Option<f64>| ValuedBox {
            ends: vec![x, [-1.0, 1.0], [0.0, 1.0]],
            value,
        };
        let boxes = [part([0.0, 0.5], Some(1e-2)), part([0.5, 2.0], Some(1e-3))];
        let cells = largest(&domain, &boxes, (0, 1), 4);
        assert_eq!(cells, [1e-2, 1e-3, 1e-3, 1e-3].repeat(4));
        // A box that covers a part of a cell counts in it.
        assert_eq!(covered([0.0, 2.0], [0.5, 1.1], 4), 1..3);
        assert_eq!(covered([0.0, 2.0], [1.9, 2.0], 4), 3..4);
        let labels = MapLabels { title: "map", value: "log of v", unknown: "not known" };
        let variables = ["x (m)", "y (m)", "u (V)"].map(str::to_owned);
        let svg = box_map(labels, (&variables, 2), &domain, &boxes).unwrap();
        for label in ["x (m)", "y (m)", "log of v"] {
            assert!(svg.contains(label), "{label}");
        }
        assert!(!svg.contains("u (V)") && !svg.contains("not known"));
        let open = [part([0.0, 0.5], None), part([0.5, 2.0], Some(1e-3))];
        assert!(box_map(labels, (&variables, 2), &domain, &open).unwrap().contains("not known"));
        assert!(box_map(labels, (&variables[..1], 1), &domain[..1], &[]).is_none());
    }
}
