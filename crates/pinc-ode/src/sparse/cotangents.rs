//! The gradient of a weighted sum of the results of the Rosenbrock method, stage by stage backwards.
//!
//! With g the gradient by the state at the end of a substep, and W, J and `M_i` those of
//! [`super::tangents`], from the last stage to the first
//!
//! ```text
//! W'q_i = g_i + sum_(j>i) (a_ji J(y_j)'q_j + c_ji q_j / h),    g_6 = g,    g_i = a_6i g
//! gradient = g + sum_i (J(y_i) + M_i)'q_i
//! ```
//!
//! where g has no entries for inputs and parameters.

use super::SparsityPattern;
use super::gradient::Gradient;
use super::rosenbrock::{A, C, STAGES};
use super::tangents::{Curved, Substep};
use pinc_ad::simd::Simd;

/// The gradient by the variables (x, u, p) at the start of a step.
#[derive(Clone, Debug)]
pub(super) struct Cotangents<V> {
    states: usize,
    pub(super) gradient: Gradient<V>,
    /// By the `k_i`, and then `q_i`, stage by stage.
    stages: Vec<[V; 1]>,
    /// By `y_i`.
    slope: Vec<V>,
}

impl<V: Simd> Cotangents<V> {
    pub(super) fn new(pattern: &SparsityPattern, substeps: usize, zero: V) -> Self {
        let states = pattern.rows();
        Self {
            states,
            gradient: Gradient::new(pattern, substeps, zero),
            stages: vec![[zero]; STAGES * states],
            slope: vec![zero; states],
        }
    }

    /// Takes the gradient by the first `columns` variables back through a substep, with the second
    /// derivatives of f at its beginning.
    #[inline(always)]
    pub(super) fn pull_back(
        &mut self,
        substep: Substep<'_, V>,
        (curvatures, second): (&[Curved], &[V]),
        columns: usize,
    ) {
        let Self { states, gradient, stages, slope, .. } = self;
        let Substep { pattern, entries, k, elimination, h, zero } = substep;
        let (n, count, gradient) = (*states, pattern.entries(), &mut gradient.numbers);
        stages.fill([zero]);
        slope.copy_from_slice(&gradient[..n]);
        for (to, &g) in stages[(STAGES - 1) * n..].iter_mut().zip(&*slope) {
            *to = [g];
        }
        gradient[..n].fill(zero);
        for stage in (0..STAGES).rev() {
            let (earlier, rest) = stages.split_at_mut(stage * n);
            let own = &mut rest[..n];
            elimination.solve_transposed(own);
            let entries = &entries[stage * count..][..count];
            for (i, [q]) in own.iter().enumerate() {
                let row = pattern.row(i);
                for (&entry, &column) in entries[row.clone()].iter().zip(&pattern.places()[row]) {
                    let to = match column {
                        _ if column < n => &mut slope[column],
                        _ if column < columns => &mut gradient[column],
                        // Places ascend.
                        _ => break,
                    };
                    *to = entry.mul_add(*q, *to);
                }
            }
            if let Some(before) = stage.checked_sub(1) {
                for (j, earlier) in earlier.chunks_exact_mut(n).enumerate() {
                    let (a, c) = (zero.constant(A[before][j]), zero.constant(C[before][j] / h));
                    for (([to], &slope), [q]) in earlier.iter_mut().zip(&*slope).zip(&*own) {
                        *to = slope.mul_add(a, q.mul_add(c, *to));
                    }
                }
            }
            for (to, slope) in gradient.iter_mut().zip(&mut *slope) {
                *to = *to + *slope;
                *slope = zero;
            }
        }
        for (&Curved { entry, row, state }, &second) in curvatures.iter().zip(second) {
            let column = pattern.places()[entry];
            if column < columns {
                let stages = stages.chunks_exact(n).zip(k.chunks_exact(n));
                let sum = stages.fold(zero, |sum, (q, k)| q[row][0].mul_add(k[state][0], sum));
                gradient[column] = second.mul_add(sum, gradient[column]);
            }
        }
    }
}
