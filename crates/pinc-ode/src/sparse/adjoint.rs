//! The gradient of a weighted sum of the results of a Runge-Kutta method, stage by stage backwards:
//! with the gradients g of what the slope k of a stage goes into, k = f(y), the gradient by y is J(y)'
//! times theirs by k.

use super::SparsityPattern;
use super::gradient::Gradient;
use super::tableau::{Stage, places};
use pinc_ad::simd::Simd;

/// The gradient by the variables (x, u, p) at the start of a step.
#[derive(Clone, Debug)]
pub(super) struct Adjoint<V> {
    states: usize,
    pub(super) gradient: Gradient<V>,
    /// By what is in the places of the stages: see [`Stage`].
    places: Vec<V>,
    /// By the slope of a stage.
    slope: Vec<V>,
}

impl<V: Simd> Adjoint<V> {
    pub(super) fn new(
        pattern: &SparsityPattern,
        stages: &[Stage],
        substeps: usize,
        zero: V,
    ) -> Self {
        let states = pattern.rows();
        Self {
            states,
            gradient: Gradient::new(pattern, substeps, zero),
            places: vec![zero; places(stages) * states],
            slope: vec![zero; states],
        }
    }

    /// Takes the gradient by the first `columns` variables back through a substep, by the entries of
    /// the Jacobian at all its stages.
    #[inline(always)]
    pub(super) fn pull_back(
        &mut self,
        pattern: &SparsityPattern,
        (stages, entries): (&[Stage], &[V]),
        columns: usize,
        zero: V,
    ) {
        let Self { states, gradient, places, slope, .. } = self;
        let (n, gradient) = (*states, &mut gradient.numbers);
        places.fill(zero);
        places[..n].copy_from_slice(&gradient[..n]);
        for (s, Stage { input, moves }) in stages.iter().enumerate().rev() {
            slope.fill(zero);
            for step in moves.iter().rev() {
                let factor = zero.constant(step.factor);
                for (i, slope) in slope.iter_mut().enumerate() {
                    let by_sum = places[step.to * n + i];
                    *slope = by_sum.mul_add(factor, *slope);
                    places[step.to * n + i] = zero;
                    places[step.from * n + i] = places[step.from * n + i] + by_sum;
                }
            }
            let entries = &entries[s * pattern.entries()..][..pattern.entries()];
            let by_state = &mut places[input * n..][..n];
            for (i, &slope) in slope.iter().enumerate() {
                let row = pattern.row(i);
                for (&entry, &column) in entries[row.clone()].iter().zip(&pattern.places()[row]) {
                    let to = match column {
                        _ if column < n => &mut by_state[column],
                        _ if column < columns => &mut gradient[column],
                        // Places ascend.
                        _ => break,
                    };
                    *to = entry.mul_add(slope, *to);
                }
            }
        }
        gradient[..n].copy_from_slice(&places[..n]);
    }
}
