//! How a number varies over trials.

/// The confidence that an interval of the median has where there are enough values for it.
const CONFIDENCE: f64 = 0.95;

/// Order statistics of the trials of a cell.
///
/// The interval of the median is that between two values, the k-th from below and from above. It
/// holds whatever the distribution: the median lies outside only if all but k - 1 values fall on
/// one side of it, each with probability 1/2.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// In ascending order.
    values: Vec<f64>,
}

impl Spread {
    /// The spread of these values, of which those that are not finite are left out; none if nothing
    /// is left.
    #[must_use]
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        (!values.is_empty()).then_some(Self { values })
    }

    /// The quantile between the nearest two values, linearly.
    #[must_use]
    pub fn quantile(&self, part: f64) -> f64 {
        let place = part * real(self.values.len() - 1);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and the number of values"
        )]
        let below = place.floor() as usize;
        let above = (below + 1).min(self.values.len() - 1);
        let (low, high) = (self.values[below], self.values[above]);
        // With two equal values no rounding.
        if low.total_cmp(&high).is_eq() { low } else { low + (high - low) * (place - real(below)) }
    }

    /// Two values with the median between them, and the probability of that: at least 95 %, or as
    /// much as so few values can give.
    #[must_use]
    pub fn interval_of_median(&self) -> (f64, f64, f64) {
        let n = self.values.len();
        let (mut k, mut confidence) = (1, 1.0 - 2.0 * binomial_tail(n, 0));
        while 2 * (k + 1) <= n && 1.0 - 2.0 * binomial_tail(n, k) >= CONFIDENCE {
            confidence = 1.0 - 2.0 * binomial_tail(n, k);
            k += 1;
        }
        (self.values[k - 1], self.values[n - k], confidence)
    }

    /// How many values there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.len()
    }
}

/// The probability of at most `k` heads in `n` throws of a coin.
fn binomial_tail(n: usize, k: usize) -> f64 {
    // The terms C(n, i) / 2^n, each from the one before.
    let mut term = 0.5_f64.powf(real(n));
    let mut sum = term;
    for i in 1..=k {
        term *= real(n + 1 - i) / real(i);
        sum += term;
    }
    sum
}

#[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 trials")]
fn real(n: usize) -> f64 {
    n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(values: &[f64]) -> Spread {
        Spread::of(values.to_vec()).unwrap()
    }

    #[test]
    fn quantiles_lie_between_the_values() {
        let spread = spread(&[4.0, 1.0, f64::NAN, 3.0, 2.0]);
        // Python: numpy.quantile([1, 2, 3, 4], [0, .25, .5, .75, 1]) = 1, 1.75, 2.5, 3.25, 4.
        let found = [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| spread.quantile(part));
        assert_eq!(format!("{found:?}"), "[1.0, 1.75, 2.5, 3.25, 4.0]");
        assert!(Spread::of(vec![f64::NAN]).is_none());
    }

    #[test]
    fn intervals_of_the_median() {
        // Of 10 values the second and the ninth: 1 - 2 (1 + 10) / 2^10. The third and the eighth
        // have 1 - 2 (1 + 10 + 45) / 2^10 = 0.89 only.
        let ten: Vec<f64> = (1..=10).map(f64::from).collect();
        assert_eq!(spread(&ten).interval_of_median(), (2.0, 9.0, 1.0 - 22.0 / 1024.0));
        // Of 5 all there is, with 1 - 2 / 2^5.
        let five: Vec<f64> = (1..=5).map(f64::from).collect();
        assert_eq!(spread(&five).interval_of_median(), (1.0, 5.0, 1.0 - 2.0 / 32.0));
        assert_eq!(spread(&[7.0]).interval_of_median(), (7.0, 7.0, 0.0));
    }
}
