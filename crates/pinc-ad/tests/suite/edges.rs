//! The edges of functions: where a derivative jumps or is infinite, what counts as the derivative.

#![expect(clippy::float_cmp, reason = "the results are exact in binary")]

use pinc_ad::simd::{Isa, Simd, Task};
use pinc_ad::{Dual, Lanes, Scalar, Tape, derivative, gradient};

/// The derivative at `x` by each kind of number, which must agree.
macro_rules! slope {
    (|$x:ident| $f:expr, $at:expr) => {{
        fn f<S: Scalar>($x: S) -> S {
            $f
        }
        let at: f64 = $at;
        let dual = derivative(f, at);
        let lanes = derivative(f, Lanes::<4>::splat(at)).0[3];
        let tape = gradient(|v| f(v[0]), &[at]).1[0];
        let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
        assert!(same(dual, lanes) && same(dual, tape), "{dual} {lanes} {tape} at {at}");
        dual
    }};
}

#[test]
fn square_root_at_its_edge() {
    assert_eq!(slope!(|x| x.sqrt(), 0.0), 0.0);
    assert!(slope!(|x| x.sqrt(), -1.0).is_nan());
    assert!(slope!(|x| x.sqrt(), f64::NAN).is_nan());
    assert_eq!(slope!(|x| x.sqrt(), 4.0), 0.25);
    // A second derivative at 0 does not bring the infinity back.
    assert_eq!(derivative(|x| derivative(|x| x.sqrt(), x), 0.0), 0.0);
}

/// How a level below 0 is written: flow and derivative are 0 there, however the maximum is written.
#[test]
fn square_root_of_a_level() {
    for h in [-3.0, -0.0, 0.0] {
        assert_eq!(slope!(|h| h.max(h.constant(0.0)).sqrt(), h), 0.0, "{h}");
        assert_eq!(slope!(|h| h.constant(0.0).max(h).sqrt(), h), 0.0, "{h}");
        assert_eq!(slope!(|h| h.max(h.constant(0.0)).powf(0.5), h), 0.0, "{h}");
    }
    assert_eq!(slope!(|h| h.max(h.constant(0.0)).sqrt(), 4.0), 0.25);
    assert_eq!(slope!(|h| h.max(h.constant(0.0)).powf(0.5), 4.0), 0.25);
}

#[test]
fn length_of_a_zero_vector() {
    let (length, slopes) = gradient(|v| (v[0] * v[0] + v[1] * v[1]).sqrt(), &[0.0, 0.0]);
    assert_eq!((length, slopes), (0.0, vec![0.0, 0.0]));
}

#[test]
fn logarithm_at_its_edge() {
    assert_eq!(Scalar::ln(0.0), f64::NEG_INFINITY);
    assert!(Scalar::ln(-1.0).is_nan());
    assert_eq!(slope!(|x| x.ln(), 0.0), f64::INFINITY);
}

#[test]
fn powers_at_zero() {
    assert_eq!(slope!(|x| x.powf(1.5), 0.0), 0.0);
    assert_eq!(slope!(|x| x.powf(1.0), 0.0), 1.0);
    assert_eq!(slope!(|x| x.powf(0.0), 0.0), 0.0);
    assert_eq!(slope!(|x| x.powf(0.25), 0.0), 0.0);
    assert!(slope!(|x| x.powf(0.25), -1.0).is_nan());
    assert_eq!(slope!(|x| x.powf(2.0), -3.0), -6.0);
    assert_eq!(slope!(|x| x.powi(2), 0.0), 0.0);
    assert_eq!(slope!(|x| x.powi(1), 0.0), 1.0);
    assert_eq!(slope!(|x| x.powi(0), 0.0), 0.0);
}

#[test]
fn absolute_value_and_sign_at_zero() {
    for (x, expected) in [(-2.0, -1.0), (-0.0, 0.0), (0.0, 0.0), (2.0, 1.0)] {
        assert_eq!(slope!(|x| x.abs(), x), expected, "{x}");
        assert_eq!(Scalar::sign(x), expected, "{x}");
        assert_eq!(slope!(|x| x.sign(), x), 0.0, "{x}");
    }
    assert!(Scalar::sign(f64::NAN).is_nan());
}

/// The second of two equal ones is taken.
#[test]
fn ties() {
    let second = |f: fn([Dual<f64, 2>; 2]) -> Dual<f64, 2>| {
        f([Dual::variable(1.5, 0), Dual::variable(1.5, 1)]).eps
    };
    assert_eq!(second(|[a, b]| a.min(b)), [0.0, 1.0]);
    assert_eq!(second(|[a, b]| a.max(b)), [0.0, 1.0]);
    let tape = Tape::new();
    let (a, b) = (tape.variable(1.5), tape.variable(1.5));
    for picked in [a.min(b), a.max(b)] {
        assert_eq!(tape.gradient(picked, &[a, b]), [0.0, 1.0]);
    }
}

#[test]
fn nan_stays_visible_in_the_smaller_and_the_larger() {
    for (a, b) in [(f64::NAN, 1.0), (1.0, f64::NAN), (f64::NAN, f64::INFINITY)] {
        assert!(Scalar::min(a, b).is_nan() && Scalar::max(a, b).is_nan(), "{a} {b}");
    }
    let infinity = f64::INFINITY;
    assert_eq!(Scalar::min(infinity, infinity), infinity);
    assert_eq!(Scalar::max(-infinity, -infinity), -infinity);
    assert_eq!(Scalar::max(infinity, -infinity), infinity);
    assert_eq!(Scalar::min(infinity, -infinity), -infinity);
    // Numbers whose difference overflows or is denormal.
    assert_eq!(Scalar::max(-1e308, 1e308), 1e308);
    assert_eq!(Scalar::min(5e-324, 0.0), 0.0);
}

/// Every function in every instruction set gives what plain numbers give.
struct Functions<'a>(&'a [f64]);

fn functions<S: Scalar>(x: S) -> [S; 14] {
    let half = x.constant(0.5);
    let powers = [x.powf(1.7), x.powf(-0.5), x.powi(3), x.powi(-2)];
    let [a, b, c, d] = powers;
    let picked = [x.abs(), x.sign(), x.min(half), half.max(x)];
    let [e, f, g, h] = picked;
    [x.exp(), x.ln(), x.sin(), x.cos(), x.tan(), x.atan(), a, b, c, d, e, f, g, h]
}

/// By how many units in the last place the vectors' own functions may differ: the first eight.
fn units(function: usize, x: f64) -> f64 {
    let power = |p: f64| 4.0 + 3.0 * (p * x.ln()).abs();
    [2.0, 2.0, 2.0, 2.0, 4.0, 2.0, power(1.7), power(-0.5)]
        .get(function)
        .map_or(0.0, |&units| units)
}

impl Task for Functions<'_> {
    type Output = Vec<[f64; 14]>;
    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> Self::Output {
        let mut out = Vec::new();
        for x in self.0.chunks_exact(V::LANES) {
            let mut rows = vec![[0.0; 14]; V::LANES];
            let mut lanes = vec![0.0; V::LANES];
            for (i, y) in functions(zero.generate(|i| x[i])).into_iter().enumerate() {
                y.write(&mut lanes);
                for (row, lane) in rows.iter_mut().zip(&lanes) {
                    row[i] = *lane;
                }
            }
            out.extend(rows);
        }
        out
    }
}

/// What a task gives in every instruction set, and in the arrays that are vectors where the
/// portable one has no instructions.
fn on_all<T: Task>(task: impl Fn() -> T) -> Vec<(String, T::Output)> {
    let mut all: Vec<_> =
        Isa::available().iter().map(|isa| (isa.to_string(), isa.dispatch(task()))).collect();
    all.push(("arrays".to_owned(), task().run(Lanes::<4>::splat(0.0))));
    all
}

#[test]
fn vectors_agree_with_numbers() {
    let (infinity, nan) = (f64::INFINITY, f64::NAN);
    let x = [
        -2.5, -0.5, 0.0, 0.3, 0.5, 7.0, 1e-200, 1e200, -0.0, infinity, -infinity, nan, 1.0, 2.0,
        -1e-310, 700.0,
    ];
    for (isa, rows) in on_all(|| Functions(&x)) {
        for (x, row) in x.iter().zip(rows) {
            for (i, (y, expected)) in row.into_iter().zip(functions(*x)).enumerate() {
                let same = y.to_bits() == expected.to_bits() || (y.is_nan() && expected.is_nan());
                let (units, unit) = (units(i, *x), f64::EPSILON * expected.abs());
                let near = units > 0.0 && (y - expected).abs() <= units * unit;
                // A fraction as the exponent is for numbers that are not negative.
                let undefined = matches!(i, 6 | 7) && *x < 0.0 && y.is_nan();
                assert!(
                    same || near || undefined,
                    "{isa}: function {i} of {x} is {y}, not {expected}"
                );
            }
        }
    }
}

/// The sums of vectors 0, 1, .. of the lanes 1, 2, 4, .., which tell apart which lanes are in them.
struct Sums;

impl Task for Sums {
    type Output = Vec<f64>;
    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> Vec<f64> {
        let power = |place: usize| f64::from(i32::try_from(place).unwrap()).exp2();
        let vector = |k: usize| zero.generate(|i| power(i + V::LANES * k));
        let vectors: Vec<V> = (0..V::LANES).map(vector).collect();
        let mut sums = vec![0.0; V::LANES];
        V::sums(&vectors).write(&mut sums);
        sums
    }
}

#[test]
fn sums_of_several_vectors_are_in_their_places() {
    for (isa, sums) in on_all(|| Sums) {
        let lanes = i32::try_from(sums.len()).unwrap();
        let expected = (0..lanes).map(|k| 2.0_f64.powi(lanes * k) * (2.0_f64.powi(lanes) - 1.0));
        assert_eq!(sums, expected.collect::<Vec<_>>(), "{isa}");
    }
    for isa in Isa::available() {
        assert_eq!(isa.dispatch(Sums).len(), isa.lanes());
    }
}
