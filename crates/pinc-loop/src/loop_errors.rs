//! Tracking errors of a closed loop, summed up as the plant moves.

use pinc_ode::metrics::Tracking;

/// What is kept of a loop's trace: the sums of its tracking errors, and the tracked quantities at
/// the step marks t = kT.
#[derive(Clone, Debug)]
pub(crate) struct LoopErrors {
    width: usize,
    /// `[marks, width]`, row by row.
    marks: Vec<f64>,
    at_steps: Tracking,
    dense: Tracking,
}

impl LoopErrors {
    /// Nothing yet of `width` tracked quantities.
    pub(crate) fn new(width: usize) -> Self {
        let (at_steps, dense) = (Tracking::new(width), Tracking::new(width));
        Self { width, marks: Vec::new(), at_steps, dense }
    }

    /// Adds the initial point, which is at a mark, but at the end of no step.
    pub(crate) fn push_start(&mut self, reference: &[f64], tracked: &[f64]) {
        self.marks.extend_from_slice(tracked);
        self.dense.push(reference, tracked);
    }

    /// Adds the end of a step.
    pub(crate) fn push_mark(&mut self, reference: &[f64], tracked: &[f64]) {
        self.push_start(reference, tracked);
        self.at_steps.push(reference, tracked);
    }

    /// Adds a point within a step.
    pub(crate) fn push_between(&mut self, reference: &[f64], tracked: &[f64]) {
        self.dense.push(reference, tracked);
    }

    /// The errors at the ends of the steps.
    pub(crate) fn at_steps(&self) -> &Tracking {
        &self.at_steps
    }

    /// The errors on the dense trace.
    pub(crate) fn dense(&self) -> &Tracking {
        &self.dense
    }

    /// The tracked quantities at step mark `mark`.
    pub(crate) fn at_mark(&self, mark: usize) -> &[f64] {
        &self.marks[mark * self.width..(mark + 1) * self.width]
    }
}
