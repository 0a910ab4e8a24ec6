//! The cost J, which is quadratic in the unknowns.

use crate::NmpcProblem;
use crate::solution::Shape;

/// J's weights, laid out by stage and doubled, as its derivatives have them.
#[derive(Clone, Debug)]
pub(crate) struct Cost {
    shape: Shape,
    controlled: Vec<usize>,
    /// 2 w_{j+1} Q, `[N, outputs]`; 0 before N1.
    q: Vec<f64>,
    /// 2 `v_i` R, `[Nu, m]`.
    r: Vec<f64>,
}

/// What J is measured against at one control step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Targets<'a> {
    /// yref\[k+1\]..yref\[k+N2\], `[N2, outputs]`.
    pub(crate) reference: &'a [f64],
    /// u\[k-1\], `m`.
    pub(crate) previous: &'a [f64],
}

impl Cost {
    pub(crate) fn new(problem: &NmpcProblem, shape: Shape, horizon_s: f64) -> Self {
        let weights = &problem.weights;
        let stage_weight = |i| weights.profile.weight(i, shape.stages, horizon_s);
        let mut q = Vec::new();
        for j in 0..shape.stages {
            let tracked = j + 1 >= problem.first;
            let w = if tracked { 2.0 * stage_weight(j) } else { 0.0 };
            q.extend(weights.q.iter().map(|q| w * q));
        }
        let mut r = Vec::new();
        for i in 0..shape.moves {
            r.extend(weights.r.iter().map(|r| 2.0 * stage_weight(i) * r));
        }
        Self { shape, controlled: problem.controlled.clone(), q, r }
    }

    /// Writes dJ/dz at `z` into `gradient`.
    pub(crate) fn gradient(&self, z: &[f64], targets: Targets<'_>, gradient: &mut [f64]) {
        gradient.fill(0.0);
        for j in 0..self.shape.stages {
            let base = self.shape.next_state(j).start;
            let row = j * self.controlled.len();
            for (i, &state) in self.controlled.iter().enumerate() {
                let error = z[base + state] - targets.reference[row + i];
                gradient[base + state] = self.q[row + i] * error;
            }
        }
        let inputs = self.shape.all_states();
        let m = self.shape.inputs;
        for i in 0..self.r.len() {
            let before = if i < m { targets.previous[i] } else { z[inputs + i - m] };
            let force = self.r[i] * (z[inputs + i] - before);
            gradient[inputs + i] += force;
            if i >= m {
                gradient[inputs + i - m] -= force;
            }
        }
    }

    /// The Hessian's diagonal entry of unknown `v`.
    pub(crate) fn curvature(&self, v: usize) -> f64 {
        let all_states = self.shape.all_states();
        if v < all_states {
            let (stage, state) = (v / self.shape.states, v % self.shape.states);
            let output = self.controlled.iter().position(|&c| c == state);
            output.map_or(0.0, |i| self.q[stage * self.controlled.len() + i])
        } else {
            let i = v - all_states;
            self.r[i] + self.r.get(i + self.shape.inputs).unwrap_or(&0.0)
        }
    }

    /// The Hessian's only other entry in column `v` above the diagonal, with its row: that between
    /// an input and the same input a step before.
    pub(crate) fn coupling(&self, v: usize) -> Option<(usize, f64)> {
        let m = self.shape.inputs;
        let i = v.checked_sub(self.shape.all_states() + m)?;
        Some((v - m, -self.r[i + m]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bounds, Profile, Weights};
    use pinc_ad::check_gradient;

    fn problem() -> NmpcProblem {
        NmpcProblem {
            first: 2,
            last: 3,
            control: 2,
            controlled: vec![2, 0],
            weights: Weights { q: vec![3.0, 0.5], r: vec![1.0, 2.0], profile: Profile::Cumulative },
            state_bounds: Bounds::none(3),
            input_bounds: Bounds::none(2),
        }
    }

    /// J by its definition, for the problem above with T = 0.5.
    fn value(z: &[f64], targets: Targets<'_>) -> f64 {
        let mut sum = 0.0;
        for (j, w) in [(2, 1.0), (3, 0.5)] {
            let x = &z[(j - 1) * 3..j * 3];
            let reference = &targets.reference[(j - 1) * 2..j * 2];
            sum += w * 3.0 * (x[2] - reference[0]).powi(2);
            sum += w * 0.5 * (x[0] - reference[1]).powi(2);
        }
        let u = [targets.previous, &z[9..11], &z[11..13]];
        for (i, v) in [(1, 1.5), (2, 1.0)] {
            sum += v * (u[i][0] - u[i - 1][0]).powi(2);
            sum += v * 2.0 * (u[i][1] - u[i - 1][1]).powi(2);
        }
        sum
    }

    #[test]
    fn the_derivatives_are_those_of_the_definition() {
        let shape = Shape { states: 3, inputs: 2, stages: 3, moves: 2 };
        let cost = Cost::new(&problem(), shape, 0.5);
        let targets =
            Targets { reference: &[0.3, -0.2, 0.1, 0.7, -0.4, 0.9], previous: &[0.6, -1.1] };
        let z: Vec<f64> = (0..13).map(|i| f64::from(i * i % 7) - 2.0).collect();
        let mut gradient = vec![f64::NAN; 13];
        cost.gradient(&z, targets, &mut gradient);
        // J is quadratic: central differences are exact but for rounding, 1e-16/1e-5 of J's 1e2.
        check_gradient(|z| value(z, targets), &z, &gradient, 1e-8).unwrap();

        // So is the Hessian, column by column, as a difference of gradients.
        let mut dense = vec![vec![0.0; 13]; 13];
        (0..13).for_each(|v| {
            dense[v][v] = cost.curvature(v);
            if let Some((row, value)) = cost.coupling(v) {
                dense[row][v] = value;
                dense[v][row] = value;
            }
        });
        for v in 0..13 {
            let mut moved = z.clone();
            moved[v] += 1.0;
            let mut there = vec![f64::NAN; 13];
            cost.gradient(&moved, targets, &mut there);
            for row in 0..13 {
                let difference = there[row] - gradient[row];
                assert!((dense[row][v] - difference).abs() < 1e-13 * 100.0, "{row}, {v}");
            }
        }
    }
}
