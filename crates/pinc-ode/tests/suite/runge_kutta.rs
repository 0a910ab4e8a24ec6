//! The Runge-Kutta methods: order, sensitivities, determinism.

use crate::common::{Oscillator, distance, flows, linearize, order, predict};
use pinc_ad::{Dual, Scalar, central_difference};
use pinc_ode::{
    Dopri5, Integrator, Linearization, LinearizationBuffer, Model, Plant, Rk4, Rk5, Stages,
    Variable,
};
use pinc_plants::{AcetoneColumn, AcetoneStill, FourTanks, OneTank, VanDerPol};
use proptest::prelude::*;
use proptest::test_runner::{FileFailurePersistence, TestRunner};

#[test]
fn order_4_on_a_linear_system() {
    let plant = Oscillator { damping: 0.2 };
    let (x, u, t) = ([1.0, -0.5], 0.7, 3.0);
    let slope =
        order(|n| Box::new(Rk4::new(plant.clone(), t, n)), &x, &[u], &plant.exact(&x, u, t));
    assert!((slope - 4.0).abs() < 0.15, "{slope}");
}

#[test]
fn order_4_on_van_der_pol() {
    let plant = VanDerPol::default();
    // Of the flows on file 2 s is the one whose range of errors these substeps cover.
    let flow = flows("van-der-pol").into_iter().find(|f| (f.duration_s - 2.0).abs() < 0.1);
    let flow = flow.expect("a flow over 2 s");
    let method = |n| Box::new(Rk4::new(plant, flow.duration_s, n));
    let slope = order(method, &flow.x, &flow.u, &flow.end);
    assert!((slope - 4.0).abs() < 0.15, "{slope}");
}

#[test]
fn order_4_on_the_tanks() {
    for flow in flows("johansson-nonminimum") {
        let plant = FourTanks::johansson_nonminimum();
        let method = |n| Box::new(Rk4::new(plant, flow.duration_s, n));
        let slope = order(method, &flow.x, &flow.u, &flow.end);
        assert!((slope - 4.0).abs() < 0.15, "{slope}");
    }
}

#[test]
fn order_5_of_dormand_and_prince() {
    let plant = Oscillator { damping: 0.2 };
    let (x, u, t) = ([1.0, -0.5], 0.7, 8.0);
    let slope =
        order(|n| Box::new(Rk5::new(plant.clone(), t, n)), &x, &[u], &plant.exact(&x, u, t));
    assert!((slope - 5.0).abs() < 0.15, "{slope}");
}

/// On x' = A x the method is the Taylor polynomial of exp(h A) to h^4; so are its Jacobians.
#[test]
fn one_step_on_a_linear_system_by_hand() {
    // Without damping A = [0 1; -1 0], and h = 1/2 gives cos and sin to the fourth power.
    let mut method = Rk4::new(Oscillator { damping: 0.0 }, 0.5, 1);
    let (c, s) = (1.0 - 0.125 + 0.0625 / 24.0, 0.5 - 0.125 / 6.0);
    let [next, a, b] = linearize(&mut method, &[1.0, 0.0], &[0.0]);
    // A handful of roundings of numbers below 1.
    assert!(distance(&next, &[c, -s]) < 1e-15, "{next:?}");
    assert!(distance(&a, &[c, s, -s, c]) < 1e-15, "{a:?}");
    // The input shifts the rest position to u: df/du = (I - df/dx) (1, 0).
    assert!(distance(&b, &[1.0 - c, s]) < 1e-15, "{b:?}");
}

#[test]
fn jacobians_of_a_linear_system_converge() {
    let plant = Oscillator { damping: 0.3 };
    let [_, a, b] = linearize(&mut Rk4::new(plant.clone(), 2.0, 500), &[3.0, 1.0], &[0.5]);
    let exact = plant.transition(2.0);
    let gain = 1.0 / (1.0 + 0.09);
    // T h^4 |lambda|^5 / 120 = 2 * 2.6e-10 * 1.2 / 120 = 5e-12
    assert!(distance(&a, &exact) < 1e-11, "{a:?}");
    let expected = [(1.0 - exact[0]) * gain, -exact[2] * gain];
    assert!(distance(&b, &expected) < 1e-11, "{b:?}");
}

/// The plant with its variational equation in one direction: states (x, p), inputs (u, q),
/// p' = df/dx p + df/du q, by a dual number through the plant.
#[derive(Clone, Debug)]
struct Variational<P> {
    plant: P,
    states: Vec<Variable>,
    inputs: Vec<Variable>,
}

impl<P: Plant> Variational<P> {
    fn new(plant: P) -> Self {
        let states = [plant.states(), plant.states()].concat();
        let inputs = [plant.inputs(), plant.inputs()].concat();
        Self { plant, states, inputs }
    }
}

impl<P: Plant> Plant for Variational<P> {
    fn states(&self) -> &[Variable] {
        &self.states
    }
    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let dual = |v: &[S]| -> Vec<Dual<S>> {
            let (re, eps) = v.split_at(v.len() / 2);
            re.iter().zip(eps).map(|(&re, &eps)| Dual { re, eps: [eps] }).collect()
        };
        let (x, u) = (dual(x), dual(u));
        let mut slopes = x.clone();
        self.plant.rhs(&x, &u, &[], &mut slopes);
        for (i, slope) in slopes.iter().enumerate() {
            dx[i] = slope.re;
            dx[slopes.len() + i] = slope.eps[0];
        }
    }
}

/// Every column of the Jacobians is the solution of the variational equation: by the same method to
/// rounding, since differentiating and stepping commute; by a fine integration to the method's
/// error.
fn check_variational<P: Plant>(plant: &P, sample_time_s: f64, x: &[f64], u: &[f64], error: f64) {
    let (n, m) = (x.len(), u.len());
    let [_, a, b] = linearize(&mut Rk4::new(plant.clone(), sample_time_s, 40), x, u);
    let variational = Variational::new(plant.clone());
    for column in 0..n + m {
        let unit: Vec<_> = (0..n + m).map(|j| if j == column { 1.0 } else { 0.0 }).collect();
        let (start, held) = ([x, &unit[..n]].concat(), [u, &unit[n..]].concat());
        let jacobian: Vec<_> = (0..n)
            .map(|i| if column < n { a[i * n + column] } else { b[i * m + column - n] })
            .collect();
        let method = pinc_expr::into_dyn(variational.clone());
        let mut method = method.model(Integrator::Rk4, sample_time_s, 40).unwrap();
        let same = predict(&mut *method, &start, &held);
        // 160 stages of a few roundings each, of sensitivities below 20.
        assert!(distance(&same[n..], &jacobian) < 1e-12, "column {column}");
        let mut fine = start;
        let mut integrator = Dopri5::new(variational.clone(), 1e-12);
        integrator.integrate(&mut fine, &held, sample_time_s).unwrap();
        let gap = distance(&fine[n..], &jacobian);
        assert!(gap < error, "column {column}: {gap}");
    }
}

/// With 40 substeps RK4 on Van der Pol over 0.5 s has errors of about 1e-8 (2e-5 with 8 substeps,
/// times (8/40)^4); tanks are far smoother.
#[test]
fn jacobians_solve_the_variational_equation() {
    check_variational(&VanDerPol::default(), 0.5, &[-2.0, 2.5], &[0.4], 1e-6);
    check_variational(&OneTank::default(), 10.0, &[3.0], &[2.0], 1e-9);
    check_variational(&FourTanks::antonelo(), 10.0, &[9.0, 8.0, 2.0, 3.0], &[3.0, 2.0], 1e-9);
}

/// `x_i' = u - x_i^2 / (i + 1) + x_(i+1) / 2` in a ring of ten: more than two groups of directions.
#[derive(Clone, Debug)]
struct Ring(Vec<Variable>);

impl Plant for Ring {
    fn states(&self) -> &[Variable] {
        &self.0
    }
    fn inputs(&self) -> &[Variable] {
        &self.0[..1]
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let mut divisor = 1.0;
        for i in 0..x.len() {
            dx[i] = u[0] - x[i] * x[i] / divisor + x[(i + 1) % x.len()] * 0.5;
            divisor += 1.0;
        }
    }
}

/// Central differences of a step are good to 1e-10 of its value (20 at most) plus h^2/6 = 6e-12
/// times third derivatives of the flow, which these horizons keep below some 50.
fn check_differences<P: Plant>(plant: P, sample_time_s: f64, x: [f64; 2], u: [f64; 2]) {
    let erased = pinc_expr::into_dyn(plant.clone());
    for (integrator, substeps) in [(Integrator::Rk4, 3), (Integrator::Rk5, 2)] {
        let mut method = erased.model(integrator, sample_time_s, substeps).unwrap();
        check_differences_of(&mut *method, x, u);
    }
    if Rk4::suits(&plant) {
        check_differences_of(&mut Rk4::new(plant.clone(), sample_time_s, 3), x, u);
        check_differences_of(&mut Rk5::new(plant, sample_time_s, 2), x, u);
    }
}

fn check_differences_of(method: &mut dyn Model, x: [f64; 2], u: [f64; 2]) {
    let dims = method.dims();
    let points =
        (prop::collection::vec(x[0]..x[1], dims.nx), prop::collection::vec(u[0]..u[1], dims.nu));
    let config = ProptestConfig {
        failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("regressions"))),
        ..ProptestConfig::with_cases(64)
    };
    let strategy = points.prop_map(|(x, u)| (x, u));
    let cell = std::cell::RefCell::new(method);
    let outcome = TestRunner::new(config).run(&strategy, |(x, u)| {
        let mut method = cell.borrow_mut();
        let (n, m) = (x.len(), u.len());
        let [next, a, b] = linearize(*method, &x, &u);
        let value = predict(*method, &x, &u);
        prop_assert!(distance(&next, &value) < 1e-13, "{:?} {:?}", next, value);
        let at = [&x[..], &u[..]].concat();
        for i in 0..n {
            for j in 0..n + m {
                let f = |v: &[f64]| predict(*method, &v[..n], &v[n..])[i];
                let difference = central_difference(f, &at, j);
                let exact = if j < n { a[i * n + j] } else { b[i * m + j - n] };
                prop_assert!((exact - difference).abs() < 1e-8, "{} {}", exact, difference);
            }
        }
        Ok(())
    });
    if let Err(failure) = outcome {
        panic!("{failure}");
    }
}

#[test]
fn jacobians_against_differences() {
    check_differences(VanDerPol::default(), 0.3, [-2.0, 2.0], [-1.0, 1.0]);
    check_differences(OneTank::default(), 10.0, [2.0, 20.0], [0.5, 4.45]);
    check_differences(FourTanks::antonelo(), 10.0, [2.0, 20.0], [0.5, 4.5]);
    let ring = (0..10).map(|_| Variable::new("x", "")).collect();
    check_differences(Ring(ring), 0.2, [0.0, 2.0], [-1.0, 1.0]);
    // Fewer states than a register has lanes, and more.
    for states in 3..=8 {
        let ring = (0..states).map(|_| Variable::new("x", "")).collect();
        check_differences(Ring(ring), 0.2, [0.0, 2.0], [-1.0, 1.0]);
    }
}

#[test]
fn value_of_linearize_matches_predict() {
    let mut method = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let (x, u) = ([2.0, 20.0, 0.3, 6.0], [0.0, 5.0]);
    let [next, _, _] = linearize(&mut method, &x, &u);
    // Four substeps of some 40 roundings of levels up to 20 cm, and more than enough.
    assert!(distance(&next, &predict(&mut method, &x, &u)) < 1e-13);
}

#[test]
fn substeps_are_steps_in_a_row() {
    let plant = VanDerPol::default();
    let mut whole = Rk4::new(plant, 0.5, 4);
    let mut quarter = Rk4::new(plant, 0.125, 1);
    assert_eq!((whole.substeps(), whole.sample_time_s().to_bits()), (4, 0.5f64.to_bits()));
    let mut x = vec![1.0, -0.5];
    let end = predict(&mut whole, &x, &[0.3]);
    for _ in 0..4 {
        x = predict(&mut quarter, &x, &[0.3]);
    }
    assert_eq!(x, end);
}

/// The same bits whatever the model was asked before.
#[test]
fn no_memory_of_earlier_calls() {
    let (x, u) = ([9.0, 8.0, 2.0, 3.0], [3.0, 2.0]);
    let mut used = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let first = (predict(&mut used, &x, &u), linearize(&mut used, &x, &u));
    predict(&mut used, &[f64::NAN; 4], &[f64::NAN; 2]);
    linearize(&mut used, &[f64::NAN; 4], &[f64::NAN; 2]);
    assert_eq!((predict(&mut used, &x, &u), linearize(&mut used, &x, &u)), first);
    let mut fresh = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    assert_eq!((predict(&mut fresh, &x, &u), linearize(&mut fresh, &x, &u)), first);
}

#[test]
fn what_is_no_method_is_a_programming_error() {
    let large = || Rk4::new(Ring((0..7).map(|_| Variable::new("x", "")).collect()), 0.1, 1);
    assert!(std::panic::catch_unwind(large).is_err());
    for (sample_time_s, substeps) in
        [(0.0, 1), (-1.0, 1), (f64::NAN, 1), (f64::INFINITY, 1), (1.0, 0)]
    {
        let build = || Rk4::new(VanDerPol::default(), sample_time_s, substeps);
        assert!(std::panic::catch_unwind(build).is_err(), "{sample_time_s} {substeps}");
    }
}

/// The method on the graph of a plant with a long equation, however many points there are: wide vectors, narrow ones and parts
/// of both give the step that dual numbers give, each point by itself.
fn check_long<P: Plant>(plant: P, x: &[f64], u: &[f64]) {
    let (nx, nu) = (x.len(), u.len());
    let erased = pinc_expr::into_dyn(plant.clone());
    let mut model = erased.model(Integrator::Rk4, 10.0, 2).unwrap();
    let moved = |values: &[f64], k: usize| -> Vec<f64> {
        let by = 1.0 + 0.01 * f64::from(u8::try_from(k).expect("few points"));
        values.iter().map(|v| v * by).collect()
    };
    for count in [1, 3, 4, 5, 8, 9, 13, 20] {
        let all_x: Vec<f64> = (0..count).flat_map(|k| moved(x, k)).collect();
        let all_u: Vec<f64> = (0..count).flat_map(|k| moved(u, k)).collect();
        let mut to = LinearizationBuffer::new(model.dims(), count);
        model.linearize(Stages { x: &all_x, u: &all_u, p: &[] }, to.as_mut());
        for k in 0..count {
            let at = [moved(x, k), moved(u, k)].concat();
            let variables: Vec<_> =
                at.iter().enumerate().map(|(j, &v)| Dual::variable(v, j)).collect();
            let mut expected = vec![Dual::lift(0.0); nx];
            by_hand(&plant, &variables, nx, &mut expected);
            let Linearization { next, a, b, .. } = to.as_mut();
            for (i, expected) in expected.iter().enumerate() {
                let row = k * nx + i;
                assert!((next[row] - expected.re).abs() < 1e-12, "{count}, {k}, {i}");
                let found = a[row * nx..][..nx].iter().chain(&b[row * nu..][..nu]);
                for (found, expected) in found.zip(expected.eps) {
                    assert!((found - expected).abs() < 1e-11, "{count}, {k}, {i}: {found}");
                }
            }
            let mut alone = vec![0.0; nx];
            model.step(&at[..nx], &at[nx..], &[], &mut alone);
            for (alone, expected) in alone.iter().zip(&expected) {
                assert!((alone - expected.re).abs() < 1e-12, "{k}: {alone}, {}", expected.re);
            }
        }
    }
}

/// Two substeps of 5 s of RK4, as they are written in textbooks.
fn by_hand<P: Plant>(plant: &P, at: &[Dual<f64, 8>], nx: usize, next: &mut [Dual<f64, 8>]) {
    let (x, u) = at.split_at(nx);
    next.copy_from_slice(x);
    for _ in 0..2 {
        let begin = next.to_vec();
        let mut stage = begin.clone();
        for [weight, length] in [[1.0, 0.5], [2.0, 0.5], [2.0, 1.0], [1.0, 0.0]] {
            let mut k = stage.clone();
            plant.rhs(&stage, u, &[], &mut k);
            for i in 0..nx {
                stage[i] = begin[i] + k[i] * (5.0 * length);
                next[i] = next[i] + k[i] * (5.0 * weight / 6.0);
            }
        }
    }
}

#[test]
fn plants_with_long_equations() {
    check_long(AcetoneStill::default(), &[0.15, 0.25], &[4.0, 100.0]);
    check_long(AcetoneColumn::default(), &[0.1, 0.7, 0.4, 0.3, 0.6, 0.1], &[3.0, 120.0]);
}
