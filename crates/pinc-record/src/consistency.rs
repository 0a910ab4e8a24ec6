//! The consistency of an estimator: errors against their claimed spread.

use crate::metrics::EstimatorMetrics;
use crate::verdict::{Finding, significant};
use std::ops::RangeInclusive;

/// A mean square is far above its interval if it is more than this many times what it is of a
/// consistent estimator. A plant that differs a little from its model leaves the interval, too.
///
/// A mean below the interval is no finding: in a loop without noise errors are smaller than any
/// useful tuning allows for.
const FAR_ABOVE: f64 = 2.0;
/// The interval holds the mean square of a consistent estimator with a probability of 99.9 %: so
/// many standard deviations of a normal distribution.
const NORMAL_999: f64 = 3.2905;

/// The mean of normalized squares of an estimator.
#[derive(Clone, Debug, PartialEq)]
struct MeanSquare {
    /// What they are of: NIS or NEES.
    name: &'static str,
    /// The mean.
    mean: f64,
    /// What it is of a consistent estimator.
    expected: f64,
    /// Over how many steps.
    steps: usize,
}

impl EstimatorMetrics {
    /// Returns what a reader should know of the estimator after this many steps, with advice.
    #[must_use]
    pub fn notes(&self, steps: usize) -> Vec<String> {
        findings(self, steps).iter().map(Finding::to_string).collect()
    }
}

/// What a reader should know of `estimator` after `steps`.
pub(crate) fn findings(estimator: &EstimatorMetrics, steps: usize) -> Vec<Finding> {
    let EstimatorMetrics { nis_mean, nis_expected, nis_steps, nees_mean, nees_steps, .. } =
        *estimator;
    let mut findings = Vec::new();
    let nis = MeanSquare { name: "NIS", mean: nis_mean, expected: nis_expected, steps: nis_steps };
    let states = estimator.estimate_rmse.len() as f64;
    let nees = MeanSquare { name: "NEES", mean: nees_mean, expected: states, steps: nees_steps };
    // One is enough: what is to be changed is the same.
    findings.extend([nis, nees].iter().find(|of| of.is_far_above()).map(MeanSquare::finding));
    if let Some(kept) = estimator.estimator_status.get("not-finite") {
        findings.push(Finding::new(
            format!(
                "the model was not finite at the estimate {kept} times in {steps} steps, and the last \
                 estimate was kept."
            ),
            "The estimate has left the states at which the model is defined, mostly after wild \
             measurements, and only a reset brings it back: set low and high in \
             [control.estimator], or narrow its gate.",
        ));
    }
    let undefined = estimator.nis_undefined;
    if undefined > 0 {
        findings.push(Finding::new(
            format!(
                "the NIS is undefined in {undefined} of {steps} steps and is left out of its mean."
            ),
            "The covariance was singular to working precision there: bring the standard \
             deviations in [control.estimator] closer together.",
        ));
    }
    if !estimator.rejected.is_empty() {
        let each = estimator.rejected.iter().map(|(name, count)| format!("{count} of {name}"));
        let each = each.collect::<Vec<_>>().join(", ");
        findings.push(Finding::new(
            format!("in {steps} steps the estimator's gate rejected measurements: {each}."),
            "They were too far from what was expected, and counted as missing. Look at the \
             sensor; if it is right, raise process_sd or disturbance_sd in [control.estimator], or \
             widen its gate.",
        ));
    }
    findings
}

impl MeanSquare {
    /// The interval of the mean of a consistent estimator, by Wilson and Hilferty's approximation of
    /// the chi-squared distribution.
    fn interval(&self) -> RangeInclusive<f64> {
        let spread = 2.0 / (9.0 * self.expected * self.steps as f64);
        let quantile = |normal: f64| {
            let root = 1.0 - spread + normal * spread.sqrt();
            self.expected * root.max(0.0).powi(3)
        };
        quantile(-NORMAL_999)..=quantile(NORMAL_999)
    }

    fn is_far_above(&self) -> bool {
        // Without any step there is no mean.
        self.mean > FAR_ABOVE * self.expected && self.mean > *self.interval().end()
    }

    /// What a mean far above its interval says: the estimator is overconfident.
    fn finding(&self) -> Finding {
        let (low, high) = self.interval().into_inner();
        let [mean, expected, low, high] = [self.mean, self.expected, low, high].map(significant);
        Finding::new(
            format!(
                "the estimator is inconsistent: its mean {} is {mean}, where a consistent one has \
                 {expected} ({low} to {high} over {} steps).",
                self.name, self.steps
            ),
            "Its errors are larger than it believes: raise process_sd and disturbance_sd in \
             [control.estimator], or measurement_sd if the sensors are noisier than it says; if \
             innovations keep their sign, estimate a disturbance or a parameter where plant and \
             model differ.",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(mean: f64, steps: usize) -> MeanSquare {
        MeanSquare { name: "NIS", mean, expected: 3.0, steps }
    }

    /// The 0.05 % and 99.95 % quantiles of the chi-squared distribution with 300 degrees of freedom
    /// are 225.886 and 387.203.
    #[test]
    fn the_interval_matches_the_chi_squared_distribution() {
        let (low, high) = square(3.0, 100).interval().into_inner();
        assert!((low - 2.258_86).abs() < 1e-3 && (high - 3.872_03).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn a_mean_far_above_is_named_with_its_numbers() {
        for (mean, steps, is_far) in
            [(108.0, 144, true), (5.9, 144, false), (6.1, 144, true), (0.015, 144, false)]
        {
            assert_eq!(square(mean, steps).is_far_above(), is_far, "{mean}");
        }
        // A few steps say little.
        assert!(!square(6.1, 2).is_far_above());
        assert!(!square(f64::NAN, 0).is_far_above());
        let said = square(108.0, 144).finding().to_string();
        assert!(said.contains("mean NIS is 108, where a consistent one has 3.00 ("), "{said}");
    }
}
