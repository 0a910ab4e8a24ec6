//! Scenario trees: against IPOPT's answers, the conditions of optimality assembled by paths, and
//! what must be the same as without a tree.

use crate::problems::{Loop, four_tanks_loop};
use pinc_ad::Scalar;
use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, QpMethod, Scenarios, Softness, SqpConfig, SqpStatus,
    Tracked, Weights,
};
use pinc_ode::{Dims, Model, Plant, Rk4, Variable};
use pinc_plants::{FourTanks, VanDerPol};

/// Random problems with the first inputs of IPOPT; scenarios.py beside it says how.
const CASES: &str = include_str!("../data/scenarios.toml");

const SUBSTEPS: usize = 4;

/// Variables without names.
static NONE: [Variable; 4] = [const { Variable::new("", "") }; 4];

/// The plants of the cases, with the parameters that the scenarios vary.
#[derive(Clone, Copy, Debug)]
enum Uncertain {
    /// p: the damping.
    VanDerPol,
    /// p: the pump constants.
    FourTanks,
    /// p: alpha and beta. The second input is in MJ.
    Reactor,
}

impl Plant for Uncertain {
    fn states(&self) -> &[Variable] {
        &NONE[..if matches!(self, Self::VanDerPol) { 2 } else { 4 }]
    }

    fn inputs(&self) -> &[Variable] {
        &NONE[..if matches!(self, Self::VanDerPol) { 1 } else { 2 }]
    }

    fn parameters(&self) -> &[Variable] {
        self.inputs()
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        match self {
            Self::VanDerPol => VanDerPol { mu: 1.0 }.rhs_with(p, x, u, &[], dx),
            Self::FourTanks => {
                // Each input counts as often as its pump is stronger.
                let plant = FourTanks { pump: [1.0, 1.0], ..tanks() };
                plant.rhs(x, &[u[0] * p[0], u[1] * p[1]], &[], dx);
            }
            Self::Reactor => reactor(x, u, p, dx),
        }
    }
}

fn tanks() -> FourTanks {
    FourTanks {
        area: [28.0, 32.0, 28.0, 32.0],
        outlet: [0.071, 0.057, 0.071, 0.057],
        gamma: [0.7, 0.6],
        pump: [1.0, 1.0],
    }
}

#[inline(always)]
fn reactor<S: Scalar>(x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
    let (a, b, temperature, coolant) = (x[0], x[1], x[2], x[3]);
    let kelvin = temperature + 273.15;
    let k2 = (kelvin.constant(-9758.3) / kelvin).exp() * 1.287e12;
    let (k1, k3) = (k2 * p[1], (p[0] / kelvin * -8560.0).exp() * 9.043e9);
    let (r1, r2, r3) = (k1 * a, k2 * b, k3 * a * a);
    let exchange = (temperature - coolant) * (4032.0 * 0.215);
    dx[0] = u[0] * (-a + 5.1) - r1 - r3;
    dx[1] = r1 - r2 - u[0] * b;
    dx[2] = (r1 * 4.2 - r2 * 11.0 - r3 * 41.85) * (-1.0 / (0.9342 * 3.01))
        + u[0] * (-temperature + 130.0)
        - exchange * (1.0 / (0.9342 * 3.01 * 10.01));
    dx[3] = (u[1] * 1000.0 + exchange) * 0.1;
}

impl Uncertain {
    fn named(name: &str) -> Self {
        match name {
            "van-der-pol" => Self::VanDerPol,
            "four-tanks" => Self::FourTanks,
            "reactor" => Self::Reactor,
            _ => panic!("{name}"),
        }
    }

    fn model(self) -> Box<dyn Model> {
        let step_s = match self {
            Self::VanDerPol => 0.5,
            Self::FourTanks => 10.0,
            Self::Reactor => 0.005,
        };
        Box::new(Rk4::new(self, step_s, SUBSTEPS))
    }

    /// The problem of a case.
    fn problem(self, case: &toml::Value) -> NmpcProblem {
        let list = |key: &str| numbers(&case[key]);
        let tracked = case["tracked"].as_array().unwrap().iter().map(count);
        let dims = self.dims();
        let weights = Weights::uniform(list("q"), list("r"));
        NmpcProblem {
            tracked: Tracked::states(tracked),
            input_bounds: Bounds::new(list("u_low"), list("u_high")),
            state_bounds: Bounds::new(list("x_low"), list("x_high")),
            parameters: vec![1.0; dims.np],
            ..NmpcProblem::new(dims, count(&case["horizon"]), weights)
        }
    }
}

fn numbers(value: &toml::Value) -> Vec<f64> {
    let number = |v: &toml::Value| v.as_float().expect("a number");
    value.as_array().expect("a list").iter().map(number).collect()
}

fn count(value: &toml::Value) -> usize {
    value.as_integer().and_then(|n| usize::try_from(n).ok()).expect("a number")
}

/// A case: its name, the controller with the input applied before, x and the reference, and
/// IPOPT's first input.
struct Case {
    name: String,
    plant: Uncertain,
    nmpc: Nmpc,
    x: Vec<f64>,
    previous: Vec<f64>,
    reference: Vec<f64>,
    u: Vec<f64>,
}

fn cases(config: SqpConfig) -> Vec<Case> {
    let all: toml::Table = CASES.parse().unwrap();
    let case = |(i, case): (usize, &toml::Value)| {
        let plant = Uncertain::named(case["plant"].as_str().unwrap());
        let horizon = count(&case["horizon"]);
        let values: Vec<_> = case["values"].as_array().unwrap().iter().map(numbers).collect();
        let scenarios = Scenarios {
            parameters: (0..values[0].len()).collect(),
            values,
            weights: numbers(&case["weights"]),
            robust_horizon: count(&case["robust"]),
        };
        let penalty = numbers(&case["penalty"]);
        let soft = if penalty.is_empty() { Softness::Hard } else { Softness::Penalty(penalty) };
        let problem = NmpcProblem {
            control_horizon: count(&case["control"]),
            state_softness: soft,
            scenarios: Some(scenarios),
            ..plant.problem(case)
        };
        let (x, previous) = (numbers(&case["x"]), numbers(&case["previous"]));
        let mut nmpc = Nmpc::new(problem, plant.model(), config).unwrap();
        nmpc.reset_to(&x, &previous).unwrap();
        let name = format!("case {i}, {plant:?}");
        let (reference, u) = (numbers(&case["reference"]).repeat(horizon), numbers(&case["u"]));
        Case { name, plant, nmpc, x, previous, reference, u }
    };
    all["case"].as_array().unwrap().iter().enumerate().map(case).collect()
}

fn sharp(qp: QpMethod) -> SqpConfig {
    SqpConfig { tolerance: 1e-10, max_iterations: 200, qp, ..SqpConfig::default() }
}

/// Where the last cases begin: do-mpc's reactor over 20 steps, with a flat cost.
const LONG: usize = 54;

/// The ones of them that begin above their soft limit of temperature.
const HOT: [usize; 2] = [55, 57];

#[test]
fn first_inputs_match_ipopt() {
    for method in [QpMethod::Auto, QpMethod::Clarabel] {
        let mut all = cases(sharp(method));
        assert_eq!(all.len(), 58);
        // Rounding in multipliers of 1e4 leaves a residual above 1e-10.
        let less_sharp = cases(SqpConfig { tolerance: 1e-8, ..sharp(method) });
        for (i, case) in less_sharp.into_iter().enumerate().filter(|(i, _)| HOT.contains(i)) {
            all[i] = case;
        }
        for (i, Case { name, mut nmpc, x, reference, u, .. }) in all.into_iter().enumerate() {
            // Clarabel alone does not solve the long ones.
            if i >= LONG && method == QpMethod::Clarabel {
                continue;
            }
            let step = nmpc.step(&x, &reference).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{name}: {:?}", step.kkt);
            let allowed = if i < LONG { 1e-6 } else { 5e-6 };
            for (found, expected) in step.u.iter().zip(&u) {
                let off = (found - expected).abs() / (1.0 + expected.abs());
                assert!(off < allowed, "{name}: {found} {expected}");
            }
            let most = if HOT.contains(&i) { 25 } else { 12 };
            assert!(i < LONG || step.sqp_iterations < most, "{name}: {}", step.sqp_iterations);
        }
    }
}

/// The node before each node and the branch that leads there, path by path.
fn paths(branches: usize, robust: usize, horizon: usize) -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let (mut before, mut branch, mut depth) = (vec![0], vec![0], vec![0]);
    let mut level = vec![0];
    for d in 0..horizon {
        let mut next = Vec::new();
        for &node in &level {
            let own = branch[node];
            let followers = if d < robust { 0..branches } else { own..own + 1 };
            for b in followers {
                next.push(before.len());
                before.push(node);
                branch.push(b);
                depth.push(d + 1);
            }
        }
        level = next;
    }
    (before, branch, depth)
}

/// The Lagrangian of a case at z, with the plan's multipliers.
fn lagrangian(case: &Case, model: &mut dyn Model, z: &[f64]) -> (f64, f64) {
    let (problem, plan) = (case.nmpc.problem(), case.nmpc.plan());
    let scenarios = problem.scenarios.as_ref().unwrap();
    let Dims { nx: n, nu: m, .. } = model.dims();
    let robust = scenarios.robust_horizon;
    let (before, branch, depth) = paths(scenarios.values.len(), robust, problem.horizon);
    let (states, inputs) = z.split_at(plan.states().len());
    assert_eq!(states.len(), (before.len() - 1) * n);
    let free = depth.iter().filter(|&&d| d < problem.control_horizon).count();
    assert_eq!(inputs.len(), free * m);
    let mut weight = vec![1.0; before.len()];
    let (q, r) = match (problem.weights.q.at(0), problem.weights.r.at(0)) {
        (pinc_mpc::Weight::Diagonal(q), pinc_mpc::Weight::Diagonal(r)) => (q, r),
        _ => panic!("diagonal weights"),
    };
    let acting = |mut node: usize| {
        while depth[node] >= problem.control_horizon {
            node = before[node];
        }
        node
    };
    let u = |node: usize| &inputs[acting(node) * m..][..m];
    let (mut sum, mut defect, mut next) = (0.0, 0.0_f64, vec![0.0; n]);
    for node in 0..before.len() {
        let part = if depth[node] <= robust { scenarios.weights[branch[node]] } else { 1.0 };
        weight[node] = if node == 0 { 1.0 } else { weight[before[node]] * part };
        if depth[node] < problem.control_horizon {
            let last = if node == 0 { &case.previous[..] } else { u(before[node]) };
            for i in 0..m {
                sum += weight[node] * r[i] * (u(node)[i] - last[i]).powi(2);
            }
        }
        if node == 0 {
            continue;
        }
        let x = &states[(node - 1) * n..][..n];
        for (i, tracked) in problem.tracked.iter().enumerate() {
            let &Tracked::State(state) = tracked else { panic!("states are tracked") };
            sum += weight[node] * q[i] * (x[state] - case.reference[i]).powi(2);
        }
        let origin = match before[node] {
            0 => &case.x[..],
            origin => &states[(origin - 1) * n..][..n],
        };
        model.step(origin, u(before[node]), &scenarios.values[branch[node]], &mut next);
        for i in 0..n {
            sum += plan.dynamics_multipliers()[(node - 1) * n + i] * (next[i] - x[i]);
            defect = defect.max((next[i] - x[i]).abs());
        }
    }
    let bounds = [plan.state_multipliers(), plan.input_multipliers()].concat();
    (sum + bounds.iter().zip(z).map(|(mu, z)| mu * z).sum::<f64>(), defect)
}

#[test]
fn plans_are_stationary_points_on_the_tree() {
    for mut case in cases(sharp(QpMethod::Auto)).into_iter().take(LONG) {
        let (x, reference) = (case.x.clone(), case.reference.clone());
        assert_eq!(case.nmpc.step(&x, &reference).unwrap().status, SqpStatus::Converged);
        let mut model = case.plant.model();
        let plan = case.nmpc.plan();
        let mut z = [plan.states(), plan.inputs()].concat();
        let size = 1.0 + plan.dynamics_multipliers().iter().fold(0.0_f64, |s, l| s.max(l.abs()));
        let (_, defect) = lagrangian(&case, &mut *model, &z);
        assert!(defect < 1e-8, "{}: {defect:e}", case.name);
        for v in 0..z.len() {
            let (at, step) = (z[v], 1e-5 * (1.0 + z[v].abs()));
            let mut value = |to: f64| {
                z[v] = to;
                lagrangian(&case, &mut *model, &z).0
            };
            let slope = (value(at + step) - value(at - step)) / (2.0 * step);
            z[v] = at;
            assert!(slope.abs() < 1e-5 * size, "{}, unknown {v}: {slope:e} {size}", case.name);
        }
    }
}

/// The tanks' loop with the pump constants as parameters.
fn uncertain_tanks(scenarios: Option<Scenarios>) -> Loop {
    let mut run = four_tanks_loop();
    run.problem.scenarios = scenarios;
    run.problem.parameters = vec![3.33, 3.35];
    run
}

/// The inputs of 30 steps, and how many QPs these took.
fn inputs(mut run: Loop) -> (Vec<f64>, usize) {
    let plant = Rk4::new(Uncertain::FourTanks, 10.0, SUBSTEPS);
    let mut nmpc = Nmpc::new(run.problem.clone(), Box::new(plant), SqpConfig::default()).unwrap();
    let (mut all, mut qps) = (Vec::new(), 0);
    run.run(|k, x, window| {
        if k >= 30 {
            return vec![0.0; 2];
        }
        let step = nmpc.step(x, window).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{k}");
        all.extend_from_slice(step.u);
        qps += step.sqp_iterations;
        step.u.to_vec()
    });
    (all, qps)
}

#[test]
fn a_plan_expects_all_states_of_its_branches() {
    let branches = Scenarios::grid(vec![0], &[vec![3.33, 3.0, 3.6]], 1);
    let problem = uncertain_tanks(Some(branches)).problem;
    let plant = Rk4::new(Uncertain::FourTanks, 10.0, SUBSTEPS);
    let mut nmpc = Nmpc::new(problem.clone(), Box::new(plant), SqpConfig::default()).unwrap();
    let reference = [9.2, 14.2].repeat(problem.horizon);
    nmpc.step(&[9.2, 14.2, 2.5, 2.5], &reference).unwrap();
    let ranges = nmpc.expected().unwrap();
    assert_eq!(ranges.len(), problem.horizon);
    // With one branching stage the nodes of a depth are the three branches.
    for ([low, high], depth) in ranges.iter().zip(nmpc.plan().states().chunks_exact(3 * 4)) {
        for i in 0..4 {
            let values = [depth[i], depth[4 + i], depth[8 + i]];
            let least = values.into_iter().fold(f64::INFINITY, f64::min);
            let most = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
            assert_eq!([low[i], high[i]].map(f64::to_bits), [least, most].map(f64::to_bits));
        }
    }
    assert!(ranges[0][0][0] < ranges[0][1][0]);
}

/// A plant with the problem of its first case, without scenarios.
fn first_of(plant: Uncertain) -> (Uncertain, NmpcProblem) {
    let all = cases(SqpConfig::default()).into_iter();
    let problems = all.filter(|case| case.name.ends_with(&format!("{plant:?}")));
    let problem = problems.map(|case| case.nmpc.problem().clone()).next().unwrap();
    (plant, NmpcProblem { scenarios: None, state_softness: Softness::Hard, ..problem })
}

#[test]
fn one_branch_is_the_controller_without_a_tree() {
    let plain = inputs(uncertain_tanks(None));
    for robust_horizon in [1, 3] {
        let one = Scenarios::grid(vec![1, 0], &[vec![3.35], vec![3.33]], robust_horizon);
        assert_eq!(inputs(uncertain_tanks(Some(one))), plain);
    }
}

#[test]
fn equal_branches_give_the_inputs_without_a_tree() {
    let (plain, qps) = inputs(uncertain_tanks(None));
    for (values, robust_horizon) in [(vec![3.33; 3], 1), (vec![3.33; 2], 2)] {
        let equal = Scenarios::grid(vec![0], &[values], robust_horizon);
        let (found, of_tree) = inputs(uncertain_tanks(Some(equal)));
        for (found, plain) in found.iter().zip(&plain) {
            assert!((found - plain).abs() < 1e-7, "{found} {plain}");
        }
        assert!(of_tree <= qps + 5, "{of_tree} {qps}");
    }
}

/// A reactor at its limit of temperature: whichever branch the plant is, the limit is kept; without
/// scenarios it is broken by the worst.
#[test]
fn bounds_hold_in_every_branch() {
    let (plant, problem) = first_of(Uncertain::Reactor);
    let grid = Scenarios::grid(vec![0, 1], &[vec![1.0, 1.05, 0.95], vec![1.0, 1.1, 0.9]], 1);
    let run = |scenarios: Option<Scenarios>, p: &[f64]| {
        let (horizon, control_horizon) = (10, 10);
        let problem = NmpcProblem { horizon, control_horizon, scenarios, ..problem.clone() };
        let high = problem.state_bounds.high.clone();
        let mut nmpc = Nmpc::new(problem, plant.model(), SqpConfig::default()).unwrap();
        let (mut truth, mut x, mut next) = (plant.model(), vec![0.8, 0.5, 134.0, 130.0], [0.0; 4]);
        nmpc.reset_to(&x, &[20.0, -4.0]).unwrap();
        let mut worst = f64::NEG_INFINITY;
        for k in 0..15 {
            let step = nmpc.step(&x, &[0.6; 10]).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{k} {p:?}");
            truth.step(&x, step.u, p, &mut next);
            x.copy_from_slice(&next);
            worst = x.iter().zip(&high).fold(worst, |worst, (x, high)| worst.max(x - high));
        }
        worst
    };
    let branches = grid.values.clone();
    for p in &branches {
        let worst = run(Some(grid.clone()), p);
        assert!(worst < 1e-7, "{p:?}: {worst}");
    }
    let nominal = branches.iter().map(|p| run(None, p)).fold(0.0, f64::max);
    assert!(nominal > 0.05, "{nominal}");
}

#[test]
fn scenarios_that_make_no_sense_are_errors() {
    let (plant, four) = first_of(Uncertain::FourTanks);
    let four = NmpcProblem { horizon: 4, control_horizon: 4, ..four };
    let of = |change: fn(&mut NmpcProblem, &mut Scenarios)| {
        let mut problem = four.clone();
        let mut scenarios = Scenarios::grid(vec![0], &[vec![3.0, 3.5]], 1);
        change(&mut problem, &mut scenarios);
        problem.scenarios = Some(scenarios);
        Nmpc::new(problem, plant.model(), SqpConfig::default()).map(|_| ()).unwrap_err().to_string()
    };
    for (change, expected) in [
        (
            (|_, s| s.parameters = vec![2]) as fn(&mut NmpcProblem, &mut Scenarios),
            "scenarios.parameters has 2, but must name each of 0 to 1 at most once",
        ),
        (
            |_, s| *s = Scenarios::grid(vec![0, 0], &[vec![1.0], vec![1.0]], 1),
            "has 0, but must name each",
        ),
        (|_, s| s.values[1] = vec![f64::NAN], "scenarios.values of a branch"),
        (|_, s| s.weights = vec![0.5, 0.6], "the sum of scenarios.weights is 1.1, but must be 1"),
        (|_, s| s.weights = vec![1.5, -0.5], "scenarios.weights"),
        (|_, s| s.robust_horizon = 0, "robust_horizon is 0, but must be from 1 to 3"),
        (|p, _| p.delay = 1, "scenarios do not go with a delay"),
        (|p, _| p.control_horizon = 1, "robust_horizon is 1, but must be from 1 to 0"),
        (
            |p, _| p.weights.input_sequence = Some(vec![1.0; 10].into()),
            "cannot weight the whole input sequence",
        ),
    ] {
        let message = of(change);
        assert!(message.contains(expected), "{message}");
    }
    let problem = NmpcProblem {
        scenarios: Some(Scenarios::grid(vec![0], &[vec![3.0, 3.5]], 1)),
        ..four.clone()
    };
    let long = Box::new(Rk4::new(plant, 20.0, SUBSTEPS));
    let unequal = Nmpc::builder(problem).stages(plant.model(), 2).stages(long, 2).build();
    assert_eq!(unequal.unwrap_err(), MpcError::WithScenarios("stages of different lengths"));
}
