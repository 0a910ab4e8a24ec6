//! `[tune]`: the loops of candidates, and those that are held out.

use crate::common::parse;
use pinc_config::{CaseSpec, trials};
use std::collections::BTreeSet;

/// A lag with a noisy sensor, tuned on 3 loops and judged by 5 others.
const LAG: &str = r#"
name = "lag"
preset = "ours"
seed = 1
[plant.expression]
states = ["x"]
inputs = ["u"]
parameters = { rate = 1.0 }
derivatives = { x = "rate*(u - x)" }
[control]
models = ["rk4"]
step_s = 0.2
duration_s = 6.0
initial_state = [0.0]
controlled = ["x"]
q = [1.0]
r = [100.0]
input_low = [-3.0]
input_high = [3.0]
references = [{ start_s = 0.0, value = [1.0] }]
[tune]
loops = 3
held_out = 5
ranges = [{ key = "control.r.0", low = 0.01, high = 1000.0, log = true }]
draws = [{ key = "control.plant.expression.parameters.rate", low = 0.7, high = 1.4 }]
"#;

/// Other plants and other noise, so that what is tuned to the one is not judged by it.
#[test]
fn loops_that_are_held_out_are_others() {
    let experiment = parse(LAG, &[]).unwrap();
    let drawn = |held_out: bool| -> Vec<(u64, String)> {
        let case = CaseSpec { name: "tuned".to_owned(), set: toml::Table::new() };
        let sweep = experiment.tuning(vec![case], held_out).unwrap();
        let made = trials(&sweep).unwrap_or_else(|(key, _)| panic!("{key}"));
        let rate = "control.plant.expression.parameters.rate";
        let of = |trial: &pinc_config::Trial| {
            assert_eq!(trial.experiment.seed, experiment.seed, "nets are the same");
            (trial.experiment.noise_seed(), trial.experiment.value_of(rate).unwrap().to_string())
        };
        made.iter().map(of).collect()
    };
    let (tuned, held_out) = (drawn(false), drawn(true));
    assert_eq!((tuned.len(), held_out.len()), (3, 5));
    let all: Vec<_> = tuned.iter().chain(&held_out).collect();
    let seeds: BTreeSet<u64> = all.iter().map(|(seed, _)| *seed).collect();
    let rates: BTreeSet<&str> = all.iter().map(|(_, rate)| &**rate).collect();
    assert_eq!((seeds.len(), rates.len()), (8, 8), "{all:?}");
    assert_eq!(drawn(true), held_out, "the same ones every time");
}

/// Draws with noise of their own share a net, whatever else they draw of the loop.
#[test]
fn seeded_draws_need_one_training() {
    let net = [
        "model={ horizon_s = 0.5, hidden_layers = 1, neurons = 4 }",
        "domain={ state_low = [-2.0], state_high = [2.0], input_low = [-3.0], input_high = [3.0] }",
        "training.collocation_points=64",
        "validation={ duration_s = 2.0, domain = { state_low = [-1.0], state_high = [1.0], input_low = [-1.0], input_high = [1.0] } }",
        "control.models=[\"pinc\"]",
        "--unset control.step_s",
        "--unset tune",
    ];
    let draws = "sweep.draws=[{ name = \"noise\", count = 4, seeded = true }]";
    let sweep = parse(LAG, &[&net[..], &[draws]].concat()).unwrap();
    let made = trials(&sweep).unwrap_or_else(|(key, _)| panic!("{key}"));
    let trainings: BTreeSet<&str> = made.iter().map(pinc_config::Trial::unit).collect();
    let noise: BTreeSet<u64> = made.iter().map(|trial| trial.experiment.noise_seed()).collect();
    assert_eq!((made.len(), trainings.len(), noise.len()), (4, 1, 4));
    // Seeds of the experiment are those of nets.
    let seeds = parse(LAG, &[&net[..], &[draws, "sweep.seeds=[1, 2]"]].concat()).unwrap();
    let made = trials(&seeds).unwrap_or_else(|(key, _)| panic!("{key}"));
    let trainings: BTreeSet<&str> = made.iter().map(pinc_config::Trial::unit).collect();
    assert_eq!((made.len(), trainings.len()), (8, 2));
    let other = "sweep.draws=[{ name = \"noise\", count = 4, seeded = true, seed = 9 }]";
    let other = trials(&parse(LAG, &[&net[..], &[other]].concat()).unwrap());
    let other = other.unwrap_or_else(|(key, _)| panic!("{key}"));
    assert!(other.iter().all(|trial| !noise.contains(&trial.experiment.noise_seed())));

    let error = parse(LAG, &[&net[..], &[draws, "--unset control"]].concat()).unwrap_err();
    assert!(
        error.contains("`sweep.draws[0].seeded`: true given, expected false without"),
        "{error}"
    );
}
