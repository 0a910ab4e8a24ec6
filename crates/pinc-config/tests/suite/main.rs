//! The tests of pinc-config, as one program.

mod arrays;
mod common;
mod config;
mod estimator;
mod names;
mod scenarios;
mod schedules;
mod slurm;
mod times;
mod tune;
mod uncertainty;
