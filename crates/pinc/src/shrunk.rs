//! `pinc shrink`: a net in place of a controller.

use crate::choices::{SetArgs, model_kind};
use crate::options::{arguments, verbosity};
use crate::printed::show;
use clap::builder::RangedI64ValueParser;
use pinc_bench::ShrinkOptions;
use pinc_config::{Experiment, ModelKind, Plants};
use pinc_runs::{Options, RunError, console};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// The most plans, iterations and loops.
const MOST: i64 = 4_294_967_295;

#[derive(Debug, clap::Args)]
pub(crate) struct ShrinkArgs {
    /// Config file (TOML).
    config: PathBuf,
    /// Model file (safetensors) of the net that is the controller's model.
    #[arg(long)]
    model: Option<PathBuf>,
    /// The controller's model, instead of the config's first.
    #[arg(long, value_parser = model_kind())]
    only: Option<ModelKind>,
    /// Directory of the results, by default `runs/`, the experiment's name and `-shrink`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Neurons in each of the two hidden layers.
    #[arg(long, default_value_t = ShrinkOptions::default().neurons, value_parser = count(1, 200))]
    neurons: usize,
    /// Plans to make and train on.
    #[arg(long, default_value_t = ShrinkOptions::default().samples, value_parser = count(100, MOST))]
    samples: usize,
    /// The most iterations of the training.
    #[arg(long, default_value_t = ShrinkOptions::default().iterations, value_parser = count(0, MOST))]
    iterations: usize,
    /// Closed loops to judge by, with states and references that were not trained on.
    #[arg(long, default_value_t = ShrinkOptions::default().loops, value_parser = count(1, MOST))]
    loops: usize,
    #[command(flatten)]
    set: SetArgs,
}

impl ShrinkArgs {
    /// Makes the net, judges it, and writes the judgement and the C.
    pub(crate) fn shrink(&self, plants: &Plants, quiet: bool) -> Result<(), RunError> {
        let experiment = Experiment::load(&self.config, &self.set.overrides(), plants)?;
        let Self { neurons, samples, iterations, loops, .. } = *self;
        let how = ShrinkOptions { neurons, samples, iterations, loops };
        let named = || Path::new("runs").join(format!("{}-shrink", experiment.name));
        let dir = self.out.clone().unwrap_or_else(named);
        let arguments = arguments();
        let verbosity = verbosity(quiet);
        // Ctrl-C ends the program at once: there is nothing that could be resumed.
        let interrupt = &AtomicBool::new(false);
        let options = Options { resume: false, verbosity, interrupt, arguments: &arguments };
        let model = (self.model.as_deref(), self.only);
        let shrunk = pinc_bench::shrink(&experiment, model, &dir, &options, how)?;
        show(quiet, &shrunk.to_string())?;
        if let Err(why) = &shrunk.c {
            console::note(&format!("no C: {why}"));
        }
        show(quiet, &dir.display().to_string())
    }
}

/// A number within these limits.
fn count(low: i64, high: i64) -> RangedI64ValueParser<usize> {
    RangedI64ValueParser::new().range(low..=high)
}
