//! One evaluation of loss and gradient as a file, for comparison with other programs.
//!
//! It is a model file (a `model.safetensors` with the net's tensors and metadata) with more tensors,
//! all f64:
//!
//! - `points.collocation`, `points.initial`: (t, y0, u) row by row;
//! - `loss.lambda` `[1]`, `loss.residual_scale`, `loss.initial_scale` (one factor per state);
//! - `loss.terms`: `MSE_y` and lambda `MSE_F`;
//! - `loss.gradient`: the derivative of the sum of the terms in the parameters, layer by layer, each
//!   layer's weights row by row, then its biases.
//!
//! The metadata also has `plant`.

use super::cases::Case;
use super::kernel::Evaluation;
use pinc_net::{Points, Workers};
use pinc_record::write_atomically;
use pinc_runs::RunError;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors};
use std::path::Path;

/// Writes `evaluation`, with its result, to `path`.
pub(super) fn write(path: &Path, case: Case, evaluation: &Evaluation) -> Result<(), RunError> {
    let parameters = evaluation.net.mlp().parameters();
    let mut gradient = vec![0.0; parameters.len()];
    let terms = evaluation.batch_loss(&Workers::new(0)?).loss_gradient(parameters, &mut gradient);
    let weights = &evaluation.weights;
    let tensors = [
        points("points.collocation", &evaluation.collocation),
        points("points.initial", &evaluation.initial),
        vector("loss.lambda", &[weights.lambda]),
        vector("loss.residual_scale", &weights.residual_scale),
        vector("loss.initial_scale", &weights.initial_scale),
        vector("loss.terms", &[terms.data, terms.physics]),
        vector("loss.gradient", &gradient),
    ];
    let bytes = container(&evaluation.net.to_bytes(), &tensors, case)
        .expect("a net's own file, and tensors whose shapes fit their data");
    Ok(write_atomically(path, &bytes)?)
}

/// A named tensor.
struct Tensor {
    name: &'static str,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

fn vector(name: &'static str, values: &[f64]) -> Tensor {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    Tensor { name, shape: vec![values.len()], bytes }
}

fn points(name: &'static str, points: &Points) -> Tensor {
    let row = |i| {
        let variables = points.state(i).iter().chain(points.input(i));
        std::iter::once(points.time(i)).chain(variables.copied())
    };
    let values: Vec<f64> = (0..points.len()).flat_map(row).collect();
    let columns = values.len() / points.len();
    Tensor { shape: vec![points.len(), columns], ..vector(name, &values) }
}

/// The model file `net` with more tensors.
fn container(net: &[u8], tensors: &[Tensor], case: Case) -> Result<Vec<u8>, SafeTensorError> {
    let (_, header) = SafeTensors::read_metadata(net)?;
    let mut metadata = header.metadata().clone().unwrap_or_default();
    metadata.insert("plant".to_owned(), case.name().to_owned());
    let mut all: Vec<(String, TensorView<'_>)> = SafeTensors::deserialize(net)?.tensors();
    for tensor in tensors {
        let view = TensorView::new(Dtype::F64, tensor.shape.clone(), &tensor.bytes)?;
        all.push((tensor.name.to_owned(), view));
    }
    safetensors::serialize(all, Some(metadata))
}
