//! Differential-algebraic plants: what is refused, and in which words; and that they give the
//! numbers of their ODE.

use crate::common::{outcome, pinc, repository};
use pinc_config::{Experiment, Plants};
use pinc_runs::{Finding, Severity, check};

fn siphon() -> std::path::PathBuf {
    repository("crates/pinc/tests/data/traps/siphon.toml")
}

fn load(sets: &[&str]) -> Result<Experiment, String> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    Experiment::load(&siphon(), &sets, &Plants::built_in()).map_err(|error| error.to_string())
}

fn serious(sets: &[&str]) -> Vec<Finding> {
    let found = check(&load(sets).unwrap());
    found.into_iter().filter(|finding| finding.severity != Severity::Fact).collect()
}

#[track_caller]
fn assert_said(text: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| text.contains(part)), "no {parts:?} in {text}");
}

const Q: &str = "plant.expression.algebraic.q";

#[test]
fn one_root_all_over_the_domain_is_no_finding() {
    let all = check(&load(&[]).unwrap());
    let found: Vec<_> = all.iter().filter(|f| f.severity != Severity::Fact).collect();
    assert!(found.is_empty(), "{found:?}");
    let texts: Vec<_> = all.iter().map(ToString::to_string).collect();
    assert!(
        texts
            .iter()
            .any(|text| text.contains("algebraic variables in the training domain: q from 1.317")),
        "{texts:?}"
    );
}

/// Before the training: what is proven is the error against listed equations.
#[test]
fn no_net_of_algebraic_variables_is_proven() {
    let refused = load(&["training.proven_tolerance={ h = 1e-3 }"]).unwrap_err();
    assert_said(
        &refused,
        &["training.proven_tolerance", "no such key with", "algebraic variables"],
    );
}

#[test]
fn no_root_is_named_with_equation_and_place() {
    let low = "domain.state_low=[-1.0]";
    let found = serious(&[low]);
    assert_said(&found[0].what, &["h' is NaN (algebraic.q: no root found in the box", " at h = -"]);
    assert_eq!(found[0].severity, Severity::Error);
    // A run says it too, before it trains.
    let dir = tempfile::tempdir().unwrap();
    let mut command = pinc(&["train".as_ref(), siphon().as_os_str()]);
    command.args(["--set", low, "--out"]).arg(dir.path().join("run"));
    let outcome = outcome(&mut command);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert_said(
        &outcome.stderr,
        &["the derivative of state h is not finite at x = [-", "algebraic.q: no root"],
    );
}

/// The truth runs dry: the loop ends with the equation, the state and the time.
#[test]
fn a_root_that_ends_on_the_way_is_named_by_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let mut command = pinc(&["control".as_ref(), siphon().as_os_str()]);
    let sets = [
        "control.input_high=[0.1]",
        "control.state_low=[-1.0]",
        "plant.expression.derivatives.h=\"u - q - 1\"",
    ];
    for set in sets {
        command.args(["--set", set]);
    }
    let outcome = outcome(command.arg("--out").arg(dir.path().join("run")));
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert_said(
        &outcome.stderr,
        &["the equation has no value beyond t = ", "algebraic.q: no root found"],
    );
}

#[test]
fn several_roots_trigger_a_warning() {
    let found = serious(&[&format!("{Q}.low=-10.0")]);
    assert!(found.len() == 1 && found[0].severity == Severity::Warning, "{found:?}");
    assert_said(&found[0].what, &["several roots at h = ", "which the plant takes, and q = -"]);
    assert_eq!(found[0].place, Q);
}

/// A start that changes sides with the input: beyond the place between, the other root is found,
/// and the derivative by q has the other sign.
#[test]
fn a_singular_derivative_is_refused() {
    let found = serious(&[&format!("{Q}.low=-10.0"), &format!("{Q}.start=\"6*(u - 1.5)\"")]);
    let singular = found.iter().find(|f| f.what.contains("singular")).unwrap();
    assert_eq!(singular.severity, Severity::Error);
    assert_said(
        &singular.to_string(),
        &["algebraic.q by its unknowns is singular", "changes sign", "the index is not 1"],
    );
}

/// A pendulum of Cartesian coordinates: the tension is not in the equation that determines it.
#[test]
fn index_2_is_refused_in_words() {
    let sets = [
        "plant.expression.states=[\"x\", \"y\", \"vx\", \"vy\"]".to_owned(),
        format!("{Q}.equation=\"x*vx + y*vy\""),
        format!("{Q}.start=1.0"),
        "plant.expression.derivatives={ x = \"vx\", y = \"vy\", vx = \"-q*x + u\", vy = \"-q*y - 9.81\" }".to_owned(),
    ];
    let sets: Vec<_> = sets.iter().map(String::as_str).collect();
    let error = load(&sets).unwrap_err();
    assert_said(
        &error,
        &[Q, "contains no algebraic variable", "determines q", "index 2", "differentiate"],
    );
}

#[test]
fn other_mistakes_are_named() {
    let refused = |key: &str, value: &str, part: &str| {
        let error = load(&[&format!("{Q}.{key}={value}")]).unwrap_err();
        assert_said(&error, &[Q, part]);
    };
    refused("low", "10.0", "the box goes from 10 to 10");
    refused("start", "11.0", "the search starts at 11, outside the box");
    refused("start", "\"q + 1\"", "depends on the algebraic variable `q`");
    refused("equation", "\"q - z\"", "unknown name `z`");
    let error = load(&[&format!("{Q}.guess=1.0")]).unwrap_err();
    assert_said(&error, &["algebraic.q.guess", "expected one of equation, start, low, high, unit"]);
}

/// The oscillator with its damping force d and the sum e of damping and spring, from two equations
/// that have both.
const OSCILLATOR: &str = r#"
[plant.expression]
states = ["x1", "x2"]
inputs = ["u"]
[plant.expression.algebraic]
d = { equation = "d + 0.1*(e - d + x1) - (1 - x1^2)*x2", low = -500.0, high = 500.0 }
e = { equation = "(e + x1 - d)*(2 + x2^2)", low = -500.0, high = 500.0 }
[plant.expression.derivatives]
x1 = "x2"
x2 = "e + u"
"#;

/// The four tanks with their flows w as the roots of Torricelli's law w^2 = 2 g a^2 h.
const TANKS: &str = r#"
[plant.expression]
states = ["h1", "h2", "h3", "h4"]
inputs = ["u1", "u2"]
[plant.expression.algebraic]
w1 = { equation = "w1^2 - 2*981*0.071^2*h1", start = 10.0, low = 0.0, high = 30.0 }
w2 = { equation = "w2^2 - 2*981*0.057^2*h2", start = 10.0, low = 0.0, high = 30.0 }
w3 = { equation = "w3*(w3 + w1) - 2*981*0.071^2*h3 - w1*w3", start = 5.0, low = 0.0, high = 30.0 }
w4 = { equation = "w4^2/h4 - 2*981*0.057^2", start = 5.0, low = 0.0, high = 30.0 }
[plant.expression.derivatives]
"#;

/// Metrics of the loops with each integrator as the model, without the times.
fn loops(text: &str) -> Vec<[f64; 3]> {
    let sets = [
        "control.models=[\"rk4\", \"rk5\", \"rosenbrock\"]",
        "control.repetitions=1",
        "control.rosenbrock_substeps=1",
        "control.plant_tolerance=1e-10",
    ];
    let sets = sets.map(str::to_owned);
    let experiment = Experiment::parse("loop.toml".as_ref(), text, &sets, &Plants::built_in());
    let dir = tempfile::tempdir().unwrap();
    let options = pinc_runs::Options {
        resume: false,
        verbosity: pinc_runs::Verbosity::Quiet,
        interrupt: &std::sync::atomic::AtomicBool::new(false),
        arguments: &[],
    };
    let run = pinc_runs::run(&experiment.unwrap(), dir.path(), &options).unwrap();
    let numbers = |loops: &pinc_record::ControlMetrics| [loops.rmse_dense, loops.iae, loops.rmse];
    run.metrics().control.iter().map(numbers).collect()
}

#[test]
fn loops_have_the_numbers_of_the_ode() {
    let tanks = format!(
        "{TANKS}h1 = \"(0.5*3.33*u1 + w3 - w1)/28\"\nh2 = \"(0.5*3.35*u2 + w4 - w2)/32\"\n\
         h3 = \"(0.5*3.35*u2 - w3)/28\"\nh4 = \"(0.5*3.33*u1 - w4)/32\"\n"
    );
    let tanks_ode = "[plant]\nfour-tanks = { parameters = \"antonelo\" }\n";
    let cases = [
        ("configs/van-der-pol/main.toml", "[plant]\nvan-der-pol = { mu = 1.0 }\n", OSCILLATOR, 0.5),
        ("configs/four-tanks/control.toml", tanks_ode, &tanks, 10.0),
    ];
    for (config, ode, dae, step_s) in cases {
        let [expected, found] = [ode, dae].map(|plant| loops(&with_plant(config, plant, step_s)));
        assert_eq!(found.len(), 3);
        for (a, b) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((a - b).abs() <= 1e-8 * b.abs(), "{config}: {found:?} {expected:?}");
        }
    }
}

/// The closed loop of a config, without a net and with another plant.
fn with_plant(config: &str, plant: &str, step_s: f64) -> String {
    let text = std::fs::read_to_string(repository(config)).unwrap();
    let (head, _) = text.split_once("[plant]").unwrap();
    let (_, control) = text.split_once("\n[control]\n").unwrap();
    let control = control.split("\n\n").next().unwrap();
    format!("{head}{plant}\n[control]\nstep_s = {step_s:?}\n{control}\n")
}
