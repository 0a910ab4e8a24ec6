//! The spread of a number over trials.

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
        let place = part * (self.values.len() - 1) as f64;
        #[expect(clippy::cast_possible_truncation, reason = "between 0 and the number of values")]
        let below = place.floor() as usize;
        let above = (below + 1).min(self.values.len() - 1);
        let (low, high) = (self.values[below], self.values[above]);
        // With two equal values no rounding.
        if low.total_cmp(&high).is_eq() { low } else { low + (high - low) * (place - below as f64) }
    }

    /// Two values with the median between them, and the probability of that: at least 95 %, or as
    /// much as so few values can give.
    #[must_use]
    pub fn interval_of_median(&self) -> (f64, f64, f64) {
        let n = self.values.len();
        let mut tails = Tails::new(n);
        let (mut k, mut confidence) = (1, 1.0 - 2.0 * tails.next(0));
        while 2 * (k + 1) <= n {
            let less = 1.0 - 2.0 * tails.next(k);
            if less < CONFIDENCE {
                break;
            }
            (k, confidence) = (k + 1, less);
        }
        (self.values[k - 1], self.values[n - k], confidence)
    }

    /// How many values there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.len()
    }

    /// How many of them are not 0.
    #[must_use]
    pub fn nonzero(&self) -> usize {
        self.values.iter().filter(|value| **value != 0.0).count()
    }
}

/// More throws than this, and the probability of none is too small for a number.
const MANY: usize = 1000;

/// The probabilities of at most 0, 1, 2 .. heads in `n` throws of a coin.
struct Tails {
    n: usize,
    /// C(n, k) / 2^n, or its logarithm if there are many throws.
    term: f64,
    sum: f64,
}

impl Tails {
    fn new(n: usize) -> Self {
        let term = if n > MANY { -(n as f64) * 2.0_f64.ln() } else { 0.5_f64.powf(n as f64) };
        Self { n, term, sum: 0.0 }
    }

    /// The probability of at most `k` heads, after the probabilities of fewer have been asked for.
    fn next(&mut self, k: usize) -> f64 {
        let ratio = if k == 0 { 1.0 } else { (self.n + 1 - k) as f64 / k as f64 };
        if self.n > MANY {
            self.term += ratio.ln();
            self.sum += self.term.exp();
        } else {
            self.term *= ratio;
            self.sum += self.term;
        }
        self.sum
    }
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

    #[test]
    fn the_interval_of_very_many_values_is_narrow() {
        // Python, with math.comb.
        for (n, first, confidence) in
            [(2000_u32, 956.0, 0.953_447_179_508), (10_000, 4902.0, 0.951_167_050_103_6)]
        {
            let values: Vec<f64> = (1..=n).map(f64::from).collect();
            let (low, high, found) = spread(&values).interval_of_median();
            assert_eq!((low, high), (first, f64::from(n) + 1.0 - first));
            assert!((found - confidence).abs() < 1e-9, "{found}");
        }
    }
}
