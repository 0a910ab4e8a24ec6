//! The correlations of residuals with each other and with the inputs before them.

use crate::problem::Recording;
use crate::result::InputCorrelation;

/// How many steps before an input may lie.
pub(crate) const LAGS: usize = 50;
/// The lags that tell how coloured a signal is.
const COLOURED: usize = 200;
/// The standard deviations beyond which a correlation is no chance: one in sixteen thousand.
const BEYOND: f64 = 4.0;

impl InputCorrelation {
    /// Its size, in what chance allows.
    pub(crate) fn size(&self) -> f64 {
        self.correlation.abs() / self.chance
    }

    /// Whether it is more than chance.
    #[must_use]
    pub fn is_significant(&self) -> bool {
        self.size() > 1.0
    }
}

/// The correlation of neighbours among the residuals of each recording, NaN where there is none:
/// each and the next that there is, however many rows later.
pub(crate) fn of_neighbours(residuals: impl IntoIterator<Item = Vec<f64>>) -> f64 {
    let (mut products, mut squares) = (0.0, 0.0);
    for mut of in residuals {
        of.retain(|residual| !residual.is_nan());
        // A residual by itself has no neighbour.
        if of.len() > 1 {
            squares += of.iter().map(|residual| residual * residual).sum::<f64>();
            products += of.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>();
        }
    }
    if squares > 0.0 { products / squares } else { 0.0 }
}

/// The largest correlation of the residuals of each recording, NaN where there is none, with each
/// of `nu` inputs of up to 50 steps before.
pub(crate) fn with_inputs(
    recordings: &[Recording<'_>],
    residuals: &[Vec<f64>],
    nu: usize,
) -> Vec<InputCorrelation> {
    let residuals = without_mean(residuals.to_vec());
    let of = |input: usize| {
        let column = |of: &Recording<'_>| of.u.iter().skip(input).step_by(nu).copied().collect();
        let inputs = without_mean(recordings.iter().map(column).collect());
        largest(&residuals, &inputs)
    };
    (0..nu).map(of).collect()
}

fn largest(residuals: &[Vec<f64>], inputs: &[Vec<f64>]) -> InputCorrelation {
    let (size, pairs) = products(residuals, residuals, 0);
    let scale = size.sqrt() * size_beside(residuals, inputs).sqrt();
    if !(scale > 0.0 && pairs > 2 * LAGS) {
        return InputCorrelation { correlation: f64::NAN, lag: 0, chance: f64::INFINITY };
    }
    // The variance of a correlation of two independent signals, as Bartlett has it.
    let own = |of: &[Vec<f64>], lag| products(of, of, lag).0 / products(of, of, 0).0;
    let coloured = (1..COLOURED.min(pairs / 2)).map(|lag| own(residuals, lag) * own(inputs, lag));
    let variance = (1.0 + 2.0 * coloured.sum::<f64>()).max(1.0) / pairs as f64;
    let chance = BEYOND * variance.sqrt();
    let at = |lag| {
        let correlation = products(residuals, inputs, lag).0 / scale;
        InputCorrelation { correlation, lag, chance }
    };
    (1..=LAGS).map(at).fold(at(0), |a, b| if b.size() > a.size() { b } else { a })
}

/// The sum of a[k] b[k - lag], without missing values, and how many products it has.
fn products(a: &[Vec<f64>], b: &[Vec<f64>], lag: usize) -> (f64, usize) {
    let pairs = a.iter().zip(b).flat_map(|(a, b)| a.iter().skip(lag).zip(b));
    let products = pairs.map(|(a, b)| a * b).filter(|product| !product.is_nan());
    products.fold((0.0, 0), |(sum, count), product| (sum + product, count + 1))
}

/// The sum of the squares of the inputs in rows that have a residual.
fn size_beside(residuals: &[Vec<f64>], inputs: &[Vec<f64>]) -> f64 {
    let rows = residuals.iter().flatten().zip(inputs.iter().flatten());
    rows.filter(|(residual, _)| !residual.is_nan()).map(|(_, input)| input * input).sum()
}

fn without_mean(mut of: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let given = || of.iter().flatten().filter(|value| !value.is_nan());
    let mean = given().sum::<f64>() / given().count().max(1) as f64;
    of.iter_mut().flatten().for_each(|value| *value -= mean);
    of
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    /// The residual has the input of seven steps before as a quarter of its variance.
    #[test]
    fn the_lag_of_an_input_is_found_and_chance_is_none() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut draw =
            |n: usize| -> Vec<f64> { (0..n).map(|_| rng.random_range(-1.0..1.0)).collect() };
        let (u, e) = (draw(1200), draw(600));
        let other: Vec<f64> = u.chunks(2).map(|u| u[1]).collect();
        let delayed = |k: usize| if k < 7 { 0.0 } else { other[k - 7] };
        let share = 3.0_f64.sqrt();
        let residuals: Vec<f64> = (0..600).map(|k| share * e[k] - delayed(k)).collect();
        let recording = Recording { name: "", before: None, u: &u, y: &[] };
        let [first, second] = with_inputs(&[recording], &[residuals], 2)[..] else { panic!() };
        assert!(!first.is_significant(), "{first:?}");
        assert_eq!(second.lag, 7);
        assert!((second.correlation + 0.5).abs() < 0.06, "{second:?}");
        // White signals: four over the root of 600.
        assert!((second.chance - 4.0 / 600.0_f64.sqrt()).abs() < 0.03, "{second:?}");
    }

    /// Forty rows are too few to say anything.
    #[test]
    fn too_few_rows_have_no_correlation() {
        let u: Vec<f64> = (0..40).map(|k| f64::from(k % 7)).collect();
        let recording = Recording { name: "", before: None, u: &u, y: &[] };
        let found = with_inputs(&[recording], std::slice::from_ref(&u), 1)[0];
        assert!(found.correlation.is_nan() && !found.is_significant(), "{found:?}");
    }

    /// Two independent signals that drift slowly look correlated, which is chance.
    #[test]
    fn slow_signals_need_more() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut slow = || -> Vec<f64> {
            let mut x = 0.0;
            let mut next = || {
                x = 0.97 * x + rng.random_range(-1.0..1.0);
                x
            };
            (0..800).map(|_| next()).collect()
        };
        let (u, e) = (slow(), slow());
        let recording = Recording { name: "", before: None, u: &u, y: &[] };
        let found = with_inputs(&[recording], &[e], 1)[0];
        assert!(found.chance > 0.5, "{found:?}");
        assert!(!found.is_significant(), "{found:?}");
    }
}
