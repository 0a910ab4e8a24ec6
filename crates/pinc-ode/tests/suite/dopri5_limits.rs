//! The adaptive integrator at its limits: jumps, poles, NaN; and the work that it counts.

use pinc_ad::Scalar;
use pinc_ode::{Dopri5, OdeError, Plant, Variable};
use pinc_plants::{FourTanks, VanDerPol};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

fn integrate(
    integrator: &mut Dopri5,
    x: &[f64],
    u: &[f64],
    duration: f64,
) -> Result<Vec<f64>, OdeError> {
    let mut x = x.to_vec();
    integrator.integrate(&mut x, u, duration).map(|()| x)
}

/// Equations without an input that are hard on an integrator, or very easy.
#[derive(Clone, Copy, Debug)]
enum Equation {
    /// x' = x^2
    BlowUp,
    /// x' = 1 for the first half second, then -1; the second state is the time.
    Jump,
    /// x' = -1 above 0, +1 below: no solution goes on after 0.
    Chatter,
    /// x' = 1
    Clock,
    /// x' = 1e300
    Overflow,
    /// x' = 1 up to x = 1/2, NaN from there on
    Undefined,
}

impl Plant for Equation {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("x", ""), Variable::new("t", "s")];
        match self {
            Self::Jump => &VARIABLES,
            _ => &VARIABLES[..1],
        }
    }
    fn inputs(&self) -> &[Variable] {
        &[]
    }
    fn rhs<S: Scalar>(&self, x: &[S], _: &[S], _p: &[S], dx: &mut [S]) {
        let number = |value: f64| x[0].constant(value);
        dx[0] = match self {
            Self::BlowUp => x[0] * x[0],
            Self::Jump => (x[1] - 0.5).where_nonpositive(number(1.0), number(-1.0)),
            Self::Chatter => x[0].where_nonpositive(number(1.0), number(-1.0)),
            Self::Clock => number(1.0),
            Self::Overflow => number(1e300),
            Self::Undefined => (x[0] - 0.5).where_nonpositive(number(1.0), number(f64::NAN)),
        };
        if let Self::Jump = self {
            dx[1] = number(1.0);
        }
    }
}

/// The step that crosses the jump is cut down until its estimated error fits the tolerance. With
/// the jump at the fraction c of a step, only the stages after c see it: the estimate is the sum of
/// their weights in `ERROR`, the true error 1 - c less the sum of their weights in the solution.
/// The ratio is worst for c just below 0.3, where it is 0.209 / 0.00123 = 170.
#[test]
fn jump_in_the_right_hand_side() {
    let mut integrator = Dopri5::new(Equation::Jump, 1e-12);
    let x = integrate(&mut integrator, &[0.0, 0.0], &[], 1.0).unwrap();
    // Up for half a second, down for another; at the jump x = 1/2.
    let bound = 170.0 * 1e-12 * 1.5;
    assert!(x[0].abs() < bound && (x[1] - 1.0).abs() < 1e-14, "{x:?}");
}

/// x = 1 / (1 - t) ends at t = 1.
#[test]
fn blow_up_in_finite_time() {
    let mut integrator = Dopri5::new(Equation::BlowUp, 1e-12);
    let mut x = vec![1.0];
    let error = integrator.integrate(&mut x, &[], 2.0).unwrap_err();
    let OdeError::StepTooSmall { t, step } = error else {
        panic!("{error:?}");
    };
    // The pole moves by as much as the errors: steps * 1e-12, fewer than 1e4 of them.
    assert!((t - 1.0).abs() < 1e-8 && step < 1e-15, "{error:?}");
    assert!(x[0].is_finite() && x[0] > 1e8, "{x:?}");
    assert!(error.to_string().contains("too stiff or has a jump"), "{error}");
}

/// It gets as far as x = 0, where the solution ends at t = 0.1, and then tries a million steps of
/// at most tolerance / (2 * 0.00123) = 4e-10 s (the ratio above): 4e-4 s.
#[test]
fn chattering_is_given_up() {
    let mut integrator = Dopri5::new(Equation::Chatter, 1e-12);
    let mut x = vec![0.1];
    let error = integrator.integrate(&mut x, &[], 1.0).unwrap_err();
    let OdeError::StepTooSmall { t, .. } = error else {
        panic!("{error:?}");
    };
    assert!((t - 0.1).abs() < 4e-4 && x[0].abs() < 1e-9, "{error:?} {x:?}");
    assert!(integrator.rhs_calls() <= 6_000_001);
}

#[test]
fn state_that_is_not_finite() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for equation in [Equation::Clock, Equation::BlowUp, Equation::Chatter] {
            let mut integrator = Dopri5::new(equation, 1e-9);
            let error = integrate(&mut integrator, &[bad], &[], 1.0).unwrap_err();
            let OdeError::NotFinite { t, state } = &error else {
                panic!("{error:?}");
            };
            assert_eq!((t.to_bits(), state[0].to_bits()), (0, bad.to_bits()));
        }
    }
    let mut integrator = Dopri5::new(VanDerPol::default(), 1e-9);
    let error = integrate(&mut integrator, &[0.0, 0.0], &[f64::NAN], 1.0).unwrap_err();
    assert!(matches!(error, OdeError::NotFinite { .. }), "{error:?}");
}

#[test]
fn state_that_becomes_not_finite() {
    let mut integrator = Dopri5::new(Equation::Undefined, 1e-9);
    let mut x = vec![0.0];
    let error = integrator.integrate(&mut x, &[], 1.0).unwrap_err();
    // It breaks off within 1e-12 of the duration before x = t = 1/2, with what it has.
    let OdeError::NotFinite { t, state } = &error else {
        panic!("{error:?}");
    };
    assert!((t - 0.5).abs() < 1e-11 && (state[0] - 0.5).abs() < 1e-11, "{error:?}");
    assert_eq!(*state, x);
    assert!(error.to_string().starts_with("the solution is no longer finite at t = "), "{error}");

    // 1e300 * 1e9 s is more than an f64 holds; the derivative is finite all along.
    let error = integrate(&mut Dopri5::new(Equation::Overflow, 1e-9), &[0.0], &[], 1e9);
    assert!(matches!(error, Err(OdeError::NotFinite { .. })), "{error:?}");
}

#[test]
fn after_an_error_the_integrator_continues() {
    let mut integrator = Dopri5::new(VanDerPol::default(), 1e-10);
    let expected = integrate(&mut integrator.clone(), &[1.0, 0.0], &[0.5], 0.5).unwrap();
    integrate(&mut integrator, &[f64::NAN, 0.0], &[0.5], 0.5).unwrap_err();
    assert_eq!(integrate(&mut integrator, &[1.0, 0.0], &[0.5], 0.5).unwrap(), expected);
}

/// No time, no change, and no step size of 0 that the next call would be stuck with.
#[test]
fn zero_duration() {
    let mut integrator = Dopri5::new(Equation::Clock, 1e-9);
    for _ in 0..2 {
        assert_eq!(integrate(&mut integrator, &[3.0], &[], 0.0).unwrap(), [3.0]);
        let x = integrate(&mut integrator, &[3.0], &[], 1.0).unwrap();
        assert!((x[0] - 4.0).abs() < 1e-14, "{x:?}");
    }
}

#[test]
fn misuse_is_a_programming_error() {
    for tolerance in [0.0, -1.0, f64::NAN] {
        let build = || Dopri5::new(Equation::Clock, tolerance);
        assert!(std::panic::catch_unwind(build).is_err(), "{tolerance}");
    }
    for duration in [-1.0, f64::NAN, f64::INFINITY] {
        let run = || integrate(&mut Dopri5::new(Equation::Clock, 1e-9), &[0.0], &[], duration);
        assert!(std::panic::catch_unwind(run).is_err(), "{duration}");
    }
    // The oscillator has two states and one input.
    for (states, inputs) in [(1, 1), (3, 1), (2, 0), (2, 2)] {
        let run = || {
            let mut integrator = Dopri5::new(VanDerPol::default(), 1e-9);
            integrate(&mut integrator, &vec![0.0; states], &vec![0.0; inputs], 1.0)
        };
        assert!(std::panic::catch_unwind(run).is_err(), "{states} states, {inputs} inputs");
    }
}

/// x' = -p x.
#[derive(Clone, Debug)]
struct Decay;

impl Plant for Decay {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }
    fn inputs(&self) -> &[Variable] {
        &[]
    }
    fn parameters(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("p", "1/s")];
        &VARIABLES
    }
    fn rhs<S: Scalar>(&self, x: &[S], _u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = -(p[0] * x[0]);
    }
}

/// Parameters hold until others are set; without them there is no solution.
#[test]
fn parameters_are_set_first() {
    let mut integrator = Dopri5::new(Decay, 1e-11);
    for rate in [0.5, 2.0] {
        integrator.set_parameters(&[rate]);
        for _ in 0..2 {
            let end = integrate(&mut integrator, &[1.0], &[], 1.5).unwrap();
            // A few dozen steps, each with an error of 1e-11 at most.
            assert!((end[0] - (-1.5 * rate).exp()).abs() < 1e-9, "{end:?}");
        }
    }
    let unset = || integrate(&mut Dopri5::new(Decay, 1e-11), &[1.0], &[], 1.5);
    assert!(std::panic::catch_unwind(unset).is_err());
    let wrong = || Dopri5::new(Decay, 1e-11).set_parameters(&[1.0, 2.0]);
    assert!(std::panic::catch_unwind(wrong).is_err());
}

#[test]
fn same_calls_same_bits() {
    let run = || {
        let mut integrator = Dopri5::new(FourTanks::antonelo(), 1e-10);
        let mut x = vec![9.0, 8.0, 2.0, 3.0];
        for k in 0..20 {
            integrator.integrate(&mut x, &[f64::from(k % 5), 2.0], 10.0).unwrap();
        }
        (x, integrator.rhs_calls())
    };
    assert_eq!(run(), run());
}

/// A plant that counts how often it is asked.
#[derive(Clone, Debug)]
struct Counted<P> {
    plant: P,
    calls: Arc<AtomicU64>,
}

impl<P: Plant> Plant for Counted<P> {
    fn states(&self) -> &[Variable] {
        self.plant.states()
    }
    fn inputs(&self) -> &[Variable] {
        self.plant.inputs()
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        self.calls.fetch_add(1, Ordering::Relaxed);
        self.plant.rhs(x, u, &[], dx);
    }
}

#[test]
fn rhs_calls_are_counted() {
    let calls = Arc::new(AtomicU64::new(0));
    let plant = Counted { plant: VanDerPol::default(), calls: Arc::clone(&calls) };
    let mut integrator = Dopri5::new(plant, 1e-10);
    assert_eq!(integrator.rhs_calls(), 0);
    let mut x = vec![1.0, 0.0];
    for k in 1..=20 {
        integrator.integrate(&mut x, &[0.5], 0.5).unwrap();
        let counted = integrator.rhs_calls();
        assert_eq!(counted, calls.load(Ordering::Relaxed));
        // One to start a call and six per step tried.
        assert_eq!((counted - k) % 6, 0);
    }
}

/// Without any error a step is five times the one before: 1/16, 5/16 and the rest; the next call of
/// the same duration needs a single step.
#[test]
fn step_size_is_remembered_between_calls() {
    let mut integrator = Dopri5::new(Equation::Clock, 1e-9);
    integrate(&mut integrator, &[0.0], &[], 2.0).unwrap();
    assert_eq!(integrator.rhs_calls(), 1 + 3 * 6);
    integrate(&mut integrator, &[0.0], &[], 2.0).unwrap();
    assert_eq!(integrator.rhs_calls(), 1 + 3 * 6 + 7);
}
