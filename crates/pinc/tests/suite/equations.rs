//! Plants whose equations stand in the config: read, refused where they are wrong, and run like
//! others.

use crate::common::{Outcome, outcome, pinc, smoke};
use pinc_config::{Experiment, Plants};
use pinc_record::RunDir;
use pinc_runs::{Options, Verbosity};
use std::path::Path;
use std::sync::atomic::AtomicBool;

const BUILT_IN: &str = "[plant]\nvan-der-pol = { mu = 1.0 }\n";

const EQUATIONS: &str = r#"[plant.expression]
states = ["x1", { name = "x2", unit = "1/s" }]
inputs = ["u"]

[plant.expression.parameters]
mu = 1.0

[plant.expression.let]
damping = "mu*(1 - x1^2)"

[plant.expression.derivatives]
x1 = "x2"
x2 = "damping*x2 - x1 + u"
"#;

/// The smoke config with its plant written out.
fn config() -> String {
    let text = smoke();
    assert!(text.contains(BUILT_IN));
    text.replace(BUILT_IN, EQUATIONS)
}

fn parse(text: &str, sets: &[&str]) -> Experiment {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    Experiment::parse("experiment.toml".as_ref(), text, &sets, &Plants::built_in()).unwrap()
}

fn run(experiment: &Experiment, dir: &Path) -> RunDir {
    let options = Options {
        resume: false,
        verbosity: Verbosity::Quiet,
        interrupt: &AtomicBool::new(false),
        arguments: &[],
    };
    pinc_runs::run(experiment, dir, &options).unwrap()
}

fn check_with(from: &str, to: &str) -> Outcome {
    let text = config();
    assert!(text.contains(from), "`{from}` is not in the config");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("experiment.toml");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    outcome(&mut pinc(&["check".as_ref(), path.as_os_str()]))
}

fn place(start: &str) -> String {
    let line = config().lines().position(|line| line.starts_with(start)).unwrap();
    format!("experiment.toml:{}: ", line + 1)
}

#[test]
fn a_run_has_the_numbers_of_the_built_in_plant() {
    // Few iterations, since many amplify differences of rounding.
    let sets = ["training.phases.0.iterations=5", "training.validation_every=5"];
    let (ours, theirs) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let found = run(&parse(&config(), &sets), ours.path());
    let expected = run(&parse(&smoke(), &sets), theirs.path());
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-8 * b.abs();
    let (found, expected) = (found.metrics(), expected.metrics());
    let validation = |metrics: &pinc_record::Metrics| {
        metrics.validation.as_ref().expect("a validation").one_step_mse
    };
    assert!(close(validation(found), validation(expected)), "{found:?} {expected:?}");
    for (found, expected) in found.control.iter().zip(&expected.control) {
        assert!(close(found.rmse_dense, expected.rmse_dense), "{found:?} {expected:?}");
    }
    assert_eq!(found.control.len(), 2);
}

#[test]
fn written_out_and_read_again_it_is_the_same() {
    let experiment = parse(&config(), &["plant.expression.parameters.mu=2"]);
    let again = parse(&experiment.to_toml(), &[]);
    assert_eq!(again, experiment);
    assert!(experiment.to_toml().contains("mu = 2.0"));
}

#[test]
fn mistakes_in_equations_are_shown_with_their_place() {
    check_with("damping*x2", "daming*x2").assert_refused(&[
        &place("x2 = "),
        "`plant.expression.derivatives.x2`: unknown name `daming`",
        "did you mean `damping`?",
        "\n    daming*x2 - x1 + u\n    ^^^^^^ column 1",
    ]);
    check_with("mu*(1 - x1^2)", "mu*(1 - x1^2").assert_refused(&[
        &place("damping = "),
        "`plant.expression.let.damping`",
        "expected an operator or `)`",
        "^ column 13",
    ]);
    check_with("x1 = \"x2\"\n", "").assert_refused(&[
        &place("[plant.expression.derivatives]"),
        "`plant.expression.derivatives.x1`: missing; expected the time derivative of the state \
        `x1`",
    ]);
    check_with("mu = 1.0", "mu = 1.0\nnu = 2.0")
        .assert_refused(&["`plant.expression.parameters.nu`: no expression uses this parameter"]);
    check_with("mu = 1.0", "mu = \"one\"").assert_refused(&[
        &place("mu = "),
        "`plant.expression.parameters.mu`",
        "expected a number",
    ]);
    check_with("mu = 1.0", "mu = nan").assert_refused(&["`plant.expression.parameters.mu`"]);
    check_with("mu = 1.0", "mu = 1.0\nexp = 2.0")
        .assert_refused(&["the name `exp` is taken: a function"]);
    check_with("\"mu*(1 - x1^2)\"", "\"mu*(1 - x1^2) + 0*damping\"")
        .assert_refused(&["defined by itself: damping needs damping"]);
}

#[test]
fn mistakes_in_lists_of_variables_are_shown_with_their_place() {
    check_with("unit = \"1/s\"", "units = \"1/s\"")
        .assert_refused(&["`plant.expression.states[1].units`: unknown key", "`unit`"]);
    check_with("[\"x1\", ", "[1, ")
        .assert_refused(&["`plant.expression.states[0]`", "a name, or a table { name, unit }"]);
    check_with("[\"u\"]", "[\"u\", \"x1\"]")
        .assert_refused(&["`plant.expression.inputs[1]`: the name `x1` is taken by `states[0]`"]);
    check_with("[plant.expression.let]", "[plant.expression.lets]")
        .assert_refused(&["`plant.expression.lets`: unknown key", "did you mean `let`?"]);
}
