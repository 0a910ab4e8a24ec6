//! Outputs of the model, tracked and bounded, and costs of one's own.

use crate::optimality::{StepInput, none, residuals_with, scale};
use crate::support::Linear;
use pinc_ad::Scalar;
use pinc_loop::ClosedLoop;
use pinc_mpc::{
    Bounds, Nmpc, NmpcProblem, QpMethod, QuadBlock, Reference, Softness, SqpConfig, SqpStatus,
    StageCost, StagePoint, Tracked, Weight, Weights,
};
use pinc_ode::{
    Dims, Dopri5, Linearization, Model, OutputLinearization, Plant, Rk4, Stages, Variable,
};
use pinc_plants::VanDerPol;

pub(crate) const METHODS: [QpMethod; 3] =
    [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel];

pub(crate) fn config(qp: QpMethod) -> SqpConfig {
    SqpConfig { qp, ..SqpConfig::default() }
}

/// A model with the outputs x1 + x2 and x1^2 + feed u.
#[derive(Clone, Debug)]
pub(crate) struct Observed<M> {
    pub(crate) model: M,
    pub(crate) feed: f64,
}

impl<M: Model> Model for Observed<M> {
    fn dims(&self) -> Dims {
        self.model.dims().with_outputs(2)
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.model.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.model.linearize(at, out);
    }

    fn output(&mut self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        (y[0], y[1]) = (x[0] + x[1], x[0] * x[0] + self.feed * u[0]);
    }

    fn feedthrough(&self) -> Vec<bool> {
        vec![false, self.feed.abs() > 0.0]
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let points = out.y.chunks_exact_mut(2).zip(out.c.chunks_exact_mut(4));
        for (k, ((y, c), d)) in points.zip(out.d.chunks_exact_mut(2)).enumerate() {
            let at = at.point(k, self.dims());
            self.output(at.x, at.u, at.p, y);
            c.copy_from_slice(&[1.0, 1.0, 2.0 * at.x[0], 0.0]);
            d.copy_from_slice(&[0.0, self.feed]);
        }
    }
}

/// The oscillator with the same outputs, without feed.
#[derive(Clone, Debug)]
struct ObservedPlant(VanDerPol);

impl Plant for ObservedPlant {
    fn states(&self) -> &[Variable] {
        self.0.states()
    }

    fn inputs(&self) -> &[Variable] {
        self.0.inputs()
    }

    fn outputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("sum", ""), Variable::new("square", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        self.0.rhs(x, u, p, dx);
    }

    fn output<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[0] + x[1];
        y[1] = x[0] * x[0];
    }
}

pub(crate) fn linear() -> Linear {
    Linear { dims: Dims::new(2, 1), a: vec![0.9, 0.3, -0.2, 0.8], b: vec![0.1, 0.6] }
}

/// Rounding of an output whose weight is 1e7 to 1e9 times that of the input stays within the tolerance.
#[test]
fn outputs_converge_with_nearly_free_inputs() {
    for r in [1e-7, 1e-8, 1e-9] {
        let problem = NmpcProblem {
            tracked: Tracked::outputs([0]),
            input_bounds: Bounds::new(vec![-3.0], vec![3.0]),
            ..NmpcProblem::new(Dims::new(2, 1), 6, Weights::uniform(vec![1.0], vec![r]))
        };
        let model = Box::new(Observed { model: linear(), feed: 0.0 });
        let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
        let mut x = [0.3, -0.2];
        for k in 0..8 {
            let step = nmpc.step(&x, &[if k < 3 { 1.0 } else { 2.0 }; 6]).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{r} {k}");
            let u = step.u[0];
            x = [0.9 * x[0] + 0.3 * x[1] + 0.1 * u, -0.2 * x[0] + 0.8 * x[1] + 0.6 * u];
        }
    }
}

/// (x1 + x2 - r)^2 is e'Q e with the full Q of ones and e = (x1 - r, x2).
#[test]
fn a_tracked_sum_is_a_full_weight_of_states() {
    let dims = Dims::new(2, 1);
    let ones = Weight::Full(vec![vec![3.0; 2]; 2]);
    let bounds = Bounds::new(vec![-0.7], vec![0.7]);
    let states = NmpcProblem {
        input_bounds: bounds.clone(),
        control_horizon: 3,
        ..NmpcProblem::new(dims, 5, Weights::uniform(ones, vec![0.2]))
    };
    let sum = NmpcProblem {
        input_bounds: bounds,
        control_horizon: 3,
        tracked: Tracked::outputs([0]),
        ..NmpcProblem::new(dims, 5, Weights::uniform(vec![3.0], vec![0.2]))
    };
    for qp in METHODS {
        let mut states = Nmpc::new(states.clone(), Box::new(linear()), config(qp)).unwrap();
        let model = Observed { model: linear(), feed: 0.0 };
        let mut sum = Nmpc::new(sum.clone(), Box::new(model), config(qp)).unwrap();
        let mut x = [1.0, -2.0];
        for r in [1.5, 1.5, -0.5, -0.5, 0.0] {
            // Each stage has its own.
            let reference = [1.0, -0.4, 0.7, 0.2, -1.1].map(|part| r + part);
            let rows: Vec<f64> = reference.iter().flat_map(|r| [*r, 0.0]).collect();
            let expected = states.step(&x, &rows).unwrap().u[0];
            let step = sum.step(&x, &reference).unwrap();
            assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 1), "{qp}");
            assert!((step.u[0] - expected).abs() < 1e-6, "{qp}: {} {expected}", step.u[0]);
            let u = step.u[0];
            x = [0.9 * x[0] + 0.3 * x[1] + 0.1 * u, -0.2 * x[0] + 0.8 * x[1] + 0.6 * u];
        }
    }
}

/// In closed loop with the oscillator x1 + x2 reaches its reference, and the loop samples the
/// output.
#[test]
fn an_output_reaches_its_reference() {
    let model = Observed { model: Rk4::new(VanDerPol::default(), 0.5, 4), feed: 0.0 };
    let problem = NmpcProblem {
        tracked: Tracked::outputs([0]),
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(model.dims(), 8, Weights::uniform(vec![10.0], vec![0.1]))
    };
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    let reference = Reference::new(vec![0.5; 60], 1).unwrap();
    let plant = Dopri5::new(ObservedPlant(VanDerPol::default()), 1e-10);
    let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &[0.0, 0.0]).unwrap();
    let (record, ended) = run.run_recorded();
    ended.unwrap();
    assert!(record.steps.iter().all(|step| step.status == SqpStatus::Converged));
    assert!((run.state()[0] + run.state()[1] - 0.5).abs() < 1e-3, "{:?}", run.state());
    // The tracking error is the output's: it falls from 0.5, and its mean is far below.
    assert!(run.tracking_at_steps().iae_mean() / 60.0 < 0.1);
}

/// An output that is nonlinear and has the input in it, beside a state: optimal by the conditions
/// assembled a second time.
#[test]
fn plans_that_track_nonlinear_outputs_are_optimal() {
    let feed = 0.4;
    let mut model = Observed { model: Rk4::new(VanDerPol::default(), 0.5, 4), feed };
    let problem = NmpcProblem {
        n1: 2,
        control_horizon: 4,
        tracked: vec![Tracked::Output(1), Tracked::State(1)],
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(model.dims(), 6, Weights::uniform(vec![5.0, 2.0], vec![0.3]))
    };
    for qp in METHODS {
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(model.clone()), config(qp)).unwrap();
        let (mut x, mut previous) = (vec![0.3, 0.2], vec![0.0]);
        let reference = [0.6, 0.0].repeat(6);
        for k in 0..8 {
            let step = nmpc.step(&x, &reference).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{qp} {k}");
            let u = step.u.to_vec();
            let extra = |j: usize, x: &[f64], u: &[f64]| {
                let force = 2.0 * 5.0 * (x[0] * x[0] + feed * u[0] - 0.6);
                let on = if j >= 2 { force } else { 0.0 };
                (vec![2.0 * x[0] * on, 0.0], vec![feed * on])
            };
            let input = StepInput { x: &x, previous: &previous, reference: &reference };
            let found = residuals_with(&nmpc, &mut model, &input, [&none, &extra]);
            assert!(found.iter().all(|&r| r <= 1e-8 * scale(&nmpc)), "{qp} {k}: {found:?}");
            let mut next = vec![0.0; 2];
            model.step(&x, &u, &[], &mut next);
            (x, previous) = (next, u);
        }
    }
}

#[test]
fn bounds_on_outputs_hold_or_are_named() {
    let model = Observed { model: linear(), feed: 0.0 };
    let mut problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        output_bounds: Some(Bounds::new(vec![-0.4, f64::NEG_INFINITY], vec![0.4, f64::INFINITY])),
        ..NmpcProblem::new(model.dims(), 4, Weights::uniform(vec![1.0; 2], vec![0.1]))
    };
    let sums = |nmpc: &Nmpc| -> Vec<f64> {
        nmpc.plan().states().chunks_exact(2).map(|x| x[0] + x[1]).collect()
    };
    for qp in METHODS {
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(model.clone()), config(qp)).unwrap();
        let step = nmpc.step(&[0.2, 0.1], &[2.0; 8]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{qp}");
        let most = sums(&nmpc).into_iter().fold(f64::MIN, f64::max);
        assert!((most - 0.4).abs() < 1e-6, "{qp}: {most}");
        // From far outside an input of 1 is not enough.
        let step = nmpc.step(&[5.0, 5.0], &[0.0; 8]).unwrap();
        assert_eq!(step.status, SqpStatus::InfeasibleQp, "{qp}");
        assert_eq!(step.violated.unwrap().to_string(), "upper bound of y[k+1][0]", "{qp}");
    }
    problem.output_softness = Softness::Exact;
    for qp in METHODS {
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(model.clone()), config(qp)).unwrap();
        let step = nmpc.step(&[5.0, 5.0], &[0.0; 8]).unwrap();
        assert_eq!((step.status, step.violated), (SqpStatus::Converged, None), "{qp}");
        assert!((step.u[0] + 1.0).abs() < 1e-6, "{qp}: {}", step.u[0]);
    }
}

/// |L (x, u) - (1, -1)|^2 with a full L, which couples the input and both states.
#[derive(Debug)]
struct Squares;

const L: [[f64; 3]; 2] = [[1.0, -0.5, 0.7], [0.2, 0.9, -0.4]];

/// The gradient of [`Squares`].
fn slope(x: &[f64], u: &[f64]) -> [f64; 3] {
    let v = [x[0], x[1], u[0]];
    let mut slope = [0.0; 3];
    for (row, target) in L.iter().zip([1.0, -1.0]) {
        let off: f64 = row.iter().zip(v).map(|(l, v)| l * v).sum::<f64>() - target;
        slope.iter_mut().zip(row).for_each(|(slope, l)| *slope += 2.0 * l * off);
    }
    slope
}

impl StageCost for Squares {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        let gradient = slope(at.x, at.u);
        out.by_x.copy_from_slice(&gradient[..2]);
        out.by_u.copy_from_slice(&gradient[2..]);
        let hessian = |i: usize, k: usize| 2.0 * L.iter().map(|row| row[i] * row[k]).sum::<f64>();
        for i in 0..2 {
            out.s[i] = hessian(2, i);
            out.q[2 * i] = hessian(i, 0);
            out.q[2 * i + 1] = hessian(i, 1);
        }
        out.r[0] = hessian(2, 2);
        for (row, target) in L.iter().zip([1.0, -1.0]) {
            let off = row[0] * at.x[0] + row[1] * at.x[1] + row[2] * at.u[0] - target;
            out.value += off * off;
        }
    }
}

/// A linear model and a quadratic cost are one QP, if its Hessian is right in all its blocks.
#[test]
fn a_quadratic_stage_cost_is_solved_at_once() {
    let mut problem =
        NmpcProblem::new(Dims::new(2, 1), 5, Weights::uniform(vec![0.1, 0.0], vec![0.2]));
    problem.state_bounds.high = vec![0.6, 3.0];
    for control in [1, 3, 5] {
        problem.control_horizon = control;
        for qp in METHODS {
            let mut nmpc = Nmpc::builder(problem.clone())
                .model(Box::new(linear()))
                .stage_cost(Box::new(Squares))
                .config(config(qp))
                .build()
                .unwrap();
            let (x, reference) = ([0.5, -0.5], [0.3, 0.0].repeat(5));
            let step = nmpc.step(&x, &reference).unwrap();
            assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 1), "{qp}");
            let extra = |_: usize, x: &[f64], u: &[f64]| {
                let gradient = slope(x, u);
                (gradient[..2].to_vec(), gradient[2..].to_vec())
            };
            let input = StepInput { x: &x, previous: &[0.0], reference: &reference };
            let found = residuals_with(&nmpc, &mut linear(), &input, [&extra, &none]);
            assert!(found.iter().all(|&r| r <= 1e-8), "{qp}: {found:?}");
        }
    }
}

/// Energy at a price beside a product: min sum 2 exp(u) - 3 x1, with the exponential's own
/// curvature.
#[derive(Debug)]
struct Economy;

impl StageCost for Economy {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        let energy = 2.0 * at.u[0].exp();
        out.value = energy - 3.0 * at.x[0];
        (out.by_u[0], out.r[0], out.by_x[0]) = (energy, energy, -3.0);
    }
}

#[test]
fn an_economic_cost_needs_no_reference() {
    let weights = Weights::uniform(vec![0.0; 2], vec![0.0]);
    let problem = NmpcProblem {
        state_bounds: Bounds::new(vec![-1.5; 2], vec![1.5; 2]),
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        control_horizon: 6,
        ..NmpcProblem::new(Dims::new(2, 1), 8, weights)
    };
    let mut model = Rk4::new(VanDerPol::default(), 0.5, 4);
    for qp in METHODS {
        let mut nmpc = Nmpc::builder(problem.clone())
            .model(Box::new(model.clone()))
            .stage_cost(Box::new(Economy))
            .config(config(qp))
            .build()
            .unwrap();
        let (x, reference) = ([0.1, 0.1], [0.0; 16]);
        let step = nmpc.step(&x, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{qp}");
        let extra = |_: usize, _: &[f64], u: &[f64]| (vec![-3.0, 0.0], vec![2.0 * u[0].exp()]);
        let input = StepInput { x: &x, previous: &[0.0], reference: &reference };
        let found = residuals_with(&nmpc, &mut model, &input, [&extra, &none]);
        assert!(found.iter().all(|&r| r <= 1e-8 * scale(&nmpc)), "{qp}: {found:?}");
    }
}

/// Hard bounds hold, and those that are soft where they have to be give way, whichever counts in larger numbers.
#[test]
fn exact_bounds_give_way_to_hard_ones() {
    let model = Observed { model: linear(), feed: 0.0 };
    let none = f64::INFINITY;
    for (state_softness, output_softness) in
        [(Softness::Hard, Softness::Exact), (Softness::Exact, Softness::Hard)]
    {
        for (weight, qp) in [1e-3, 1.0, 1e3].into_iter().flat_map(|w| METHODS.map(|qp| (w, qp))) {
            // x1 is at most 0.3 and x2 at most 0.2, x1 + x2 at least 0.7.
            let problem = NmpcProblem {
                state_bounds: Bounds::new(vec![-none; 2], vec![0.3, 0.2]),
                output_bounds: Some(Bounds::new(vec![0.7, -none], vec![none; 2])),
                state_softness: state_softness.clone(),
                output_softness: output_softness.clone(),
                ..NmpcProblem::new(model.dims(), 4, Weights::uniform(vec![weight; 2], vec![0.1]))
            };
            let mut nmpc = Nmpc::new(problem, Box::new(model.clone()), config(qp)).unwrap();
            let step = nmpc.step(&[0.2, 0.1], &[0.0; 8]).unwrap();
            let case = format!("{qp}, states {state_softness:?}, weight {weight}");
            assert_eq!((step.status, step.violated), (SqpStatus::Converged, None), "{case}");
            for x in nmpc.plan().states().chunks_exact(2) {
                let broken = match state_softness {
                    Softness::Hard => (x[0] - 0.3).max(x[1] - 0.2),
                    _ => 0.7 - x[0] - x[1],
                };
                assert!(broken < 1e-6, "{case}: {x:?}");
            }
        }
    }
}

/// Where neither kind can be kept the program with `exact` bounds soft alone has no solution: it takes nothing
/// from the iterations that there are.
#[test]
fn giving_way_in_turn_takes_no_iterations() {
    let model = Observed { model: linear(), feed: 0.0 };
    let none = f64::INFINITY;
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        state_bounds: Bounds::new(vec![-none; 2], vec![0.3, 0.2]),
        output_bounds: Some(Bounds::new(vec![20.0, -none], vec![none; 2])),
        output_softness: Softness::Exact,
        ..NmpcProblem::new(model.dims(), 4, Weights::uniform(vec![1.0; 2], vec![0.1]))
    };
    for qp in METHODS {
        let config = SqpConfig { max_iterations: 2, ..config(qp) };
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(model.clone()), config).unwrap();
        let step = nmpc.step(&[5.0, 5.0], &[0.0; 8]).unwrap();
        assert_eq!(step.status, SqpStatus::InfeasibleQp, "{qp}");
        assert!(step.sqp_iterations <= 2, "{qp}: {step:?}");
    }
}

/// How a plan ends is no soft constraint: `exact` bounds of states give way to it.
#[test]
fn exact_bounds_give_way_to_the_end_of_the_plan() {
    // A cart that must go 1.5 in 1 s, and should not be faster than 1.
    let model = Linear { dims: Dims::new(2, 1), a: vec![1.0, 0.1, 0.0, 1.0], b: vec![0.005, 0.1] };
    let none = f64::INFINITY;
    let mut bounds = Bounds::new([-none; 2].repeat(10), [none, 1.0].repeat(10));
    bounds.low[18..].copy_from_slice(&[1.5, 0.0]);
    bounds.high[18..].copy_from_slice(&[1.5, 0.0]);
    let problem = NmpcProblem {
        state_bounds: bounds,
        state_softness: Softness::Exact,
        end_states: vec![0, 1],
        ..NmpcProblem::new(model.dims(), 10, Weights::uniform(vec![1.0, 0.0], vec![0.01]))
    };
    for qp in METHODS {
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(model.clone()), config(qp)).unwrap();
        let step = nmpc.step(&[0.0; 2], &[1.5; 20]).unwrap();
        assert_eq!((step.status, step.violated), (SqpStatus::Converged, None), "{qp}");
        let end = &nmpc.plan().states()[18..];
        assert!((end[0] - 1.5).abs() < 1e-7 && end[1].abs() < 1e-7, "{qp}: {end:?}");
    }
}
