//! Experiments with PINC: configs, runs and their results, and the program `pinc`.
//!
//! - [`Experiment`]: a config file, resolved and checked ([`spec`] has its parts).
//! - [`run`], [`train`], [`control`], [`predict`], [`check`], [`rebuild_report`]: what the program does.
//! - [`sweep()`], [`merge`]: an experiment many times over.
//! - [`bench()`]: measurements of the machine.
//! - [`program`]: the command line; with [`Plants`] of your own, a `pinc` that knows them.
//! - [`RunDir`]: the results of a run, in its directory; [`Provenance`]: where they come from.
//!
//! ```
//! use pinc_bench::Experiment;
//!
//! let text = r#"
//!     name = "a-tank"
//!     preset = "ours"
//!     seed = 1
//!     [plant]
//!     one-tank = {}
//!     [model]
//!     horizon_s = 10.0
//!     hidden_layers = 2
//!     neurons = 8
//! "#;
//! let sets = ["model.neurons=16".to_owned()];
//! let experiment = Experiment::parse("a-tank.toml".as_ref(), text, &sets)?;
//! assert_eq!(experiment.model.unwrap().neurons, 16);
//!
//! let sets = ["model.neuron=16".to_owned()];
//! let error = Experiment::parse("a-tank.toml".as_ref(), text, &sets).unwrap_err();
//! assert!(error.to_string().contains("did you mean `neurons`?"));
//! # Ok::<(), pinc_bench::spec::ConfigError>(())
//! ```
//!
//! This is the only crate of the project that opens files, writes to the terminal and reads a clock.

mod bench;
mod cli;
mod clock;
pub mod console;
mod error;
mod one_step;
mod paper;
mod plants;
mod presets;
mod progress;
mod provenance;
mod record;
mod registry;
pub mod report;
mod runs;
pub mod spec;
mod summary;
mod sweep;

pub use bench::{
    BenchOptions, BenchReport, FmaPeak, LossGradient, Machine, ModelStep, NmpcTimes, QpTime, bench,
};
pub use cli::program;
pub use error::{BenchError, CheckpointProblem, CsvProblem};
pub use one_step::StepErrors;
pub use paper::{results, write_results};
pub use plants::Plants;
pub use presets::Preset;
pub use progress::Verbosity;
pub use provenance::{Invocation, Provenance};
pub use record::{
    ControlMetrics, Excess, Metrics, OneStepMetrics, OutsideDomain, PredictionMetrics, RunDir,
    StepTimes, SweepMetrics, TrainingMetrics, ValidationMetrics, WallTimes,
};
pub use runs::{
    Finding, Options, Severity, check, control, findings_json, predict, rebuild_report, run, train,
};
pub use spec::{Experiment, ModelKind, OutsidePolicy};
pub use summary::summary;
pub use sweep::{Shard, merge, sweep};
