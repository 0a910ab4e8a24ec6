//! Self-tests in single precision: what rounding and the residual that is asked for leave is allowed, and
//! no more.

use super::compile::Sources;
use super::controller::{Begin, Case, Source, equations, oscillator_case};
use pinc_estimate::{Augmentation, Disturbance, Gate, Measured, Tuning};
use pinc_export::{Estimation, Filter, GeneratedFile};
use pinc_mpc::{NmpcProblem, Reference, Weights};
use pinc_ode::Integrator;

/// Weights so small that a residual of 1e-3 leaves the input uncertain by more than that.
fn case() -> Case {
    let base = oscillator_case();
    let weights = Weights::uniform(vec![0.1, 0.1], vec![0.01]);
    let reference = Some(Reference::new(vec![0.0; 60], 2).unwrap());
    Case {
        problem: NmpcProblem { weights, ..base.problem },
        low: vec![0.5, -0.5],
        high: vec![1.5, 0.5],
        begin: Begin { reference, ..Begin::default() },
        ..oscillator_case()
    }
}

/// What the self-test says differs and is allowed.
fn said(printed: &str) -> [f64; 2] {
    let number = |before: &str| {
        let rest = printed.split_once(before).expect("a number").1;
        rest.split([',', '\n']).next().and_then(|number| number.parse().ok()).expect("a number")
    };
    [number("largest difference "), number("allowed ")]
}

/// Passes in both precisions, in float by more than 1e-3; and fails by name if an input is another.
#[track_caller]
fn assert_judged(files: &[GeneratedFile]) {
    let float = ["-DCTL_REAL=float"];
    let sources = Sources::new(files);
    let [_, allowed] = said(&sources.selftest("ctl", &[]));
    assert!((allowed - 1e-8).abs() < 1e-12, "{allowed}");
    let printed = sources.selftest("ctl", &float);
    let [off, allowed] = said(&printed);
    assert!(off > 1e-3 && allowed > off && allowed < 5.1e-2, "{printed}");
    assert!(!printed.contains("rounding"), "{printed}");
    let mut files = files.to_vec();
    let selftest = files.iter_mut().find(|file| file.path == "ctl_selftest.c").unwrap();
    let text = String::from_utf8(selftest.bytes.clone()).unwrap();
    let (before, rest) = text.split_once("ctl_u[20][1] = {\n    {\n    ").expect("the inputs");
    selftest.bytes = format!("{before}ctl_u[20][1] = {{\n    {{\n    0.06+{rest}").into_bytes();
    let failed = std::panic::catch_unwind(|| Sources::new(&files).selftest("ctl", &float));
    let why = failed.unwrap_err();
    let why = why.downcast_ref::<String>().unwrap();
    assert!(why.contains("single precision is not enough for this controller"), "{why}");
}

#[test]
fn a_controller_may_be_off_by_what_its_residual_leaves() {
    assert_judged(&case().export(None).unwrap());
}

#[test]
fn a_controller_with_an_estimator_may_too() {
    let augmentation = Augmentation {
        disturbance: Disturbance::None,
        ..Augmentation::measured(Measured::states([0, 1]))
    };
    let tuning = Tuning {
        initial_estimate: vec![1.0, 0.0],
        initial_sd: vec![1e-3; 2],
        process_sd: vec![1e-4; 2],
        measurement_sd: vec![1e-4; 2],
        gate: Gate::Sd(8.0),
        ..Tuning::default()
    };
    for filter in [Filter::Extended, Filter::MovingHorizon(3)] {
        let estimation = Estimation { filter, augmentation: &augmentation, tuning: &tuning };
        assert_judged(&case().export(Some(estimation)).unwrap());
    }
}

/// The loop stays where the model has values, and plans leave it: inputs agree, and the self-test fails
/// with the first step and its status.
#[test]
fn a_failure_beside_the_numbers_is_named_with_its_step() {
    let case = oscillator_case();
    let first = f64::midpoint(case.low[0], case.high[0]);
    let steps = 20.0 + 0.5 * case.problem.horizon as f64;
    let last = first + 0.05 * case.sample_time_s * steps;
    let text = format!(
        r#"{{"states": [{{"name": "x1"}}, {{"name": "x2"}}], "inputs": [{{"name": "u"}}],
            "derivatives": {{"x1": "0.05", "x2": "u - x2 + 0.01*log({last:?} - x1)"}}}}"#
    );
    let source = Source::runge_kutta(equations(&text), Integrator::Rk4, 2);
    let sources = Case { source, ..case }.sources();
    let failed = std::panic::catch_unwind(|| sources.selftest("ctl", &[]));
    let why = failed.unwrap_err();
    let why = why.downcast_ref::<String>().unwrap();
    let first = why.lines().find(|line| line.contains("CTL_NUMERICAL_TROUBLE")).expect(why);
    assert!(first.contains("ctl: step ") && first.contains("(t = "), "{why}");
    assert!(why.contains("ctl: failed: ") && !why.contains("larger than allowed"), "{why}");
}
