//! Features of the problem beyond the paper's experiments: h and g, increments, delays, soft bounds,
//! full weights.

use crate::problems::van_der_pol;
use crate::support::{Linear, scalar_problem};
use pinc_ad::Scalar;
use pinc_mpc::{
    Bounds, Constraints, Nmpc, NmpcProblem, QpMethod, Softness, SqpConfig, SqpStatus,
    StageConstraints, Weight, Weights,
};
use pinc_ode::{Dims, Dopri5, Model, Rk4};
use pinc_plants::VanDerPol;

const METHODS: [QpMethod; 3] = [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel];

/// Tolerance of inputs: KKT residuals of 1e-8 over curvatures of 1 and more, with room.
const TOLERANCE: f64 = 1e-6;

fn controllers(problem: &NmpcProblem, model: &(impl Model + Clone + 'static)) -> Vec<Nmpc> {
    let build = |qp| {
        let config = SqpConfig { qp, ..SqpConfig::default() };
        Nmpc::new(problem.clone(), Box::new(model.clone()), config).unwrap()
    };
    METHODS.map(build).into()
}

/// h = (x1^2 + x2^2 - radius^2), or g with the same, nothing else.
#[derive(Debug)]
struct Circle {
    radius: f64,
    equality: bool,
}

impl StageConstraints for Circle {
    fn inequalities(&self) -> usize {
        usize::from(!self.equality)
    }

    fn equalities(&self) -> usize {
        usize::from(self.equality)
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], h: &mut [S], g: &mut [S]) {
        let to = if self.equality { g } else { h };
        to[0] = x[0] * x[0] + x[1] * x[1] - self.radius * self.radius;
    }
}

/// The state is kept within a circle, and a reference outside it draws it to the edge.
#[test]
fn a_nonlinear_inequality_holds_at_every_stage() {
    let mut problem = van_der_pol();
    problem.state_bounds = Bounds::none(2);
    problem.constraints = Some(Constraints::new(Circle { radius: 0.6, equality: false }));
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    for mut nmpc in controllers(&problem, &model) {
        let mut truth = Dopri5::new(VanDerPol::default(), 1e-9);
        let mut x = vec![0.1, 0.0];
        let mut on_the_edge = 0;
        for k in 0..20 {
            let step = nmpc.step(&x, &[0.9, 0.0].repeat(5)).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{} {k}", nmpc.config().qp);
            truth.integrate(&mut x, step.u, 0.5).unwrap();
            let eta = nmpc.plan().constraint_multipliers();
            for (x, eta) in nmpc.plan().states().chunks_exact(2).zip(eta) {
                let h = x[0].hypot(x[1]) - 0.6;
                assert!(h < 1e-8 && *eta >= -1e-8);
                on_the_edge += usize::from(*eta > 1e-3);
                assert!(*eta < 1e-3 || h.abs() < 1e-6);
            }
        }
        assert!(on_the_edge > 20, "{on_the_edge}");
    }
}

/// One input meets one equation per stage, with the horizon of one step: x[k+1] is on the circle,
/// at its nearest point that the input reaches.
#[test]
fn an_equality_is_met() {
    let mut problem = van_der_pol();
    problem.horizon = 1;
    problem.control_horizon = 1;
    problem.state_bounds = Bounds::none(2);
    problem.constraints = Some(Constraints::new(Circle { radius: 0.5, equality: true }));
    let mut model = Rk4::new(VanDerPol::default(), 0.5, 4);
    for mut nmpc in controllers(&problem, &model) {
        let step = nmpc.step(&[0.4, 0.1], &[0.5, 0.0]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        let mut next = [0.0; 2];
        model.step(&[0.4, 0.1], step.u, &[], &mut next);
        assert!((next[0].hypot(next[1]) - 0.5).abs() < 1e-7);
    }
}

/// x1 + x2 <= 0.5
#[derive(Debug)]
struct Plane;

impl StageConstraints for Plane {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = x[0] + x[1] - 0.5;
    }
}

#[test]
fn an_unattainable_constraint_is_named() {
    let mut problem = van_der_pol();
    problem.state_bounds = Bounds::none(2);
    problem.constraints = Some(Constraints::new(Plane));
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    for mut nmpc in controllers(&problem, &model) {
        let step = nmpc.step(&[2.0, 2.0], &[0.0; 10]).unwrap();
        assert_eq!(step.status, SqpStatus::InfeasibleQp, "{step:?}");
        assert!(step.violated.unwrap().to_string().starts_with("h[0] <= 0 at k+"), "{step:?}");
        assert!(step.followed && step.u[0].abs() <= 1.0);
    }
}

/// x[k+1] = x[k] + u[k] towards 10 with |du| <= 0.5: inputs climb by 0.5 as long as that is too
/// little.
#[test]
fn increments_are_bounded() {
    let mut problem = scalar_problem(4, 4);
    problem.weights = Weights::uniform(vec![1.0], vec![0.0]);
    problem.increment_bounds = Bounds { low: vec![-0.5], high: vec![0.5] };
    for mut nmpc in controllers(&problem, &Linear::scalar(1.0, 1.0)) {
        let (mut x, mut previous) = (0.0, 0.0);
        for k in 0..12 {
            let step = nmpc.step(&[x], &[10.0; 4]).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{k}");
            let u = step.u[0];
            assert!((u - previous).abs() <= 0.5 + 1e-12);
            if k < 3 {
                assert!((u - previous - 0.5).abs() < TOLERANCE, "{u} {previous}");
            }
            x += u;
            previous = u;
        }
        assert!((x - 10.0).abs() < 0.5, "{x}");
    }
}

/// From outside its bounds the first input goes to the nearest, however large the step.
#[test]
fn bounds_come_before_increments() {
    let mut problem = scalar_problem(2, 2);
    problem.input_bounds = Bounds { low: vec![3.0], high: vec![4.0] };
    problem.increment_bounds = Bounds { low: vec![-0.25], high: vec![0.25] };
    for mut nmpc in controllers(&problem, &Linear::scalar(1.0, 1.0)) {
        let step = nmpc.step(&[0.0], &[100.0; 2]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        // u[-1] = 0: as far as to 3, and not further.
        assert!((step.u[0] - 3.0).abs() < TOLERANCE, "{}", step.u[0]);
        assert!((nmpc.plan().inputs()[1] - 3.25).abs() < TOLERANCE);
    }
}

/// A delay of d steps is the problem without delay from where the inputs under way lead.
#[test]
fn a_delayed_problem_is_the_undelayed_one_from_a_later_state() {
    let model = Linear::scalar(1.1, 0.5);
    let mut delayed = NmpcProblem { delay: 2, ..scalar_problem(3, 3) };
    delayed.input_bounds = Bounds { low: vec![-0.8], high: vec![0.8] };
    let plain = NmpcProblem { delay: 0, ..delayed.clone() };
    let mut delayed = Nmpc::new(delayed, Box::new(model.clone()), SqpConfig::default()).unwrap();
    let mut plain = Nmpc::new(plain, Box::new(model), SqpConfig::default()).unwrap();
    let (mut x, mut under_way) = (1.5, [0.0, 0.0]);
    for _ in 0..8 {
        let ahead = 1.1 * (1.1 * x + 0.5 * under_way[0]) + 0.5 * under_way[1];
        let expected = plain.step(&[ahead], &[0.3; 3]).unwrap().u[0];
        let step = delayed.step(&[x], &[0.3; 3]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        assert!((step.u[0] - expected).abs() < TOLERANCE);
        x = 1.1 * x + 0.5 * under_way[0];
        under_way = [under_way[1], step.u[0]];
    }
}

/// x[k+1] = x[k] + u[k], x <= 1, |u| <= 1, from x = 3: one step is not enough, two are.
fn out_of_bounds(softness: Softness) -> NmpcProblem {
    let mut problem = scalar_problem(3, 3);
    problem.weights = Weights::uniform(vec![1.0], vec![0.0]);
    problem.state_bounds.high = vec![1.0];
    problem.state_softness = softness;
    problem.input_bounds = Bounds { low: vec![-1.0], high: vec![1.0] };
    problem
}

#[test]
fn exactly_soft_bounds_are_violated_no_more_than_they_must() {
    for mut nmpc in controllers(&out_of_bounds(Softness::Exact), &Linear::scalar(1.0, 1.0)) {
        let step = nmpc.step(&[3.0], &[5.0; 3]).unwrap();
        assert_eq!((step.status, step.violated), (SqpStatus::Converged, None));
        for (x, expected) in nmpc.plan().states().iter().zip([2.0, 1.0, 1.0]) {
            assert!((x - expected).abs() < TOLERANCE, "{x} {expected}");
        }
        // Where there is a feasible plan, the violations vanish, though the reference draws.
        let step = nmpc.step(&[0.5], &[5.0; 3]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        assert!(nmpc.plan().states().iter().all(|x| *x <= 1.0 + 1e-8));
    }
}

/// With a weight below the multiplier the bound gives way: 2 (x - 5) = -w is where the cost's slope
/// is the weight.
#[test]
fn a_penalty_is_a_price() {
    let softness = Softness::Penalty(vec![6.5]);
    for mut nmpc in controllers(&out_of_bounds(softness), &Linear::scalar(1.0, 1.0)) {
        let step = nmpc.step(&[1.5], &[5.0; 3]).unwrap();
        assert_eq!((step.status, step.violated), (SqpStatus::Converged, None));
        for x in nmpc.plan().states() {
            assert!((x - (5.0 - 3.25)).abs() < TOLERANCE, "{x}");
        }
        assert!((nmpc.plan().state_multipliers()[2] - 6.5).abs() < TOLERANCE);
    }
}

/// Softened bounds leave the end of the horizon where it must be, and the way there soft.
#[test]
fn an_end_is_met_whatever_bounds_cost() {
    for (softness, is_soft) in [(Softness::Penalty(vec![6.5]), true), (Softness::Exact, false)] {
        let mut problem = out_of_bounds(softness);
        let last = problem.horizon - 1;
        let side = |of: &[f64], end: f64| [of.repeat(last), vec![end]].concat();
        let Bounds { low, high } = &problem.state_bounds;
        problem.state_bounds = Bounds::new(side(low, 0.8), side(high, 0.8));
        problem.end_states = vec![0];
        for mut nmpc in controllers(&problem, &Linear::scalar(1.0, 1.0)) {
            let step = nmpc.step(&[1.5], &[5.0; 3]).unwrap();
            assert_eq!(step.status, SqpStatus::Converged);
            let x = nmpc.plan().states();
            assert!((x[last] - 0.8).abs() < TOLERANCE && (x[0] > 1.1) == is_soft, "{x:?}");
            let out_of_reach = nmpc.step(&[4.5], &[5.0; 3]).unwrap();
            let violated = out_of_reach.violated.map(|of| of.to_string());
            assert_eq!(out_of_reach.status, SqpStatus::InfeasibleQp);
            assert_eq!(violated.as_deref(), Some("given value of x[k+3][0]"));
        }
    }
}

/// With a full Q, R = 0, an invertible B and a horizon of 1 the plan meets the reference; with a
/// singular Q only what Q sees: here y1 - y2.
#[test]
fn weights_may_be_full() {
    let dims = Dims::new(2, 2);
    let model = Linear { dims, a: vec![1.0, 0.2, -0.1, 0.9], b: vec![1.0, 0.0, 0.5, 1.0] };
    let q = Weight::Full(vec![vec![2.0, -2.0], vec![-2.0, 2.0]]);
    let weights = Weights::uniform(q, vec![1e-3; 2]);
    let problem = NmpcProblem::new(dims, 1, weights);
    for mut nmpc in controllers(&problem, &model) {
        let step = nmpc.step(&[0.3, 0.4], &[3.0, 1.0]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        let x = nmpc.plan().states();
        // The weight of the inputs, 1e-3 of Q's, costs about so much of it.
        assert!((x[0] - x[1] - 2.0).abs() < 2e-3, "{x:?}");
    }
}

#[test]
fn a_terminal_weight_counts_at_the_end_only() {
    let mut problem = scalar_problem(2, 2);
    problem.weights = Weights::uniform(vec![1.0], vec![1.0]).with_terminal(vec![100.0]);
    for mut nmpc in controllers(&problem, &Linear::scalar(1.0, 1.0)) {
        let step = nmpc.step(&[0.0], &[1.0, 4.0]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        // min (x1 - 1)^2 + 100 (x2 - 4)^2 + x1^2 + (x2 - 2 x1)^2:
        // 12 x1 - 4 x2 = 2 and 101 x2 - 2 x1 = 400.
        let x2 = (400.0 + 1.0 / 3.0) / (101.0 - 2.0 / 3.0);
        let expected = [(2.0 + 4.0 * x2) / 12.0, x2];
        for (x, expected) in nmpc.plan().states().iter().zip(expected) {
            assert!((x - expected).abs() < TOLERANCE, "{x} {expected}");
        }
    }
}

/// In the real-time iteration each step is one QP, and the loop settles where the converged one
/// does.
#[test]
fn the_real_time_iteration_follows() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    let mut quick = Nmpc::new(van_der_pol(), Box::new(model.clone()), config).unwrap();
    let mut full = Nmpc::new(van_der_pol(), Box::new(model), SqpConfig::default()).unwrap();
    let mut truth = Dopri5::new(VanDerPol::default(), 1e-9);
    let reference = [0.8, 0.0].repeat(5);
    let mut x = vec![0.2, -0.3];
    let mut far = 0.0_f64;
    for k in 0..40 {
        let expected = full.step(&x, &reference).unwrap().u[0];
        quick.prepare();
        let step = quick.step(&x, &reference).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Prepared, 1));
        if k >= 20 {
            far = far.max((step.u[0] - expected).abs());
        }
        let u = step.u.to_vec();
        truth.integrate(&mut x, &u, 0.5).unwrap();
    }
    assert!(far < 1e-5, "{far}");
    assert!((x[0] - 0.8).abs() < 1e-2, "{x:?}");
}
