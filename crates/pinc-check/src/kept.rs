//! References that the closed loop keeps while the plant moves on, as a batch does: there a steady
//! state says little.

use crate::Subject;
use pinc_analysis::{HeldPoint, OperatingPoint};
use std::ops::Range;

/// How near a reference the loop stays, of the way that the quantity goes in the loop, and of the
/// width of the region.
const NEAR: f64 = 0.01;
const NEAR_OF_WIDTH: f64 = 1e-3;

/// The part of a reference's time that is looked at: late enough to have come to it, and before the
/// next one is prepared.
const LATE: Range<f64> = 0.6..0.8;

/// A steady state this far from where the loop is, in widths, is another place.
const ELSEWHERE: f64 = 0.05;

/// Where the closed loop keeps a reference.
pub(crate) struct Kept {
    /// When, in s.
    pub(crate) during_s: Range<f64>,
    /// The state and the input at the end of that time.
    pub(crate) point: OperatingPoint,
    /// The state at its beginning.
    pub(crate) from: Vec<f64>,
}

impl Kept {
    /// What the point is called.
    pub(crate) fn name(&self, subject: &Subject<'_>) -> String {
        format!("the closed loop at t = {}", subject.time(self.during_s.end))
    }
}

/// Where the rehearsed loop keeps a reference, if it does so away from `steady` and moves on while
/// it does.
pub(crate) fn of(subject: &Subject<'_>, reference: usize, steady: &HeldPoint) -> Option<Kept> {
    let rehearsal = subject.evidence.rehearsal.as_ref()?.as_ref().ok()?;
    let (trace, control) = (&rehearsal.trace, subject.experiment.control.as_ref()?);
    let of = control.references.get(reference)?;
    let end_s = trace.times().last().copied()?;
    let next_s = control.references.get(reference + 1).map_or(end_s, |next| next.start_s);
    let length_s = next_s.min(end_s) - of.start_s;
    let during_s = of.start_s + LATE.start * length_s..of.start_s + LATE.end * length_s;
    let samples = (0..trace.len()).filter(|&i| during_s.contains(&trace.times()[i]));
    let samples: Vec<usize> = samples.collect();
    let (&first, &last) = (samples.first()?, samples.last()?);
    for (&i, wanted) in subject.controlled().iter().zip(&of.value) {
        let values = (0..trace.len()).map(|k| trace.state(k)[i]);
        let (low, high) =
            values.fold((*wanted, *wanted), |(low, high), v| (low.min(v), high.max(v)));
        let near = (NEAR * (high - low)).max(NEAR_OF_WIDTH * subject.region.width(i));
        if samples.iter().any(|&k| (trace.state(k)[i] - wanted).abs() > near) {
            return None;
        }
    }
    let point = rehearsal.point(last);
    let from = trace.state(first).to_vec();
    let moves = (0..from.len())
        .any(|i| (point.x[i] - from[i]).abs() > NEAR_OF_WIDTH * subject.region.width(i));
    let near = |at: &OperatingPoint| subject.region.distance(at, &point) <= ELSEWHERE;
    let is_elsewhere = !steady.steady().is_some_and(near);
    let during_s = trace.times()[first]..trace.times()[last];
    (moves && is_elsewhere).then_some(Kept { during_s, point, from })
}
