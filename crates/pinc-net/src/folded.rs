//! A net at t = T as plain layers.

use crate::{Ansatz, NetError, PincNet, TrainingTarget};

/// The layers of a net at t = T, with both normalizers and T folded into weights and biases: what
/// is left of the net for a controller, and for other programs that are to compute it.
///
/// With z = W v + b and v = ((t, y0, u, p) - mean)/std, the first layer becomes W' (y0, u, p) + b'
/// with
///
/// ```text
/// W'_j = W_j / std_j                 b' = b + W_t (T - mean_t) / std_t - sum_j W'_j mean_j
/// ```
///
/// and the output layer d = `output_mean` + `output_std` (W a + b) likewise. At t = T both ansatzes
/// are d, or y0 + d.
#[derive(Clone, Debug, PartialEq)]
pub struct FoldedNet {
    /// The hidden layers, each followed by tanh, and the output layer.
    pub layers: Vec<PlainLayer>,
    /// The change of the first layer's biases per second of t: at another t they are
    /// b' + `time` (t - T).
    pub time: Vec<f64>,
    /// Whether the state is y0 + (t/T) d instead of d.
    pub adds_initial_state: bool,
}

/// A layer z = W v + b.
#[derive(Clone, Debug, PartialEq)]
pub struct PlainLayer {
    /// W, row by row, `[outputs][inputs]`.
    pub weights: Vec<Vec<f64>>,
    /// b, `outputs`.
    pub bias: Vec<f64>,
}

impl FoldedNet {
    /// The layers of `net`.
    ///
    /// # Errors
    ///
    /// [`NetError::OneScenario`] for a conventional PINN, whose state depends on neither x nor u.
    pub fn new(net: &PincNet) -> Result<Self, NetError> {
        Self::at(net, net.sample_time_s)
    }

    /// The layers of `net` at t = `t`, of which d is the state, or its change, there: what
    /// [`FoldedNet::new`] is for T.
    ///
    /// # Errors
    ///
    /// [`NetError::OneScenario`] for a conventional PINN; [`NetError::Time`] if `t` is not in
    /// (0, T], or not T for a distilled net.
    pub(crate) fn at(net: &PincNet, t: f64) -> Result<Self, NetError> {
        if net.time_only.is_some() {
            return Err(NetError::OneScenario);
        }
        let end = net.sample_time_s;
        let is_end = t.total_cmp(&end).is_eq();
        if net.source == TrainingTarget::Integrator && !is_end {
            return Err(NetError::Time { t, known: format!("{end} s alone, being distilled") });
        }
        if !(t > 0.0 && t <= end) {
            return Err(NetError::Time { t, known: format!("up to {end} s") });
        }
        let parameters = net.mlp.parameters();
        let plain = net.mlp.layers().map(|layer| PlainLayer {
            weights: parameters[layer.weight]
                .chunks_exact(layer.inputs)
                .map(<[f64]>::to_vec)
                .collect(),
            bias: parameters[layer.bias].to_vec(),
        });
        let mut layers: Vec<_> = plain.collect();
        let mut time = fold_input(net, t, &mut layers[0]);
        let last = layers.len() - 1;
        fold_output(net, t, &mut layers[last]);
        if last == 0 {
            time.iter_mut().zip(&net.output.std).for_each(|(w, std)| *w *= std);
        }
        Ok(Self { layers, time, adds_initial_state: net.ansatz == Ansatz::HardLinear })
    }
}

/// From weights of the normalized (t, y0, u, p) to weights of (y0, u, p) at `t`; returns the
/// weights of t, per second.
fn fold_input(net: &PincNet, t: f64, layer: &mut PlainLayer) -> Vec<f64> {
    let fold = |(row, bias): (&mut Vec<f64>, &mut f64)| {
        let scaled = row.iter().zip(&net.input.std).map(|(w, std)| w / std);
        let mut scaled: Vec<f64> = scaled.collect();
        *bias += scaled[0] * t;
        for (w, mean) in scaled.iter().zip(&net.input.mean) {
            *bias -= w * mean;
        }
        *row = scaled.split_off(1);
        scaled[0]
    };
    layer.weights.iter_mut().zip(&mut layer.bias).map(fold).collect()
}

/// From the normalized output to the states' units, and to the part of d that counts at `t`.
fn fold_output(net: &PincNet, t: f64, layer: &mut PlainLayer) {
    let part = if net.ansatz == Ansatz::HardLinear { t / net.sample_time_s } else { 1.0 };
    for (i, (row, bias)) in layer.weights.iter_mut().zip(&mut layer.bias).enumerate() {
        let (mean, std) = (part * net.output.mean[i], part * net.output.std[i]);
        for w in row {
            *w *= std;
        }
        *bias = *bias * std + mean;
    }
}
