//! Errors of an experiment.

use pinc_config::{ConfigError, Experiment, ModelKind};
use pinc_estimate::EstimateError;
use pinc_export::ExportError;
use pinc_identify::IdentifyError;
use pinc_mpc::MpcError;
use pinc_net::{ModelError, NetError};
use pinc_ode::OdeError;
use pinc_record::{RecordError, UnknownMetric};
use pinc_report::ReportError;
use pinc_tube::TubeError;
use pinc_verify::VerifyError;
use std::path::PathBuf;
use thiserror::Error;

/// An error of this crate.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RunError {
    /// The config cannot be used.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file or directory that cannot be read or written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The error of a net that cannot be estimated.
    #[error("the error of the net cannot be estimated: {0}")]
    Verify(#[from] VerifyError),
    /// Something that was asked for and cannot be done.
    #[error("{subject}: {problem}")]
    Usage {
        /// What it is about: an experiment, a command, an argument or a file.
        subject: String,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// No integrator makes a loop that others could be compared with.
    #[error(
        "{name}: no model can be chosen, since no loop succeeded that others could be compared with{}: {reasons}",
        if *out_of_time { " so far (the time was up; --budget-s gives more)" } else { "" }
    )]
    NothingToChoose {
        /// Name of the experiment.
        name: String,
        /// Whether not all could be tried.
        out_of_time: bool,
        /// How each loop ended.
        reasons: String,
    },
    /// The C compiler that makes the binary of an FMU is missing or failed.
    #[error(
        "export: the FMU was not written, since the C compiler `cc` failed: {reason}; install a C \
        compiler, such as the package `gcc`"
    )]
    NoBinary {
        /// What the system or the compiler says.
        reason: String,
    },
    /// Something that cannot be exported.
    #[error("export: {0}")]
    Export(#[from] ExportError),
    /// A model file that holds no usable model.
    #[error("{}: {source}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: ModelError,
    },
    /// A cell, a row or the header of a CSV file.
    #[error("{}:{line}: {problem}", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What is wrong there.
        problem: CsvProblem,
    },
    /// A net about to be used outside the box that it was trained on, where that is refused.
    #[error(
        "the net would be used outside its training domain: {variable} is {excess:.3} beyond {low} \
        to {high}; \
         train on a larger [domain], or continue with outside_domain = \"report\""
    )]
    OutsideDomain {
        /// The variable.
        variable: String,
        /// Its distance from the box.
        excess: f64,
        /// The lower end.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// A net whose states are no numbers.
    #[error(
        "{}:{line}: the net's {variable} is {value} at this row; the inputs or the initial state are too \
         large for it, or the net is damaged",
        path.display()
    )]
    NotFinite {
        /// The file with the inputs.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// The state.
        variable: String,
        /// What it is.
        value: f64,
    },
    /// Standard output that takes nothing, as on a full disk.
    #[error("standard output cannot be written: {0}")]
    StandardOutput(std::io::Error),
    /// An estimator and its model that do not fit together.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
    /// A tube that does not suit its controller.
    #[error("[control.uncertainty]: {0}")]
    Tube(#[from] TubeError),
    /// A problem of identification that cannot be solved.
    #[error("identify: {0}")]
    Identify(#[from] IdentifyError),
    /// A problem of identification in a data file.
    #[error("{}: {source}", path.display())]
    IdentifyFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: IdentifyError,
    },
    /// A net whose error is not proven to be within `training.proven_tolerance`.
    #[error("{name}: training.proven_tolerance: {reason}")]
    NotProven {
        /// The experiment.
        name: String,
        /// Why not.
        reason: String,
    },
    /// Another error of a net or its training.
    #[error("training: {0}")]
    Net(#[from] NetError),
    /// Another error of the control problem, or a plant that could not be integrated in the loop.
    #[error("closed loop: {0}")]
    Control(#[from] MpcError),
    /// Too many steps of a controller failed.
    #[error(
        "the loop with {model} failed: {failed} of {steps} control steps failed, more than \
         control.max_failed_share = {allowed} allows; the results are kept"
    )]
    FailedSteps {
        /// The model in the controller.
        model: ModelKind,
        /// How many failed.
        failed: usize,
        /// The number of steps.
        steps: usize,
        /// The share that may fail.
        allowed: f64,
    },
    /// The truth could not be integrated.
    #[error("the plant cannot be integrated: {0}")]
    Plant(#[from] OdeError),
    /// The report could not be made.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// Some trials of a sweep ended with errors.
    #[error("{failed} of {trials} trials failed; {} says which and why", table.display())]
    FailedTrials {
        /// How many failed.
        failed: usize,
        /// The number of trials.
        trials: usize,
        /// The table that names them.
        table: PathBuf,
    },
    /// Some of several experiments ended with errors.
    #[error("{failed} of {runs} experiments failed; their errors are above")]
    FailedRuns {
        /// How many failed.
        failed: usize,
        /// The number of runs.
        runs: usize,
    },
    /// Slurm, or what is to talk to it.
    #[error("{program}: {said}; --dry-run writes the scripts without submitting them")]
    Slurm {
        /// The program that was called.
        program: String,
        /// What it says.
        said: String,
    },
    /// A sweep that is submitted once more before its jobs are over.
    #[error(
        "jobs of this sweep are still in Slurm's queue: {numbers}; wait for them, or run \
        `scancel {numbers}` first; finished trials are kept"
    )]
    Queued {
        /// Their numbers.
        numbers: String,
    },
    /// The user does not wait any longer.
    #[error("the jobs continue; `pinc status {}` shows their progress", dir.display())]
    StillQueued {
        /// The run directory.
        dir: PathBuf,
    },
    /// The user stopped the run.
    #[error("interrupted; continue with the same command and --resume (state in {})", dir.display())]
    Interrupted {
        /// The run directory.
        dir: PathBuf,
    },
}

/// A problem with a CSV file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CsvProblem {
    /// The file as such.
    #[error("not a CSV file: {0}")]
    Syntax(csv::Error),
    /// A column that is missing.
    #[error("column `{column}` is missing; expected {expected}")]
    MissingColumn {
        /// The column.
        column: String,
        /// All that are expected.
        expected: String,
    },
    /// A column that is not known, or there twice.
    #[error("column `{column}` is unexpected; expected {expected}, each once")]
    UnexpectedColumn {
        /// The column.
        column: String,
        /// All that are expected.
        expected: String,
    },
    /// A cell that is no finite number, or too large a one.
    #[error("column `{column}`: `{found}` given, expected a finite number up to 1e100")]
    Cell {
        /// The column.
        column: String,
        /// What is in the cell.
        found: String,
    },
    /// Times that do not increase.
    #[error("column `t`: {t} s given, expected more than {previous} s, the scenario's row before")]
    Time {
        /// The time.
        t: f64,
        /// The time of the row before.
        previous: f64,
    },
    /// Times that are not a step apart.
    #[error("column `t`: {t} s after {previous} s given, expected steps of T = {sample_time_s} s")]
    Spacing {
        /// The time.
        t: f64,
        /// The time of the row before.
        previous: f64,
        /// Length T of a step, in s.
        sample_time_s: f64,
    },
    /// A file without data.
    #[error("{rows} rows of data, expected {least} or more below the header")]
    TooFewRows {
        /// How many there are.
        rows: usize,
        /// How many are needed.
        least: usize,
    },
    /// Times that are not whole steps apart.
    #[error(
        "column `t`: {t} s after {previous} s given, expected a whole number of steps of T = \
         {sample_time_s} s; identify.step_s sets T for integrators"
    )]
    Grid {
        /// The time.
        t: f64,
        /// The time of the row before.
        previous: f64,
        /// Length T of a step, in s.
        sample_time_s: f64,
    },
    /// A time that is not within a step.
    #[error("column `t`: {t} s given, expected from 0 to T = {sample_time_s} s")]
    OutsideStep {
        /// The time.
        t: f64,
        /// Length T of a step, in s.
        sample_time_s: f64,
    },
    /// A time at which a distilled net is not defined.
    #[error(
        "column `t`: {t} s lies between steps of {sample_time_s} s, of which a net distilled from \
        an \
         integrator knows nothing; expected times on step marks"
    )]
    BetweenSteps {
        /// The time.
        t: f64,
        /// Length of a step, in s.
        sample_time_s: f64,
    },
    /// A gap that would take too many steps to cross.
    #[error("column `t`: {t} s is more than a million steps of T after the scenario's row before")]
    Gap {
        /// The time.
        t: f64,
    },
}

/// Whether nothing can be written for want of space, rather than at a wrong place.
fn is_full(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull, WriteZero};
    matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge | WriteZero)
}

impl RunError {
    /// See [`RunError::Usage`].
    pub fn usage(subject: impl ToString, problem: impl Into<String>) -> Self {
        Self::Usage { subject: subject.to_string(), problem: problem.into() }
    }

    /// The config `name` lacks a section that `command` needs.
    #[must_use]
    pub fn missing_section(name: &str, section: &str, command: &str) -> Self {
        let problem = format!("the config has no section [{section}], which `{command}` needs");
        Self::usage(name, problem)
    }

    /// The config's trials lack a metric that is to be minimized.
    #[must_use]
    pub fn unknown_metric(experiment: &Experiment, problem: &UnknownMetric) -> Self {
        Self::usage(&experiment.name, format!("`{}`: {problem}", problem.key))
    }

    /// The closed loop of the config `name` lacks the requested model.
    pub(crate) fn missing_model(name: &str, model: ModelKind) -> Self {
        Self::usage(name, format!("control.models does not contain `{}`", model.name()))
    }

    /// The net is to be the model, and no file has it.
    pub(crate) fn no_model_file(name: &str, command: &str) -> Self {
        let problem = format!(
            "`{command}` with the model `pinc` needs a trained net: give --model FILE \
             (`pinc train` makes one), or name another of the config's models with --only"
        );
        Self::usage(name, problem)
    }

    /// A controller or plant that cannot be written in another language.
    pub(crate) fn not_exportable(plant: &str, model: ModelKind) -> Self {
        let problem = format!(
            "the model `{}` of the plant `{plant}` cannot be written in C; it can for `pinc`, a \
             net, and for `rk4` and `rk5` of plants whose equations are known",
            model.name()
        );
        Self::usage("export", problem)
    }

    /// A command for controllers whose parameters do not change.
    pub(crate) fn with_schedule(name: &str, command: &str, key: &str) -> Self {
        let problem = format!(
            "`{command}` does not support {key}: remove the key, and give the current values in \
             control.parameters"
        );
        Self::usage(name, problem)
    }

    /// The exit code of the program: 2 for bad usage or input, 1 for a run that failed.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Net(NetError::Setting { .. } | NetError::Dimension { .. }) => 2,
            Self::Control(MpcError::Plant { .. }) | Self::OutsideDomain { .. } => 1,
            Self::NotProven { .. } => 1,
            Self::Net(_) | Self::Plant(_) | Self::FailedSteps { .. } | Self::NotFinite { .. } => 1,
            Self::Record(RecordError::Unwritable { source, .. }) if is_full(source) => 1,
            Self::Slurm { .. } | Self::Queued { .. } | Self::StillQueued { .. } => 1,
            Self::NothingToChoose { .. } | Self::StandardOutput(_) => 1,
            Self::Interrupted { .. } | Self::FailedTrials { .. } | Self::FailedRuns { .. } => 1,
            _ => 2,
        }
    }
}
