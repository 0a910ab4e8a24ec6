//! The sections of `metrics.json` on the net, and their rows in the table of metrics.

use super::{OutsideDomain, nan, number_or_null};
use crate::domain_error::DomainErrorMetrics;
use pinc_net::{TrainingTarget, Validation};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// How good the net that was kept is, on scenarios that it was not chosen by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValidationMetrics {
    /// Eq. (`mse_gen`) of the paper: self-loop, at the steps t = kT, in the states' units squared.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_gen: f64,
    /// As the authors' program has it: self-loop, at all rows, in standard deviations of the box.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_all_normalized: f64,
    /// The mean squared error of one step from random points of the box, in the states' units
    /// squared.
    #[serde(deserialize_with = "number_or_null")]
    pub one_step_mse: f64,
    /// `mse_gen` with each state in standard deviations of the box.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub mse_gen_normalized: f64,
    /// On held-out measurements, each state in standard deviations of the box: the best net was
    /// chosen by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_mse: Option<f64>,
    /// The error of one step from all over the training domain; absent for a conventional PINN.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub domain_error: Option<DomainErrorMetrics>,
}

impl ValidationMetrics {
    /// These errors of a net, and its error over the domain if there is one.
    #[must_use]
    pub fn new(validation: &Validation, domain_error: Option<DomainErrorMetrics>) -> Self {
        Self {
            mse_gen: validation.mse_gen,
            mse_all_normalized: validation.mse_all_normalized,
            one_step_mse: validation.one_step_mse,
            mse_gen_normalized: validation.mse_gen_normalized,
            measured_mse: validation.measured_mse,
            domain_error,
        }
    }
}

/// The work and time of a training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingMetrics {
    /// The target that the net was trained on.
    #[serde(default)]
    pub source: TrainingTarget,
    /// Wall time of the whole stage in s, with validation and files.
    pub wall_s: f64,
    /// Wall time of the optimizer alone in s: the last `elapsed_s` of `training.csv`.
    #[serde(default)]
    pub optimizer_s: f64,
    /// Iterations over all phases.
    pub iterations: u64,
    /// Evaluations of the loss and its gradient.
    pub loss_evaluations: u64,
    /// Why it ended.
    pub stop_reason: String,
    /// The loss in the last iteration, where it was looked at on fresh points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss: Option<f64>,
    /// The loss on points that the net was not trained on, then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fresh_loss: Option<f64>,
    /// The parameters of the plant that were trained with the net.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
}

/// How good the free run is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionMetrics {
    /// Mean squared error at the step marks t = kT, in physical units.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_marks: f64,
    /// Mean squared error over all rows but the initial state, in physical units.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_all: f64,
    /// Whether the net was used outside its training domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside_domain: Option<OutsideDomain>,
}

/// The metrics of training, validation and free run.
pub(crate) mod rows {
    use super::TrainingMetrics;
    use crate::metric::Of::{Domain, FreeRun, Name, Training, Validation};
    use crate::metric::Unit::{self, Clock, Count, Errors, States};
    use crate::metric::{Metric, Of};

    const S: Unit = Clock("s", 1.0);
    const DEVIATIONS: Unit = Errors("standard deviation of the validation box, squared");
    const WIDTHS: Unit = Errors("width of the domain");

    const fn name(
        key: &'static str,
        title: &'static str,
        of: fn(&TrainingMetrics) -> String,
    ) -> Metric {
        Metric::new([key; 2], title, Unit::Name, 0, Name(of)).neutral()
    }

    const fn count(key: &'static str, title: &'static str, of: Of) -> Metric {
        Metric::new([key; 2], title, Count, 0, of).neutral()
    }

    /// An error that is called like this beneath the heading of its stage.
    const fn error(
        keys: [&'static str; 2],
        [title, row]: [&'static str; 2],
        unit: Unit,
        of: Of,
    ) -> Metric {
        let digits = if let Domain(_) = of { 2 } else { 3 };
        Metric::new(keys, title, unit, digits, of).row(Some(row))
    }

    /// The target that the net was trained on.
    pub const SOURCE: Metric = name("source", "Training, on", |of| of.source.to_string()).row(None);
    /// Wall time of the training.
    pub const TRAINING_WALL: Metric = error(
        ["wall_s", "training_wall_s"],
        ["Training, wall time", "Wall time"],
        S,
        Training(|of| of.wall_s),
    );
    /// Mean squared error at the steps.
    pub const MSE_GEN: Metric = error(
        ["mse_gen"; 2],
        ["Validation, MSE at the steps", "MSE at the steps t = kT, physical units"],
        States("²"),
        Validation(|of| of.mse_gen),
    );
    /// Mean squared error of one step.
    pub const ONE_STEP_MSE: Metric = error(
        ["one_step_mse"; 2],
        ["Validation, MSE of one step", "MSE of one step, from random states in validation.domain"],
        States("²"),
        Validation(|of| of.one_step_mse),
    );
    /// Root mean square error of the whole free run.
    pub const FREE_RUN_RMSE: Metric = Metric::new(
        ["", "free_run_rmse"],
        "RMSE of the free run",
        States(""),
        3,
        FreeRun(|of| of.mse_all.sqrt()),
    )
    .row(None);

    /// The metrics of the training.
    pub const TRAINING: &[Metric] = &[
        SOURCE,
        name("stop_reason", "Training, stopped because", |of| of.stop_reason.clone())
            .row(Some("Stopped because")),
        count("iterations", "Iterations", Training(|of| of.iterations as f64)),
        count("loss_evaluations", "Loss evaluations", Training(|of| of.loss_evaluations as f64)),
        TRAINING_WALL,
        error(
            ["optimizer_s"; 2],
            ["Training, optimizer alone", "Optimizer alone"],
            S,
            Training(|of| of.optimizer_s),
        ),
    ];

    /// The metrics of the validation.
    pub const VALIDATION: &[Metric] = &[
        MSE_GEN,
        error(
            ["mse_all_normalized"; 2],
            ["Validation, MSE of all rows, normalized", "MSE of all rows, normalized"],
            DEVIATIONS,
            Validation(|of| of.mse_all_normalized),
        ),
        ONE_STEP_MSE,
        error(
            ["measured_mse"; 2],
            ["Validation, MSE of held-out data", "MSE of the held-out data, which chose the net"],
            DEVIATIONS,
            Validation(|of| of.measured_mse.unwrap_or(f64::NAN)),
        ),
    ];

    /// The metrics of one step over the domain.
    pub const DOMAIN: &[Metric] = &[
        error(
            ["rms", ""],
            ["One step over [domain], rms in widths", "Root mean square"],
            WIDTHS,
            Domain(|of| of.rms),
        ),
        error(
            ["p99", ""],
            ["One step over [domain], 99th percentile", "99th percentile of the points"],
            WIDTHS,
            Domain(|of| of.p99),
        ),
        error(
            ["max", ""],
            ["One step over [domain], largest", "Largest"],
            WIDTHS,
            Domain(|of| of.max),
        ),
    ];

    /// The metrics of the free run.
    pub const FREE_RUN: &[Metric] = &[
        error(
            ["mse_marks", "free_run_mse_marks"],
            ["Free run, MSE at the steps", "MSE at the steps t = kT, physical units"],
            States("²"),
            FreeRun(|of| of.mse_marks),
        ),
        error(
            ["mse_all", ""],
            ["Free run, MSE of all rows", "MSE of all rows, physical units"],
            States("²"),
            FreeRun(|of| of.mse_all),
        ),
        FREE_RUN_RMSE,
    ];
}
