//! The code of grouped functions, and what it computes on every instruction set.

#[path = "../../tests/suite/on_dual_numbers.rs"]
mod on_dual_numbers;

use super::Parts;
use crate::Equations;
use pinc_ad::simd::Isa;
use pinc_ode::{
    Dims, Integrator, LinearizationBuffer, Model, Stages, Tableau, Variable, sparse_runge_kutta,
};

fn equations(states: &[(String, String)]) -> Equations {
    Equations {
        states: states
            .iter()
            .map(|(name, _)| Variable { name: name.clone().into(), unit: "".into() })
            .collect(),
        inputs: vec![Variable::new("u", "")],
        derivatives: states.iter().cloned().collect(),
        ..Equations::default()
    }
}

/// `n` nodes in a row.
fn rod(n: usize) -> Equations {
    let equation = |i: usize| {
        let left = if i == 0 { "u".to_owned() } else { format!("0.5*(T{} - T{i})", i - 1) };
        let right = if i + 1 == n { "1".to_owned() } else { format!("0.5*(T{i} - T{})", i + 1) };
        (format!("T{i}"), format!("{left} - {right} - 0.1*(T{i} + 2)^4"))
    };
    equations(&(0..n).map(equation).collect::<Vec<_>>())
}

fn numbers(len: usize) -> Vec<f64> {
    (0..len).map(|i| 0.7 + (i as f64 * 0.9).sin() * 0.5).collect()
}

fn linearize(model: &mut dyn Model, count: usize) -> LinearizationBuffer {
    let Dims { nx, nu, .. } = model.dims();
    let (x, u) = (numbers(count * nx), numbers(count * nu));
    let mut out = LinearizationBuffer::new(model.dims(), count);
    model.linearize(Stages { x: &x, u: &u, p: &[] }, out.as_mut());
    out
}

/// Every operation, on every instruction set, against dual numbers.
#[test]
fn every_instruction_set_computes_every_operation() {
    let texts = [
        "sqrt(x0) + exp(-x1) - log(x2 + 2)*sin(x3)",
        "cos(x0)*tan(x1/2) + tanh(x2*x3) - atan(x0/x1)",
        "abs(x0 - x1) + sign(x2)*x3 + min(x0, x3) + max(x1, x2) + max(x0, 0.5) - min(0.5, x1)",
        "x0^1.3 - x1^0.5 + x2^-2 + x3^x0 - 2/x1 + (1 - x2)*(x3 - 3) + u",
        "u*x0 - x4*x1 + 0.3*(x2 - x4)/(1 + x3^2)",
    ];
    let states: Vec<_> =
        texts.iter().enumerate().map(|(i, text)| (format!("x{i}"), (*text).to_owned())).collect();
    // The first four alone are a small plant.
    for count in [4, 5] {
        let plant = equations(&states[..count]).compile().expect("valid equations");
        let (x, u) = (numbers(11 * count), numbers(11));
        let points = x.chunks_exact(count).zip(&u).flat_map(|(x, &u)| [x, &[u]].concat());
        let points: Vec<f64> = points.collect();
        let method = (Integrator::Rk4, 0.01, 2);
        let expected = on_dual_numbers::linearize(&plant, method, &points);
        for isa in Isa::available() {
            let (sparse, method) = (plant.sparse.plant.clone(), Tableau::CLASSICAL);
            let found = linearize(&mut *sparse_runge_kutta(sparse, method, 0.01, 2, isa), 11);
            for (found, expected) in
                [(&found.next, &expected.next), (&found.a, &expected.a), (&found.b, &expected.b)]
            {
                for (a, b) in found.iter().zip(expected) {
                    assert!((a - b).abs() <= 1e-13 * (1.0 + b.abs()), "{isa}: {a:e}, {b:e}");
                }
            }
        }
    }
}

/// Each node has its own temperature, one or two neighbours, and the same equation.
#[test]
fn a_rods_code_grows_with_its_nodes_and_has_no_more_groups() {
    let sizes = |n: usize| {
        let plant = rod(n).compile().expect("valid equations");
        let code = &plant.sparse.plant.rhs.0.linearization;
        assert_eq!(plant.sparse.plant.rhs.0.pattern.entries(), 3 * n - 2 + 1);
        (code.steps.len(), code.groups.len())
    };
    let [(short, groups), (middle, _), (long, most)] = [sizes(20), sizes(40), sizes(60)];
    assert_eq!(long - middle, middle - short);
    assert!(long - middle <= 20 * 12, "{short} {middle} {long}");
    assert_eq!(groups, most);
    assert!(groups <= 12, "{groups}");
}

/// Constant factors meet: d(0.1 (T + 2)^4)/dT = 0.4 (T + 2)^3 takes one product with a number.
#[test]
fn constants_fold_across_the_chain() {
    let code = |text: &str| {
        let plant = equations(&[("x".to_owned(), text.to_owned())]).compile();
        let plant = plant.expect("valid equations");
        let Parts { values, linearization, .. } = &*plant.sparse.plant.rhs.0;
        linearization.steps.len() - values.steps.len()
    };
    // x + 2 and its square are known; the product of the two, then with a number.
    assert_eq!(code("0.1*(x + 2)^4 + u"), 2);
    // Only numbers.
    assert_eq!(code("3*(2*x - u/4) + (1 - x)/5"), 0);
    assert_eq!(code("x - x + u"), 0);
    // The cosine comes with the sine.
    assert_eq!(code("sin(x) + u"), 0);
}
