//! The cost J, which is quadratic in the unknowns.

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Weights;
    use crate::outputs::OutputRows;
    use pinc_ad::check_gradient;
    use pinc_ode::Dims;

    fn problem() -> NmpcProblem {
        let q = Weight::Full(vec![vec![3.0, 0.2], vec![0.2, 0.5]]);
        let r = Weight::Full(vec![vec![1.0, -0.3], vec![-0.3, 2.0]]);
        let weights = Weights::scaled(q, r, &[1.5, 1.0, 0.5], &[1.5, 1.0])
            .with_terminal(vec![4.0, 7.0])
            .with_input_sequence(vec![0.0, 3.0, 0.0, 1.0, 2.0, 0.0]);
        NmpcProblem {
            n1: 2,
            control_horizon: 2,
            tracked: Tracked::states([2, 0]),
            ..NmpcProblem::new(Dims::new(3, 2), 3, weights)
        }
    }

    fn cost_of(problem: &NmpcProblem) -> Cost {
        let dims = problem.ocp_dims(Dims::new(3, 2), &OutputRows::default());
        Cost::new(problem, dims, &Nodes::new(problem, dims))
    }

    /// J by its definition, for the problem above.
    fn value(z: &[f64], targets: Targets<'_>) -> f64 {
        let error = |j: usize| {
            let (x, y) = (&z[(j - 1) * 3..j * 3], &targets.reference[(j - 1) * 2..j * 2]);
            [x[2] - y[0], x[0] - y[1]]
        };
        let [e, f] = error(2);
        let mut sum = 3.0 * e * e + 0.4 * e * f + 0.5 * f * f;
        let [e, f] = error(3);
        sum += 4.0 * e * e + 7.0 * f * f;
        let u = [targets.previous, &z[9..11], &z[11..13]];
        for (i, v) in [(1, 1.5), (2, 1.0)] {
            let [a, b] = [u[i][0] - u[i - 1][0], u[i][1] - u[i - 1][1]];
            sum += v * (a * a - 0.6 * a * b + 2.0 * b * b);
        }
        sum + 3.0 * u[0][1].powi(2) + u[1][1].powi(2) + 2.0 * u[2][0].powi(2)
    }

    #[test]
    fn each_increment_is_from_the_input_before() {
        let weights = Weights::scaled(
            Weight::Full(vec![vec![0.0; 2]; 2]),
            Weight::Full(vec![vec![1.0, -0.3], vec![-0.3, 2.0]]),
            &[1.0; 3],
            &[1.5, 1.0, 0.5],
        );
        let problem = NmpcProblem { control_horizon: 3, weights, ..problem() };
        let cost = cost_of(&problem);
        let targets = Targets { reference: &[0.0; 6], previous: &[0.5, -1.0] };
        let z = [[0.0; 9].as_slice(), &[1.5, 0.0, 1.0, 2.0, 4.0, -1.0]].concat();
        // The increments are (1, 1), (-0.5, 2) and (3, -3).
        let expected = 1.5 * 2.4 + (0.25 + 0.6 + 8.0) + 0.5 * (9.0 + 5.4 + 18.0);
        let mut gradient = vec![f64::NAN; 15];
        let found = cost.gradient(&z, targets, &mut gradient);
        assert!((found - expected).abs() < 1e-13 * expected, "{found} {expected}");
        let value = |z: &[f64]| cost.gradient(z, targets, &mut [0.0; 15]);
        check_gradient(value, &z, &gradient, 1e-8).unwrap();
    }

    #[test]
    fn the_tracking_weight_belongs_to_its_stage() {
        let problem = problem();
        let cost = cost_of(&problem);
        // Before N1, then twice Q, then the terminal weight.
        assert_eq!(cost.tracking_weight(1).to_vec(), vec![0.0; 4]);
        assert_eq!(cost.tracking_weight(2).to_vec(), vec![6.0, 0.4, 0.4, 1.0]);
        assert_eq!(cost.tracking_weight(3).to_vec(), vec![8.0, 0.0, 0.0, 14.0]);
    }

    #[test]
    fn the_derivatives_match_the_definition() {
        let problem = problem();
        let dims = problem.ocp_dims(Dims::new(3, 2), &OutputRows::default());
        let cost = Cost::new(&problem, dims, &Nodes::new(&problem, dims));
        let targets =
            Targets { reference: &[0.3, -0.2, 0.1, 0.7, -0.4, 0.9], previous: &[0.6, -1.1] };
        let z: Vec<f64> = (0..13).map(|i| f64::from(i * i % 7) - 2.0).collect();
        let mut gradient = vec![f64::NAN; 13];
        let found = cost.gradient(&z, targets, &mut gradient);
        assert!((found - value(&z, targets)).abs() < 1e-13 * found);
        // J is quadratic: central differences are exact up to rounding, 1e-16/1e-5 of J's 1e2.
        check_gradient(|z| value(z, targets), &z, &gradient, 1e-8).unwrap();

        // Its Hessian, block by block, as a difference of gradients.
        let (q, r) = (cost.state_hessians(), cost.increment_hessians());
        let w = cost.input_hessian();
        for v in 0..13 {
            let mut moved = z.clone();
            moved[v] += 1.0;
            let mut there = vec![f64::NAN; 13];
            cost.gradient(&moved, targets, &mut there);
            for row in 0..13 {
                let block = |matrix: &[f64], i: usize, size: usize, row: usize, column: usize| {
                    matrix[(i * size + row % size) * size + column % size]
                };
                let expected = match (row, v) {
                    (0..9, 0..9) if row / 3 == v / 3 => block(&q, v / 3, 3, row, v),
                    (9..11, 9..11) => {
                        block(&r, 0, 2, row - 9, v - 9) + block(&r, 1, 2, row - 9, v - 9)
                    }
                    (11..13, 11..13) => block(&r, 1, 2, row - 9, v - 9),
                    (9..13, 9..13) => -block(&r, 1, 2, row - 9, v - 9),
                    _ => 0.0,
                };
                let inputs = row.min(v) >= 9;
                let expected = expected + if inputs { w[(row - 9) * 4 + v - 9] } else { 0.0 };
                let difference = there[row] - gradient[row];
                assert!((expected - difference).abs() < 1e-13 * 100.0, "{row}, {v}");
            }
        }
    }
}
