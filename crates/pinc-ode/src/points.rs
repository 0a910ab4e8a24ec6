//! Points to linearize at, with the places of the results.

use crate::{Dims, Linearization, Stages};

/// Points to linearize at, and where the results go: as in
/// [`Model::linearize`](crate::Model::linearize).
#[derive(Debug)]
pub(crate) struct Points<'a> {
    pub(crate) at: Stages<'a>,
    pub(crate) out: Linearization<'a>,
}

impl<'a> Points<'a> {
    /// The first `count` points, and the others.
    pub(crate) fn split(self, dims: Dims, count: usize) -> (Points<'a>, Points<'a>) {
        let Dims { nx: n, nu: m, np, .. } = dims;
        let Points { at, out } = self;
        let (at, at_rest) = at.split(dims, count);
        let (next, next_rest) = out.next.split_at_mut(count * n);
        let (a, a_rest) = out.a.split_at_mut(count * n * n);
        let (b, b_rest) = out.b.split_at_mut(count * n * m);
        let e_length = if out.e.is_empty() { 0 } else { count * n * np };
        let (e, e_rest) = out.e.split_at_mut(e_length);
        let rest = Points {
            at: at_rest,
            out: Linearization { next: next_rest, a: a_rest, b: b_rest, e: e_rest },
        };
        (Points { at, out: Linearization { next, a, b, e } }, rest)
    }

    /// The columns of the Jacobians that are wanted: those by x, by u and, unless their place is
    /// empty, by p.
    #[inline(always)]
    pub(crate) fn columns(&self, Dims { nx, nu, np, .. }: Dims) -> usize {
        nx + nu + if self.out.e.is_empty() { 0 } else { np }
    }

    /// Writes the derivative of a row (counted through all points) in a column.
    #[inline(always)]
    pub(crate) fn set(&mut self, dims: Dims, row: usize, column: usize, derivative: f64) {
        let Dims { nx: n, nu: m, np, .. } = dims;
        if column < n {
            self.out.a[row * n + column] = derivative;
        } else if column < n + m {
            self.out.b[row * m + column - n] = derivative;
        } else {
            self.out.e[row * np + column - n - m] = derivative;
        }
    }
}
