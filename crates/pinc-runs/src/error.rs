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
    /// Something that was done and did not succeed.
    #[error("{0}")]
    Failed(String),
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
        problem: String,
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
    /// Another error of a net or its training.
    #[error("training: {0}")]
    Net(#[from] NetError),
    /// Another error of the control problem, or a plant that could not be integrated in the loop.
    #[error("closed loop: {0}")]
    Control(#[from] MpcError),
    /// The truth could not be integrated.
    #[error("the plant cannot be integrated: {0}")]
    Plant(#[from] OdeError),
    /// The report could not be made.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// The user stopped the run.
    #[error("interrupted; continue with the same command and --resume (state in {})", dir.display())]
    Interrupted {
        /// The run directory.
        dir: PathBuf,
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

    /// A config lacks a section that `command` needs.
    #[must_use]
    pub fn missing_section(config: &Experiment, section: &str, command: &str) -> Self {
        let problem = format!("the config has no section [{section}], which `{command}` needs");
        Self::usage(config.source(), problem)
    }

    /// The config's trials lack a metric that is to be minimized.
    #[must_use]
    pub fn unknown_metric(experiment: &Experiment, problem: &UnknownMetric) -> Self {
        Self::usage(experiment.source(), format!("`{}`: {problem}", problem.key))
    }

    /// The closed loop of the config lacks the `model` that `option` asks for.
    #[must_use]
    pub fn missing_model(config: &Experiment, option: &str, model: ModelKind) -> Self {
        let models = config.control.iter().flat_map(|control| &control.models);
        let known = models.map(|kind| kind.name()).collect::<Vec<_>>().join(", ");
        let problem = format!("control.models does not contain `{}`, it has {known}", model.name());
        Self::usage(format!("{option}: {}", config.source()), problem)
    }

    /// A net is given beside models that use none.
    pub(crate) fn unused_net(command: &str, models: &[ModelKind]) -> Self {
        let models = models.iter().map(|kind| kind.name()).collect::<Vec<_>>().join("\", \"");
        let problem = format!("a model file is given, but no model is a net: \"{models}\"");
        Self::usage(format!("`{command}`"), problem + "; leave one of them out")
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

    /// Whether it is of this run alone, and the same every time: another model or config may do better.
    #[must_use]
    pub fn is_of_this_run(&self) -> bool {
        match self {
            Self::Net(NetError::Threads(_)) => false,
            Self::Failed(_) | Self::Net(_) | Self::Control(_) | Self::Plant(_) => true,
            Self::Estimate(_) | Self::Tube(_) | Self::Verify(_) => true,
            Self::Config(_) | Self::Record(_) | Self::Usage { .. } | Self::Export(_) => false,
            Self::Model { .. } | Self::Csv { .. } | Self::StandardOutput(_) => false,
            Self::Identify(_) | Self::IdentifyFile { .. } => false,
            Self::Report(_) | Self::Interrupted { .. } => false,
        }
    }

    /// The exit code of the program: 2 for bad usage or input, 1 for a run that failed.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Net(NetError::Setting { .. } | NetError::Dimension { .. }) => 2,
            Self::Control(MpcError::Plant { .. }) | Self::Net(_) | Self::Plant(_) => 1,
            Self::Record(RecordError::Unwritable { source, .. }) if is_full(source) => 1,
            Self::Failed(_) | Self::StandardOutput(_) | Self::Interrupted { .. } => 1,
            _ => 2,
        }
    }
}
