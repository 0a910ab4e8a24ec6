//! The tests of pinc-config, as one program.

mod arrays;
mod common;
mod config;
mod estimator;
mod loops;
mod names;
mod scenarios;
mod schedules;
mod slurm;
mod times;
mod trials;
mod tune;
mod uncertainty;
