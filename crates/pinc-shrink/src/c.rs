//! A net with its check as C.

use crate::Policy;
use pinc_mpc::{Bounds, Nmpc, Tracked};
use std::fmt::Write as _;

/// The header and the source, filled with names by `fill`.
const HEADER: &str = include_str!("../templates/policy.h");
const SOURCE: &str = include_str!("../templates/policy.c");

/// Returns the content of `NAME_policy.h` and `NAME_policy.c`: the net and the check of its plans
/// ([`Checked`](crate::Checked)), without a quadratic program and without branches that depend on
/// numbers. `model` is the part of the exported model's name behind `NAME_`, as `rk4` or `net`: its
/// header and `NAME_rk4_step` are used.
#[must_use]
pub fn policy_to_c(policy: &Policy, nmpc: &mut Nmpc, name: &str, model: &str) -> [String; 2] {
    let problem = nmpc.problem().clone();
    let dims = nmpc.model().dims();
    let (inputs, horizon) = (problem.control_horizon * dims.nu, problem.horizon);
    let program = nmpc.program();
    let q = (1..=horizon).flat_map(|j| match j < problem.n1 {
        true => vec![0.0; problem.tracked.len().pow(2)],
        false => program.tracking_weight(j).iter().map(|q| 0.5 * q).collect(),
    });
    let r = (0..problem.control_horizon).flat_map(|i| {
        let r = problem.weights.r.at(i);
        (0..dims.nu * dims.nu).map(move |at| r.entry(at / dims.nu, at % dims.nu))
    });
    let mut tables = String::new();
    let mut array = |name: &str, values: &[f64]| {
        let _ = writeln!(tables, "static const PINC_REAL {name}[{}] = {{", values.len());
        for row in values.chunks(4) {
            let row: Vec<String> = row.iter().map(|value| number(*value)).collect();
            let _ = writeln!(tables, "    {},", row.join(", "));
        }
        tables += "};\n";
    };
    array("weights", &policy.net.weights);
    array("in_middle", &policy.inputs.middle);
    array("in_half", &policy.inputs.half);
    array("out_middle", &policy.outputs.middle);
    array("out_half", &policy.outputs.half);
    array("q", &q.collect::<Vec<_>>());
    array("r", &r.collect::<Vec<_>>());
    let all = |side: &[f64], count: usize| -> Vec<f64> {
        side.iter().cycle().take(count).copied().collect()
    };
    let Bounds { low, high } = &problem.state_bounds;
    let (low, high) = (all(low, horizon * dims.nx), all(high, horizon * dims.nx));
    let sizes: Vec<f64> =
        low.iter().zip(&high).map(|(low, high)| crate::check::size(*low, *high)).collect();
    array("state_low", &low);
    array("state_high", &high);
    array("state_size", &sizes);
    array("input_low", &policy.limits.bounds.low);
    array("input_high", &policy.limits.bounds.high);
    array("increment_low", &policy.limits.increments.low);
    array("increment_high", &policy.limits.increments.high);
    let mut values = String::new();
    for (i, tracked) in problem.tracked.iter().enumerate() {
        let place = match tracked {
            Tracked::State(state) => format!("x[{state}]"),
            Tracked::Input(input) => format!("u[{input}]"),
            // Refused by `shrink`.
            Tracked::Output(_) => "x[0]".to_owned(),
        };
        let _ = writeln!(values, "        error[{i}] = {place} - reference[{i}];");
    }
    let widths: Vec<String> = policy.net.widths.iter().map(ToString::to_string).collect();
    let widest = policy.net.widths.iter().max().copied().unwrap_or(1);
    let fill = |text: &str| {
        let pairs = [
            ("@TABLES@", tables.as_str()),
            ("@VALUES@", values.trim_end()),
            ("@MODEL@", model),
            ("@LAYERS@", &policy.net.widths.len().to_string()),
            ("@WIDTHS@", &widths.join(", ")),
            ("@WIDEST@", &widest.to_string()),
            ("@HORIZON@", &horizon.to_string()),
            ("@CONTROLS@", &problem.control_horizon.to_string()),
            ("@INPUTS@", &inputs.to_string()),
            ("@TRACKED@", &problem.tracked.len().to_string()),
            ("PINC_", &format!("{}_", name.to_uppercase())),
            ("pinc_", &format!("{name}_")),
        ];
        pairs.iter().fold(text.to_owned(), |text, (key, value)| text.replace(key, value))
    };
    [fill(HEADER), fill(SOURCE)]
}

/// A number that C reads as the same; infinite bounds become huge ones.
fn number(value: f64) -> String {
    if value.is_finite() { format!("{value:e}") } else { format!("{:e}", 1e30_f64.copysign(value)) }
}
