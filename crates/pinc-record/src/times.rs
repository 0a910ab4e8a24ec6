//! Statistics of the controller's times.

use serde::{Deserialize, Serialize};

/// Statistics over repetitions, in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WallTimes {
    /// The mean.
    pub mean: f64,
    /// The standard deviation (with n - 1; 0 for one run).
    pub sd: f64,
    /// The median.
    pub median: f64,
    /// The number of repetitions.
    pub runs: usize,
}

impl WallTimes {
    /// The statistics of these times, of which there is at least one.
    ///
    /// # Panics
    ///
    /// If there are none.
    #[must_use]
    pub fn of(mut times: Vec<f64>) -> Self {
        times.sort_unstable_by(f64::total_cmp);
        let (runs, freedom) = (times.len() as f64, times.len().saturating_sub(1).max(1) as f64);
        let mean = times.iter().sum::<f64>() / runs;
        let squares: f64 = times.iter().map(|t| (t - mean).powi(2)).sum();
        let middle = times.len() / 2;
        let median = if times.len().is_multiple_of(2) {
            f64::midpoint(times[middle - 1], times[middle])
        } else {
            times[middle]
        };
        Self { mean, sd: (squares / freedom).sqrt(), median, runs: times.len() }
    }
}

/// The median of at least one number.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    WallTimes::of(values.to_vec()).median
}

/// A number of points or operations.
#[must_use]
pub fn to_f64(n: u64) -> f64 {
    n as f64
}

/// Statistics over all steps of all repetitions, in microseconds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepTimes {
    /// The median.
    pub p50: f64,
    /// The 99th percentile.
    pub p99: f64,
    /// The longest.
    pub max: f64,
}

impl StepTimes {
    /// The statistics of these times, of which there is at least one, by the nearest-rank method.
    ///
    /// # Panics
    ///
    /// If there are none.
    #[must_use]
    pub fn of(mut times: Vec<f64>) -> Self {
        times.sort_unstable_by(f64::total_cmp);
        let rank = |percent: usize| times[(times.len() * percent).div_ceil(100).max(1) - 1];
        Self { p50: rank(50), p99: rank(99), max: rank(100) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_times() {
        let wall = WallTimes::of(vec![4.0, 1.0, 2.0, 3.0]);
        // Squares about the mean 2.5 sum up to 5.
        let expected = WallTimes { mean: 2.5, sd: (5.0f64 / 3.0).sqrt(), median: 2.5, runs: 4 };
        assert_eq!(wall, expected);
        assert_eq!(WallTimes::of(vec![7.0]).sd.to_bits(), 0.0f64.to_bits());

        let steps = StepTimes::of((1..=200).map(f64::from).rev().collect());
        assert_eq!(steps, StepTimes { p50: 100.0, p99: 198.0, max: 200.0 });
    }
}
