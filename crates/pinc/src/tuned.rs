//! `pinc tune`: keys of the controller, tuned on drawn plants.

use crate::choices::{RunArgs, model_kind};
use crate::options::{arguments, options};
use crate::printed::show;
use clap::Args;
use pinc_config::{Experiment, ModelKind, Plants};
use pinc_runs::RunError;
use std::path::PathBuf;

/// What to tune.
#[derive(Debug, Args)]
pub(crate) struct TuneArgs {
    /// Config file (TOML) with a section [tune].
    config: PathBuf,
    /// Tune with this one of the config's models, instead of the first.
    #[arg(long, value_parser = model_kind())]
    only: Option<ModelKind>,
    #[command(flatten)]
    run: RunArgs,
}

impl TuneArgs {
    /// Tunes, and prints the result.
    pub(crate) fn tune(&self, plants: &Plants, quiet: bool) -> Result<(), RunError> {
        let experiment = Experiment::load(&self.config, &self.run.set.overrides(), plants)?;
        let dir = self.run.directory(&format!("{}-tune", experiment.name), false);
        let arguments = arguments();
        let options = options(self.run.resume, quiet, &arguments);
        let tuned = pinc_bench::tune(&experiment, &dir, &options, self.only)?;
        show(quiet, &tuned.to_string())
    }
}
