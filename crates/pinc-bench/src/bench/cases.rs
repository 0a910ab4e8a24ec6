//! The measured cases: the paper's two plants, as the shipped configs have them.

use pinc_config::{Experiment, Plants};
use pinc_runs::RunError;
use std::path::Path;

/// A plant of the paper, with its net and its closed loop.
#[derive(Clone, Copy, Debug)]
pub(super) enum Case {
    VanDerPol,
    FourTanks,
}

impl Case {
    pub(super) const ALL: [Self; 2] = [Self::VanDerPol, Self::FourTanks];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::VanDerPol => "van-der-pol",
            Self::FourTanks => "four-tanks",
        }
    }

    /// The paper's net and loss.
    pub(super) fn papers_training(self) -> Result<Experiment, RunError> {
        self.experiment(&["preset=\"as-printed\""])
    }

    /// The shipped closed loop, with `sets` over its values.
    pub(super) fn experiment(self, sets: &[&str]) -> Result<Experiment, RunError> {
        let (path, text) = match self {
            Self::VanDerPol => {
                ("configs/van-der-pol/control.toml", include_str!("../../configs/van-der-pol.toml"))
            }
            Self::FourTanks => {
                ("configs/four-tanks/control.toml", include_str!("../../configs/four-tanks.toml"))
            }
        };
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        Ok(Experiment::parse(Path::new(path), text, &sets, &Plants::built_in())?)
    }
}

/// How much work goes into the measurements.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort {
    /// Collocation points of the loss.
    pub(super) collocation_points: usize,
    /// Initial conditions of the loss.
    pub(super) initial_points: usize,
    /// Time for each setting of the kernel, in s.
    pub(super) kernel_s: f64,
    /// Rounds of the multiply-add probe: some milliseconds at a time.
    pub(super) probe_rounds: u64,
    /// Time for each model, with and without Jacobians, in s.
    pub(super) model_s: f64,
    /// Points of the one-step error.
    pub(super) one_step_points: usize,
    /// When the trainings of the small net and of the paper's end, as `--set` has it.
    pub(super) training: [&'static str; 2],
    /// How many times each closed loop is run.
    pub(super) repetitions: usize,
}

impl Effort {
    pub(super) fn new(quick: bool) -> Self {
        if quick {
            Self {
                collocation_points: 2000,
                initial_points: 20,
                kernel_s: 0.02,
                probe_rounds: 100_000,
                model_s: 0.005,
                one_step_points: 64,
                // Not by time: a busy machine must have nets that can be controlled with, too.
                training: ["training.phases.0.iterations=100", "training.phases.0.iterations=200"],
                repetitions: 1,
            }
        } else {
            Self {
                collocation_points: 100_000,
                initial_points: 1000,
                kernel_s: 1.5,
                probe_rounds: 2_000_000,
                model_s: 0.3,
                one_step_points: 4096,
                training: ["training.time_limit_s=2.0", "training.time_limit_s=4.0"],
                repetitions: 10,
            }
        }
    }
}
