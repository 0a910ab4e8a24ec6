//! The tests of pinc-config, as one program.

mod arrays;
mod common;
mod config;
mod estimator;
mod names;
mod schedules;
mod times;
mod uncertainty;
