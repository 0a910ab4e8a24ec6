//! The gradient of a weighted sum of the results of a step, on its way back through the substeps.

use super::SparsityPattern;
use pinc_ad::simd::Simd;

/// The gradient by the variables (x, u, p) at the start of a step, and what the way back needs.
#[derive(Clone, Debug)]
pub(super) struct Gradient<V> {
    states: usize,
    /// The state at the beginning of each substep.
    starts: Vec<V>,
    /// By the state so far back, and by inputs and parameters on the way there.
    pub(super) numbers: Vec<V>,
}

impl<V: Simd> Gradient<V> {
    pub(super) fn new(pattern: &SparsityPattern, substeps: usize, zero: V) -> Self {
        let states = pattern.rows();
        let (starts, numbers) = (vec![zero; substeps * states], vec![zero; pattern.columns()]);
        Self { states, starts, numbers }
    }

    /// The state at the beginning of a substep.
    #[inline(always)]
    pub(super) fn start(&mut self, substep: usize) -> &mut [V] {
        &mut self.starts[substep * self.states..][..self.states]
    }

    /// Begins at the end of a step, where the gradient by the state has these weights.
    #[inline(always)]
    pub(super) fn begin(&mut self, weights: impl Fn(usize) -> V, zero: V) {
        self.numbers.fill(zero);
        for (i, to) in self.numbers.iter_mut().take(self.states).enumerate() {
            *to = weights(i);
        }
    }
}
