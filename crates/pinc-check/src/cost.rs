//! The times of the loop's models on this machine.

use crate::{Finding, Subject};
use pinc_config::ModelKind;

/// Times on the machine at hand, of one thread.
#[derive(Clone, Debug)]
pub struct Cost {
    /// One evaluation of f(x, u), in ns.
    pub rhs_ns: f64,
    /// The stages of the horizon.
    pub stages: usize,
    /// The costs of the models.
    pub models: Vec<ModelCost>,
}

/// The times of a model.
#[derive(Clone, Debug)]
pub struct ModelCost {
    /// Which one it is.
    pub model: ModelKind,
    /// A step alone, in ns.
    pub step_ns: f64,
    /// A step with Jacobians, all steps of a horizon at once, in ns.
    pub linearized_ns: f64,
    /// A step of the controller, in us; of a net it is not known before the training.
    pub control_step_us: Option<f64>,
}

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let (Some(control), Some(cost)) = (&subject.experiment.control, &subject.evidence.cost) else {
        return Vec::new();
    };
    let rhs = format!("an evaluation of the equation takes {}", duration(cost.rhs_ns));
    let of_model = |of: &ModelCost| {
        let name = match of.model.integrator() {
            Some(method) => format!("{} x{}", method.title(), control.own_substeps(method)),
            None => of.model.title().to_owned(),
        };
        let step = of.control_step_us.map_or_else(String::new, |us| {
            format!("; a control step takes {}", duration(1e3 * us))
        });
        let what = format!(
            "a step of {name} takes {}, with Jacobians {} ({} at a time){step}",
            duration(of.step_ns),
            duration(of.linearized_ns),
            cost.stages,
        );
        Finding::fact("control.models", what)
    };
    let models = cost.models.iter().map(of_model);
    std::iter::once(Finding::fact("", rhs)).chain(models).collect()
}

/// A time with two or three digits.
fn duration(ns: f64) -> String {
    match ns {
        ns if ns < 1e3 => format!("{ns:.0} ns"),
        ns if ns < 1e5 => format!("{:.1} us", 1e-3 * ns),
        ns if ns < 1e6 => format!("{:.0} us", 1e-3 * ns),
        ns => format!("{:.1} ms", 1e-6 * ns),
    }
}
