//! The program and what it does, in one test program: each links all of it.

mod accuracy_cost;
mod bad_config;
mod bench;
mod check;
mod common;
mod control;
mod equations;
mod examples;
mod files;
mod guard;
mod kills;
mod limits;
mod lists;
mod measurements;
mod own_plant;
mod predict;
mod random;
mod resume;
mod run_directory;
mod smoke;
mod sweep;
