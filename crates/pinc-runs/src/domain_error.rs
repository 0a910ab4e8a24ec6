//! How wrong one step of a net is over the domain that it was trained on, beside RK4.

use super::training_setup::TrainingSetup;
use crate::RunError;
use pinc_net::{DomainTruth, PincModel, PincNet};
use pinc_ode::{DynPlant, Integrator};
use pinc_record::{DomainErrorMetrics, DomainErrorTable, Rk4Errors, RunDir, file};

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
