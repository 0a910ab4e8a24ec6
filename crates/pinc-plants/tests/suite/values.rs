//! The paper's plants: values and Jacobians against digits computed elsewhere and against
//! differences, on every kind of number, and with empty tanks.

use pinc_ad::{Dual, Lanes, Scalar, Tape, Var, central_difference, jacobian};
use pinc_ode::Plant;
use pinc_plants::{AcetoneColumn, AcetoneStill, FourTanks, OneTank, VanDerPol};
use proptest::prelude::*;
use proptest::test_runner::{FileFailurePersistence, TestCaseError, TestRunner};

/// Right-hand sides and Jacobians, by mpmath: see data/expected.py.
const TABLE: &str = include_str!("../data/rhs.csv");

fn rhs(plant: &impl Plant, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut dx = vec![0.0; x.len()];
    plant.rhs(x, u, &[], &mut dx);
    dx
}

/// Row by row, columns x then u.
fn rhs_jacobian(plant: &impl Plant, x: &[f64], u: &[f64]) -> Vec<f64> {
    let n = x.len();
    jacobian(|v, dx| plant.rhs(&v[..n], &v[n..], &[], dx), &[x, u].concat(), n)
}

fn numbers(field: &str) -> Vec<f64> {
    let parse = |v: &str| v.parse().expect("a number");
    field.split(' ').map(parse).collect()
}

/// An equation has at most 6 operations on flows up to 20 cm^3/s, divided by an area of at least
/// 28 cm^2; for Van der Pol the numbers go up to 27. A few ulps of 32 are 2.8e-14.
fn assert_close(what: &str, values: &[f64], expected: &[f64]) {
    assert_eq!(values.len(), expected.len(), "{what}");
    for (value, expected) in values.iter().zip(expected) {
        assert!((value - expected).abs() < 2.8e-14, "{what}: {value}, expected {expected}");
    }
}

fn check_table(name: &str, plant: &impl Plant, rows: usize) {
    let mut seen = 0;
    for line in TABLE.lines() {
        let fields: Vec<_> = line.split(',').collect();
        if fields[0] == name {
            let (x, u) = (numbers(fields[1]), numbers(fields[2]));
            assert_close(name, &rhs(plant, &x, &u), &numbers(fields[3]));
            assert_close(name, &rhs_jacobian(plant, &x, &u), &numbers(fields[4]));
            seen += 1;
        }
    }
    assert_eq!(seen, rows, "{name}");
}

#[test]
fn expected_digits() {
    check_table("acetone-column", &AcetoneColumn::default(), 2);
    check_table("acetone-still", &AcetoneStill::default(), 3);
    check_table("van-der-pol", &VanDerPol::default(), 3);
    check_table("one-tank", &OneTank::default(), 2);
    check_table("antonelo", &FourTanks::antonelo(), 2);
    check_table("johansson-nonminimum", &FourTanks::johansson_nonminimum(), 2);
    check_table("johansson-minimum", &FourTanks::johansson_minimum(), 2);
}

/// x = (1, 2), u = 1/2, mu = 3: x2' = 3 (1 - 1) 2 - 1 + 1/2; at x = (0, 2): 3 * 2 + 1/2.
#[test]
fn van_der_pol_by_hand() {
    let plant = VanDerPol { mu: 3.0 };
    assert_close("at 1", &rhs(&plant, &[1.0, 2.0], &[0.5]), &[2.0, -0.5]);
    assert_close("at 0", &rhs(&plant, &[0.0, 2.0], &[0.5]), &[2.0, 6.5]);
}

/// 2 g h is a square at h = 2 * 981 / 4 cm: there sqrt(2 g h) = 981 cm/s.
#[test]
fn one_tank_by_hand() {
    let plant = OneTank { area: 4.0, outlet: 2.0, pump: 10.0 };
    assert_close("tank", &rhs(&plant, &[490.5], &[200.0]), &[(2000.0 - 1962.0) / 4.0]);
}

fn names(variables: &[pinc_ode::Variable]) -> Vec<(&str, &str)> {
    variables.iter().map(|v| (&*v.name, &*v.unit)).collect()
}

#[test]
fn order_of_states_is_the_papers() {
    let tanks = FourTanks::antonelo();
    assert_eq!(names(tanks.states()), [("h1", "cm"), ("h2", "cm"), ("h3", "cm"), ("h4", "cm")]);
    assert_eq!(names(tanks.inputs()), [("u1", "V"), ("u2", "V")]);
    assert_eq!(names(OneTank::default().states()), [("h", "cm")]);
    assert_eq!(names(OneTank::default().inputs()), [("u", "V")]);
    assert_eq!(names(VanDerPol::default().states()), [("x1", ""), ("x2", "")]);
    assert_eq!(names(VanDerPol::default().inputs()), [("u", "")]);
    assert_eq!((tanks.dims().nx, tanks.dims().nu), (4, 2));
}

/// Who feeds whom: pump 1 tanks 1 and 4, pump 2 tanks 2 and 3; tank 3 drains into 1, tank 4 into 2.
#[test]
fn pipes_of_the_four_tanks() {
    let j = rhs_jacobian(&FourTanks::antonelo(), &[5.0; 4], &[3.0; 2]);
    let signs: Vec<_> = j.iter().map(|v| if v.abs() > 0.0 { v.signum() } else { 0.0 }).collect();
    #[rustfmt::skip]
    let expected = [
        // h1    h2    h3    h4   u1   u2
        -1.0,  0.0,  1.0,  0.0, 1.0, 0.0,
         0.0, -1.0,  0.0,  1.0, 0.0, 1.0,
         0.0,  0.0, -1.0,  0.0, 0.0, 1.0,
         0.0,  0.0,  0.0, -1.0, 1.0, 0.0,
    ];
    assert_close("signs", &signs, &expected);
}

/// For h <= 0 a tank has no outflow and the outflow no slope; the pump goes on.
#[test]
fn empty_tank_has_no_outflow() {
    let plant = OneTank::default();
    for h in [0.0, -0.0, -1e-300, -3.0] {
        assert_close("value", &rhs(&plant, &[h], &[2.0]), &[314.0 / 1400.0]);
        assert_close("slope", &rhs_jacobian(&plant, &[h], &[2.0]), &[0.0, 314.0 / 2800.0]);
    }
    // Just above 0 the law of Torricelli holds: a sqrt(2 g h) / A with h = 1e-20.
    let expected = -0.071 * (1962.0f64 * 1e-20).sqrt() / 28.0;
    let dx = rhs(&plant, &[1e-20], &[0.0])[0];
    assert!((dx / expected - 1.0).abs() < 1e-14, "{dx}");
}

#[test]
fn empty_tanks_among_full_ones() {
    let plant = FourTanks::antonelo();
    let dx = rhs(&plant, &[4.0, -1.0, 0.0, 9.0], &[0.0, 0.0]);
    let w = |a: f64, h: f64| a * (1962.0 * h).sqrt();
    let expected = [-w(0.071, 4.0) / 28.0, w(0.057, 9.0) / 32.0, 0.0, -w(0.057, 9.0) / 32.0];
    assert_close("value", &dx, &expected);
    let j = rhs_jacobian(&plant, &[4.0, -1.0, 0.0, 9.0], &[0.0, 0.0]);
    assert!(j.iter().all(|v| v.is_finite()), "{j:?}");
    let column = |c: usize| [j[c], j[6 + c], j[12 + c], j[18 + c]];
    assert_close("column of h2", &column(1), &[0.0; 4]);
    assert_close("column of h3", &column(2), &[0.0; 4]);
}

/// On a tape too: the root of the side that is not taken must not reach the gradient.
#[test]
fn empty_tank_on_a_tape() {
    let plant = OneTank::default();
    for h in [0.0, -2.0] {
        let tape = Tape::new();
        let inputs = [tape.variable(h), tape.variable(1.0)];
        let mut dx = [inputs[0]];
        plant.rhs(&inputs[..1], &inputs[1..], &[], &mut dx);
        assert_close("gradient", &tape.gradient(dx[0], &inputs), &[0.0, 314.0 / 2800.0]);
    }
}

#[test]
fn nan_in_nan_out() {
    for i in 0..4 {
        let mut h = [5.0; 4];
        h[i] = f64::NAN;
        assert!(rhs(&FourTanks::antonelo(), &h, &[1.0; 2])[i].is_nan(), "h{}", i + 1);
    }
    for i in 0..2 {
        let mut u = [1.0; 2];
        u[i] = f64::NAN;
        assert!(rhs(&FourTanks::antonelo(), &[5.0; 4], &u)[i].is_nan(), "u{}", i + 1);
    }
    assert!(rhs(&OneTank::default(), &[f64::NAN], &[1.0])[0].is_nan());
    assert!(rhs(&VanDerPol::default(), &[f64::NAN, 0.0], &[0.0])[1].is_nan());
    assert!(rhs(&VanDerPol::default(), &[0.0, 0.0], &[f64::NAN])[1].is_nan());
}

fn config() -> ProptestConfig {
    ProptestConfig {
        failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("regressions"))),
        ..ProptestConfig::default()
    }
}

/// Runs `check` on random (x, u) between `low` and `high`.
fn on_points(
    plant: &impl Plant,
    [low, high]: [f64; 2],
    check: impl Fn(&[f64], &[f64]) -> Result<(), TestCaseError>,
) {
    let dims = plant.dims();
    let x = prop::collection::vec(low..high, dims.nx);
    let u = prop::collection::vec(-1.0..5.0, dims.nu);
    if let Err(failure) = TestRunner::new(config()).run(&(x, u), |(x, u)| check(&x, &u)) {
        panic!("{plant:?}: {failure}");
    }
}

/// Levels of at least 0.1 cm: there h^2 f'''/6 of the differences is below
/// (6e-6)^2 * a sqrt(2 g) (3/8) 0.1^(-5/2) / (6 A) = 7e-11, and rounding below 1e-10 * 27.
fn jacobian_agrees_with_differences(plant: &impl Plant, box_: [f64; 2]) {
    on_points(plant, box_, |x, u| {
        let (n, at) = (x.len(), [x, u].concat());
        let exact = rhs_jacobian(plant, x, u);
        for (k, exact) in exact.iter().enumerate() {
            let (row, column) = (k / at.len(), k % at.len());
            let f = |v: &[f64]| rhs(plant, &v[..n], &v[n..])[row];
            let difference = central_difference(f, &at, column);
            prop_assert!((exact - difference).abs() < 1e-8, "{}: {} {}", k, exact, difference);
        }
        Ok(())
    });
}

#[test]
fn jacobians_against_differences() {
    jacobian_agrees_with_differences(&VanDerPol::default(), [-3.0, 3.0]);
    jacobian_agrees_with_differences(&VanDerPol { mu: 0.1 }, [-3.0, 3.0]);
    jacobian_agrees_with_differences(&OneTank::default(), [0.1, 20.0]);
    jacobian_agrees_with_differences(&FourTanks::antonelo(), [0.1, 20.0]);
    jacobian_agrees_with_differences(&FourTanks::johansson_nonminimum(), [0.1, 20.0]);
    jacobian_agrees_with_differences(&FourTanks::johansson_minimum(), [0.1, 20.0]);
}

/// The value of the right-hand side on numbers made by `make`, read by `read`.
fn value_on<S: Scalar>(
    plant: &impl Plant,
    x: &[f64],
    u: &[f64],
    make: impl Fn(f64) -> S,
    read: impl Fn(S) -> f64,
) -> Vec<u64> {
    let lift = |v: &[f64]| -> Vec<S> { v.iter().map(|&v| make(v)).collect() };
    let (x, u) = (lift(x), lift(u));
    let mut dx = x.clone();
    plant.rhs(&x, &u, &[], &mut dx);
    dx.into_iter().map(|v| read(v).to_bits()).collect()
}

/// The equations have no `mul_add`, so that every kind of number rounds alike.
fn kinds_agree(plant: &impl Plant) {
    on_points(plant, [-2.0, 12.0], |x, u| {
        let expected = value_on(plant, x, u, |v| v, |v| v);
        let tape = Tape::new();
        let lanes = value_on(plant, x, u, Lanes::<8>::splat, |v| v.0[7]);
        prop_assert_eq!(&lanes, &expected);
        let dual = value_on(plant, x, u, |v| Dual::<f64, 4>::variable(v, 1), |v| v.re);
        prop_assert_eq!(&dual, &expected);
        let var = value_on(plant, x, u, |v| tape.variable(v), Var::value);
        prop_assert_eq!(&var, &expected);
        let nested = |v| Dual::<Var>::variable(tape.variable(v), 0);
        prop_assert_eq!(value_on(plant, x, u, nested, |v| v.re.value()), expected);
        Ok(())
    });
}

#[test]
fn every_kind_of_number_gives_the_same_bits() {
    kinds_agree(&VanDerPol::default());
    kinds_agree(&OneTank::default());
    kinds_agree(&FourTanks::antonelo());
}
