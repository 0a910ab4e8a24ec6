//! A map of the net's error of one step over its training domain.

use crate::data::Run;
use crate::picture::Picture;
use pinc_chart::{BoxMap, MapLabels, ValuedBox, text};
use pinc_record::{DomainErrorTable, file};

/// Cells along an axis: at most so many, and so few that a cell has some points.
const MOST_CELLS: usize = 24;
const POINTS_OF_A_CELL: usize = 6;

pub(crate) fn picture(run: &Run) -> Option<Picture> {
    let table = run.domain_error.as_ref().filter(|table| !table.errors.is_empty())?;
    let domain = run.experiment.domain.as_ref()?;
    let ends: Vec<[f64; 2]> = domain.ends().map(|(low, high)| [low, high]).collect();
    if ends.len() != table.variables.len() {
        return None;
    }
    let label = |variable: &String| run.axis_label(&[variable]);
    let variables: Vec<String> = table.variables.iter().map(label).collect();
    let boxes: Vec<ValuedBox> = boxes(table).collect();
    let fits = |size: &usize| size * size * POINTS_OF_A_CELL <= boxes.len();
    let worst = worst(run).filter(|place| place.len() == ends.len());
    let map = BoxMap {
        labels: MapLabels {
            title: "Error of one step",
            value: "log₁₀ of the largest error (widths)",
            unknown: "no finite number",
        },
        variables: &variables,
        preferred: domain.state_low.len(),
        domain: &ends,
        boxes: &boxes,
        cells: (1..=MOST_CELLS).rev().find(fits).unwrap_or(1),
        mark: worst.as_deref().map(|place| ("the largest error found", place)),
    };
    let (figure, places) = map.figure()?;
    let caption = caption(table, places);
    Some(Picture::new("domain-error", "Error of one step over the domain", figure, caption))
}

fn boxes(table: &DomainErrorTable) -> impl Iterator<Item = ValuedBox> {
    table.points.iter().zip(&table.errors).map(|(point, error)| ValuedBox {
        ends: point.iter().map(|value| [*value, *value]).collect(),
        value: error.is_finite().then_some(*error),
    })
}

fn worst(run: &Run) -> Option<Vec<f64>> {
    let at = &run.metrics.as_ref()?.validation.as_ref()?.domain_error.as_ref()?.max_at;
    let parameters = &run.experiment.domain.as_ref()?.parameters;
    let p = parameters.iter().filter_map(|range| at.p.get(&range.name).copied());
    Some(at.x.iter().chain(&at.u).copied().chain(p).collect())
}

fn caption(table: &DomainErrorTable, places: [usize; 2]) -> String {
    let [across, up] = places.map(|i| &table.variables[i]);
    format!(
        "The largest error of the net after one step T among {} points all over the training \
         domain, by {across} and {up}, whatever the other variables are. The error of a state is \
         measured in widths of its range in the domain. From {}.",
        text::count(table.errors.len()),
        file::DOMAIN_ERROR
    )
}
