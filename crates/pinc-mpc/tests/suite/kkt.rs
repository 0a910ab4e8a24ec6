//! Solutions judged by the optimality conditions, assembled here a second time.

use crate::support::{Linear, four_tanks, van_der_pol};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Profile, SqpConfig, SqpStatus, Weight, Weights};
use pinc_ode::{Adaptive, Dims, FourTanks, Plant, Predictor, Rk4, VanDerPol};
use proptest::prelude::*;

/// What one step was asked.
pub(crate) struct Asked<'a> {
    pub(crate) x: &'a [f64],
    pub(crate) previous: &'a [f64],
    pub(crate) reference: &'a [f64],
}

fn diagonal(weight: &Weight) -> &[f64] {
    match weight {
        Weight::Diagonal(diagonal) => diagonal,
        Weight::Full(_) => panic!("the problems here have diagonal weights"),
    }
}

/// The residuals of the KKT conditions at the controller's plan: stationarity, feasibility of the
/// dynamics, violation of bounds, complementarity; unscaled, with Jacobians from the model.
#[expect(clippy::needless_range_loop, reason = "indices as in the formulas")]
pub(crate) fn residuals(nmpc: &Nmpc, model: &mut dyn Predictor, asked: &Asked<'_>) -> [f64; 4] {
    let (problem, plan) = (nmpc.problem(), nmpc.plan());
    let Dims { states: n, inputs: m } = model.dims();
    let x = |j: usize| match j {
        0 => asked.x,
        _ => &plan.states()[(j - 1) * n..j * n],
    };
    let u = |i: usize| &plan.inputs()[i * m..(i + 1) * m];
    let weight = |stage: usize| match problem.weights.profile {
        Profile::Uniform => 1.0,
        Profile::Cumulative => (problem.last - stage) as f64 * model.horizon_s(),
    };

    // dJ/dx and dJ/du
    let mut dx = vec![vec![0.0; n]; problem.last + 1];
    let mut du = vec![vec![0.0; m]; problem.control];
    for j in problem.first..=problem.last {
        for (i, &state) in problem.controlled.iter().enumerate() {
            let error = x(j)[state] - asked.reference[(j - 1) * problem.controlled.len() + i];
            dx[j][state] += 2.0 * weight(j - 1) * diagonal(&problem.weights.q)[i] * error;
        }
    }
    for i in 0..problem.control {
        for c in 0..m {
            let before = if i == 0 { asked.previous[c] } else { u(i - 1)[c] };
            let slope = 2.0 * weight(i) * diagonal(&problem.weights.r)[c] * (u(i)[c] - before);
            du[i][c] += slope;
            if i > 0 {
                du[i - 1][c] -= slope;
            }
        }
    }

    let mut infeasibility: f64 = 0.0;
    let (mut next, mut a, mut b) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n * m]);
    for j in 0..problem.last {
        let acting = j.min(problem.control - 1);
        model.linearize(x(j), u(acting), &mut next, &mut a, &mut b);
        let lambda = &plan.dynamics_multipliers()[j * n..(j + 1) * n];
        for row in 0..n {
            infeasibility = infeasibility.max((next[row] - x(j + 1)[row]).abs());
            dx[j + 1][row] -= lambda[row];
            for column in 0..n {
                dx[j][column] += lambda[row] * a[row * n + column];
            }
            for column in 0..m {
                du[acting][column] += lambda[row] * b[row * m + column];
            }
        }
    }

    let (mut stationarity, mut violation, mut complementarity) = (0.0_f64, 0.0_f64, 0.0_f64);
    let mut bounded = |slope: f64, mu: f64, value: f64, low: f64, high: f64| {
        stationarity = stationarity.max((slope + mu).abs());
        violation = violation.max(low - value).max(value - high);
        if mu > 0.0 {
            complementarity = complementarity.max(mu * (high - value));
        }
        if mu < 0.0 {
            complementarity = complementarity.max(-mu * (value - low));
        }
    };
    for j in 1..=problem.last {
        for (i, &slope) in dx[j].iter().enumerate() {
            let mu = plan.state_multipliers()[(j - 1) * n + i];
            let Bounds { low, high } = &problem.state_bounds;
            bounded(slope, mu, x(j)[i], low[i], high[i]);
        }
    }
    for (i, slopes) in du.iter().enumerate() {
        for (c, &slope) in slopes.iter().enumerate() {
            let mu = plan.input_multipliers()[i * m + c];
            let Bounds { low, high } = &problem.input_bounds;
            bounded(slope, mu, u(i)[c], low[c], high[c]);
        }
    }
    [stationarity, infeasibility, violation, complementarity]
}

/// The scaling that `KktResidual` documents.
pub(crate) fn scale(nmpc: &Nmpc) -> f64 {
    let plan = nmpc.plan();
    let all =
        [plan.dynamics_multipliers(), plan.state_multipliers(), plan.input_multipliers()].concat();
    let count = all.len() + plan.increment_multipliers().len();
    let mean = all.iter().map(|l| l.abs()).sum::<f64>() / count as f64;
    f64::max(1.0, mean / 100.0)
}

/// Runs a closed loop towards `reference`, judging every step.
fn judge<P: Plant>(plant: P, horizon_s: f64, problem: NmpcProblem, x0: &[f64], y: &[f64]) {
    let mut model = Rk4::new(plant.clone(), horizon_s, 4);
    let mut nmpc = Nmpc::new(problem, Box::new(model.clone()), SqpConfig::default()).unwrap();
    let mut truth = Adaptive::new(plant, 1e-9);
    let reference = y.repeat(nmpc.problem().last);
    let mut x = x0.to_vec();
    let mut previous = vec![0.0; model.dims().inputs];
    for k in 0..25 {
        let step = nmpc.step(&x, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "step {k}");
        let (u, reported) = (step.u.to_vec(), step.kkt);
        let asked = Asked { x: &x, previous: &previous, reference: &reference };
        let [stationarity, dynamics, bounds, complementarity] =
            residuals(&nmpc, &mut model, &asked);
        let s = scale(&nmpc);
        let found = [stationarity / s, dynamics, bounds, complementarity / s];
        assert!(found.iter().all(|&r| r <= 1e-8), "step {k}: {found:?}");
        // Sums of some ten terms up to 1e3, in another order: 1e-12.
        let worst = found.iter().fold(0.0, |worst: f64, r| worst.max(*r));
        assert!((worst - reported.max()).abs() < 1e-11, "step {k}: {worst:e} {reported:?}");
        truth.integrate(&mut x, &u, horizon_s).unwrap();
        previous = u;
    }
}

#[test]
fn plans_for_the_oscillator_are_optimal() {
    judge(VanDerPol::default(), 0.5, van_der_pol(), &[1.0, 0.0], &[0.8, 0.0]);
    // A reference outside the bounds keeps some of these active.
    judge(VanDerPol::default(), 0.5, van_der_pol(), &[0.2, -0.4], &[-1.2, 0.0]);
}

#[test]
fn plans_for_the_tanks_are_optimal() {
    let x0 = [2.0, 2.0, 0.6, 0.6];
    judge(FourTanks::antonelo(), 10.0, four_tanks(), &x0, &[9.2, 14.2]);
}

#[test]
fn plans_of_every_shape_are_optimal() {
    let mut problem = four_tanks();
    problem.first = 2;
    problem.last = 6;
    problem.control = 3;
    problem.controlled = vec![1, 3, 0];
    problem.weights = Weights {
        profile: Profile::Cumulative,
        ..Weights::uniform(vec![3.0, 0.0, 5.0], vec![1.0, 0.2])
    };
    problem.state_bounds.low[2] = f64::NEG_INFINITY;
    problem.input_bounds.high[1] = f64::INFINITY;
    let x0 = [12.0, 13.0, 1.8, 1.4];
    judge(FourTanks::johansson_minimum(), 10.0, problem, &x0, &[13.0, 1.0, 11.0]);
}

/// A warm start saves work: the same steps taken without memory need more QPs, though both are
/// solved to the same accuracy.
#[test]
fn a_warm_start_saves_iterations() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let controller = || Nmpc::new(van_der_pol(), Box::new(model.clone()), SqpConfig::default());
    let mut warm = controller().unwrap();
    let mut truth = Adaptive::new(VanDerPol::default(), 1e-9);
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
        let dims = Dims { states: 3, inputs: 2 };
        let mut model = Linear { dims, a, b };
        let weights = Weights::uniform(vec![10.0, 1.0], vec![0.1, 1.0]);
        let problem = NmpcProblem {
            control,
            controlled: vec![2, 0],
            // |x_j| <= 4 is out of reach: the row sums of |A| and |B| are below 1.8 and 2.
            state_bounds: Bounds { low: vec![-40.0; 3], high: vec![40.0; 3] },
            input_bounds: Bounds { low: vec![-0.5; 2], high },
            ..NmpcProblem::new(dims, 4, weights)
        };
        let mut nmpc = Nmpc::new(problem, Box::new(model.clone()), SqpConfig::default()).unwrap();
        let status = nmpc.step(&x, &reference).unwrap().status;
        prop_assert_eq!(status, SqpStatus::Converged);
        let asked = Asked { x: &x, previous: &[0.0; 2], reference: &reference };
        let found = residuals(&nmpc, &mut model, &asked);
        prop_assert!(found.iter().all(|&r| r <= 1e-8 * scale(&nmpc)), "{:?}", found);
    }
}
