//! A map of the net's error of one step over its training domain.

use crate::data::Run;
use crate::picture::Picture;
use pinc_chart::{
    Area, Axis, Figure, Fill, GREY, INK, Kind, Look, Panel, Shape, Style, color_bar, extent,
    graded, text,
};
use pinc_record::{DomainErrorTable, file};

/// The map's height in pixels.
const HEIGHT: f64 = 380.0;

/// Cells along an axis: at most so many, and so few that a cell has some points.
const MOST_CELLS: usize = 24;
const POINTS_OF_A_CELL: usize = 6;

/// Cells along an axis of the grid by which the variables are chosen.
const COARSE: usize = 6;

/// The smallest error that is told from none.
const LEAST: f64 = 1e-16;

/// The map, if the errors of the net are there.
pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let table = run.domain_error.as_ref().filter(|table| !table.errors.is_empty())?;
    let domain = run.experiment.domain.as_ref()?;
    let ends: Vec<(f64, f64)> = domain.ends().collect();
    if ends.len() != table.variables.len() {
        return None;
    }
    let (across, up) = variables(table, &ends, domain.state_low.len());
    let map = Map { run, table, ends: &ends, across, up };
    Some(Picture {
        stem: "domain-error".to_owned(),
        title: "Error of one step over the domain".to_owned(),
        figure: map.figure(),
        caption: map.caption(),
    })
}

/// The two states over which the error varies most; with one state, that and the input over which
/// it does.
fn variables(table: &DomainErrorTable, ends: &[(f64, f64)], states: usize) -> (usize, usize) {
    let second = if states > 1 { 0..states } else { 0..ends.len() };
    let pairs = (0..states).flat_map(|a| second.clone().map(move |b| (a, b)));
    let spread = |&(a, b): &(usize, usize)| between(&cells(table, ends, (a, b), COARSE));
    let best = pairs.filter(|(a, b)| a < b).max_by(|one, other| {
        // The first of two alike.
        spread(one).total_cmp(&spread(other)).then(other.cmp(one))
    });
    best.unwrap_or((0, 0))
}

/// By how much cells differ: the variance of the means of the error's logarithm.
fn between(cells: &[Vec<f64>]) -> f64 {
    let logs = |cell: &Vec<f64>| cell.iter().map(|error| log(*error)).sum::<f64>();
    let all: f64 = cells.iter().map(logs).sum::<f64>() / count(cells.iter().map(Vec::len).sum());
    let filled = cells.iter().filter(|cell| !cell.is_empty());
    filled.map(|cell| count(cell.len()) * (logs(cell) / count(cell.len()) - all).powi(2)).sum()
}

/// Log10, within the numbers that can be drawn.
fn log(error: f64) -> f64 {
    error.clamp(LEAST, 1e16).log10()
}

#[expect(clippy::cast_precision_loss, reason = "a few thousand points")]
fn count(n: usize) -> f64 {
    n as f64
}

/// The errors in the cells of a grid over two variables, row by row.
fn cells(
    table: &DomainErrorTable,
    ends: &[(f64, f64)],
    (across, up): (usize, usize),
    size: usize,
) -> Vec<Vec<f64>> {
    let mut cells = vec![Vec::new(); size * size];
    for (point, error) in table.points.iter().zip(&table.errors) {
        let place = |i: usize| {
            let (low, high) = ends[i];
            let share = (point[i] - low) / (high - low) * count(size);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a place on the grid; what is outside is put at its edge"
            )]
            let place = share as usize;
            place.min(size - 1)
        };
        cells[place(up) * size + place(across)].push(*error);
    }
    cells
}

struct Map<'a> {
    run: &'a Run,
    table: &'a DomainErrorTable,
    ends: &'a [(f64, f64)],
    across: usize,
    up: usize,
}

impl Map<'_> {
    fn label(&self, variable: usize) -> String {
        self.run.axis_label(std::slice::from_ref(&self.table.variables[variable]))
    }

    fn figure(&self) -> Figure {
        let label = "log₁₀ of the largest error (widths)";
        let axis = |i: usize| Axis::ranged(&self.label(i), Kind::Linear, self.ends[i]);
        let mut panel = Panel::new("", axis(self.up), HEIGHT);
        let areas = self.areas(label);
        let ends = extent(areas.iter().filter_map(|area| area.value));
        panel.areas = areas;
        for area in &mut panel.areas {
            if let Some(value) = area.value {
                let share = (value - ends.0) / (ends.1 - ends.0).max(f64::MIN_POSITIVE);
                area.fill = Fill::solid(graded(share));
            }
        }
        if panel.areas.iter().any(|area| area.fill.hatched) {
            panel.key("no finite number", Look::Area(Fill::hatched(GREY)));
        }
        if let Some(at) = self.worst() {
            let ring = Style::new(INK, Shape::Rings(7.0));
            panel.add_named("the largest error found", vec![at], ring);
        }
        let bar = color_bar(label, ends, HEIGHT);
        Figure::grid("Error of one step", axis(self.across), vec![26.0, 1.0], vec![panel, bar])
    }

    /// The cells that hold points, with the logarithm of the largest error in each.
    fn areas(&self, name: &str) -> Vec<Area> {
        let points = self.table.errors.len();
        let fits = |size: &usize| size * size * POINTS_OF_A_CELL <= points;
        let size = (1..=MOST_CELLS).rev().find(fits).unwrap_or(1);
        let cells = cells(self.table, self.ends, (self.across, self.up), size);
        let side = |variable: usize, place: usize| {
            let (low, high) = self.ends[variable];
            let at = |place: usize| low + (high - low) * count(place) / count(size);
            (at(place), at(place + 1))
        };
        let filled = cells.iter().enumerate().filter(|(_, cell)| !cell.is_empty());
        let area = |(i, cell): (usize, &Vec<f64>)| {
            let largest = cell.iter().copied().fold(0.0, f64::max);
            let value = largest.is_finite().then(|| log(largest));
            Area {
                name: name.to_owned(),
                x: side(self.across, i % size),
                y: side(self.up, i / size),
                fill: Fill::hatched(GREY),
                value,
                text: String::new(),
            }
        };
        filled.map(area).collect()
    }

    /// Where the largest error is.
    fn worst(&self) -> Option<(f64, f64)> {
        let of = self.run.metrics.as_ref()?.validation.as_ref()?.domain_error.as_ref()?;
        let place = [&of.max_at.x[..], &of.max_at.u].concat();
        Some((*place.get(self.across)?, *place.get(self.up)?))
    }

    fn caption(&self) -> String {
        let [across, up] = [self.across, self.up].map(|i| &self.table.variables[i]);
        format!(
            "The largest error of the net after one step T among {} points all over the training \
             domain, by {across} and {up}, whatever the other variables are. The error of a state is \
             measured in widths of its range in the domain. Light is a large error. From {}.",
            text::count(self.table.errors.len()),
            file::DOMAIN_ERROR
        )
    }
}
