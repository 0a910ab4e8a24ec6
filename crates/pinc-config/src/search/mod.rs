//! The table `[sweep.search]`: candidates drawn at random, and successive halving among them.

#[cfg(test)]
mod tests;

use crate::validate::Checked;
use crate::validate::values::{at_least_one, value};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use toml::Value;

/// The stream of random numbers that candidates come from; those below are others'.
const STREAM: u64 = 1 << 34;

/// Most rungs of a halving.
const MOST_RUNGS: usize = 20;

/// Candidates drawn at random from the experiment's seed, among which the best one is found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchSpec {
    /// Number of candidates.
    pub candidates: usize,
    /// Column of `sweep.csv` whose median over seeds and draws is minimized.
    pub minimize: String,
    /// Values that are drawn, independently of one another.
    pub ranges: Vec<SearchRange>,
    /// Successive halving; every candidate is run in full if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub halving: Option<HalvingSpec>,
}

/// A value that is drawn from a range, or from a list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchRange {
    /// Key path, as `--set` has it.
    pub key: String,
    /// Key paths that take the same value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<String>,
    /// Lower end of the range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Upper end of the range.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// Whether the logarithm of the value is drawn uniformly, rather than the value.
    #[serde(default)]
    pub log: bool,
    /// Whether the value is a whole number.
    #[serde(default)]
    pub whole: bool,
    /// Values to choose from, each with the same probability.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<Value>,
}

/// Successive halving: all candidates get a small budget, and the best of each rung a larger one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HalvingSpec {
    /// Key path of the budget, a whole number.
    pub key: String,
    /// Key paths that take the same value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<String>,
    /// Budget of the first rung.
    pub least: i64,
    /// Factor by which the budget grows, and the number of candidates shrinks, from rung to rung.
    pub factor: i64,
    /// Number of rungs.
    pub rungs: usize,
}

impl HalvingSpec {
    /// The budget of a rung, from 0.
    #[must_use]
    pub fn budget(&self, rung: usize) -> i64 {
        (0..rung).fold(self.least, |budget, _| budget.saturating_mul(self.factor))
    }

    /// How many of so many candidates reach a rung.
    #[must_use]
    pub fn survivors(&self, candidates: usize, rung: usize) -> usize {
        let factor = usize::try_from(self.factor).unwrap_or(usize::MAX);
        (0..rung).fold(candidates, |left, _| left.div_ceil(factor)).max(1)
    }
}

/// A key and those that take the same value, each with its place in the table `here`.
pub(crate) fn placed<'a>(here: &str, key: &'a str, also: &'a [String]) -> Vec<(String, &'a str)> {
    let also = also.iter().map(|key| (format!("{here}.also"), key.as_str()));
    std::iter::once((format!("{here}.key"), key)).chain(also).collect()
}

impl SearchSpec {
    /// How many rungs there are.
    #[must_use]
    pub fn rungs(&self) -> usize {
        self.halving.as_ref().map_or(1, |halving| halving.rungs)
    }

    /// The keys that are set, each with its place in the config.
    pub(crate) fn keys(&self) -> Vec<(String, &str)> {
        let ranges = self.ranges.iter().enumerate();
        let ranges = ranges.flat_map(|(i, range)| {
            placed(&format!("sweep.search.ranges[{i}]"), &range.key, &range.also)
        });
        let halving = self.halving.iter();
        let halving = halving.flat_map(|of| placed("sweep.search.halving", &of.key, &of.also));
        ranges.chain(halving).collect()
    }

    /// Checks what can be checked without looking at the trials.
    pub(crate) fn validate(&self) -> Checked {
        let key = |name: &str| format!("sweep.search.{name}");
        at_least_one(&key("candidates"), self.candidates)?;
        if self.ranges.is_empty() {
            return value(&key("ranges"), "[]", "one range or more");
        }
        for (i, range) in self.ranges.iter().enumerate() {
            range.check(&key(&format!("ranges[{i}]")))?;
        }
        let Some(halving) = &self.halving else { return Ok(()) };
        if halving.least < 1 {
            return value(&key("halving.least"), halving.least, "1 or more");
        }
        if halving.factor < 2 {
            return value(&key("halving.factor"), halving.factor, "2 or more");
        }
        match (2..=MOST_RUNGS).contains(&halving.rungs) {
            true => Ok(()),
            false => value(&key("halving.rungs"), halving.rungs, "from 2 to 20"),
        }
    }

    /// The candidates, each with a value for each range: the first ones are the same however many there are.
    pub(crate) fn drawn(&self, seed: u64) -> Vec<Vec<Value>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(STREAM);
        let mut candidate =
            || self.ranges.iter().map(|range| range.value(rng.random::<f64>())).collect();
        (0..self.candidates).map(|_| candidate()).collect()
    }
}

impl SearchRange {
    /// Checks that this, which has the key `key`, is a range or a list.
    pub(crate) fn check(&self, key: &str) -> Checked {
        let (low, high) = match (self.low, self.high) {
            (Some(low), Some(high)) if self.values.is_empty() => (low, high),
            (None, None) if !self.values.is_empty() => return Ok(()),
            _ => {
                let found = format!("`{}`", self.key);
                return value(key, found, "either low and high, or values");
            }
        };
        let expected = if low >= high {
            "a lower end below the upper end"
        } else if self.log && low <= 0.0 {
            "positive ends, to draw the logarithm"
        } else if self.whole && (low.fract() != 0.0 || high.fract() != 0.0) {
            "whole ends of a range of whole numbers"
        } else {
            return Ok(());
        };
        value(key, format!("{low} to {high}"), expected)
    }

    /// The value at a place from 0 to 1, of four digits: the last bits of a logarithm do not matter.
    pub(crate) fn value(&self, place: f64) -> Value {
        let (Some(low), Some(high)) = (self.low, self.high) else {
            let count = self.values.len();
            #[expect(clippy::cast_possible_truncation, reason = "a place in a short list")]
            let i = (place * count as f64) as usize;
            return self.values[i.min(count - 1)].clone();
        };
        let ends = self.ends(low, high);
        let drawn = ends.0 + (ends.1 - ends.0) * place;
        let drawn = if self.log { drawn.exp() } else { drawn };
        if self.whole {
            #[expect(clippy::cast_possible_truncation, reason = "between whole numbers")]
            return Value::Integer(drawn.round().clamp(low, high) as i64);
        }
        let short: f64 = format!("{drawn:.3e}").parse().unwrap_or(drawn);
        Value::Float(short.clamp(low, high))
    }

    /// The place of a value in the range, from 0 to 1.
    pub(crate) fn place(&self, value: f64) -> f64 {
        let (Some(low), Some(high)) = (self.low, self.high) else { return 0.5 };
        let value = value.clamp(low, high);
        let (first, last) = self.ends(low, high);
        let value = if self.log { value.ln() } else { value };
        (value - first) / (last - first)
    }

    /// What the values at the places 0 and 1 are, or their logarithms.
    fn ends(&self, low: f64, high: f64) -> (f64, f64) {
        let ends = if self.whole { (low - 0.5, high + 0.5) } else { (low, high) };
        if self.log { (ends.0.max(0.5 * low).ln(), ends.1.ln()) } else { ends }
    }
}
