//! A net of tanh layers, with the derivative along one direction, and their gradients in the
//! weights.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// A net with a linear last layer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Net {
    /// Neurons of each layer, inputs and outputs included.
    pub(crate) widths: Vec<usize>,
    /// Layer by layer: the matrix row by row, then the biases.
    pub(crate) weights: Vec<f64>,
}

/// The values of all layers at one point, and their derivatives along a direction.
#[derive(Clone, Debug)]
pub(crate) struct Pass {
    values: Vec<Vec<f64>>,
    tangents: Vec<Vec<f64>>,
    /// W t before the nonlinearity.
    sums: Vec<Vec<f64>>,
    /// Adjoints of a layer's values and tangents.
    adjoints: [Vec<f64>; 2],
    below: [Vec<f64>; 2],
}

impl Net {
    /// A net with weights drawn as by Glorot and Bengio (2010).
    pub(crate) fn new(widths: Vec<usize>, random: &mut ChaCha8Rng) -> Self {
        let mut weights = Vec::new();
        for pair in widths.windows(2) {
            #[expect(clippy::cast_precision_loss, reason = "layers are small")]
            let most = (6.0 / (pair[0] + pair[1]) as f64).sqrt();
            weights.extend((0..pair[0] * pair[1]).map(|_| random.random_range(-most..most)));
            weights.extend(std::iter::repeat_n(0.0, pair[1]));
        }
        Self { widths, weights }
    }

    pub(crate) fn pass(&self) -> Pass {
        let layers = || self.widths.iter().map(|width| vec![0.0; *width]).collect();
        let widest = self.widths.iter().copied().max().unwrap_or(0);
        let wide = || [vec![0.0; widest], vec![0.0; widest]];
        Pass {
            values: layers(),
            tangents: layers(),
            sums: layers(),
            adjoints: wide(),
            below: wide(),
        }
    }

    /// Evaluates at `v` along `direction` with these weights.
    pub(crate) fn forward(&self, weights: &[f64], [v, direction]: [&[f64]; 2], pass: &mut Pass) {
        pass.values[0].copy_from_slice(v);
        pass.tangents[0].copy_from_slice(direction);
        let mut first = 0;
        for (layer, pair) in self.widths.windows(2).enumerate() {
            let (n, m) = (pair[0], pair[1]);
            let (matrix, biases) = weights[first..first + (n + 1) * m].split_at(n * m);
            let (below, above) = pass.values.split_at_mut(layer + 1);
            let (tangents_below, tangents) = pass.tangents.split_at_mut(layer + 1);
            for (i, row) in matrix.chunks_exact(n).enumerate() {
                let sum = biases[i] + dot(row, &below[layer]);
                let slope = dot(row, &tangents_below[layer]);
                pass.sums[layer + 1][i] = slope;
                let last = layer + 2 == self.widths.len();
                let value = if last { sum } else { sum.tanh() };
                above[0][i] = value;
                tangents[0][i] = if last { slope } else { (1.0 - value * value) * slope };
            }
            first += (n + 1) * m;
        }
    }

    /// Adds to `gradient` the gradient in the weights of a function of outputs and their
    /// derivatives, from its gradient in these, at the point of the last `forward`.
    pub(crate) fn backward(
        &self,
        weights: &[f64],
        by_outputs: [&[f64]; 2],
        pass: &mut Pass,
        gradient: &mut [f64],
    ) {
        for (adjoint, by) in pass.adjoints.iter_mut().zip(by_outputs) {
            adjoint[..by.len()].copy_from_slice(by);
        }
        let mut end = weights.len();
        for (layer, pair) in self.widths.windows(2).enumerate().rev() {
            let (n, m) = (pair[0], pair[1]);
            let first = end - (n + 1) * m;
            let last = layer + 2 == self.widths.len();
            pass.below.iter_mut().for_each(|part| part.fill(0.0));
            for i in 0..m {
                let [by_value, by_tangent] = [pass.adjoints[0][i], pass.adjoints[1][i]];
                let a = pass.values[layer + 1][i];
                // tanh'' = -2 tanh tanh'
                let slope = if last { 1.0 } else { 1.0 - a * a };
                let curved = if last { 0.0 } else { -2.0 * a * slope * pass.sums[layer + 1][i] };
                let (by_sum, by_slope) =
                    (by_value * slope + by_tangent * curved, by_tangent * slope);
                let row = first + i * n;
                let sums = gradient[row..row + n].iter_mut();
                let points = pass.values[layer].iter().zip(&pass.tangents[layer]);
                for (sum, (value, tangent)) in sums.zip(points) {
                    *sum += by_sum * value + by_slope * tangent;
                }
                gradient[first + n * m + i] += by_sum;
                for (k, weight) in weights[row..row + n].iter().enumerate() {
                    pass.below[0][k] += by_sum * weight;
                    pass.below[1][k] += by_slope * weight;
                }
            }
            std::mem::swap(&mut pass.adjoints, &mut pass.below);
            end = first;
        }
    }
}

impl Pass {
    pub(crate) fn outputs(&self) -> &[f64] {
        &self.values[self.values.len() - 1]
    }

    pub(crate) fn slopes(&self) -> &[f64] {
        &self.tangents[self.tangents.len() - 1]
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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
        let mut pass = net.pass();
        let function = |weights: &[f64], pass: &mut Pass| {
            net.forward(weights, [&v, &d], pass);
            dot(pass.outputs(), &by_values) + dot(pass.slopes(), &by_slopes)
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
