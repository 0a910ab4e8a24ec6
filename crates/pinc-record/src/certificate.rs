//! `certify.json`: what is known of the errors of one step of a model.

use crate::error::RecordError;
use crate::files::{file, json, read_json};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Values of states, inputs and parameters by their names.
pub type ByName = BTreeMap<String, f64>;

/// The results of `pinc certify`, with errors in the states' units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CertificateMetrics {
    /// The experiment's name.
    pub experiment: String,
    /// The model.
    pub model: String,
    /// Length T of the step in s.
    pub step_s: f64,
    /// How many predictions were judged.
    pub points: usize,
    /// From what the random ones were drawn.
    pub seed: u64,
    /// How many of them have no proven bound for some state.
    pub unproven_points: usize,
    /// The median of the proven bounds over the errors; nothing without bounds.
    pub bound_over_error_median: Option<f64>,
    /// The relative difference between the first-order estimate and the error, over the points whose
    /// error is known; nothing for other models than nets.
    #[serde(default)]
    pub estimate_difference_median: Option<f64>,
    /// Its 99th percentile.
    #[serde(default)]
    pub estimate_difference_p99: Option<f64>,
    /// Statistical upper bounds of quantiles of the absolute error, by the quantile and the state;
    /// nothing where the random points are too few, or none were drawn.
    pub quantiles: BTreeMap<String, BTreeMap<String, Option<f64>>>,
    /// With what probability each of these is at least the quantile.
    pub confidence: f64,
    /// Why there are no proofs, where that is so.
    pub refused: Option<String>,
    /// The proof over the whole domain.
    pub domain: Option<DomainCertificate>,
}

/// The largest error over a domain, from both sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DomainCertificate {
    /// Proven bounds, wherever there are any; empty if there are none.
    pub proven: ByName,
    /// The largest errors found.
    pub found: ByName,
    /// Where each was found.
    pub at: BTreeMap<String, ByName>,
    /// The share of the domain in which nothing is proven.
    pub unproven_volume: f64,
    /// Whether the search is over; if not, more time may bring the bounds down.
    pub complete: bool,
    /// Parts that the domain was cut into.
    pub leaves: usize,
    /// Boxes that were enclosed.
    pub boxes: u64,
    /// The domain: the ends of each variable.
    pub ends: BTreeMap<String, [f64; 2]>,
}

impl CertificateMetrics {
    /// Those in a directory; `None` if there are none.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if the file cannot be read or is damaged.
    pub fn read(dir: &Path) -> Result<Option<Self>, RecordError> {
        read_json(&dir.join(file::CERTIFY))
    }

    /// The text of the file.
    #[must_use]
    pub fn to_json(&self) -> String {
        json(self)
    }
}

/// The results in some lines.
impl fmt::Display for CertificateMetrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: one step of {} s of {}", self.experiment, self.step_s, self.model)?;
        if let Some(reason) = &self.refused {
            write!(f, "\nno proof: {reason}")?;
        }
        if self.points > 0 {
            write!(f, "\n{} points, {} without a bound", self.points, self.unproven_points)?;
            if let Some(ratio) = self.bound_over_error_median {
                write!(f, "; median of bound over error {ratio:.3}")?;
            }
            if let (Some(median), Some(p99)) =
                (self.estimate_difference_median, self.estimate_difference_p99)
            {
                let [median, p99] = [100.0 * median, 100.0 * p99];
                write!(
                    f,
                    "\nthe estimate differs from the error by {median:.2} % of it (median), {p99:.1} % \
                     (99th percentile)"
                )?;
            }
        }
        for (quantile, states) in &self.quantiles {
            let known = states.iter().filter_map(|(state, bound)| Some((state, bound.as_ref()?)));
            for (state, bound) in known {
                let confidence = 100.0 * self.confidence;
                write!(
                    f,
                    "\n{state}: {quantile} of all errors are below {bound:.3e}, with {confidence} % \
                     confidence (statistical)"
                )?;
            }
        }
        self.domain.as_ref().map_or(Ok(()), |domain| domain.fmt(f))
    }
}

impl fmt::Display for DomainCertificate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_whole = self.unproven_volume <= 0.0;
        for (state, found) in &self.found {
            let Some(proven) = self.proven.get(state) else {
                write!(f, "\n{state}: nothing proven, found {found:.3e}")?;
                continue;
            };
            let place = if is_whole { "over the domain" } else { "where anything is proven" };
            write!(f, "\n{state}: proven at most {proven:.3e} {place}, found {found:.3e}")?;
            if is_whole {
                write!(f, " (ratio {:.3})", proven / found)?;
            }
        }
        if !is_whole {
            let share = 100.0 * self.unproven_volume;
            write!(f, "\nnothing is proven in {share:.3} % of the domain's volume")?;
        }
        if self.complete {
            return Ok(());
        }
        f.write_str("\nthe search is not over: --resume continues it")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn by_name(values: &[(&str, f64)]) -> ByName {
        values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
    }

    fn domain() -> DomainCertificate {
        DomainCertificate {
            proven: by_name(&[("h", 3e-4)]),
            found: by_name(&[("h", 1.5e-4), ("v", 2e-5)]),
            at: BTreeMap::new(),
            unproven_volume: 0.0,
            complete: true,
            leaves: 5,
            boxes: 9,
            ends: BTreeMap::new(),
        }
    }

    fn certificate() -> CertificateMetrics {
        let quantile = [("h".to_owned(), Some(1e-3)), ("v".to_owned(), None)].into();
        CertificateMetrics {
            experiment: "tank".to_owned(),
            model: "the net".to_owned(),
            step_s: 0.5,
            points: 1000,
            seed: 1,
            unproven_points: 3,
            bound_over_error_median: Some(1.25),
            estimate_difference_median: Some(0.001),
            estimate_difference_p99: Some(0.02),
            quantiles: [("0.99".to_owned(), quantile)].into(),
            confidence: 0.95,
            refused: None,
            domain: Some(domain()),
        }
    }

    /// Each number is said with what it is of: ratios as bound over error, shares in percent.
    #[test]
    fn a_certificate_says_what_is_proven_and_what_is_likely() {
        assert_eq!(
            certificate().to_string(),
            "tank: one step of 0.5 s of the net\n1000 points, 3 without a bound; median of bound over \
             error 1.250\nthe estimate differs from the error by 0.10 % of it (median), 2.0 % (99th \
             percentile)\nh: 0.99 of all errors are below 1.000e-3, with 95 % confidence \
             (statistical)\nh: proven at most 3.000e-4 over the domain, found 1.500e-4 (ratio 2.000)\n\
             v: nothing proven, found 2.000e-5"
        );
        let part = DomainCertificate { unproven_volume: 0.0125, complete: false, ..domain() };
        assert_eq!(
            part.to_string(),
            "\nh: proven at most 3.000e-4 where anything is proven, found 1.500e-4\n\
             v: nothing proven, found 2.000e-5\nnothing is proven in 1.250 % of the domain's \
             volume\nthe search is not over: --resume continues it"
        );
        let refused = CertificateMetrics {
            refused: Some("a kink".to_owned()),
            points: 0,
            quantiles: BTreeMap::new(),
            domain: None,
            ..certificate()
        };
        assert_eq!(refused.to_string(), "tank: one step of 0.5 s of the net\nno proof: a kink");
        let read: CertificateMetrics = serde_json::from_str(&certificate().to_json()).unwrap();
        assert_eq!(read, certificate());
    }
}
