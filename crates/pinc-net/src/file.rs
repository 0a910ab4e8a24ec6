//! The model file: a safetensors container with the tensors of the perceptron and a JSON
//! description.

use crate::{
    Ansatz, Domain, Mlp, ModelError, Normalizer, ParameterRange, PincNet, Scenario, TrainingTarget,
};
use pinc_ode::Dims;
use safetensors::{Dtype, SafeTensorError, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

const FORMAT: &str = "pinc-model";
/// The metadata key of the certificate, which is left out without one.
const CERTIFICATE: &str = "certificate";
/// The format versions of nets of one plant, and of nets that take parameters as inputs.
const VERSIONS: [&str; 2] = ["1", "2"];
const ACTIVATION: &str = "tanh";

/// The JSON text under the metadata key `model`.
#[derive(Debug, Serialize, Deserialize)]
struct Description {
    states: Vec<String>,
    inputs: Vec<String>,
    /// In version 2 only.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    parameters: Vec<String>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    units: BTreeMap<String, String>,
    #[serde(rename = "horizon_s")]
    sample_time_s: f64,
    activation: String,
    ansatz: Ansatz,
    input_mean: Vec<f64>,
    input_std: Vec<f64>,
    output_mean: Vec<f64>,
    output_std: Vec<f64>,
    skip: Value,
    domain: DomainBox,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    time_only: Option<Scenario>,
    #[serde(default, skip_serializing_if = "is_physics")]
    source: TrainingTarget,
}

fn is_physics(source: &TrainingTarget) -> bool {
    *source == TrainingTarget::Physics
}

/// The box that the net was trained on. Written as `Flat`; the other ways to write it are read too.
#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
enum DomainBox {
    /// Ends of the states, then of the inputs, then of the parameters.
    Flat { low: Vec<f64>, high: Vec<f64> },
    /// As in a config.
    Named(Domain),
    /// States and inputs apart.
    Nested { states: Ends, inputs: Ends },
}

#[derive(Debug, Serialize, Deserialize)]
struct Ends {
    low: Vec<f64>,
    high: Vec<f64>,
}

impl DomainBox {
    /// The domain of a net with so many states and inputs and these parameters.
    fn into_domain(self, states: usize, inputs: usize, parameters: &[String]) -> Domain {
        match self {
            Self::Flat { low, high } => {
                let split = |ends: &[f64]| {
                    let (states, rest) = ends.split_at(states.min(ends.len()));
                    let (inputs, parameters) = rest.split_at(inputs.min(rest.len()));
                    [states, inputs, parameters].map(<[f64]>::to_vec)
                };
                let [[state_low, input_low, low], [state_high, input_high, high]] =
                    [split(&low), split(&high)];
                let ends = low.into_iter().zip(high).zip(parameters);
                let range = |((low, high), name): ((f64, f64), &String)| ParameterRange {
                    name: name.clone(),
                    low,
                    high,
                };
                let parameters = ends.map(range).collect();
                Domain { state_low, state_high, input_low, input_high, parameters }
            }
            Self::Named(domain) => domain,
            Self::Nested { states, inputs } => Domain {
                state_low: states.low,
                state_high: states.high,
                input_low: inputs.low,
                input_high: inputs.high,
                parameters: Vec::new(),
            },
        }
    }
}

impl PincNet {
    /// The net as the bytes of a model file. The same net gives the same bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let (low, high) = self.domain.ends().unzip();
        let parameters: Vec<_> = self.parameter_names().map(str::to_owned).collect();
        let version = VERSIONS[usize::from(!parameters.is_empty())];
        let description = Description {
            states: self.states.clone(),
            inputs: self.inputs.clone(),
            parameters,
            units: self.units.clone(),
            sample_time_s: self.sample_time_s,
            activation: ACTIVATION.into(),
            ansatz: self.ansatz,
            input_mean: self.input.mean.clone(),
            input_std: self.input.std.clone(),
            output_mean: self.output.mean.clone(),
            output_std: self.output.std.clone(),
            skip: Value::Bool(false),
            domain: DomainBox::Flat { low, high },
            time_only: self.time_only.clone(),
            source: self.source,
        };
        // The container is written by hand: the library's writer takes its metadata from a hash
        // map, so that the same net would give other bytes each time.
        let mut header = BTreeMap::new();
        let mut data = Vec::new();
        let mut metadata = BTreeMap::from([
            ("format", FORMAT.to_owned()),
            ("version", version.to_owned()),
            ("model", serde_json::json!(description).to_string()),
        ]);
        metadata.extend(self.certificate.iter().map(|text| (CERTIFICATE, text.clone())));
        header.insert("__metadata__".to_owned(), serde_json::json!(metadata));
        for (i, layer) in self.mlp.layers().enumerate() {
            let tensors = [
                ("weight", vec![layer.outputs, layer.inputs], layer.weight),
                ("bias", vec![layer.outputs], layer.bias),
            ];
            for (kind, shape, range) in tensors {
                let start = data.len();
                data.extend(self.mlp.parameters()[range].iter().flat_map(|v| v.to_le_bytes()));
                let place = [start, data.len()];
                let entry =
                    serde_json::json!({ "dtype": "F64", "shape": shape, "data_offsets": place });
                header.insert(format!("layers.{i}.{kind}"), entry);
            }
        }
        let mut text = serde_json::json!(header).to_string().into_bytes();
        text.resize(text.len().next_multiple_of(8), b' ');
        let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
        bytes.extend(text);
        bytes.extend(data);
        bytes
    }

    /// The net in the bytes of a model file, of this or another program.
    ///
    /// # Errors
    ///
    /// [`ModelError`] says which part is missing, damaged or contradicts another.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        let container = |error: SafeTensorError| ModelError::Container(error.into());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(container)?;
        let empty = std::collections::HashMap::new();
        let metadata = header.metadata().as_ref().unwrap_or(&empty);
        let entry = |key: &'static str, allowed: &[&str], expected: &'static str| {
            let found = metadata.get(key);
            if found.is_some_and(|v| allowed.is_empty() || allowed.contains(&v.as_str())) {
                return Ok(found.map_or("", String::as_str));
            }
            let found = found.map_or("missing".to_owned(), |v| format!("\"{v}\""));
            Err(ModelError::Foreign { key, found, expected })
        };
        entry("format", &[FORMAT], FORMAT)?;
        let version = entry("version", &VERSIONS, "1 or 2")?;
        let description: Description = serde_json::from_str(entry("model", &[], "a JSON text")?)
            .map_err(|error| ModelError::Description(error.into()))?;
        if version == VERSIONS[0] && !description.parameters.is_empty() {
            let (field, problem) = ("parameters", "are known from version 2 on");
            return Err(ModelError::Inconsistent { field, problem });
        }
        let net = description.into_net(&SafeTensors::deserialize(bytes).map_err(container)?)?;
        Ok(Self { certificate: metadata.get(CERTIFICATE).cloned(), ..net })
    }
}

impl Description {
    fn into_net(self, tensors: &SafeTensors<'_>) -> Result<PincNet, ModelError> {
        self.check()?;
        let (states, inputs) = (self.states.len(), self.inputs.len());
        let mlp = read_layers(tensors, self.features(), states)?;
        let domain = self.domain.into_domain(states, inputs, &self.parameters);
        let dims = Dims::new(states, inputs).with_parameters(self.parameters.len());
        let named = domain.parameters.iter().map(|range| &range.name).eq(&self.parameters);
        if !named || domain.validate(dims).is_err() {
            let (field, problem) = ("domain", "does not have a low and a higher end per variable");
            return Err(ModelError::Inconsistent { field, problem });
        }
        Ok(PincNet {
            mlp,
            ansatz: self.ansatz,
            sample_time_s: self.sample_time_s,
            input: Normalizer { mean: self.input_mean, std: self.input_std },
            output: Normalizer { mean: self.output_mean, std: self.output_std },
            domain,
            states: self.states,
            inputs: self.inputs,
            units: self.units,
            time_only: self.time_only,
            source: self.source,
            certificate: None,
        })
    }

    /// The length of the net's input.
    fn features(&self) -> usize {
        let variables = self.states.len() + self.inputs.len() + self.parameters.len();
        if self.time_only.is_some() { 1 } else { 1 + variables }
    }

    fn check(&self) -> Result<(), ModelError> {
        let fail = |field, problem| Err(ModelError::Inconsistent { field, problem });
        let states = self.states.len();
        if states == 0 {
            return fail("states", "names no state");
        }
        if self.activation != ACTIVATION {
            return fail("activation", "is not \"tanh\", the only one known");
        }
        if self.skip != Value::Bool(false) {
            return fail("skip", "is not false: nets with skip connections are not known");
        }
        if !(self.sample_time_s > 0.0 && self.sample_time_s.is_finite()) {
            return fail("horizon_s", "is not a positive number");
        }
        let features = self.features();
        for (field, values, length) in [
            ("input_mean", &self.input_mean, features),
            ("input_std", &self.input_std, features),
            ("output_mean", &self.output_mean, states),
            ("output_std", &self.output_std, states),
        ] {
            if values.len() != length {
                return fail(field, "does not have one number per variable");
            }
        }
        if self.input_std.iter().chain(&self.output_std).any(|&s| s <= 0.0) {
            return fail("input_std, output_std", "has a number that is not positive");
        }
        if let Some(Scenario { initial_state, input }) = &self.time_only
            && (initial_state.len() != states
                || input.len() != self.inputs.len()
                || !self.parameters.is_empty())
        {
            return fail("time_only", "does not have one number per state and input alone");
        }
        Ok(())
    }
}

/// The tensors `layers.0.weight`, `layers.0.bias`, .. up to the first that is missing; each layer's
/// length of input must be the one before's output, the last output one per state.
fn read_layers(tensors: &SafeTensors<'_>, inputs: usize, states: usize) -> Result<Mlp, ModelError> {
    let mut widths = vec![inputs];
    let mut parameters = Vec::new();
    let layers =
        (0..).take_while(|i| tensors.tensor(&format!("layers.{i}.weight")).is_ok()).count();
    for i in 0..layers.max(1) {
        let name = format!("layers.{i}.weight");
        let weight = tensors.tensor(&name).map_err(|_| missing(&name))?;
        let width = widths[i];
        let rows = match *weight.shape() {
            [rows, columns] if columns == width && rows > 0 => rows,
            ref shape => {
                let (found, expected) = (format!("shape {shape:?}"), format!("[_, {width}]"));
                return Err(ModelError::Tensor { name, found, expected });
            }
        };
        if i + 1 == layers && rows != states {
            let (found, expected) = (format!("{rows} rows"), format!("{states}, one per state"));
            return Err(ModelError::Tensor { name, found, expected });
        }
        parameters.extend(numbers(&name, &weight)?);
        let name = format!("layers.{i}.bias");
        let bias = tensors.tensor(&name).map_err(|_| missing(&name))?;
        if bias.shape() != [rows] {
            let (found, expected) = (format!("shape {:?}", bias.shape()), format!("[{rows}]"));
            return Err(ModelError::Tensor { name, found, expected });
        }
        parameters.extend(numbers(&name, &bias)?);
        widths.push(rows);
    }
    Mlp::from_parts(widths, parameters).ok_or_else(|| missing("layers"))
}

fn missing(name: &str) -> ModelError {
    let (name, found) = (name.to_owned(), "missing".to_owned());
    ModelError::Tensor { name, found, expected: "a tensor of f64".to_owned() }
}

fn numbers(name: &str, tensor: &TensorView<'_>) -> Result<Vec<f64>, ModelError> {
    let error = |found: String| ModelError::Tensor {
        name: name.to_owned(),
        found,
        expected: "finite numbers of type F64".to_owned(),
    };
    if tensor.dtype() != Dtype::F64 {
        return Err(error(format!("type {:?}", tensor.dtype())));
    }
    let (bytes, _) = tensor.data().as_chunks::<8>();
    let values: Vec<f64> = bytes.iter().map(|&b| f64::from_le_bytes(b)).collect();
    match values.iter().find(|v| !v.is_finite()) {
        Some(bad) => Err(error(bad.to_string())),
        None => Ok(values),
    }
}
