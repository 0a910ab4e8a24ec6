//! A rehearsal of the closed loop with an integrator, and its failed steps.

use crate::{Finding, Subject};
use pinc_record::{advice, is_failure};

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let (Some(control), Some(rehearsal)) =
        (&subject.experiment.control, &subject.evidence.rehearsal)
    else {
        return Vec::new();
    };
    let rehearsal = match rehearsal {
        Ok(rehearsal) => rehearsal,
        Err(error) => {
            // Only RK4 has not been asked for where no integrator is in the config.
            return vec![
                Finding::error("control", format!("with an integrator as the model: {error}"))
                    .because(
                        "a controller that fails with the plant's own equation will not work \
                         with a net",
                    )
                    .change(
                        "other bounds, references or a shorter T; more rk4_substeps if the \
                         equation is stiff",
                    ),
            ];
        }
    };
    let (model, steps) = (rehearsal.model.title(), rehearsal.status.values().sum::<usize>());
    let failures = || rehearsal.status.iter().filter(|(status, _)| is_failure(status));
    let failed: usize = failures().map(|(_, steps)| steps).sum();
    let Some((worst, _)) = failures().max_by_key(|(_, steps)| **steps) else {
        let what = match rehearsal.left_out {
            0 => format!("all {steps} steps of the closed loop with {model} succeed"),
            more => format!(
                "the first {steps} steps of the closed loop with {model} succeed; the other {more} \
                 were left out, since they would take long"
            ),
        };
        return vec![Finding::fact("control", what)];
    };
    let what = format!(
        "{failed} of {steps} steps of the closed loop with {model} fail, most with the status {worst}"
    );
    let share = failed as f64 / steps as f64;
    if share <= control.max_failed_share {
        return vec![Finding::fact("control", what)];
    }
    vec![
        Finding::warning("control", what)
            .because(
                "a step that fails follows the plan of the step before, or none: what the loop does \
                 then says little of the model",
            )
            .change(advice(worst)),
    ]
}
