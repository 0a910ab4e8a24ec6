//! Sweeps of experiments, the choice of a model, measurements of the machine, and the program
//! `pinc`.
//!
//! - what is done with one experiment is in pinc-runs: [`run`], [`train`], [`control`] and others;
//! - [`sweep()`], [`merge`], [`status`]: an experiment many times over.
//! - [`submit`], [`wait`]: a sweep as jobs of Slurm.
//! - [`choose()`]: which model should be in a loop.
//! - [`bench()`]: measurements of the machine.
//! - [`program`]: the command line; with [`Plants`] of your own, a `pinc` that
//!   knows them.

mod bench;
mod choices;
mod choose;
mod cli;
mod slurm;
mod summary;
mod sweep;

pub use bench::{
    BenchOptions, BenchReport, FmaPeak, LossGradient, Machine, ModelStep, NmpcTimes, QpTime, bench,
};
pub use choose::{Choice, ChooseOptions, choose};
pub use cli::program;
pub use pinc_config::Plants;
pub use pinc_runs::{
    CsvProblem, Estimated, Finding, Follow, LiveController, LiveStep, ModelFile, Options, RunError,
    Severity, Target, TrainedNet, TrainingProgress, Verbosity, check, compare, console, control,
    estimate, export_controller, export_net, export_plant, findings_json, identification_summary,
    identify, predict, rebuild_report, run, serve, train, train_watched, verdict,
};
pub use slurm::{OnSlurm, Submitted, submit, wait};
pub use summary::summary;
pub use sweep::{Kept, Shard, Status, clear, kept, merge, status, sweep};
