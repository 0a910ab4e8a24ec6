//! Quantiles of Student's distribution.

use std::f64::consts::FRAC_PI_2;

/// The 97.5 % quantile of the normal distribution.
const NORMAL: f64 = 1.959_963_984_540_054;

/// The t with which an estimate plus or minus t of its standard deviations is an interval of 95 %,
/// for `freedom` degrees of freedom, at least 1.
pub(crate) fn quantile_95(freedom: usize) -> f64 {
    let (mut low, mut high) = (NORMAL, 13.0);
    let nu = freedom as f64;
    if freedom > 300 {
        // The expansion of Abramowitz and Stegun, 26.7.5, to 1e-10 here.
        let z = NORMAL;
        let terms = [
            (z.powi(3) + z) / 4.0,
            (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0,
            (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0,
        ];
        return z + (terms[0] + (terms[1] + terms[2] / nu) / nu) / nu;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        let below = central(middle, freedom, nu) < 0.95;
        *(if below { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

/// The probability of values from -t to t: Abramowitz and Stegun, 26.7.3 and 26.7.4.
fn central(t: f64, freedom: usize, nu: f64) -> f64 {
    let angle = (t / nu.sqrt()).atan();
    let (sin, cos) = angle.sin_cos();
    let odd = freedom % 2 == 1;
    let (mut term, mut sum) = if odd { (cos, 0.0) } else { (1.0, 1.0) };
    // The terms are 2/3 of the one before, times cos^2, 4/5, .. if nu is odd; 1/2, 3/4, .. if even.
    let mut k = if odd { 1.0 } else { 0.0 };
    if odd && freedom > 1 {
        sum = cos;
    }
    while k + 2.0 <= nu - 2.0 {
        term *= (k + 1.0) / (k + 2.0) * cos * cos;
        sum += term;
        k += 2.0;
    }
    if odd { (angle + sin * sum) / FRAC_PI_2 } else { sin * sum }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of any textbook.
    #[test]
    fn the_quantiles_match_the_tables() {
        for (freedom, expected) in [
            (1, 12.706_205),
            (2, 4.302_653),
            (3, 3.182_446),
            (4, 2.776_445),
            (5, 2.570_582),
            (10, 2.228_139),
            (31, 2.039_513),
            (100, 1.983_972),
            (300, 1.967_903),
            (301, 1.967_877),
            (788, 1.962_979),
        ] {
            let found = quantile_95(freedom);
            assert!((found - expected).abs() < 2e-6, "{freedom}: {found} {expected}");
        }
    }
}
