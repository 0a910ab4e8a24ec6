//! Optimizations that fail: an honest status, an input within its bounds, and no harm to the next.

use crate::faulty::{Faulty, NOT_A_NUMBER, SOUND};
use crate::problems::van_der_pol;
use crate::support::{Linear, scalar_problem};
use pinc_mpc::{Bounds, Constraint, Nmpc, NmpcProblem, QpMethod, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Dims, Linearization, Model, Rk4, Stages};
use pinc_plants::VanDerPol;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

fn oscillator() -> Rk4<VanDerPol> {
    Rk4::new(VanDerPol::default(), 0.5, 4)
}

fn faulty(problem: NmpcProblem) -> (Nmpc, Arc<AtomicU64>) {
    let fault = Arc::new(AtomicU64::new(SOUND));
    let model = Faulty { model: oscillator(), fault: Arc::clone(&fault) };
    let nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    (nmpc, fault)
}

#[test]
fn a_model_without_value_leaves_the_last_plan() {
    let (mut nmpc, fault) = faulty(van_der_pol());
    let reference = [0.8, 0.0].repeat(5);
    let first = nmpc.step(&[0.5, 0.0], &reference).unwrap();
    assert_eq!(first.status, SqpStatus::Converged);
    let planned = nmpc.plan().inputs().to_vec();

    fault.store(NOT_A_NUMBER, Ordering::Relaxed);
    for k in 1..8 {
        let step = nmpc.step(&[0.5, 0.1], &reference).unwrap();
        assert_eq!(step.status, SqpStatus::NumericalTrouble);
        assert!(step.kkt.max().is_infinite());
        // The last input of the plan stays when the plan has run out.
        assert_eq!(step.u[0].to_bits(), planned[k.min(4)].to_bits());
    }

    // Recovery: as good as a controller that was never in trouble.
    fault.store(SOUND, Ordering::Relaxed);
    let x = [0.4, -0.2];
    let step = nmpc.step(&x, &reference).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    assert!(step.kkt.max() <= 1e-8);
}

#[test]
fn without_any_plan_the_input_is_zero_moved_into_the_bounds() {
    let mut problem = van_der_pol();
    problem.input_bounds.low = vec![0.25];
    let (mut nmpc, fault) = faulty(problem);
    fault.store(NOT_A_NUMBER, Ordering::Relaxed);
    let step = nmpc.step(&[0.5, 0.0], &[0.0; 10]).unwrap();
    assert_eq!(step.status, SqpStatus::NumericalTrouble);
    assert!((step.u[0] - 0.25).abs() < 1e-15);
    fault.store(SOUND, Ordering::Relaxed);
    let step = nmpc.step(&[0.5, 0.0], &[0.0; 10]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
}

/// x\[k+1\] = x\[k\] + u\[k\] with |u| <= 1 cannot come from 5 to 1 in a step.
#[test]
fn an_infeasible_problem_says_so() {
    let mut problem = scalar_problem(3, 3);
    problem.state_bounds.high = vec![1.0];
    problem.input_bounds.low = vec![-1.0];
    problem.input_bounds.high = vec![1.0];
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let step = nmpc.step(&[0.0], &[1.0; 3]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);

    // Going down as fast as allowed gives the least violation.
    let step = nmpc.step(&[5.0], &[1.0; 3]).unwrap();
    assert_eq!(step.status, SqpStatus::InfeasibleQp);
    assert!(step.followed && (step.u[0] + 1.0).abs() < 1e-8, "{}", step.u[0]);
    assert_eq!(step.violated.unwrap().to_string(), "upper bound of x[k+1][0]");
    assert!((step.kkt.bounds - 3.0).abs() < 1e-6, "{}", step.kkt.bounds);

    let step = nmpc.step(&[0.5], &[1.0; 3]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
}

/// In the real-time iteration too: what can be done is done, and what is in the way is said.
#[test]
fn an_infeasible_prepared_program_says_so() {
    let mut problem = scalar_problem(3, 3);
    problem.state_bounds.high = vec![1.0];
    problem.input_bounds = Bounds::new(vec![-1.0], vec![1.0]);
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, config).unwrap();
    nmpc.prepare();
    let step = nmpc.step(&[5.0], &[1.0; 3]).unwrap();
    assert_eq!(step.status, SqpStatus::Prepared);
    assert_eq!(step.violated.unwrap().to_string(), "upper bound of x[k+1][0]");
    assert!(step.followed && (step.u[0] + 1.0).abs() < 1e-8, "{}", step.u[0]);
    nmpc.prepare();
    let step = nmpc.step(&[0.5], &[1.0; 3]).unwrap();
    assert_eq!((step.status, step.violated), (SqpStatus::Prepared, None));
}

/// x\[k+1\] = x\[k\] + u\[k\] with a derivative of the wrong sign.
#[derive(Debug)]
struct WrongSign(Linear);

impl Model for WrongSign {
    fn dims(&self) -> Dims {
        self.0.dims()
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.0.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Linearization { next, a, b, e } = out;
        self.0.linearize(at, Linearization { next, a, b, e });
        b.iter_mut().for_each(|b| *b = -*b);
    }
}

/// After the first step none decreases the merit function, with constraints hard and then soft, each with
/// Gauss-Newton's Hessian, the exact one, and Gauss-Newton's again.
#[test]
fn an_iteration_without_descent_stalls() {
    let model = Box::new(WrongSign(Linear::scalar(1.0, 1.0)));
    let mut nmpc = Nmpc::new(scalar_problem(3, 3), model, SqpConfig::default()).unwrap();
    let step = nmpc.step(&[5.0], &[1.0; 3]).unwrap();
    assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Stalled, 7));
}

#[test]
fn a_step_after_a_reset_does_the_work_of_the_first() {
    let mut nmpc = limited(50);
    let reference = [0.8, 0.0].repeat(5);
    let first = nmpc.step(&[-0.5, 0.5], &reference).unwrap().work;
    nmpc.reset();
    assert_eq!(nmpc.step(&[-0.5, 0.5], &reference).unwrap().work, first);
}

fn limited(max_iterations: usize) -> Nmpc {
    let config = SqpConfig { max_iterations, ..SqpConfig::default() };
    Nmpc::new(van_der_pol(), Box::new(oscillator()), config).unwrap()
}

#[test]
fn short_of_convergence_a_credible_plan_is_followed() {
    let (x, reference) = ([-0.5, 0.5], [0.8, 0.0].repeat(5));
    let mut full = limited(50);
    let step = full.step(&x, &reference).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    let (needed, optimal) = (step.sqp_iterations, step.u[0]);

    let mut nmpc = limited(needed - 1);
    let step = nmpc.step(&x, &reference).unwrap();
    assert_eq!(step.status, SqpStatus::IterationLimit);
    assert_eq!(step.sqp_iterations, needed - 1);
    assert!(step.kkt.max() > 1e-8 && step.kkt.dynamics <= 1e-4);
    // One iteration short, the error is at most the root of the tolerance.
    assert!((step.u[0] - optimal).abs() < 1e-4, "{} {optimal}", step.u[0]);
}

#[test]
fn short_of_convergence_a_plan_that_contradicts_the_model_is_not_followed() {
    let mut nmpc = limited(1);
    let step = nmpc.step(&[-0.5, 0.5], &[0.8, 0.0].repeat(5)).unwrap();
    assert_eq!(step.status, SqpStatus::IterationLimit);
    assert_eq!(step.sqp_iterations, 1);
    // No plan yet: 0.
    assert!(step.u[0].abs() < 1e-15);
}

/// x\[k+1\] = atan(u\[k\]), on which Newton's iteration diverges from afar.
#[derive(Debug)]
struct Arctangent;

impl Model for Arctangent {
    fn dims(&self) -> Dims {
        Dims::new(1, 1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, _x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        next[0] = u[0].atan();
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let u = at.u[k];
            self.step(&[], &[u], &[], &mut out.next[k..=k]);
            (out.a[k], out.b[k]) = (0.0, 1.0 / (1.0 + u * u));
        }
    }
}

#[test]
fn an_iteration_that_diverges_with_full_steps_converges() {
    let mut problem = scalar_problem(1, 1);
    problem.weights.r = vec![0.0].into();
    problem.input_bounds.low = vec![-100.0];
    problem.input_bounds.high = vec![100.0];
    let mut nmpc = Nmpc::new(problem, Box::new(Arctangent), SqpConfig::default()).unwrap();
    // From u = 0 the iteration climbs to tan(1.4) = 5.8 ..
    let step = nmpc.step(&[0.0], &[1.4]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    // .. from which the first step towards -1.4 is -2.8 (1 + 5.8^2) = -97, and so on to and fro.
    let step = nmpc.step(&[0.0], &[-1.4]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    // The slope is 1/35 there: 1e-8 in the gradient 2 q (1/35) (x - y) are 1e-7 in x, and 35 times
    // that in u.
    assert!((step.u[0] + 1.4_f64.tan()).abs() < 1e-5);
}

#[test]
fn a_deadline_is_kept_and_forgotten() {
    let mut nmpc = limited(50);
    let (x, reference) = ([-0.5, 0.5], [0.8, 0.0].repeat(5));
    for allowed in 0..3 {
        nmpc.reset();
        let mut asked = 0;
        let mut expired = || {
            asked += 1;
            asked > allowed
        };
        let step = nmpc.step_within(&x, &reference, &mut expired).unwrap();
        assert_eq!(step.status, SqpStatus::Deadline);
        assert_eq!(step.sqp_iterations, allowed);
        assert!(step.u[0].abs() <= 1.0);
    }
    let step = nmpc.step(&x, &reference).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
}

/// The time may be up within a quadratic program: the one of twenty inputs that come to their
/// bounds one by one.
#[test]
fn a_deadline_is_kept_within_a_program() {
    let mut problem = scalar_problem(20, 20);
    problem.input_bounds = Bounds::new(vec![-1.0], vec![1.0]);
    for qp in [QpMethod::Condensed, QpMethod::Riccati] {
        let config = SqpConfig { qp, ..SqpConfig::default() };
        let model = Box::new(Linear::scalar(1.0, 1.0));
        let mut nmpc = Nmpc::new(problem.clone(), model, config).unwrap();
        let mut asked = 0;
        let mut expired = || {
            asked += 1;
            asked > 2
        };
        let step = nmpc.step_within(&[0.0], &[15.0; 20], &mut expired).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Deadline, 1), "{qp}");
        assert!(step.u[0].abs() <= 1.0);
        let step = nmpc.step(&[0.0], &[15.0; 20]).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 1), "{qp}");
    }
}

/// Preparing a real-time iteration leaves a quadratic program to the step, and no linearization.
#[test]
fn what_is_prepared_is_not_linearized_again() {
    let points = Arc::new(AtomicU64::new(0));
    let model = Counted { model: oscillator(), points: Arc::clone(&points) };
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    let mut nmpc = Nmpc::new(van_der_pol(), Box::new(model), config).unwrap();
    nmpc.step(&[0.2, -0.3], &[0.0; 10]).unwrap();
    let before = points.load(Ordering::Relaxed);
    nmpc.prepare();
    let prepared = points.load(Ordering::Relaxed);
    assert!(prepared > before);
    nmpc.step(&[0.2, -0.2], &[0.0; 10]).unwrap();
    assert_eq!(points.load(Ordering::Relaxed), prepared);
}

/// The oscillator over 160 stages, RK4 x4, and the points at which its model was linearized.
fn long() -> (Nmpc, Arc<AtomicU64>) {
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0]);
    let problem = NmpcProblem {
        state_bounds: Bounds::new(vec![-1.0; 2], vec![1.0; 2]),
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(Dims::new(2, 1), 160, weights)
    };
    let points = Arc::new(AtomicU64::new(0));
    let model = Counted { model: oscillator(), points: Arc::clone(&points) };
    let nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    (nmpc, points)
}

#[derive(Debug)]
struct Counted {
    model: Rk4<VanDerPol>,
    points: Arc<AtomicU64>,
}

impl Model for Counted {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.model.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.points.fetch_add(at.count(self.dims()) as u64, Ordering::Relaxed);
        self.model.linearize(at, out);
    }
}

/// The time may be up within the first linearization of a long horizon.
#[test]
fn a_deadline_is_kept_within_a_linearization() {
    let (mut nmpc, points) = long();
    let reference = [0.0; 320];
    let step = nmpc.step_within(&[1.0, 0.0], &reference, &mut || true).unwrap();
    assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Deadline, 0));
    assert!(!step.followed && step.u[0].abs() <= 1.0 && step.kkt.max().is_infinite());
    assert_eq!(points.load(Ordering::Relaxed), 32);
    let step = nmpc.step(&[1.0, 0.0], &reference).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
}

/// No step has the time for a whole optimization, and the first ones not even for a program from
/// scratch. Each resumes where the last ended, and the loop comes to rest.
#[test]
fn what_a_deadline_cuts_off_resumes_in_the_next_step() {
    for allowed in [9, 14, 20] {
        let (converged, x) = oscillator_cut_off_after(allowed);
        assert!(converged >= 20, "{allowed}: {converged}");
        assert!(x.iter().all(|x| x.abs() < 1e-3), "{allowed}: {x:?}");
    }
}

/// How many of 40 steps converge where each looks so often at a clock, and where the plant ends.
fn oscillator_cut_off_after(allowed: usize) -> (usize, [f64; 2]) {
    let (mut nmpc, points) = long();
    let mut plant = oscillator();
    let mut x = [1.0, 0.0];
    let mut converged = 0;
    for k in 0..40 {
        let (mut asked, mut when_up) = (0, u64::MAX);
        let mut expired = || {
            asked += 1;
            if asked > allowed {
                when_up = when_up.min(points.load(Ordering::Relaxed));
            }
            asked > allowed
        };
        let step = nmpc.step_within(&x, &[0.0; 320], &mut expired).unwrap();
        assert!(matches!(step.status, SqpStatus::Converged | SqpStatus::Deadline));
        assert!(step.u[0].abs() <= 1.0);
        converged += usize::from(step.status == SqpStatus::Converged);
        assert!(k > 0 || step.status == SqpStatus::Deadline);
        // What is linearized when the time is up is one piece of the horizon at most.
        assert!(points.load(Ordering::Relaxed) <= when_up.saturating_add(32));
        let u = step.u.to_vec();
        let mut next = [0.0; 2];
        plant.step(&x, &u, &[], &mut next);
        x = next;
    }
    (converged, x)
}

/// A hard bound of an output that cannot be kept is as hard in the next step, and says so each time.
#[test]
fn an_output_that_cannot_be_kept_stays_hard() {
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-0.3], vec![0.3]),
        output_bounds: Some(Bounds::new(vec![f64::NEG_INFINITY], vec![1.0])),
        ..scalar_problem(3, 3)
    };
    let controller = || {
        let model = Box::new(Linear::scalar(1.0, 1.0));
        Nmpc::new(problem.clone(), model, SqpConfig::default()).unwrap()
    };
    let (mut nmpc, mut applied) = (controller(), 0.0);
    let reference = [1.5; 3];
    for x in [3.0, 2.7, 2.4] {
        let step = nmpc.step(&[x], &reference).unwrap();
        assert_eq!(step.status, SqpStatus::InfeasibleQp, "{x}");
        assert!(matches!(step.violated, Some(Constraint::Output { index: 0, .. })), "{step:?}");
        // As near to the bound as the input allows, though the reference is above it.
        assert!((step.u[0] + 0.3).abs() < 1e-6, "{x}: {:?}", step.u);
        applied = step.u[0];
    }
    // Back where it can be kept, it is; a controller that was never in trouble does the same.
    for x in [1.1, 0.9, 0.5] {
        let mut fresh = controller();
        fresh.reset_to(&[x], &[applied]).unwrap();
        let expected = fresh.step(&[x], &reference).unwrap().u[0];
        let step = nmpc.step(&[x], &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{x}");
        assert!(x + step.u[0] <= 1.0 + 1e-8, "{x}: {:?}", step.u);
        assert!((step.u[0] - expected).abs() < 1e-6, "{x}: {:?} {expected}", step.u);
        applied = step.u[0];
    }
}
