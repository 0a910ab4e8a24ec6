//! Numbers in findings, and from which numbers on there is one, on plants whose answers are known.

mod boxes;
mod horizons;
mod loops;

use crate::Severity::{self, Fact, Warning};
use crate::{Evidence, Finding, Metered, ReadMeasurements, Subject, Work, check, region, rest};
use pinc_config::{Experiment, Plants};
use pinc_net::Measurements;
use pinc_ode::Dims;

/// The findings on a plant with the states x1 and x2 and the input u, and a loop with steps of 0.5 s
/// that moves the first of `controlled` from 0 to 0.5. Nothing is run.
fn findings(derivatives: [&str; 2], sets: &[&str]) -> Vec<Finding> {
    findings_beside(derivatives, sets, &|_| Err("no files".to_owned()))
}

/// The same beside the measurements that `read` gives.
fn findings_beside(
    derivatives: [&str; 2],
    sets: &[&str],
    read: &ReadMeasurements<'_>,
) -> Vec<Finding> {
    let experiment = experiment(derivatives, sets);
    check(&*experiment.plant.dyn_plant(), &experiment, &evidence(read))
}

/// The findings of one examination of the same plant and loop.
fn findings_of(examine: Examine, derivatives: [&str; 2], sets: &[&str]) -> Vec<Finding> {
    let evidence = evidence(&|_| Err("no files".to_owned()));
    examined(examine, &experiment(derivatives, sets), &evidence)
}

type Examine = fn(&Subject<'_>) -> Vec<Finding>;

/// The findings of one examination beside what else was found.
fn examined(examine: Examine, experiment: &Experiment, evidence: &Evidence<'_>) -> Vec<Finding> {
    let plant = experiment.plant.dyn_plant();
    let metered = Metered::new(&*plant, experiment, &evidence.work);
    evidence.work.begin();
    let region = region::of(experiment, plant.dims()).unwrap();
    examine(&Subject::new((&*plant, &metered), experiment, region, evidence))
}

/// What a check is given where nothing was run.
pub(crate) fn evidence<'a>(read: &'a ReadMeasurements<'a>) -> Evidence<'a> {
    let work = Work::of_a_check();
    Evidence { rehearsal: None, cost: None, read, work, progress: &|_, _, _| {} }
}

fn experiment(derivatives: [&str; 2], sets: &[&str]) -> Experiment {
    let text = format!(
        r#"
        name = "test"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["x1", "x2"]
        inputs = ["u"]
        derivatives = {{ x1 = "{}", x2 = "{}" }}
        [domain]
        state_low = [-2.0, -2.0]
        state_high = [2.0, 2.0]
        input_low = [-1.0]
        input_high = [1.0]
        [control]
        models = ["rk4"]
        step_s = 0.5
        duration_s = 5.0
        initial_state = [0.0, 0.0]
        controlled = ["x1"]
        q = [1.0]
        r = [1.0]
        input_low = [-1.0]
        input_high = [1.0]
        references = [{{ start_s = 0.0, value = [0.5] }}]
        "#,
        derivatives[0], derivatives[1]
    );
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    Experiment::parse("test.toml".as_ref(), &text, &sets, &Plants::built_in()).unwrap()
}

/// How serious the only finding with these words is, and the change that it advises.
#[track_caller]
fn only<'a>(findings: &'a [Finding], words: &str) -> (Severity, &'a str) {
    let found: Vec<_> = findings.iter().filter(|of| of.what.contains(words)).collect();
    let [found] = found[..] else { panic!("{words}: {findings:#?}") };
    (found.severity, &found.change)
}

#[test]
fn a_reference_after_the_end_of_the_loop_is_named() {
    let references =
        "control.references=[{ start_s = 0.0, value = [0.5] }, { start_s = 5.0, value = [0.0] }]";
    let found = findings(["x2", "u - x1 - x2"], &[references]);
    assert_eq!(only(&found, "it begins at 5 s: the loop ends at 5 s").0, Fact);
    let whole = findings(["x2", "u - x1 - x2"], &[references, "control.duration_s=5.5"]);
    assert!(whole.iter().all(|of| !of.what.contains("the loop ends at")), "{whole:#?}");
}

/// The actuator's limits belong to the bounds.
#[test]
fn an_input_that_the_equation_saturates_is_to_be_bounded_there() {
    let bounds = ["control.input_low=[-1.0]", "control.input_high=[2.0]"];
    let saturated = findings(["x2", "max(-0.5, min(0.75, u)) - x2"], &bounds);
    let (severity, change) = only(&saturated, "u has no effect above 0.75");
    assert_eq!((severity, change), (Warning, "0.75 as this bound of u"));
    assert_eq!(only(&saturated, "u has no effect below -0.5").0, Warning);
    // A valve that opens with the level still has an effect somewhere.
    let with_level = findings(["x2", "min(x1, u) - x2"], &bounds);
    for free in [with_level, findings(["x2", "u - x2"], &bounds)] {
        assert!(free.iter().all(|of| !of.what.contains("no effect")), "{free:#?}");
    }
}

/// x2 = (1 - s) / (1 + s)^2 u has a zero at 1/s, and goes the wrong way for about 1 s: a horizon of
/// twice that is long enough.
#[test]
fn a_horizon_covers_twice_the_time_of_a_wrong_first_response() {
    let derivatives = ["u - x1", "2*x1 - u - x2"];
    let of = |n2: &str| findings(derivatives, &["control.controlled=[\"x2\"]", "control.nu=1", n2]);
    let short = of("control.n2=3");
    let (severity, change) = only(&short, "nonminimum phase");
    assert_eq!(severity, Warning);
    assert!(change.starts_with("control.n2 of about 4 or more"), "{change}");
    assert_eq!(only(&of("control.n2=4"), "nonminimum phase").0, Fact);
}

/// From rest at 0.5, the input at its lower bound moves x1 by 1.5 (1 - exp(-a t)) in the horizon of
/// 5 s: three times that is the share of the reference's change.
#[test]
fn inputs_have_to_make_a_tenth_of_a_change_within_the_horizon() {
    let of = |share: f64| {
        let a = -(1.0 - share / 3.0).ln() / 5.0;
        findings([&format!("{a}*(u - x1)"), "x1 - x2"], &["control.n2=10", "control.nu=10"])
    };
    let poor = of(0.09);
    let (severity, change) = only(&poor, "can move x1 by 0.09 of a change of its reference");
    assert_eq!(severity, Warning);
    // A horizon in which they make half of it: 1.5 (1 - exp(-a t)) = 0.25 after 60 steps.
    assert!(change.starts_with("n2 of about 60,"), "{change}");
    // More than 5000 steps would be needed, which is what a config may have.
    let a = -(1.0 - 0.0078 / 3.0_f64).ln() / 40.0;
    let slow = findings([&format!("{a}*(u - x1)"), "x1 - x2"], &["control.n2=80", "control.nu=10"]);
    let (_, change) = only(&slow, "can move x1 by 0.0078");
    assert!(change.starts_with("a T at least 1.1 times as long (n2 is 5000"), "{change}");
    assert!(of(0.11).iter().all(|of| !of.what.contains("of a change of its reference")));
}

/// x1'' = u - w^2 x1 with T of a whole period is at rest again at the end of each step.
#[test]
fn no_longer_horizon_is_advised_where_steps_take_whole_periods() {
    let w2 = (4.0 * std::f64::consts::PI).powi(2);
    let found = findings(["x2", &format!("{w2}*(u - x1)")], &["control.n2=10", "control.nu=10"]);
    let (_, change) = only(&found, "of a change of its reference");
    assert!(change.starts_with("another T"), "{change}");
}

/// Over the horizon of 5 s a deviation grows by exp(5 a), and 1e5 is exp(5 * 2.3026).
#[test]
fn a_plant_that_grows_much_over_the_horizon_is_named() {
    let of = |a: f64| findings([&format!("{a}*x1 + u"), "x1 - x2"], &["control.n2=10"]);
    let words = "over the horizon of 5 s";
    let unstable = of(2.31);
    let (severity, change) = only(&unstable, words);
    assert!(severity == Warning && change.starts_with("a shorter horizon"), "{change}");
    assert!(of(2.29).iter().all(|of| !of.what.contains(words)));
}

/// What needs controlled states is left out for an output, and this is said.
#[test]
fn a_controlled_output_leaves_out_what_needs_states() {
    let output = ["plant.expression.outputs.level=\"x1\"", "control.controlled=[\"level\"]"];
    let words = "these need controlled states, and level is none";
    let found = findings(["u - x1", "x1 - x2"], &output);
    assert_eq!(only(&found, words).0, Fact);
    let found = findings(["u - x1", "x1 - x2"], &[]);
    assert!(found.iter().all(|of| !of.what.contains("these need controlled states")));
}

/// x1 moves by 1e-6 in a second, in a domain of 4.
#[test]
fn plants_that_stand_still_within_the_horizon_are_noticed() {
    let of = |n2: &str| findings(["1e-6 + 1e-12*u", "1e-9*x1 - 1e-9*x2"], &["control.nu=1", n2]);
    let words = "within the horizon of 5 s no state moves more than 1.250e-6 widths";
    assert_eq!(only(&of("control.n2=10"), words).0, Warning);
    only(
        &of("control.n2=20"),
        "within the horizon of 10 s no state moves more than 2.500e-6 widths",
    );
}

#[test]
fn measurements_outside_the_domain_are_counted() {
    let read = |_: &[_]| {
        let mut measured = Measurements::new(Dims::new(2, 1));
        // Two of five: a state above, an input below.
        for (x1, u) in [(0.0, 0.0), (2.1, 0.0), (2.0, 1.0), (0.0, -1.1), (-2.0, -1.0)] {
            measured.push(0.5, &[x1, 0.0], &[u], &[], &[Some(0.1), None]);
        }
        Ok(measured)
    };
    let sets =
        ["data.files=[\"a.csv\"]", "training={}", "model.hidden_layers=1", "model.neurons=4"];
    let domain = "validation.domain={ state_low = [-1.0, -1.0], state_high = [1.0, 1.0], \
                  input_low = [-1.0], input_high = [1.0] }";
    let sets = [&sets[..], &["model.horizon_s=0.5", "validation.duration_s=1.0", domain]].concat();
    let found = findings_beside(["u - x1", "x1 - x2"], &sets, &read);
    assert_eq!(only(&found, "2 of 5 points lie outside the training domain").0, Warning);
    assert_eq!(only(&found, "5 measured values at 5 points").0, Fact);
}

/// What is said of a start at rest on a kink.
fn at_rest(derivatives: [&str; 2], set: &str) -> Option<Finding> {
    let experiment = experiment(derivatives, &[set]);
    let plant = experiment.plant.dyn_plant();
    let evidence = evidence(&|_| Err("no files".to_owned()));
    let metered = Metered::new(&*plant, &experiment, &evidence.work);
    evidence.work.begin();
    let region = region::of(&experiment, plant.dims()).unwrap();
    let subject = Subject::new((&*plant, &metered), &experiment, region, &evidence);
    rest::examine(&subject, &experiment.plant.equations().unwrap().critical_terms().unwrap())
}

/// Of equal arguments the derivative of the second counts: that of max(x2, 0) is 0 at rest.
#[test]
fn a_start_at_rest_on_a_kink_without_slopes_is_named() {
    let zone = "2*max(x2, 0) + 1.2*min(x2, 0) - x1";
    let found = findings([zone, "u - x2"], &[]);
    let (severity, change) = only(&found, "the loop starts at rest on a kink");
    assert_eq!(severity, Warning);
    assert!(change.contains("control.initial_input"), "{change}");
    let kink = "(plant.expression.derivatives.x1: x2 - 0 changes sign)";
    only(&found, &format!("{kink}, where the derivatives of x1 by u are 0"));
    // Also by way of other states, and if the input itself is on it.
    assert!(at_rest(["x2 - x1", "abs(u) - x2"], "seed=1").is_some());
    for (derivatives, set) in [
        // The derivative is 1, the kink is elsewhere, or the plant leaves it.
        (["2*max(0, x2) + 1.2*min(0, x2) - x1", "u - x2"], "seed=1"),
        (["max(x2 - 0.1, 0) - x1", "u - x2"], "seed=1"),
        ([zone, "u - x2 + 0.1*x1"], "control.initial_state=[0.1, 0.0]"),
        ([zone, "u - x2"], "control.initial_state=[0.0, 0.1]"),
        ([zone, "u - x2"], "control.initial_input=[0.001]"),
        // Another plan is the first one, or what is controlled has a slope, or can have none.
        ([zone, "u - x2"], "control.first_plan={ input = [0.5] }"),
        ([zone, "u - x2"], "control.controlled=[\"x2\"]"),
        (["max(x2, 0) - x1", "-x2"], "seed=1"),
    ] {
        let found = at_rest(derivatives, set);
        assert!(found.is_none(), "{derivatives:?} {set}: {found:?}");
    }
}

/// x1 + x2 grows by itself, and x1 - x2 is what is measured, whatever the estimator believes of the
/// states' sizes.
#[test]
fn what_no_measurement_shows_is_named_in_any_sizes() {
    for sizes in ["[1.0, 10.0]", "[1.0, 1.0]"] {
        let sd = format!("control.estimator.initial_sd={sizes}");
        let sets = [
            "plant.expression.outputs.difference=\"x1 - x2\"",
            "control.measurement.measured=[\"difference\"]",
            "control.estimator.kind=\"ekf\"",
            "control.estimator.initial_estimate=[0.0, 0.0]",
            "control.estimator.process_sd=[0.01, 0.01]",
            "control.estimator.measurement_sd=[0.1]",
            &sd,
        ];
        let found = findings(["x2 - 0.9*x1 + u", "x1 - 0.9*x2 + u"], &sets);
        let (severity, _) =
            only(&found, "what is measured does not tell x1, x2 apart: rank 1 of 2");
        assert_eq!(severity, Warning, "{sizes}");
    }
}

#[test]
fn zeros_are_of_as_many_inputs_as_controlled_states() {
    let both = ["control.controlled=[\"x1\", \"x2\"]", "control.q=[1.0, 1.0]"];
    let both =
        [&both[..], &["control.references=[{ start_s = 0.0, value = [0.5, 0.5] }]"]].concat();
    let zeros = |sets: &[&str]| {
        let found = findings(["u - x1", "2*x1 - u - x2"], sets);
        found.iter().filter(|of| of.what.contains("transmission zero")).count()
    };
    assert_eq!(zeros(&both), 0);
    assert!(zeros(&["control.controlled=[\"x2\"]"]) > 0);
}

/// x2' = 0.2 x2 runs away whatever the input; with little effect of the input it can be stopped.
#[test]
fn growth_that_no_input_reaches_is_a_warning() {
    let both = ["control.controlled=[\"x1\", \"x2\"]", "control.q=[1.0, 1.0]"];
    let sets = [&both[..], &["control.references.0.value=[0.5, 0.0]"]].concat();
    let alone = findings(["u - x1", "0.2*x2"], &sets);
    assert_eq!(only(&alone, "no input acts on the growing modes 0.2000 1/s").0, Warning);
    assert_eq!(only(&alone, "no input moves x2 within the prediction horizon").0, Warning);
    let reached = findings(["u - x1", "0.2*x2 + 0.01*u"], &sets);
    assert!(!reached.iter().any(|of| of.what.contains("no input acts")), "{reached:#?}");
}
