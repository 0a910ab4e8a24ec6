//! The units of states, inputs and cost do not matter.

use crate::problems::{Loop, four_tanks_loop, van_der_pol_loop};
use crate::support::{Linear, scalar_problem};
use crate::together::Together;
use pinc_mpc::{Bounds, Constraints, Nmpc, NmpcProblem, QpMethod, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Dims, Linearization, Model, Rk4, Stages};
use pinc_plants::{FourTanks, VanDerPol};

/// Bounds so wide that they bound nothing do not tell what an input costs, nor how large it is where it
/// moves by less: the controller does not stay where it starts.
#[test]
fn wide_bounds_of_an_input_change_no_plan() {
    let input = |bound: f64, moved: f64| {
        let problem = NmpcProblem {
            input_bounds: Bounds::new(vec![-bound], vec![bound]),
            increment_bounds: Bounds::new(vec![-moved], vec![moved]),
            ..scalar_problem(5, 5)
        };
        let model = Box::new(Linear::scalar(0.9, 0.5));
        let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
        let step = nmpc.step(&[0.0], &[1.0; 5]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{bound}: {step:?}");
        step.u[0]
    };
    for moved in [f64::INFINITY, 0.05] {
        let expected = input(10.0, moved);
        assert!(expected > 0.04, "{expected}");
        for bound in [1e6, 1e8, 1e10, 1e12] {
            let found = input(bound, moved);
            assert!((found - expected).abs() < 1e-7, "{bound} {moved}: {found} {expected}");
        }
    }
}

/// A model whose states and inputs are counted in other units: numbers so many times larger.
#[derive(Clone, Debug)]
struct Rescaled<M> {
    model: M,
    x: f64,
    u: f64,
}

impl<M: Model> Model for Rescaled<M> {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let [x, u]: [Vec<f64>; 2] =
            [(x, self.x), (u, self.u)].map(|(v, unit)| v.iter().map(|v| v / unit).collect());
        self.model.step(&x, &u, p, next);
        next.iter_mut().for_each(|next| *next *= self.x);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let [x, u]: [Vec<f64>; 2] =
            [(at.x, self.x), (at.u, self.u)].map(|(v, unit)| v.iter().map(|v| v / unit).collect());
        let Linearization { next, a, b, e } = out;
        self.model.linearize(Stages { x: &x, u: &u, p: at.p }, Linearization { next, a, b, e });
        next.iter_mut().for_each(|next| *next *= self.x);
        b.iter_mut().for_each(|b| *b *= self.x / self.u);
    }
}

/// How a loop is counted: units of states and inputs, the cost's unit, and whether bounds on states
/// tell their size.
#[derive(Clone, Copy, Debug)]
struct Counted {
    x: f64,
    u: f64,
    cost: f64,
    bounded: bool,
}

/// The controller of a loop that is counted so.
fn controller(
    run: &Loop,
    model: impl Model + Clone + 'static,
    counted: Counted,
    qp: QpMethod,
) -> Nmpc {
    let Counted { x, u, cost, bounded } = counted;
    let times = |bounds: &Bounds, factor: f64| {
        let scaled = |side: &[f64]| side.iter().map(|v| v * factor).collect();
        Bounds::new(scaled(&bounds.low), scaled(&bounds.high))
    };
    let mut problem = run.problem.clone();
    problem.state_bounds = times(&problem.state_bounds, x);
    problem.input_bounds = times(&problem.input_bounds, u);
    problem.increment_bounds = times(&problem.increment_bounds, u);
    if !bounded {
        problem.state_bounds = Bounds::none(problem.state_bounds.low.len());
    }
    let (q, r) = (problem.weights.q.at(0), problem.weights.r.at(0));
    problem.weights = Weights::uniform(q.times(cost / (x * x)), r.times(cost / (u * u)));
    let config = SqpConfig { qp, ..SqpConfig::default() };
    Nmpc::new(problem, Box::new(Rescaled { model, x, u }), config).unwrap()
}

/// The iterations of all steps, and the inputs in the plant's own units.
fn run(
    mut run: Loop,
    model: impl Model + Clone + 'static,
    counted: Counted,
    qp: QpMethod,
) -> (usize, Vec<Vec<f64>>) {
    let Counted { x, u, .. } = counted;
    let mut nmpc = controller(&run, model, counted, qp);
    let (mut iterations, mut inputs) = (0, Vec::new());
    run.run(|k, state, reference| {
        let state: Vec<f64> = state.iter().map(|v| v * x).collect();
        let reference: Vec<f64> = reference.iter().map(|v| v * x).collect();
        let step = nmpc.step(&state, &reference).unwrap();
        assert_eq!(
            step.status,
            SqpStatus::Converged,
            "{counted:?}, {qp}, step {k}: {:?}",
            step.kkt
        );
        iterations += step.sqp_iterations;
        let input: Vec<f64> = step.u.iter().map(|v| v / u).collect();
        inputs.push(input.clone());
        input
    });
    (iterations, inputs)
}

fn compare(
    build: impl Fn() -> Loop,
    model: &(impl Model + Clone + 'static),
    counted: Counted,
    qp: QpMethod,
) {
    let usual = Counted { x: 1.0, u: 1.0, cost: 1.0, ..counted };
    let (expected, inputs) = run(build(), model.clone(), usual, qp);
    let (found, others) = run(build(), model.clone(), counted, qp);
    // A quantity of ordinary size is computed with as it is, another as one of 8 to 16: the
    // tolerances differ by such factors, and so an iteration more or less in a few steps.
    assert!(
        found.abs_diff(expected) * 100 <= 15 * expected,
        "{counted:?}, {qp}: {found} {expected}"
    );
    for (k, (a, b)) in inputs.iter().flatten().zip(others.iter().flatten()).enumerate() {
        assert!((a - b).abs() < 1e-5, "{counted:?}, {qp}, {k}: {a} {b}");
    }
}

/// A multiplier is what the cost gains per unit of its bound: in the units of the plant, whatever the
/// optimization counts in.
#[test]
fn multipliers_are_in_the_plants_units() {
    let mut run = van_der_pol_loop();
    run.problem.increment_bounds = Bounds::new(vec![-0.15], vec![0.1]);
    let multipliers = |counted: Counted| {
        let model = Rk4::new(VanDerPol::default(), 0.5, 4);
        let mut nmpc = controller(&run, model, counted, QpMethod::Condensed);
        let Counted { x, u, cost, .. } = counted;
        let step = nmpc.step(&[0.5 * x, 0.1 * x], &[-0.4 * x, 0.0].repeat(5)).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        let plan = nmpc.plan();
        let of_u = |values: &[f64]| values.iter().map(|v| v * u / cost).collect::<Vec<_>>();
        let of_x: Vec<_> = plan.dynamics_multipliers().iter().map(|v| v * x / cost).collect();
        [of_u(plan.increment_multipliers()), of_u(plan.input_multipliers()), of_x]
    };
    let usual = multipliers(Counted { x: 1.0, u: 1.0, cost: 1.0, bounded: true });
    let largest = |values: &[f64]| values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!(largest(&usual[0]) > 0.1 && largest(&usual[2]) > 0.1, "{usual:?}");
    for (x, u, cost) in [(1.0, 1e5, 1.0), (1e-4, 1e-3, 1.0), (1e4, 1.0, 1e6), (1.0, 1e-5, 1e-6)] {
        let found = multipliers(Counted { x, u, cost, bounded: true });
        for (found, usual) in found.iter().zip(&usual) {
            for (a, b) in found.iter().zip(usual) {
                let off = (a - b).abs();
                assert!(off < 1e-4 * largest(usual).max(1.0), "{x} {u} {cost}: {a} {b}");
            }
        }
    }
}

const METHODS: [QpMethod; 2] = [QpMethod::Condensed, QpMethod::Riccati];

#[test]
fn states_may_be_counted_in_any_unit() {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    for qp in METHODS {
        for x in [1e-6, 1e-3, 1e-1, 1e3, 1e5, 1e7] {
            let counted = Counted { x, u: 1.0, cost: 1.0, bounded: true };
            compare(four_tanks_loop, &model, counted, qp);
        }
    }
}

/// Without bounds large states are seen to be large.
#[test]
fn large_states_need_no_bounds() {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    for x in [1e3, 1e7] {
        let counted = Counted { x, u: 1.0, cost: 1.0, bounded: false };
        compare(four_tanks_loop, &model, counted, QpMethod::Auto);
    }
}

#[test]
fn inputs_and_costs_may_be_counted_in_any_unit() {
    let tanks = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let oscillator = Rk4::new(VanDerPol::default(), 0.5, 4);
    for qp in METHODS {
        for (x, u, cost) in [
            (1.0, 1e6, 1.0),
            (1.0, 1e-6, 1.0),
            (1.0, 1.0, 1e-6),
            (1.0, 1.0, 1e7),
            (1e5, 1e-4, 1e-6),
        ] {
            let counted = Counted { x, u, cost, bounded: true };
            compare(four_tanks_loop, &tanks, counted, qp);
            // The last reference is on two bounds, where the optimum is flat: 90 of 120 steps.
            compare(short_loop, &oscillator, counted, qp);
        }
    }
}

#[test]
fn constraints_may_be_counted_in_any_unit() {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let inputs = |x: f64, row: f64, qp: QpMethod| {
        let mut built = four_tanks_loop();
        built.problem.constraints = Some(Constraints::new(Together { x, row }));
        run(built, model.clone(), Counted { x, u: 1.0, cost: 1.0, bounded: true }, qp).1
    };
    for qp in METHODS {
        let expected = inputs(1.0, 1.0, qp);
        for (x, row) in [(1e-4, 1.0), (1e4, 1.0), (1e5, 1e-3), (1.0, 1e-5), (1.0, 1e6)] {
            let found = inputs(x, row, qp);
            for (k, (a, b)) in expected.iter().flatten().zip(found.iter().flatten()).enumerate() {
                assert!((a - b).abs() < 1e-5, "{x}, {row}, {qp}, {k}: {a} {b}");
            }
        }
        // Without it the references add up to 23 to 26.
        let usual = Counted { x: 1.0, u: 1.0, cost: 1.0, bounded: true };
        assert_ne!(run(four_tanks_loop(), model.clone(), usual, qp).1, expected);
    }
}

/// Multipliers are the cost's derivatives: of a state counted in numbers a million times larger,
/// they are a million times smaller.
#[test]
fn multipliers_are_in_the_units_of_the_problem() {
    let multipliers = |counted: Counted| {
        let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
        let (mut nmpc, x) =
            (controller(&four_tanks_loop(), model, counted, QpMethod::Auto), counted.x);
        let state = [6.0, 6.0, 5.0, 5.0].map(|v: f64| v * x);
        let reference = [15.0, 8.0].repeat(5).into_iter().map(|v: f64| v * x).collect::<Vec<_>>();
        let step = nmpc.step(&state, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        let plan = nmpc.plan();
        let parts = [(plan.dynamics_multipliers(), x), (plan.input_multipliers(), counted.u)];
        parts.map(|(part, unit)| part.iter().map(|m| m * unit / counted.cost).collect::<Vec<_>>())
    };
    let usual = Counted { x: 1.0, u: 1.0, cost: 1.0, bounded: true };
    let expected = multipliers(usual);
    let found = multipliers(Counted { x: 1e6, u: 1e-3, cost: 10.0, ..usual });
    for (expected, found) in expected.iter().zip(&found) {
        let largest = expected.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        assert!(largest > 0.0);
        for (a, b) in expected.iter().zip(found) {
            assert!((a - b).abs() <= 1e-5 * largest, "{a} {b}");
        }
    }
}

fn short_loop() -> Loop {
    let mut run = van_der_pol_loop();
    let values: Vec<f64> = (0..90).flat_map(|k| run.reference.at(k).to_vec()).collect();
    run.reference = pinc_mpc::Reference::new(values, 2).unwrap();
    run
}

/// The iterations of the loops of the paper, whose quantities are of ordinary size, equal the
/// iterations of a controller that knows no units.
#[test]
fn ordinary_units_are_left_alone() {
    let counted = Counted { x: 1.0, u: 1.0, cost: 1.0, bounded: true };
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let mut plain = four_tanks_loop();
    let mut nmpc =
        Nmpc::new(plain.problem.clone(), Box::new(model.clone()), SqpConfig::default()).unwrap();
    let mut inputs = Vec::new();
    plain.run(|_, x, reference| {
        let u = nmpc.step(x, reference).unwrap().u.to_vec();
        inputs.push(u.clone());
        u
    });
    let (_, others) = run(four_tanks_loop(), model, counted, QpMethod::Auto);
    let bits = |inputs: &[Vec<f64>]| -> Vec<u64> {
        inputs.iter().flatten().map(|u| u.to_bits()).collect()
    };
    assert_eq!(bits(&inputs), bits(&others));
}
