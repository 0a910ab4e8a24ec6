//! Derivatives of random expressions: dual numbers against the tape against central differences.

use super::common::{Expr, INPUTS, config, expressions, points};
use pinc_ad::{Dual, Lanes, Scalar, Tape, Var, central_difference, gradient, jacobian};
use proptest::prelude::*;

/// What two exact methods may differ by, relative to 1 + |derivative|. An expression has at most
/// four levels of operations with partial derivatives of at most 8, and at most 24 operations: its
/// rounding errors add up to less than 24 * 8^4 * 2.2e-16 = 2e-11. Twice that for two methods.
const ROUNDING: f64 = 5e-11;

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * (1.0 + b.abs())
}

/// `df/dx_j` and a bound of its error, by central differences with two steps, the second at least
/// 8/3 times the first: their difference is then at least six times the truncation error of the
/// first, to leading order. 1e-8 stands for rounding (4 eps / h = 1.5e-10, amplified like
/// [`ROUNDING`]). `None` where the bound says nothing.
fn difference(mut f: impl FnMut(&[f64]) -> f64, x: &[f64], j: usize) -> Option<(f64, f64)> {
    let fine = central_difference(&mut f, x, j);
    // As a function of x_j / 4, the step in x_j is four times h(0); h(x) is at most 1.5 h(0) here.
    let mut scaled = x.to_vec();
    scaled[j] /= 4.0;
    let stretched = |z: &[f64]| {
        let mut x = z.to_vec();
        x[j] *= 4.0;
        f(&x)
    };
    let coarse = central_difference(stretched, &scaled, j) / 4.0;
    let bound = (fine - coarse).abs() + 1e-8;
    (bound < 1e-5).then_some((fine, bound))
}

fn by_duals<const N: usize>(f: &Expr, x: &[f64; INPUTS]) -> Vec<f64> {
    let mut gradient = Vec::new();
    for first in (0..INPUTS).step_by(N) {
        let seeded: Vec<_> = (0..INPUTS)
            .map(|j| Dual::<f64, N>::variable(x[j], j.checked_sub(first).unwrap_or(N)))
            .collect();
        let result = f.eval(&seeded);
        gradient.extend_from_slice(&result.eps[..N.min(INPUTS - first)]);
    }
    gradient
}

/// Row by row, by `Dual<Var>`: the gradient, swept back from each directional derivative.
fn hessian_forward_over_reverse(f: &Expr, x: &[f64; INPUTS]) -> Vec<f64> {
    let rows = (0..INPUTS).map(|row| {
        let tape = Tape::new();
        let inputs: Vec<_> = x.iter().map(|&v| tape.variable(v)).collect();
        let seeded: Vec<_> = inputs
            .iter()
            .enumerate()
            .map(|(j, &v)| Dual::<Var>::variable(v, usize::from(j != row)))
            .collect();
        tape.gradient(f.eval(&seeded).eps[0], &inputs)
    });
    rows.flatten().collect()
}

/// Row by row, by dual numbers of dual numbers.
fn hessian_forward_over_forward(f: &Expr, x: &[f64; INPUTS]) -> Vec<f64> {
    let entry = |row: usize, column: usize| {
        let seeded: Vec<_> = (0..INPUTS)
            .map(|j| {
                let inner = Dual::<f64>::variable(x[j], usize::from(j != column));
                Dual::<Dual<f64>> {
                    re: inner,
                    eps: [inner.constant(if j == row { 1.0 } else { 0.0 })],
                }
            })
            .collect();
        f.eval(&seeded).eps[0].eps[0]
    };
    let indices = (0..INPUTS).flat_map(|row| (0..INPUTS).map(move |column| (row, column)));
    indices.map(|(row, column)| entry(row, column)).collect()
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn gradients_agree(f in expressions(), x in points()) {
        prop_assume!(f.is_tame(&x));
        let (value, by_tape) = gradient(|v| f.eval(v), &x);
        prop_assert_eq!(value.to_bits(), f.eval(&x[..]).to_bits());
        for duals in [by_duals::<1>(&f, &x), by_duals::<2>(&f, &x), by_duals::<8>(&f, &x)] {
            for (a, b) in duals.into_iter().zip(&by_tape) {
                prop_assert!(close(a, *b, ROUNDING), "dual {} tape {}", a, b);
            }
        }
        for (j, &given) in by_tape.iter().enumerate() {
            let Some((expected, bound)) = difference(|x| f.eval(x), &x, j) else {
                return Err(TestCaseError::reject("too curved for differences"));
            };
            prop_assert!((given - expected).abs() <= bound, "{}: {} {}", j, given, expected);
        }
    }

    #[test]
    fn jacobian_has_the_gradients_as_rows(f in expressions(), g in expressions(), x in points()) {
        prop_assume!(f.is_tame(&x) && g.is_tame(&x));
        let rows = jacobian(|v, out| { out[0] = f.eval(v); out[1] = g.eval(v) }, &x, 2);
        let gradients = [gradient(|v| f.eval(v), &x).1, gradient(|v| g.eval(v), &x).1].concat();
        prop_assert_eq!(rows.len(), 2 * INPUTS);
        for (a, b) in rows.iter().zip(&gradients) {
            prop_assert!(close(*a, *b, ROUNDING), "{} {}", a, b);
        }
    }

    #[test]
    fn lanes_inside_duals_are_points_of_their_own(
        f in expressions(),
        x in prop::array::uniform8(points()),
    ) {
        prop_assume!(x.iter().all(|x| f.is_tame(x)));
        let seeded: Vec<_> = (0..INPUTS)
            .map(|j| Dual::<Lanes<8>, 2>::variable(Lanes(std::array::from_fn(|i| x[i][j])), j))
            .collect();
        let result = f.eval(&seeded);
        for (lane, x) in x.iter().enumerate() {
            let alone = by_duals::<1>(&f, x);
            prop_assert_eq!(result.re.0[lane].to_bits(), f.eval(&x[..]).to_bits());
            prop_assert!(close(result.eps[0].0[lane], alone[0], ROUNDING));
            prop_assert!(close(result.eps[1].0[lane], alone[1], ROUNDING));
        }
    }

    #[test]
    fn hessians_agree(f in expressions(), x in points()) {
        prop_assume!(f.is_tame(&x));
        let reverse = hessian_forward_over_reverse(&f, &x);
        let forward = hessian_forward_over_forward(&f, &x);
        for row in 0..INPUTS {
            for column in 0..INPUTS {
                let (a, b) = (reverse[row * INPUTS + column], forward[row * INPUTS + column]);
                // Second derivatives have products of two first ones: the bound is squared in 8^4.
                prop_assert!(close(a, b, ROUNDING * 4096.0), "{} {}", a, b);
                prop_assert!(close(a, reverse[column * INPUTS + row], ROUNDING * 4096.0));
                let slope = |x: &[f64]| gradient(|v| f.eval(v), x).1[row];
                if let Some((expected, bound)) = difference(slope, &x, column) {
                    prop_assert!((a - expected).abs() <= bound, "{} {}", a, expected);
                }
            }
        }
    }
}

/// A wide function, so that [`jacobian`] needs more than one group of directions: 0, 1, 7, 8, 9
/// and 17 inputs around its eight.
#[test]
fn jacobian_of_any_width() {
    for n in [1, 7, 8, 9, 17] {
        let x: Vec<f64> = (1..=n).map(|i| f64::from(i) / 4.0).collect();
        // f_0 = sum of x_i^2 / 2, f_1 = 3, f_2 = x_last
        let rows = jacobian(
            |v, out| {
                for &x in v {
                    out[0] = x.mul_add(x * 0.5, out[0]);
                }
                out[1] = v[0].constant(3.0);
                out[2] = v[v.len() - 1];
            },
            &x,
            3,
        );
        let mut last = vec![0.0; x.len()];
        last[x.len() - 1] = 1.0;
        // All numbers here are exact in binary.
        assert_eq!(rows, [x.clone(), vec![0.0; x.len()], last].concat(), "{n}");
    }
    assert!(jacobian(|_, _| {}, &[], 2).is_empty());
}
