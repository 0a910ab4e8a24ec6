//! The accurate integrator on stiff plants: published and exact solutions, and what it costs.

use crate::common::Oscillator;
use pinc_ad::Scalar;
use pinc_ode::{AccurateIntegrator, Dopri5, OdeError, Plant, Variable};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

#[derive(Clone, Debug)]
enum Equation {
    /// Robertson's three reactions.
    Robertson,
    /// Van der Pol's oscillator, scaled: eps y2' = (1 - y1^2) y2 - y1 with eps = 1e-6.
    Relaxation,
    /// x1' = -rate (x1 - x2), x2' = -x2/time: x2 decays, x1 follows it.
    Fast { rate: f64, time: f64 },
    /// A wall of so many layers with a warm side: x' is rate times the second difference of x.
    Wall { rate: f64, layers: usize },
    /// A fast mode, and no equation once x2 has fallen to 1/2.
    Ends,
}

/// An equation that counts how often it is evaluated.
#[derive(Clone, Debug)]
struct Counted(Equation, Arc<AtomicUsize>);

impl Counted {
    fn new(equation: Equation) -> (Self, Arc<AtomicUsize>) {
        let calls = Arc::new(AtomicUsize::new(0));
        (Self(equation, Arc::clone(&calls)), calls)
    }
}

impl Plant for Counted {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 40] = [const { Variable::new("x", "") }; 40];
        match self.0 {
            Equation::Robertson => &VARIABLES[..3],
            Equation::Wall { layers, .. } => &VARIABLES[..layers],
            _ => &VARIABLES[..2],
        }
    }
    fn inputs(&self) -> &[Variable] {
        &[]
    }
    fn rhs<S: Scalar>(&self, x: &[S], _: &[S], _: &[S], dx: &mut [S]) {
        self.1.fetch_add(1, Ordering::Relaxed);
        match self.0 {
            Equation::Robertson => {
                dx[0] = x[0] * -0.04 + x[1] * x[2] * 1e4;
                dx[2] = x[1] * x[1] * 3e7;
                dx[1] = -dx[0] - dx[2];
            }
            Equation::Relaxation => {
                dx[0] = x[1];
                dx[1] = ((-x[0] * x[0] + 1.0) * x[1] - x[0]) * 1e6;
            }
            Equation::Fast { rate, time } => {
                dx[0] = (x[1] - x[0]) * rate;
                dx[1] = x[1] * (-1.0 / time);
            }
            Equation::Wall { rate, layers } => {
                for i in 0..layers {
                    let before = if i == 0 { x[0].constant(1.0) } else { x[i - 1] };
                    let after = if i + 1 == layers { x[0].constant(0.0) } else { x[i + 1] };
                    dx[i] = (before - x[i] * 2.0 + after) * rate;
                }
            }
            Equation::Ends => {
                dx[0] = (x[1] - x[0]) * 1e6;
                dx[1] = (-x[1] + 0.5).where_nonpositive(x[1].constant(-1.0), x[1] * f64::NAN);
            }
        }
    }
}

/// The state after `duration`, how often f was evaluated, and whether by the implicit method.
fn end(equation: Equation, start: &[f64], duration: f64, tol: f64) -> (Vec<f64>, usize, bool) {
    let (plant, calls) = Counted::new(equation);
    let (mut integrator, mut x) = (AccurateIntegrator::new(plant, tol), start.to_vec());
    integrator.integrate(&mut x, &[], duration).unwrap();
    (x, calls.load(Ordering::Relaxed), integrator.is_implicit())
}

/// Hairer and Wanner, *Solving Ordinary Differential Equations II*: Robertson's problem at t = 40,
/// and the relaxation oscillation at t = 2 as in the Test Set for IVP Solvers.
#[test]
fn published_solutions_of_stiff_problems() {
    let (x, calls, implicit) = end(Equation::Robertson, &[1.0, 0.0, 0.0], 40.0, 1e-10);
    let expected = [0.715_827_068_8, 9.185_534_765e-6, 0.284_163_745_7];
    assert!(implicit && calls < 20_000, "{calls}");
    for (x, expected) in x.iter().zip(expected) {
        assert!((x - expected).abs() < 1e-8, "{x} {expected}");
    }
    let (x, calls, implicit) = end(Equation::Relaxation, &[2.0, 0.0], 2.0, 1e-9);
    let expected = [1.706_167_732_170_483, -0.892_809_701_024_797_5];
    assert!(implicit && calls < 60_000, "{calls}");
    for (x, expected) in x.iter().zip(expected) {
        assert!((x - expected).abs() < 1e-5, "{x} {expected}");
    }
}

/// With x2 = exp(-t/time), x1 = (x1(0) - b) exp(-rate t) + b x2, b = rate time/(rate time - 1).
#[test]
fn the_exact_solution_in_any_unit_of_time() {
    for time in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
        for stiffness in [1e3, 1e6, 1e9] {
            for tolerance in [1e-6, 1e-9, 1e-12] {
                let equation = Equation::Fast { rate: stiffness / time, time };
                let (x, calls, implicit) = end(equation, &[0.0, 1.0], time, tolerance);
                let slow = (-1.0_f64).exp();
                let expected = [stiffness / (stiffness - 1.0) * slow, slow];
                assert!(
                    (implicit || stiffness < 1e6) && calls < 6000,
                    "{time} {stiffness} {tolerance} {calls}"
                );
                for (x, expected) in x.iter().zip(expected) {
                    let error = (x - expected).abs();
                    let bound = 30.0 * tolerance + 1e-12;
                    assert!(error < bound, "{time} {stiffness} {tolerance} {error}");
                }
            }
        }
    }
}

/// Many layers: the profile at rest is a straight line, which a hundred thousand explicit steps
/// would be needed for.
#[test]
fn a_wall_at_rest() {
    let equation = Equation::Wall { rate: 1e4, layers: 40 };
    let (x, calls, implicit) = end(equation, &[0.0; 40], 40.0, 1e-9);
    assert!(implicit && calls < 20_000, "{calls}");
    for (i, x) in x.iter().enumerate() {
        let expected = 1.0 - f64::from(u32::try_from(i + 1).unwrap()) / 41.0;
        assert!((x - expected).abs() < 1e-8, "{i} {x} {expected}");
    }
}

/// Where nothing is stiff the explicit method's bits come out.
#[test]
fn a_plant_that_is_not_stiff_is_left_to_the_explicit_method() {
    for damping in [0.0, 0.3, 1.0] {
        let plant = Oscillator { damping };
        let (mut explicit, mut accurate) =
            (Dopri5::new(plant.clone(), 1e-12), AccurateIntegrator::new(plant, 1e-12));
        let (mut one, mut other) = ([1.0, 0.5], [1.0, 0.5]);
        for k in 0..50 {
            let u = [f64::from(k % 3) - 1.0];
            explicit.integrate(&mut one, &u, 0.5).unwrap();
            accurate.integrate(&mut other, &u, 0.5).unwrap();
            assert_eq!(one.map(f64::to_bits), other.map(f64::to_bits), "{damping} {k}");
        }
        assert!(!accurate.is_implicit());
    }
}

#[test]
fn the_implicit_method_says_where_the_equation_ends() {
    let (plant, _) = Counted::new(Equation::Ends);
    let mut integrator = AccurateIntegrator::new(plant, 1e-8);
    let mut x = vec![1.0, 1.0];
    let error = integrator.integrate(&mut x, &[], 1.0).unwrap_err();
    assert!(integrator.is_implicit());
    let OdeError::NotFinite { t, .. } = error else { panic!("{error:?}") };
    assert!((t - 0.5).abs() < 1e-6, "{t}");
}
