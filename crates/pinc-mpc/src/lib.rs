#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`NmpcProblem`]: the optimization problem of the paper, Eqs. (MS:*), with its [`Weights`] and
//!   [`Bounds`].
//! - [`Nmpc`]: the controller. Each step solves the problem by Gauss-Newton sequential quadratic
//!   programming and returns how that ended ([`SqpStatus`]) and how good the plan is
//!   ([`KktResidual`]).
//! - [`Reference`], [`Timetable`] and [`BoundSchedule`]: references, parameters and bounds that
//!   change over the steps and are known in advance.
//!
//! Integrators and neural nets implement one trait; the crate does not know which one a model is. It
//! prints nothing, opens no file and reads no clock.
//!
//! A failed optimization is a status, not an error, because the plant needs an input in any case. An
//! [`MpcError`] means that the parts do not fit together.

#![forbid(unsafe_code)]

mod bounds;
mod builder;
mod config;
mod constraint;
mod constraints;
mod controller;
mod cost;
mod curvature;
mod error;
mod guard;
mod guess;
mod horizon;
mod kkt;
mod linearization_cache;
mod merit;
mod outputs;
mod problem;
mod program;
mod reference;
mod report;
mod scenarios;
mod search;
mod solution;
mod sqp;
mod stage_cost;
mod stage_terms;
mod timetable;
mod tracked;
mod transcription;
mod units;
mod weights;
mod work;

pub use bounds::{Bounds, Softness};
pub use builder::NmpcBuilder;
pub use config::{SqpConfig, SqpHessian, SqpStatus};
pub use constraint::{Constraint, Side};
pub use constraints::{Constraints, StageConstraints};
pub use controller::Nmpc;
pub use curvature::LEAST_SIZE;
pub use error::{MpcError, check_finite};
pub use guard::{Judge, Trust};
pub use kkt::KktResidual;
pub use outputs::IntervalEnd;
pub use pinc_qp::{QpError, QpMethod, Tree};
pub use problem::NmpcProblem;
pub use program::{OutputPoint, Program};
pub use reference::Reference;
pub use report::StepReport;
pub use scenarios::Scenarios;
pub use search::{PlanSearch, Planner, Programs};
pub use solution::Solution;
pub use stage_cost::{QuadBlock, StageCost, StagePoint};
pub use timetable::{BoundSchedule, Bounded, Timetable};
pub use tracked::Tracked;
pub use units::ProblemUnits;
pub use weights::{PerStage, Weight, Weights};
pub use work::StepWork;
