//! First plans of shipped configs with a `[control.cost]`, against IPOPT's on the same
//! discretization, as `benches/peers/casadi_cost.py` found them: beside ours for the double pendulum
//! and the periodic reactor, where IPOPT finds worse minima from elsewhere. And first steps that
//! Gauss-Newton's Hessian alone does not find.

use crate::common::repository;
use pinc_config::{Experiment, Plants};
use pinc_mpc::SqpStatus;
use pinc_runs::{Follow, LiveController};
use serde::Deserialize;

/// What IPOPT found.
#[derive(Deserialize)]
struct Answer {
    name: String,
    objective: f64,
    /// All inputs of the plan.
    inputs: Vec<f64>,
    status: String,
}

fn answers() -> Vec<Answer> {
    let lines = include_str!("optima.jsonl").lines();
    lines.map(|line| serde_json::from_str(line).expect("an answer")).collect()
}

/// The cost agrees to 1e-6, and so do the inputs, in parts of their ranges.
#[test]
fn first_plans_match_ipopt() {
    let answers = answers();
    assert!(answers.len() >= 8, "{}", answers.len());
    for Answer { name, objective, inputs, status } in answers {
        assert_eq!(status, "Solve_Succeeded", "{name}");
        let path = repository(&format!("configs/gallery/{name}.toml"));
        let experiment = Experiment::load(&path, &[], &Plants::built_in())
            .unwrap_or_else(|error| panic!("{error}"));
        let mut controller = LiveController::new(&experiment, None, None, "the test").unwrap();
        let spec = controller.spec().clone();
        let step = controller.step(&spec.initial_state, Follow::Config, None).unwrap();
        assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false), "{name}");
        let cost = step.cost.expect("a config with a cost");
        let difference = (cost - objective).abs() / objective.abs().max(1e-3);
        assert!(difference < 1e-6, "{name}: {cost} {objective}");
        let found = controller.nmpc().plan().inputs();
        assert_eq!(found.len(), inputs.len(), "{name}");
        for (i, (found, expected)) in found.iter().zip(&inputs).enumerate() {
            let k = i % spec.input_low.len();
            let range = spec.input_high[k] - spec.input_low[k];
            let off = (found - expected).abs() / range;
            assert!(off < 1e-4, "{name}, input {i}: {found} {expected}");
        }
    }
}

/// The cost of a config's first plan, which converges.
#[track_caller]
fn first_cost(text: &str) -> f64 {
    let (status, cost) = first_plan(text);
    assert_eq!(status, SqpStatus::Converged);
    cost
}

fn controller_of(text: &str, sets: &[String]) -> LiveController {
    let parsed = Experiment::parse("text.toml".as_ref(), text, sets, &Plants::built_in());
    LiveController::new(&parsed.unwrap(), None, None, "the test").unwrap()
}

/// How a config's first plan ends, and its cost.
fn first_plan(text: &str) -> (SqpStatus, f64) {
    let mut controller = controller_of(text, &[]);
    let start = controller.spec().initial_state.clone();
    let step = controller.step(&start, Follow::Config, None).unwrap();
    (step.status, step.cost.expect("a config with a cost"))
}

/// Two rods are swung up past an obstacle, over 100 stages of unstable dynamics. From the same start IPOPT
/// ends at 108.0968.
#[test]
fn a_double_pendulum_is_swung_up() {
    let path = repository("configs/gallery/double-pendulum.toml");
    let experiment = Experiment::load(&path, &[], &Plants::built_in()).unwrap();
    let mut controller = LiveController::new(&experiment, None, None, "the test").unwrap();
    let mut state = controller.spec().initial_state.clone();
    for k in 0..3 {
        let step = controller.step(&state, Follow::Config, None).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{k}");
        assert!(k > 0 || step.cost.is_some_and(|cost| cost < 105.2), "{:?}", step.cost);
        state = controller.nmpc().plan().states()[..6].to_vec();
    }
}

#[test]
fn a_cost_that_is_wrong_is_named_with_its_key() {
    let path = repository("configs/gallery/batch-reactor.toml");
    for (set, expected) in [
        ("control.cost.stage=\"-Q/hour\"", "`control.cost.stage`"),
        ("control.cost.terminal=\"-P +\"", "`control.cost.terminal`"),
        ("control.cost.parameters={ P = 1.0 }", "`control.cost.parameters.P`"),
        ("control.cost.parameters={ t = 1.0 }", "`control.cost.parameters.t`"),
        ("control.cost={}", "`control.cost`"),
        ("control.sqp.real_time=true", "`control.sqp.real_time`"),
        ("control.controlled=[\"P\"]", "`control.q`"),
    ] {
        let error = Experiment::load(&path, &[set.to_owned()], &Plants::built_in())
            .unwrap_err()
            .to_string();
        assert!(error.contains(expected), "{set}: {error}");
    }
}

/// The cost is concave along some plans. Because steps without their negative curvature are lengthened,
/// 39 programs are enough; with whole steps, 300 are not. The expected cost is IPOPT's.
#[test]
fn steps_along_negative_curvature_are_lengthened() {
    let text = r#"
name = "downwards"
preset = "ours"
seed = 1
[plant.expression]
states = ["x0", "x1", "x2"]
inputs = ["u0"]
[plant.expression.derivatives]
x0 = "-0.3924*x0 - 0.1*x0^3 + 0.6271*cos(-0.6961*x1) - 0.1609*x1*x0 - 0.6503*u0"
x1 = "-0.9815*x1 - 0.1*x1^3 + 0.5835*x1^2 + 0.6796*u0"
x2 = "-0.7519*x2 - 0.1*x2^3 - 0.8068*sin(-1.6582*x2) + 0.9812*exp(-x1^2) - 0.8045*u0"
[control.cost]
stage = "0.3900*x1*u0 - 0.6665*tanh(x1) + 0.3001*u0*x0"
terminal = "-0.7016*x1*x1 - 0.6906*x1"
[control]
models = ["rk4"]
step_s = 0.118
duration_s = 0.118
rk4_substeps = 2
initial_state = [-0.18080769881474956, -0.6463927932426534, 0.9046346681500534]
n2 = 10
nu = 10
input_low = [-1.4790400595749353]
input_high = [1.6310512987993186]
sqp = { max_iterations = 100 }
r = [0.2506080283289293]
"#;
    let cost = first_cost(text);
    assert!((cost + 0.555_098_879_559_826_6).abs() < 1e-8, "{cost}");
}

/// Its linearized constraints contradict each other at first, so that hard ones become soft. At the end the
/// weight of their violations times what rounding leaves of these is above the tolerance.
#[test]
fn a_plan_that_keeps_hard_bounds_to_rounding_is_converged() {
    let text = r#"
name = "kept"
preset = "ours"
seed = 1
[plant.expression]
states = ["x0", "x1", "x2"]
inputs = ["u0", "u1"]
derivatives = { x0 = "(-0.5844*x0) + (-0.1*x0^3) + (0.8687*sin(0.8568*x0)) + (0.7000*sin(0.5333*x0)) + (0.3143*u0)", x1 = "(-0.3232*x1) + (-0.1*x1^3) + (-0.8044*x1*x1) + (0.6460*u1)", x2 = "(-0.6134*x2) + (-0.1*x2^3) + (0.9765*sin(-1.2851*x2)) + (0.4082*u0)" }
outputs = { y = "(-0.7368*exp(-x0^2)) + (-0.9465*cos(0.7298*x0))" }
[control.cost]
stage = "(0.7551*x1*u0) + (0.8497*x0) + (0.3594*u0^2) + (0.4614*u1^2)"
terminal = "(-0.9271*cos(-1.4614*x0)) + (0.5180*x1)"
[control]
models = ["rk4"]
step_s = 0.281
duration_s = 0.281
rk4_substeps = 1
initial_state = [-0.933946586560912, -0.9140022149776477, 0.30033334195630146]
n2 = 20
nu = 20
input_low = { u0 = -1.079979647671322, u1 = -0.2850211734704122 }
input_high = { u0 = 1.6090811075657552, u1 = 1.3797257385698345 }
sqp = { max_iterations = 300 }
output_low = { y = -inf }
output_high = { y = -0.9278734802300043 }
first_plan = { input = [0.0, 0.0] }
"#;
    let cost = first_cost(text);
    assert!((cost + 41.387_450_848).abs() < 1e-6, "{cost}");
}

/// Where its first inputs lead, in stretched time, x1 is almost beyond all bounds: the plan is found from
/// states that stay where they are. On the way rounding decides which minimum is found, and of half of the
/// starts whether one is.
#[test]
fn a_first_plan_that_leads_far_away_begins_anew() {
    let text = r#"
name = "escapes"
preset = "ours"
seed = 1
[plant.expression]
states = ["x0", "x1", "x2", "x3"]
inputs = ["u0", "stretch"]
derivatives = { x0 = "(-0.9773*x0) + (-0.1*x0^3) + (-0.9316*x1*u0) + (-0.9661*tanh(x2)) + (0.9598*u0)", x1 = "(-0.5440*x1) + (-0.1*x1^3) + (0.4447*sin(1.2515*x0)) + (-0.9173*x1^2) + (0.6491*u0)", x2 = "(-0.9162*x2) + (-0.1*x2^3) + (-0.7782*sqrt(1 + x0^2))", x3 = "(-0.8228*x3) + (-0.1*x3^3) + (-0.7126*tanh(x3)) + (-0.2925*x3*x1)" }
[control.cost]
stage = "(0.6479*x1*u0) + (-0.8290*sqrt(1 + x1^2)) + (0.1052*x0*u0) + (0.4275*u0^2) + (1)"
[control]
models = ["rk4"]
step_s = 0.338
duration_s = 0.338
rk4_substeps = 2
initial_state = [-0.9399311386364941, 0.22180628631408483, -0.23786691489266598, 0.5986710678524976]
n2 = 15
nu = 9
input_low = { u0 = -1.331140363838098, stretch = 0.4 }
input_high = { u0 = 0.3118939468420092, stretch = 3.0 }
sqp = { max_iterations = 300 }
free_time = "stretch"
end_state = { x0 = -1.320807011302381 }
initial_input = { u0 = 0.0, stretch = 1.0 }
"#;
    let from = |part: f64| {
        let start = (0.221_806_286_314_084_83 * (1.0 + part)).to_string();
        first_plan(&text.replace("0.22180628631408483", &start))
    };
    let plans: Vec<_> = (-8..8).map(|k| from(1e-7 * f64::from(k))).collect();
    // IPOPT's is -16.57448 from the same inputs; there are lower minima.
    let found = |plan: &&(SqpStatus, f64)| plan.0 == SqpStatus::Converged && plan.1 < -16.5744;
    assert!(plans.iter().filter(found).count() > 1, "{plans:?}");
}

/// How the first step of a controller from x ends, and its input.
#[track_caller]
fn first_input(text: &str, x: &[f64], method: &str) -> (SqpStatus, Vec<f64>) {
    let text = format!("preset = \"ours\"\nseed = 1\n{text}");
    let mut controller = controller_of(&text, &[format!("control.sqp.qp={method:?}")]);
    let step = controller.step(x, Follow::Config, None).unwrap();
    (step.status, step.u.to_vec())
}

/// A heater above its temperature bound is switched off from any current; losses by the square of an input
/// are not made up for by that input; a bound holds beside one that is nearly the same. IPOPT's inputs.
#[test]
fn inputs_whose_gradient_vanishes_at_their_bound() {
    let heater = r#"
        name = "heater"
        plant.expression = { states = ["T"], inputs = ["i"], derivatives = { T = "-0.3*T + 0.8*i^2" } }
        [control]
        models = ["rk4"]
        step_s = 0.25
        duration_s = 5.0
        initial_state = [0.9]
        initial_input = [0.5]
        controlled = ["T"]
        q = [10.0]
        r = [0.001]
        n2 = 4
        nu = 4
        input_low = [0.0]
        input_high = [1.0]
        state_high = [0.4]
        state_softness = "exact"
        references = [{ start_s = 0.0, value = [0.6] }]
    "#;
    let losses = r#"
        name = "losses"
        [plant.expression]
        states = ["a", "b"]
        inputs = ["u", "v"]
        derivatives = { a = "-0.7*a^2*tanh(b) + u", b = "1.2*sin(a) - 0.4*b + 0.3*v*a" }
        outputs = { w = "a*b + 0.5*u^2" }
        [control]
        models = ["rk4"]
        step_s = 0.4
        duration_s = 4.0
        initial_state = [0.7, 1.2]
        controlled = ["w"]
        q = [1.0]
        r = [0.1, 0.1]
        n2 = 8
        nu = 8
        input_low = [0.0, -2.0]
        input_high = [2.0, 2.0]
        output_high = [0.8]
        output_softness = { penalty = [5.0] }
        references = [{ start_s = 0.0, value = [0.5] }]
    "#;
    let twins = r#"
        name = "twins"
        [plant.expression]
        states = ["x", "z"]
        inputs = ["u", "v"]
        derivatives = { x = "-0.37*x + 0.46*sin(z) + 0.99*u", z = "-0.31*z" }
        outputs = { y = "x + v^2" }
        [control]
        models = ["rk4"]
        step_s = 0.34
        duration_s = 3.4
        initial_state = [0.0, 0.0]
        initial_input = [0.5, 0.2]
        controlled = ["x"]
        q = [1.0]
        r = [0.1, 0.1]
        n2 = 8
        nu = 5
        input_low = [0.0, 0.01]
        input_high = [1.0, 1.0]
        state_high = [0.3, inf]
        state_softness = { penalty = [100.0, 100.0] }
        output_high = [0.3]
        output_softness = { penalty = [100.0] }
        references = [{ start_s = 0.0, value = [0.96] }]
    "#;
    let mut cases = vec![
        (losses, vec![0.825_796_486_361_381_5, 1.194_361_675_567_756_6], vec![0.0, -2.0]),
        (twins, vec![-0.566_801_205_738_773_2, -0.155_766_848_834_565_37], vec![1.0, 0.136_666_67]),
    ];
    cases.extend((0..12).map(|k| (heater, vec![0.45 + 0.08 * f64::from(k)], vec![0.0])));
    for (text, x, expected) in cases {
        for method in ["auto", "riccati"] {
            let (status, u) = first_input(text, &x, method);
            assert_eq!(status, SqpStatus::Converged, "{method} at {x:?}");
            for (found, expected) in u.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-6, "{method} at {x:?}: {u:?}");
            }
        }
    }
    // Hard bounds that cannot be met are violated as little as possible.
    let hard = heater.replace("state_softness = \"exact\"\n", "");
    let (status, u) = first_input(&hard, &[0.9], "auto");
    assert_eq!(status, SqpStatus::InfeasibleQp);
    assert!(u[0] < 1e-6, "{u:?}");
    let at = [0.825_796_486_361_381_5, 1.194_361_675_567_756_6];
    for (softness, expected) in [("hard", SqpStatus::InfeasibleQp), ("exact", SqpStatus::Converged)]
    {
        let other = losses.replace("{ penalty = [5.0] }", &format!("{softness:?}"));
        let (status, u) = first_input(&other, &at, "auto");
        assert_eq!(status, expected, "{softness}");
        assert!(u[0].abs() < 1e-6 && (u[1] + 2.0).abs() < 1e-6, "{softness}: {u:?}");
    }
}
