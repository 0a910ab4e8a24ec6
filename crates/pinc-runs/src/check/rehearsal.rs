//! The closed loop that a check looks at.

use crate::RunError;
use crate::control::LoopSetup;
use pinc_check::{Metered, Rehearsal, Work};
use pinc_config::{ControlSpec, Experiment, ModelKind, UncertaintySpec};
use pinc_ode::{Dims, DynPlant, Integrator, Scheme, Trajectory};
use std::collections::BTreeMap;

/// The entries of Jacobians that a rehearsal computes for its plans.
const REHEARSED_ENTRIES: usize = 400_000_000;

/// The closed loop of `experiment` with an integrator as the model, the first one of the config or else
/// RK4, and the models' own plant, whose states are known.
pub(super) fn rehearse(
    (plant, metered): (&dyn DynPlant, &Metered),
    (experiment, spec): (&Experiment, &ControlSpec),
    sample_time_s: f64,
    work: &Work,
) -> Result<Rehearsal, RunError> {
    let integrator = spec.models.iter().find(|kind| kind.is_numerical());
    let spec = &ControlSpec { estimator: None, uncertainty: known(spec), ..spec.clone() };
    let uncertain = experiment.has_uncertain_parameters();
    let names = if uncertain { experiment.loop_parameters().names } else { Vec::new() };
    let nominal = experiment.plant.parameters();
    let values: Vec<f64> = names.iter().filter_map(|name| nominal.get(*name).copied()).collect();
    let family = uncertain.then(|| experiment.plant.family(&names));
    let plant = family.as_deref().unwrap_or(plant);
    let other = if plant.black_box().is_some() { ModelKind::BlackBox } else { ModelKind::RK4 };
    let kind = integrator.copied().unwrap_or(other);
    let setup = LoopSetup {
        truth: metered,
        parameters: &values,
        beside: experiment.horizon_plants(&names),
        scenarios: experiment.scenarios(),
        ..LoopSetup::numerical(spec, sample_time_s, plant)
    };
    let mut nmpc = setup.controller(kind, plant)?;
    let mut run = setup.begin(&mut nmpc)?;
    let (mut trace, mut status) = (Trajectory::new(plant.dims()), BTreeMap::new());
    let nodes = setup.problem().tree().first_node(spec.n2 + 1) - 1;
    let most = rehearsed_steps(plant.dims(), (spec, nodes), kind);
    let all = pinc_config::steps(spec.duration_s, sample_time_s);
    let iteration = nodes as u64 * node_units(plant.dims(), spec, kind, metered);
    let mut done = 0;
    while done < most && (done == 0 || !work.is_over()) {
        let Some(control) = run.control()? else { break };
        let record = control.record();
        let (ended, iterations) = (record.status.to_string(), record.sqp_iterations as u64 + 1);
        match control.advance() {
            // The budget was used up on the way.
            Err(_) if work.is_over() && done > 0 => break,
            advanced => advanced?,
        }
        work.spend(iterations.saturating_mul(iteration));
        done += 1;
        *status.entry(ended).or_default() += 1;
        let step = run.last_step();
        for (i, t) in step.times().iter().enumerate() {
            trace.push(*t, step.state(i), step.input(i));
        }
    }
    let (references, violations) = (setup.reached(&run), setup.violations(&run));
    let left_out = all.saturating_sub(done);
    Ok(Rehearsal { model: kind, trace, status, references, violations, left_out })
}

/// What a tube is made of where there is neither an estimator nor a net; `None` if that is nothing.
fn known(spec: &ControlSpec) -> Option<UncertaintySpec> {
    let of = spec.uncertainty.clone()?;
    UncertaintySpec { estimate: false, ..of }.without_net_error()
}

/// The units of work that an iteration of the controller takes for each node of its plan: the model with
/// its Jacobians, and a factorization.
fn node_units(dims: Dims, spec: &ControlSpec, kind: ModelKind, metered: &Metered) -> u64 {
    let evaluations = match kind {
        ModelKind::Integrator(integrator) => evaluations(spec, integrator),
        ModelKind::BlackBox => 1 + dims.nx + dims.nu,
        ModelKind::Pinc | ModelKind::Policy => evaluations(spec, Integrator::Rk4),
    };
    // About four derivatives cost as much as the value.
    let model = evaluations as u64 * metered.units() * (1 + (dims.nx + dims.nu) as u64 / 4);
    let factorization = ((dims.nx + dims.nu) as u64).pow(3) / 10;
    model + factorization
}

/// Evaluations of the right-hand side in a step of an integrator.
fn evaluations(spec: &ControlSpec, integrator: Integrator) -> usize {
    integrator.stages() * spec.own_substeps(integrator)
}

/// How many steps of a loop are rehearsed: as many as take a second or so, by the entries of the
/// Jacobians that the model computes for one plan.
fn rehearsed_steps(dims: Dims, (spec, nodes): (&ControlSpec, usize), kind: ModelKind) -> usize {
    let stages = match kind {
        ModelKind::Integrator(integrator) => match integrator.scheme() {
            Scheme::Explicit(_) => evaluations(spec, integrator),
            // A factorization takes as long as the products with its factors.
            Scheme::LinearlyImplicit => 2 * evaluations(spec, integrator),
        },
        // A millisecond or so for each run of the black box.
        ModelKind::BlackBox => 10_000,
        ModelKind::Pinc | ModelKind::Policy => evaluations(spec, Integrator::Rk4),
    };
    let dense = if kind == ModelKind::ROSENBROCK { dims.nx } else { 1 };
    let sizes = [nodes, stages, dims.nx, dims.nx + dims.nu, dense];
    let work = sizes.into_iter().fold(1_usize, usize::saturating_mul);
    (REHEARSED_ENTRIES / work.max(1)).max(5)
}
