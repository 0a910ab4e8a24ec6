//! The states of arrays over their indices, at some times of the closed loop or of the free run.

use crate::data::Run;
use crate::picture::Picture;
use crate::variables::{MOST_SHOWN, Variables};
use pinc_chart::{Axis, Figure, Kind, Panel, Point, Shape, Style, extent, graded, places, text};
use pinc_ode::Variable;
use std::ops::Range;

/// How many times are shown.
const TIMES: usize = 7;

/// The profiles, if there are arrays whose elements are too many to have a curve each.
pub(crate) fn picture(run: &Run, variables: &Variables) -> Option<Picture> {
    let groups = Variable::groups(&variables.states).into_iter();
    let arrays: Vec<Range<usize>> = groups.filter(|group| group.len() > MOST_SHOWN).collect();
    let (what, file, rows) = rows(run)?;
    if arrays.is_empty() || rows.is_empty() {
        return None;
    }
    let panels = arrays.into_iter().map(|array| panel(run, &variables.states, &array, &rows));
    let axis = Axis::new("index", Kind::Linear);
    let title = format!("Profiles of the {what}");
    let figure = Figure::stack(&title, axis, panels.collect());
    let caption = format!(
        "The elements of each array over their indices, at {} times from the first to the last. \
         From {file}.",
        TIMES.min(rows.len())
    );
    Some(Picture::new("profiles", title, figure, caption))
}

/// Times and states.
type Rows<'a> = Vec<(f64, &'a [f64])>;

/// What there is of a trajectory, and its file.
fn rows(run: &Run) -> Option<(&'static str, String, Rows<'_>)> {
    if let Some(of) = run.control.loops.first() {
        let rows = of.table.rows.iter().map(|row| (row.t, &row.state[..])).collect();
        return Some(("closed loop", of.file.clone(), rows));
    }
    let table = run.prediction.as_ref()?;
    let rows = table.rows.iter().map(|row| (row.t, &row.truth[..])).collect();
    Some(("truth of the free run", pinc_record::file::PREDICTION.to_owned(), rows))
}

fn panel(run: &Run, states: &[String], array: &Range<usize>, rows: &Rows<'_>) -> Panel {
    let names = &states[array.clone()];
    let title = Variable::grouped_names(names).join(", ");
    let label = run.label_in_unit_of(&title, names);
    let mut panel = Panel::new(&title, Axis::new(&label, Kind::Linear), 260.0);
    let indices: Vec<f64> = indices(names);
    let (from, to) = extent(rows.iter().map(|(t, _)| *t));
    for share in places(TIMES).iter().map(|k| k / places(TIMES)[TIMES - 1]) {
        let at = rows.partition_point(|(t, _)| *t < from + share * (to - from));
        let Some((t, state)) = rows.get(at.min(rows.len() - 1)) else { continue };
        let values = indices.iter().zip(&state[array.clone()]);
        let points: Vec<Point> = values.map(|(index, value)| (*index, *value)).collect();
        let time = format!("{} {}", text::number(*t, 4), run.time_unit().name());
        panel.add_named(&time, points, Style::new(graded(share), Shape::Line(1.8)));
    }
    panel
}

/// The indices of the elements.
fn indices(names: &[String]) -> Vec<f64> {
    let index = |name: &String| Variable::split_name(name).map_or(0, |(_, index)| index);
    names.iter().map(|name| index(name) as f64).collect()
}
