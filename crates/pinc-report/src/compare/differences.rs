//! By how much the closed loops of several runs differ from the first.

use super::pictures::{Loop, style, time_axis};
use crate::data::Run;
use crate::picture::Picture;
use crate::variables::EQUAL;
use pinc_chart::{Axis, Figure, Kind, Panel, difference};

/// A panel for each controlled variable, or for each state if none is controlled; `None` with fewer
/// than two loops.
pub(super) fn picture(run: &Run, loops: &[Loop<'_>]) -> Option<Picture> {
    let [first, others @ ..] = loops else { return None };
    if others.is_empty() {
        return None;
    }
    let columns = &first.trace.columns;
    let names = if columns.controlled.is_empty() { &columns.states } else { &columns.controlled };
    let panels = names.iter().map(|name| panel(run, first, others, name)).collect();
    let axis = time_axis(run, loops);
    let title = "Differences of the closed loops";
    let caption = format!(
        "Each loop less the loop of {}, at the times of both; between its rows the first loop is \
         interpolated linearly.",
        first.name
    );
    Some(Picture::new("differences", title, Figure::stack(title, axis, panels), caption))
}

fn panel(run: &Run, first: &Loop<'_>, others: &[Loop<'_>], name: &str) -> Panel {
    let label = run.label_in_unit_of(&format!("Δ{name}"), &[name]);
    let title = format!("Difference of {name}");
    let mut panel = Panel::new(&title, Axis::new(&label, Kind::Linear), 150.0);
    let baseline = first.quantity(name);
    for (i, other) in others.iter().enumerate() {
        let points = difference(&other.quantity(name), &baseline, EQUAL);
        if points.iter().any(|point| point.1 != 0.0) {
            panel.add_named(&other.name, points, style(i + 1));
        }
    }
    panel.note = Some(format!("{name} is the same in all loops, up to rounding."));
    panel
}
