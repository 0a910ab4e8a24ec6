//! Counts of the controller's evaluations of its model, and of the work of its quadratic programs.

use crate::faulty::{Faulty, NOT_A_NUMBER, SOUND};
use crate::problems::{four_tanks, van_der_pol};
use crate::support::{Linear, scalar_problem};
use pinc_mpc::{Nmpc, QpMethod, SqpConfig, SqpStatus};
use pinc_ode::{Dims, Linearization, Model, Rk4, Stages};
use pinc_plants::{FourTanks, VanDerPol};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// A model that counts the points at which it is linearized.
#[derive(Debug)]
struct Counting<M> {
    model: M,
    points: Arc<AtomicUsize>,
}

impl<M: Model> Model for Counting<M> {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        self.model.step(x, u, &[], next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.points.fetch_add(at.count(self.dims()), Ordering::Relaxed);
        self.model.linearize(at, out);
    }
}

const HORIZON: usize = 5;

struct Counted {
    nmpc: Nmpc,
    points: Arc<AtomicUsize>,
    fault: Arc<AtomicU64>,
}

impl Counted {
    fn new() -> Self {
        let (points, fault) = (Arc::default(), Arc::new(AtomicU64::new(SOUND)));
        let model = Rk4::new(VanDerPol::default(), 0.5, 4);
        let model = Faulty { model, fault: Arc::clone(&fault) };
        let model = Counting { model, points: Arc::clone(&points) };
        let nmpc = Nmpc::new(van_der_pol(), Box::new(model), SqpConfig::default()).unwrap();
        Self { nmpc, points, fault }
    }

    /// The status of a step, the points that it linearized at, and its QPs.
    fn step(&mut self, x: [f64; 2]) -> (SqpStatus, usize, usize) {
        self.points.store(0, Ordering::Relaxed);
        let step = self.nmpc.step(&x, &[0.8, 0.0].repeat(HORIZON)).unwrap();
        let points = self.points.load(Ordering::Relaxed);
        assert_eq!(step.work.linearized, points);
        if step.status == SqpStatus::Converged {
            // Condensed programs: a factor each.
            assert_eq!(step.work.factorizations, step.sqp_iterations);
        }
        (step.status, points, step.sqp_iterations)
    }
}

#[test]
fn a_shifted_plan_is_linearized_at_its_ends() {
    let mut run = Counted::new();
    let (status, points, qps) = run.step([0.2, 0.1]);
    assert_eq!((status, points), (SqpStatus::Converged, (qps + 1) * HORIZON));
    for x in [[0.25, 0.4], [0.5, 0.6], [0.7, 0.3]] {
        let (status, points, qps) = run.step(x);
        assert_eq!((status, points), (SqpStatus::Converged, 2 + qps * HORIZON));
    }
    // Begun anew, nothing is known.
    run.nmpc.reset();
    let (_, points, qps) = run.step([0.7, 0.3]);
    assert_eq!(points, (qps + 1) * HORIZON);
}

/// At rest against a bound, one step ahead, the plan of the step before is optimal with its
/// multipliers: no program is solved.
#[test]
fn at_rest_against_bounds_there_is_nothing_to_solve() {
    let mut problem = scalar_problem(1, 1);
    problem.state_bounds.high = vec![1.0];
    for qp in [QpMethod::Condensed, QpMethod::Riccati] {
        let config = SqpConfig { qp, ..SqpConfig::default() };
        let model = Box::new(Linear::scalar(0.5, 1.0));
        let mut nmpc = Nmpc::new(problem.clone(), model, config).unwrap();
        // The reference of 3 draws the state to its bound, which an input of 0.5 holds.
        nmpc.reset_to(&[1.0], &[0.5]).unwrap();
        let step = nmpc.step(&[1.0], &[3.0]).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 1), "{qp}");
        assert!((step.u[0] - 0.5).abs() < 1e-9, "{}", step.u[0]);
        assert!(nmpc.plan().state_multipliers()[0] > 1.0);
        let step = nmpc.step(&[1.0], &[3.0]).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 0), "{qp}");
    }
}

#[test]
fn stages_without_value_are_asked_again() {
    let mut run = Counted::new();
    run.step([0.2, 0.1]);
    run.fault.store(NOT_A_NUMBER, Ordering::Relaxed);
    assert_eq!(run.step([0.25, 0.4]).0, SqpStatus::NumericalTrouble);
    run.fault.store(SOUND, Ordering::Relaxed);
    let (status, points, qps) = run.step([0.5, 0.6]);
    assert_eq!((status, points), (SqpStatus::Converged, (qps + 1) * HORIZON));
}

/// A first step from the lower bounds of all levels: the sets of active rows of its third program
/// come round again. Followed until its steps were over, that took 29 factors (and 33 with 40
/// stages) instead of 19 (22).
#[test]
fn a_first_step_does_not_go_round_in_circles() {
    for (stages, most) in [(20, 23), (40, 27)] {
        let mut problem = four_tanks();
        (problem.horizon, problem.control_horizon) = (stages, stages);
        let model = Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4));
        let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
        assert_eq!(QpMethod::Auto.resolve([4, 2], [stages; 2]), QpMethod::Riccati);
        let x = [2.0, 2.0, 0.6, 0.6];
        let reference = [9.159_582_958_982_018, 14.211_590_549_777_885].repeat(stages);
        let step = nmpc.step(&x, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        assert!(step.work.changes > stages, "{:?}", step.work);
        assert!(step.work.factorizations <= most, "{:?}", step.work);
        // With a plan there is next to nothing left to do.
        let x = nmpc.plan().states()[..4].to_vec();
        let step = nmpc.step(&x, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        assert!(step.work.factorizations <= step.sqp_iterations + 2, "{:?}", step.work);
    }
}
