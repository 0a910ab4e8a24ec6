//! A run in a few sentences.

use crate::data::Run;
use crate::identification;
use crate::number_tables::{comparison, shown};
use pinc_chart::text;
use pinc_config::ModelKind;
use pinc_mpc::SqpStatus;
use pinc_record::{ControlMetrics, Metrics, TrainingMetrics, ValidationMetrics, metric};

/// The run in a few sentences, one a line; empty if there are no metrics.
pub(crate) fn sentences(run: &Run) -> String {
    let identified = run.identification.as_ref().map(identification::paragraph);
    let Some(metrics) = &run.metrics else { return identified.unwrap_or_default() };
    let sentences = [
        identified,
        metrics.training.as_ref().map(training),
        metrics.validation.as_ref().map(validation),
        metrics.validation.as_ref().and_then(|of| over_the_domain(of, metrics)),
        metrics.domain_finding(),
        tracking(run, metrics),
        starts(run, metrics),
        tubes(run, metrics),
        speed(run, metrics),
        statuses(metrics),
    ];
    let mut said: Vec<String> = sentences.into_iter().flatten().collect();
    said.extend(metrics.loop_notes());
    said.join("\n")
}

fn training(training: &TrainingMetrics) -> String {
    format!(
        "The net was trained in {}, with {} iterations and {} evaluations of the loss.",
        shown(&metric::TRAINING_WALL, training.wall_s),
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
    let [one, two, four] = [of.rk4.one, of.rk4.two, of.rk4.four].map(shown);
    let rk4 = match of.rk4.are_known() {
        true => format!("; RK4 with 1, 2 and 4 substeps: {one}, {two} and {four}"),
        false => String::new(),
    };
    let sampled = format!(
        "After one step from {} points all over its domain it is off by {} of a state's range \
         (rms{rk4}); the largest error found is {}, at {}.",
        text::count(of.points),
        shown(of.rms),
        shown(of.max),
        of.max_at.named(&metrics.states, &metrics.inputs)
    );
    let proven = of.proven.to_string();
    Some(if proven.is_empty() { sampled } else { format!("{sampled} Anywhere in it {proven}.") })
}

fn tracking(run: &Run, metrics: &Metrics) -> Option<String> {
    let iae = |of: &ControlMetrics| shown(&metric::IAE_DENSE_SUM, of.iae_dense_sum);
    let with = |of: &ControlMetrics| format!("{} with {}", iae(of), run.model_name(Some(of.model)));
    match &metrics.control[..] {
        // Where nothing has a reference there is no IAE.
        all if all.iter().any(|of| of.iae_dense_sum.is_nan()) => None,
        [] => None,
        [one] => {
            let name = run.model_name(Some(one.model));
            Some(format!("The IAE of the closed loop with {name} is {}.", iae(one)))
        }
        all => {
            let of = |model| Some(metrics.loop_with(model)?.iae_dense_sum);
            let compared = of(ModelKind::Pinc).zip(of(ModelKind::RK4));
            let compared = compared.map(|(pinc, rk4)| difference(pinc, rk4)).unwrap_or_default();
            let each: Vec<String> = all.iter().map(with).collect();
            Some(format!(
                "In the closed loop the IAE (dense trace) is {}{compared}.",
                text::listed(&each)
            ))
        }
    }
}

fn difference(pinc: f64, rk4: f64) -> String {
    match comparison(pinc, rk4) {
        same if same == "the same" => String::new(),
        other => format!(": the net's is {other} than RK4's"),
    }
}

/// From which of several starts each controller's first plan is.
fn starts(run: &Run, metrics: &Metrics) -> Option<String> {
    let with = |of: &ControlMetrics| {
        let start = of.start.as_ref()?;
        Some(format!("With {} {start}.", run.model_name(Some(of.model))))
    };
    let each: Vec<String> = metrics.control.iter().filter_map(with).collect();
    (!each.is_empty()).then(|| each.join(" "))
}

/// How many plans keep the bounds of each controller's tube.
fn tubes(run: &Run, metrics: &Metrics) -> Option<String> {
    let with = |of: &ControlMetrics| {
        Some(format!("With {} {}.", run.model_name(Some(of.model)), of.tube.as_ref()?))
    };
    let each: Vec<String> = metrics.control.iter().filter_map(with).collect();
    (!each.is_empty()).then(|| each.join(" "))
}

fn speed(run: &Run, metrics: &Metrics) -> Option<String> {
    let time = |of: &ControlMetrics| {
        let name = run.model_name(Some(of.model));
        format!("{} with {name}", shown(&metric::STEP_TIME, of.step_us.p50))
    };
    let times: Vec<String> = metrics.control.iter().map(time).collect();
    (!times.is_empty())
        .then(|| format!("A step of the controller takes {} (medians).", text::listed(&times)))
}

/// How many control steps converged or failed. Real-time iterations and steps that the time budget
/// ended are neither.
fn statuses(metrics: &Metrics) -> Option<String> {
    let sum = |count: fn(&ControlMetrics) -> usize| metrics.control.iter().map(count).sum();
    let converged = SqpStatus::Converged.to_string();
    let statuses = metrics.control.iter().flat_map(|of| &of.status);
    let others: usize = statuses.filter(|(status, _)| **status != converged).map(|(_, n)| n).sum();
    let (all, failed): (usize, usize) =
        (sum(ControlMetrics::steps), sum(ControlMetrics::failed_steps));
    let all = match (all, others) {
        (0, _) => return None,
        (all, 0) => return Some(format!("All {} control steps converged.", text::count(all))),
        (all, _) => text::count(all),
    };
    Some(match failed {
        0 => format!("Of {all} control steps none failed."),
        failed => format!("Of {all} control steps {} failed.", text::count(failed)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::collections::BTreeMap;

    fn of(model: ModelKind, status: &[(SqpStatus, usize)]) -> ControlMetrics {
        let steps = |(status, steps): &(SqpStatus, usize)| (status.to_string(), *steps);
        let status: BTreeMap<_, _> = status.iter().map(steps).collect();
        let loops = json!({
            "model": model, "wall_s": { "mean": 1.0, "sd": 0.0, "median": 1.0, "runs": 1 },
            "step_us": { "p50": 40.0, "p99": 40.0, "max": 40.0 }, "sqp_iterations_mean": 1.0,
            "rmse": 0.0, "iae": 0.0, "rmse_dense": 0.0, "iae_dense_sum": 2.5, "kkt_max": 0.0,
            "max_violation": 0.0, "status": status
        });
        serde_json::from_value(loops).unwrap()
    }

    fn metrics(control: Vec<ControlMetrics>) -> Metrics {
        let text = r#"{ "experiment": "e", "preset": "ours", "variables": {} }"#;
        Metrics { control, ..serde_json::from_str(text).unwrap() }
    }

    #[test]
    fn steps_that_wait_for_the_next_one_or_ran_out_of_time_have_not_failed() {
        let said = |status: &[(SqpStatus, usize)]| {
            statuses(&metrics(vec![of(ModelKind::RK5, status)])).unwrap()
        };
        let fine = [(SqpStatus::Converged, 5), (SqpStatus::Prepared, 3), (SqpStatus::Deadline, 4)];
        assert_eq!(said(&fine), "Of 12 control steps none failed.");
        assert_eq!(said(&fine[..1]), "All 5 control steps converged.");
        let failed = [fine[0], fine[1], (SqpStatus::Stalled, 2)];
        assert_eq!(said(&failed), "Of 10 control steps 2 failed.");
        assert_eq!(statuses(&metrics(Vec::new())), None);
    }
}
