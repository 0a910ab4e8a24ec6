//! An equation solved inside another: iterated on plain numbers, differentiated by one last step.

use pinc_ad::{Dual, ImplicitEquations, Lanes, Scalar, derivative, gradient, solve_implicit};

/// z with z^3 + z = x, by Newton's method.
fn root<S: Scalar>(x: S) -> S {
    let plain = x.plain();
    let mut z = plain.constant(1.0);
    let mut slope = z;
    for _ in 0..12 {
        let at = Dual::<S::Plain>::variable(z, 0);
        let residual = at * at * at + at - Dual::lift(plain);
        slope = residual.eps[0];
        z = z - residual.re / slope;
    }
    let z = x.constants(z);
    z - (z * z * z + z - x) / x.constants(slope)
}

/// dz/dx = 1 / (3 z^2 + 1), by every kind of number with derivatives.
#[test]
fn derivatives_follow_from_the_implicit_function_theorem() {
    for x in [-3.0, 0.0, 0.5, 2.0, 10.0] {
        let z = root(x);
        let expected = 1.0 / (3.0 * z * z + 1.0);
        // Some roundings of numbers of order 10 and below.
        assert!((z * z * z + z - x).abs() < 1e-14, "{x}");
        assert!((derivative(root, x) - expected).abs() < 1e-14, "dual at {x}");
        assert!((gradient(|v| root(v[0]), &[x]).1[0] - expected).abs() < 1e-14, "tape at {x}");
    }
}

#[test]
fn every_lane_has_its_own_root_and_derivative() {
    let x = [-3.0, 0.0, 2.0, 10.0];
    let z = root(Dual::<Lanes<4>>::variable(Lanes(x), 0));
    for (lane, x) in x.into_iter().enumerate() {
        assert!((z.re.0[lane] - root(x)).abs() < 1e-15);
        assert!((z.eps[0].0[lane] - derivative(root, x)).abs() < 1e-15);
    }
}

#[test]
fn a_plain_number_made_a_constant_has_no_derivatives() {
    let frozen = |x: Dual<f64>| x * x.constants(x.plain());
    // d/dx (x c) at c = x is x, not 2x.
    assert!((derivative(frozen, 3.0) - 3.0).abs() < 1e-15);
}

/// a + b = s, a b = p: the two roots of z^2 - s z + p, of which the start picks the order.
struct SumAndProduct;

impl ImplicitEquations<2, 2> for SumAndProduct {
    fn residuals<S: Scalar>(&self, [s, p]: &[S; 2], [a, b]: &[S; 2], g: &mut [S; 2]) {
        *g = [*a + *b - *s, *a * *b - *p];
    }
}

/// The smaller root.
fn smaller<S: Scalar>(s: S, p: S) -> S {
    let start = [s.plain() * 0.2, s.plain() * 0.8];
    solve_implicit(&SumAndProduct, &[s, p], start, &[[-10.0, 10.0]; 2])[0]
}

fn by_formula<S: Scalar>(s: S, p: S) -> S {
    (s - (s * s - p * 4.0).sqrt()) * 0.5
}

const POINTS: [[f64; 2]; 4] = [[3.0, 2.0], [5.0, 1.0], [4.0, -3.0], [1.0, 0.24]];

/// Values, first and second derivatives of two unknowns, in every kind of number.
#[test]
fn systems_have_exact_derivatives_of_all_orders() {
    type Second = Dual<Dual<f64, 2>, 2>;
    for at in POINTS {
        let seeded: [Second; 2] =
            std::array::from_fn(|i| Dual::variable(Dual::variable(at[i], i), i));
        let (found, expected) = (smaller(seeded[0], seeded[1]), by_formula(seeded[0], seeded[1]));
        let flat = |d: Second| [d.re, d.eps[0], d.eps[1]].map(|d| [d.re, d.eps[0], d.eps[1]]);
        for (a, b) in flat(found).iter().flatten().zip(flat(expected).iter().flatten()) {
            assert!((a - b).abs() < 1e-11 * (1.0 + b.abs()), "{at:?}: {found:?} {expected:?}");
        }
        let (_, found) = gradient(|v| smaller(v[0], v[1]), &at);
        let (_, expected) = gradient(|v| by_formula(v[0], v[1]), &at);
        assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

/// Each lane has the bits that it has alone, also beside one without a root.
#[test]
fn lanes_of_systems_are_independent() {
    let [mut s, mut p] = [0, 1].map(|i| POINTS.map(|at| at[i]));
    let all = smaller(Lanes(s), Lanes(p));
    (s[2], p[2]) = (1.0, 9.0);
    let with_none = smaller(Lanes(s), Lanes(p));
    for (lane, [s, p]) in POINTS.into_iter().enumerate() {
        assert_eq!(all.0[lane].to_bits(), smaller(s, p).to_bits(), "{lane}");
        if lane == 2 {
            assert!(with_none.0[lane].is_nan());
        } else {
            assert_eq!(with_none.0[lane].to_bits(), smaller(s, p).to_bits(), "{lane}");
        }
    }
}

/// z e^z = x in a box: found from far away, NaN where the root is outside, and for NaN.
#[test]
fn the_search_stays_in_its_box() {
    struct Lambert;
    impl ImplicitEquations<1, 1> for Lambert {
        fn residuals<S: Scalar>(&self, [x]: &[S; 1], [z]: &[S; 1], g: &mut [S; 1]) {
            g[0] = *z * z.exp() - *x;
        }
    }
    let solve = |x: f64, start: f64| solve_implicit(&Lambert, &[x], [start], &[[-0.9, 6.0]])[0];
    for z in [-0.8, -0.3, 0.0, 0.5, 2.0, 5.9] {
        for start in [-0.5, 0.0, 3.0, 6.0, 100.0] {
            let found = solve(z * f64::exp(z), start);
            assert!(
                (found - z).abs() < 1e-13 * (1.0 + z.abs() * 10.0),
                "{z} from {start}: {found}"
            );
        }
    }
    assert!(solve(6.5 * f64::exp(6.5), 1.0).is_nan() && solve(-1.0, 0.0).is_nan());
    assert!(solve(f64::NAN, 0.0).is_nan() && solve(1.0, f64::NAN).is_nan());
}
