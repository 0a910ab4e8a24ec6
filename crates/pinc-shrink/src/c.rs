//! A net with its check as C.

use crate::check::{Limit, Rater, size, urgency};
use crate::selftest::golden;
use crate::{Policy, PolicyNet};
use pinc_export::{Controller, ExportError, GeneratedFile, ModelSource, Name, lanes_to_c};
use pinc_mpc::Nmpc;
use std::fmt::Write as _;

/// The files by how their names end, filled with names by `fill`.
const FILES: [(&str, &str); 3] = [
    ("policy.h", include_str!("../templates/policy.h")),
    ("policy.c", include_str!("../templates/policy.c")),
    ("policy_selftest.h", include_str!("../templates/policy_selftest.h")),
];

/// Returns `NAME_policy.h` and `NAME_policy.c`: the net and the check of its plans
/// ([`Checked`](crate::Checked)), without a quadratic program and without branches that depend on
/// numbers; and `NAME_policy_selftest.h`, which compares both with golden decisions. They use the header
/// of the exported `controller`'s model, and the source of a net; `nmpc` is the same controller.
///
/// # Errors
///
/// [`ExportError`] if the model cannot be written as C.
pub fn policy_to_c(
    policy: &Policy,
    nmpc: &mut Nmpc,
    controller: &Controller<'_>,
    name: &Name,
) -> Result<[GeneratedFile; 3], ExportError> {
    let functions = lanes_to_c(controller)?;
    let problem = nmpc.problem().clone();
    let dims = nmpc.model().dims();
    let (inputs, horizon) = (problem.control_horizon * dims.nu, problem.horizon);
    let rater = Rater::new(nmpc);
    let mut tables = Tables::default();
    tables.numbers("weights", &weights(&policy.net), " + PINC_BLOCK");
    let outputs = problem.tracked.len();
    let count = if problem.uses_outputs() { dims.ny } else { 0 };
    tables.matrices("q", &rater.q, outputs);
    tables.matrices("r", &rater.r, dims.nu);
    tables.places("tracked", &rater.tracked);
    let stages = &rater.limits;
    let is_bounded = |i: &usize| {
        stages.iter().any(|stage| stage[*i].low.is_finite() || stage[*i].high.is_finite())
    };
    let bounded = (0..stages[0].len()).filter(is_bounded);
    let (starts, ends): (Vec<_>, Vec<_>) = bounded.partition(|i| stages[0][*i].at_start);
    tables.count("BOUNDED_ENDS", ends.len());
    tables.count("BOUNDED", ends.len() + starts.len());
    let bounded = [ends, starts].concat();
    tables.places("bounded", &bounded.iter().map(|i| stages[0][*i].place).collect::<Vec<_>>());
    let scale = |j: usize, of: &Limit| urgency(horizon, j + 1) / size(of.low, of.high);
    for (name, of) in [
        ("low", &(|_, of: &Limit| of.low) as &dyn Fn(usize, &Limit) -> f64),
        ("high", &|_, of: &Limit| of.high),
        ("scale", &scale),
    ] {
        let rows = stages.iter().enumerate();
        let values = rows.flat_map(|(j, stage)| bounded.iter().map(move |i| of(j, &stage[*i])));
        tables.numbers(&format!("bound_{name}"), &values.collect::<Vec<_>>(), "");
    }
    for (name, bounds) in
        [("input", &policy.limits.bounds), ("increment", &policy.limits.increments)]
    {
        tables.numbers(&format!("{name}_low"), &bounds.low, "");
        tables.numbers(&format!("{name}_high"), &bounds.high, "");
    }
    let widths = &policy.net.layers.widths;
    let list: Vec<String> = widths.iter().map(ToString::to_string).collect();
    let model = match controller.model {
        ModelSource::RungeKutta(model) => model.method.name(),
        _ => "net",
    };
    let golden = golden(policy, nmpc, controller);
    let fill = |text: &str| {
        let pairs = [
            ("@GOLDEN@", golden.as_str()),
            ("@FUNCTIONS@", &functions),
            ("@TABLES@", &tables.text),
            ("@MODEL@", model),
            ("@OUTPUTS@", &count.to_string()),
            ("@LAYERS@", &widths.len().to_string()),
            ("@WIDTHS@", &list.join(", ")),
            ("@WIDEST@", &widths.iter().max().copied().unwrap_or(1).to_string()),
            ("@HORIZON@", &horizon.to_string()),
            ("@CONTROLS@", &problem.control_horizon.to_string()),
            ("@INPUTS@", &inputs.to_string()),
            ("@TRACKED@", &outputs.to_string()),
            ("PINC_", &format!("{}_", name.as_str().to_uppercase())),
            ("pinc_", &format!("{}_", name.as_str())),
        ];
        pairs.iter().fold(text.to_owned(), |text, (key, value)| text.replace(key, value))
    };
    Ok(FILES.map(|(ending, text)| GeneratedFile {
        path: format!("{}_{ending}", name.as_str()),
        bytes: fill(text).into_bytes(),
    }))
}

/// Layer by layer the biases and then, input by input, the weights; the scales of inputs and outputs
/// are part of the first and the last layer.
fn weights(PolicyNet { layers: net, inputs, outputs, .. }: &PolicyNet) -> Vec<f64> {
    let (mut all, mut first, last) = (Vec::new(), 0, net.widths.len() - 2);
    for (layer, pair) in net.widths.windows(2).enumerate() {
        let (n, m) = (pair[0], pair[1]);
        let (matrix, biases) = net.weights[first..first + (n + 1) * m].split_at(n * m);
        first += (n + 1) * m;
        let (mut matrix, mut biases) = (matrix.to_vec(), biases.to_vec());
        for (row, bias) in matrix.chunks_exact_mut(n).zip(&mut biases) {
            let scales = inputs.middle.iter().zip(&inputs.half).filter(|_| layer == 0);
            for (weight, (middle, half)) in row.iter_mut().zip(scales) {
                *weight /= half;
                *bias -= *weight * middle;
            }
        }
        let scales = outputs.middle.iter().zip(&outputs.half).filter(|_| layer == last);
        for ((row, bias), (middle, half)) in matrix.chunks_exact_mut(n).zip(&mut biases).zip(scales)
        {
            row.iter_mut().for_each(|weight| *weight *= half);
            *bias = middle + half * *bias;
        }
        all.extend_from_slice(&biases);
        all.extend((0..n).flat_map(|k| matrix.iter().skip(k).step_by(n).copied()));
    }
    all
}

/// The tables of the source.
#[derive(Debug, Default)]
pub(crate) struct Tables {
    pub(crate) text: String,
}

impl Tables {
    pub(crate) fn count(&mut self, name: &str, count: usize) {
        let _ = writeln!(self.text, "#define {name} {count}");
    }

    /// A table of `rows`, at least one; C has none of length 0.
    pub(crate) fn table(&mut self, (kind, name, more): (&str, &str, &str), values: &[String]) {
        let _ =
            writeln!(self.text, "static const {kind} {name}[{}{more}] = {{", values.len().max(1));
        for row in values.chunks(4) {
            let _ = writeln!(self.text, "    {},", row.join(", "));
        }
        self.text += if values.is_empty() { "    0,\n};\n" } else { "};\n" };
    }

    /// Numbers that C reads as the same, with zeros behind them: as many as `more` adds to the length.
    /// Infinite ones become huge.
    fn numbers(&mut self, name: &str, values: &[f64], more: &str) {
        let number = |value: &f64| {
            let value = if value.is_finite() { *value } else { 1e30_f64.copysign(*value) };
            format!("PINC_N({value:e})")
        };
        self.table(("PINC_REAL", name, more), &values.iter().map(number).collect::<Vec<_>>());
    }

    fn places(&mut self, name: &str, places: &[usize]) {
        let texts: Vec<String> = places.iter().map(ToString::to_string).collect();
        self.table(("int", name, ""), &texts);
    }

    /// The entries that are not 0 in all of these matrices, and their rows and columns.
    fn matrices(&mut self, name: &str, matrices: &[Vec<f64>], width: usize) {
        let is_there = |at: &usize| matrices.iter().any(|matrix| matrix[*at] != 0.0);
        let there: Vec<usize> = (0..width * width).filter(is_there).collect();
        let entries = matrices.iter().flat_map(|matrix| there.iter().map(|at| matrix[*at]));
        self.count(&format!("{}_ENTRIES", name.to_uppercase()), there.len());
        self.numbers(name, &entries.collect::<Vec<_>>(), "");
        self.places(&format!("{name}_row"), &there.iter().map(|at| at / width).collect::<Vec<_>>());
        self.places(
            &format!("{name}_column"),
            &there.iter().map(|at| at % width).collect::<Vec<_>>(),
        );
    }
}
