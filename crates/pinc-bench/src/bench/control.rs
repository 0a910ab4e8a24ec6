//! Nets trained briefly, and the shipped closed loops with them.

use super::cases::{Case, Effort};
use super::clock::to_f64;
use super::model::{self, Trained};
use super::results::{BenchReport, ModelStep, NmpcTimes, QpTime};
use crate::record::file;
use crate::registry::PlantTask;
use crate::runs::read_model;
use crate::{BenchError, ControlMetrics, Experiment, ModelKind, Options, Record, Verbosity};
use pinc_ode::Plant;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Hidden layers and neurons of a net that is much smaller than the paper's.
const SMALL: [usize; 2] = [2, 10];

/// What solves the controller's quadratic programs.
const QP_SOLVER: &str = "clarabel";

/// Trains nets for `case`, and adds its models' steps, closed loops and quadratic programs to `report`.
pub(super) fn run(case: Case, effort: &Effort, report: &mut BenchReport) -> Result<(), BenchError> {
    let [small_s, papers_s] = effort.training_s;
    let [hidden_layers, neurons] = SMALL;
    let small = case.experiment(&[
        &format!("training.time_limit_s={small_s:?}"),
        &format!("model.hidden_layers={hidden_layers}"),
        &format!("model.neurons={neurons}"),
    ])?;
    let (small, _) = finish(&small, crate::train)?;
    let experiment = case.experiment(&[
        &format!("training.time_limit_s={papers_s:?}"),
        &format!("control.repetitions={}", effort.repetitions),
    ])?;
    let (papers, record) =
        finish(&experiment, |e, dir, options| crate::control(e, dir, options, None, None))?;
    let steps = Steps { case, nets: &[&small, &papers], effort };
    let steps = experiment.plant.with(steps)?;
    for metrics in &record.metrics().control {
        report.nmpc.push(nmpc(case, &experiment, metrics));
        report.qp.extend(qp(case, &experiment, metrics, &steps));
    }
    report.model_step.extend(steps);
    Ok(())
}

/// Does `work` on the experiment, in a directory that is removed afterwards, and returns the net.
fn finish(
    experiment: &Experiment,
    work: impl FnOnce(&Experiment, &Path, &Options<'_>) -> Result<Record, BenchError>,
) -> Result<(Trained, Record), BenchError> {
    let temporary = std::env::temp_dir();
    let dir = tempfile::tempdir().map_err(BenchError::unwritable(&temporary))?;
    let options = Options {
        resume: false,
        verbosity: Verbosity::Quiet,
        interrupt: &AtomicBool::new(false),
        arguments: &[],
    };
    let record = work(experiment, dir.path(), &options)?;
    let net = read_model(&dir.path().join(file::MODEL))?;
    let seconds = record.metrics().training.as_ref().map_or(0.0, |training| training.wall_s);
    Ok((Trained { net, seconds }, record))
}

struct Steps<'a> {
    case: Case,
    nets: &'a [&'a Trained],
    effort: &'a Effort,
}

impl PlantTask for Steps<'_> {
    type Output = Result<Vec<ModelStep>, BenchError>;

    fn run<P: Plant + 'static>(self, plant: P) -> Self::Output {
        let Self { case, nets, effort } = self;
        let domain = nets[0].net.domain();
        model::run(case, &plant, domain, nets, effort)
    }
}

fn nmpc(case: Case, experiment: &Experiment, metrics: &ControlMetrics) -> NmpcTimes {
    let converged = metrics.status.get("converged").copied().unwrap_or(0);
    NmpcTimes {
        plant: case.name(),
        model: metrics.model.name(),
        kkt_tol: experiment.control.as_ref().map_or(f64::NAN, |control| control.sqp.tolerance),
        step_us: metrics.step_us.clone(),
        sqp_iterations_mean: metrics.sqp_iterations_mean,
        converged: to_f64(converged as u64) / steps(metrics),
        qp_solver: QP_SOLVER,
    }
}

/// Steps of a closed loop.
fn steps(metrics: &ControlMetrics) -> f64 {
    to_f64(metrics.status.values().sum::<usize>() as u64)
}

/// The time of a quadratic program, from the closed loop with Runge-Kutta: pinc-mpc does not show its
/// solver. A step linearises the model over the horizon once, and once more after each program; the
/// rest of its time is that of the programs and of the checks around them.
fn qp(
    case: Case,
    experiment: &Experiment,
    metrics: &ControlMetrics,
    models: &[ModelStep],
) -> Option<QpTime> {
    let control = experiment.control.as_ref().filter(|_| metrics.model == ModelKind::Rk4)?;
    let model = models.iter().find(|model| model.substeps == Some(control.rk4_substeps))?;
    let programs = metrics.sqp_iterations_mean;
    let linearized = to_f64(control.n2 as u64) * (programs + 1.0);
    let step_us = 1e6 * metrics.wall_s.median / steps(metrics);
    Some(QpTime {
        plant: case.name(),
        solver: QP_SOLVER,
        us: (step_us - 1e-3 * model.forward_jacobian_ns * linearized) / programs,
        note: "control step less linearisations, per program: includes the SQP's own checks",
    })
}
