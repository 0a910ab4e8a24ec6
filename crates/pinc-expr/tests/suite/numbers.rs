//! Plants written as text: the same numbers as those written in Rust, for every kind of number.

use super::common::{Expr, INPUTS, config, expressions, points};
use pinc_ad::simd::{Isa, Simd, Task};
use pinc_ad::{Dual, Tape, central_difference};
use pinc_expr::{Equations, ExpressionPlant};
use pinc_ode::{Dopri5, Plant, Variable};
use pinc_plants::{FourTanks, VanDerPol};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// What two ways of writing the same equation may differ by, relative to 1 + |value|: a few
/// roundings in each of some ten operations.
const ROUNDING: f64 = 1e-14;

pub(crate) fn variables(names: &[&'static str]) -> Vec<Variable> {
    names.iter().map(|name| Variable::new(name, "")).collect()
}

pub(crate) fn texts(pairs: &[(&str, &str)]) -> BTreeMap<String, String> {
    pairs.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
}

pub(crate) fn numbers(pairs: &[(&str, f64)]) -> BTreeMap<String, f64> {
    pairs.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

fn van_der_pol() -> ExpressionPlant {
    let equations = Equations {
        states: variables(&["x1", "x2"]),
        inputs: variables(&["u"]),
        parameters: numbers(&[("mu", 1.3)]),
        intermediates: texts(&[]),
        derivatives: texts(&[("x1", "x2"), ("x2", "mu*(1 - x1^2)*x2 - x1 + u")]),
        ..Equations::default()
    };
    equations.compile().expect("valid equations")
}

fn four_tanks() -> ExpressionPlant {
    let equations = Equations {
        states: variables(&["h1", "h2", "h3", "h4"]),
        inputs: variables(&["u1", "u2"]),
        parameters: numbers(&[
            ("A13", 28.0),
            ("A24", 32.0),
            ("a13", 0.071),
            ("a24", 0.057),
            ("g", 981.0),
            ("gamma1", 0.70),
            ("gamma2", 0.60),
            ("k1", 3.33),
            ("k2", 3.35),
        ]),
        // Torricelli's law; an empty tank has no outflow.
        intermediates: texts(&[
            ("w1", "a13*sqrt(2*g*max(h1, 0))"),
            ("w2", "a24*sqrt(2*g*max(h2, 0))"),
            ("w3", "a13*sqrt(2*g*max(h3, 0))"),
            ("w4", "a24*sqrt(2*g*max(h4, 0))"),
        ]),
        derivatives: texts(&[
            ("h1", "(gamma1*k1*u1 + w3 - w1)/A13"),
            ("h2", "(gamma2*k2*u2 + w4 - w2)/A24"),
            ("h3", "((1 - gamma2)*k2*u2 - w3)/A13"),
            ("h4", "((1 - gamma1)*k1*u1 - w4)/A24"),
        ]),
        ..Equations::default()
    };
    equations.compile().expect("valid equations")
}

/// The right-hand side with its derivatives by all states and inputs, flat.
fn with_jacobian<const N: usize>(plant: &impl Plant, xu: &[f64]) -> Vec<f64> {
    let seeded: Vec<_> =
        xu.iter().enumerate().map(|(i, &v)| Dual::<f64, N>::variable(v, i)).collect();
    let (x, u) = seeded.split_at(plant.dims().nx);
    let mut dx = x.to_vec();
    plant.rhs(x, u, &[], &mut dx);
    dx.iter().flat_map(|d| std::iter::once(d.re).chain(d.eps)).collect()
}

fn assert_close(found: &[f64], expected: &[f64], at: &[f64]) {
    for (a, b) in found.iter().zip(expected) {
        assert!(
            (a - b).abs() <= ROUNDING * (1.0 + b.abs()),
            "{found:?}, not {expected:?} at {at:?}"
        );
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn van_der_pol_is_the_built_in_one(xu in prop::array::uniform3(-4.0..4.0)) {
        let expected = with_jacobian::<3>(&VanDerPol { mu: 1.3 }, &xu);
        assert_close(&with_jacobian::<3>(&van_der_pol(), &xu), &expected, &xu);
    }

    #[test]
    fn four_tanks_are_the_built_in_ones(
        h in prop::array::uniform4(-2.0..20.0),
        u in prop::array::uniform2(0.0..5.0),
    ) {
        let xu = [h.as_slice(), &u].concat();
        let expected = with_jacobian::<6>(&FourTanks::johansson_minimum(), &xu);
        assert_close(&with_jacobian::<6>(&four_tanks(), &xu), &expected, &xu);
    }
}

/// Levels at and below 0 give no NaN and the built-in plant's zeros.
#[test]
fn an_empty_tank_has_no_outflow_and_no_derivative() {
    for h in [0.0, -0.0, -1e-12, -3.0] {
        let xu = [h, h, h, h, 1.0, 2.0];
        let expected = with_jacobian::<6>(&FourTanks::johansson_minimum(), &xu);
        assert!(expected.iter().all(|v| v.is_finite()));
        assert_close(&with_jacobian::<6>(&four_tanks(), &xu), &expected, &xu);
    }
}

#[test]
fn trajectories_match_the_built_in_plant() {
    let (mut x, mut y) = ([1.0, -0.5], [1.0, -0.5]);
    Dopri5::new(van_der_pol(), 1e-12).integrate(&mut x, &[0.3], 10.0).expect("a limit cycle");
    Dopri5::new(VanDerPol { mu: 1.3 }, 1e-12).integrate(&mut y, &[0.3], 10.0).expect("the same");
    // Differences of one rounding are not amplified on a limit cycle; the tolerance is the
    // integrator's.
    assert!((x[0] - y[0]).abs() < 1e-11 && (x[1] - y[1]).abs() < 1e-11, "{x:?} {y:?}");
}

/// As many lanes as the narrowest vectors have.
const LANES: usize = 2;

/// The tanks in vectors with derivatives, as in the training kernel.
struct InLanes<'a>(&'a ExpressionPlant);

impl Task for InLanes<'_> {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> Vec<f64> {
        let lift = |i: usize| {
            Dual::<V, 4>::variable(zero.generate(|lane| 3.0 + i as f64 - lane as f64), i)
        };
        let (x, u): (Vec<_>, Vec<_>) = ((0..4).map(lift).collect(), (4..6).map(lift).collect());
        let mut dx = x.clone();
        self.0.rhs(&x, &u, &[], &mut dx);
        let mut out = Vec::new();
        for part in dx.iter().flat_map(|d| std::iter::once(d.re).chain(d.eps)) {
            let mut lanes = vec![0.0; V::LANES];
            part.write(&mut lanes);
            out.extend(&lanes[..LANES]);
        }
        out
    }
}

#[test]
fn every_instruction_set_gives_the_same_numbers() {
    let plant = four_tanks();
    let mut expected = vec![0.0; 4 * 5 * LANES];
    for lane in 0..LANES {
        let xu: Vec<_> = (0..6).map(|i| 3.0 + f64::from(i) - lane as f64).collect();
        // The derivatives of a row by the first four of six variables.
        for (row, values) in with_jacobian::<6>(&plant, &xu).chunks(7).enumerate() {
            for (i, &value) in values[..5].iter().enumerate() {
                expected[(row * 5 + i) * LANES + lane] = value;
            }
        }
    }
    for isa in Isa::available() {
        assert_close(&isa.dispatch(InLanes(&plant)), &expected, &[]);
    }
}

#[test]
fn a_tape_records_an_expression() {
    let tape = Tape::new();
    let (x, u) = ([tape.variable(0.5), tape.variable(2.0)], [tape.variable(0.1)]);
    let mut dx = x;
    van_der_pol().rhs(&x, &u, &[], &mut dx);
    // d(mu (1 - x1^2) x2 - x1 + u) = (-2 mu x1 x2 - 1, mu (1 - x1^2), 1)
    let gradient = tape.gradient(dx[1], &[x[0], x[1], u[0]]);
    assert_close(&gradient, &[-2.0 * 1.3 * 0.5 * 2.0 - 1.0, 1.3 * 0.75, 1.0], &[]);
}

/// An expression of the family that `pinc-ad` is tested with, as text. What an operator makes
/// stands in parentheses: `^` binds to the right, so that an operand that ends in a power would be
/// another one.
pub(crate) fn text(e: &Expr) -> String {
    match e {
        Expr::Input(i) => ["x", "y", "u"][*i].to_owned(),
        Expr::Constant(c) => format!("({c:?})"),
        Expr::Add(a, b) => format!("({} + {})", text(a), text(b)),
        Expr::Sub(a, b) => format!("({} - {})", text(a), text(b)),
        Expr::Mul(a, b) => format!("({}*{})", text(a), text(b)),
        Expr::Div(a, b, sign) => format!("({}/(({}^2 + 0.5)*{sign:?}))", text(a), text(b)),
        Expr::Neg(a) => format!("(-{})", text(a)),
        Expr::AddNumber(a, c) => format!("({} + {c:?})", text(a)),
        Expr::SubNumber(a, c) => format!("({} - {c:?})", text(a)),
        Expr::MulNumber(a, c) => format!("({}*{c:e})", text(a)),
        Expr::DivNumber(a, c) => format!("({}/{c:?})", text(a)),
        Expr::Sqrt(a) => format!("sqrt({}^2 + 0.5)", text(a)),
        Expr::Tanh(a) => format!("tanh({})", text(a)),
        Expr::Exp(a) => format!("exp({})", text(a)),
        Expr::Ln(a) => format!("log({}^2 + 0.5)", text(a)),
        Expr::Sin(a) => format!("sin({})", text(a)),
        Expr::Cos(a) => format!("cos({})", text(a)),
        Expr::Tan(a) => format!("tan(sin({}))", text(a)),
        Expr::Atan(a) => format!("atan({})", text(a)),
        Expr::Powf(a) => format!("(({}^2 + 0.5)^1.3)", text(a)),
        Expr::Powi(a, n) => format!("({}^{n})", text(a)),
        Expr::Abs(a) => format!("abs({})", text(a)),
        Expr::Min(a, b) => format!("min({}, {})", text(a), text(b)),
        Expr::Max(a, b) => format!("max({}, {})", text(a), text(b)),
        Expr::MulAdd(a, b, c) => format!("({}*{} + {})", text(a), text(b), text(c)),
        // There is no choice in the language; a sign of +-1 makes one.
        Expr::WhereNonpositive(test, yes, no) => {
            let (test, yes, no) = (text(test), text(yes), text(no));
            format!("((1 - sign({test}))*{yes}/2 + (1 + sign({test}))*{no}/2)")
        }
    }
}

/// x' = e, y' = the same once more, by way of an intermediate name.
pub(crate) fn plant_of(e: &Expr) -> ExpressionPlant {
    let equations = Equations {
        states: variables(&["x", "y"]),
        inputs: variables(&["u"]),
        parameters: numbers(&[]),
        intermediates: texts(&[("e", &text(e))]),
        derivatives: texts(&[("x", &text(e)), ("y", "e")]),
        ..Equations::default()
    };
    equations.compile().unwrap_or_else(|error| panic!("{error}"))
}

/// `df/dx_j` and a bound of its error, by central differences with a step and four times it.
fn difference(mut f: impl FnMut(&[f64]) -> f64, x: &[f64], j: usize) -> (f64, f64) {
    let fine = central_difference(&mut f, x, j);
    let mut scaled = x.to_vec();
    scaled[j] /= 4.0;
    let stretched = |z: &[f64]| {
        let mut x = z.to_vec();
        x[j] *= 4.0;
        f(&x)
    };
    let coarse = central_difference(stretched, &scaled, j) / 4.0;
    // Twice the difference bounds the truncation of both; 1e-8 stands for rounding.
    (fine, 2.0 * (fine - coarse).abs() + 1e-8)
}

proptest! {
    #![proptest_config(config())]

    /// Values and derivatives of random expressions: text against Rust, and against differences.
    /// The bounds are as in the tests of `pinc-ad`: rounding amplified by at most 8 at each of four
    /// levels.
    #[test]
    fn random_expressions((e, x) in (expressions(), points())) {
        prop_assume!(e.is_tame(&x));
        let found = with_jacobian::<INPUTS>(&plant_of(&e), &x);
        let seeded: [_; INPUTS] = std::array::from_fn(|i| Dual::<f64, INPUTS>::variable(x[i], i));
        let expected = e.eval(&seeded);
        let expected: Vec<_> = std::iter::once(expected.re).chain(expected.eps).collect();
        for row in found.chunks(1 + INPUTS) {
            for (a, b) in row.iter().zip(&expected) {
                prop_assert!((a - b).abs() <= 5e-11 * (1.0 + b.abs()), "{} {:?}", text(&e), x);
            }
        }
        for j in 0..INPUTS {
            let (slope, bound) = difference(|x| e.eval(x), &x, j);
            prop_assert!(bound > 1e-5 || (found[1 + j] - slope).abs() <= bound, "{}", text(&e));
        }
    }
}
