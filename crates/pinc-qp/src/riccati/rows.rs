//! The rows of a QP as one list.

use crate::algebra::{add_scaled, block, block_mut, dot};
use crate::{Kind, Multipliers, OcpDims, Qp, Row, RowBlock};

/// The values C d of all rows that may have limits: the unknowns, the increments of the inputs, and
/// the general rows, one after the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rows {
    dims: OcpDims,
}

impl Rows {
    pub(super) fn new(dims: OcpDims) -> Self {
        Self { dims }
    }

    pub(super) fn len(self) -> usize {
        self.dims.unknowns() + self.dims.all_inputs() + self.dims.all_rows()
    }

    /// Splits a list of all rows into the three kinds.
    pub(super) fn split(self, list: &[f64]) -> (&[f64], &[f64], &[f64]) {
        let (bounds, rest) = list.split_at(self.dims.unknowns());
        let (increments, general) = rest.split_at(self.dims.all_inputs());
        (bounds, increments, general)
    }

    /// Writes C d.
    pub(super) fn values(self, qp: &Qp, d: &[f64], values: &mut [f64]) {
        let dims = self.dims;
        let (n, m) = (dims.nx, dims.nu);
        let (bounds, rest) = values.split_at_mut(dims.unknowns());
        let (increments, general) = rest.split_at_mut(dims.all_inputs());
        bounds.copy_from_slice(d);
        let inputs = &d[dims.all_states()..];
        increments.copy_from_slice(inputs);
        let (branching, before) = dims.inputs_before();
        for (i, before) in branching {
            add_scaled(block_mut(increments, i, m), -1.0, block(inputs, before, m));
        }
        let later = increments.len() - before.len();
        for (increment, before) in increments[later..].iter_mut().zip(&inputs[before]) {
            *increment -= before;
        }
        for j in dims.stages_with_rows() {
            for RowBlock { rows, state, input } in dims.row_blocks(j) {
                let u = &d[dims.input(input)];
                let [by_x, by_u] = qp.row_jacobians(rows.clone());
                let values = general[rows].iter_mut().zip(by_u.chunks_exact(m));
                if let Some(state) = dims.state(state) {
                    let x = &d[state];
                    for ((value, by_u), by_x) in values.zip(by_x.chunks_exact(n)) {
                        *value = dot(by_x, x) + dot(by_u, u);
                    }
                } else {
                    values.for_each(|(value, by_u)| *value = dot(by_u, u));
                }
            }
        }
    }

    /// sum += C' list
    pub(super) fn add_transposed(self, qp: &Qp, list: &[f64], sum: &mut [f64]) {
        let dims = self.dims;
        let (n, m) = (dims.nx, dims.nu);
        let (bounds, increments, general) = self.split(list);
        for (sum, factor) in sum.iter_mut().zip(bounds) {
            *sum += factor;
        }
        let inputs = &mut sum[dims.all_states()..];
        for (sum, factor) in inputs.iter_mut().zip(increments) {
            *sum += factor;
        }
        let (branching, before) = dims.inputs_before();
        for (i, before) in branching {
            add_scaled(block_mut(inputs, before, m), -1.0, block(increments, i, m));
        }
        let later = increments.len() - before.len();
        for (sum, factor) in inputs[before].iter_mut().zip(&increments[later..]) {
            *sum -= factor;
        }
        for j in dims.stages_with_rows() {
            for RowBlock { rows, state, input } in dims.row_blocks(j) {
                let (state, input) = (dims.state(state), dims.input(input));
                let [by_x, by_u] = qp.row_jacobians(rows.clone());
                let jacobians = by_x.chunks_exact(n).zip(by_u.chunks_exact(m));
                for (factor, (by_x, by_u)) in general[rows].iter().zip(jacobians) {
                    if let Some(state) = &state {
                        add_scaled(&mut sum[state.clone()], *factor, by_x);
                    }
                    add_scaled(&mut sum[input.clone()], *factor, by_u);
                }
            }
        }
    }

    /// [`Limits::find`](crate::Limits::find) over all rows.
    #[inline(always)]
    pub(super) fn find(
        self,
        qp: &Qp,
        list: &[f64],
        is: impl Fn(f64, f64, f64) -> bool,
        mut found: impl FnMut(usize, [f64; 3]),
    ) {
        let (bounds, increments, general) = self.split(list);
        let mut first = 0;
        for ((_, limits), list) in qp.limits().into_iter().zip([bounds, increments, general]) {
            limits.find(list, &is, |row, of| found(first + row, of));
            first += list.len();
        }
    }

    /// The limits of a row, `[low, high, penalty]`.
    pub(super) fn limits_of(self, qp: &Qp, row: usize) -> [f64; 3] {
        let Row { kind, index, .. } = self.row(row, true);
        let limits = match kind {
            Kind::Bound => &qp.bounds,
            Kind::Increment => &qp.increments,
            Kind::Row => &qp.rows,
        };
        [limits.low[index], limits.high[index], limits.penalty[index]]
    }

    /// The limits of all rows, `[low, high, penalty]`.
    pub(super) fn limits(qp: &Qp) -> impl Iterator<Item = [f64; 3]> {
        qp.bounds.iter().chain(qp.increments.iter()).chain(qp.rows.iter())
    }

    pub(super) fn row(self, i: usize, upper: bool) -> Row {
        let (bounds, increments) = (self.dims.unknowns(), self.dims.all_inputs());
        let (kind, index) = if i < bounds {
            (Kind::Bound, i)
        } else if i < bounds + increments {
            (Kind::Increment, i - bounds)
        } else {
            (Kind::Row, i - bounds - increments)
        };
        Row { kind, index, upper }
    }

    pub(super) fn read(self, multipliers: &Multipliers, list: &mut [f64]) {
        let parts = [&multipliers.bounds, &multipliers.increments, &multipliers.rows];
        let all = parts.into_iter().flatten();
        list.iter_mut().zip(all).for_each(|(to, from)| *to = *from);
    }

    pub(super) fn write(self, list: &[f64], multipliers: &mut Multipliers) {
        let (bounds, increments, general) = self.split(list);
        multipliers.bounds.copy_from_slice(bounds);
        multipliers.increments.copy_from_slice(increments);
        multipliers.rows.copy_from_slice(general);
    }
}
