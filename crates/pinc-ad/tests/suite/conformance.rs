//! One suite for every kind of number: the same function has the same value on all of them.

use super::common::{Expr, INPUTS, config, expressions, points};
use pinc_ad::{Dual, Lanes, Scalar, Tape, Var};
use proptest::prelude::*;
use proptest::test_runner::{TestCaseError, TestRunner};

/// Pairs to operate on: small, large, negative, zeros of both signs, not finite.
const PAIRS: [(f64, f64); 10] = [
    (0.7, -1.3),
    (-2.5, 0.125),
    (1e-8, 1e8),
    (3.0, 3.0),
    (0.0, 2.0),
    (-0.0, -4.0),
    (19.5, 0.3),
    (f64::INFINITY, 2.0),
    (f64::NEG_INFINITY, -1.0),
    (f64::NAN, 1.0),
];

/// A kind of number under test.
struct Kind<'k, S> {
    /// How many points it holds.
    lanes: usize,
    /// Makes one from the values of its lanes.
    make: &'k dyn Fn(&[f64]) -> S,
    /// The values of its lanes.
    read: &'k dyn Fn(S) -> Vec<f64>,
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn sign(a: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a.signum() }
}

/// For numbers that are both finite or infinite; NaN if one of them is NaN.
fn or_nan(a: f64, b: f64, taken: f64) -> f64 {
    if (a + b).is_nan() { f64::NAN } else { taken }
}

impl<S: Scalar> Kind<'_, S> {
    fn number(&self, lane: &dyn Fn(usize) -> f64) -> S {
        (self.make)(&(0..self.lanes).map(lane).collect::<Vec<_>>())
    }

    /// Lane by lane, `on_kind` must have the value of `on_f64`, bit for bit.
    fn agree(&self, what: &str, on_kind: fn(S, S) -> S, on_f64: fn(f64, f64) -> f64) {
        for first in 0..PAIRS.len() {
            let pair = |lane: usize| PAIRS[(first + lane) % PAIRS.len()];
            let result = on_kind(self.number(&|i| pair(i).0), self.number(&|i| pair(i).1));
            let values = (self.read)(result);
            assert_eq!(values.len(), self.lanes, "{what}: lanes");
            for (lane, value) in values.into_iter().enumerate() {
                let (a, b) = pair(lane);
                let expected = on_f64(a, b);
                assert!(same(value, expected), "{what}({a}, {b}) = {value}, not {expected}");
            }
        }
    }

    fn operations(&self) {
        self.agree("identity", |a, _| a, |a, _| a);
        self.agree("a + b", |a, b| a + b, |a, b| a + b);
        self.agree("a - b", |a, b| a - b, |a, b| a - b);
        self.agree("a * b", |a, b| a * b, |a, b| a * b);
        self.agree("a / b", |a, b| a / b, |a, b| a / b);
        self.agree("-a", |a, _| -a, |a, _| -a);
        self.agree("a + number", |a, _| a + 0.3, |a, _| a + 0.3);
        self.agree("a - number", |a, _| a - 0.3, |a, _| a - 0.3);
        self.agree("a * number", |a, _| a * 0.3, |a, _| a * 0.3);
        self.agree("a / number", |a, _| a / 0.3, |a, _| a / 0.3);
        self.agree("sqrt", |a, _| a.sqrt(), |a, _| a.sqrt());
        self.agree("tanh", |a, _| a.tanh(), |a, _| a.tanh());
        self.functions();
        self.agree("constant", |a, _| a.constant(0.3), |_, _| 0.3);
        // An exact product, so that fusing or not makes no difference.
        self.agree("mul_add", |a, b| a.constant(3.0).mul_add(b.constant(0.25), b), |_, b| 0.75 + b);
        self.agree(
            "where_nonpositive",
            |a, b| a.where_nonpositive(b, b * 2.0),
            |a, b| if a <= 0.0 { b } else { b * 2.0 },
        );
    }

    fn functions(&self) {
        self.agree("exp", |a, _| a.exp(), |a, _| a.exp());
        self.agree("ln", |a, _| a.ln(), |a, _| a.ln());
        self.agree("sin", |a, _| a.sin(), |a, _| a.sin());
        self.agree("cos", |a, _| a.cos(), |a, _| a.cos());
        self.agree("tan", |a, _| a.tan(), |a, _| a.tan());
        self.agree("atan", |a, _| a.atan(), |a, _| a.atan());
        self.agree("powf", |a, _| a.powf(1.7), |a, _| a.powf(1.7));
        self.agree("powf below 0", |a, _| a.powf(-0.3), |a, _| a.powf(-0.3));
        self.agree("powi 0", |a, _| a.powi(0), |_, _| 1.0);
        self.agree("powi 3", |a, _| a.powi(3), |a, _| a * (a * a));
        self.agree("powi -4", |a, _| a.powi(-4), |a, _| 1.0 / ((a * a) * (a * a)));
        self.agree("abs", |a, _| a.abs(), |a, _| a.abs());
        self.agree("sign", |a, _| a.sign(), |a, _| sign(a));
        self.agree("min", |a, b| a.min(b), |a, b| or_nan(a, b, a.min(b)));
        self.agree("max", |a, b| a.max(b), |a, b| or_nan(a, b, a.max(b)));
    }

    /// Random expressions. They may differ by the rounding of a product inside `mul_add`: half an
    /// ulp of at most 4, that is 4.4e-16, times at most 8 for each of four levels, times at most 8
    /// such nodes: 1.5e-11.
    fn expressions(&self) {
        let strategy = (expressions(), prop::collection::vec(points(), self.lanes));
        let check = |(f, x): (Expr, Vec<[f64; INPUTS]>)| {
            // A point that will not do is replaced by one that does, so that all lanes are used.
            let tame = x.iter().position(|x| f.is_tame(x));
            prop_assume!(tame.is_some());
            let x: Vec<_> =
                x.iter().map(|p| if f.is_tame(p) { p } else { &x[tame.unwrap_or(0)] }).collect();
            let inputs: Vec<S> = (0..INPUTS).map(|j| self.number(&|lane| x[lane][j])).collect();
            for (value, x) in (self.read)(f.eval(&inputs)).into_iter().zip(x) {
                let expected: f64 = f.eval(x);
                prop_assert!((value - expected).abs() <= 1.5e-11, "{} {}", value, expected);
            }
            Ok::<(), TestCaseError>(())
        };
        if let Err(failure) = TestRunner::new(config()).run(&strategy, check) {
            panic!("{failure}");
        }
    }

    fn conforms(&self) {
        self.operations();
        self.expressions();
    }
}

#[test]
fn plain_number() {
    Kind { lanes: 1, make: &|x| x[0], read: &|s| vec![s] }.conforms();
}

fn lanes_conform<const L: usize>() {
    Kind {
        lanes: L,
        make: &|x| Lanes::<L>(std::array::from_fn(|i| x[i])),
        read: &|s| s.0.to_vec(),
    }
    .conforms();
}

#[test]
fn lanes_of_4_and_of_8() {
    lanes_conform::<4>();
    lanes_conform::<8>();
}

fn duals_conform<const N: usize>() {
    Kind { lanes: 1, make: &|x| Dual::<f64, N>::variable(x[0], N / 2), read: &|s| vec![s.re] }
        .conforms();
}

#[test]
fn duals_with_1_3_and_8_directions() {
    duals_conform::<1>();
    duals_conform::<3>();
    duals_conform::<8>();
}

#[test]
fn dual_of_lanes() {
    Kind {
        lanes: 8,
        make: &|x| Dual::<Lanes<8>, 2>::variable(Lanes(std::array::from_fn(|i| x[i])), 1),
        read: &|s| s.re.0.to_vec(),
    }
    .conforms();
}

#[test]
fn dual_of_dual() {
    Kind {
        lanes: 1,
        make: &|x| Dual::<Dual<f64>>::variable(Dual::variable(x[0], 0), 0),
        read: &|s| vec![s.re.re],
    }
    .conforms();
}

#[test]
fn variable_of_a_tape() {
    let tape = Tape::new();
    Kind { lanes: 1, make: &|x| tape.variable(x[0]), read: &|s| vec![s.value()] }.conforms();
}

#[test]
fn dual_of_variables_of_a_tape() {
    let tape = Tape::new();
    Kind {
        lanes: 1,
        make: &|x| Dual::<Var>::variable(tape.variable(x[0]), 0),
        read: &|s| vec![s.re.value()],
    }
    .conforms();
}
