//! The hyperbolic tangent in SIMD lanes.

use crate::simd::{Simd, TABLE_SIZE};

/// Entries per unit of x.
const DENSITY: f64 = 32.0;

/// 1.5 * 2^52 + 1024: adding it rounds a number to an integer, which is then in the low bits,
/// shifted to the middle of the table.
const SHIFT: f64 = 6_755_399_441_055_744.0 + 1024.0;

/// Beyond it tanh is 1 to rounding.
const LIMIT: f64 = 20.0;

/// tanh((i - 1024)/32).
static TANH: [f64; TABLE_SIZE] = table();

/// r coth r = 1 + r (C0 r + C1 r^3 + C2 r^5) + .., the Taylor series; the next term is below 2^-60
/// for |r| <= 1/64.
const C: [f64; 3] = [1.0 / 3.0, -1.0 / 45.0, 2.0 / 945.0];

/// tanh of several vectors, each to within 2 units in the last place (tested over the whole range);
/// odd to within rounding, NaN for NaN, +-1 for +-infinity.
///
/// ```text
/// x = k/32 + r, |r| <= 1/64, T = tanh(k/32) from a table; by the addition theorem
/// tanh x = T + (1 - T^2) r / (1 + w),    w = r (T + r/3 - r^3/45 + 2 r^5/945)
/// 1/(1 + w) = (1 - w)(1 + w^2)(1 + w^4)  to within w^8
/// ```
///
/// There is no division, which would take longer than all the rest. It is a long chain of dependent
/// operations: several vectors go through it side by side, stage by stage, so that the processor
/// always has independent work at hand.
#[inline(always)]
pub fn tanh_all<V: Simd, const N: usize>(x: &mut [V; N]) {
    let zero = x[0].constant(0.0);
    let (mut r, mut from_table, mut w) = ([zero; N], [zero; N], [zero; N]);
    for i in 0..N {
        let x = x[i].clamp(LIMIT);
        let shifted = x.mul_add(zero.constant(DENSITY), zero.constant(SHIFT));
        from_table[i] = shifted.lookup(&TANH);
        r[i] = (shifted - SHIFT).neg_mul_add(zero.constant(1.0 / DENSITY), x);
    }
    for i in 0..N {
        let square = r[i] * r[i];
        let series = square.mul_add(zero.constant(C[2]), zero.constant(C[1]));
        let series = series.mul_add(square, zero.constant(C[0]));
        w[i] = r[i] * series.mul_add(r[i], from_table[i]);
    }
    for i in 0..N {
        let slope = from_table[i].neg_mul_add(from_table[i], zero.constant(1.0));
        let step = slope * r[i];
        let step = step.neg_mul_add(w[i], step);
        let square = w[i] * w[i];
        let step = step.mul_add(square, step);
        x[i] = from_table[i] + step.mul_add(square * square, step);
    }
}

/// e^(1/16) in twice the precision.
const SIXTEENTH: (f64, f64) = (1.064_494_458_917_859_3, 1.087_288_814_321_195_7e-16);

/// [`TANH`], computed in pairs of numbers (high, low) whose sum has twice the precision.
const fn table() -> [f64; TABLE_SIZE] {
    let middle = TABLE_SIZE / 2;
    let mut table = [0.0; TABLE_SIZE];
    // e^(k/16) = e^(2 k/32), by repeated multiplication with e^(1/16).
    let mut power = (1.0, 0.0);
    let mut k = 1;
    while k < middle {
        power = times(power, SIXTEENTH);
        table[middle + k] = ratio(plus(power, -1.0), plus(power, 1.0));
        table[middle - k] = -table[middle + k];
        k += 1;
    }
    table[0] = -1.0;
    table
}

/// a + b of a pair and a number, the pair being the larger or b a power of two near it.
const fn plus((high, low): (f64, f64), b: f64) -> (f64, f64) {
    let sum = high + b;
    let part = sum - high;
    let error = (high - (sum - part)) + (b - part);
    normalized(sum, error + low)
}

/// The pair of a large and a small number.
const fn normalized(high: f64, low: f64) -> (f64, f64) {
    let sum = high + low;
    (sum, low - (sum - high))
}

/// a b of two pairs, after Dekker (1971).
const fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let (product, error) = exact_product(a.0, b.0);
    normalized(product, error + (a.0 * b.1 + a.1 * b.0))
}

/// a b of two numbers and its rounding error: each is split into halves whose products are exact.
const fn exact_product(a: f64, b: f64) -> (f64, f64) {
    let ((a0, a1), (b0, b1)) = (halves(a), halves(b));
    let product = a * b;
    (product, ((a0 * b0 - product) + a0 * b1 + a1 * b0) + a1 * b1)
}

const fn halves(a: f64) -> (f64, f64) {
    let scaled = 134_217_729.0 * a;
    let high = scaled - (scaled - a);
    (high, a - high)
}

/// a / b of two pairs, rounded to one number.
const fn ratio(a: (f64, f64), b: (f64, f64)) -> f64 {
    let quotient = a.0 / b.0;
    let (product, error) = exact_product(quotient, b.0);
    let rest = (a.0 - product) - error + (a.1 - quotient * b.1);
    quotient + rest / b.0
}

/// tanh of one vector: see [`tanh_all`].
#[cfg(any(target_arch = "x86_64", test))]
#[inline(always)]
pub(super) fn tanh<V: Simd>(x: V) -> V {
    let mut one = [x];
    tanh_all(&mut one);
    one[0]
}

#[cfg(test)]
mod tests {
    use crate::simd::{Isa, Simd, Task};

    struct Tanh<'a>(&'a [f64]);

    impl Task for Tanh<'_> {
        type Output = Vec<f64>;
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> Vec<f64> {
            let mut out = vec![0.0; self.0.len()];
            for (x, y) in self.0.chunks_exact(V::LANES).zip(out.chunks_exact_mut(V::LANES)) {
                super::tanh(zero.generate(|i| x[i])).write(y);
            }
            out
        }
    }

    /// A multiple of every vector length, from denormal to beyond saturation, both signs.
    fn grid() -> Vec<f64> {
        let mut x: Vec<f64> = (0..40_000).map(|i| f64::from(i) * 5.5e-4 - 11.0).collect();
        x.extend((0..8_000).map(|i| 2.0_f64.powf(-f64::from(i) * 0.13)));
        x.extend([0.0, -0.0, 25.0, -25.0, 1e300, -1e300, 19.0, 22.0]);
        x
    }

    #[test]
    fn within_two_units_in_the_last_place_of_the_true_value() {
        for isa in Isa::available() {
            let x = grid();
            for (x, y) in x.iter().zip(isa.dispatch(Tanh(&x))) {
                // std's tanh is itself within 1 unit of the true value.
                let expected = x.tanh();
                let unit = expected.abs().next_up() - expected.abs();
                assert!((y - expected).abs() <= 2.0 * unit, "{isa}: tanh {x:e} = {y:e}");
            }
        }
    }

    #[test]
    fn not_finite_arguments() {
        let x = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, f64::NAN, 1e308, -1e308, 0.0];
        for isa in Isa::available() {
            let y = isa.dispatch(Tanh(&x));
            assert!(y[0].is_nan() && y[4].is_nan(), "{isa}: {y:?}");
            for (i, expected) in [(1, 1.0), (2, -1.0), (3, 0.0), (5, 1.0), (6, -1.0_f64)] {
                assert!((y[i] - expected).abs() < f64::EPSILON, "{isa}: {y:?}");
            }
        }
    }
}
