//! The section `one_step` of `metrics.json`, and its rows in the table of metrics.

use super::{nan, number_or_null};
use pinc_config::ModelKind;
use serde::{Deserialize, Serialize};

/// One step of a model by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OneStepMetrics {
    /// The model.
    pub model: ModelKind,
    /// How wrong it is over the domain.
    #[serde(flatten)]
    pub errors: StepErrors,
    /// Time of a step in ns, each waiting for the one before.
    pub forward_ns: f64,
    /// Time of a step with both Jacobians in ns, of as many at a time as the controller's horizon
    /// has.
    pub forward_jacobian_ns: f64,
}

/// How wrong one step is, over points that fill a domain. States are measured in widths of the
/// domain; the error at a point is the root mean square over the states. Not finite where a step is
/// not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepErrors {
    /// Root mean square over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub rms: f64,
    /// Median over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub median: f64,
    /// 99th percentile over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub p99: f64,
    /// The largest of the points.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub max: f64,
    /// Root mean square, over points and entries, of the errors of the Jacobians A and B, in widths
    /// of the domain per width.
    #[serde(deserialize_with = "number_or_null")]
    pub jacobian_rms: f64,
}

/// The metrics of one step.
pub(crate) mod rows {
    use super::OneStepMetrics;
    use crate::metric::Unit::{Clock, Errors};
    use crate::metric::{Metric, Of, Unit};

    const WIDTHS: Unit = Errors("width of the domain");
    const NS: Unit = Clock("ns", 1e-9);

    const fn of(
        keys: [&'static str; 2],
        title: &'static str,
        unit: Unit,
        of: fn(&OneStepMetrics) -> f64,
    ) -> Metric {
        Metric::new(keys, title, unit, 2, Of::OneStep(of)).row(None)
    }

    /// Root mean square error of one step.
    pub const ONE_STEP_RMS: Metric =
        of(["rms", "one_step_rms"], "One step, rms", WIDTHS, |of| of.errors.rms);
    /// Median error of one step.
    pub const ONE_STEP_MEDIAN: Metric =
        of(["median", "one_step_median"], "One step, median", WIDTHS, |of| of.errors.median);
    /// 99th percentile of the error of one step.
    pub const ONE_STEP_P99: Metric =
        of(["p99", "one_step_p99"], "One step, 99th percentile", WIDTHS, |of| of.errors.p99);
    /// Root mean square error of the Jacobians, per width of the domain.
    pub const JACOBIAN_RMS: Metric =
        of(["jacobian_rms"; 2], "One step, Jacobians, rms", WIDTHS, |of| of.errors.jacobian_rms);
    /// Time of one step.
    pub const FORWARD: Metric = of(["forward_ns"; 2], "One step, time", NS, |of| of.forward_ns);
    /// Time of one step with its Jacobians.
    pub const FORWARD_JACOBIAN: Metric =
        of(["forward_jacobian_ns"; 2], "One step with Jacobians, time", NS, |of| {
            of.forward_jacobian_ns
        });

    /// All of them.
    pub const ONE_STEP: &[Metric] =
        &[ONE_STEP_RMS, ONE_STEP_MEDIAN, ONE_STEP_P99, JACOBIAN_RMS, FORWARD, FORWARD_JACOBIAN];
}
