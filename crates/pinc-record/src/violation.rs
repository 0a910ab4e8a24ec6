//! Bounds that the plant in a closed loop broke.

use crate::verdict::significant;
use pinc_config::TimeUnit;
use pinc_loop::Violation;
use pinc_mpc::Side;
use serde::{Deserialize, Serialize};

/// The share of a quantity's size from which on a broken bound is worth a word.
const VISIBLE: f64 = 1e-4;

/// The worst violation of a bound, on the dense trace of a closed loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViolationMetrics {
    /// The state, input or output.
    pub of: String,
    /// Its unit; empty if it has none.
    pub unit: String,
    /// Which of its bounds: `low` or `high`.
    pub side: String,
    /// The bound, in that unit.
    pub bound: f64,
    /// Whether it is hard; a soft one may be broken at a cost.
    pub hard: bool,
    /// By how much it was broken, in that unit.
    pub amount: f64,
    /// When, in s from the beginning of the loop.
    pub time_s: f64,
    /// By how much it was broken at the ends of control steps, at most; 0 if it held there.
    pub at_steps: f64,
    /// The amount as a share of the quantity's largest absolute value.
    pub share: f64,
    /// The step of a plan from which on the controller keeps it: `n1` for outputs, 1 for others.
    #[serde(default)]
    pub from_step: usize,
}

impl ViolationMetrics {
    /// The violation of a bound of the quantity `of`, which plans keep from a step on.
    #[must_use]
    pub fn new(violation: &Violation, of: &str, unit: &str, from_step: usize) -> Self {
        Self {
            of: of.to_owned(),
            unit: unit.to_owned(),
            side: match violation.side {
                Side::Low => "low",
                Side::High => "high",
            }
            .to_owned(),
            bound: violation.bound,
            hard: violation.hard,
            amount: violation.amount,
            time_s: violation.time_s,
            at_steps: violation.at_steps,
            share: violation.share(),
            from_step,
        }
    }

    /// Whether a hard bound was broken by more than rounding and the optimizer's tolerance.
    #[must_use]
    pub fn is_noteworthy(&self) -> bool {
        self.hard && self.is_visible()
    }

    /// Whether the bound, of whatever softness, was broken by more than these.
    pub(crate) fn is_visible(&self) -> bool {
        self.share > VISIBLE
    }

    /// Whether the bound held at the ends of control steps, as far as is visible.
    #[must_use]
    pub fn is_between_steps(&self) -> bool {
        self.at_steps * self.share <= VISIBLE * self.amount
    }

    /// The violation in words, as `0.031 m above 1 m at 3.2 s`.
    #[must_use]
    pub fn shown(&self, time_unit: Option<TimeUnit>) -> String {
        let unit = match &*self.unit {
            "" => String::new(),
            unit => format!(" {unit}"),
        };
        let side = if self.side == "low" { "below" } else { "above" };
        format!(
            "{}{unit} {side} {}{unit} at {}",
            significant(self.amount),
            self.bound,
            TimeUnit::shown(self.time_s, time_unit)
        )
    }
}
