//! The cost J, which is quadratic in the unknowns.

#[cfg(test)]
mod tests;

use crate::scenarios::Nodes;
use crate::{NmpcProblem, Tracked, Weight};
use pinc_qp::OcpDims;

/// J's weights, laid out by stage and doubled, as its derivatives have them.
#[derive(Clone, Debug)]
pub(crate) struct Cost {
    dims: OcpDims,
    /// The tracked states, if nothing else is tracked.
    tracked: Vec<usize>,
    /// 2 Q, `[N, tracked, tracked]`; 0 before N1.
    q: Vec<f64>,
    /// 2 R, `[Nu, m, m]`.
    r: Vec<f64>,
    /// 2 W, `[(Nu + 1) m, (Nu + 1) m]`, or empty.
    w: Vec<f64>,
}

/// What J is measured against at one control step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Targets<'a> {
    /// yref\[k+1\]..yref\[k+N2\], `[N2, outputs]`; of a tree, of each node.
    pub(crate) reference: &'a [f64],
    /// u\[k-1\], `m`.
    pub(crate) previous: &'a [f64],
}

impl Cost {
    pub(crate) fn new(problem: &NmpcProblem, dims: OcpDims, nodes: &Nodes) -> Self {
        let weights = &problem.weights;
        let mut each = nodes.depths.iter().zip(&nodes.weights);
        let mut r = Vec::new();
        for (&depth, part) in each.clone().take(dims.n_controls) {
            append(&mut r, weights.r.at(depth), 2.0 * part);
        }
        each.next();
        let mut q = Vec::new();
        for (&depth, part) in each {
            match &weights.terminal {
                Some(terminal) if depth == problem.horizon => append(&mut q, terminal, 2.0 * part),
                _ if depth >= problem.n1 => append(&mut q, weights.q.at(depth - 1), 2.0 * part),
                _ => append(&mut q, weights.q.at(depth - 1), 0.0),
            }
        }
        let mut w = Vec::new();
        if let Some(weight) = &weights.input_sequence {
            append(&mut w, weight, 2.0);
        }
        let state = |tracked: &Tracked| match tracked {
            Tracked::State(state) => Some(*state),
            Tracked::Output(_) | Tracked::Input(_) => None,
        };
        let states: Option<Vec<usize>> = problem.tracked.iter().map(state).collect();
        Self { dims, tracked: states.unwrap_or_default(), q, r, w }
    }

    /// 2 Q of stage `j`, in terms of what is tracked.
    pub(crate) fn tracking_weight(&self, j: usize) -> &[f64] {
        let size = self.q.len() / self.dims.horizon;
        &self.q[(j - 1) * size..j * size]
    }

    /// 2 Q in terms of all states, for `x_1..x_N`: `[N, n, n]`; 0 if outputs are tracked.
    pub(crate) fn state_hessians(&self) -> Vec<f64> {
        let (n, outputs) = (self.dims.nx, self.tracked.len());
        let mut all = vec![0.0; self.dims.horizon * n * n];
        if outputs == 0 {
            return all;
        }
        let stages = all.chunks_exact_mut(n * n).zip(self.q.chunks_exact(outputs * outputs));
        for (hessian, q) in stages {
            for (&row, q) in self.tracked.iter().zip(q.chunks_exact(outputs)) {
                for (&column, &q) in self.tracked.iter().zip(q) {
                    hessian[row * n + column] = q;
                }
            }
        }
        all
    }

    /// 2 R, `[Nu, m, m]`.
    pub(crate) fn increment_hessians(&self) -> Vec<f64> {
        self.r.clone()
    }

    /// 2 W without u\[k-1\], `[Nu m, Nu m]`, or empty.
    pub(crate) fn input_hessian(&self) -> Vec<f64> {
        let m = self.dims.nu;
        let width = self.dims.all_inputs() + m;
        self.w.chunks_exact(width).skip(m).flat_map(|row| &row[m..]).copied().collect()
    }

    /// J at `z` without what is said of outputs or by a stage cost; writes dJ/dz into `gradient`.
    pub(crate) fn gradient(&self, z: &[f64], targets: Targets<'_>, gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let (x, u) = z.split_at(self.dims.all_states());
        let (by_x, by_u) = gradient.split_at_mut(self.dims.all_states());
        let mut twice = self.move_inputs(u, targets, by_u);
        if !self.tracked.is_empty() {
            twice += self.track(x, targets.reference, by_x);
        }
        if !self.w.is_empty() {
            twice += self.weigh_inputs(u, targets, by_u);
        }
        twice / 2.0
    }

    /// The part of the states: e'(2 Q)e and its gradient 2 Q e, with e = y - yref.
    fn track(&self, x: &[f64], reference: &[f64], gradient: &mut [f64]) -> f64 {
        let (n, outputs) = (self.dims.nx, self.tracked.len());
        let stages = x.chunks_exact(n).zip(gradient.chunks_exact_mut(n));
        let stages = stages.zip(reference.chunks_exact(outputs));
        let mut twice = 0.0;
        for (((x, gradient), y), q) in stages.zip(self.q.chunks_exact(outputs * outputs)) {
            for ((&row, &y_row), q) in self.tracked.iter().zip(y).zip(q.chunks_exact(outputs)) {
                let mut force = 0.0;
                for ((&column, &y), &q) in self.tracked.iter().zip(y).zip(q) {
                    force += q * (x[column] - y);
                }
                gradient[row] = force;
                twice += force * (x[row] - y_row);
            }
        }
        twice
    }

    /// The part of the inputs: du'(2 R)du and its gradient.
    fn move_inputs(&self, u: &[f64], targets: Targets<'_>, gradient: &mut [f64]) -> f64 {
        let m = self.dims.nu;
        let mut twice = 0.0;
        for (i, r) in self.r.chunks_exact(m * m).enumerate() {
            let now = &u[i * m..(i + 1) * m];
            let place = self.dims.input_before(i);
            let before = place.map_or(targets.previous, |at| &u[at * m..(at + 1) * m]);
            for (row, r) in r.chunks_exact(m).enumerate() {
                let mut force = 0.0;
                for ((&now, &before), &r) in now.iter().zip(before).zip(r) {
                    force += r * (now - before);
                }
                gradient[i * m + row] += force;
                if let Some(before) = place {
                    gradient[before * m + row] -= force;
                }
                twice += force * (now[row] - before[row]);
            }
        }
        twice
    }
}

impl Cost {
    /// The part of W: v'(2 W)v and its gradient, with v = (u\[k-1\], u\[k\], ..).
    #[inline(never)]
    fn weigh_inputs(&self, u: &[f64], targets: Targets<'_>, gradient: &mut [f64]) -> f64 {
        let m = self.dims.nu;
        let width = u.len() + m;
        let value = |i: usize| if i < m { targets.previous[i] } else { u[i - m] };
        let mut twice = 0.0;
        for (i, row) in self.w.chunks_exact(width).enumerate() {
            let force: f64 = row.iter().enumerate().map(|(k, w)| w * value(k)).sum();
            twice += force * value(i);
            if let Some(i) = i.checked_sub(m) {
                gradient[i] += force;
            }
        }
        twice
    }
}

/// Appends `factor` times the matrix.
fn append(to: &mut Vec<f64>, matrix: &Weight, factor: f64) {
    for i in 0..matrix.size() {
        to.extend((0..matrix.size()).map(|k| factor * matrix.entry(i, k)));
    }
}
