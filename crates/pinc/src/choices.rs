//! The values of command line arguments, and the arguments that several commands share.

use clap::builder::{PossibleValue, PossibleValuesParser, RangedI64ValueParser, TypedValueParser};
use pinc_bench::{OnSlurm, Shard, Timed};
use pinc_config::{ModelKind, OutsidePolicy};
use pinc_export::FmiVersion;
use pinc_runs::{Certify, RunError, Target};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// What to do where a net is evaluated outside its training domain.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum Outside {
    /// Continue, and report how often and how far.
    Report,
    /// Stop there.
    Refuse,
}

impl Outside {
    pub(crate) fn policy(self) -> OutsidePolicy {
        match self {
            Self::Report => OutsidePolicy::Report,
            Self::Refuse => OutsidePolicy::Refuse,
        }
    }
}

/// One of the models that a controller can have.
pub(crate) fn model_kind() -> impl TypedValueParser<Value = ModelKind> {
    let choice = |kind: ModelKind| PossibleValue::new(kind.name()).help(kind.title());
    let kind = |name: String| ModelKind::from_name(&name).expect("one of the possible values");
    PossibleValuesParser::new(ModelKind::ALL.map(choice)).map(kind)
}

/// Whose control steps `pinc choose` times.
pub(crate) fn timed() -> impl TypedValueParser<Value = Timed> {
    let known = |name: String| Timed::from_name(&name).expect("one of the possible values");
    PossibleValuesParser::new(Timed::ALL.map(Timed::name)).map(known)
}

/// What `pinc certify` judges.
#[derive(Debug, clap::Args)]
pub(crate) struct CertifyArgs {
    /// Model file (safetensors) of the net.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Judge an integrator instead of a net.
    #[arg(long, value_parser = model_kind())]
    only: Option<ModelKind>,
    /// Number of random points of the domain to judge; by default 1000, or 0 with other points.
    #[arg(long, value_name = "N", value_parser = count(0))]
    points: Option<usize>,
    /// Judge the rows of a CSV file too: columns for states and inputs.
    #[arg(long, value_name = "FILE")]
    data: Option<PathBuf>,
    /// Judge the states and inputs of a run's closed loop too.
    #[arg(long = "run", value_name = "DIR")]
    of_run: Option<PathBuf>,
    /// Prove a bound over the whole domain.
    #[arg(long)]
    domain: bool,
    /// Time limit of the proof over the domain, in s.
    #[arg(long, value_name = "SECONDS", value_parser = seconds, requires = "domain")]
    budget_s: Option<f64>,
    /// Check the certificate in the model file instead: compare hashes and prove the bounds again.
    #[arg(long, requires = "model", conflicts_with_all = ["only", "points", "data", "of_run", "domain"])]
    verify: bool,
}

impl CertifyArgs {
    /// The model file, and the model that is judged.
    pub(crate) fn model(&self) -> (Option<&Path>, Option<ModelKind>) {
        (self.model.as_deref(), self.only)
    }

    /// The model file whose certificate is to be checked, if that is asked for.
    pub(crate) fn certified(&self) -> Option<&Path> {
        self.model.as_deref().filter(|_| self.verify)
    }

    pub(crate) fn what(&self) -> Certify {
        let Self { points, domain, budget_s, .. } = *self;
        let (data, run) = (self.data.clone(), self.of_run.clone());
        Certify { points, data, run, domain, budget_s }
    }
}

/// Where a command's results go.
#[derive(Debug, clap::Args)]
pub(crate) struct RunArgs {
    /// Run directory; by default `runs/NAME` with the experiment's name, after which some commands put
    /// their own. With several configs, the folder that holds their run directories.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Resume the run in the run directory.
    #[arg(long)]
    pub(crate) resume: bool,
    #[command(flatten)]
    pub(crate) set: SetArgs,
}

/// What a command overrides of its config.
#[derive(Debug, clap::Args)]
pub(crate) struct SetArgs {
    /// Override a value of the config, such as training.lambda=0.5 (repeatable).
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Remove a key from the config, such as control.preview (repeatable); applied before `--set`.
    #[arg(long = "unset", value_name = "KEY")]
    unset: Vec<String>,
}

impl SetArgs {
    /// Returns an error if there are overrides, where there is no config.
    pub(crate) fn without_config(&self) -> Result<(), RunError> {
        let option = if self.set.is_empty() { "--unset" } else { "--set" };
        match self.overrides().is_empty() {
            true => Ok(()),
            false => Err(RunError::usage(option, "changes a config, and none is given")),
        }
    }

    /// The overrides, as [`pinc_config::Experiment::load`] takes them.
    pub(crate) fn overrides(&self) -> Vec<String> {
        let unset = self.unset.iter().map(|key| format!("--unset {key}"));
        unset.chain(self.set.iter().cloned()).collect()
    }
}

/// Where a sweep runs, if not in this process.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum On {
    /// Slurm, which must be installed.
    Slurm,
}

/// How a sweep is run.
#[derive(Debug, clap::Args)]
pub(crate) struct SweepArgs {
    /// Run only a share of a sweep: 3/8 is the third of eight.
    #[arg(long, value_name = "K/N", value_parser = shard, allow_hyphen_values = true)]
    shard: Option<Shard>,
    /// Share a sweep with other processes that work in the same run directory.
    #[arg(long)]
    shared: bool,
    /// Discard the sweep's results in the run directory.
    #[arg(long, conflicts_with = "resume")]
    pub(crate) fresh: bool,
    /// Submit a sweep to Slurm as a job array, followed by a merge.
    #[arg(long, value_enum, conflicts_with_all = ["shard", "shared"])]
    on: Option<On>,
    /// Number of jobs that share the sweep.
    #[arg(long, requires = "on", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    jobs: Option<u16>,
    /// An option of sbatch, such as partition=short or time=02:00:00, or modules=NAME,.. (repeatable).
    #[arg(long, value_name = "KEY=VALUE", requires = "on")]
    slurm: Vec<String>,
    /// Write Slurm's scripts without submitting them.
    #[arg(long, requires = "on")]
    dry_run: bool,
    /// Wait for the jobs and show their progress.
    #[arg(long, requires = "on", conflicts_with = "dry_run")]
    wait: bool,
}

impl SweepArgs {
    /// The share to run, if the experiment has to be a sweep.
    pub(crate) fn shard(&self) -> Option<Shard> {
        let part = Shard { shared: self.shared, ..self.shard.unwrap_or(Shard::WHOLE) };
        (self.shard.is_some() || self.shared).then_some(part)
    }

    /// How the sweep is given to Slurm, if it is.
    pub(crate) fn on_slurm(&self) -> Option<OnSlurm> {
        self.on.map(|On::Slurm| OnSlurm {
            jobs: self.jobs.map(usize::from),
            options: self.slurm.clone(),
            dry_run: self.dry_run,
            wait: self.wait,
        })
    }
}

/// A share of a sweep, written K/N.
fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((number, of)) if (1..=of).contains(&number) => Ok(Shard { number, of, shared: false }),
        _ => Err("expected K/N with K from 1 to N, as 3/8".to_owned()),
    }
}

/// A format of exports.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub(crate) enum To {
    /// C99 without dependencies.
    C,
    /// C for CasADi's `external`, with exact Jacobian and Hessian.
    Casadi,
    /// A co-simulation FMU, with its sources.
    Fmu,
    /// An ONNX file.
    Onnx,
}

impl To {
    /// The target with `--double` and `--fmi3`, each of which belongs to one format.
    pub(crate) fn target(self, double: bool, fmi3: bool) -> Result<Target, RunError> {
        let expected = |option: &str, format: &str| {
            Err(RunError::usage(option, format!("expected with `--to {format}` only")))
        };
        match (self, double, fmi3) {
            (Self::C, false, false) => Ok(Target::C),
            (Self::Casadi, false, false) => Ok(Target::Casadi),
            (Self::Fmu, false, false) => Ok(Target::Fmu(FmiVersion::Two)),
            (Self::Fmu, false, true) => Ok(Target::Fmu(FmiVersion::Three)),
            (Self::Onnx, false, false) => Ok(Target::Onnx),
            (Self::Onnx, true, false) => Ok(Target::OnnxDouble),
            (Self::C | Self::Casadi | Self::Fmu, true, _) => expected("--double", "onnx"),
            (Self::C | Self::Casadi | Self::Onnx, _, true) => expected("--fmi3", "fmu"),
        }
    }
}

/// A share, written 1% or 0.01.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    let (number, unit) = match text.trim().strip_suffix('%') {
        Some(number) => (number, 0.01),
        None => (text, 1.0),
    };
    let share = number.trim().parse::<f64>().ok().map(|number| unit * number);
    let is_share = |share: &f64| *share > 0.0 && *share <= 1.0;
    share
        .filter(is_share)
        .ok_or_else(|| "expected a share above 0, up to 1, as 1% or 0.01".to_owned())
}

/// A whole number from `least` on.
pub(crate) fn count(least: i64) -> RangedI64ValueParser<usize> {
    RangedI64ValueParser::new().range(least..)
}

/// A number of seconds.
pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|s| *s > 0.0 && s.is_finite());
    seconds.ok_or_else(|| "expected a positive number of seconds, as 120".to_owned())
}

/// An address of this machine that no other machine reaches.
pub(crate) fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address = text.parse::<SocketAddr>().ok().filter(|address| address.ip().is_loopback());
    address.ok_or_else(|| "expected an address of this machine, as 127.0.0.1:5025".to_owned())
}
