#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`RunDir`]: the directory of a run, with its [`Metrics`] and its failures.
//! - [`TrainingRow`], [`DomainErrorTable`], [`PredictionTable`], [`ControlRow`], [`StepRow`],
//!   [`EstimateTable`]: the tables of a run.
//! - [`TrialTable`], [`SummaryTable`]: the tables of a sweep; [`SweepDir`]: where its trials are.
//! - [`metric`]: the list of metrics that sweeps, reports and comparisons show.
//! - [`work`]: which process works on which trial of a sweep.
//! - [`IdentificationMetrics`], [`ResidualTable`]: results of an identification.
//! - [`CertificateMetrics`]: proven and sampled errors of one step of a model.
//! - [`Provenance`]: the version, processor and command that gave the results.
//! - [`Saved`]: a training to resume.
//!
//! One type writes and reads each table; only it knows the names of the columns.

#![forbid(unsafe_code)]

mod certificate;
mod checkpoint;
pub mod columns;
mod consistency;
mod csv;
mod domain_error;
mod error;
mod files;
mod identification;
mod lock;
pub mod metric;
mod metrics;
mod provenance;
mod recorded;
mod run_dir;
mod search;
mod spread;
mod sweep_dir;
mod tables;
mod times;
mod verdict;
mod violation;
pub mod work;

pub use certificate::{ByName, CertificateMetrics, DomainCertificate};
pub use checkpoint::{Saved, load_checkpoint, save_checkpoint};
pub use csv::{CsvText, decimals, number};
pub use domain_error::{DomainErrorMetrics, Place, ProvenErrors, Rk4Errors};
pub use error::{CheckpointProblem, RecordError, TableProblem};
pub use files::{
    check_output, check_page, file, read_file, read_text, remove_unfinished, write_atomically,
    write_output,
};
pub use identification::{
    CorrelationMetrics, EstimateMetrics, HeldOutMetrics, IdentificationMetrics,
    InitialStateMetrics, InputCorrelationMetrics, MinimumMetrics, ParameterMetrics,
    ResidualMetrics, StartMetrics, WorkMetrics,
};
pub use metrics::{
    BrokenBounds, ControlMetrics, CostMetrics, DISTILLED, EstimatorMetrics, Excess, FileNote,
    FirstPlanMetrics, Metrics, ModelErrorMetrics, OneStepMetrics, OutsideDomain, PredictionMetrics,
    ReferenceMetrics, StepErrors, SweepMetrics, TrainingMetrics, TubeMetrics, ValidationMetrics,
    is_failure,
};
pub use provenance::{Invocation, Provenance, rfc3339};
pub use recorded::{RecordedColumns, RecordedRow, RecordedSteps, recorded_inputs};
pub use run_dir::RunDir;
pub use search::{Best, Eligibility, Search};
pub use spread::Spread;
pub use sweep_dir::{Claim, Ending, Finished, SweepDir, WorkerNote};
pub use tables::{
    ControlColumns, ControlReader, ControlRow, ControlWriter, DomainErrorTable, EstimateRow,
    EstimateTable, FixedReader, FixedWriter, Pair, PairRow, PredictionRow, PredictionTable,
    ResidualRow, ResidualTable, StatePairs, StepRow, SummaryRow, SummaryTable, TrainingRow,
    TrialColumn, TrialMetric, TrialStatus, TrialTable, UnknownMetric, fixed_table,
    read_fixed_table,
};
pub use times::{StepTimes, WallTimes, median, to_f64};
pub use verdict::{advice, significant};
pub use violation::ViolationMetrics;
