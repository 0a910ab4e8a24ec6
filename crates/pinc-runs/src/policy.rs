//! A net in place of a controller, and its file.

use super::control::LoopSetup;
use super::model_error::SharedLog;
use crate::{BatchController, RunError};
use pinc_config::{ControlSpec, ModelKind, Variables};
use pinc_mpc::Nmpc;
use pinc_ode::{DynPlant, DynRhs};
use pinc_record::read_file;
use pinc_shrink::{Checked, Policy, PolicyNet};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The file of a net that `pinc shrink` trained, with what it is of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyFile {
    of: Controller,
    net: PolicyNet,
}

/// The controller in whose place a net was trained, as far as its inputs and outputs and what it minimizes
/// are the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Controller {
    states: Vec<String>,
    inputs: Vec<String>,
    controlled: Vec<String>,
    step_s: f64,
    nu: usize,
    model: ModelKind,
    /// Weights, horizon, bounds and parameters, as JSON text.
    problem: String,
}

impl Controller {
    fn of((spec, variables): (&ControlSpec, &Variables), step_s: f64, model: ModelKind) -> Self {
        let (states, inputs) = (variables.state_names(), variables.input_names());
        let weights = (spec.n1, spec.n2, &spec.q, &spec.r, &spec.q_terminal, &spec.weights_profile);
        let of_inputs =
            (&spec.input_low, &spec.input_high, &spec.increment_low, &spec.increment_high);
        let of_states = (&spec.state_low, &spec.state_high, &spec.state_softness);
        let of_outputs = (&spec.output_low, &spec.output_high, &spec.output_softness);
        let problem = json(&(weights, of_inputs, of_states, of_outputs, &spec.parameters));
        let controlled = spec.controlled.clone();
        Self { states, inputs, controlled, step_s, nu: spec.nu, model, problem }
    }
}

impl PolicyFile {
    /// The file of a net in place of this controller.
    #[must_use]
    pub fn new(controller: &BatchController, net: PolicyNet) -> Self {
        let step_s = controller.batch().nmpc().model().sample_time_s();
        let of = (controller.spec(), controller.variables());
        Self { of: Controller::of(of, step_s, controller.kind()), net }
    }
}

/// The content of the file.
impl fmt::Display for PolicyFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&json(self))
    }
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("names and finite numbers")
}

/// The net of `control.policy`, in place of the controller of `spec` for the plant `truth`.
pub(super) fn read(
    (spec, truth): (&ControlSpec, &dyn DynRhs),
    sample_time_s: f64,
) -> Result<PolicyNet, RunError> {
    for (key, is_there) in [
        ("control.estimator", spec.estimator.is_some()),
        ("control.measured_parameters", !spec.measured_parameters.is_empty()),
        ("control.bound_schedule", !spec.bound_schedule.is_empty()),
    ] {
        if is_there {
            let problem = format!("the model \"policy\" does not support {key}; leave it out");
            return Err(RunError::usage("control.models", problem));
        }
    }
    let path = spec.policy.as_deref().expect("the config was checked for it");
    let refused = |problem: String| RunError::usage(path.display(), problem);
    let file = serde_json::from_slice(&read_file(path)?);
    let PolicyFile { of, net } =
        file.map_err(|error| refused(format!("{error}; expected `policy.json` of `pinc shrink`")))?;
    let variables = (spec, &Variables::of(truth));
    let own = Controller::of(variables, sample_time_s, spec.model_of(ModelKind::Policy));
    if of != own {
        let (of, own) = (json(&of), json(&own));
        return Err(refused(format!("a net for {of}; expected one for {own}")));
    }
    let inputs = own.states.len() + own.controlled.len() + own.inputs.len();
    net.check(inputs, own.nu * own.inputs.len()).map_err(|error| refused(error.to_string()))?;
    Ok(net)
}

impl LoopSetup<'_> {
    /// The controller with the net of `control.policy` in place of the optimization.
    pub(super) fn policy(
        &self,
        plant: &dyn DynPlant,
    ) -> Result<(Nmpc, Option<SharedLog>), RunError> {
        let net = read((self.spec, self.truth), self.sample_time_s)?;
        let (mut nmpc, log) =
            self.judged_controller(self.spec.model_of(ModelKind::Policy), plant)?;
        let checked = Policy::new(net, &nmpc).and_then(|policy| Checked::new(policy, &mut nmpc));
        let checked =
            checked.map_err(|error| RunError::usage("control.policy", error.to_string()))?;
        nmpc.set_planner(Some(Box::new(checked)));
        Ok((nmpc, log))
    }
}
