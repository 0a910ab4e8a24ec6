//! The times of a closed loop's models on this machine.

use crate::RunError;
use crate::clock::{for_seconds, time};
use crate::control::LoopSetup;
use pinc_check::{Cost, Metered, ModelCost};
use pinc_config::{ControlSpec, Experiment, ModelKind};
use pinc_net::PincNet;
use pinc_ode::{DynPlant, LinearizationBuffer, Model, Stages};
use pinc_record::{median, to_f64};
use std::hint::black_box;

/// How long each call is measured, in s.
const MEASURED_S: f64 = 0.01;

/// How long the steps of a loop are measured, in s.
const LOOP_S: f64 = 0.1;

/// Calls are timed together for this long, in s, so that reading the clock does not count.
const BATCH_S: f64 = 1e-4;

/// Calls that are timed together, at most.
const LARGEST_BATCH: usize = 1000;

/// The costs of the config's models, if it has a loop.
pub(super) fn measure(
    (plant, metered): (&dyn DynPlant, &Metered),
    experiment: &Experiment,
) -> Option<Cost> {
    let (spec, sample_time_s) = experiment.control.as_ref().zip(experiment.sample_time_s())?;
    let net = untrained(plant, experiment);
    // No estimator: the loop measures the plant's state.
    let spec = &ControlSpec { estimator: None, uncertainty: None, ..spec.clone() };
    let numerical = LoopSetup::numerical(spec, sample_time_s, plant);
    let beside = experiment.horizon_plants(&[]);
    let setup = LoopSetup { net: net.as_ref(), truth: metered, beside, ..numerical };
    let (x, u) = (&spec.initial_state, middle(spec));
    let mut dx = vec![0.0; x.len()];
    let rhs_ns = call_ns(|| plant.rhs(black_box(x), black_box(&u), &[], black_box(&mut dx)));
    let known = |kind: &&ModelKind| **kind != ModelKind::Pinc || net.is_some();
    let of_model = |kind: &ModelKind| {
        let mut model = setup.model(*kind, plant).ok()?;
        let (step_ns, linearized_ns) = step_ns(&mut *model, spec, &u);
        // A control step of several iterations, each as long as all measurements, is left out.
        let is_short = to_f64(spec.n2 as u64) * linearized_ns < 1e9 * LOOP_S;
        let control_step_us = (is_short && *kind != ModelKind::Pinc)
            .then(|| control_step_us(&setup, *kind, plant).ok().flatten())
            .flatten();
        Some(ModelCost { model: *kind, step_ns, linearized_ns, control_step_us })
    };
    let models = spec.models.iter().filter(known).filter_map(of_model).collect();
    Some(Cost { rhs_ns, stages: spec.n2, models })
}

/// The net of the config before its training: it takes as long as the trained one.
fn untrained(plant: &dyn DynPlant, experiment: &Experiment) -> Option<PincNet> {
    let (net, domain) = experiment.model.as_ref().zip(experiment.domain.as_ref())?;
    PincNet::new(plant, net, domain, experiment.seed).ok()
}

/// The middle between the bounds of the inputs.
fn middle(spec: &ControlSpec) -> Vec<f64> {
    spec.input_low.iter().zip(&spec.input_high).map(|(low, high)| 0.5 * (low + high)).collect()
}

/// The time of a step alone, and of one with Jacobians where a horizon of them is asked for.
fn step_ns(model: &mut dyn Model, spec: &ControlSpec, u: &[f64]) -> (f64, f64) {
    let dims = model.dims();
    let (x, p) = (&spec.initial_state, vec![1.0; dims.np]);
    let mut next = vec![0.0; dims.nx];
    let step_ns = call_ns(|| model.step(black_box(x), black_box(u), &p, black_box(&mut next)));
    let [x, u, p] = [x, u, &p].map(|values| values.repeat(spec.n2));
    let mut to = LinearizationBuffer::new(dims, spec.n2);
    let at = Stages { x: &x, u: &u, p: &p };
    let all_ns = call_ns(|| model.linearize(black_box(at), black_box(to.as_mut())));
    (step_ns, all_ns / to_f64(spec.n2 as u64))
}

/// The median time of a call, in ns; for a long call, the time of a single one.
fn call_ns(mut call: impl FnMut()) -> f64 {
    let once = time(&mut call);
    if once > MEASURED_S {
        return 1e9 * once;
    }
    let mut calls = 1;
    while calls < LARGEST_BATCH && to_f64(calls as u64) * once < BATCH_S {
        calls *= 2;
    }
    let mut times = Vec::new();
    for_seconds(MEASURED_S, || times.push(time(|| (0..calls).for_each(|_| call()))));
    1e9 * median(&times) / to_f64(calls as u64)
}

/// The median time of the controller's first steps, without the very first one.
fn control_step_us(
    setup: &LoopSetup<'_>,
    kind: ModelKind,
    plant: &dyn DynPlant,
) -> Result<Option<f64>, RunError> {
    let mut nmpc = setup.controller(kind, plant)?;
    let mut run = setup.begin(&mut nmpc)?;
    let mut times = Vec::new();
    while times.iter().sum::<f64>() < LOOP_S {
        let mut step = Ok(None);
        let taken = time(|| step = run.control());
        let Some(control) = step? else { break };
        times.push(taken);
        control.advance()?;
    }
    Ok((times.len() > 1).then(|| 1e6 * median(&times[1..])))
}
