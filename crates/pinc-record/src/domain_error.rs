//! The error of one step of a net all over its training domain, in numbers and in words.

use crate::metrics::number_or_null;
use pinc_net::DomainError;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// An error that counts as off: so many widths of a state's range.
const OFF: f64 = 0.01;

/// The largest error, and the error in a hundredth of the domain, from which on a reader is warned.
/// Beside a pole a net has 0.5 and 0.3; of the shipped configs with a full training, all but the
/// stiff servo are below, most by far.
const WORST: f64 = 0.2;
const HUNDREDTH: f64 = 0.02;

/// How wrong one step of a net is over its training domain.
///
/// The error of a state is measured in widths of its range in the domain; the error of a point is
/// the largest of its states' errors. Not finite where a step is not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DomainErrorMetrics {
    /// Root mean square over points and states.
    #[serde(deserialize_with = "number_or_null")]
    pub rms: f64,
    /// The 99th percentile over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub p99: f64,
    /// The largest found, by a search from the worst points.
    #[serde(deserialize_with = "number_or_null")]
    pub max: f64,
    /// Where that is.
    pub max_at: Place,
    /// The state that is predicted worst there.
    pub max_of: String,
    /// Its predicted value, in its unit.
    #[serde(deserialize_with = "number_or_null")]
    pub predicted: f64,
    /// Its true value.
    #[serde(deserialize_with = "number_or_null")]
    pub truth: f64,
    /// The share of the points whose error is larger than a hundredth of a width.
    pub share_off: f64,
    /// How many points were looked at.
    pub points: usize,
    /// From how many more the plant cannot be integrated over a step.
    pub unsolved: usize,
    /// The root mean square of RK4 at the same points.
    pub rk4: Rk4Errors,
    /// What is proven of the errors over the whole domain.
    #[serde(default, skip_serializing_if = "ProvenErrors::is_empty")]
    pub proven: ProvenErrors,
}

/// Proven bounds of the error of one step over the domain, of the states in widths of their ranges,
/// where a proof takes little work.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ProvenErrors {
    /// With the net.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub net: Option<f64>,
    /// With RK4, by its substeps.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rk4: BTreeMap<String, f64>,
}

impl ProvenErrors {
    fn is_empty(&self) -> bool {
        self.net.is_none() && self.rk4.is_empty()
    }
}

/// As "the net is proven to be wrong by at most 1.2e-3, RK4 x4 by 2.1e-4"; empty if nothing is
/// proven.
impl fmt::Display for ProvenErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let net = self.net.map(|bound| ("the net".to_owned(), bound));
        let rk4 = self.rk4.iter().map(|(substeps, bound)| (format!("RK4 x{substeps}"), *bound));
        for (i, (model, bound)) in net.into_iter().chain(rk4).enumerate() {
            match i {
                0 => write!(f, "{model} is proven to be wrong by at most {bound:.1e}")?,
                _ => write!(f, ", {model} by {bound:.1e}")?,
            }
        }
        Ok(())
    }
}

/// A state and an input, in the plant's order and units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Place {
    /// The state.
    pub x: Vec<f64>,
    /// The input.
    pub u: Vec<f64>,
    /// The parameters that the net takes as inputs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub p: BTreeMap<String, f64>,
}

/// The errors of RK4 by its substeps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rk4Errors {
    /// With one.
    #[serde(rename = "1", deserialize_with = "number_or_null")]
    pub one: f64,
    /// With two.
    #[serde(rename = "2", deserialize_with = "number_or_null")]
    pub two: f64,
    /// With four.
    #[serde(rename = "4", deserialize_with = "number_or_null")]
    pub four: f64,
}

impl Rk4Errors {
    /// Whether there are any: a black box has none.
    #[must_use]
    pub fn are_known(self) -> bool {
        [self.one, self.two, self.four].iter().any(|error| !error.is_nan())
    }
}

impl DomainErrorMetrics {
    /// Summarizes `judged` for a net with these states and parameters.
    ///
    /// # Panics
    ///
    /// If there are fewer names than states.
    #[must_use]
    pub fn of(
        judged: &DomainError,
        [states, parameters]: [&[String]; 2],
        unsolved: usize,
        rk4: Rk4Errors,
    ) -> Self {
        let worst = &judged.worst;
        let p = parameters.iter().cloned().zip(worst.p.iter().copied()).collect();
        Self {
            rms: judged.rms,
            p99: judged.p99,
            max: judged.max,
            max_at: Place { x: worst.x.clone(), u: worst.u.clone(), p },
            max_of: states[worst.state].clone(),
            predicted: worst.predicted,
            truth: worst.truth,
            share_off: judged.share_beyond(OFF),
            points: judged.errors.len(),
            unsolved,
            rk4,
            proven: ProvenErrors::default(),
        }
    }
}

/// Up to this ratio of the loss on fresh points to that on its sample a net does not overfit.
const FITS: f64 = 2.0;

impl DomainErrorMetrics {
    /// What a user must know of a net that is badly wrong somewhere; `losses` are its loss on its
    /// sample and on fresh points, if they are known.
    #[must_use]
    pub fn finding(
        &self,
        [states, inputs]: [&[String]; 2],
        losses: Option<(f64, f64)>,
    ) -> Option<String> {
        if self.max <= WORST && self.p99 <= HUNDREDTH {
            return None;
        }
        let mut said = "The net is wrong in a part of its domain: ".to_owned();
        if self.share_off > 0.0 {
            said += &format!(
                "{} % of [domain] is off by more than {} % of a state's range after one step; ",
                rounded(100.0 * self.share_off),
                rounded(100.0 * OFF)
            );
        }
        let (place, truth) = (self.max_at.named(states, inputs), rounded(self.truth));
        said += &format!(
            "worst at {place}, where {} is to become {truth} and the net says ",
            self.max_of
        );
        said += &match self.max.is_finite() {
            true => {
                let percent = rounded(100.0 * self.max);
                format!("{} ({percent} % of its range off). ", rounded(self.predicted))
            }
            false => "nothing that is a number. ".to_owned(),
        };
        said += "A controller that plans there is misled: see what pinc check says of poles and \
                 kinks, take a smaller [domain] or a shorter T, ";
        // A net that fits fresh points as well as its sample does not want more of them.
        said += match losses {
            Some((loss, fresh)) if fresh <= FITS * loss => {
                "or a larger net: its loss is the same on fresh points, so that more points would \
                 not help."
            }
            _ => "or a larger net and more training.",
        };
        Some(said)
    }
}

impl Place {
    /// Names with values, as "x = 1, v = 0; u = 0.5".
    #[must_use]
    pub fn named(&self, states: &[String], inputs: &[String]) -> String {
        let named = |names: &[String], values: &[f64]| {
            let pairs = names.iter().zip(values);
            let pairs = pairs.map(|(name, value)| format!("{name} = {}", rounded(*value)));
            pairs.collect::<Vec<_>>().join(", ")
        };
        let (names, values): (Vec<_>, Vec<_>) = self.p.clone().into_iter().unzip();
        let parts = [named(states, &self.x), named(inputs, &self.u), named(&names, &values)];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        parts.join("; ")
    }
}

/// A number with three digits.
fn rounded(value: f64) -> String {
    let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    match rounded.abs() {
        0.0 => "0".to_owned(),
        size if (1e-3..1e6).contains(&size) => rounded.to_string(),
        _ => format!("{rounded:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_net::WorstStep;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    fn judged(errors: Vec<f64>, max: f64) -> DomainErrorMetrics {
        let worst = WorstStep {
            x: vec![2.2, 0.4],
            u: vec![0.36512],
            p: Vec::new(),
            state: 1,
            predicted: -0.310_04,
            truth: 0.876,
        };
        let judged = DomainError { rms: 1e-2, p99: 1e-3, max, worst, errors };
        let rk4 = Rk4Errors { one: 1.0, two: f64::NAN, four: 1e-3 };
        DomainErrorMetrics::of(&judged, [&names(&["X", "S"]), &[]], 0, rk4)
    }

    fn finding(of: &DomainErrorMetrics, losses: Option<(f64, f64)>) -> Option<String> {
        of.finding([&names(&["X", "S"]), &names(&["D"])], losses)
    }

    #[test]
    fn a_net_that_is_wrong_somewhere_is_described_in_plain_words() {
        let mut errors = vec![1e-6; 1000];
        errors[..13].fill(0.3);
        let off = judged(errors, 0.395);
        let said = finding(&off, None).unwrap();
        for part in [
            "1.3 % of [domain] is off by more than 1 % of a state's range after one step",
            "worst at X = 2.2, S = 0.4; D = 0.365, where S is to become 0.876 and the net says -0.31",
            "(39.5 % of its range off)",
            "pinc check",
        ] {
            assert!(said.contains(part), "no `{part}` in {said}");
        }
        assert!(said.ends_with("a larger net and more training."), "{said}");
        assert!(!said.contains("  "), "{said}");
        let said = finding(&off, Some((1e-6, 1.5e-6))).unwrap();
        assert!(said.contains("larger net: its loss is the same on fresh points"), "{said}");
        assert!(!said.contains("  "), "{said}");
        assert!(finding(&off, Some((1e-6, 1e-3))).unwrap().ends_with("more training."));
        // Found by the search only.
        assert!(!finding(&judged(vec![1e-6], 0.395), None).unwrap().contains("0 %"));
        assert_eq!(finding(&judged(vec![1e-3], 0.02), None), None);
    }

    #[test]
    fn values_that_are_not_numbers_are_read_back() {
        let of = judged(vec![f64::INFINITY], f64::INFINITY);
        let text = serde_json::to_string(&of).unwrap();
        assert!(text.contains(r#""rk4":{"1":1.0,"2":null,"4":0.001}"#), "{text}");
        let read: DomainErrorMetrics = serde_json::from_str(&text).unwrap();
        assert!(read.max.is_nan() && read.rk4.two.is_nan());
        assert_eq!((read.max_at, read.share_off), (of.max_at.clone(), 1.0));
        // What is no number is no small error.
        let said = finding(&of, None).unwrap();
        assert!(said.contains("nothing that is a number"), "{said}");
    }
}
