//! Time scales, horizons, and what integrators need.

use super::{experiment, findings, findings_of, only};
use crate::Severity::{Fact, Warning};
use crate::{Cost, Evidence, Finding, ModelCost, Work, check, stability, substeps};
use pinc_config::ModelKind;

fn is_said(findings: &[Finding], words: &str) -> bool {
    findings.iter().any(|of| of.what.contains(words))
}

/// exp(a t) doubles in ln 2 / a, and a step may take two doublings.
#[test]
fn a_step_of_more_than_two_doublings_is_too_long() {
    let of = |a: f64| {
        findings_of(stability::examine, [&format!("{a}*x1 + u"), "x1 - x2"], &["control.n2=5"])
    };
    let found = of(2.8);
    let words = "T = 0.5 s is 2.01977 times the 0.248 s in which a deviation doubles";
    let (severity, change) = only(&found, words);
    assert_eq!(severity, Warning);
    assert!(change.starts_with("a T of 49.5 ms"), "{change}");
    assert!(!is_said(&of(2.7), "in which a deviation doubles"));
    assert!(!is_said(&of(0.5), "in which a deviation doubles"));
}

/// What has settled at the end of a step, after three time constants, cannot be shaped; what
/// integrates does not settle.
#[test]
fn a_step_of_three_time_constants_is_too_long() {
    let words = "times the slowest time constant";
    let of = |second: &str, rate: f64| {
        let second = second.replace("rate", &rate.to_string());
        findings_of(stability::examine, [&format!("{rate}*(u - x1)"), &second], &[])
    };
    let found = of("rate*(x1 - x2)", 6.2);
    let (severity, change) = only(&found, "T = 0.5 s is 3.1 times the slowest time constant");
    assert_eq!(severity, Warning);
    assert!(change.starts_with("a T of 0.161"), "{change}");
    assert!(!is_said(&of("rate*(x1 - x2)", 5.8), words));
    assert!(!is_said(&of("x1 - x2", 6.2), words), "the slower one counts");
    assert!(!is_said(&of("x1", 6.2), words), "an integrator");
}

/// A plant is stiff if its fastest mode is ten times as fast as the slowest and as T.
#[test]
fn stiffness_is_a_matter_of_both_ends() {
    let of = |slow: f64, fast: f64| {
        findings_of(
            stability::examine,
            [&format!("{slow}*(u - x1)"), &format!("{fast}*(x1 - x2)")],
            &[],
        )
    };
    let words = "stiff: the fastest mode times T is ";
    let found = of(1.0, 30.0);
    let said = format!("{words}15, and it is 30 times as fast as the slowest");
    assert_eq!(only(&found, &said).0, Warning, "four substeps are not enough");
    assert!(!is_said(&of(25.0, 30.0), words), "all is fast");
    assert!(!is_said(&of(1.0, 19.0), words), "T is short");
    assert!(is_said(&of(2.0, 20.5), words) && !is_said(&of(2.1, 20.5), words));
}

/// RK4 with four substeps of 0.125 s is unstable at -30/s, with six it is stable, and with eight the
/// error of (1 - 1.875 + .. )^8 = 6e-5 instead of exp(-15) in a fast state is below 1e-4 of the
/// widths; half that step has 4e-7 instead of 3e-7, and is below 1e-6.
#[test]
fn substeps_are_enough_to_be_stable_and_exact() {
    let plant = ["u - x1", "30*(x1 - x2)"];
    let found = findings_of(substeps::examine, plant, &["control.rk4_substeps=4"]);
    only(&found, "RK4 is stable at 200 random points of the training domain with 6 substeps");
    let (_, change) = only(&found, "with 4 substeps RK4 is unstable at 200 of 200 random points");
    assert_eq!(change, "rk4_substeps = 8");
    let words = "RK4 has an rms error of 1e-4 of the region's width with 8 substeps, 1e-6 of the \
                 region's width with 16 substeps";
    assert_eq!(only(&found, words).0, Fact);
    let found = findings_of(stability::examine, plant, &["control.rk4_substeps=4"]);
    let (_, change) = only(&found, "4 substeps are unstable at control.references[0]");
    assert!(change.starts_with("rk4_substeps = 6 or more"), "{change}");
    let sound = findings_of(stability::examine, plant, &["control.rk4_substeps=6"]);
    assert!(!is_said(&sound, "are unstable at"));
}

/// Of more controlled states than inputs no gain reaches all: that is no fault of the plant. Of as
/// many it is.
#[test]
fn a_gain_has_the_rank_of_its_inputs() {
    let both = [
        "control.controlled=[\"x1\", \"x2\"]",
        "control.q=[1.0, 1.0]",
        "control.references=[{ start_s = 0.0, value = [0.5, 0.5] }]",
    ];
    let found = findings(["u - x1", "x1 - x2"], &both);
    // (1, 1) has the singular value sqrt(2).
    let words = "static gain from u to x1, x2: singular values 1.41421, rank 1";
    assert_eq!(only(&found, words).0, Fact);
    assert!(!is_said(&found, ": singular;"), "{found:#?}");
    let found = findings(["u - x1", "0.0*x1 - x2"], &["control.controlled=[\"x2\"]"]);
    let gain: Vec<_> =
        found.into_iter().filter(|of| of.what.contains("rank 0: singular")).collect();
    assert_eq!(only(&gain, "static gain from u to x2").0, Warning);
}

/// Gains of any units are as many as there are: 1 Pa and 1 m^3/s are no smaller than 1 K and 1 W.
#[test]
fn a_rank_does_not_depend_on_units() {
    let found = findings(
        ["1e9*u - x1", "(1e-3*v - x2)/2"],
        &[
            "plant.expression.inputs=[\"u\", \"v\"]",
            "domain.state_low=[0.0, 0.0]",
            "domain.state_high=[1e5, 10.0]",
            "domain.input_low=[0.0, 0.0]",
            "domain.input_high=[2e-4, 2e4]",
            "control.controlled=[\"x1\", \"x2\"]",
            "control.q=[1e-10, 1e-2]",
            "control.r=[1e5, 1e-10]",
            "control.input_low=[0.0, 0.0]",
            "control.input_high=[2e-4, 2e4]",
            "control.references=[{ start_s = 0.0, value = [1e5, 10.0] }]",
        ],
    );
    assert_eq!(only(&found, "singular values 1.000e9, 0.001, rank 2").0, Fact);
    only(&found, "no transmission zeros");
}

/// A response that comes and goes counts by its peak: k t exp(-t) has k / e at t = 1 s.
#[test]
fn a_response_counts_by_its_peak() {
    let of = |k: f64| {
        findings([&format!("{k}*(u - x2) - x1"), "u - x2"], &["control.n2=10", "control.nu=10"])
    };
    let words = "of a change of its reference";
    assert!(!is_said(&of(0.163), words), "a peak of 0.06 of 0.5");
    let found = of(0.12);
    only(&found, "can move x1 by 0.08829 of a change of its reference");
}

/// What is to be moved is the largest step from one reference to the next, not from the start.
#[test]
fn changes_are_from_one_reference_to_the_next() {
    let references = "control.references=[{ start_s = 0.0, value = [0.5] }, \
                      { start_s = 2.5, value = [0.6] }]";
    // From 0.6 the input at -1 moves x1 by 1.6 (1 - exp(-a t)) in 5 s.
    let a = -(1.0 - 0.09 * 0.5 / 1.6_f64).ln() / 5.0;
    let sets = [references, "control.n2=10", "control.nu=10"];
    let found = findings([&format!("{a}*(u - x1)"), "x1 - x2"], &sets);
    only(&found, "can move x1 by 0.09 of a change of its reference");
}

/// Wide bounds do not make a change of the reference larger; without one, a part of them counts.
#[test]
fn a_change_is_what_the_reference_changes_by() {
    let of = |reference: &str| {
        let reference = format!("control.references=[{{ start_s = 0.0, value = [{reference}] }}]");
        let wide = ["domain.state_low=[-500.0, -2.0]", "domain.state_high=[500.0, 2.0]"];
        let sets = [&reference, wide[0], wide[1], "control.n2=10", "control.nu=10"];
        findings(["0.01*(u - x1)", "x1 - x2"], &sets)
    };
    // 1.5 (1 - exp(-0.05)) of 0.5.
    assert!(!is_said(&of("0.5"), "the inputs can move x1 by"));
    // 1 - exp(-0.05) of 50.
    only(&of("0.0"), "can move x1 by 9.754e-4 of a twentieth of its range");
}

/// Times are said in the unit that suits them, and a control step is measured in microseconds.
#[test]
fn times_of_models_are_said_in_their_units() {
    let experiment = experiment(["u - x1", "x1 - x2"], &["control.rk4_substeps=3"]);
    let of = |step_ns, linearized_ns, control_step_us| {
        let model = ModelKind::RK4;
        let models = vec![ModelCost { model, step_ns, linearized_ns, control_step_us }];
        let cost = Some(Cost { rhs_ns: 512.4, stages: 5, models });
        let work = Work::of_a_check();
        let read = |_: &[std::path::PathBuf]| Err(String::new());
        let evidence =
            Evidence { rehearsal: None, cost, read: &read, work, progress: &|_, _, _| {} };
        check(&*experiment.plant.dyn_plant(), &experiment, &evidence)
    };
    let found = of(12_340.0, 250_400.0, Some(2510.0));
    only(&found, "an evaluation of the equation takes 512 ns");
    only(
        &found,
        "a step of RK4 x3 takes 12.3 us, with Jacobians 250 us (5 at a time); a control step takes \
         2.5 ms",
    );
    let found = of(999.0, 1_250_000.0, None);
    let words = "a step of RK4 x3 takes 999 ns, with Jacobians 1.2 ms (5 at a time)";
    assert_eq!(found.iter().filter(|of| of.what == words).count(), 1, "{found:#?}");
}

/// Each examination has a share of the whole budget, and a little where that is used up.
#[test]
fn each_examination_has_some_work() {
    let work = Work::of_a_check();
    assert_eq!(work.left(), crate::work::TOTAL);
    work.begin();
    assert_eq!(work.left(), crate::work::SHARE);
    assert!(work.spend(crate::work::SHARE - 1) && !work.spend(1) && work.is_over());
    work.begin();
    assert_eq!((work.left(), work.is_over()), (crate::work::SHARE, false));
    work.spend(2 * crate::work::TOTAL);
    assert!(work.is_over());
    work.begin();
    assert_eq!(work.left(), 2_000_000);
}
