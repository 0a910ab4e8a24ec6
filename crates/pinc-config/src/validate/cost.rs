//! Checks of `[control.cost]`, and of what may be left out beside it.

use super::values::value;
use super::{Checked, Problem, expression_finding};
use crate::control::is_no_weight;
use crate::{ControlSpec, DisturbanceSpec, Experiment, ModelKind, Variables};
use pinc_mpc::SqpHessian;

/// What is written, or left out, of the cost.
pub(super) fn parts(spec: &ControlSpec) -> Checked {
    let missing = |key: &str, expected| Err((format!("control.{key}"), Problem::Missing(expected)));
    let has_cost = spec.cost.is_some();
    if is_no_weight(&spec.r) && !has_cost {
        return missing("r", "one weight per input, or a cost in [control.cost]");
    }
    if spec.controlled.is_empty() && !has_cost {
        return missing("controlled", "names of states, outputs or inputs, or a [control.cost]");
    }
    if is_no_weight(&spec.q) && !spec.controlled.is_empty() {
        return missing("q", "one weight per controlled quantity");
    }
    if spec.references.is_empty() && !spec.controlled.is_empty() {
        return missing("references", "at least one { start_s, value }");
    }
    Ok(())
}

/// The expressions, for the plant of `experiment`.
pub(super) fn expressions(
    experiment: &Experiment,
    spec: &ControlSpec,
    variables: &Variables,
) -> Checked {
    let Some(cost) = &spec.cost else { return Ok(()) };
    if cost.texts().next().is_none() {
        let expected = "an expression `stage` or `terminal`, or both";
        return value("control.cost", "neither", expected);
    }
    if spec.sqp.real_time {
        let expected = "false with [control.cost], which needs more than one iteration";
        return value("control.sqp.real_time", true, expected);
    }
    if spec.sqp.hessian == SqpHessian::GaussNewton {
        let expected = "\"auto\" or \"adaptive\" with [control.cost], whose Hessian is exact";
        return value("control.sqp.hessian", "\"gauss-newton\"", expected);
    }
    let estimator = spec.estimator.as_ref();
    if estimator.is_some_and(|of| of.disturbance == DisturbanceSpec::Output) {
        let expected = "another one with [control.cost], whose states and outputs are the model's, \
                        without disturbances";
        return value("control.estimator.disturbance", "\"output\"", expected);
    }
    if experiment.is_distilled() && spec.models.contains(&ModelKind::Pinc) {
        let expected = "\"physics\" with [control.cost]: a distilled net knows one length only";
        return value("training.source", "\"integrator\"", expected);
    }
    let mut taken =
        [variables.state_names(), variables.input_names(), variables.output_names()].concat();
    taken.extend(experiment.plant.parameter_names());
    taken.push("t".to_owned());
    for (name, number) in &cost.parameters {
        let key = format!("control.cost.parameters.{name}");
        if taken.contains(name) {
            return value(&key, format!("the name `{name}`"), "a name that is not taken");
        }
        if !number.is_finite() {
            return Err((key, Problem::NotFinite(*number)));
        }
    }
    cost.beside(&experiment.plant, &[]).map(drop).map_err(|error| {
        let (_, problem) = expression_finding("plant", error.clone());
        (format!("control.cost.{}", error.key), problem)
    })
}
