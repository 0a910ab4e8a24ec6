//! Scaling to zero mean and unit standard deviation.

use serde::{Deserialize, Serialize};

/// Means and standard deviations of a vector: z = (v - mean) / std.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Normalizer {
    /// The means.
    pub mean: Vec<f64>,
    /// The standard deviations, all positive.
    pub std: Vec<f64>,
}

impl Normalizer {
    /// The normalizer of independent uniform distributions between the given ends: the mean is the
    /// middle, the standard deviation the width over the root of 12.
    pub(crate) fn of_uniform(ends: impl Iterator<Item = (f64, f64)>) -> Self {
        let (mean, std) = ends
            .map(|(low, high)| (f64::midpoint(low, high), (high - low) / 12.0_f64.sqrt()))
            .unzip();
        Self { mean, std }
    }
}
