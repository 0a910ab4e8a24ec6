//! Control problems with a free end time, whole inputs and steady-state targets, against answers
//! that are known otherwise.

use crate::common::{outcome, pinc, repository};
use pinc_config::{Experiment, Plants};
use pinc_mpc::SqpStatus;
use pinc_runs::{Follow, LiveController};
use serde_json::Value;
use std::path::Path;

fn load(config: &str, sets: &[&str]) -> Result<Experiment, String> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let loaded = Experiment::load(&repository(config), &sets, &Plants::built_in());
    loaded.map_err(|error| error.to_string())
}

fn parse(text: &str, sets: &[&str]) -> Result<Experiment, String> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let parsed = Experiment::parse("text.toml".as_ref(), text, &sets, &Plants::built_in());
    parsed.map_err(|error| error.to_string())
}

fn controller_of(experiment: &Experiment) -> LiveController {
    LiveController::new(experiment, None, None, "the test").unwrap()
}

/// The status, cost and inputs of the first plan.
#[track_caller]
fn first_plan(config: &str, sets: &[&str]) -> (SqpStatus, f64, Vec<f64>) {
    let experiment = load(config, sets).unwrap_or_else(|error| panic!("{error}"));
    let mut controller = controller_of(&experiment);
    let x = controller.spec().initial_state.clone();
    let step = controller.step(&x, Follow::Config, None).unwrap();
    let (status, cost) = (step.status, step.cost.expect("a config with a cost"));
    (status, cost, controller.nmpc().plan().inputs().to_vec())
}

const MINIMUM_TIME: &str = "configs/gallery/minimum-time.toml";
const FISHING: &str = "configs/gallery/fishing.toml";
const ORBIT: &str = "configs/gallery/periodic-reactor.toml";
const CRANE: &str = "configs/gallery/crane.toml";
const TARGETS: &str = "configs/estimation/targets.toml";

/// The shortest time does not depend on the unit of the angle, where the bounds say how far it goes.
#[test]
fn the_shortest_time_is_found_in_degrees_and_milliradians() {
    let text = std::fs::read_to_string(repository(CRANE)).unwrap();
    for unit in [1.0, 180.0 / std::f64::consts::PI, 1e3, 1e4] {
        let replaced = |text: &str, from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            text.replace(from, to)
        };
        let rate = format!("-{unit}*(g*sin(angle/{unit}) + acceleration*cos(angle/{unit}))/rope");
        let text = replaced(&text, "-(g*sin(angle) + acceleration*cos(angle))/rope", &rate);
        let bounds =
            |side: f64| format!("angle = {}, rate = {}", side * 0.25 * unit, side * 3.0 * unit);
        let text = replaced(&text, "angle = -0.25", &bounds(-1.0));
        let text = replaced(&text, "angle = 0.25", &bounds(1.0));
        let mut controller = controller_of(&parse(&text, &[]).unwrap());
        let step = controller.step(&[0.0; 4], Follow::Config, None).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{unit}");
        let cost = step.cost.unwrap();
        assert!((cost - 2.868933).abs() < 1e-5, "{unit}: {cost}");
    }
}

/// A plan that breaks the model's equations is not followed, and its cost is none.
#[test]
fn a_plan_that_is_not_followed_has_no_cost() {
    let mut controller = controller_of(&load(CRANE, &["control.sqp.max_iterations=3"]).unwrap());
    let step = controller.step(&[0.0; 4], Follow::Config, None).unwrap();
    assert_eq!(step.status, SqpStatus::IterationLimit);
    assert!(step.cost.unwrap().is_nan() && !step.curvature_dropped, "{:?}", step.cost);
}

/// From rest to rest over d with |a| <= A takes 2 sqrt(d/A): here 2 s, then sqrt(8) s.
#[test]
fn the_shortest_time_of_a_double_integrator_is_bang_bang() {
    let without = "control.r=[0.0, 0.0]";
    let (status, cost, inputs) = first_plan(MINIMUM_TIME, &[without]);
    assert_eq!(status, SqpStatus::Converged);
    assert!((cost - 2.0).abs() < 1e-6, "{cost}");
    for (j, u) in inputs.chunks_exact(2).enumerate() {
        let expected = if j < 5 { 1.0 } else { -1.0 };
        assert!((u[0] - expected).abs() < 1e-4 && (u[1] - 1.0).abs() < 1e-6, "{j}: {u:?}");
    }
    // With a first stage that fits, ten equal stages again.
    let step = 0.2 * 2.0_f64.sqrt();
    let sets = [
        without,
        "control.end_state={ position = 2.0, speed = 0.0 }",
        &format!("control.step_s={step:?}"),
        &format!("control.duration_s={:?}", 10.0 * step),
    ];
    let (_, cost, _) = first_plan(MINIMUM_TIME, &sets);
    assert!((cost - 8.0_f64.sqrt()).abs() < 1e-6, "{cost}");
}

/// 1.344657 is IPOPT's relaxed optimum on this grid (`benches/peers/casadi_cost.py`), 1.34408 the one
/// in continuous time; 1.349985 is the cost of its sum-up rounding, summed by `NumPy`.
#[test]
fn fishing_costs_what_is_known() {
    let (status, relaxed, _) = first_plan(FISHING, &["control.integer=[]"]);
    assert_eq!(status, SqpStatus::Converged);
    assert!((relaxed - 1.344_657_259).abs() < 1e-6, "{relaxed}");
    let (status, rounded, inputs) = first_plan(FISHING, &[]);
    assert_eq!(status, SqpStatus::Rounded);
    assert!((rounded - 1.349_985_316).abs() < 1e-6, "{rounded}");
    assert!(inputs.iter().all(|u| (u - u.round()).abs() < f64::MIN_POSITIVE), "{inputs:?}");
}

/// Of all 4096 plans of twelve stages, summed by `NumPy`, this one costs least; sum-up rounding costs
/// 3.01 there.
#[test]
fn branch_and_bound_finds_the_best_of_all_switches() {
    let coarse = [
        "control.step_s=1.0",
        "control.rk4_substeps=8",
        "control.n2=12",
        "control.nu=12",
        "control.integer_programs=1000",
    ];
    let (status, cost, inputs) = first_plan(FISHING, &coarse);
    assert_eq!(status, SqpStatus::Converged);
    assert!((cost - 1.676_752_504).abs() < 1e-6, "{cost}");
    let best = [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(inputs, best);
    // Too few programs are said.
    let few = [&coarse[..4], &["control.integer_programs=1"]].concat();
    assert_eq!(first_plan(FISHING, &few).0, SqpStatus::Rounded);
}

/// A battery between a grid and a load, by prices that are known ahead: it buys 4 kWh at .1 in the first
/// two hours, evenly because of the losses, and the load has them when the price is .3.
#[test]
fn prices_may_change_and_are_known_ahead() {
    let config = r#"
name = "battery"
preset = "ours"
seed = 1
[plant.expression]
states = ["stored"]
inputs = ["charge"]
parameters = { price = 0.1, load = 1.0 }
time_unit = "h"
derivatives = { stored = "charge" }
outputs = { grid = "load + charge" }
[domain]
state_low = [0.0]
state_high = [5.0]
input_low = [-2.0]
input_high = [4.0]
parameters = { price = [0.0, 1.0], load = [0.0, 5.0] }
[control]
models = ["rk4"]
step_s = 1800.0
duration_s = 14400.0
initial_state = [0.0]
n2 = 8
nu = 8
state_low = [0.0]
input_low = [-2.0]
input_high = [4.0]
cost = { stage = "price*grid + 1e-3*charge^2" }
parameter_schedule = [{ start_s = 0.0, values = { price = 0.1 } }, { start_s = 7200.0, values = { price = 0.3, load = 2.0 } }]
plant_schedule = [{ start_s = 7200.0, values = { load = 2.0 } }]
parameter_preview = true
"#;
    let mut config = config.to_owned();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("battery.toml");
    let mut costs = Vec::new();
    for preview in ["true", "false"] {
        std::fs::write(&path, &config).unwrap();
        let mut command = pinc(&["control"]);
        command.arg(&path).arg("--out").arg(dir.path().join(preview));
        assert_eq!(outcome(&mut command).code, Some(0));
        costs.push(run_in(&dir.path().join(preview))["cost"]["first_plan"].as_f64().unwrap());
        config = config.replace("parameter_preview = true", "parameter_preview = false");
    }
    // 2 h of (1 + 2) kW at .1, losses of 2^2 in all 4 h; without preview nothing is bought for later.
    assert!((costs[0] - (0.6 + 0.016)).abs() < 1e-7, "{costs:?}");
    assert!((costs[1] - 0.4).abs() < 1e-7, "{costs:?}");
    let unused = parse(&config.replace("price*grid", "0.1*grid"), &[]).unwrap_err();
    assert!(unused.contains("`plant.expression.parameters.price`: no expression"), "{unused}");
}

/// Rates and costs per hour over hours are those per second over seconds.
#[test]
fn a_cost_is_integrated_in_the_equations_unit_of_time() {
    let hours = [
        "control.integer=[]",
        "plant.expression.time_unit=\"h\"",
        "control.step_s=720.0",
        "control.duration_s=43200.0",
    ];
    let (_, hourly, inputs) = first_plan(FISHING, &hours);
    let (_, cost, expected) = first_plan(FISHING, &["control.integer=[]"]);
    assert!((hourly - cost).abs() < 1e-9, "{hourly} {cost}");
    for (found, expected) in inputs.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-5, "{found} {expected}");
    }
}

/// The metrics of the loop whose results are in a directory.
fn run_in(directory: &Path) -> Value {
    let metrics = std::fs::read_to_string(directory.join("metrics.json")).unwrap();
    serde_json::from_str::<Value>(&metrics).unwrap()["control"][0].clone()
}

/// How far the levels are from their references at the end, and the nearest values that can be held.
fn at_the_end(sets: &[&str]) -> ([f64; 2], Value) {
    let dir = tempfile::tempdir().unwrap();
    let mut command = pinc(&["control"]);
    command.arg(repository(TARGETS)).arg("--out").arg(dir.path().join("run"));
    command.args(["--set", "control.repetitions=1"]);
    sets.iter().for_each(|set| _ = command.args(["--set", set]));
    let done = outcome(&mut command);
    assert_eq!(done.code, Some(0), "{done:?}");
    let run = run_in(&dir.path().join("run"));
    let offset = |name: &str| run["offset"][name][0].as_f64().unwrap().abs();
    (["h1", "h2"].map(offset), run["nearest_held"].clone())
}

#[test]
fn a_target_leaves_no_offset_whatever_the_weights_of_the_inputs() {
    let ([h1, h2], nearest) = at_the_end(&[]);
    assert!(h1 < 1e-3 && h2 < 1e-3, "{h1} {h2}");
    assert!(nearest["u1"].is_number() && nearest["h1"].is_null(), "{nearest}");
    let ([h1, h2], _) = at_the_end(&["control.target=false"]);
    assert!(h1.max(h2) > 0.1, "{h1} {h2}");
    // Level 1 of 12.4 cm needs more than 2.9 V of a pump.
    let (_, nearest) = at_the_end(&["control.input_high=[2.5, 2.5]"]);
    assert!(nearest["h1"].as_f64().is_some_and(|h1| h1 < 12.0), "{nearest}");
}

/// A flow in m^3/s that cannot be at its reference is named like one in l/h.
#[test]
fn what_cannot_be_held_is_named_in_any_unit() {
    let nearest = [1.0, 1e-8].map(|unit| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("vessel.toml");
        let text = format!(
            r#"
            name = "vessel"
            preset = "ours"
            seed = 1
            [plant.expression]
            states = ["h"]
            inputs = ["u"]
            derivatives = {{ h = "u/{unit:e} - h" }}
            [control]
            models = ["rk4"]
            step_s = 0.2
            duration_s = 4.0
            n2 = 8
            nu = 8
            target = true
            initial_state = [0.5]
            controlled = ["h", "u"]
            q = [1.0, {:e}]
            r = [0.0]
            input_low = [0.0]
            input_high = [{:e}]
            references = [{{ start_s = 0.0, value = [0.7, {:e}] }}]
            [control.estimator]
            kind = "ekf"
            process_sd = [0.01]
            measurement_sd = [0.01]
            initial_estimate = [0.5]
            initial_sd = [0.1]
            "#,
            0.01 / (unit * unit),
            2.0 * unit,
            0.3 * unit
        );
        std::fs::write(&path, text).unwrap();
        let mut command = pinc(&["control"]);
        command.arg(&path).arg("--out").arg(dir.path().join("run"));
        assert_eq!(outcome(&mut command).code, Some(0));
        run_in(&dir.path().join("run"))["nearest_held"]["u"].as_f64().unwrap() / unit
    });
    assert!(nearest[0] > 0.5 && (nearest[0] / nearest[1] - 1.0).abs() < 1e-3, "{nearest:?}");
}

#[test]
fn what_does_not_go_together_is_named() {
    for (config, sets, expected) in [
        (MINIMUM_TIME, &["control.free_time=\"strech\""][..], "`control.free_time`"),
        (MINIMUM_TIME, &["control.input_low={ acceleration = -1.0, stretch = 0.0 }"], "a factor"),
        (MINIMUM_TIME, &["control.cost.stage=\"1 + t\""], "`t` in [control.cost]"),
        (MINIMUM_TIME, &["control.end_state={ place = 1.0 }"], "`control.end_state.place`"),
        (MINIMUM_TIME, &["control.state_high={ position = 0.5 }"], "`control.end_state.position`"),
        (FISHING, &["control.integer=[\"fish\"]"], "`control.integer[0]`"),
        (ORBIT, &["control.periodic=[\"c\"]"], "`control.periodic[0]`"),
        (ORBIT, &["control.end_state={ a = 0.1 }"], "`control.periodic[0]`"),
        (FISHING, &["control.input_high=[0.5]"], "a whole number"),
        (FISHING, &["control.sqp.real_time=true"], "`control.sqp.real_time`"),
        (FISHING, &["control.target=true"], "control.estimator"),
    ] {
        let error = load(config, sets).unwrap_err();
        assert!(error.contains(expected), "{sets:?}: {error}");
    }
    for (config, key) in [
        (MINIMUM_TIME, "control.free_time"),
        (FISHING, "control.integer"),
        (ORBIT, "control.periodic"),
        (TARGETS, "control.target"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let mut command = pinc(&["export", "--to", "c", "--only", "rk4"]);
        command.arg(repository(config)).arg("--out").arg(dir.path().join("c"));
        outcome(&mut command).assert_refused(&[key]);
    }
}

/// At the best steady state, which costs -0.1693, no first derivative is in favour of an orbit. Each plan ends where
/// it begins.
#[test]
fn an_orbit_beats_the_best_steady_state() {
    let experiment = load(ORBIT, &[]).unwrap();
    let mut controller = controller_of(&experiment);
    let mut x = controller.spec().initial_state.clone();
    for k in 0..12 {
        let step = controller.step(&x, Follow::Config, None).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{k}");
        let cost = step.cost.unwrap();
        assert!(k > 0 || cost < -0.1705, "{cost}");
        let states = controller.nmpc().plan().states();
        let end = &states[states.len() - 3..];
        assert!(end.iter().zip(&x).all(|(end, x)| (end - x).abs() < 1e-7), "{k}: {end:?} {x:?}");
        x = states[..3].to_vec();
    }
}

/// Negative curvature and a least height, with active rows that change in every program: the barrier finds
/// each plan, which programs alone do not in 300.
#[test]
fn a_kite_that_is_held_up_by_its_least_height_is_planned_in_few_steps() {
    let experiment = load("benches/outside/dompc/kite.toml", &[]).unwrap();
    let mut controller = controller_of(&experiment);
    let mut x = controller.spec().initial_state.clone();
    for k in 0..40 {
        let step = controller.step(&x, Follow::Config, None).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{k}");
        assert!(step.sqp_iterations <= 150, "{k}: {}", step.sqp_iterations);
        x = controller.nmpc().plan().states()[..3].to_vec();
    }
}

/// A problem in other units: the sizes of the two states and of the first input.
fn mixed([p, c, f]: [f64; 3]) -> String {
    let [q_p, q_c, r_f] = [p, c, f].map(|size| size.powi(-2));
    let [start, p_end, c_end] = [0.4 * f, 1.3 * p, 0.8 * c];
    format!(
        r#"
name = "mixed"
preset = "ours"
seed = 1

[plant.expression]
states = ["p", "c", "th"]
inputs = ["f", "g"]
parameters = {{ P = {p}, C = {c}, F = {f} }}
let = {{ s = "p/P", z = "c/C" }}

[plant.expression.derivatives]
p = "P*(f/F - 0.4*sqrt(max(s, 0)) + 0.1*z)"
c = "C*(-z/2 + g*(1.5 - z) + 0.3*s*th)"
th = "s - th - 0.2*z*th"

[control]
models = ["rk4"]
step_s = 0.3
duration_s = 0.3
initial_state = [{p}, {c}, 0.5]
initial_input = [{start}, 0.5]
controlled = ["p", "c"]
q = [{q_p}, {q_c}]
r = [{r_f}, 0.1]
n2 = 8
nu = 5
rk4_substeps = 2
input_low = [0.0, 0.0]
input_high = [{f}, 1.0]
references = [{{ start_s = 0.0, value = [{p_end}, {c_end}] }}]
cost = {{ stage = "(s - 1.2)^2" }}
"#
    )
}

#[test]
fn the_units_of_states_without_bounds_do_not_matter() {
    let solved = |sizes: [f64; 3]| {
        let mut controller = controller_of(&parse(&mixed(sizes), &[]).unwrap());
        let step = controller.step(&[sizes[0], sizes[1], 0.5], Follow::Config, None).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{sizes:?}");
        assert!(step.sqp_iterations <= 6, "{sizes:?}: {}", step.sqp_iterations);
        [step.u[0] / sizes[2], step.u[1], step.cost.unwrap()]
    };
    let expected = solved([1.0; 3]);
    for sizes in
        [[1.0, 1e-5, 1.0], [1e5, 1e-5, 1e3], [1e-7, 1.0, 1e-7], [1e-7, 1e-7, 1.0], [1.0, 1e-9, 1.0]]
    {
        for (found, expected) in solved(sizes).iter().zip(expected) {
            assert!((found - expected).abs() < 1e-7, "{sizes:?}: {found} {expected}");
        }
    }
}

/// A boat passes an island, which is a little south of its course, to a place south of it.
const ISLAND: &str = r#"
name = "island"
preset = "ours"
seed = 1

[plant.expression]
states = ["east", "north"]
inputs = ["speed"]
derivatives = { east = "1", north = "speed" }
outputs = { nearness = "1 - (east - 2)^2 - north^2" }

[control]
models = ["rk4"]
step_s = 0.25
duration_s = 0.25
initial_state = [0.0, 0.1]
n2 = 16
nu = 16
rk4_substeps = 1
end_state = { north = -0.6 }
input_low = [-2.0]
input_high = [2.0]
output_low = [-inf]
output_high = [0.0]
cost = { stage = "speed^2" }
sqp = { max_iterations = 400 }
"#;

/// Straight on the boat is led north of the island. 64 random starts of IPOPT end there or south of it
/// (`benches/peers/casadi_cost.py`).
#[test]
fn several_starts_find_the_shorter_way_round() {
    let cost = |sets: &[&str]| {
        let mut controller = controller_of(&parse(ISLAND, sets).unwrap());
        let step = controller.step(&[0.0, 0.1], Follow::Config, None).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        (step.cost.unwrap(), step.start)
    };
    let (north, start) = cost(&[]);
    assert_eq!(start, None);
    assert!((north - 1.923260).abs() < 1e-6, "{north}");
    let (south, start) = cost(&["control.sqp.starts=8"]);
    assert!((1..8).contains(&start.unwrap()), "{start:?}");
    assert!((south - 0.749488).abs() < 1e-6, "{south}");
    for (sets, expected) in [
        (vec!["control.sqp.starts=0"], "`control.sqp.starts`"),
        (vec!["control.sqp.starts=2", "control.sqp.real_time=true"], "sqp.real_time"),
    ] {
        let message = parse(ISLAND, &sets).unwrap_err();
        assert!(message.contains(expected), "{message}");
    }
}

/// An economic cost on a tree of three scenarios, against IPOPT on three copies of the horizon with
/// one first input (`CasADi` 3.8.2, classical RK4).
#[test]
fn an_economic_cost_on_a_tree_of_scenarios_has_the_optimum_of_ipopt() {
    let config = r#"
name = "tree"
preset = "ours"
seed = 1

[plant.expression]
states = ["x", "y"]
inputs = ["u"]
parameters = { k = 1.0 }
derivatives = { x = "k*u*exp(-y) - x", y = "x - 0.5*y" }

[control]
models = ["rk4"]
step_s = 0.25
duration_s = 0.25
initial_state = [0.2, 0.1]
n2 = 8
nu = 8
rk4_substeps = 2
state_high = { x = 0.3 }
input_low = [-1.0]
input_high = [2.0]
scenarios = { values = { k = [1.0, 1.4, 0.6] } }
cost = { stage = "0.3*u^2 - y*cos(x) + 0.1*t*u", terminal = "y^2" }
"#;
    let mut controller = controller_of(&parse(config, &[]).unwrap());
    let step = controller.step(&[0.2, 0.1], Follow::Config, None).unwrap();
    assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false));
    let (cost, u) = (step.cost.unwrap(), step.u[0]);
    assert!((cost + 0.356433283338).abs() < 1e-7, "{cost}");
    assert!((u - 0.526875).abs() < 1e-5, "{u}");
}
