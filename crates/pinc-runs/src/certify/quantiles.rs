//! Upper bounds of quantiles from a sample, whatever the distribution.

/// A number that is at least the `quantile` of the distribution with probability `confidence`, from
/// values drawn independently; none if they are too few.
///
/// The k-th smallest of n values is at least the quantile unless k or more of them are below it,
/// which a binomial distribution says.
pub(super) fn upper_bound(mut values: Vec<f64>, quantile: f64, confidence: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53")]
    let number = |count: usize| count as f64;
    // The probability that exactly k values are below, in logarithms, and that at most so many are.
    let mut log_probability = number(n) * (1.0 - quantile).ln();
    let mut at_most = 0.0;
    for (k, value) in values.iter().enumerate() {
        at_most += log_probability.exp();
        if at_most >= confidence {
            return value.is_finite().then_some(*value);
        }
        let odds = (quantile / (1.0 - quantile)).ln();
        log_probability += odds + number(n - k).ln() - number(k + 1).ln();
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of 10 values the median is below the ninth with a probability of 1 - 11 / 1024.
    #[test]
    fn bounds_of_the_median_of_ten() {
        let values: Vec<f64> = (1..=10).rev().map(f64::from).collect();
        let bound = |confidence| upper_bound(values.clone(), 0.5, confidence);
        assert_eq!(bound(0.989), Some(9.0));
        assert_eq!(bound(0.9895), Some(10.0));
        assert_eq!(bound(0.9999), None);
        assert_eq!(upper_bound(vec![1.0, f64::INFINITY], 0.5, 0.6), None);
        assert_eq!(upper_bound(Vec::new(), 0.5, 0.5), None);
        // With 459 values the largest is above the 0.99 quantile with 99 % confidence, with 458 it
        // is not known to be.
        let of = |n: u32| upper_bound((0..n).map(f64::from).collect(), 0.99, 0.99);
        assert_eq!((of(458), of(459)), (None, Some(458.0)));
    }
}
