//! The error of one step of a net over its training domain, beside RK4.

use super::training_setup::TrainingSetup;
use crate::RunError;
use crate::invocation::cores;
use pinc_check::proven_error;
use pinc_config::{Experiment, ModelKind};
use pinc_net::{DomainTruth, PincModel, PincNet};
use pinc_ode::{DynPlant, Integrator, Tableau};
use pinc_record::{DomainErrorMetrics, DomainErrorTable, ProvenErrors, Rk4Errors, RunDir, file};
use pinc_verify::StepModel;
use std::path::Path;

/// Judges `net`, and writes the error of each point; nothing for a conventional PINN, which makes
/// no steps, or if the plant cannot be integrated from anywhere.
pub(super) fn judge(
    plant: &dyn DynPlant,
    net: &PincNet,
    setup: &TrainingSetup<'_>,
    seed: u64,
    run_dir: &RunDir,
) -> Result<Option<DomainErrorMetrics>, RunError> {
    if net.time_only().is_some() {
        return Ok(None);
    }
    let (count, tolerance) = (setup.validation.one_step_points, setup.validation.tolerance);
    let sample_time_s = net.sample_time_s();
    let mut truth = DomainTruth::draw(plant, net.domain(), sample_time_s, count, tolerance, seed);
    if truth.points().is_empty() {
        return Ok(None);
    }
    let judged = truth.judge(&mut PincModel::new(net)?);
    let rk4 = |substeps| match plant.model(Integrator::Rk4, sample_time_s, substeps) {
        Ok(mut model) => truth.rms(&mut *model),
        // A plant without an equation has no such error.
        Err(_) => f64::NAN,
    };
    let rk4 = Rk4Errors { one: rk4(1), two: rk4(2), four: rk4(4) };
    let parameters: Vec<_> = net.parameter_names().map(str::to_owned).collect();
    if run_dir.keeps_traces() {
        let variables = [net.state_names(), net.input_names(), &parameters].concat();
        let table = DomainErrorTable::of(variables, &truth, &judged).to_csv();
        run_dir.write(file::DOMAIN_ERROR, table.as_bytes())?;
    }
    Ok(Some(DomainErrorMetrics::of(
        &judged,
        [net.state_names(), &parameters],
        truth.unsolved(),
        rk4,
    )))
}

/// What a small proof gives for the step of `net`, and for RK4 with the config's substeps if it is a
/// model of the loop.
pub(super) fn proven(experiment: &Experiment, net: &PincNet) -> ProvenErrors {
    let of =
        |model| proven_error(&experiment.plant, net.domain(), model, net.sample_time_s(), cores());
    let control = experiment.control.as_ref();
    let control = control.filter(|control| control.models.contains(&ModelKind::RK4));
    let rk4 = control.and_then(|control| {
        let substeps = control.own_substeps(Integrator::Rk4);
        let bound = of(StepModel::RungeKutta(Tableau::CLASSICAL, substeps))?;
        Some((substeps.to_string(), bound))
    });
    ProvenErrors { net: of(StepModel::Net(net)), rk4: rk4.into_iter().collect() }
}

/// A bound of the error of one step of the net in the file `model`, in widths of its domain, if a
/// small proof gives one.
///
/// # Errors
///
/// [`RunError`] if the file holds no net.
pub fn proven_net_error(experiment: &Experiment, model: &Path) -> Result<Option<f64>, RunError> {
    let net = crate::read_model(model)?;
    let (domain, step_s) = (net.domain(), net.sample_time_s());
    Ok(proven_error(&experiment.plant, domain, StepModel::Net(&net), step_s, cores()))
}
