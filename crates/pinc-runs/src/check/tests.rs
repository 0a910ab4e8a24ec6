//! Every message of the examinations, from a plant that gives rise to it.

use super::examine as examine_watched;
use crate::progress::Verbosity;
use pinc_ad::Scalar;
use pinc_check::Finding;
use pinc_check::Severity::{self, Error, Fact, Warning};
use pinc_config::Experiment;
use pinc_ode::{DynPlant, Plant, Variable};

/// A plant of two states x1, x2 and one input u, as the config below says it is.
#[derive(Clone, Copy, Debug)]
enum Test {
    /// x1' = -sqrt(x1) + u, x2' = x1 - x2: not defined below 0.
    Sqrt,
    /// x1' = 1 / x1 - u, x2' = -x2: infinite at 0 only.
    Division,
    /// x1' = u - 1 / (1 / x1), x2' = -x2: like u - x1, with derivatives that are not finite at 0.
    Reciprocal,
    /// x1' = -1000 (x1 - u), x2' = x1 - x2.
    Stiff,
    /// x1' = u, x2' = x1 - x2.
    Integrator,
    /// x1' = u - x1, x2' = 1 - x2: the input does not reach x2.
    Unreached,
    /// x1' = -x1 + u, x2' = 1 + x1^2: nothing is ever at rest.
    Restless,
    /// x1' = x1^2 + u, x2' = -x2: gone to infinity after 1 / x1(0).
    Explosive,
    /// y = x2 = (1 - s) / (1 + s)^2 u: a zero at +1.
    Nonminimum,
    /// x1' = 0.001 (u - x1), x2' = 0.002 (x1 - x2).
    Slow,
    /// x1' = x2, x2' = u - x1 - x2.
    Damped,
    /// x1' = u + x1, x2' = x1 - x2.
    Unstable,
    /// x1' = 3600 (u - x1), x2' = 3600 (x1 - x2): rates per hour as they are written by mistake.
    Hourly,
}

impl Plant for Test {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let (x1, x2, u) = (x[0], x[1], u[0]);
        let one = u.constant(1.0);
        [dx[0], dx[1]] = match self {
            Self::Sqrt => [u - x1.sqrt(), x1 - x2],
            Self::Division => [one / x1 - u, -x2],
            Self::Reciprocal => [u - one / (one / x1), -x2],
            Self::Stiff => [(u - x1) * 1000.0, x1 - x2],
            Self::Integrator => [u, x1 - x2],
            Self::Unreached => [u - x1, one - x2],
            Self::Restless => [u - x1, one + x1 * x1],
            Self::Explosive => [x1 * x1 + u, -x2],
            Self::Nonminimum => [u - x1, x1 * 2.0 - u - x2],
            Self::Slow => [(u - x1) * 0.001, (x1 - x2) * 0.002],
            Self::Damped => [x2, u - x1 - x2],
            Self::Unstable => [u + x1, x1 - x2],
            Self::Hourly => [(u - x1) * 3600.0, (x1 - x2) * 3600.0],
        };
    }
}

/// A config with a domain and a closed loop for x1, changed by `sets`, and `more` sections.
fn experiment(sets: &[&str], more: &str) -> Experiment {
    let text = r#"
        name = "test"
        preset = "ours"
        seed = 1
        [plant]
        van-der-pol = { mu = 1.0 }
        [domain]
        state_low = [-2.0, -2.0]
        state_high = [2.0, 2.0]
        input_low = [-1.0]
        input_high = [1.0]
        [control]
        models = ["rk4"]
        step_s = 0.5
        duration_s = 5.0
        initial_state = [0.5, 0.0]
        controlled = ["x1"]
        q = [1.0]
        r = [1.0]
        state_low = [-2.0, -2.0]
        state_high = [2.0, 2.0]
        input_low = [-1.0]
        input_high = [1.0]
        references = [{ start_s = 0.0, value = [0.5] }]
    "#;
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    Experiment::parse(
        "test.toml".as_ref(),
        &format!("{text}\n{more}"),
        &sets,
        &pinc_config::Plants::built_in(),
    )
    .unwrap()
}

/// The findings, without progress.
fn examine(plant: &dyn DynPlant, experiment: &Experiment) -> Vec<Finding> {
    examine_watched(plant, experiment, Verbosity::Quiet)
}

fn findings(plant: Test, sets: &[&str]) -> Vec<Finding> {
    findings_with(plant, sets, "")
}

fn findings_with(plant: Test, sets: &[&str], more: &str) -> Vec<Finding> {
    examine(&*pinc_expr::into_dyn(plant), &experiment(sets, more))
}

/// Checks that there is a finding of this severity with this place and text, and that it says why
/// and what to change unless it is a fact.
#[track_caller]
fn assert_found(findings: &[Finding], severity: Severity, place: &str, what: &str) {
    let of_kind =
        |f: &&Finding| f.severity == severity && f.place.contains(place) && f.what.contains(what);
    let all: Vec<_> = findings.iter().map(Finding::to_string).collect();
    let found = findings.iter().find(of_kind);
    let found = found.unwrap_or_else(|| panic!("no `{place}: {what}` in\n{}", all.join("\n")));
    if severity != Fact {
        assert!(!found.why.is_empty() && !found.change.is_empty(), "{found}");
    }
}

/// An estimator of both states from x1.
const ESTIMATOR: &str = r#"
    [control.measurement]
    measured = ["x1"]
    [control.estimator]
    kind = "ekf"
    process_sd = [0.01, 0.03]
    measurement_sd = [0.02]
    initial_estimate = [0.5, 0.0]
    initial_sd = [0.1, 0.2]
    gate = 5.0
"#;

/// How far readings may be from what is expected of them, step by step, with the filter of textbooks.
fn widths(steps: usize) -> Vec<f64> {
    // exp(A T) with the eigenvalues -1/2 +- i w.
    let (t, w) = (0.5_f64, 0.75_f64.sqrt());
    let (decay, sine, cosine) = ((-0.5 * t).exp(), (w * t).sin() / w, (w * t).cos());
    let a = [
        [decay * (cosine + 0.5 * sine), decay * sine],
        [-decay * sine, decay * (cosine - 0.5 * sine)],
    ];
    let mut p = [[0.01, 0.0], [0.0, 0.04]];
    let step = |_| {
        let s = p[0][0] + 0.02 * 0.02;
        let corrected = [0, 1].map(|i| [0, 1].map(|j| p[i][j] - p[i][0] * p[0][j] / s));
        let moved =
            a.map(|row| [0, 1].map(|j| row[0] * corrected[0][j] + row[1] * corrected[1][j]));
        p = moved.map(|row| [0, 1].map(|j| row[0] * a[j][0] + row[1] * a[j][1]));
        p[0][0] += 0.01 * 0.01;
        p[1][1] += 0.03 * 0.03;
        5.0 * s.sqrt()
    };
    (0..steps).map(step).collect()
}

/// The findings of the damped plant, which is also the config's, with the estimator.
fn gated(sets: &[&str]) -> Vec<Finding> {
    let derivatives = r#"derivatives = { x1 = "x2", x2 = "u - x1 - x2" }"#;
    let names = r#"states = ["x1", "x2"], inputs = ["u"]"#;
    let plant = format!("plant={{ expression = {{ {names}, {derivatives} }} }}");
    findings_with(Test::Damped, &[&[plant.as_str()], sets].concat(), ESTIMATOR)
}

#[test]
fn the_gate_is_put_into_units() {
    let found = gated(&[]);
    let said =
        "further than this from what is expected is rejected: x1 by 0.5099 in the first step";
    assert_found(&found, Fact, "control.estimator.gate", said);
    let widths = widths(11);
    assert!((widths[0] - 0.5099).abs() < 1e-5);
    let text = &found.iter().find(|f| f.place == "control.estimator.gate").unwrap().what;
    let last = text.split("rehearsed loop, x1 by ").nth(1).unwrap();
    let last: f64 = last.split(' ').next().unwrap().parse().unwrap();
    assert!((last / widths[10] - 1.0).abs() < 1e-3, "{last} {widths:?}");
    assert!(!found.iter().any(|f| f.severity == Warning && f.place.contains("gate")));
    let off = gated(&["control.estimator.gate=off"]);
    assert_found(&off, Fact, "control.estimator.gate", "no reading is rejected");
}

/// Readings of a sound sensor are rejected in the rehearsed loop if the estimator begins elsewhere
/// without knowing it; so is noise that it does not expect.
#[test]
fn a_gate_that_rejects_sound_readings_triggers_a_warning() {
    let wrong = ["control.estimator.initial_estimate=[1.25, 0.0]"];
    let found = gated(&wrong);
    let place = "control.estimator.gate";
    assert_found(&found, Warning, place, "of 11 readings of x1 in the rehearsed loop");
    assert_found(&found, Warning, place, "at 0 s is 0.75 from what is expected, where 0.5099 are");
    let warning = found.iter().find(|f| f.severity == Warning && f.place == place).unwrap();
    assert!(warning.change.contains("initial_sd"), "{warning}");
    let wide = [wrong[0], "control.estimator.initial_sd=[0.3, 0.3]"];
    let found = gated(&wide);
    assert!(!found.iter().any(|f| f.severity == Warning && f.place == place));
    let noisy = ["control.measurement.noise_sd=[0.1]"];
    let found = gated(&noisy);
    assert_found(&found, Warning, place, "the noise of x1 has a standard deviation of 0.1, and");
    let quiet = ["control.measurement.noise_sd=[0.02]"];
    let found = gated(&quiet);
    assert!(!found.iter().any(|f| f.severity == Warning && f.place == place));
}

#[test]
fn a_function_that_is_not_defined_in_the_domain() {
    let found = findings(Test::Sqrt, &[]);
    assert_found(&found, Error, "plant", "x1' is NaN at x1 = -");
    // Half of the domain.
    assert_found(&found, Error, "plant", "random points); from the middle");
    let found = findings(Test::Division, &[]);
    assert_found(&found, Warning, "plant", "x1' is inf at x1 = 0");
    let found = findings(Test::Reciprocal, &[]);
    assert_found(&found, Warning, "plant", "the derivative of x1' in x1 is NaN at x1 = 0");
}

#[test]
fn a_steady_state_without_derivatives() {
    let found = findings(Test::Reciprocal, &["control.references.0.value=[0.0]"]);
    assert_found(&found, Warning, "references[0]", "the derivatives are not finite there");
}

#[test]
fn where_a_function_breaks_is_named() {
    let sets = ["domain.state_low=[-1.0, -2.0]", "domain.state_high=[2.0, 2.0]"];
    let found = findings(Test::Sqrt, &sets);
    let text = &found.iter().find(|f| f.severity == Error).unwrap().what;
    // On the way from the middle, x1 = 0.5, to a negative x1 it is finite up to 0.
    let end = text.split("finite up to x1 = ").nth(1).unwrap();
    let x1: f64 = end.split(&[',', ';'][..]).next().unwrap().parse().unwrap();
    assert!(x1.abs() < 1e-6, "{text}");
}

#[test]
fn steady_states_and_their_modes() {
    let found = findings(Test::Damped, &[]);
    // s^2 + s + 1: -1/2 +- i sqrt(3)/2.
    assert_found(&found, Fact, "references[0], x1 = 0.5, x2 = 0; u = 0.5", "-0.5000 +0.8660i 1/s");
    assert_found(&found, Fact, "references[0]", "x1 = 0.5 is held at x1 = 0.5, x2 = 0 by u = 0.5");
    assert_found(&found, Fact, "", "2 states: x1, x2; 1 input: u");
    assert_found(&found, Fact, "references[0]", "singular values 1, rank 1");
    assert_found(&found, Fact, "domain", "trajectories stay in the training domain");
    assert_found(
        &found,
        Fact,
        "",
        "at 1000 random points of the training domain; there |x1'| <= 1.9",
    );
    assert_found(&found, Fact, "", "start and references are within the bounds");
    assert_found(&found, Fact, "", "no transmission zeros");
    assert_found(
        &found,
        Fact,
        "",
        "rms error of one step of RK4 over the training domain, in its widths",
    );
    assert_found(&found, Fact, "control", "all 10 steps of the closed loop with RK4 succeed");
    assert_found(
        &found,
        Fact,
        "",
        "T = 0.5 s: RK4 has an rms error of 1e-4 of the region's width with 1 substeps",
    );
    assert!(found.iter().all(|f| f.severity == Fact), "{found:?}");
    assert_found(&findings(Test::Restless, &[]), Fact, "", "no steady state was found");
    assert_found(&findings(Test::Unstable, &[]), Fact, "", "1.0000 1/s (doubles in 0.693 s)");
    assert_found(&findings(Test::Integrator, &[]), Fact, "", "neither grows nor decays");
    assert_found(&findings(Test::Integrator, &[]), Fact, "", "the plant integrates");
}

#[test]
fn steps_and_horizons_against_the_modes() {
    let found = findings(Test::Stiff, &[]);
    assert_found(&found, Warning, "references[0]", "stiff: the fastest mode times T is 500");
    assert_found(
        &found,
        Warning,
        "control.rk4_substeps",
        "with 4 substeps RK4 is unstable at 200 of 200 random points of the training domain",
    );
    let found = findings(Test::Stiff, &["control.step_s=50.0", "control.duration_s=50.0"]);
    assert_found(&found, Fact, "", "more than 1e-6 of the region's width with 1024 substeps");
    let change =
        |f: &Finding| f.change.starts_with("rk4_substeps = ") && f.change.ends_with(" or more");
    assert!(found.iter().any(change), "{found:?}");
    let found = findings(Test::Damped, &["control.step_s=5.0", "control.duration_s=50.0"]);
    assert_found(&found, Warning, "references[0]", "T = 5 s is 5 times the slowest time constant");
    // From 0.5 the input -1 moves x1 by 1.5 (1 - exp(-0.0025)) = 3.746e-3 in 2.5 s; the change is
    // 0.25.
    let found = findings(Test::Slow, &["control.initial_state=[0.25, 0.5]"]);
    assert_found(
        &found,
        Warning,
        "control.n2",
        "2.5 s, the inputs can move x1 by 0.01498 of a change",
    );
    // A slow plant whose inputs are strong enough needs no longer horizon.
    let strong = ["control.input_low=[-100.0]", "control.input_high=[100.0]"];
    let found = findings(Test::Slow, &strong);
    assert!(found.iter().all(|f| f.place != "control.n2"), "{found:?}");
}

#[test]
fn outputs_out_of_reach() {
    let sets = ["control.controlled=[\"x2\"]"];
    let found = findings(Test::Unreached, &sets);
    assert_found(&found, Warning, "references[0]", "x2 = 0.5 is no steady state, with any input");
    let sets = ["control.controlled=[\"x2\"]", "control.references.0.value=[1.0]"];
    let found = findings(Test::Unreached, &sets);
    assert_found(&found, Warning, "", "rank 0: singular");
    assert_found(&found, Warning, "", "u has no effect on x2");
}

#[test]
fn a_response_that_first_goes_the_wrong_way() {
    let sets = ["control.controlled=[\"x2\"]", "control.n2=3", "control.nu=3"];
    let found = findings(Test::Nonminimum, &sets);
    assert_found(&found, Warning, "", "transmission zeros 1.0000 1/s: nonminimum phase");
    let sets = ["control.controlled=[\"x2\"]", "control.n2=5"];
    assert_found(&findings(Test::Nonminimum, &sets), Fact, "", "transmission zeros 1.0000 1/s");
}

#[test]
fn references_that_inputs_cannot_hold() {
    let sets = ["control.references.0.value=[1.5]"];
    let found = findings(Test::Damped, &sets);
    assert_found(&found, Warning, "references[0]", "it needs u = 1.5 (bounds -1 to 1)");
}

#[test]
fn values_outside_their_bounds() {
    let sets = ["control.initial_state=[3.0, 0.0]", "control.references.0.value=[-2.5]"];
    let found = findings(Test::Damped, &sets);
    assert_found(&found, Warning, "control.initial_state", "x1 = 3 is outside its bounds");
    assert_found(&found, Warning, "control.references[0]", "x1 = -2.5 is outside its bounds");
    let sets = ["domain.state_high=[1.0, 2.0]", "domain.input_low=[-0.5]"];
    let found = findings(Test::Damped, &sets);
    assert_found(&found, Warning, "domain", "the bounds of x1 reach outside the training domain");
    assert_found(&found, Warning, "domain", "the bounds of u reach outside the training domain");
}

#[test]
fn a_loop_that_leaves_the_domain() {
    let sets = ["domain.state_low=[0.6, -2.0]"];
    let found = findings(Test::Damped, &sets);
    assert_found(&found, Warning, "domain", "the closed loop with RK4: x1 goes down to");
    assert_found(&found, Fact, "domain", "a box that holds all of these trajectories");
    let proposal = found.iter().find(|f| f.what.starts_with("a box")).unwrap();
    let table: toml::Table = proposal.change.parse().unwrap();
    let low = table["domain"]["state_low"][0].as_float().unwrap();
    // From 0.5 to the reference 0.5 and back by little: the proposal is not far below.
    assert!((0.0..0.5).contains(&low), "{proposal}");
}

#[test]
fn a_plant_whose_integration_fails() {
    // From 1.9 it is gone after less than a second, with any input.
    let sets =
        ["control.initial_state=[1.9, 0.0]", "control.step_s=2.0", "control.duration_s=20.0"];
    let found = findings(Test::Explosive, &sets);
    assert_found(&found, Warning, "domain", "the plant breaks off within T from");
    assert_found(&found, Error, "control", "with an integrator as the model");
}

/// A free run from x1 = 1.9, and scenarios from there on.
const FREE: &str = r#"
    [prediction]
    duration_s = 2.0
    initial_state = [1.9, 0.0]
    input_low = [0.5]
    input_high = [1.0]
    [validation]
    duration_s = 2.0
    domain = { state_low = [1.5, 0.0], state_high = [1.9, 0.1], input_low = [0.5], input_high = [1.0] }
"#;

#[test]
fn free_runs_that_leave_the_domain_or_fail() {
    let found = findings_with(Test::Damped, &["domain.state_high=[1.2, 2.0]"], FREE);
    assert_found(&found, Warning, "domain", "the free run of [prediction]: x1 goes up to 1.9");
    assert_found(&found, Warning, "domain", "the validation's scenarios: x1 goes up to");
    let found = findings_with(Test::Explosive, &[], FREE);
    assert_found(
        &found,
        Error,
        "plant",
        "the plant breaks off in 1 of 1 free runs, the first at x1",
    );
    assert_found(&found, Error, "plant", "the plant breaks off in 10 of 10 free runs");
}

/// The findings on `[data]` with one file of these steps.
fn on_measurements(steps: &str, held_out: bool) -> Vec<Finding> {
    let dir = tempfile::tempdir().unwrap();
    let [file, other] = ["m.csv", "held-out.csv"].map(|name| dir.path().join(name));
    for path in [&file, &other] {
        std::fs::write(path, format!("x1_0,x2_0,u,t,x1,x2\n{steps}")).unwrap();
    }
    let held_out = if held_out { format!("held_out = [{other:?}]") } else { String::new() };
    let model = "[model]\nhorizon_s = 0.5\nhidden_layers = 1\nneurons = 4\n[training]";
    let data = format!("[data]\nfiles = [{file:?}]\n{held_out}");
    findings_with(Test::Damped, &[], &format!("{FREE}\n{model}\n{data}"))
}

#[test]
fn measurements_inside_the_domain_outside_of_it_and_unreadable() {
    let found = on_measurements("1,0,0.5,0.5,0.8,\n-1,0.5,0,0.25,0.1,0.8\n", true);
    assert_found(&found, Fact, "data.files", "3 measured values at 2 points (t, y0, u)");
    assert_found(&found, Fact, "data.held_out", "3 measured values at 2 points (t, y0, u)");
    let found = on_measurements("1,0,0.5,0.5,0.8,\n-1,2.5,0,0.25,0.1,0.8\n", false);
    assert_found(&found, Warning, "data.files", "1 of 2 points lie outside the training domain");
    assert_found(&found, Warning, "data.held_out", "no measurements are held out");
    let found = on_measurements("1,0,0.5,0.5,much,\n", true);
    assert_found(&found, Error, "data.files", "m.csv:2: column `x1`: `much` given");
    assert_found(&found, Error, "data.held_out", "held-out.csv:2: column `x1`: `much` given");
}

#[test]
fn nothing_to_look_at() {
    let text = "name = \"t\"\npreset = \"ours\"\nseed = 1\n[plant]\nvan-der-pol = { mu = 1.0 }\n";
    let experiment =
        Experiment::parse("t.toml".as_ref(), text, &[], &pinc_config::Plants::built_in()).unwrap();
    assert_found(
        &examine(&*pinc_expr::into_dyn(Test::Damped), &experiment),
        Warning,
        "",
        "nothing to look at",
    );
}

#[test]
fn the_size_of_the_net_against_the_plants() {
    let net = |layers: usize, neurons: usize| {
        let text = format!(
            r#"
            [model]
            horizon_s = 0.5
            hidden_layers = {layers}
            neurons = {neurons}
            [training]
            [validation]
            duration_s = 2.0
            [validation.domain]
            state_low = [-1.0, -1.0]
            state_high = [1.0, 1.0]
            input_low = [-1.0]
            input_high = [1.0]
            "#
        );
        findings_with(Test::Damped, &[], &text)
    };
    let usual = net(3, 20);
    assert_found(&usual, Fact, "model", "3 layers of 20 neurons (982 weights) are usual");
    assert!(usual.iter().all(|f| f.severity == Fact), "{usual:?}");
    assert_found(&net(2, 1), Warning, "model.neurons", "1 neurons for 2 states are too few");
    assert_found(&net(8, 64), Warning, "model", "29570 weights are far more than");
}

/// By the error constant of order 5, |T|^5/120 of modes of size 1: 0.087 at T = 1.6 and 0.0083 at
/// T = 1, times 0.3 or so for points all over the box.
#[test]
fn an_integrator_may_be_wrong_by_a_hundredth_of_the_box() {
    let with = |step_s: &str| {
        let step_s = format!("control.step_s={step_s}");
        findings(Test::Damped, &[&step_s, "control.duration_s=8.0", "control.rk4_substeps=1"])
    };
    let found = with("1.6");
    assert_found(&found, Warning, "control.rk4_substeps", "with 1 substeps RK4 is wrong by 0.0");
    let found = with("1.0");
    let warned = |f: &&Finding| f.place == "control.rk4_substeps" && f.severity == Warning;
    assert_eq!(found.iter().find(warned), None);
}

/// The table has the numbers of `pinc run`: the same points, the same truth.
#[test]
fn the_errors_of_rk4_match_a_run() {
    use pinc_net::DomainTruth;
    use pinc_ode::Rk4;
    let experiment = experiment(&[], "");
    let found = findings(Test::Damped, &[]);
    let domain = experiment.domain.as_ref().unwrap();
    let truth = DomainTruth::draw(&Test::Damped, domain, 0.5, 4096, 1e-12, 1);
    for substeps in [1, 2, 4] {
        let rms = truth.rms(&mut Rk4::new(Test::Damped, 0.5, substeps));
        assert_found(&found, Fact, "", &format!("{substeps}: {rms:.1e}"));
    }
    assert_found(&found, Fact, "", "the largest error of one step of RK4 x4 that a search found");
}

#[test]
fn a_continuum_of_steady_states_is_called_one() {
    let found = findings(Test::Integrator, &[]);
    // x1' = u: with u = 0 any x1 rests, and x2 with it.
    assert_found(&found, Fact, "", "steady states are a continuum: with this input x1, x2 can be");
    let found = findings(Test::Damped, &[]);
    assert!(found.iter().all(|f| !f.what.contains("continuum")), "{found:?}");
    // The input in the middle of its bounds is no rest; that does not mean that there is none.
    let sets = [
        "control.input_low=[-0.5]",
        "domain.input_low=[-0.5]",
        "control.references.0.value=[3.0]",
        "control.state_high=[4.0, 4.0]",
        "domain.state_high=[4.0, 4.0]",
    ];
    let found = findings(Test::Integrator, &sets);
    assert!(found.iter().all(|f| !f.what.contains("no steady state was")), "{found:?}");
}

/// x2 grows as in a batch, while x1 is kept where it is.
#[test]
fn a_reference_that_is_kept_while_the_plant_moves_on_is_no_fault() {
    let sets = [
        "control.state_high=[2.0, 20.0]",
        "domain.state_high=[2.0, 20.0]",
        "control.initial_input=[0.5]",
    ];
    let found = findings(Test::Restless, &sets);
    // From 0 at a rate of 1.25, looked at from 3 s to the last sample before 4 s.
    let kept = "x1 = 0.5 is kept by the closed loop from t = 3 s to ";
    assert_found(&found, Fact, "control.references[0]", kept);
    assert_found(&found, Fact, "control.references[0]", "x2 goes from 3.75 to 4.");
    assert_found(&found, Fact, "the closed loop at t = 3.", "modes");
    let about = |f: &&Finding| f.place.starts_with("control.references") && f.severity != Fact;
    assert_eq!(found.iter().find(about), None);
}

#[test]
fn rates_in_another_unit_of_time_are_asked_about() {
    let found = findings(Test::Hourly, &[]);
    assert_found(
        &found,
        Warning,
        "plant",
        "are the equation's rates per min instead of per second?",
    );
    let found = findings(Test::Hourly, &["time_unit=\"h\""]);
    assert_found(&found, Warning, "plant", "are the equation's rates per h instead of per second?");
    assert_found(&found, Fact, "", " per h");
    let asks = |f: &Finding| f.what.contains("instead of per second");
    // One fast state is stiffness.
    assert!(!findings(Test::Stiff, &[]).iter().any(asks));
    assert!(!findings(Test::Slow, &["time_unit=\"h\""]).iter().any(asks));
}

#[test]
fn a_net_of_a_stiff_equation_is_to_be_distilled() {
    let net = |plant: Test, source: &str| {
        let text = format!(
            r#"
            [model]
            horizon_s = 0.5
            hidden_layers = 3
            neurons = 20
            [training]
            source = "{source}"
            [validation]
            duration_s = 2.0
            [validation.domain]
            state_low = [-1.0, -1.0]
            state_high = [1.0, 1.0]
            input_low = [-1.0]
            input_high = [1.0]
            "#
        );
        findings_with(plant, &[], &text)
    };
    let found = net(Test::Stiff, "physics");
    assert_found(&found, Warning, "training.source", "fastest mode times T is 500");
    for found in [net(Test::Stiff, "integrator"), net(Test::Damped, "physics")] {
        assert!(found.iter().all(|f| f.place != "training.source"), "{found:?}");
    }
}

#[test]
fn a_metric_that_no_loop_has_is_an_error() {
    let tune = "[tune]\nranges = [{ key = \"control.r.0\", low = 0.1, high = 1.0 }]\n";
    let with = |cost: &str| findings_with(Test::Damped, &[], &format!("{tune}{cost}"));
    assert_found(&with("cost = { iea = 1.0 }"), Error, "tune.cost", "expected one of");
    assert!(with("cost = { iae = 1.0 }").iter().all(|f| f.place != "tune.cost"));
}
