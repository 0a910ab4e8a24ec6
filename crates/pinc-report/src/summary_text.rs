//! A run in a few sentences.

use crate::data::Run;
use crate::identification;
use crate::number_tables::comparison;
use pinc_chart::text;
use pinc_config::ModelKind;
use pinc_mpc::SqpStatus;
use pinc_record::{Metrics, TrainingMetrics, ValidationMetrics};

/// The run in a few sentences; empty if there are no metrics.
pub(crate) fn paragraph(run: &Run) -> String {
    let identified = run.identification.as_ref().map(identification::paragraph);
    let Some(metrics) = &run.metrics else { return identified.unwrap_or_default() };
    let sentences = [
        identified,
        metrics.training.as_ref().map(training),
        metrics.validation.as_ref().map(validation),
        metrics.validation.as_ref().and_then(|of| over_the_domain(of, metrics)),
        metrics.domain_finding().map(|finding| finding.to_string()),
        tracking(run, metrics),
        speed(run, metrics),
        statuses(metrics),
    ];
    let mut said: Vec<String> = sentences.into_iter().flatten().collect();
    said.extend(metrics.loop_notes());
    said.join(" ")
}

fn training(training: &TrainingMetrics) -> String {
    format!(
        "The net was trained in {}, with {} iterations and {} evaluations of the loss.",
        text::duration(training.wall_s),
        training.iterations,
        training.loss_evaluations
    )
}

fn validation(validation: &ValidationMetrics) -> String {
    format!(
        "Running freely on scenarios that it was not chosen by, its mean squared error is {} at the steps.",
        text::number(validation.mse_gen, 3)
    )
}

fn over_the_domain(validation: &ValidationMetrics, metrics: &Metrics) -> Option<String> {
    let of = validation.domain_error.as_ref()?;
    let shown = |value| text::number(value, 2);
    Some(format!(
        "After one step from {} points all over its domain it is off by {} of a state's range (rms; \
         RK4 with 1, 2 and 4 substeps: {}, {} and {}), by {} at most: at {}.",
        text::count(of.points),
        shown(of.rms),
        shown(of.rk4.one),
        shown(of.rk4.two),
        shown(of.rk4.four),
        shown(of.max),
        of.max_at.named(&metrics.states, &metrics.inputs)
    ))
}

fn tracking(run: &Run, metrics: &Metrics) -> Option<String> {
    let iae = |model| Some(metrics.loop_with(model)?.iae_dense_sum);
    let shown = |value| text::significant(value, 6);
    match (iae(ModelKind::Pinc), iae(ModelKind::Rk4)) {
        (Some(pinc), Some(rk4)) => Some(format!(
            "In the closed loop the IAE (dense trace) is {} with the net as the controller's model \
            and \
             {} with RK4{}.",
            shown(pinc),
            shown(rk4),
            difference(pinc, rk4)
        )),
        (Some(one), None) => {
            let name = run.model_name(Some(ModelKind::Pinc));
            Some(format!("The IAE of the closed loop with {name} is {}.", shown(one)))
        }
        (None, Some(one)) => {
            Some(format!("The IAE of the closed loop with RK4 is {}.", shown(one)))
        }
        (None, None) => None,
    }
}

fn difference(pinc: f64, rk4: f64) -> String {
    match comparison(pinc, rk4) {
        same if same == "the same" => String::new(),
        other => format!(": the net's is {other}"),
    }
}

fn speed(run: &Run, metrics: &Metrics) -> Option<String> {
    let time = |model| {
        let time = metrics.loop_with(model)?.step_us.p50;
        Some(format!("{} with {}", text::duration(time * 1e-6), run.model_name(Some(model))))
    };
    let times: Vec<String> =
        [ModelKind::Pinc, ModelKind::Rk4].into_iter().filter_map(time).collect();
    (!times.is_empty())
        .then(|| format!("A step of the controller takes {} (medians).", text::listed(&times)))
}

fn statuses(metrics: &Metrics) -> Option<String> {
    let statuses = || metrics.control.iter().flat_map(|of| &of.status);
    let all: usize = statuses().map(|(_, count)| count).sum();
    let converged = SqpStatus::Converged.to_string();
    let failed = statuses().filter(|(status, _)| **status != converged).map(|(_, n)| n).sum();
    match (all, failed) {
        (0, _) => None,
        (all, 0) => Some(format!("All {} control steps converged.", text::count(all))),
        (all, failed) => Some(format!(
            "Of {} control steps {} did not converge.",
            text::count(all),
            text::count(failed)
        )),
    }
}
