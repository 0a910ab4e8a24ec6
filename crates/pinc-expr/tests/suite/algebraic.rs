//! Algebraic equations: the same numbers as with the unknowns eliminated by hand.

use super::common::{Expr, INPUTS, config, expressions, points};
use super::numbers::{text, texts, variables};
use pinc_ad::simd::{Isa, Simd, Task};
use pinc_ad::{Dual, Tape, central_difference};
use pinc_expr::{AlgebraicVariable, Equations, ExpressionPlant, Start};
use pinc_ode::{Integrator, LinearizationBuffer, Model, Plant, Stages, VectorDual};
use proptest::prelude::*;

/// The error of some ten roundings in each of two ways to a number, relative to 1 + |value|.
const ROUNDING: f64 = 1e-11;

pub(crate) fn unknown(
    equation: &str,
    start: Option<Start>,
    [low, high]: [f64; 2],
) -> AlgebraicVariable {
    AlgebraicVariable { equation: equation.to_owned(), start, low, high, unit: String::new() }
}

/// Three unknowns: a and b solve two equations at once, c one that has b.
/// With the expressions A and B they are a = A, b = B, c = B + u.
fn implicit(a: &str, b: &str) -> ExpressionPlant {
    let equations = Equations {
        intermediates: texts(&[("A", a), ("B", b)]),
        algebraic: [
            ("a", "a + 0.3*tanh(b) - (A + 0.3*tanh(B))"),
            ("b", "b - 0.4*tanh(a) - (B - 0.4*tanh(A))"),
            ("c", "(c/20)^3 + c - (((b + u)/20)^3 + b + u)"),
        ]
        .map(|(name, equation)| (name.to_owned(), unknown(equation, None, [-3000.0, 3100.0])))
        .into(),
        ..frame()
    };
    equations.compile().unwrap_or_else(|error| panic!("{error}"))
}

fn eliminated(a: &str, b: &str) -> ExpressionPlant {
    let equations =
        Equations { intermediates: texts(&[("a", a), ("b", b), ("c", "b + u")]), ..frame() };
    equations.compile().unwrap_or_else(|error| panic!("{error}"))
}

fn frame() -> Equations {
    Equations {
        states: variables(&["x", "y"]),
        inputs: variables(&["u"]),
        derivatives: texts(&[("x", "sin(a) + x*cos(b)"), ("y", "atan(c) - tanh(a)*y")]),
        ..Equations::default()
    }
}

fn close(found: &[f64], expected: &[f64], factor: f64) -> Result<(), String> {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        if (a - b).is_nan() || (a - b).abs() > factor * ROUNDING * (1.0 + b.abs()) {
            return Err(format!("{found:?}, {expected:?}"));
        }
    }
    Ok(())
}

/// f with its derivatives on the vectors of an instruction set, the lanes around `x`.
struct OnVectors<'a> {
    plant: &'a ExpressionPlant,
    x: &'a [f64],
}

impl Task for OnVectors<'_> {
    type Output = Vec<f64>;

    fn run<V: Simd>(self, zero: V) -> Vec<f64> {
        let variable = |i: usize| {
            VectorDual::variable(zero.generate(|lane| self.x[i] + 0.01 * lane as f64), i)
        };
        let (x, u) = ([variable(0), variable(1)], [variable(2)]);
        let mut dx = [Dual::lift(zero); 2];
        self.plant.rhs(&x, &u, &[], &mut dx);
        let mut all = Vec::new();
        for value in dx.iter().flat_map(|dx| [dx.re, dx.eps[0], dx.eps[1], dx.eps[2]]) {
            let mut lanes = [0.0; 8];
            value.write(&mut lanes);
            all.extend(&lanes[..V::LANES]);
        }
        all
    }
}

fn jacobian(plant: &ExpressionPlant, x: &[f64]) -> Vec<f64> {
    pinc_ode::DynRhs::jacobian(plant, &x[..2], &x[2..], &[])
}

/// Derivatives of the derivatives: the matrix of all second derivatives of f.
fn second(plant: &ExpressionPlant, x: &[f64]) -> Vec<f64> {
    let seeded: Vec<Dual<Dual<f64, 3>, 3>> =
        (0..3).map(|i| Dual::variable(Dual::variable(x[i], i), i)).collect();
    let mut dx = [seeded[0]; 2];
    plant.rhs(&seeded[..2], &seeded[2..], &[], &mut dx);
    dx.iter().flat_map(|dx| dx.eps.iter().flat_map(|e| e.eps)).collect()
}

/// The gradient of the first derivative of f by x on the tape: reverse over forward.
fn taped(plant: &ExpressionPlant, x: &[f64]) -> Vec<f64> {
    let tape = Tape::new();
    let leaves: Vec<_> = x.iter().map(|x| tape.variable(*x)).collect();
    let seeded: Vec<_> =
        leaves.iter().enumerate().map(|(i, x)| Dual::<_, 1>::variable(*x, i)).collect();
    let mut dx = [seeded[0]; 2];
    plant.rhs(&seeded[..2], &seeded[2..], &[], &mut dx);
    let slope = dx[0].eps[0] + dx[1].eps[0];
    let mut all = tape.gradient(slope, &leaves);
    all.push(slope.value());
    all
}

fn linearized(model: &mut dyn Model, points: &[f64]) -> Vec<f64> {
    let part = |from: usize, to: usize| -> Vec<f64> {
        points.chunks_exact(INPUTS).flat_map(|point| point[from..to].to_vec()).collect()
    };
    let (x, u) = (part(0, 2), part(2, 3));
    let mut out = LinearizationBuffer::new(model.dims(), points.len() / INPUTS);
    model.linearize(Stages { x: &x, u: &u, p: &[] }, out.as_mut());
    [&out.next[..], &out.a, &out.b].concat()
}

/// Whether rounding stays small and the expressions are smooth within the boxes.
fn fits(e: &Expr, x: &[f64]) -> bool {
    e.is_tame(x) && e.eval(x).abs() < 1000.0
}

proptest! {
    #![proptest_config(config())]

    /// Values, first and second derivatives of all kinds of number.
    #[test]
    fn all_kinds_of_number((a, b, x) in (expressions(), expressions(), points())) {
        prop_assume!(fits(&a, &x) && fits(&b, &x));
        let (a, b) = (text(&a), text(&b));
        let (found, expected) = (implicit(&a, &b), eliminated(&a, &b));
        let value = |plant: &ExpressionPlant| {
            let mut dx = [0.0; 2];
            Plant::rhs(plant, &x[..2], &x[2..], &[], &mut dx);
            dx
        };
        let check = |a: &[f64], b: &[f64], factor: f64| close(a, b, factor).map_err(TestCaseError::fail);
        check(&value(&found), &value(&expected), 1.0)?;
        check(&jacobian(&found, &x), &jacobian(&expected, &x), 100.0)?;
        check(&second(&found, &x), &second(&expected, &x), 1e4)?;
        check(&taped(&found, &x), &taped(&expected, &x), 1e4)?;
        let grouped = |plant: &ExpressionPlant| plant.clone().into_dyn().jacobian(&x[..2], &x[2..], &[]);
        check(&grouped(&found), &grouped(&expected), 100.0)?;
    }
}

const A: &str = "sin(x) + 0.5*x*y";
const B: &str = "exp(0.3*y) - u*x";

#[test]
fn every_instruction_set() {
    let (found, expected) = (implicit(A, B), eliminated(A, B));
    for isa in Isa::available() {
        let run = |plant| isa.dispatch(OnVectors { plant, x: &[0.3, -0.7, 0.4] });
        close(&run(&found), &run(&expected), 1.0).unwrap();
    }
}

/// The Rosenbrock method needs second derivatives.
#[test]
fn every_integrator() {
    let points: Vec<f64> = (0..33).map(|i| (0.7 * f64::from(i)).sin()).collect();
    let models = |plant: ExpressionPlant| -> [Box<dyn Model>; 3] {
        let erased = plant.into_dyn();
        [
            erased.model(Integrator::Rk4, 0.2, 2).unwrap(),
            erased.model(Integrator::Rk5, 0.2, 1).unwrap(),
            erased.model(Integrator::Rosenbrock, 0.2, 2).unwrap(),
        ]
    };
    let pairs = models(implicit(A, B)).into_iter().zip(models(eliminated(A, B)));
    for (mut found, mut expected) in pairs {
        close(&linearized(&mut *found, &points), &linearized(&mut *expected, &points), 1.0)
            .unwrap();
    }
}

/// A point's numbers do not depend on what is beside it in a vector.
#[test]
fn lanes_are_independent() {
    let points: Vec<f64> = (0..24).map(|i| (0.7 * f64::from(i)).sin()).collect();
    let mut model = implicit(A, B).into_dyn().model(Integrator::Rk4, 0.2, 1).unwrap();
    let all = linearized(&mut *model, &points);
    let mut repeated = points[..3].repeat(8);
    let alone = linearized(&mut *model, &repeated);
    repeated[3..].copy_from_slice(&points[3..]);
    assert_eq!(
        all[..2].iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
        alone[..2].iter().map(|v| v.to_bits()).collect::<Vec<_>>()
    );
}

/// Jacobians against differences, where the root is known by its equation only.
#[test]
fn jacobians_match_differences() {
    let equations = Equations {
        algebraic: [
            ("a".to_owned(), unknown("a*exp(a) - x - 3", None, [0.0, 10.0])),
            (
                "b".to_owned(),
                unknown("b^3 + b*a - y + u", Some(Start::Expression("y - u".into())), [-9.0, 9.0]),
            ),
            ("c".to_owned(), unknown("c - b", None, [-9.0, 9.0])),
        ]
        .into(),
        ..frame()
    };
    let plant = equations.compile().unwrap().into_dyn();
    let x = [0.4, 0.9, -0.3];
    let found = plant.jacobian(&x[..2], &x[2..], &[]);
    for i in 0..2 {
        for j in 0..3 {
            let f = |x: &[f64]| {
                let mut dx = [0.0; 2];
                plant.rhs(&x[..2], &x[2..], &[], &mut dx);
                dx[i]
            };
            let difference = central_difference(f, &x, j);
            assert!(
                (found[i * 3 + j] - difference).abs() < 1e-8,
                "{i} {j}: {found:?} {difference}"
            );
        }
    }
}

/// Unknowns are outputs beside the table's, with units, derivatives and values.
#[test]
fn unknowns_are_outputs() {
    let mut equations: Equations = toml::from_str(
        "states = [{ name = 'h', unit = 'cm' }]\n\
         inputs = [{ name = 'u', unit = 'V' }]\n\
         derivatives = { h = 'u - q' }\n\
         outputs = { power = 'q*h' }\n\
         algebraic.q = { equation = 'q*abs(q) - 4*h', low = 0, high = 1e2, unit = 'cm/s' }\n",
    )
    .unwrap();
    let plant = equations.compile().unwrap().into_dyn();
    let names: Vec<_> =
        plant.outputs().iter().map(|v| (v.name.as_ref(), v.unit.as_ref())).collect();
    assert_eq!(names, [("power", ""), ("q", "cm/s")]);
    let mut y = [0.0; 2];
    plant.output(&[9.0], &[0.0], &[], &mut y);
    assert!(close(&y, &[54.0, 6.0], 1.0).is_ok());
    equations.outputs.clear();
    let plant = equations.compile().unwrap().into_dyn();
    let mut model = plant.model(Integrator::Rk4, 0.1, 1).unwrap();
    let (mut y, mut c, mut d) = ([0.0], [0.0], [9.0]);
    let out = pinc_ode::OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut [] };
    model.linearize_output(Stages { x: &[9.0], u: &[0.0], p: &[] }, out);
    assert!(close(&[y[0], c[0], d[0]], &[6.0, 1.0 / 3.0, 0.0], 1.0).is_ok(), "{y:?} {c:?} {d:?}");
}

fn circle() -> Equations {
    Equations {
        algebraic: [(
            "a".to_owned(),
            unknown("a^2 + x^2 - 1", Some(Start::Number(0.9)), [-2.0, 2.0]),
        )]
        .into(),
        derivatives: texts(&[("x", "a"), ("y", "u")]),
        ..frame()
    }
}

/// NaN where there is no root, with the reason; of two roots that beside the start.
#[test]
fn no_root_and_several() {
    let equations = circle();
    let system = equations.algebraic_equations().unwrap().unwrap();
    let mut dx = [0.0; 2];
    let plant = equations.compile().unwrap();
    plant.rhs(&[0.6, 0.0], &[0.0], &[], &mut dx);
    assert!((dx[0] - 0.8).abs() < 1e-15);
    let other = system.another_root(&[0.6, 0.0, 0.0], &[vec![0.1]]).unwrap();
    assert!(other[0].0 == "a" && (other[0].1 + 0.8).abs() < 1e-12, "{other:?}");
    plant.rhs(&[1.5, 0.0], &[0.0], &[], &mut dx);
    assert!(dx[0].is_nan());
    let message = system.solve(&[1.5, 0.0, 0.0]).unwrap_err().to_string();
    assert!(message.starts_with("algebraic.a: no root found in the box"), "{message}");
    let message = system.solve(&[1.0, 0.0, 0.0]).unwrap_err().to_string();
    assert!(message.starts_with("algebraic.a: "), "{message}");
    let error = plant.explain(&[1.5, 0.0], &[0.0], &[]).unwrap();
    assert!(error.starts_with("algebraic.a: no root found in the box"), "{error}");
    assert_eq!(plant.explain(&[0.6, 0.0], &[0.0], &[]), None);
}

/// Two equations that are one determine nothing, though the search begins at a root of them; and two
/// that contradict each other have none.
#[test]
fn singular_equations_are_called_so() {
    let of = |second: &str| {
        let unknown = |equation: &str| unknown(equation, None, [0.0, 3.0]);
        let algebraic =
            [("a".to_owned(), unknown("a - b")), ("b".to_owned(), unknown(second))].into();
        let equations =
            Equations { algebraic, derivatives: texts(&[("x", "a"), ("y", "u + b")]), ..frame() };
        let system = equations.algebraic_equations().unwrap().unwrap();
        system.solve(&[0.0; 3]).unwrap_err().to_string()
    };
    let singular = of("b - a");
    assert!(singular.contains("the unknowns is singular at "), "{singular}");
    assert!(!singular.contains("no root"), "{singular}");
    let neither = of("b - a + 1");
    let both = "1, 0 should be 0 and the derivative by the unknowns is singular";
    assert!(neither.contains("no root found") && neither.ends_with(both), "{neither}");
}

#[test]
fn lanes_without_a_root_do_not_disturb_others() {
    let plant = circle().compile().unwrap();
    let run = |x: &[f64]| {
        let mut model = plant.clone().into_dyn().model(Integrator::Rk4, 1e-3, 1).unwrap();
        let mut out = LinearizationBuffer::new(model.dims(), x.len() / 2);
        model.linearize(Stages { x, u: &vec![0.0; x.len() / 2], p: &[] }, out.as_mut());
        out.next
    };
    let found = run(&[0.1, 0.0, 1.5, 0.0, 0.3, 0.0]);
    assert!(found[2].is_nan() && found[3] == 0.0);
    for (point, lane) in [(0.1, 0), (0.3, 4)] {
        let alone = run(&[point, 0.0]);
        assert!(alone[0].to_bits() == found[lane].to_bits(), "{found:?} {alone:?}");
    }
}

#[test]
fn a_critical_term_of_unknowns_has_the_same_value_alone() {
    let mut equations = Equations {
        algebraic: [("z".to_owned(), unknown("z + z^3 - x - u", None, [-10.0, 10.0]))].into(),
        derivatives: texts(&[("x", "sqrt(z + 0.5)/(2 + x)"), ("y", "-y*sqrt(z + x)")]),
        ..frame()
    };
    equations.inputs = variables(&["u"]);
    let terms = equations.critical_terms().unwrap();
    let at = [0.7, 0.0, 1.3];
    let together = terms.values(&at);
    assert!(terms.list().len() >= 3, "{:?}", terms.list());
    for (i, term) in terms.list().iter().enumerate() {
        let alone = terms.alone(i);
        assert_eq!(alone.value(&at).to_bits(), together[i].to_bits(), "{term:?}");
        // Radicands depend on all through z = 1, beside x or not; the denominator on x only.
        let expected: &[usize] = if term.text.contains('z') { &[0, 1, 2] } else { &[0] };
        assert_eq!(alone.variables(), expected, "{term:?}");
    }
    assert!((together[0] - 1.5).abs() < 1e-12, "{together:?}");
    assert!(together.iter().any(|value| (value - 1.7).abs() < 1e-12), "{together:?}");
}
