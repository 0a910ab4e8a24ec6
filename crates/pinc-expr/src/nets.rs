//! Small nets inside the equations, written out as expressions.

use crate::error::{ExpressionError, ExpressionProblem};
use crate::{Equations, parser};
use pinc_ode::Variable;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::iter::once;

/// A small net with tanh layers in the equations of a plant, for what no equation is known of.
///
/// The weights of the net `drag` are the parameters `drag[1]`, `drag[2]` and so on, which `pinc
/// identify` finds with the others: layer by layer, for each neuron its bias, then one weight per
/// input. The last layer is linear and gives the outputs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetExpression {
    /// The inputs of the net, as expressions; scale them to the size of 1.
    pub inputs: Vec<String>,
    /// The names of its outputs, for use in expressions.
    pub outputs: Vec<String>,
    /// Neurons of each hidden layer.
    pub layers: Vec<usize>,
    /// CSV file with the weights, one a row below the header `weight`, relative to the config. A
    /// config that is written out has them in `parameters` instead. A net without weights gives 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<String>,
}

impl NetExpression {
    /// The number of weights, biases included.
    #[must_use]
    pub fn weight_count(&self) -> usize {
        self.sizes().windows(2).map(|of| (of[0] + 1) * of[1]).sum()
    }

    /// The number of inputs, of neurons of each hidden layer, and of outputs.
    fn sizes(&self) -> Vec<usize> {
        let layers = self.layers.iter().copied();
        once(self.inputs.len()).chain(layers).chain(once(self.outputs.len())).collect()
    }

    /// Weights with which the outputs are 0 and all neurons differ.
    fn start(&self) -> Vec<f64> {
        let (count, outputs) = (self.weight_count(), self.outputs.len());
        let last = outputs * (self.layers.last().copied().unwrap_or_default() + 1);
        // Multiples of the golden ratio are spread evenly.
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let spread = (1..).map(|k| 2.0 * (f64::from(k) * golden).fract() - 1.0);
        spread.take(count - last).chain(std::iter::repeat_n(0.0, last)).collect()
    }

    /// The names and expressions of its neurons, layer by layer from the inputs on.
    fn written_out(&self, name: &str) -> Vec<(String, String)> {
        let sizes = self.sizes();
        let of = |layer: usize, i: usize| format!("{name}_{layer}[{i}]");
        let inputs = self.inputs.iter().enumerate();
        let mut all: Vec<_> = inputs.map(|(i, text)| (of(0, i + 1), text.clone())).collect();
        let mut weight = 0;
        for (layer, pair) in sizes.windows(2).enumerate() {
            for neuron in 1..=pair[1] {
                let terms = (1..=pair[0])
                    .map(|i| format!(" + {name}[{}]*{}", weight + 1 + i, of(layer, i)));
                let sum = format!("{name}[{}]{}", weight + 1, terms.collect::<String>());
                weight += pair[0] + 1;
                all.push(match self.outputs.get(neuron - 1) {
                    Some(output) if layer + 2 == sizes.len() => (output.clone(), sum),
                    _ => (of(layer + 1, neuron), format!("tanh({sum})")),
                });
            }
        }
        all
    }
}

impl Equations {
    /// Gives nets without weights those with which their outputs are 0.
    pub fn add_net_weights(&mut self) {
        for (name, net) in &self.nets {
            if self.weights_of(name) == 0 {
                let weights = net.start().into_iter().enumerate();
                let named = weights.map(|(i, weight)| (format!("{name}[{}]", i + 1), weight));
                self.parameters.extend(named.collect::<Vec<_>>());
            }
        }
    }

    /// The names of the weights of a net; none if there is no such net.
    #[must_use]
    pub fn net_weights(&self, net: &str) -> Vec<String> {
        let count = self.nets.get(net).map_or(0, NetExpression::weight_count);
        (1..=count).map(|i| format!("{net}[{i}]")).collect()
    }

    fn weights_of(&self, net: &str) -> usize {
        let of = |name: &&String| Variable::split_name(name).is_some_and(|(base, _)| base == net);
        self.parameters.keys().filter(of).count()
    }

    /// The same equations with the nets as expressions of `let` and their weights as parameters.
    pub(crate) fn with_nets_written_out(&self) -> Result<Cow<'_, Self>, ExpressionError> {
        if self.nets.is_empty() {
            return Ok(Cow::Borrowed(self));
        }
        let mut plain = self.clone();
        plain.add_net_weights();
        let nets = std::mem::take(&mut plain.nets);
        for (name, net) in &nets {
            self.check_net(name, net)?;
            let found = plain.weights_of(name);
            if found != net.weight_count() {
                let problem = ExpressionProblem::Weights { found, expected: net.weight_count() };
                return Err(problem.at(format!("parameters.{name}")));
            }
            for (neuron, text) in net.written_out(name) {
                let first = format!("let.{neuron}");
                if plain.intermediates.insert(neuron.clone(), text).is_some() {
                    let key = self.key_in_a_net(&first);
                    return Err(ExpressionProblem::Duplicate { name: neuron, first }.at(key));
                }
            }
        }
        Ok(Cow::Owned(plain))
    }

    fn check_net(&self, name: &str, net: &NetExpression) -> Result<(), ExpressionError> {
        let lists = [("inputs", net.inputs.len()), ("outputs", net.outputs.len())];
        let lists = lists.into_iter().chain(once(("layers", net.layers.len())));
        if let Some((field, _)) = { lists }.find(|(_, length)| *length == 0) {
            return Err(ExpressionProblem::Empty.at(format!("nets.{name}.{field}")));
        }
        if let Some(i) = net.layers.iter().position(|&size| size == 0) {
            return Err(ExpressionProblem::Size(0).at(format!("nets.{name}.layers[{i}]")));
        }
        let inputs = self.nets.values().flat_map(|net| &net.inputs).map(String::as_str);
        let used: BTreeSet<_> = self.texts().chain(inputs).flat_map(parser::names).collect();
        match net.outputs.iter().position(|output| !used.contains(output.as_str())) {
            Some(i) => Err(ExpressionProblem::UnusedOutput.at(format!("nets.{name}.outputs[{i}]"))),
            None => Ok(()),
        }
    }

    /// The key of an input or output of a net, where `key` is the one of its expression.
    fn key_in_a_net(&self, key: &str) -> String {
        let of_a_net = || {
            let neuron = key.strip_prefix("let.")?;
            self.nets.iter().find_map(|(name, net)| {
                let place = |field, i: usize| format!("nets.{name}.{field}[{i}]");
                let first = format!("{name}_0");
                match Variable::split_name(neuron) {
                    Some((array, i)) if array == first => Some(place("inputs", i - 1)),
                    _ => Some(place("outputs", net.outputs.iter().position(|of| of == neuron)?)),
                }
            })
        };
        of_a_net().unwrap_or_else(|| key.to_owned())
    }

    /// An error about equations with their nets written out as one about the nets.
    pub(crate) fn explain_nets(&self, mut error: ExpressionError) -> ExpressionError {
        if !self.nets.is_empty() {
            error.key = self.key_in_a_net(&error.key);
        }
        error
    }
}
