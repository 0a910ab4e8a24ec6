//! Upper bounds of quantiles from a sample, whatever the distribution.

/// A number that is at least the `quantile` of the distribution with probability `confidence`, from
/// values drawn independently; none if they are too few.
///
/// The k-th smallest of n values is at least the quantile unless k or more of them are below it,
/// which a binomial distribution says.
#[must_use]
pub fn quantile_bound(mut values: Vec<f64>, quantile: f64, confidence: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
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
mod tests;
