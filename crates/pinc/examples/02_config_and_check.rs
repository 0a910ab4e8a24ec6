//! An experiment from the text of a config: what is wrong in it is said by file, line and key, and
//! the plant is examined before anything is trained.
//!
//! `cargo run --release -p pinc --example 02_config_and_check`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_config::{Experiment, Plants};
use pinc_runs::{Severity, check};
use std::error::Error;
use std::path::Path;

const CONFIG: &str = r#"
name = "heated-tank"
preset = "ours"
seed = 1

[plant.expression]
states = [{ name = "temperature", unit = "K" }]
inputs = [{ name = "heat", unit = "K/s" }]
derivatives = { temperature = "heat - 0.1*(temperature - 293)" }

[model]
horizon_s = 1.0
hidden_layers = 2
neurons = 8

[domain]
state_low = [290.0]
state_high = [320.0]
input_low = [0.0]
input_high = [2.0]

[control]
duration_s = 60.0
initial_state = [293.0]
controlled = ["temperature"]
q = [1.0]
r = [1.0]
state_low = [290.0]
state_high = [320.0]
input_low = [0.0]
input_high = [2.0]
references = [{ start_s = 0.0, value = [318.0] }]
"#;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let (name, sets) = (Path::new("heated-tank.toml"), Vec::new());
    let mistaken = CONFIG.replace("neurons", "neuron");
    let error = Experiment::parse(name, &mistaken, &sets, &Plants::built_in())
        .err()
        .ok_or("a key that nothing has")?;
    println!("{error}\n");
    assert!(error.to_string().contains("did you mean `neurons`?"));

    let experiment = Experiment::parse(name, CONFIG, &sets, &Plants::built_in())?;
    let findings = check(&experiment);
    for finding in &findings {
        println!("{finding}");
    }
    // 318 K need 2.5 K/s, more than the heater has.
    let warnings: Vec<_> = findings.iter().filter(|f| f.severity == Severity::Warning).collect();
    assert!(warnings.iter().any(|finding| finding.what.contains("needs heat = 2.5")));
    Ok(())
}
