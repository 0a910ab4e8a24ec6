//! A model of the states with outputs of its own.

use crate::{Dims, Gradients, Linearization, Model, OutputLinearization, Stages};

/// A model of the states, as a net is one, with the outputs y = h(x, u, p) of the plant's own
/// equation.
#[derive(Debug)]
pub struct WithOutputs<M> {
    states: M,
    outputs: Box<dyn Model>,
}

impl<M: Model> WithOutputs<M> {
    /// `states` with the outputs of `outputs`, which is of the same states, inputs and parameters.
    pub fn new(states: M, outputs: Box<dyn Model>) -> Self {
        Self { states, outputs }
    }
}

impl<M: Model> Model for WithOutputs<M> {
    fn dims(&self) -> Dims {
        self.states.dims().with_outputs(self.outputs.dims().ny)
    }

    fn sample_time_s(&self) -> f64 {
        self.states.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.states.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.states.linearize(at, out);
    }

    fn pull_back(&mut self, at: Stages<'_>, weights: &[f64], out: Gradients<'_>) -> bool {
        self.states.pull_back(at, weights, out)
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.outputs.output(x, u, p, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        self.outputs.feedthrough()
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.outputs.linearize_output(at, out);
    }
}
