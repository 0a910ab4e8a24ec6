//! Runs of experiments, sweeps, measurements of the machine, and the program `pinc`.
//!
//! - [`run`], [`train`] (or [`train_watched`], which writes no files), [`control`], [`predict`],
//!   [`estimate`], [`identify`], [`check`], [`rebuild_report`]: what the program does with an
//!   [`Experiment`](pinc_config::Experiment).
//! - [`export_net`], [`export_controller`], [`export_plant`], [`serve`]: nets and controllers for
//!   other programs; [`LiveController`] is the controller that is served, step by step.
//! - [`compare`]: runs side by side.
//! - [`sweep()`], [`merge`], [`status`]: an experiment many times over.
//! - [`submit`], [`wait`]: a sweep as jobs of Slurm.
//! - [`choose()`]: which model should be in a loop.
//! - [`bench()`]: measurements of the machine.
//! - [`program`]: the command line; with [`Plants`] of your own, a `pinc` that
//!   knows them.
//!
//! This is the only crate of the project that writes to the terminal and reads a clock.

mod bench;
mod choices;
mod choose;
mod cli;
mod clock;
pub mod console;
mod error;
mod invocation;
mod one_step;
mod progress;
mod runs;
mod slurm;
mod summary;
mod sweep;

pub use bench::{
    BenchOptions, BenchReport, FmaPeak, LossGradient, Machine, ModelStep, NmpcTimes, QpTime, bench,
};
pub use choose::{Choice, ChooseOptions, choose};
pub use cli::program;
pub use error::{BenchError, CsvProblem};
pub use pinc_config::Plants;
pub use progress::Verbosity;
pub use runs::{
    Estimated, Finding, Follow, LiveController, LiveStep, ModelFile, Options, Severity, Target,
    TrainedNet, TrainingProgress, check, compare, control, estimate, export_controller, export_net,
    export_plant, findings_json, identification_summary, identify, predict, rebuild_report, run,
    serve, train, train_watched, verdict,
};
pub use slurm::{OnSlurm, Submitted, submit, wait};
pub use summary::summary;
pub use sweep::{Kept, Shard, Status, clear, kept, merge, status, sweep};
