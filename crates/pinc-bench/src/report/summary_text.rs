//! A run in a few sentences.

use super::data::Run;
use super::number_tables::comparison;
use pinc_chart::text;
use serde_json::Value;

/// The run in a few sentences; empty if there are no metrics.
pub(super) fn paragraph(run: &Run) -> String {
    let sentences = [training(run), validation(run), tracking(run), speed(run), statuses(run)];
    let said: Vec<String> = sentences.into_iter().flatten().collect();
    said.join(" ")
}

fn training(run: &Run) -> Option<String> {
    let wall = run.metric(&["training", "wall_s"])?;
    let iterations = run.metric(&["training", "iterations"])?;
    let evaluations = run.metric(&["training", "loss_evaluations"])?;
    Some(format!(
        "The net was trained in {}, with {} iterations and {} evaluations of the loss.",
        text::duration(wall),
        text::number(iterations, 9),
        text::number(evaluations, 9)
    ))
}

fn validation(run: &Run) -> Option<String> {
    let error = run.metric(&["validation", "mse_gen"])?;
    Some(format!(
        "Running freely on the validation scenarios, its mean squared error is {} at the steps.",
        text::number(error, 3)
    ))
}

fn tracking(run: &Run) -> Option<String> {
    let iae = |model| run.control_metrics(model)?.get("iae_dense_sum")?.as_f64();
    let shown = |value| text::significant(value, 6);
    match (iae("pinc"), iae("rk4")) {
        (Some(pinc), Some(rk4)) => Some(format!(
            "In the closed loop the IAE (dense trace) is {} with the net as the controller's model and \
             {} with RK4{}.",
            shown(pinc),
            shown(rk4),
            difference(pinc, rk4)
        )),
        (Some(one), None) => {
            let name = run.model_name("pinc");
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

fn speed(run: &Run) -> Option<String> {
    let times = ["pinc", "rk4"].map(|model| {
        let time = run.control_metrics(model)?.get("step_us")?.get("p50")?.as_f64()?;
        Some(format!("{} with {}", text::duration(time * 1e-6), run.model_name(model)))
    });
    let times: Vec<String> = times.into_iter().flatten().collect();
    (!times.is_empty())
        .then(|| format!("A step of the controller takes {} (medians).", text::listed(&times)))
}

fn statuses(run: &Run) -> Option<String> {
    let runs = run.metrics["control"].as_array()?;
    let statuses = || runs.iter().filter_map(|run| run["status"].as_object()).flatten();
    let count = |n: &Value| n.as_f64().unwrap_or(0.0);
    let all: f64 = statuses().map(|(_, n)| count(n)).sum();
    let converged = statuses().filter(|(status, _)| *status == "converged");
    let failed = all - converged.map(|(_, n)| count(n)).sum::<f64>();
    match (all, failed) {
        (all, _) if all < 0.5 => None,
        (all, failed) if failed < 0.5 => {
            Some(format!("All {} control steps converged.", text::number(all, 9)))
        }
        (all, failed) => Some(format!(
            "Of {} control steps {} did not converge.",
            text::number(all, 9),
            text::number(failed, 9)
        )),
    }
}
