//! The sensitivities of the Rosenbrock method, one *block* of columns at a time.
//!
//! With S the derivatives of the state at the beginning of a substep, and W = I / (h gamma) - J, the
//! differentiated equations of the method are
//!
//! ```text
//! W K_i = J(y_i) sum_(j<i) a_ij K_j + (J(y_i) + M_i) S + sum_(j<i) c_ij K_j / h
//! M_i = d(J(x) k_i)/d(x, u, p), k_i held
//! ```
//!
//! where `J(y_i)` and `M_i` also have columns for inputs and parameters, and S has their unit rows.

use super::elimination::{Elimination, MOST_COLUMNS};
use super::rosenbrock::{A, C, STAGES};
use super::{CurvedFunction, SparsityPattern};
use pinc_ad::simd::{Simd, Work};

/// Numbers of columns that go through the method together.
const WIDTHS: [usize; 3] = [2, 3, MOST_COLUMNS];

/// Derivatives of the state by the variables (x, u, p) at the start of a step.
#[derive(Clone, Debug)]
pub(super) struct Tangents<V> {
    width: usize,
    variables: usize,
    states: usize,
    /// S, block by block: a row of [`Tangents::width`] columns for each variable.
    numbers: Vec<V>,
    /// `K_i` of a block, stage by stage, and a sum of them.
    stages: Vec<V>,
    sum: Vec<V>,
    pub(super) curvatures: Vec<Curved>,
    /// The second derivatives of f at the beginning of a substep, in the order of `curvatures`.
    pub(super) second: Vec<V>,
    /// `J(y_i) + M_i`, stage by stage.
    slopes: Vec<V>,
}

/// What a second derivative is a part of: this entry of M, times k of this state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Curved {
    pub(super) entry: usize,
    /// The entry's row.
    pub(super) row: usize,
    pub(super) state: usize,
}

impl<V: Simd> Tangents<V> {
    pub(super) fn new<F: CurvedFunction>(rhs: &F, zero: V) -> Self {
        let pattern = rhs.pattern();
        let (states, variables) = (pattern.rows(), pattern.columns());
        // Each block takes the entries of all matrices again.
        let work = |width: &usize| variables.div_ceil(*width) * (width + 1);
        let width = WIDTHS.into_iter().min_by_key(work).unwrap_or(MOST_COLUMNS);
        let row_of = |entry: usize| (0..states).find(|&i| pattern.row(i).contains(&entry));
        let curved = |curvature: &super::Curvature| {
            let row = row_of(curvature.entry)?;
            let places = pattern.row(row);
            let entry = places.start
                + pattern.places()[places].iter().position(|&v| v == curvature.variable)?;
            Some(Curved { entry, row, state: pattern.places()[curvature.entry] })
        };
        let curvatures: Option<Vec<_>> = rhs.curvatures().iter().map(curved).collect();
        let curvatures = curvatures.expect("what bends by a variable has a slope by it");
        Self {
            width,
            variables,
            states,
            numbers: vec![zero; variables.div_ceil(width) * variables * width],
            stages: vec![zero; STAGES * states * width],
            sum: vec![zero; states * width],
            second: vec![zero; curvatures.len()],
            curvatures,
            slopes: vec![zero; STAGES * pattern.entries()],
        }
    }

    /// Sets the first `columns` to the identity's, as for a step of no length.
    #[inline(always)]
    pub(super) fn reset(&mut self, columns: usize, zero: V) {
        let Self { width, variables, .. } = *self;
        let blocks = columns.div_ceil(width);
        self.numbers[..blocks * variables * width].fill(zero);
        for column in 0..variables.min(blocks * width) {
            let block = column / width;
            self.numbers[(block * variables + column) * width + column % width] =
                zero.constant(1.0);
        }
    }

    /// The derivative of a state by a variable.
    #[inline(always)]
    pub(super) fn get(&self, state: usize, variable: usize) -> V {
        let (block, column) = (variable / self.width, variable % self.width);
        self.numbers[(block * self.variables + state) * self.width + column]
    }

    /// Takes the derivatives by the first `columns` variables through a substep.
    #[inline(always)]
    pub(super) fn propagate(&mut self, columns: usize, substep: Substep<'_, V>) {
        let Self { curvatures, second, slopes, states, .. } = self;
        slopes.copy_from_slice(substep.entries);
        let count = substep.pattern.entries();
        let stages = slopes.chunks_exact_mut(count.max(1)).zip(substep.k.chunks_exact(*states));
        for (slopes, k) in stages {
            for (Curved { entry, state, .. }, &second) in curvatures.iter().zip(&*second) {
                slopes[*entry] = second.mul_add(k[*state][0], slopes[*entry]);
            }
        }
        let blocks = columns.div_ceil(self.width);
        let (zero, width) = (substep.zero, self.width);
        let parts = Propagate { tangents: self, substep, blocks };
        match width {
            2 => zero.vectorize(Columns::<V, 2>(parts)),
            3 => zero.vectorize(Columns::<V, 3>(parts)),
            _ => zero.vectorize(Columns::<V, MOST_COLUMNS>(parts)),
        }
    }
}

/// What a substep of the state has left.
#[derive(Debug)]
pub(super) struct Substep<'a, V> {
    pub(super) pattern: &'a SparsityPattern,
    /// The entries of the Jacobian, stage by stage.
    pub(super) entries: &'a [V],
    /// `k_i`, stage by stage.
    pub(super) k: &'a [[V; 1]],
    pub(super) elimination: &'a mut Elimination<V>,
    pub(super) h: f64,
    pub(super) zero: V,
}

struct Propagate<'a, V> {
    tangents: &'a mut Tangents<V>,
    substep: Substep<'a, V>,
    blocks: usize,
}

/// The same, with `W` columns in a block.
struct Columns<'a, V, const W: usize>(Propagate<'a, V>);

impl<V: Simd, const W: usize> Work for Columns<'_, V, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Propagate { tangents, substep, blocks } = self.0;
        let Substep { pattern, entries, elimination, h, zero, .. } = substep;
        let Tangents { variables, states, numbers, stages, sum, slopes, .. } = tangents;
        let (n, count) = (*states, pattern.entries());
        let (numbers, _) = numbers.as_chunks_mut::<W>();
        let (stages, _) = stages.as_chunks_mut::<W>();
        let (sum, _) = sum.as_chunks_mut::<W>();
        for block in numbers.chunks_exact_mut(*variables).take(blocks) {
            for stage in 0..STAGES {
                let (known, rest) = stages.split_at_mut(stage * n);
                let own = &mut rest[..n];
                let at = stage * count..(stage + 1) * count;
                for (i, to) in own.iter_mut().enumerate() {
                    *to = [zero; W];
                    add_product(to, pattern, i, &slopes[at.clone()], block);
                }
                if let Some(before) = stage.checked_sub(1) {
                    let scaled = C[before].map(|c| c / h);
                    for (i, (to, sum)) in own.iter_mut().zip(&mut *sum).enumerate() {
                        *sum = [zero; W];
                        add_stages(sum, &A[before], known, n, i, zero);
                        add_stages(to, &scaled, known, n, i, zero);
                    }
                    for (i, to) in own.iter_mut().enumerate() {
                        add_product(to, pattern, i, &entries[at.clone()], sum);
                    }
                }
                elimination.solve(own);
            }
            let last = &stages[(STAGES - 1) * n..];
            for ((to, sum), k) in block.iter_mut().zip(&*sum).zip(last) {
                for c in 0..W {
                    to[c] = to[c] + (sum[c] + k[c]);
                }
            }
        }
    }
}

/// Adds row `i` of a matrix times `by`, which may have fewer rows than the matrix has columns.
#[inline(always)]
fn add_product<V: Simd, const W: usize>(
    to: &mut [V; W],
    pattern: &SparsityPattern,
    i: usize,
    entries: &[V],
    by: &[[V; W]],
) {
    let row = pattern.row(i);
    for (&place, &entry) in pattern.places()[row.clone()].iter().zip(&entries[row]) {
        // Places ascend.
        let Some(factors) = by.get(place) else { return };
        for c in 0..W {
            to[c] = factors[c].mul_add(entry, to[c]);
        }
    }
}

/// Adds `factors_1 K_1 + factors_2 K_2 + ..` of state i.
#[inline(always)]
fn add_stages<V: Simd, const W: usize>(
    to: &mut [V; W],
    factors: &[f64; 5],
    stages: &[[V; W]],
    n: usize,
    i: usize,
    zero: V,
) {
    for (&factor, stage) in factors.iter().zip(stages.chunks_exact(n)) {
        let factor = zero.constant(factor);
        for c in 0..W {
            to[c] = stage[i][c].mul_add(factor, to[c]);
        }
    }
}
