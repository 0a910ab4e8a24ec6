//! Plans with RK4 as the model, judged by the optimality conditions.

use crate::optimality::{StepInput, judge, residuals, scale};
use crate::problems::{Loop, four_tanks, four_tanks_loop, van_der_pol, van_der_pol_loop};
use crate::support::Linear;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Tracked, Weights};
use pinc_ode::{Dims, Dopri5, Rk4};
use pinc_plants::{FourTanks, VanDerPol};
use proptest::prelude::*;

#[test]
fn every_plan_of_the_oscillators_loop_is_optimal() {
    judge(van_der_pol_loop(), Rk4::new(VanDerPol::default(), 0.5, 4));
}

#[test]
fn every_plan_of_the_tanks_loop_is_optimal() {
    judge(four_tanks_loop(), Rk4::new(FourTanks::antonelo(), 10.0, 4));
}

/// A reference outside the bounds keeps some of these active.
#[test]
fn plans_at_their_bounds_are_optimal() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let target = (&[&[-1.2, 0.0][..]][..], 25);
    judge(Loop::new(van_der_pol(), model.clone(), &[0.2, -0.4], target), model);
}

#[test]
fn plans_of_every_shape_are_optimal() {
    let mut problem = four_tanks();
    problem.n1 = 2;
    problem.horizon = 6;
    problem.control_horizon = 3;
    problem.tracked = Tracked::states([1, 3, 0]);
    let (w, v) = ([60.0, 50.0, 40.0, 30.0, 20.0, 10.0], [60.0, 50.0, 40.0]);
    problem.weights = Weights::scaled(vec![3.0, 0.0, 5.0], vec![1.0, 0.2], &w, &v);
    problem.state_bounds.low[2] = f64::NEG_INFINITY;
    problem.input_bounds.high[1] = f64::INFINITY;
    let model = Rk4::new(FourTanks::johansson_minimum(), 10.0, 4);
    let target = (&[&[13.0, 1.0, 11.0][..]][..], 25);
    judge(Loop::new(problem, model.clone(), &[12.0, 13.0, 1.8, 1.4], target), model);
}

/// A warm start saves work: the same steps taken without memory need more QPs, though both are
/// solved to the same accuracy.
#[test]
fn a_warm_start_saves_iterations() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let controller = || Nmpc::new(van_der_pol(), Box::new(model.clone()), SqpConfig::default());
    let mut warm = controller().unwrap();
    let mut truth = Dopri5::new(VanDerPol::default(), 1e-9);
    let reference = [0.8, 0.0].repeat(5);
    let mut x = vec![0.5, -0.3];
    let (mut warm_work, mut cold_work) = (0, 0);
    for _ in 0..30 {
        cold_work += controller().unwrap().step(&x, &reference).unwrap().sqp_iterations;
        let step = warm.step(&x, &reference).unwrap();
        warm_work += step.sqp_iterations;
        truth.integrate(&mut x, step.u, 0.5).unwrap();
    }
    assert!(warm_work * 3 < cold_work * 2, "{warm_work} {cold_work}");
    assert!(warm_work <= 30 * 4, "{warm_work}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Linear models with random dynamics and bounds that x = 0, u = 0 satisfies.
    #[test]
    fn random_linear_problems_are_solved(
        a in prop::collection::vec(-0.6..0.6, 9),
        b in prop::collection::vec(-1.0..1.0, 6),
        x in prop::collection::vec(-1.0..1.0, 3),
        reference in prop::collection::vec(-3.0..3.0, 8),
        high in prop::collection::vec(0.05..2.0, 2),
        control in 1..=4_usize,
    ) {
        let dims = Dims::new(3, 2);
        let mut model = Linear { dims, a, b };
        let weights = Weights::uniform(vec![10.0, 1.0], vec![0.1, 1.0]);
        let problem = NmpcProblem {
            control_horizon: control,
            tracked: Tracked::states([2, 0]),
            // |x_j| <= 4 is out of reach: the row sums of |A| and |B| are below 1.8 and 2.
            state_bounds: Bounds { low: vec![-40.0; 3], high: vec![40.0; 3] },
            input_bounds: Bounds { low: vec![-0.5; 2], high },
            ..NmpcProblem::new(dims, 4, weights)
        };
        let mut nmpc = Nmpc::new(problem, Box::new(model.clone()), SqpConfig::default()).unwrap();
        let status = nmpc.step(&x, &reference).unwrap().status;
        prop_assert_eq!(status, SqpStatus::Converged);
        let input = StepInput { x: &x, previous: &[0.0; 2], reference: &reference };
        let found = residuals(&nmpc, &mut model, &input);
        prop_assert!(found.iter().all(|&r| r <= 1e-8 * scale(&nmpc)), "{:?}", found);
    }
}
