//! The multilayer perceptron, in its readable form.

use pinc_ad::Scalar;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::ops::Range;

/// Size of a perceptron: `hidden_layers` layers of `neurons` each, then a linear output layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MlpConfig {
    /// Length of the input.
    pub(crate) inputs: usize,
    /// Number of hidden layers; "4 layers of 20" has `hidden_layers` 4.
    pub(crate) hidden_layers: usize,
    /// Neurons in each hidden layer.
    pub(crate) neurons: usize,
    /// Length of the output.
    pub(crate) outputs: usize,
}

impl MlpConfig {
    fn widths(self) -> Vec<usize> {
        let mut widths = vec![self.inputs];
        widths.resize(1 + self.hidden_layers, self.neurons);
        widths.push(self.outputs);
        widths
    }

    /// The number of weights and biases.
    pub(crate) fn parameters(self) -> usize {
        parameter_count(&self.widths())
    }
}

/// A multilayer perceptron with tanh hidden layers and a linear output layer:
///
/// ```text
/// z = W_L tanh(.. tanh(W_0 v + b_0) ..) + b_L
/// ```
///
/// The parameters lie in one vector, layer by layer: the weight matrix (shape `[out, in]`, row by
/// row), then the bias (shape `[out]`).
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    widths: Vec<usize>,
    parameters: Vec<f64>,
}

/// Place and shape of one layer's parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Layer {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) weight: Range<usize>,
    pub(crate) bias: Range<usize>,
}

impl Mlp {
    /// A perceptron with Glorot (Xavier) normal weights, variance 2/(in + out), and biases 0, as in
    /// the paper's Algorithm 1.
    pub(crate) fn glorot_normal(config: MlpConfig, rng: &mut impl rand::Rng) -> Self {
        let widths = config.widths();
        let mut parameters = vec![0.0; parameter_count(&widths)];
        for layer in layers(&widths) {
            let deviation = (2.0 / to_f64(layer.inputs + layer.outputs)).sqrt();
            for weight in &mut parameters[layer.weight] {
                *weight = deviation * rng.sample::<f64, _>(StandardNormal);
            }
        }
        Self { widths, parameters }
    }

    /// A perceptron of these widths (input, hidden layers, output) with these parameters; `None` if
    /// their number does not fit.
    pub(crate) fn from_parts(widths: Vec<usize>, parameters: Vec<f64>) -> Option<Self> {
        let fits = widths.len() >= 2 && parameters.len() == parameter_count(&widths);
        fits.then_some(Self { widths, parameters })
    }

    /// The perceptron of the first `kept` inputs, the others having the values `fixed`, which go
    /// into the biases.
    pub(crate) fn with_inputs_fixed(&self, kept: usize, fixed: &[f64]) -> Self {
        let mut layers = self.layers();
        let first = layers.next().expect("there is a layer");
        let rows = || self.parameters[first.weight.clone()].chunks_exact(first.inputs);
        let biases = rows().zip(&self.parameters[first.bias.clone()]).map(|(row, bias)| {
            row[kept..].iter().zip(fixed).fold(*bias, |bias, (w, value)| w.mul_add(*value, bias))
        });
        let rest = &self.parameters[first.bias.end..];
        let parameters = rows().flat_map(|row| &row[..kept]).copied();
        let parameters = parameters.chain(biases).chain(rest.iter().copied()).collect();
        let mut widths = self.widths.clone();
        widths[0] = kept;
        Self { widths, parameters }
    }

    /// Lengths of the input, of each hidden layer and of the output.
    #[must_use]
    pub fn widths(&self) -> &[usize] {
        &self.widths
    }

    /// All weights and biases.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// All weights and biases, to be changed.
    pub fn parameters_mut(&mut self) -> &mut [f64] {
        &mut self.parameters
    }

    /// Place and shape of each layer's parameters.
    pub(crate) fn layers(&self) -> impl DoubleEndedIterator<Item = Layer> + ExactSizeIterator {
        layers(&self.widths)
    }

    /// The output for the input `v`, over any scalar, with `parameters` in place of the net's own.
    ///
    /// This is the specification of the net: with `Dual<Var>` it gives time derivatives inside
    /// gradients in the weights. The batched kernel does the same work fast, and a test holds them
    /// together.
    ///
    /// # Shapes
    ///
    /// `parameters`: as many as the net has; `v`: `widths[0]`; the result: the last of `widths`.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn forward<S: Scalar>(&self, parameters: &[S], v: &[S]) -> Vec<S> {
        assert_eq!(v.len(), self.widths[0], "length of the input");
        assert_eq!(parameters.len(), self.parameters.len(), "number of parameters");
        let mut a = v.to_vec();
        let last = self.widths.len() - 2;
        for (i, layer) in self.layers().enumerate() {
            let rows = parameters[layer.weight].chunks_exact(layer.inputs);
            a = rows
                .zip(&parameters[layer.bias])
                .map(|(row, &bias)| {
                    let z = row.iter().zip(&a).fold(bias, |z, (&w, &a)| w.mul_add(a, z));
                    if i == last { z } else { z.tanh() }
                })
                .collect();
        }
        a
    }
}

fn layers(widths: &[usize]) -> impl DoubleEndedIterator<Item = Layer> + ExactSizeIterator {
    let mut start = 0;
    let places: Vec<_> = widths
        .windows(2)
        .map(|pair| {
            let (inputs, outputs) = (pair[0], pair[1]);
            let weight = start..start + inputs * outputs;
            let bias = weight.end..weight.end + outputs;
            start = bias.end;
            Layer { inputs, outputs, weight, bias }
        })
        .collect();
    places.into_iter()
}

fn parameter_count(widths: &[usize]) -> usize {
    widths.windows(2).map(|pair| (pair[0] + 1) * pair[1]).sum()
}

pub(crate) fn to_f64(n: usize) -> f64 {
    n as f64
}
