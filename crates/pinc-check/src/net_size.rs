//! The size of the net compared with the plant.

use crate::{Finding, Subject};
use pinc_net::NetConfig;

/// Layers of the usual net.
const LAYERS: usize = 3;

/// The fewest neurons that such a net has in a layer.
const FEWEST: usize = 20;

/// Neurons for each number that goes into the net, as far as there are few of these; beyond that
/// one for each.
const PER_INPUT: usize = 3;
const MORE_INPUTS: usize = 43;

/// A net with this many times the weights of the usual one is far too large.
const FAR_TOO_MANY: usize = 20;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(model) = &subject.experiment.model else { return Vec::new() };
    if model.time_only.is_some() || subject.experiment.training.is_none() {
        return Vec::new();
    }
    let dims = subject.experiment.dims();
    let usual = NetConfig {
        hidden_layers: LAYERS,
        neurons: usual_neurons(dims.nx + dims.nu + dims.np),
        ..model.clone()
    };
    let (weights, usual_weights) = (model.parameters(dims), usual.parameters(dims));
    let size = |net: &NetConfig, weights: usize| {
        let plural = if net.hidden_layers == 1 { "" } else { "s" };
        let (layers, neurons) = (net.hidden_layers, net.neurons);
        format!("{layers} layer{plural} of {neurons} neurons ({weights} weights)")
    };
    let (given, recommended) = (size(model, weights), size(&usual, usual_weights));
    let mut findings = vec![Finding::fact(
        "model",
        format!("a net of {given}; {recommended} are usual for a plant of this size"),
    )];
    if model.neurons < dims.nx {
        findings.push(
            Finding::warning(
                "model.neurons",
                format!("{} neurons for {} states are too few", model.neurons, dims.nx),
            )
            .because(format!(
                "what the net says of a step is a sum of {} vectors, one for each neuron of the \
                 last layer: the states can only go where these lead, in {} of {} directions",
                model.neurons, model.neurons, dims.nx
            ))
            .change(format!("neurons = {} and hidden_layers = {LAYERS}", usual.neurons)),
        );
    } else if weights > FAR_TOO_MANY * usual_weights {
        findings.push(
            Finding::warning(
                "model",
                format!("{weights} weights are far more than a plant of this size needs"),
            )
            .because(
                "the times of an iteration and of a control step grow with the weights, so \
                 that such a net is less accurate after the same time",
            )
            .change(format!("neurons = {} and hidden_layers = {LAYERS}", usual.neurons)),
        );
    }
    findings
}

/// The neurons of a layer for a net with so many states, inputs and parameters.
fn usual_neurons(inputs: usize) -> usize {
    let neurons = (PER_INPUT * inputs).min(inputs + MORE_INPUTS).max(FEWEST);
    neurons.next_multiple_of(4)
}

#[cfg(test)]
mod tests {
    use super::usual_neurons;

    /// The oscillator, the four tanks, the rod of 20 and of 100 parts.
    #[test]
    fn layers_grow_with_the_plant() {
        assert_eq!([3, 6, 21, 101].map(usual_neurons), [20, 20, 64, 144]);
    }
}
