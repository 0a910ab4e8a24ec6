//! Systems of linear equations with the matrix `g I - J`, where J is sparse, in the lanes of
//! vectors.

use super::lanes::WIDEST;
use super::{SparsityPattern, lu};
use pinc_ad::simd::Simd;
use std::collections::BTreeSet;

/// The most columns that are solved for together.
pub(super) const MOST_COLUMNS: usize = 4;

/// The part of its terms that must be left of a pivot, so that it counts as exact.
const LEAST_PIVOT: f64 = 1e-3;

/// Factors of `g I - J`, in an order of rows and columns that keeps them sparse.
///
/// Rows are not exchanged, so that all lanes do the same, whatever their numbers. With the same
/// number g on the diagonal, and whatever the units of the states are, only a pivot that is a small
/// difference of large terms loses digits: lanes where that happens are solved by themselves, with
/// exchange of rows.
#[derive(Clone, Debug)]
pub(super) struct Elimination<V> {
    /// The rows in the order of elimination.
    rows: Vec<Row>,
    /// Of each state, its place in this order.
    position: Vec<usize>,
    /// The columns of the entries of the factors, row by row, without the diagonal.
    columns: Vec<usize>,
    factors: Vec<V>,
    /// Of each state, one over its pivot.
    inverse: Vec<V>,
    /// A row while it is computed.
    row: Vec<V>,
    alone: [bool; WIDEST],
    exchanged: Exchanged,
}

/// A row of the factors: its entries before the diagonal and those after it.
#[derive(Clone, Copy, Debug)]
struct Row {
    state: usize,
    begin: usize,
    split: usize,
    end: usize,
}

/// Dense factors of single lanes, with exchange of rows.
#[derive(Clone, Debug)]
struct Exchanged {
    n: usize,
    matrices: Vec<f64>,
    orders: Vec<usize>,
    /// Right-hand sides, then solutions.
    columns: Vec<f64>,
}

impl Exchanged {
    fn new(n: usize) -> Self {
        Self {
            n,
            matrices: vec![0.0; WIDEST * n * n],
            orders: vec![0; WIDEST * n],
            columns: vec![0.0; WIDEST * MOST_COLUMNS * n],
        }
    }

    /// The matrix of a lane with the order of its rows, and the numbers of a column there.
    fn of(&mut self, lane: usize, column: usize) -> (&mut [f64], &mut [usize], &mut [f64]) {
        let n = self.n;
        let matrix = &mut self.matrices[lane * n * n..][..n * n];
        let column = &mut self.columns[(lane * MOST_COLUMNS + column) * n..][..n];
        (matrix, &mut self.orders[lane * n..][..n], column)
    }
}

impl<V: Simd> Elimination<V> {
    /// For a right-hand side whose Jacobian has this pattern.
    pub(super) fn new(pattern: &SparsityPattern, zero: V) -> Self {
        let n = pattern.rows();
        let (order, couplings) = order(pattern);
        let mut position = vec![0; n];
        order.iter().enumerate().for_each(|(k, &state)| position[state] = k);
        let (mut rows, mut columns) = (Vec::with_capacity(n), Vec::new());
        for &state in &order {
            let begin = columns.len();
            columns.extend(&couplings[state]);
            columns[begin..].sort_by_key(|&column| position[column]);
            let own = |&column: &usize| position[column] < position[state];
            let split = begin + columns[begin..].partition_point(own);
            rows.push(Row { state, begin, split, end: columns.len() });
        }
        Self {
            factors: vec![zero; columns.len()],
            inverse: vec![zero; n],
            row: vec![zero; n],
            alone: [false; WIDEST],
            rows,
            position,
            columns,
            exchanged: Exchanged::new(n),
        }
    }

    /// Factorizes `diagonal I - J`, with J by its entries.
    #[inline(always)]
    pub(super) fn factorize(&mut self, pattern: &SparsityPattern, entries: &[V], diagonal: f64) {
        let Self { rows, position, columns, factors, inverse, row, alone, .. } = self;
        let mut least = row[0].constant(f64::INFINITY);
        for &Row { state, begin, split, end } in &*rows {
            for &column in &columns[begin..end] {
                row[column] = row[0].constant(0.0);
            }
            row[state] = row[0].constant(diagonal);
            for entry in pattern.row(state) {
                let place = pattern.places()[entry];
                if place < inverse.len() {
                    row[place] = row[place] - entries[entry];
                }
            }
            // What the pivot is the sum of.
            let mut size = (row[state] - diagonal).abs() + diagonal;
            for place in begin..split {
                let eliminated = columns[place];
                let factor = row[eliminated] * inverse[eliminated];
                factors[place] = factor;
                let before = row[state];
                let upper = &rows[position[eliminated]];
                for other in upper.split..upper.end {
                    let to = &mut row[columns[other]];
                    *to = factor.neg_mul_add(factors[other], *to);
                }
                size = size + (row[state] - before).abs();
            }
            for place in split..end {
                factors[place] = row[columns[place]];
            }
            let pivot = row[state];
            inverse[state] = pivot.constant(1.0) / pivot;
            let left = pivot.abs() - size * LEAST_PIVOT;
            // What comes after a pivot that vanishes is not a number.
            least = (left - least).where_nonpositive(left, least);
        }
        let mut lanes = [1.0; WIDEST];
        least.write(&mut lanes);
        for (alone, lane) in alone.iter_mut().zip(lanes) {
            *alone = lane <= 0.0;
        }
        if alone.contains(&true) {
            self.factorize_alone(pattern, entries, diagonal);
        }
    }

    /// Factorizes the matrices of lanes that need an exchange of rows.
    #[inline(never)]
    fn factorize_alone(&mut self, pattern: &SparsityPattern, entries: &[V], diagonal: f64) {
        let n = pattern.rows();
        for lane in (0..V::LANES).filter(|&lane| self.alone[lane]) {
            let (matrix, order, _) = self.exchanged.of(lane, 0);
            matrix.fill(0.0);
            for (i, row) in matrix.chunks_exact_mut(n).enumerate() {
                row[i] = diagonal;
                for entry in pattern.row(i) {
                    if let Some(to) = row.get_mut(pattern.places()[entry]) {
                        let mut lanes = [0.0; WIDEST];
                        entries[entry].write(&mut lanes);
                        *to -= lanes[lane];
                    }
                }
            }
            lu::factorize(matrix, order);
        }
    }

    /// Solves with the transposed matrix.
    #[inline(always)]
    pub(super) fn solve_transposed(&mut self, b: &mut [[V; 1]]) {
        let alone = self.alone.contains(&true);
        if alone {
            self.solve_alone(b, lu::solve_transposed);
        }
        let Self { rows, columns, factors, inverse, .. } = &*self;
        for &Row { state, split, end, .. } in rows {
            let value = b[state][0] * inverse[state];
            b[state] = [value];
            for (&column, factor) in columns[split..end].iter().zip(&factors[split..end]) {
                b[column] = [factor.neg_mul_add(value, b[column][0])];
            }
        }
        for &Row { state, begin, split, .. } in rows.iter().rev() {
            let [value] = b[state];
            for (&column, factor) in columns[begin..split].iter().zip(&factors[begin..split]) {
                b[column] = [factor.neg_mul_add(value, b[column][0])];
            }
        }
        if alone {
            self.place_alone(b);
        }
    }

    /// Solves for `W` columns: `b` becomes the solution.
    #[inline(always)]
    pub(super) fn solve<const W: usize>(&mut self, b: &mut [[V; W]]) {
        let alone = self.alone.contains(&true);
        if alone {
            self.solve_alone(b, lu::solve);
        }
        let Self { rows, columns, factors, inverse, .. } = &*self;
        for &Row { state, begin, split, .. } in rows {
            let mut sum = b[state];
            for (&column, factor) in columns[begin..split].iter().zip(&factors[begin..split]) {
                for c in 0..W {
                    sum[c] = factor.neg_mul_add(b[column][c], sum[c]);
                }
            }
            b[state] = sum;
        }
        for &Row { state, split, end, .. } in rows.iter().rev() {
            let mut sum = b[state];
            for (&column, factor) in columns[split..end].iter().zip(&factors[split..end]) {
                for c in 0..W {
                    sum[c] = factor.neg_mul_add(b[column][c], sum[c]);
                }
            }
            for c in 0..W {
                b[state][c] = sum[c] * inverse[state];
            }
        }
        if alone {
            self.place_alone(b);
        }
    }

    /// Solves for the lanes that need an exchange of rows.
    #[inline(never)]
    fn solve_alone<const W: usize>(
        &mut self,
        b: &[[V; W]],
        solve: fn(&[f64], &[usize], &mut [f64]),
    ) {
        let Self { alone, exchanged, .. } = self;
        for lane in (0..V::LANES).filter(|&lane| alone[lane]) {
            for c in 0..W {
                let (matrix, order, column) = exchanged.of(lane, c);
                for (to, row) in column.iter_mut().zip(b) {
                    let mut lanes = [0.0; WIDEST];
                    row[c].write(&mut lanes);
                    *to = lanes[lane];
                }
                solve(matrix, order, column);
            }
        }
    }

    /// Puts their solutions beside the solutions of other lanes.
    #[inline(never)]
    fn place_alone<const W: usize>(&mut self, b: &mut [[V; W]]) {
        let Self { alone, exchanged, .. } = self;
        for lane in (0..V::LANES).filter(|&lane| alone[lane]) {
            for c in 0..W {
                let (_, _, column) = exchanged.of(lane, c);
                for (row, &value) in b.iter_mut().zip(&*column) {
                    let mut lanes = [0.0; WIDEST];
                    row[c].write(&mut lanes);
                    lanes[lane] = value;
                    row[c] = row[c].load(&lanes);
                }
            }
        }
    }
}

/// An order of the states in which few new entries arise when they are eliminated, by the least
/// number of couplings left (minimum degree), and the columns in which the rows of the factors then
/// have entries besides the diagonal.
fn order(pattern: &SparsityPattern) -> (Vec<usize>, Vec<BTreeSet<usize>>) {
    let n = pattern.rows();
    let mut couplings = vec![BTreeSet::new(); n];
    for i in 0..n {
        for &j in &pattern.places()[pattern.row(i)] {
            if j < n && j != i {
                couplings[i].insert(j);
                couplings[j].insert(i);
            }
        }
    }
    let mut left: BTreeSet<usize> = (0..n).collect();
    let mut order = Vec::with_capacity(n);
    let degree = |couplings: &[BTreeSet<usize>], left: &BTreeSet<usize>, i: usize| {
        couplings[i].iter().filter(|j| left.contains(j)).count()
    };
    while let Some(next) = left.iter().copied().min_by_key(|&i| degree(&couplings, &left, i)) {
        left.remove(&next);
        order.push(next);
        let coupled: Vec<usize> = couplings[next].intersection(&left).copied().collect();
        for &i in &coupled {
            couplings[i].extend(coupled.iter().filter(|&&j| j != i));
        }
    }
    (order, couplings)
}
