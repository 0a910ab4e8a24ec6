//! Nets trained briefly, and the shipped closed loops with them.

use super::cases::{Case, Effort};
use super::model::{self, Trained};
use super::programs;
use super::results::{BenchReport, NmpcTimes};
use pinc_config::Experiment;
use pinc_record::{ControlMetrics, RecordError, RunDir, file, to_f64};
use pinc_runs::{Options, RunError, Verbosity, read_model};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Hidden layers and neurons of a net that is much smaller than the paper's.
const SMALL: [usize; 2] = [2, 10];

/// Trains nets for `case`, and adds its models' steps, closed loops and quadratic programs to
/// `report`.
pub(super) fn run(case: Case, effort: &Effort, report: &mut BenchReport) -> Result<(), RunError> {
    let [small_ends, papers_ends] = effort.training;
    let [hidden_layers, neurons] = SMALL;
    let small = case.experiment(&[
        small_ends,
        &format!("model.hidden_layers={hidden_layers}"),
        &format!("model.neurons={neurons}"),
    ])?;
    let small = trained(&small, pinc_runs::train)?.0;
    let experiment =
        case.experiment(&[papers_ends, &format!("control.repetitions={}", effort.repetitions)])?;
    let (papers, run_dir) =
        trained(&experiment, |e, dir, options| pinc_runs::control(e, dir, options, None, None))?;
    let system = experiment.plant.dyn_plant();
    let text = experiment.plant.equations().and_then(|equations| equations.compile_with(&[]).ok());
    let text = text.map(|plant| plant.into_dyn());
    let steps = model::run(
        case,
        (&*system, text.as_deref()),
        small.net.domain(),
        &[&small, &papers],
        effort,
    )?;
    for metrics in &run_dir.metrics().control {
        report.nmpc.push(nmpc(case, &experiment, metrics));
    }
    report.qp.extend(programs::run(case, effort.repetitions)?);
    report.model_step.extend(steps);
    Ok(())
}

/// Does `work` on the experiment, in a directory that is removed afterwards, and returns the net
/// too.
fn trained(
    experiment: &Experiment,
    work: impl FnOnce(&Experiment, &Path, &Options<'_>) -> Result<RunDir, RunError>,
) -> Result<(Trained, RunDir), RunError> {
    in_passing(|dir, options| {
        let run_dir = work(experiment, dir, options)?;
        let net = read_model(&dir.join(file::MODEL))?;
        let seconds = run_dir.metrics().training.as_ref().map_or(0.0, |training| training.wall_s);
        Ok((Trained { net, seconds }, run_dir))
    })
}

/// Does `work` quietly in a directory that is removed afterwards.
fn in_passing<T>(
    work: impl FnOnce(&Path, &Options<'_>) -> Result<T, RunError>,
) -> Result<T, RunError> {
    let temporary = std::env::temp_dir();
    let dir = tempfile::tempdir().map_err(RecordError::unwritable(&temporary))?;
    let options = Options {
        resume: false,
        verbosity: Verbosity::Quiet,
        interrupt: &AtomicBool::new(false),
        arguments: &[],
    };
    work(dir.path(), &options)
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
        qp_solver: experiment.control.as_ref().map_or_else(String::new, |control| {
            let sizes = [control.initial_state.len(), control.input_low.len()];
            control.sqp.qp.resolve(sizes, [control.n2, control.nu]).to_string()
        }),
    }
}

/// Steps of a closed loop.
fn steps(metrics: &ControlMetrics) -> f64 {
    to_f64(metrics.status.values().sum::<usize>() as u64)
}
