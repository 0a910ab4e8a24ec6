//! A map of values in boxes of several variables.

use crate::{
    Area, Axis, Figure, Fill, GREY, INK, Kind, Look, Panel, Shape, Style, color_bar, extent, graded,
};

/// The map's height in pixels.
const HEIGHT: f64 = 380.0;

/// Cells along an axis of the grid by which the variables are chosen.
const COARSE: usize = 8;

/// A box with a positive value, none if that is not known. A point is a box without extent.
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

/// The largest values over the two variables with which they vary most, whatever the others are.
#[derive(Clone, Copy, Debug)]
pub struct BoxMap<'a> {
    /// Its words.
    pub labels: MapLabels<'a>,
    /// The names of the variables with units.
    pub variables: &'a [String],
    /// The first so many variables are drawn if there are two of them.
    pub preferred: usize,
    /// The ends of the variables.
    pub domain: &'a [[f64; 2]],
    /// What is drawn.
    pub boxes: &'a [ValuedBox],
    /// Cells along an axis.
    pub cells: usize,
    /// A point to be marked, and what it is.
    pub mark: Option<(&'a str, &'a [f64])>,
}

impl BoxMap<'_> {
    /// Draws the map; gives also the places of the variables across and up. `None` if there are no
    /// two variables.
    #[must_use]
    pub fn figure(&self) -> Option<(Figure, [usize; 2])> {
        let Self { labels, variables, preferred, domain, mark, .. } = *self;
        let second = if preferred > 1 { 0..preferred } else { 0..variables.len() };
        let pairs = (0..preferred).flat_map(|a| second.clone().map(move |b| (a, b)));
        let spread = |pair: &(usize, usize)| self.between(*pair);
        let pairs = pairs.filter(|(a, b)| a < b);
        let (across, up) = pairs.max_by(|one, other| {
            // The first of two alike.
            spread(one).total_cmp(&spread(other)).then(other.cmp(one))
        })?;
        let axis =
            |i: usize| Axis::ranged(&variables[i], Kind::Linear, (domain[i][0], domain[i][1]));
        let (areas, ends) = self.areas((across, up));
        let mut panel = Panel::new("", axis(up), HEIGHT);
        if areas.iter().any(|area| area.fill.hatched) {
            panel.key(labels.unknown, Look::Area(Fill::hatched(GREY)));
        }
        panel.areas = areas;
        if let Some((name, at)) = mark {
            let ring = Style::new(INK, Shape::Rings(7.0));
            panel.add_named(name, vec![(at[across], at[up])], ring);
        }
        let bar = color_bar(labels.value, ends, HEIGHT);
        let widths = vec![26.0, 1.0];
        Some((Figure::grid(labels.title, axis(across), widths, vec![panel, bar]), [across, up]))
    }

    /// The cells that have a box, with the logarithms of their values and the range of these.
    fn areas(&self, (across, up): (usize, usize)) -> (Vec<Area>, (f64, f64)) {
        let cells = self.largest((across, up), self.cells);
        let side = |variable: usize, place: usize| {
            let [low, high] = self.domain[variable];
            let at = |place: usize| low + (high - low) * place as f64 / self.cells as f64;
            (at(place), at(place + 1))
        };
        let log = |value: f64| value.is_finite().then(|| value.max(LEAST).log10());
        let filled = || cells.iter().enumerate().filter(|(_, value)| **value > f64::NEG_INFINITY);
        let ends = extent(filled().filter_map(|(_, value)| log(*value)));
        let fill = |value: f64| {
            Fill::solid(graded((value - ends.0) / (ends.1 - ends.0).max(f64::MIN_POSITIVE)))
        };
        let area = |(i, value): (usize, &f64)| Area {
            name: self.labels.value.to_owned(),
            x: side(across, i % self.cells),
            y: side(up, i / self.cells),
            fill: log(*value).map_or(Fill::hatched(GREY), fill),
            value: log(*value),
            text: String::new(),
        };
        (filled().map(area).collect(), ends)
    }

    /// By how much the cells of a coarse grid differ: the variance of the means of the logarithms of
    /// the boxes that touch them.
    fn between(&self, (across, up): (usize, usize)) -> f64 {
        let mut cells = vec![(0.0, 0.0); COARSE * COARSE];
        for part in self.boxes {
            let log = part.value.unwrap_or(f64::INFINITY).clamp(LEAST, 1.0 / LEAST).log10();
            let [columns, rows] =
                [across, up].map(|i| covered(self.domain[i], part.ends[i], COARSE));
            for row in rows {
                for (sum, number) in
                    &mut cells[row * COARSE + columns.start..row * COARSE + columns.end]
                {
                    *sum += log;
                    *number += 1.0;
                }
            }
        }
        let filled = || cells.iter().filter(|(_, number)| *number > 0.0);
        let (sum, number) = filled().fold((0.0, 0.0), |all, cell| (all.0 + cell.0, all.1 + cell.1));
        let mean = sum / number;
        let squares = filled().map(|(sum, number)| number * (sum / number - mean).powi(2));
        // A box touches more cells over the variables that it is long in.
        squares.sum::<f64>() / f64::max(number, 1.0)
    }

    /// The largest value of the boxes that touch each cell of a grid over two variables, row by row;
    /// infinite where one of them has none, negative infinite where there is no box.
    fn largest(&self, (across, up): (usize, usize), size: usize) -> Vec<f64> {
        let mut cells = vec![f64::NEG_INFINITY; size * size];
        for part in self.boxes {
            let [columns, rows] = [across, up].map(|i| covered(self.domain[i], part.ends[i], size));
            for row in rows {
                for cell in &mut cells[row * size + columns.start..row * size + columns.end] {
                    *cell = cell.max(part.value.unwrap_or(f64::INFINITY));
                }
            }
        }
        cells
    }
}

/// The smallest value that differs visibly from none.
const LEAST: f64 = 1e-16;

/// The cells of a range that a part of it covers, at least one.
fn covered([low, high]: [f64; 2], part: [f64; 2], size: usize) -> std::ops::Range<usize> {
    let share = |value: f64| (value - low) / (high - low) * size as f64;
    #[expect(clippy::cast_possible_truncation, reason = "a place on the grid")]
    let [first, last] = [share(part[0]).floor() as usize, share(part[1]).ceil() as usize];
    let first = first.min(size - 1);
    first..last.clamp(first + 1, size)
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
        let variables = ["x (m)", "y (m)", "u (V)"].map(str::to_owned);
        let map = BoxMap {
            labels: MapLabels { title: "map", value: "log of v", unknown: "not known" },
            variables: &variables,
            preferred: 2,
            domain: &domain,
            boxes: &boxes,
            cells: 4,
            mark: None,
        };
        assert_eq!(map.largest((0, 1), 4), [1e-2, 1e-3, 1e-3, 1e-3].repeat(4));
        // A box that covers a part of a cell counts in it.
        assert_eq!(covered([0.0, 2.0], [0.5, 1.1], 4), 1..3);
        assert_eq!(covered([0.0, 2.0], [1.9, 2.0], 4), 3..4);
        let svg = |map: BoxMap<'_>| map.figure().unwrap().0.svg().unwrap();
        let drawn = svg(map);
        for label in ["x (m)", "y (m)", "log of v"] {
            assert!(drawn.contains(label), "{label}");
        }
        assert!(!drawn.contains("u (V)") && !drawn.contains("not known"));
        let open = [part([0.0, 0.5], None), part([0.5, 2.0], Some(1e-3))];
        let marked = BoxMap { boxes: &open, mark: Some(("worst", &[0.1, 0.2, 0.3])), ..map };
        assert!(svg(marked).contains("not known") && svg(marked).contains("worst"));
        let rings = marked.figure().unwrap().0.panels.swap_remove(0).series;
        let rings: Vec<_> = rings.iter().map(|of| (&*of.name, &of.points[..])).collect();
        assert_eq!(rings, [("worst", &[(0.1, 0.2)][..])], "x across, y up");
        // Cells without a point are left out.
        let points = [ValuedBox { ends: vec![[0.1, 0.1]; 3], value: Some(1.0) }];
        let (figure, places) = BoxMap { boxes: &points, ..map }.figure().unwrap();
        assert_eq!((figure.panels[0].areas.len(), places), (1, [0, 1]));
        let alone = BoxMap { variables: &variables[..1], preferred: 1, ..map };
        assert!(alone.figure().is_none());
    }

    /// Where boxes lie over one another in the map, the largest value is shown, whatever their order;
    /// the first cell is the lowest on the left.
    #[test]
    fn a_cell_shows_the_largest_value_at_its_place() {
        let domain = [[0.0, 4.0], [10.0, 30.0], [0.0, 1.0]];
        let part = |x: [f64; 2], y: [f64; 2], u: [f64; 2], value: f64| ValuedBox {
            ends: vec![x, y, u],
            value: Some(value),
        };
        let mut boxes = vec![
            part([0.0, 2.0], [10.0, 20.0], [0.0, 0.5], 1e-3),
            part([0.0, 2.0], [10.0, 20.0], [0.5, 1.0], 1e-1),
            part([2.0, 4.0], [20.0, 30.0], [0.0, 1.0], 1e-2),
        ];
        let variables = ["x", "y", "u"].map(str::to_owned);
        for _ in 0..2 {
            let map = BoxMap {
                labels: MapLabels { title: "map", value: "log", unknown: "not known" },
                variables: &variables,
                preferred: 2,
                domain: &domain,
                boxes: &boxes,
                cells: 2,
                mark: None,
            };
            let (figure, places) = map.figure().unwrap();
            assert_eq!(places, [0, 1]);
            let areas = &figure.panels[0].areas;
            let found: Vec<_> = areas.iter().map(|area| (area.x, area.y, area.value)).collect();
            let expected =
                [((0.0, 2.0), (10.0, 20.0), Some(-1.0)), ((2.0, 4.0), (20.0, 30.0), Some(-2.0))];
            assert_eq!(found, expected);
            boxes.reverse();
        }
    }

    /// The map is over the two variables along which the values differ most, though boxes that are
    /// long in another one touch more cells over that.
    #[test]
    fn a_map_is_over_the_variables_that_matter() {
        let domain = [[0.0, 1.0]; 3];
        let halves = [[0.0, 0.5], [0.5, 1.0]];
        let mut boxes = Vec::new();
        for (i, y) in halves.into_iter().enumerate() {
            for (j, z) in halves.into_iter().enumerate() {
                let value = Some(10.0_f64.powi(-i32::try_from(3 * i + j).unwrap()));
                boxes.push(ValuedBox { ends: vec![[0.0, 1.0], y, z], value });
            }
        }
        let variables = ["x", "y", "z"].map(str::to_owned);
        let map = BoxMap {
            labels: MapLabels { title: "map", value: "log", unknown: "not known" },
            variables: &variables,
            preferred: 3,
            domain: &domain,
            boxes: &boxes,
            cells: 4,
            mark: None,
        };
        let (_, places) = map.figure().unwrap();
        assert_eq!(places, [1, 2]);
    }
}
