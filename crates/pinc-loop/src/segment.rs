//! Whether a loop reached its references.

use crate::ClosedLoop;
use std::ops::Range;

/// How many step marks an offset is averaged over; a segment with fewer has none.
const MARKS: usize = 10;

/// The loop under one value of the reference, seen at the step marks t = kT from its beginning to
/// where the controller begins to prepare the next value: with preview N2 steps before it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Segment {
    /// The steps in which the value holds, or moves on in each.
    pub steps: Range<usize>,
    /// The mean |yref - y| of each tracked quantity over the last ten of these marks, but no more
    /// than the second half of them, which a change at the beginning does not reach; NaN of fewer
    /// than ten, and where the value moves on, which nothing comes to rest at.
    pub offset: Vec<f64>,
    /// After how many steps all errors stayed within the tolerances; `None` if they did not.
    pub settled: Option<usize>,
}

impl ClosedLoop<'_> {
    /// The largest error of each tracked quantity at the step marks, the initial one among them; 0
    /// before the first step.
    #[must_use]
    pub fn largest_errors(&self) -> Vec<f64> {
        let marks = self.marks();
        let mut largest = vec![0.0_f64; self.reference().outputs()];
        for k in 0..self.steps_done() {
            for mark in [k, k + 1] {
                for (most, error) in largest.iter_mut().zip(marks.errors(k, mark)) {
                    *most = most.max(error);
                }
            }
        }
        largest
    }

    /// Returns the segment of each value of the reference, as far as the run went. `tolerance` says
    /// for each tracked quantity how near the reference it has to stay to be settled. If none is
    /// finite there are no segments: nothing has a reference.
    ///
    /// # Panics
    ///
    /// If there is not one tolerance per tracked quantity.
    #[must_use]
    pub fn segments(&self, tolerance: &[f64]) -> Vec<Segment> {
        assert_eq!(tolerance.len(), self.reference().outputs(), "one tolerance per quantity");
        let all = self.reference().stretches().into_iter();
        let is_judged = tolerance.iter().any(|most| most.is_finite());
        let begun = all.filter(|steps| is_judged && steps.start < self.steps_done());
        let marks = self.marks();
        begun.map(|steps| self.segment(&marks, steps, tolerance)).collect()
    }

    fn segment(&self, seen: &Marks<'_, '_>, steps: Range<usize>, tolerance: &[f64]) -> Segment {
        let has_next = steps.end < self.reference().steps();
        let prepared = if has_next { self.preview_steps() } else { 0 };
        let last = steps.end.saturating_sub(prepared).min(self.steps_done());
        // At a mark the value of the step that ends there is compared; at the first, of the first.
        let errors = |mark: usize| seen.errors(steps.start.max(mark.saturating_sub(1)), mark);

        let length = last.saturating_sub(steps.start);
        let count = MARKS.min(length / 2);
        let none = length < MARKS || !self.reference().is_held(steps.clone());
        let mut offset = vec![if none { f64::NAN } else { 0.0 }; tolerance.len()];
        for mark in last + 1 - count..last + 1 {
            for (sum, error) in offset.iter_mut().zip(errors(mark)) {
                *sum += error;
            }
        }
        offset.iter_mut().for_each(|sum| *sum /= count as f64);

        let near = |mark: usize| errors(mark).zip(tolerance).all(|(e, most)| e <= *most);
        let outside = (steps.start..=last).rev().find(|&mark| !near(mark));
        let settled = outside.map_or(steps.start, |mark| mark + 1);
        let settled = (settled <= last).then(|| settled - steps.start);
        Segment { steps, offset, settled }
    }
}

impl<'a> ClosedLoop<'a> {
    fn marks(&self) -> Marks<'_, 'a> {
        Marks { run: self, end: self.tracked_at_end() }
    }
}

/// The step marks of a loop.
struct Marks<'m, 'a> {
    run: &'m ClosedLoop<'a>,
    /// What is tracked at the last one.
    end: Option<Vec<f64>>,
}

impl Marks<'_, '_> {
    /// |yref - y| at a step mark, with the reference of step `k`.
    fn errors(&self, k: usize, mark: usize) -> impl Iterator<Item = f64> {
        let y = match &self.end {
            Some(end) if mark == self.run.steps_done() => end,
            _ => self.run.errors().at_mark(mark),
        };
        self.run.reference().at(k).iter().zip(y).map(|(r, y)| (r - y).abs())
    }
}
