//! Plants of the program's own: configs name them, and say what is wrong with them.

use pinc_ad::Scalar;
use pinc_config::{Experiment, Plants};
use pinc_ode::{Plant, Variable};
use pinc_runs::{Options, Verbosity, check, run};
use serde::Deserialize;
use std::sync::atomic::AtomicBool;

/// x' = rate (u - x).
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Lag {
    rate: f64,
}

impl Plant for Lag {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 1] = [Variable::new("level", "m")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "V")];
        &INPUTS
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = (u[0] - x[0]) * self.rate;
    }
}

const CONFIG: &str = r#"
name = "lag"
preset = "ours"
seed = 1
[plant.own.lag]
rate = 2.0
[model]
horizon_s = 0.5
hidden_layers = 2
neurons = 8
[domain]
state_low = [-1.0]
state_high = [1.0]
input_low = [-1.0]
input_high = [1.0]
[training]
target_one_step_rms = 1e-3
[validation]
duration_s = 2.0
[validation.domain]
state_low = [-1.0]
state_high = [1.0]
input_low = [-1.0]
input_high = [1.0]
[control]
duration_s = 5.0
initial_state = [0.0]
controlled = ["level"]
q = [10.0]
r = [1.0]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [0.5] }]
"#;

fn plants() -> Plants {
    Plants::built_in().with::<Lag>("lag")
}

/// The config, with one piece of its text replaced.
fn load(from: &str, to: &str) -> Result<Experiment, String> {
    assert!(CONFIG.contains(from));
    let text = CONFIG.replace(from, to);
    Experiment::parse("lag.toml".as_ref(), &text, &[], &plants()).map_err(|error| error.to_string())
}

#[test]
fn it_is_examined_trained_and_controlled_like_a_built_in_one() {
    let experiment = load("", "").unwrap();
    let findings = check(&experiment);
    assert!(findings[0].what.contains("1 state: level (m); 1 input: u (V)"), "{}", findings[0]);
    let dir = tempfile::tempdir().unwrap();
    let options = Options {
        resume: false,
        verbosity: Verbosity::Quiet,
        interrupt: &AtomicBool::new(false),
        arguments: &[],
    };
    let run_dir = run(&experiment, dir.path(), &options).unwrap();
    let training = run_dir.metrics().training.as_ref().unwrap();
    assert_eq!(training.stop_reason, "target-reached");
    let [pinc, rk4] = &run_dir.metrics().control[..] else { panic!("two models") };
    assert!((pinc.iae_dense_sum - rk4.iae_dense_sum).abs() < 0.01 * rk4.iae_dense_sum);
    assert!(std::fs::read_to_string(dir.path().join("report.html")).unwrap().contains("level"));
}

/// What a run directory holds reads back as the same experiment.
#[test]
fn its_resolved_config_loads_again() {
    let experiment = load("", "").unwrap();
    let again =
        Experiment::parse("config.toml".as_ref(), &experiment.to_toml(), &[], &plants()).unwrap();
    assert_eq!(again, experiment);
}

#[test]
fn wrong_configs_of_it_are_explained() {
    for (from, to, expected) in [
        (
            "plant.own.lag",
            "plant.own.leg",
            "`plant.own.leg`: a plant that this program does not know given, expected one of lag",
        ),
        ("rate = 2.0", "", "missing field `rate`"),
        ("rate = 2.0", "rate = \"fast\"", "`plant.own.lag`: unusable parameters (invalid type"),
        ("rate = 2.0", "rate = 2.0\nrats = 1.0", "unknown field `rats`"),
        ("[plant.own.lag]\nrate = 2.0", "[plant]\nown = {}", "`plant.own`"),
    ] {
        let error = load(from, to).unwrap_err();
        assert!(error.starts_with("lag.toml:") && error.contains(expected), "{error}");
    }
}
