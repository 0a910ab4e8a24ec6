//! A net of tanh layers, with the derivative along one direction, and their gradients in the
//! weights.

use pinc_ad::Scalar;
use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// A net with a linear last layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Net {
    /// Neurons of each layer, inputs and outputs included.
    pub(crate) widths: Vec<usize>,
    /// Layer by layer: the matrix row by row, then the biases.
    pub(crate) weights: Vec<f64>,
}

/// The values of all layers, and their derivatives along a direction: at one point, or at one for
/// each lane of a vector.
#[derive(Clone, Debug)]
pub(crate) struct Pass<S> {
    values: Vec<Vec<S>>,
    tangents: Vec<Vec<S>>,
    /// W t before the nonlinearity.
    sums: Vec<Vec<S>>,
    /// Adjoints of a layer's values and tangents.
    adjoints: [Vec<S>; 2],
    below: [Vec<S>; 2],
}

impl Net {
    /// A net with weights drawn as by Glorot and Bengio (2010).
    pub(crate) fn new(widths: Vec<usize>, random: &mut ChaCha8Rng) -> Self {
        let mut weights = Vec::new();
        for pair in widths.windows(2) {
            let most = (6.0 / (pair[0] + pair[1]) as f64).sqrt();
            weights.extend((0..pair[0] * pair[1]).map(|_| random.random_range(-most..most)));
            weights.extend(std::iter::repeat_n(0.0, pair[1]));
        }
        Self { widths, weights }
    }

    pub(crate) fn pass<S: Scalar>(&self, zero: S) -> Pass<S> {
        let layers = || self.widths.iter().map(|width| vec![zero; *width]).collect();
        let widest = self.widths.iter().copied().max().unwrap_or(0);
        let wide = || [vec![zero; widest], vec![zero; widest]];
        Pass {
            values: layers(),
            tangents: layers(),
            sums: layers(),
            adjoints: wide(),
            below: wide(),
        }
    }

    /// Evaluates at `v` along `direction` with these weights.
    #[inline(always)]
    pub(crate) fn forward<S: Scalar>(
        &self,
        weights: &[f64],
        [v, direction]: [&[S]; 2],
        pass: &mut Pass<S>,
    ) {
        pass.values[0].copy_from_slice(v);
        pass.tangents[0].copy_from_slice(direction);
        let mut first = 0;
        for (layer, pair) in self.widths.windows(2).enumerate() {
            let (n, m) = (pair[0], pair[1]);
            let (matrix, biases) = weights[first..first + (n + 1) * m].split_at(n * m);
            let (below, above) = pass.values.split_at_mut(layer + 1);
            let (tangents_below, tangents) = pass.tangents.split_at_mut(layer + 1);
            for (i, row) in matrix.chunks_exact(n).enumerate() {
                let zero = v[0].constant(0.0);
                let sum = dot(row, &below[layer], v[0].constant(biases[i]));
                let slope = dot(row, &tangents_below[layer], zero);
                pass.sums[layer + 1][i] = slope;
                let last = layer + 2 == self.widths.len();
                let value = if last { sum } else { sum.tanh() };
                above[0][i] = value;
                tangents[0][i] = if last { slope } else { slope - value * value * slope };
            }
            first += (n + 1) * m;
        }
    }

    /// Adds to `gradient` the gradient in the weights of a function of outputs and their
    /// derivatives, from its gradient in these, at the point of the last `forward`.
    #[inline(always)]
    pub(crate) fn backward<S: Scalar>(
        &self,
        weights: &[f64],
        by_outputs: [&[S]; 2],
        pass: &mut Pass<S>,
        gradient: &mut [S],
    ) {
        let zero = by_outputs[0][0].constant(0.0);
        let one = zero.constant(1.0);
        for (adjoint, by) in pass.adjoints.iter_mut().zip(by_outputs) {
            adjoint[..by.len()].copy_from_slice(by);
        }
        let mut end = weights.len();
        for (layer, pair) in self.widths.windows(2).enumerate().rev() {
            let (n, m) = (pair[0], pair[1]);
            let first = end - (n + 1) * m;
            let last = layer + 2 == self.widths.len();
            pass.below.iter_mut().for_each(|part| part.fill(zero));
            for i in 0..m {
                let [by_value, by_tangent] = [pass.adjoints[0][i], pass.adjoints[1][i]];
                let a = pass.values[layer + 1][i];
                // tanh'' = -2 tanh tanh'
                let slope = if last { one } else { one - a * a };
                let curved = if last { zero } else { a * slope * pass.sums[layer + 1][i] * -2.0 };
                let (by_sum, by_slope) =
                    (by_value * slope + by_tangent * curved, by_tangent * slope);
                let row = first + i * n;
                let sums = gradient[row..row + n].iter_mut();
                let points = pass.values[layer].iter().zip(&pass.tangents[layer]);
                for (sum, (value, tangent)) in sums.zip(points) {
                    *sum = by_sum.mul_add(*value, by_slope.mul_add(*tangent, *sum));
                }
                let bias = &mut gradient[first + n * m + i];
                *bias = *bias + by_sum;
                let [values_below, tangents_below] = &mut pass.below;
                let below = values_below.iter_mut().zip(tangents_below);
                for ((value, tangent), weight) in below.zip(&weights[row..row + n]) {
                    let weight = zero.constant(*weight);
                    *value = by_sum.mul_add(weight, *value);
                    *tangent = by_slope.mul_add(weight, *tangent);
                }
            }
            std::mem::swap(&mut pass.adjoints, &mut pass.below);
            end = first;
        }
    }
}

impl<S> Pass<S> {
    pub(crate) fn outputs(&self) -> &[S] {
        &self.values[self.values.len() - 1]
    }

    pub(crate) fn slopes(&self) -> &[S] {
        &self.tangents[self.tangents.len() - 1]
    }
}

/// start + a' b
#[inline(always)]
fn dot<S: Scalar>(a: &[f64], b: &[S], start: S) -> S {
    a.iter().zip(b).fold(start, |sum, (a, b)| b.mul_add(start.constant(*a), sum))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    /// Values, derivatives along a direction and gradients in the weights agree with central
    /// differences.
    #[test]
    fn derivatives_match_differences() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let net = Net::new(vec![3, 5, 4, 2], &mut random);
        let mut drawn =
            |n: usize| -> Vec<f64> { (0..n).map(|_| random.random_range(-1.0..1.0)).collect() };
        let (v, d, by_values, by_slopes) = (drawn(3), drawn(3), drawn(2), drawn(2));
        let mut pass = net.pass(0.0);
        let function = |weights: &[f64], pass: &mut Pass<f64>| {
            net.forward(weights, [&v, &d], pass);
            dot(pass.outputs(), &by_values, dot(pass.slopes(), &by_slopes, 0.0))
        };
        let mut gradient = vec![0.0; net.weights.len()];
        function(&net.weights, &mut pass);
        let slopes = pass.slopes().to_vec();
        net.backward(&net.weights, [&by_values, &by_slopes], &mut pass, &mut gradient);
        let h = 1e-5;
        for (i, found) in gradient.iter().enumerate() {
            let mut at = |step: f64| {
                let mut weights = net.weights.clone();
                weights[i] += step;
                function(&weights, &mut pass)
            };
            let expected = (at(h) - at(-h)) / (2.0 * h);
            assert!((found - expected).abs() < 1e-8, "weight {i}: {found} is not {expected}");
        }
        let mut moved = |step: f64| -> Vec<f64> {
            let at: Vec<f64> = v.iter().zip(&d).map(|(v, d)| v + step * d).collect();
            net.forward(&net.weights, [&at, &d], &mut pass);
            pass.outputs().to_vec()
        };
        let (up, down) = (moved(h), moved(-h));
        for (i, found) in slopes.iter().enumerate() {
            let expected = (up[i] - down[i]) / (2.0 * h);
            assert!((found - expected).abs() < 1e-8, "output {i}: {found} is not {expected}");
        }
    }
}
