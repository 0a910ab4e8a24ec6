//! The integrators of text plants, which use sparse Jacobians, against textbook ones on dual
//! numbers.

use super::common::{INPUTS, config, expressions, points};
use super::numbers::{numbers, plant_of, texts, variables};
use super::on_dual_numbers;
use pinc_expr::{Equations, ExpressionPlant};
use pinc_ode::{Dims, Gradients, Integrator, LinearizationBuffer, Model, Plant, Stages};
use proptest::prelude::*;

/// What the two may differ by, relative to 1 + |value|.
const ROUNDING: f64 = 1e-13;

fn linearize(model: &mut dyn Model, points: &[f64]) -> LinearizationBuffer {
    let dims @ Dims { nx, nu, np, .. } = model.dims();
    let width = nx + nu + np;
    let part = |from: usize, to: usize| -> Vec<f64> {
        points.chunks_exact(width).flat_map(|point| point[from..to].to_vec()).collect()
    };
    let (x, u, p) = (part(0, nx), part(nx, nx + nu), part(nx + nu, width));
    let mut out = LinearizationBuffer::new(dims, points.len() / width);
    for values in [&mut out.next, &mut out.a, &mut out.b, &mut out.e] {
        values.fill(1e300);
    }
    model.linearize(Stages { x: &x, u: &u, p: &p }, out.as_mut());
    out
}

/// The largest difference of two linearizations, relative to 1 + |value|. What is not a number in
/// the one must not be in the other.
fn difference(found: &LinearizationBuffer, expected: &LinearizationBuffer) -> f64 {
    let parts = |out: &LinearizationBuffer| [&out.next[..], &out.a, &out.b, &out.e].concat();
    let pairs = parts(found).into_iter().zip(parts(expected));
    let errors = pairs.map(|(a, b)| match (a.is_finite(), b.is_finite()) {
        (true, true) => (a - b).abs() / (1.0 + b.abs()),
        (false, false) => 0.0,
        _ => f64::INFINITY,
    });
    errors.fold(0.0, f64::max)
}

/// The difference of each method from that on dual numbers.
fn differences(plant: &ExpressionPlant, h: f64, points: &[f64]) -> [f64; 3] {
    let erased = plant.clone().into_dyn();
    let methods = [(Integrator::Rk4, 2), (Integrator::Rk5, 1), (Integrator::Rosenbrock, 2)];
    methods.map(|(integrator, substeps)| {
        let mut found = erased.model(integrator, h, substeps).unwrap();
        let expected = on_dual_numbers::linearize(plant, (integrator, h, substeps), points);
        difference(&linearize(&mut *found, points), &expected)
    })
}

proptest! {
    #![proptest_config(config())]

    /// Jacobians of random expressions: rounding, amplified by at most 8 at each of four levels.
    #[test]
    fn jacobians_of_random_expressions((e, x) in (expressions(), points())) {
        prop_assume!(e.is_tame(&x));
        let plant = plant_of(&e);
        let found = plant.clone().into_dyn().jacobian(&x[..2], &x[2..], &[]);
        let expected = pinc_ode::DynRhs::jacobian(&plant, &x[..2], &x[2..], &[]);
        prop_assert_eq!(found.len(), 2 * INPUTS);
        for (a, b) in found.iter().zip(&expected) {
            prop_assert!((a - b).abs() <= 20.0 * ROUNDING * (1.0 + b.abs()), "{} {}", a, b);
        }
    }

    /// A short step: what an expression amplifies rounding by is multiplied by its length.
    #[test]
    fn steps_of_random_expressions((e, x) in (expressions(), points())) {
        prop_assume!(e.is_tame(&x));
        let points: Vec<f64> = (0..7).flat_map(|_| x).collect();
        for difference in differences(&plant_of(&e), 1e-2, &points) {
            prop_assert!(difference <= ROUNDING, "{:e}", difference);
        }
    }

    /// Plants of all sizes with random coupling, at all numbers of points.
    #[test]
    fn random_coupling(
        (n, couplings) in (1..15_usize).prop_flat_map(|n| {
            (Just(n), prop::collection::vec((0..n, 0..n + 2, -1.0..1.0), 0..3 * n))
        }),
        count in 1..18_usize,
        seed in 0.0..1.0_f64,
    ) {
        let plant = coupled(n, &couplings);
        let at = |i: usize| (seed + i as f64 * 0.37).sin();
        let points: Vec<f64> = (0..count * (n + 3)).map(at).collect();
        for difference in differences(&plant, 0.3, &points) {
            prop_assert!(difference <= ROUNDING, "{:e}", difference);
        }
    }
}

/// A step of the Rosenbrock method on dual numbers.
fn rosenbrock(plant: &ExpressionPlant, h: f64, points: &[f64]) -> LinearizationBuffer {
    on_dual_numbers::linearize(plant, (Integrator::Rosenbrock, h, 1), points)
}

/// `x_i' = k x_i (1 - x_i) + sum c tanh(x_j)`, where j may be one of two inputs.
fn coupled(n: usize, couplings: &[(usize, usize, f64)]) -> ExpressionPlant {
    let name = |j: usize| if j < n { format!("x{j}") } else { format!("u{}", j - n) };
    let equation = |i: usize| {
        let terms = couplings.iter().filter(|(to, ..)| *to == i);
        let terms = terms.map(|(_, j, c)| format!(" + ({c:?})*tanh({})", name(*j)));
        (name(i), format!("k*x{i}*(1 - x{i}){}", terms.collect::<String>()))
    };
    let variable = |j: usize| pinc_ode::Variable { name: name(j).into(), unit: "".into() };
    let equations = Equations {
        states: (0..n).map(variable).collect(),
        inputs: (n..n + 2).map(variable).collect(),
        parameters: numbers(&[("k", 0.5)]),
        derivatives: (0..n).map(equation).collect(),
        ..Equations::default()
    };
    equations.compile_with(&["k"]).expect("valid equations")
}

/// On kinks and jumps, where roots end and powers begin, the same derivatives count.
#[test]
fn kinks_and_ends_match_dual_numbers() {
    let expressions = [
        "abs(x)",
        "sign(x)*y",
        "min(x, y)",
        "max(x, y)",
        "max(y, x)",
        "max(x, 0)",
        "max(0, x)",
        "min(x, 0)",
        "min(0, x)",
        "max(0, x) + 3*max(x, 0)",
        "max(x, 0) + 3*max(0, x)",
        "min(0.5, x) + 3*min(x, 0.5)",
        "min(x, 0) + 3*min(0, x)",
        "max(1, x) + 3*max(x, 1)",
        "sqrt(max(x, 0))",
        "sqrt(x^2 + y^2)",
        "sqrt(x)",
        "x^0.5",
        "x^0.7",
        "x^1.5",
        "max(x, 0)^0.7",
        "max(log(x), -5)",
        "min(1/x, 3)",
        "exp(-abs(x - y))",
        "x*y/(x - y)",
        "x^y",
        "max(x, y)*abs(x*y)",
        "tan(x) - atan(y)",
        "x - x",
        "0*x + y",
        "x/y - y/x",
    ];
    let values = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0];
    let points: Vec<f64> =
        values.iter().flat_map(|&x| values.map(|y| [x, y, 0.3])).flatten().collect::<Vec<f64>>();
    for e in expressions {
        let equations = Equations {
            states: variables(&["x", "y"]),
            inputs: variables(&["u"]),
            derivatives: texts(&[("x", e), ("y", "u - y")]),
            ..Equations::default()
        };
        let plant = equations.compile().expect("valid equations");
        let erased = plant.clone().into_dyn();
        for point in points.chunks_exact(3) {
            let (x, u) = point.split_at(2);
            let found = erased.jacobian(x, u, &[]);
            let expected = pinc_ode::DynRhs::jacobian(&plant, x, u, &[]);
            for (a, b) in found.iter().zip(&expected) {
                // A derivative may be a number where dual numbers multiply 0 and infinity.
                let same =
                    (a - b).abs() <= ROUNDING * (1.0 + b.abs()) || a.to_bits() == b.to_bits();
                assert!(same || !b.is_finite(), "{e} at {point:?}: {found:?}, {expected:?}");
            }
            // Second derivatives at the same places.
            let found =
                linearize(&mut *erased.model(Integrator::Rosenbrock, 1e-3, 1).unwrap(), point);
            let expected = rosenbrock(&plant, 1e-3, point);
            let pairs = [(&found.next, &expected.next), (&found.a, &expected.a)];
            for (a, b) in pairs.iter().flat_map(|(found, expected)| found.iter().zip(*expected)) {
                let same = (a - b).abs() <= ROUNDING * (1.0 + b.abs());
                assert!(same || !b.is_finite(), "{e} at {point:?}: {found:?}, {expected:?}");
            }
        }
    }
}

/// The matrix of the Rosenbrock method, 8 I - J here, has no first pivot in some lanes, and less
/// and less of one in others: rows are exchanged, each lane by itself.
#[test]
fn pivots_that_vanish() {
    let equations = Equations {
        states: variables(&["x", "y", "z"]),
        inputs: variables(&["u"]),
        derivatives: texts(&[
            ("x", "(x - 1)*y + 3*z"),
            ("y", "u - 2*x - y*z"),
            ("z", "x*z - 0.3*y + 0.2*x"),
        ]),
        ..Equations::default()
    };
    let plant = equations.compile().expect("valid equations");
    let at = |k: i32| 8.0 - if k % 3 == 0 { 0.0 } else { 10.0_f64.powi(-k) };
    let points: Vec<f64> =
        (0..21).flat_map(|k| [1.0 + 0.01 * f64::from(k), at(k), 0.2, -0.5]).collect();
    let mut model = plant.clone().into_dyn().model(Integrator::Rosenbrock, 0.5, 1).unwrap();
    let found = linearize(&mut *model, &points);
    let expected = rosenbrock(&plant, 0.5, &points);
    let difference = difference(&found, &expected);
    assert!(difference <= 1e-11, "{difference:e}");

    // The gradient of x+ - 2 y+ + z+ by the state.
    let weights = [1.0, -2.0, 1.0];
    let (mut x, mut u): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    for point in points.chunks_exact(4) {
        x.extend(&point[..3]);
        u.push(point[3]);
    }
    let at = Stages { x: &x, u: &u, p: &[] };
    let (mut by_x, mut by_u) = (x.clone(), u.clone());
    let out = Gradients { x: &mut by_x, u: &mut by_u, p: &mut [] };
    assert!(model.pull_back(at, &weights.repeat(u.len()), out));
    for (by_x, a) in by_x.chunks_exact(3).zip(expected.a.chunks_exact(9)) {
        for (i, found) in by_x.iter().enumerate() {
            let terms = (0..3).map(|row| weights[row] * a[row * 3 + i]);
            let [sum, size] = terms.fold([0.0, 1.0], |[s, m], t| [s + t, m + t.abs()]);
            assert!((found - sum).abs() <= 1e-11 * size, "{found:e} {sum:e}");
        }
    }
}

/// A rod of 40 nodes: each block of columns reaches only a part of them.
#[test]
fn a_long_rod_is_that_on_dual_numbers() {
    let couplings: Vec<_> = (0..40_usize)
        .flat_map(|i| [(i, i.saturating_sub(1), 0.8), (i, (i + 1).min(39), 0.7)])
        .chain([(3, 40, 1.0), (39, 41, 0.5)])
        .collect();
    let plant = coupled(40, &couplings);
    for count in [1, 5, 12] {
        let points: Vec<f64> = (0..count * 43).map(|i| (i as f64 * 0.7).cos()).collect();
        for difference in differences(&plant, 0.5, &points) {
            assert!(difference <= ROUNDING, "{difference:e}");
        }
    }
}

/// A root, a sum and a quotient, of one state, two, and an input.
#[test]
fn outputs_have_the_derivatives_of_dual_numbers() {
    let equations = Equations {
        outputs: [("a", "sqrt(x)*k"), ("b", "x + y"), ("c", "u^2/y")]
            .map(|(name, e)| {
                (
                    name.to_owned(),
                    pinc_expr::OutputExpression { expression: e.to_owned(), unit: String::new() },
                )
            })
            .into(),
        states: variables(&["x", "y"]),
        inputs: variables(&["u"]),
        parameters: numbers(&[("k", 1.0)]),
        derivatives: texts(&[("x", "u - x"), ("y", "k*x - y")]),
        ..Equations::default()
    };
    let plant = equations.compile_with(&["k"]).expect("valid equations");
    let (x, u, p) = ([4.0, 0.5], [3.0], [2.0]);
    let mut model = plant.clone().into_dyn().model(Integrator::Rk4, 0.1, 1).unwrap();
    let (mut y, mut c, mut d, mut e) = ([9.0; 3], [9.0; 6], [9.0; 3], [9.0; 3]);
    let out = pinc_ode::OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut e };
    model.linearize_output(Stages { x: &x, u: &u, p: &p }, out);
    let close = |found: &[f64], expected: &[f64]| {
        found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14 * (1.0 + b.abs()))
    };
    assert!(close(&y, &[4.0, 4.5, 18.0]), "{y:?}");
    assert!(close(&c, &[0.5, 0.0, 1.0, 1.0, 0.0, -36.0]), "{c:?}");
    assert!(close(&d, &[0.0, 0.0, 12.0]) && close(&e, &[2.0, 0.0, 0.0]), "{d:?} {e:?}");
    assert_eq!(plant.dims().ny, 3);
}

/// At 0, where the logarithm ends, the values and slopes are those of a number as the exponent.
#[test]
fn powers_with_an_exponent_that_varies() {
    let equations = Equations {
        states: variables(&["x", "y"]),
        inputs: variables(&["u"]),
        derivatives: texts(&[("x", "x^y"), ("y", "u")]),
        ..Equations::default()
    };
    let plant = equations.compile().expect("valid equations").into_dyn();
    let at = |x: f64, y: f64| {
        let mut rates = [0.0; 2];
        plant.rhs(&[x, y], &[0.0], &[], &mut rates);
        let slopes = plant.jacobian(&[x, y], &[0.0], &[]);
        [rates[0], slopes[0], slopes[1]]
    };
    let ln_2 = std::f64::consts::LN_2;
    for (x, y, expected) in [
        (0.0, 2.0, [0.0; 3]),
        (0.0, 0.5, [0.0; 3]),
        (-0.0, 1.5, [0.0; 3]),
        (2.0, 3.0, [8.0, 12.0, 8.0 * ln_2]),
        (2.0, -1.0, [0.5, -0.25, 0.5 * ln_2]),
        (1e-12, 2.0, [1e-24, 2e-12, 1e-24 * 1e-12_f64.ln()]),
    ] {
        for (found, expected) in at(x, y).into_iter().zip(expected) {
            assert!((found - expected).abs() <= 1e-14 * expected.abs(), "{x}^{y}: {found}");
        }
    }
    for (x, y) in [(0.0, -1.0), (-1.0, 2.0), (-1e-9, 0.5)] {
        assert!(!at(x, y)[0].is_finite(), "{x}^{y}");
    }
}
