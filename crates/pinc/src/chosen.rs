//! `pinc choose`: the model of a config's loop.

use crate::choices::{RunArgs, seconds, share, timed};
use crate::options::{arguments, options};
use crate::printed::show;
use clap::Args;
use pinc_bench::{ChooseOptions, Timed};
use pinc_config::{Experiment, Plants};
use pinc_runs::RunError;
use std::path::PathBuf;

/// What to choose for, and how.
#[derive(Debug, Args)]
pub(crate) struct ChooseArgs {
    /// Config file (TOML).
    config: PathBuf,
    /// How far a good loop's IAE may exceed the most exact model's, as 1% or 0.01.
    #[arg(long, value_name = "SHARE", default_value = "1%", value_parser = share, allow_hyphen_values = true)]
    within: f64,
    /// Time limit, in s.
    #[arg(long, value_name = "SECONDS", default_value_t = 120.0, value_parser = seconds)]
    budget_s: f64,
    /// Whose control steps are timed: the program's, or exported C's, which needs a compiler cc.
    #[arg(long, default_value = "program", value_parser = timed())]
    target: Timed,
    #[command(flatten)]
    run: RunArgs,
}

impl ChooseArgs {
    /// Chooses, and prints the advice.
    pub(crate) fn choose(&self, plants: &Plants, quiet: bool) -> Result<(), RunError> {
        let experiment = Experiment::load(&self.config, &self.run.set.overrides(), plants)?;
        let dir = self.run.directory(&format!("{}-choose", experiment.name), false);
        let arguments = arguments();
        let options = options(self.run.resume, quiet, &arguments);
        let how =
            ChooseOptions { within: self.within, budget_s: self.budget_s, timed: self.target };
        let choice = pinc_bench::choose(&experiment, &dir, plants, &options, how)?;
        show(quiet, &choice.to_string())
    }
}
