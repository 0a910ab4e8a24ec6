#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`sweep()`], [`merge`], [`status`]: an experiment many times over;
//! - [`submit`], [`wait`]: a sweep as jobs of Slurm;
//! - [`choose()`]: which model should be in a loop;
//! - [`tune()`]: which weights, bounds' softness, estimator and horizon;
//! - [`shrink()`]: a net in place of a controller;
//! - [`bench()`]: measurements of the machine.
//!
//! One experiment by itself is the job of [`pinc_runs`].

#![forbid(unsafe_code)]

mod bench;
mod choose;
mod shrink;
mod slurm;
mod sweep;
mod tune;

pub use bench::{
    BenchOptions, BenchReport, FmaPeak, LossGradient, Machine, ModelStep, NmpcTimes, QpTime, bench,
};
pub use choose::{Choice, ChooseOptions, Timed, choose};
pub use shrink::{ShrinkOptions, ShrunkController, shrink};
pub use slurm::{OnSlurm, Submitted, submit, wait};
pub use sweep::{Kept, Shard, Status, clear, kept, merge, status, sweep};
pub use tune::{Tuned, tune};
