//! By how much the closed loops of several runs differ from the first.

use super::pictures::{Loop, style, time_axis};
use crate::data::Run;
use crate::picture::Picture;
use crate::variables::EQUAL;
use pinc_chart::{Axis, Figure, Kind, Panel, Point};

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
    Some(Picture {
        stem: "differences".to_owned(),
        title: "Differences of the closed loops".to_owned(),
        figure: Figure::stack("Differences of the closed loops", axis, panels),
        caption: format!(
            "Each loop less that of {}, at the times of both; between its rows the first loop is \
             interpolated linearly.",
            first.name
        ),
    })
}

fn panel(run: &Run, first: &Loop<'_>, others: &[Loop<'_>], name: &str) -> Panel {
    let label = run.label_in_unit_of(&format!("Δ{name}"), &[name.to_owned()]);
    let title = format!("Difference of {name}");
    let mut panel = Panel::new(&title, Axis::new(&label, Kind::Linear), 150.0);
    let baseline = first.quantity(name);
    for (i, other) in others.iter().enumerate() {
        let points = differences(&baseline, &other.quantity(name));
        if points.iter().any(|point| point.1 != 0.0) {
            panel.add_named(&other.name, points, style(i + 1));
        }
    }
    panel.note = Some(format!("{name} is the same in all loops, up to rounding."));
    panel
}

/// A curve less another, at the times of the curve that the other reaches. What rounding alone makes
/// is 0.
fn differences(baseline: &[Point], curve: &[Point]) -> Vec<Point> {
    let at = |&(t, value): &Point| {
        let expected = interpolated(baseline, t)?;
        let equal = (value - expected).abs() <= EQUAL * value.abs().max(expected.abs());
        Some((t, if equal { 0.0 } else { value - expected }))
    };
    curve.iter().filter_map(at).collect()
}

/// The value of a curve at a time, with times that differ by rounding as one; `None` outside of it.
fn interpolated(curve: &[Point], t: f64) -> Option<f64> {
    let slack = 1e-9 * t.abs();
    let after = curve.partition_point(|point| point.0 < t - slack);
    let (t1, value1) = *curve.get(after)?;
    if t1 <= t + slack {
        return Some(value1);
    }
    let (t0, value0) = *curve.get(after.checked_sub(1)?)?;
    Some(value0 + (t - t0) / (t1 - t0) * (value1 - value0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_subtracted_at_their_own_times() {
        let baseline = [(0.0, 1.0), (2.0, 3.0), (4.0, -1.0)];
        let curve =
            [(-1.0, 9.0), (0.0, 1.0), (0.5, 2.5), (2.0 + 1e-12, 2.0), (3.0, 1.5), (5.0, 0.0)];
        // The baseline is 1.5 at 0.5 and 1 at 3.
        let expected = [(0.0, 0.0), (0.5, 1.0), (2.0, -1.0), (3.0, 0.5)];
        let found = differences(&baseline, &curve);
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            let apart = (found.0 - expected.0).abs().max((found.1 - expected.1).abs());
            assert!(apart < 1e-9, "{found:?} instead of {expected:?}");
        }
        assert!(differences(&[], &curve).is_empty());
        let rounded = differences(&[(0.0, 1e5)], &[(0.0, 1e5 + 1e-10)]);
        assert_eq!(rounded, [(0.0, 0.0)]);
    }
}
