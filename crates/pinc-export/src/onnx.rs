//! A net as an ONNX file.

use crate::error::finite;
use crate::net_c::{check_member, folded, single_rounding};
use crate::open::Open;
use crate::origin::Origin;
use crate::protobuf::Message;
use crate::{ExportError, GeneratedFile, Name};
use pinc_net::{FoldedNet, PincNet};

/// The versions of the format and of its operators: old enough for most runtimes.
const IR_VERSION: u64 = 8;
const OPERATORS: u64 = 17;

/// The type of an ONNX file's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32 bits, which all runtimes know.
    Single,
    /// 64 bits.
    Double,
}

/// The net as an ONNX file: inputs `x`, `[batch, n]`, and `u`, `[batch, m]`, output `x_next`,
/// `[batch, n]`. Normalization is folded into the weights. Its metadata says what the states and
/// inputs are, the domain, and how far 32 bits move each state at most, over points of the domain.
///
/// # Errors
///
/// [`ExportError::Net`] for a conventional PINN, which is no model; [`ExportError::Family`].
pub fn net_to_onnx(
    net: &PincNet,
    name: &Name,
    origin: &Origin,
    precision: Precision,
) -> Result<GeneratedFile, ExportError> {
    check_member(net)?;
    let folded = folded(net, Open::default())?;
    if precision == Precision::Single {
        for (l, layer) in folded.layers.iter().enumerate() {
            let what = format!("layer {} of the net, in 32 bits (use 64),", l + 1);
            let all = layer.weights.iter().flatten().chain(&layer.bias);
            #[expect(clippy::cast_possible_truncation, reason = "single precision was asked for")]
            let single: Vec<f64> = all.map(|v| f64::from(*v as f32)).collect();
            finite(what, &single)?;
        }
    }
    let ends: Vec<_> = net.domain().ends().collect();
    let rounding = match precision {
        Precision::Single => single_rounding(&folded, &ends),
        Precision::Double => Vec::new(),
    };
    let certificate = origin.proven.as_ref().map(|proven| match precision {
        Precision::Single => format!("{proven}; in 64 bits: 32 bits add what `rounding` says"),
        Precision::Double => proven.clone(),
    });
    let writer = Writer { precision };
    let mut model = Message::default()
        .number(1, IR_VERSION)
        .text(2, "pinc")
        .text(3, &origin.version)
        .message(7, &writer.graph(net, &folded, name))
        .message(8, &Message::default().text(1, "").number(2, OPERATORS));
    let list = |values: &[f64]| format!("{values:?}");
    let domain = net.domain();
    for (key, value) in [
        ("states", origin.state_list()),
        ("inputs", origin.input_list()),
        ("step_s", format!("{:?}", net.sample_time_s())),
        ("state_low", list(&domain.state_low)),
        ("state_high", list(&domain.state_high)),
        ("input_low", list(&domain.input_low)),
        ("input_high", list(&domain.input_high)),
        ("hash", origin.hash.clone()),
        ("certificate", certificate.unwrap_or_default()),
        ("rounding", if rounding.is_empty() { String::new() } else { list(&rounding) }),
    ] {
        if value.is_empty() {
            continue;
        }
        model = model.message(14, &Message::default().text(1, key).text(2, &value));
    }
    Ok(GeneratedFile { path: format!("{}.onnx", name.as_str()), bytes: model.into_bytes() })
}

struct Writer {
    precision: Precision,
}

impl Writer {
    /// Concat, then a product, a sum and tanh per layer, and x added where the net gives a change.
    fn graph(&self, net: &PincNet, folded: &FoldedNet, name: &Name) -> Message {
        let dims = net.dims();
        let axis = Message::default().text(1, "axis").number(3, 1).number(20, 2);
        let mut graph = Message::default()
            .message(1, &node("Concat", &["x", "u"], "xu").message(5, &axis))
            .text(2, name.as_str());
        let mut from = "xu".to_owned();
        let last = folded.layers.len() - 1;
        for (l, layer) in folded.layers.iter().enumerate() {
            let (weights, bias) = (format!("weights_{l}"), format!("bias_{l}"));
            let (product, sum, value) =
                (format!("product_{l}"), format!("sum_{l}"), format!("layer_{l}"));
            let to = match (l == last, folded.adds_initial_state) {
                (true, false) => "x_next",
                _ => &sum,
            };
            graph = graph
                .message(1, &node("MatMul", &[&from, &weights], &product))
                .message(1, &node("Add", &[&product, &bias], to));
            if l < last {
                graph = graph.message(1, &node("Tanh", &[&sum], &value));
                from = value;
            } else if folded.adds_initial_state {
                graph = graph.message(1, &node("Add", &["x", &sum], "x_next"));
            }
            let (inputs, outputs) = (layer.weights[0].len(), layer.bias.len());
            let columns = (0..inputs).flat_map(|k| layer.weights.iter().map(move |row| row[k]));
            let transposed: Vec<f64> = columns.collect();
            graph = graph
                .message(5, &self.tensor(&weights, &[inputs, outputs], &transposed))
                // A row, as do-mpc reads it.
                .message(5, &self.tensor(&bias, &[1, outputs], &layer.bias));
        }
        graph
            .message(11, &self.value("x", dims.nx))
            .message(11, &self.value("u", dims.nu))
            .message(12, &self.value("x_next", dims.nx))
    }

    fn data_type(&self) -> u64 {
        match self.precision {
            Precision::Single => 1,
            Precision::Double => 11,
        }
    }

    fn tensor(&self, name: &str, shape: &[usize], values: &[f64]) -> Message {
        #[expect(clippy::cast_possible_truncation, reason = "single precision was asked for")]
        let raw: Vec<u8> = match self.precision {
            Precision::Single => values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect(),
            Precision::Double => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        };
        let sized = shape.iter().fold(Message::default(), |m, &size| m.number(1, size as u64));
        sized.number(2, self.data_type()).text(8, name).bytes(9, &raw)
    }

    /// An input or output, `[batch, width]`.
    fn value(&self, name: &str, width: usize) -> Message {
        let shape = Message::default()
            .message(1, &Message::default().text(2, "batch"))
            .message(1, &Message::default().number(1, width as u64));
        let tensor = Message::default().number(1, self.data_type()).message(2, &shape);
        Message::default().text(1, name).message(2, &Message::default().message(1, &tensor))
    }
}

/// A node named after its output.
fn node(operator: &str, inputs: &[&str], output: &str) -> Message {
    let named = inputs.iter().fold(Message::default(), |node, input| node.text(1, input));
    named.text(2, output).text(3, &format!("make_{output}")).text(4, operator)
}
