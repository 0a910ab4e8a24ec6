//! The rehearsed loop, where it goes, and the estimator along it.

use super::{Examine, examined, experiment, only};
use crate::Severity::{Fact, Warning};
use crate::{Evidence, Finding, Rehearsal, Work, estimation, excursions, rehearsal};
use pinc_config::ModelKind;
use pinc_ode::{Dims, Trajectory};
use pinc_record::ViolationMetrics;

const LAGS: [&str; 2] = ["u - x1", "x1 - x2"];

/// A loop of 5 s with RK4 along which the states are `x(t)` and the input is 1.
fn rehearsed(x: impl Fn(f64) -> [f64; 2]) -> Rehearsal {
    let mut trace = Trajectory::new(Dims::new(2, 1));
    for i in 0..=50 {
        let t = 0.1 * f64::from(i);
        trace.push(t, &x(t), &[1.0]);
    }
    Rehearsal {
        model: ModelKind::RK4,
        trace,
        status: [("converged".to_owned(), 10)].into(),
        references: pinc_record::ReferenceMetrics::default(),
        violations: Vec::new(),
        left_out: 0,
    }
}

/// x1 = 1 - exp(-t), and x2 = 1 - (1 + t) exp(-t): the lags from rest under an input of 1.
fn lags(t: f64) -> [f64; 2] {
    [1.0 - (-t).exp(), 1.0 - (1.0 + t) * (-t).exp()]
}

fn findings(examine: Examine, rehearsal: Result<Rehearsal, String>, sets: &[&str]) -> Vec<Finding> {
    let experiment = experiment(LAGS, sets);
    let read = |_: &[std::path::PathBuf]| Err(String::new());
    let (rehearsal, work) = (Some(rehearsal), Work::of_a_check());
    let evidence = Evidence { rehearsal, cost: None, read: &read, work, progress: &|_, _, _| {} };
    examined(examine, &experiment, &evidence)
}

fn is_said(findings: &[Finding], words: &str) -> bool {
    findings.iter().any(|of| of.what.contains(words))
}

/// A loop that leaves the domain is named by how far it goes, and the box that is proposed holds it
/// with a twentieth of its range beyond, rounded outwards; ends that hold stay.
#[test]
fn a_domain_is_proposed_that_holds_the_loop() {
    let found = findings(excursions::examine, Ok(rehearsed(|t| [0.5 * t, -0.6 * t])), &[]);
    let words = "the closed loop with RK4: x1 goes up to 2.5 (domain to 2), x2 goes down to -3 (domain \
                 from -2)";
    assert_eq!(only(&found, words).0, Warning);
    let (severity, change) = only(&found, "a box that holds all of these trajectories");
    assert_eq!(severity, Fact);
    // 2.5 + 0.125 and -3 - 0.15.
    let expected = "[domain]\nstate_low = [-2.0, -3.2]\nstate_high = [2.7, 2.0]\n\
                    input_low = [-1.0]\ninput_high = [1.0]";
    assert_eq!(change, expected);
    let inside = findings(excursions::examine, Ok(rehearsed(lags)), &[]);
    assert_eq!(only(&inside, "trajectories stay in the training domain").0, Fact);
}

/// Steps that fail are a warning beyond the share that the config allows, with the most frequent
/// status; those that were left out are said.
#[test]
fn failed_steps_are_judged_by_their_share() {
    let status = [("converged", 7), ("stalled", 2), ("infeasible-qp", 1)];
    let status = status.map(|(name, steps)| (name.to_owned(), steps));
    let failing = || Rehearsal { status: status.clone().into(), ..rehearsed(lags) };
    let words = "3 of 10 steps of the closed loop with RK4 fail, most with the status stalled";
    let found = findings(rehearsal::examine, Ok(failing()), &[]);
    let (severity, change) = only(&found, words);
    assert_eq!(severity, Warning);
    assert!(change.contains("tolerance"), "{change}");
    let found = findings(rehearsal::examine, Ok(failing()), &["control.max_failed_share=0.3"]);
    assert_eq!(only(&found, words).0, Fact);
    let found = findings(rehearsal::examine, Ok(failing()), &["control.max_failed_share=0.29"]);
    assert_eq!(only(&found, words).0, Warning);

    let found = findings(rehearsal::examine, Ok(rehearsed(lags)), &[]);
    only(&found, "all 10 steps of the closed loop with RK4 succeed");
    let found = findings(rehearsal::examine, Ok(Rehearsal { left_out: 4, ..rehearsed(lags) }), &[]);
    only(
        &found,
        "the first 10 steps of the closed loop with RK4 succeed; the other 4 were left out",
    );
    let found = findings(rehearsal::examine, Err("no plan".to_owned()), &[]);
    assert_eq!(only(&found, "with an integrator as the model: no plan").0, crate::Severity::Error);
}

/// Of broken hard bounds the one that is broken most, by its share, is named.
#[test]
fn the_worst_of_the_broken_bounds_is_named() {
    let violation = |of: &str, amount: f64, share: f64, hard: bool| ViolationMetrics {
        of: of.to_owned(),
        unit: String::new(),
        side: "high".to_owned(),
        bound: 1.0,
        hard,
        amount,
        time_s: 2.0,
        at_steps: 0.0,
        share,
        from_step: 1,
    };
    let violations = vec![
        violation("x1", 0.5, 0.01, true),
        violation("x2", 0.125, 0.2, true),
        violation("u", 0.75, 0.5, false),
    ];
    let found = findings(rehearsal::examine, Ok(Rehearsal { violations, ..rehearsed(lags) }), &[]);
    let words = "in the closed loop with RK4 x2 broke a hard bound between control steps: it was \
                 0.125 above 1 at 2 s (and so for 1 more)";
    assert_eq!(only(&found, words).0, Warning);
}

/// The estimator of the first lag by its own measurement.
const ESTIMATOR: [&str; 6] = [
    "control.measurement.measured=[\"x1\"]",
    "control.estimator.kind=\"ekf\"",
    "control.estimator.initial_estimate=[0.0, 0.0]",
    "control.estimator.initial_sd=[0.03, 0.03]",
    "control.estimator.process_sd=[0.001, 0.001]",
    "control.estimator.measurement_sd=[0.04]",
];

fn estimated(x: impl Fn(f64) -> [f64; 2], more: &[&str]) -> Vec<Finding> {
    findings(estimation::examine, Ok(rehearsed(x)), &[&ESTIMATOR[..], more].concat())
}

/// The gate's width is so many times the standard deviation of the innovation, in the first step
/// sqrt(0.03^2 + 0.04^2) = 0.05. Right readings are within it all along, though the input moves the
/// plant far from its start.
#[test]
fn a_gate_is_as_wide_as_the_innovation_allows() {
    let found = estimated(lags, &["control.estimator.gate=4.0"]);
    let words = "is rejected: x1 by 0.2 in the first step of the rehearsed loop, x1 by 0.16";
    assert_eq!(only(&found, words).0, Fact);
    assert!(!is_said(&found, "are rejected: that at"), "{found:#?}");
    // A reading that jumps by 0.5 at 2 s is out of it, and so are those after it.
    let jump = |t: f64| if t < 1.99 { lags(t) } else { [lags(t)[0] + 0.5, lags(t)[1]] };
    let found = estimated(jump, &["control.estimator.gate=4.0"]);
    let words = "of 11 readings of x1 in the rehearsed loop, which has no noise, are rejected: that \
                 at 2 s is 0.5";
    let (severity, change) = only(&found, words);
    assert_eq!(severity, Warning);
    assert!(change.starts_with("raise process_sd"), "{change}");
    let start = |t: f64| [lags(t)[0] + 0.5, lags(t)[1]];
    let found = estimated(start, &["control.estimator.gate=4.0"]);
    let (_, change) = only(&found, "are rejected: that at 0 s is 0.5 from what is expected");
    assert!(change.starts_with("raise initial_sd"), "{change}");
    let found = estimated(start, &["control.estimator.gate=\"off\""]);
    assert_eq!(only(&found, "no reading is rejected, however wild").0, Fact);
}

/// Readings after a jump of the input, which the estimator predicts with, are no surprise.
#[test]
fn an_estimator_is_told_the_input_that_acts() {
    let mut rehearsal = rehearsed(lags);
    rehearsal.trace = Trajectory::new(Dims::new(2, 1));
    // The first lag under 1, and 9 from 2 s on; a sample has the input that led to it.
    for i in 0..=50 {
        let t = 0.1 * f64::from(i);
        let (u, x1) = match i {
            0..=20 => (1.0, 1.0 - (-t).exp()),
            _ => (9.0, 9.0 - (8.0 + (-2.0_f64).exp()) * (2.0 - t).exp()),
        };
        rehearsal.trace.push(t, &[x1, 0.0], &[u]);
    }
    let sets = [&ESTIMATOR[..], &["control.estimator.gate=4.0"]].concat();
    let found = findings(estimation::examine, Ok(rehearsal), &sets);
    assert!(!is_said(&found, "are rejected: that at"), "{found:#?}");
}

/// The first reading is under the input that the plant has been given.
#[test]
fn a_gate_knows_the_first_input() {
    let more = [
        "plant.expression.outputs.y=\"0.5*x1*u\"",
        "control.measurement.measured=[\"y\"]",
        "control.estimator.gate=4.0",
        "control.initial_input=[1.0]",
    ];
    // sqrt(0.015^2 + 0.04^2) = 0.042720
    only(&estimated(lags, &more), "is rejected: y by 0.17088 in the first step");
}

/// Three standard deviations of the noise have to pass the gate, which is at least 4 * 0.04 wide.
#[test]
fn ordinary_noise_passes_the_gate() {
    let of = |noise: f64| {
        let noise = format!("control.measurement.noise_sd=[{noise}]");
        estimated(lags, &["control.estimator.gate=4.0", &noise])
    };
    let found = of(0.06);
    let (severity, _) = only(&found, "the noise of x1 has a standard deviation of 0.06");
    assert_eq!(severity, Warning);
    assert!(!is_said(&of(0.05), "the noise of x1"));
}

/// An estimator is free of offset with a disturbance for each measured quantity; what is controlled,
/// or has bounds, has to be measured.
#[test]
fn disturbances_are_as_many_as_measured() {
    let words = "disturbances and parameters are estimated, and";
    let none = estimated(lags, &[]);
    assert_eq!(only(&none, "0 disturbances and parameters are estimated, and 1 quant").0, Warning);
    let disturbance = |kind: &'static str| {
        let sd = "control.estimator.disturbance_sd=[0.01]";
        [kind, sd, "control.estimator.disturbance_initial_sd=[0.1]"]
    };
    let one = estimated(lags, &disturbance("control.estimator.disturbance=\"output\""));
    assert!(!is_said(&one, words) && !is_said(&one, "is controlled, but not measured"));
    only(&one, "estimated from x1");
    let other = "control.controlled=[\"x2\"]";
    let disturbed = disturbance("control.estimator.disturbance=\"output\"");
    let found = estimated(lags, &[&disturbed[..], &[other]].concat());
    assert_eq!(only(&found, "x2 is controlled, but not measured").0, Warning);

    // Bounds of an output that is measured, and of one that is not.
    let bounded = |measured: &str| {
        let measured = format!("control.measurement.measured=[\"{measured}\"]");
        let outputs = [
            "plant.expression.outputs={ a = \"x1\", b = \"x2\" }",
            "control.output_high=[inf, 2.0]",
            "control.output_low=[-inf, -2.0]",
            &measured,
        ];
        estimated(lags, &[&disturbed[..], &outputs].concat())
    };
    let words = "b has bounds, but is not measured";
    assert_eq!(only(&bounded("a"), words).0, Warning);
    assert!(!is_said(&bounded("b"), "has bounds, but is not measured"));
}
