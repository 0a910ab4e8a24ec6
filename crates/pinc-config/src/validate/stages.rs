//! Checks of `control.stages_s`.

use super::Checked;
use super::limits::PARTS;
use super::values::{alone, length, positive, value};
use crate::estimator::DisturbanceSpec;
use crate::{ControlSpec, EstimatorSpec, ModelKind, Profile};
use pinc_net::NetConfig;

const KEY: &str = "control.stages_s";

/// Stages of different length, with the net that has to cover them, which may be distilled.
pub(super) fn lengths(
    spec: &ControlSpec,
    model: Option<&NetConfig>,
    is_distilled: bool,
) -> Checked {
    let Some(stages) = &spec.stages_s else { return Ok(()) };
    let Some(&first) = stages.first() else {
        return value(KEY, "[]", "the lengths of one stage or more");
    };
    if stages.len() != spec.n2 {
        return length(KEY, stages, spec.n2, "stage of the horizon (control.n2)");
    }
    for (i, &stage) in stages.iter().enumerate() {
        let key = format!("{KEY}[{i}]");
        positive(&key, stage)?;
        if stage < first {
            let expected = format!("{first} s at least, the first, which is the control step");
            return value(&key, stage, &expected);
        }
        let steps = stage / first;
        if (steps - steps.round()).abs() > 1e-9 * steps {
            let expected = format!("a whole number of control steps of {first} s");
            return value(&key, stage, &expected);
        }
        for integrator in spec.models.iter().filter_map(|kind| kind.integrator()) {
            if spec.substeps(integrator, stage, first) > PARTS {
                let expected = format!("a stage of {PARTS} substeps of {integrator} at most");
                return value(&key, stage, &expected);
            }
        }
    }
    if let Some(step_s) = spec.step_s.filter(|step_s| step_s.total_cmp(&first).is_ne()) {
        let expected = format!("{KEY}[0], {first}, or no such key");
        return value("control.step_s", step_s, &expected);
    }
    // Per control step, as the estimator has it.
    let of_states = |of: &EstimatorSpec| matches!(of.disturbance, DisturbanceSpec::States(_));
    let differ = stages.iter().any(|&stage| stage > first);
    let others = [
        ("weights_profile = \"cumulative\"", spec.weights_profile == Profile::Cumulative),
        ("disturbances of states", differ && spec.estimator.as_ref().is_some_and(of_states)),
    ];
    alone(KEY, format!("{stages:?}"), "key", &others)?;
    let Some(model) = model.filter(|_| spec.models.contains(&ModelKind::Pinc)) else {
        return Ok(());
    };
    let longest = stages.iter().copied().fold(0.0, f64::max);
    if model.sample_time_s < longest {
        let expected = format!("{longest} s at least, the longest of control.stages_s");
        return value("model.horizon_s", model.sample_time_s, &expected);
    }
    let is_known = |stage: &f64| stage.total_cmp(&model.sample_time_s).is_eq();
    if is_distilled && !stages.iter().all(is_known) {
        let expected = "\"physics\" with control.stages_s: a distilled net knows one length only";
        return value("training.source", "\"integrator\"", expected);
    }
    Ok(())
}
