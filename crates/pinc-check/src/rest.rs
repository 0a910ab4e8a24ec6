//! A loop that starts at rest on a kink, where no input has a slope.

use crate::irregularities::key_of;
use crate::{Finding, Subject};
use pinc_config::{ControlSpec, ModelKind};
use pinc_expr::{CriticalTerms, TermRole};
use pinc_ode::Simulator;

/// Local error tolerance: enough to see whether the plant stays.
const TOLERANCE: f64 = 1e-6;

/// How far beside the kink is looked, in widths.
const BESIDE: f64 = 1e-6;

/// An input that moves the controlled states beside the kink, and by its derivatives on it none.
pub(crate) fn examine(subject: &Subject<'_>, terms: &CriticalTerms) -> Option<Finding> {
    let control = subject.experiment.control.as_ref()?;
    subject.experiment.sample_time_s()?;
    let is_integrator = |model: &ModelKind| matches!(model, ModelKind::Integrator(_));
    let controlled = subject.controlled();
    let begins_elsewhere = control.first_plan.is_some() || control.sqp.starts > 1;
    if begins_elsewhere || controlled.is_empty() || !control.models.iter().any(is_integrator) {
        return None;
    }
    let nx = subject.region.dims.nx;
    let idle_at = |at: &[f64]| -> Vec<usize> {
        let jacobian = subject.plant.jacobian(&at[..nx], &at[nx..], &[]);
        let is_idle = |j: &usize| {
            let reached = reached(&jacobian, nx, *j);
            !controlled.iter().any(|&i| reached[i])
        };
        (0..at.len() - nx).filter(is_idle).collect()
    };
    let start = [&control.initial_state[..], &first_input(control)].concat();
    let mut idle = idle_at(&start);
    if idle.is_empty() {
        return None;
    }
    let mut end = start.clone();
    let (x, u) = end.split_at_mut(nx);
    let horizon_s = control.horizon_s(subject.step_s());
    Simulator::new(subject.plant, TOLERANCE).integrate(x, u, horizon_s).ok()?;
    let idle_later = idle_at(&end);
    idle.retain(|j| idle_later.contains(j));
    // An input that acts on no side of the kink is not held by it.
    let held_by = |kink: usize| {
        let variables = terms.alone(kink).variables().to_vec();
        let mut sides = variables.into_iter().flat_map(|k| [(k, -BESIDE), (k, BESIDE)]);
        sides.find_map(|(k, by)| {
            let mut beside = start.clone();
            beside[k] += by * subject.region.width(k);
            let idle_beside = idle_at(&beside);
            idle.iter().find(|j| !idle_beside.contains(j)).copied()
        })
    };
    let values = terms.values(&start).into_iter().zip(terms.values(&end));
    let mut on_it = values.enumerate().filter(|(_, both)| *both == (0.0, 0.0)).map(|(i, _)| i);
    let is_kink = |i: &usize| terms.list()[*i].role == TermRole::Kink;
    let (kink, j) =
        on_it.find_map(|i| Some(i).filter(is_kink).and_then(held_by).map(|j| (i, j)))?;
    let term = &terms.list()[kink];
    let (input, key) = (&subject.plant.inputs()[j].name, key_of(subject, term));
    let states: Vec<&str> = controlled.iter().map(|&i| subject.state_name(i)).collect();
    let states = states.join(", ");
    let what = format!(
        "the loop starts at rest on a kink ({key}: {} changes sign), where the derivatives of {states} \
         by {input} are 0",
        term.text
    );
    Some(
        Finding::warning("control.initial_state", what)
            .because(format!(
                "the optimization may stay there with the status converged: a plan with {input} at \
                 its first value has no slope to follow"
            ))
            .change(
                "a control.initial_input or control.first_plan a little off it, or a smooth form, as \
                 (x + sqrt(x^2 + width^2))/2 for max(x, 0)",
            ),
    )
}

/// The input that plans hold at first, within its bounds.
fn first_input(control: &ControlSpec) -> Vec<f64> {
    let bounds = control.input_low.iter().zip(&control.input_high).enumerate();
    let given = |j: usize| control.initial_input.as_ref().map_or(0.0, |given| given[j]);
    bounds.map(|(j, (low, high))| given(j).max(*low).min(*high)).collect()
}

/// The states that input `j` moves, directly or by way of others, by the derivatives of the rates in
/// states and inputs, shape `[nx, nx + nu]`.
fn reached(jacobian: &[f64], nx: usize, j: usize) -> Vec<bool> {
    let columns = jacobian.len() / nx;
    let mut reached = vec![false; nx];
    let mut open = vec![nx + j];
    while let Some(k) = open.pop() {
        for i in 0..nx {
            if !reached[i] && jacobian[i * columns + k].abs() > 0.0 {
                reached[i] = true;
                open.push(i);
            }
        }
    }
    reached
}
