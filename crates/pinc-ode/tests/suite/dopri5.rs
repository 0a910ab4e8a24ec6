//! The adaptive integrator: order, and accuracy where the solution is known.

use crate::common::{Oscillator, distance, flows, log_slope};
use pinc_ad::Scalar;
use pinc_ode::{Dopri5, Plant, Variable};
use pinc_plants::{FourTanks, OneTank, VanDerPol};

fn integrate(integrator: &mut Dopri5, x: &[f64], u: &[f64], duration: f64) -> Vec<f64> {
    let mut x = x.to_vec();
    integrator.integrate(&mut x, u, duration).unwrap();
    x
}

/// With a tolerance that accepts everything and a step known from a warm-up call, each call is one
/// step of its duration (7 evaluations: one to start, six for the step), so that the order of the
/// formula shows undisturbed. Errors between 1e-12 and 1e-5 only: see the test of RK4.
#[test]
fn the_formula_has_order_5() {
    let plant = Oscillator { damping: 0.2 };
    let (start, u, duration) = ([1.0, -0.5], 0.7, 3.0);
    let exact = plant.exact(&start, u, duration);
    let mut errors = Vec::new();
    for k in 1..11 {
        let steps: u32 = 1 << k;
        let h = duration / f64::from(steps);
        let mut integrator = Dopri5::new(plant.clone(), 1e9);
        integrate(&mut integrator, &start, &[u], h);
        let warm_up = integrator.rhs_calls();
        let mut x = start.to_vec();
        for _ in 0..steps {
            integrator.integrate(&mut x, &[u], h).unwrap();
        }
        assert_eq!(integrator.rhs_calls() - warm_up, 7 * u64::from(steps));
        errors.push((h, distance(&x, &exact)));
    }
    errors.retain(|(_, error)| (1e-12..1e-5).contains(error));
    let slope = log_slope(&errors);
    assert!((slope - 5.0).abs() < 0.15, "{slope}: {errors:?}");
}

/// The step goes like tolerance^(1/5) (the estimate is of order h^5) and the global error like h^5,
/// so error ~ tolerance and error ~ calls^-5. The tolerance spans 7 decades, the number of calls a
/// factor of 10^(7/5) = 25. Steps in place of the ideal ones may change a single error by a factor
/// of 2 or so, which changes the slope over ln 25 = 3.2 by at most 2 ln 2 / 3.2 = 0.43 if both ends
/// conspire.
#[test]
fn error_follows_tolerance_and_work() {
    let plant = Oscillator { damping: 0.0 };
    let (start, duration) = ([1.0, 0.0], 40.0);
    let exact = plant.exact(&start, 0.0, duration);
    let runs: Vec<_> = (4..12)
        .map(|digits| {
            let tolerance = 10f64.powi(-digits);
            let mut integrator = Dopri5::new(plant.clone(), tolerance);
            let x = integrate(&mut integrator, &start, &[0.0], duration);
            let calls = f64::from(u32::try_from(integrator.rhs_calls()).unwrap());
            (tolerance, calls, distance(&x, &exact))
        })
        .collect();
    let by_work: Vec<_> = runs.iter().map(|&(_, calls, error)| (calls, error)).collect();
    let by_tolerance: Vec<_> =
        runs.iter().map(|&(tolerance, _, error)| (tolerance, error)).collect();
    let slopes = (log_slope(&by_work), log_slope(&by_tolerance));
    assert!((slopes.0 + 5.0).abs() < 0.43, "{slopes:?}: {runs:?}");
    // The same spread over ln 10^7 = 16: 0.09.
    assert!((slopes.1 - 1.0).abs() < 0.09, "{slopes:?}: {runs:?}");
}

/// On x' = i x the solution of order 5 and the embedded one differ by (1/120 - 1097/120000) (ih)^5
/// in leading order, which is 97/120000 h^5 times the other component of the state. In units of the
/// tolerance that component counts as |s| / (1 + |c|) or |c| / (1 + |s|), the larger of which goes
/// between 0.414 and 1 on the circle; steps aim at 0.9^5 of the tolerance. So the step is known to
/// within a fifth, and the work, six calls a step, if hardly any step is rejected.
#[test]
fn work_is_what_the_formula_asks_for() {
    let (tolerance, duration) = (1e-10, 40.0);
    let mut integrator = Dopri5::new(Oscillator { damping: 0.0 }, tolerance);
    integrate(&mut integrator, &[1.0, 0.0], &[0.0], duration);
    let calls = |part: f64| {
        let step = (0.9f64.powi(5) * tolerance * 120_000.0 / (97.0 * part)).powf(0.2);
        6.0 * duration / step
    };
    let made = f64::from(u32::try_from(integrator.rhs_calls()).unwrap());
    assert!(made > calls(0.414) && made < calls(1.0), "{made}");
}

/// x' = x (1 - x)
#[derive(Clone, Debug)]
struct Logistic;

impl Plant for Logistic {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }
    fn inputs(&self) -> &[Variable] {
        &[]
    }
    fn rhs<S: Scalar>(&self, x: &[S], _: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = x[0] * (-x[0] + 1.0);
    }
}

/// The tolerance of the accuracy tests.
const FINE: f64 = 1e-12;

/// What the errors of single steps may add up to. A step's estimate, of order h^5, is at most
/// `FINE * (1 + |x|)`; its true error, of order h^6, is smaller by about `h * rate`, with the rate
/// in 1/s at which the equation moves. Over all steps that is `FINE * (1 + |x|) * rate * duration`,
/// times the `growth` of an error on its way to the end; and once more for the first step, whose
/// size is a guess.
fn bound(size: f64, rate: f64, duration: f64, growth: f64) -> f64 {
    FINE * (1.0 + size) * (1.0 + rate * duration) * growth
}

#[test]
fn harmonic_oscillator() {
    let plant = Oscillator { damping: 0.0 };
    let mut integrator = Dopri5::new(plant.clone(), FINE);
    let x = integrate(&mut integrator, &[1.0, 0.5], &[0.3], 20.0);
    // Errors turn in circles and do not grow.
    let bound = bound(1.3, 1.0, 20.0, 1.0);
    let error = distance(&x, &plant.exact(&[1.0, 0.5], 0.3, 20.0));
    assert!(error < bound, "{error} {bound}");
}

#[test]
fn logistic_growth() {
    let exact = |t: f64| 1.0 / (1.0 + 99.0 * (-t).exp());
    let mut integrator = Dopri5::new(Logistic, FINE);
    let mut x = vec![0.01];
    for k in 1..=12 {
        integrator.integrate(&mut x, &[], 1.0).unwrap();
        // dx(t)/dx0 is at most that at x = 1/2: x (1 - x) / (x0 (1 - x0)) = 25.3.
        let bound = bound(1.0, 1.0, f64::from(k), 25.3);
        let error = (x[0] - exact(f64::from(k))).abs();
        assert!(error < bound, "{k}: {error} {bound}");
    }
}

/// h(t) = (sqrt h0 - a sqrt(2g) t / 2A)^2 until the tank is empty at 2 A sqrt h0 / (a sqrt 2g) =
/// 61.7 s, and 0 from then on. Errors shrink on the way: dh(t)/dh0 = sqrt(h/h0). The rate is that
/// at a few cm; next to empty it is larger, and the steps shorter.
#[test]
fn one_tank_drains_as_torricelli_says() {
    let plant = OneTank::default();
    let rate = plant.outlet * (2.0f64 * 981.0).sqrt() / (2.0 * plant.area);
    let mut integrator = Dopri5::new(plant, FINE);
    let mut h = vec![12.0];
    for k in 1..=12 {
        integrator.integrate(&mut h, &[0.0], 10.0).unwrap();
        let exact = (12f64.sqrt() - rate * 10.0 * f64::from(k)).max(0.0).powi(2);
        let bound = bound(12.0, 0.1, 10.0 * f64::from(k), 1.0);
        let error = (h[0] - exact).abs();
        assert!(error < bound, "{k}: {error} {bound}");
    }
    assert!(h[0].abs() < 1e-11, "{h:?}");
}

/// From empty, where the slope of the outflow is infinite, to the level at which pump and hole
/// balance: (k u / a)^2 / 2g. What is missing after 4000 s is below exp(-4000 / 60 s).
#[test]
fn empty_tank_fills_up() {
    let plant = OneTank::default();
    for h0 in [0.0, -0.5] {
        let mut integrator = Dopri5::new(plant, FINE);
        let h = integrate(&mut integrator, &[h0], &[2.0], 4000.0);
        let balance = (plant.pump * 2.0 / plant.outlet).powi(2) / (2.0 * 981.0);
        // The last few steps count only, the equation forgets the others.
        assert!((h[0] - balance).abs() < 1e-10, "{h:?} {balance}");
    }
    // Without a pump an empty tank stays as it is.
    let still = integrate(&mut Dopri5::new(plant, FINE), &[-0.5], &[0.0], 100.0);
    assert_eq!(still, [-0.5]);
}

/// Against digits by mpmath. Van der Pol draws neighbouring solutions together over most of a
/// period; on the way an error may grow as much as the trace of its Jacobian allows, mu (1 - x1^2)
/// <= 1 per second, over the two seconds or so that |x1| < 1 lasts: a factor of e^2, taken as 10.
#[test]
fn plants_against_digits() {
    check_flows("van-der-pol", &VanDerPol::default(), 3.0, 2.0, 10.0);
    check_flows("one-tank", &OneTank::default(), 6.0, 0.1, 1.0);
    check_flows("antonelo", &FourTanks::antonelo(), 10.0, 0.1, 1.0);
    let johansson = FourTanks::johansson_nonminimum();
    check_flows("johansson-nonminimum", &johansson, 14.0, 0.1, 1.0);
}

fn check_flows<P: Plant>(name: &str, plant: &P, size: f64, rate: f64, growth: f64) {
    for flow in flows(name) {
        let mut integrator = Dopri5::new(plant.clone(), FINE);
        let x = integrate(&mut integrator, &flow.x, &flow.u, flow.duration_s);
        let bound = bound(size, rate, flow.duration_s, growth);
        let error = distance(&x, &flow.end);
        assert!(error < bound, "{name}: {error} {bound}");
    }
}
