//! The section `control` of `metrics.json`, and its rows in the table of metrics.

use super::{OutsideDomain, nan, number_or_null};
use crate::times::{StepTimes, WallTimes};
use crate::violation::ViolationMetrics;
use pinc_config::ModelKind;
use pinc_mpc::SqpStatus;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;

/// How good one closed loop is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlMetrics {
    /// The model inside the controller.
    pub model: ModelKind,
    /// RMSE as printed: at the steps.
    #[serde(deserialize_with = "number_or_null")]
    pub rmse: f64,
    /// IAE as printed: at the steps, averaged over outputs.
    #[serde(deserialize_with = "number_or_null")]
    pub iae: f64,
    /// RMSE on the dense trace.
    #[serde(deserialize_with = "number_or_null")]
    pub rmse_dense: f64,
    /// IAE on the dense trace, summed over outputs.
    #[serde(deserialize_with = "number_or_null")]
    pub iae_dense_sum: f64,
    /// How far the inputs move from step to step, all added up, in widths of their bounds.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub input_travel: f64,
    /// Time of the controller in one whole closed loop.
    pub wall_s: WallTimes,
    /// Time of the controller in one step.
    pub step_us: StepTimes,
    /// SQP iterations per step.
    pub sqp_iterations_mean: f64,
    /// The largest KKT residual of a step.
    #[serde(deserialize_with = "number_or_null")]
    pub kkt_max: f64,
    /// The worst violation of a bound by the plant's state, input or output: the largest number,
    /// whatever its unit.
    #[serde(deserialize_with = "number_or_null")]
    pub max_violation: f64,
    /// Which bound that is; not there if none was broken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_violation_of: Option<ViolationMetrics>,
    /// The bounds that were broken, each with its worst violation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<ViolationMetrics>,
    /// How many steps ended with which status.
    pub status: BTreeMap<String, usize>,
    /// What the plans of a `[control.cost]` cost; not there without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<CostMetrics>,
    /// From which of several starts the first plan was found; not there with one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<FirstPlanMetrics>,
    /// What the tube of `[control.uncertainty]` left of the bounds; not there without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tube: Option<TubeMetrics>,
    /// Whether the references were reached.
    #[serde(flatten)]
    pub references: ReferenceMetrics,
    /// Whether the net was used outside its training domain; not there for other models.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside_domain: Option<OutsideDomain>,
    /// The estimated error of the net, where `control.error_tolerance` asks for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_error: Option<ModelErrorMetrics>,
    /// How good the estimates were, where the controller was told of estimates.
    #[serde(flatten)]
    pub estimator: Option<EstimatorMetrics>,
}

/// The plans of a loop with a `[control.cost]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CostMetrics {
    /// The cost of the first plan.
    #[serde(deserialize_with = "number_or_null")]
    pub first_plan: f64,
    /// In how many steps negative curvature was dropped: plans that meet the first-order conditions,
    /// without proof that they are minima.
    pub curvature_dropped: usize,
}

impl std::fmt::Display for CostMetrics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.first_plan.is_finite() {
            true => write!(f, "the first plan costs {:.7}", self.first_plan),
            false => write!(f, "the first step has no plan whose cost is known"),
        }
    }
}

/// The start of the cheapest plan, where `control.sqp.starts` asked for several.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FirstPlanMetrics {
    /// How many starts were asked for; the budget may have ended the step before the last.
    pub starts: usize,
    /// The start of the plan, counted from 0: the start without others.
    pub best: usize,
}

impl std::fmt::Display for FirstPlanMetrics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.best {
            0 => write!(f, "no other of {} starts gives a cheaper first plan", self.starts),
            best => {
                let last = self.starts.saturating_sub(1);
                write!(f, "start {best} of 0 to {last} gives the first plan")
            }
        }
    }
}

/// How often the bounds that a tube tightened could not be kept.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TubeMetrics {
    /// How many plans there were.
    pub steps: usize,
    /// How many of them were beyond a tightened bound, or had bounds that left no room: the plant may
    /// break its bounds.
    pub without_room: usize,
    /// The first of these, counted from 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first: Option<usize>,
}

impl TubeMetrics {
    /// Counts a plan, which `fits` or does not.
    pub fn add(&mut self, fits: bool) {
        if !fits {
            self.first.get_or_insert(self.steps);
            self.without_room += 1;
        }
        self.steps += 1;
    }
}

impl std::fmt::Display for TubeMetrics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { steps, without_room, first } = self;
        match first {
            None => write!(f, "all {steps} plans keep the bounds of the tube"),
            Some(first) => write!(
                f,
                "{without_room} of {steps} plans do not keep the bounds of the tube, the first in \
                 step {first}: the plant may break its bounds there"
            ),
        }
    }
}

/// How often the estimated error of the net in the first step of a plan was beyond its tolerance.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelErrorMetrics {
    /// How many plans were judged.
    pub steps: usize,
    /// In how many of them the error of some state was beyond its tolerance, or not finite.
    pub beyond: usize,
    /// The largest absolute estimate of each state with a tolerance, in its unit.
    #[serde(deserialize_with = "numbers_or_null")]
    pub largest: BTreeMap<String, f64>,
    /// The tolerances, in the states' units.
    pub tolerance: BTreeMap<String, f64>,
}

/// Numbers of which JSON has `null` in place of NaN and infinity.
fn numbers_or_null<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<BTreeMap<String, f64>, D::Error> {
    let read: BTreeMap<String, Option<f64>> = BTreeMap::deserialize(deserializer)?;
    Ok(read.into_iter().map(|(name, value)| (name, value.unwrap_or(f64::INFINITY))).collect())
}

impl std::fmt::Display for ModelErrorMetrics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (beyond, steps) = (self.beyond, self.steps);
        write!(f, "estimated error beyond control.error_tolerance in {beyond} of {steps} steps")?;
        for (i, (name, largest)) in self.largest.iter().enumerate() {
            let separator = if i == 0 { ": " } else { ", " };
            write!(f, "{separator}{name} at most {largest:.1e}")?;
        }
        Ok(())
    }
}

/// How good the estimates of a closed loop are, and whether the estimator is as sure of itself as
/// it may be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorMetrics {
    /// The mean of the normalized innovations squared, over the steps that have one.
    #[serde(deserialize_with = "number_or_null")]
    pub nis_mean: f64,
    /// Its value for a consistent estimator: the mean number of measurements used in these steps.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub nis_expected: f64,
    /// How many steps have one.
    #[serde(default)]
    pub nis_steps: usize,
    /// How many steps have none although there were measurements to use.
    #[serde(default)]
    pub nis_undefined: usize,
    /// The mean of the normalized errors squared: of a consistent estimator, the number of states.
    #[serde(deserialize_with = "number_or_null")]
    pub nees_mean: f64,
    /// How many steps have one: the others have a singular covariance.
    #[serde(default)]
    pub nees_steps: usize,
    /// How many measurements of each quantity the estimator's gate rejected, where it rejected any.
    #[serde(default)]
    pub rejected: BTreeMap<String, usize>,
    /// The nearest value that can be held at the end, of each controlled quantity whose reference
    /// cannot, with `control.target`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub nearest_held: BTreeMap<String, f64>,
    /// In how many steps the search for such a state did not converge: they follow the references.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub targets_not_found: Option<usize>,
    /// The root mean square error of each state's estimate at the step marks, in its unit.
    pub estimate_rmse: BTreeMap<String, f64>,
    /// Time of a correction and a prediction together.
    pub estimator_us: StepTimes,
    /// How many corrections ended with which status, and how many predictions with another than
    /// updated.
    pub estimator_status: BTreeMap<String, usize>,
}

impl ControlMetrics {
    /// How many steps there were.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.status.values().sum()
    }

    /// The worst violation of a bound as a share of the size of what it bounds; 0 if none was broken.
    #[must_use]
    pub fn violation_share(&self) -> f64 {
        self.violations.iter().map(|violation| violation.share).fold(0.0, f64::max)
    }

    /// How many of them failed: steps that did not converge (real-time iterations are not judged)
    /// and steps that the time budget ended.
    #[must_use]
    pub fn failed_steps(&self) -> usize {
        self.status.iter().filter(|(status, _)| is_failure(status)).map(|(_, steps)| steps).sum()
    }
}

/// Whether a control step with this status, in the words of [`SqpStatus`], has failed.
#[must_use]
pub fn is_failure(status: &str) -> bool {
    use SqpStatus::{Converged, Deadline, Kept, Prepared, Replaced, Rounded};
    let fine = [Converged, Rounded, Prepared, Kept, Replaced, Deadline];
    fine.iter().all(|fine| fine.to_string() != status)
}

/// Whether the references were reached, each of which holds for a segment of the run. A segment is
/// looked at by its step marks t = kT, up to where the controller prepares the next one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceMetrics {
    /// When each segment begins, in s.
    #[serde(default)]
    pub reference_start_s: Vec<f64>,
    /// For each controlled quantity and segment, the mean absolute error over the last ten marks,
    /// or the second half of fewer than twenty, in its unit; `None` of fewer than ten, and of a
    /// quantity without a weight.
    #[serde(default)]
    pub offset: BTreeMap<String, Vec<Option<f64>>>,
    /// For each segment, the time from its beginning until all controlled quantities stay near
    /// their references, in s; `None` if they do not.
    #[serde(default)]
    pub settle_s: Vec<Option<f64>>,
    /// How near that is for each quantity, in its unit.
    #[serde(default)]
    pub settled_within: BTreeMap<String, f64>,
}

impl ReferenceMetrics {
    /// The largest of all offsets; NaN if no segment is long enough for one.
    #[must_use]
    pub fn largest_offset(&self) -> f64 {
        self.offset.values().flatten().flatten().copied().fold(f64::NAN, f64::max)
    }

    /// The segments that did not settle, at whose ends a quantity is farther from its reference than
    /// where it counts as settled, with its offset there.
    pub(crate) fn missed(&self, quantity: &str) -> impl Iterator<Item = (usize, f64)> {
        let within = self.settled_within.get(quantity).copied().unwrap_or(f64::INFINITY);
        let offsets = self.offset.get(quantity).into_iter().flatten().enumerate();
        let known = offsets.filter_map(|(segment, offset)| Some((segment, (*offset)?)));
        let settled = |segment: usize| self.settle_s.get(segment).is_some_and(Option::is_some);
        known.filter(move |(segment, offset)| *offset > within && !settled(*segment))
    }
}

/// The metrics of a closed loop.
pub(crate) mod rows {
    use super::ControlMetrics;
    use crate::csv::decimals;
    use crate::metric::Unit::{self, Clock, Count, Errors, One, States};
    use crate::metric::{Metric, Of};

    const S: Unit = Clock("s", 1.0);
    const US: Unit = Clock("us", 1e-6);

    const fn of(
        keys: [&'static str; 2],
        title: &'static str,
        unit: Unit,
        digits: usize,
        of: fn(&ControlMetrics) -> f64,
    ) -> Metric {
        Metric::new(keys, title, unit, digits, Of::Loop(of))
    }

    /// RMSE on the dense trace.
    pub const RMSE_DENSE: Metric =
        of(["rmse_dense"; 2], "RMSE, dense trace", States(""), 5, |of| of.rmse_dense)
            .printed("RMSE dense", |v| decimals(v, 5));
    /// IAE on the dense trace, summed over outputs.
    pub const IAE_DENSE_SUM: Metric =
        of(["iae_dense_sum"; 2], "IAE, dense trace, sum over outputs", States(""), 6, |of| {
            of.iae_dense_sum
        })
        .printed("IAE dense", |v| decimals(v, 4));
    /// The largest offset from a reference at rest, over quantities and segments; NaN without one.
    pub const OFFSET_MAX: Metric =
        of(["", "offset_max"], "largest offset from a reference", States(""), 2, |of| {
            of.references.largest_offset()
        })
        .row(None);
    /// The worst violation of a bound.
    pub const MAX_VIOLATION: Metric = of(
        ["max_violation"; 2],
        "largest violation of a bound",
        Errors("unit of the bound"),
        2,
        |of| of.max_violation,
    )
    .row(None);
    /// The controller's time in the whole loop: the median of the repetitions.
    pub const WALL: Metric =
        of(["wall_s.median", "wall_s"], "Controller, whole run: median", S, 3, |of| {
            of.wall_s.median
        })
        .printed("loop ms", |v| format!("{:.3}", 1e3 * v));
    /// The controller's time in a step: the median.
    pub const STEP_TIME: Metric =
        of(["step_us.p50", "step_us"], "Controller, one step: median", US, 3, |of| of.step_us.p50)
            .printed("step us", |v| format!("{v:.1}"));

    /// All of them.
    pub const LOOP: &[Metric] = &[
        of(["rmse"; 2], "RMSE at the steps", States(""), 5, |of| of.rmse)
            .printed("RMSE", |v| decimals(v, 5)),
        of(["iae"; 2], "IAE at the steps, mean over outputs", States(""), 6, |of| of.iae)
            .printed("IAE", |v| decimals(v, 4)),
        RMSE_DENSE,
        IAE_DENSE_SUM,
        OFFSET_MAX,
        MAX_VIOLATION,
        of(["", "violation_share"], "largest violation, share of the quantity", One, 3, |of| {
            of.violation_share()
        })
        .row(None),
        of(["input_travel"; 2], "travel of the inputs, in widths of their bounds", One, 4, |of| {
            of.input_travel
        })
        .neutral()
        .row(None),
        of(["kkt_max"; 2], "Largest KKT residual", One, 2, |of| of.kkt_max)
            // Plans that were not optimized have none.
            .printed("KKT max", |v| if v.is_finite() { format!("{v:.1e}") } else { "-".to_owned() })
            .neutral(),
        of(["sqp_iterations_mean"; 2], "SQP iterations per step", Count, 3, |of| {
            of.sqp_iterations_mean
        })
        .neutral(),
        WALL,
        STEP_TIME,
        of(["step_us.p99", ""], "Controller, one step: 99th percentile", US, 3, |of| {
            of.step_us.p99
        }),
        of(["step_us.max", ""], "Controller, one step: longest", US, 3, |of| of.step_us.max),
    ];
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_without_room_are_counted_and_the_first_is_named() {
        let found = |fits: &[bool]| {
            let mut tube = TubeMetrics::default();
            fits.iter().for_each(|fits| tube.add(*fits));
            tube.to_string()
        };
        assert_eq!(found(&[true; 3]), "all 3 plans keep the bounds of the tube");
        let said = "2 of 5 plans do not keep the bounds of the tube, the first in step 2: ";
        assert!(found(&[true, true, false, true, false]).starts_with(said));
    }

    /// A loop with these statuses, offsets from two references and shares of broken bounds.
    fn of(status: serde_json::Value, offsets: [Option<f64>; 2], shares: &[f64]) -> ControlMetrics {
        let violation = |share: &f64| {
            serde_json::json!({
                "of": "h", "unit": "cm", "side": "low", "bound": 1.0, "hard": true, "amount": 1.0,
                "time_s": 0.0, "at_steps": 0.0, "share": share,
            })
        };
        let violations: Vec<_> = shares.iter().map(violation).collect();
        serde_json::from_value(serde_json::json!({
            "model": "rk4", "wall_s": { "mean": 1.0, "sd": 0.0, "median": 1.0, "runs": 1 },
            "step_us": { "p50": 1.0, "p99": 1.0, "max": 1.0 }, "sqp_iterations_mean": 1.0,
            "rmse": 0.0, "iae": 0.0, "rmse_dense": 0.0, "iae_dense_sum": 0.0, "kkt_max": 0.0,
            "max_violation": 0.0, "status": status, "reference_start_s": [0.0, 10.0],
            "offset": { "h": offsets, "v": [0.25, null] }, "violations": violations,
        }))
        .unwrap()
    }

    /// A step that ended in time, with a plan of whole inputs, or with another plan on purpose did
    /// not fail; one that is not known did.
    #[test]
    fn steps_fail_by_their_status() {
        let fine = ["converged", "rounded", "prepared", "kept", "replaced", "deadline"];
        let bad = ["iteration-limit", "infeasible-qp", "numerical-trouble", "stalled", "new"];
        for status in fine {
            assert!(!is_failure(status), "{status}");
        }
        for status in bad {
            assert!(is_failure(status), "{status}");
        }
        let status = serde_json::json!({ "converged": 5, "replaced": 2, "stalled": 3, "new": 4 });
        let of = of(status, [None; 2], &[]);
        assert_eq!((of.steps(), of.failed_steps()), (14, 7));
    }

    /// The largest of all counts, not their sum nor the last.
    #[test]
    fn the_worst_bound_and_the_largest_offset_count() {
        let found = |offsets, shares: &[f64]| {
            let of = of(serde_json::json!({}), offsets, shares);
            format!("{:?}", [of.violation_share(), of.references.largest_offset()])
        };
        assert_eq!(found([Some(0.125), None], &[0.01, 0.5, 0.2]), "[0.5, 0.25]");
        assert_eq!(found([Some(0.5), Some(0.75)], &[]), "[0.0, 0.75]");
    }

    #[test]
    fn a_first_plan_says_which_start_gave_it() {
        let said = |starts, best| FirstPlanMetrics { starts, best }.to_string();
        assert_eq!(said(4, 0), "no other of 4 starts gives a cheaper first plan");
        assert_eq!(said(4, 2), "start 2 of 0 to 3 gives the first plan");
    }
}
