//! Values and derivatives against digits computed elsewhere: see data/expected.py.

use pinc_ad::{Dual, Scalar, Tape, Var, gradient};

/// 34 digits each, by mpmath.
const TABLE: &str = include_str!("data/expected.csv");

/// The longest of the functions takes some 30 operations for a second derivative, each rounded by
/// at most half an ulp; intermediate numbers are about as large as the result or 1.
const TOLERANCE: f64 = 16.0 * f64::EPSILON;

/// The functions of data/expected.py, in the same order of variables.
fn function<S: Scalar>(name: &str, v: &[S]) -> S {
    let (x, y, z) = (v[0], v[1], v[2]);
    match name {
        "sqrt" => x.sqrt(),
        "tanh" => x.tanh(),
        "exp" => (x * 0.25).exp(),
        "log" => x.ln(),
        "sin" => x.sin(),
        "cos" => x.cos(),
        "tan" => (x / 16.0).tan(),
        "atan" => x.atan(),
        "power" => (x * 0.25).powf(1.75),
        "whole power" => (x * 0.125).powi(5) + (x + 1.0).powi(-3),
        "reciprocal" => x.constant(1.0) / x,
        "quotient" => x.tanh() * x.sqrt() / (x * x + 1.0),
        "chain" => ((x * x * x + 0.75).sqrt() - 2.0).tanh(),
        "torricelli" => (-((x * 1962.0).sqrt() * 0.125) + 3.0) / 28.0,
        "oscillator" => (-(x * x) + 1.0) * y - x + z,
        "mixed" => (x * y).tanh() / (z + 2.0) + (x * x + y * y + 1.0).sqrt() * z,
        "neuron" => z * x.mul_add(y.tanh(), z * 0.5).tanh() - y / (x * x + 1.0),
        "arrhenius" => x * (-y / (z * z + 1.0)).exp() - x.sin() * y.cos(),
        "swing" => (x.sin() + x.cos() * (z * y).atan()) / (-x.cos().powi(2) + 2.0),
        _ => panic!("{name} is not written here"),
    }
}

struct Row<'a> {
    name: &'a str,
    at: [f64; 3],
    /// "f", or the variables differentiated by: "x", "xy", ..
    quantity: &'a str,
    expected: f64,
}

fn rows() -> Vec<Row<'static>> {
    let parse = |line: &'static str| {
        let fields: Vec<_> = line.split(',').collect();
        let number = |i: usize| fields[i].parse::<f64>().expect("a number");
        Row {
            name: fields[0],
            at: [number(1), number(2), number(3)],
            quantity: fields[4],
            expected: number(5),
        }
    };
    TABLE.lines().skip(1).map(parse).collect()
}

impl Row<'_> {
    /// The indices of the variables differentiated by.
    fn by(&self) -> Vec<usize> {
        self.quantity.chars().filter_map(|c| "xyz".find(c)).collect()
    }

    fn check(&self, method: &str, value: f64) {
        let Row { name, at, quantity, expected } = self;
        assert!(
            (value - expected).abs() <= TOLERANCE * expected.abs().max(1.0),
            "{method}: {name} {quantity} at {at:?} is {value:e}, expected {expected:e}"
        );
    }
}

#[test]
fn the_table_is_whole() {
    // 14 functions at 6 points with 3 quantities, 5 at 3 points with 10.
    assert_eq!(rows().len(), 14 * 6 * 3 + 5 * 3 * 10);
}

#[test]
fn values() {
    for row in rows().iter().filter(|r| r.by().is_empty()) {
        row.check("f64", function(row.name, &row.at));
    }
}

#[test]
fn first_derivatives() {
    for row in rows().iter().filter(|r| r.by().len() == 1) {
        let direction = row.by()[0];
        let seeded: [_; 3] = std::array::from_fn(|i| Dual::<f64, 3>::variable(row.at[i], i));
        row.check("dual", function(row.name, &seeded).eps[direction]);
        let (_, slopes) = gradient(|v| function(row.name, v), &row.at);
        row.check("tape", slopes[direction]);
    }
}

#[test]
fn second_derivatives() {
    for row in rows().iter().filter(|r| r.by().len() == 2) {
        let (first, second) = (row.by()[0], row.by()[1]);
        let seeded: [_; 3] = std::array::from_fn(|i| {
            let inner = Dual::<f64, 3>::variable(row.at[i], i);
            Dual::<_, 3>::variable(inner, i)
        });
        row.check("dual of dual", function(row.name, &seeded).eps[first].eps[second]);

        let tape = Tape::new();
        let inputs = row.at.map(|v| tape.variable(v));
        let seeded: [_; 3] = std::array::from_fn(|i| Dual::<Var, 3>::variable(inputs[i], i));
        let slope = function(row.name, &seeded).eps[first];
        row.check("dual of tape", tape.gradient(slope, &inputs)[second]);
    }
}
