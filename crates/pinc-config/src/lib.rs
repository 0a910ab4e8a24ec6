#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Experiment`]: a config file, resolved and checked; its sections are types of their own.
//! - [`RunList`]: a file that lists configs.
//! - [`Preset`]: a reading of the paper, with its defaults.
//! - [`Plants`]: plants that a program adds to the built-in ones.
//! - [`trials`]: the trials of an experiment with a sweep.

#![forbid(unsafe_code)]

mod arrays;
mod black_box;
mod control;
mod cost;
mod data;
mod estimator;
mod experiment;
mod free_time;
mod identified;
mod identify;
mod list;
mod load;
mod model_kind;
mod net_weights;
mod one_step;
mod plant;
mod plants;
mod prediction;
mod presets;
mod registry;
mod sampled;
mod scenarios;
mod schedule;
mod search;
mod slurm;
mod stages;
mod sweep;
mod training;
mod trial;
mod tune;
mod uncertainty;
mod validate;

pub use black_box::{FmuSpec, ProcessSpec};
pub use control::{
    ControlSpec, FirstPlanSpec, InputDifference, OnError, OutsidePolicy, Profile, ReferenceStep,
};
pub use cost::CostSpec;
pub use data::DataSpec;
pub use estimator::{
    DisturbanceSpec, EstimatorKind, EstimatorSpec, GateSpec, GateWord, MeasurementSpec,
    UnknownParameter,
};
pub use experiment::{Experiment, LoopParameters, sha256, steps};
pub use free_time::HorizonPlants;
pub use identify::{IdentifiedNet, IdentifiedParameter, IdentifyCriterion, IdentifySpec};
pub use list::{ListedRun, RunList};
pub use load::{LoadSpec, PlantInTheLoop};
pub use model_kind::ModelKind;
pub use one_step::OneStepSpec;
pub use pinc_expr::TimeUnit;
pub use pinc_toml::{ConfigError, Origin, Problem, SetProblem};
pub use plant::{
    BuiltInSpec, FourTanksParameters, FourTanksSpec, OwnPlantSpec, PlantSpec, VanDerPolSpec,
};
pub use plants::Plants;
pub use prediction::PredictionSpec;
pub use presets::Preset;
pub use registry::Variables;
pub use sampled::{CsvProblem, CsvRow, csv_rows};
pub use scenarios::{Combine, ScenarioSpec};
pub use schedule::{BoundStep, ParameterStep, Schedule};
pub use search::{HalvingSpec, SearchRange, SearchSpec};
pub use slurm::SlurmSpec;
pub use sweep::{AxisSpec, CaseSpec, DrawsSpec, RangeSpec, SweepSpec};
pub use training::{Effort, TrainingSpec};
pub use trial::{
    CANDIDATE, CASE, DRAW, DRAWN, SEED, SearchPlace, Trial, candidate, cell_columns, columns,
    sweep_models, trials,
};
pub use tune::{Candidate, TuneSpec};
pub use uncertainty::{
    FeedbackSpec, FeedbackWord, NetErrorSpec, NetErrorWord, ProbabilitySpec, TubeParts,
    UncertaintySpec, WorstCase,
};
pub use validate::limits::{HORIZON as MOST_N2, STEPS as MOST_STEPS, THREADS as MOST_THREADS};
pub use validate::repeated_file;
