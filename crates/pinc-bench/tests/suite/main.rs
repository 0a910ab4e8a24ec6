//! The program and what it does, in one test program: each links all of it.

mod accuracy_cost;
mod bad_config;
mod bench;
mod check;
mod closed;
mod common;
mod control;
mod equations;
mod estimation;
mod examples;
mod export;
mod family;
mod files;
mod guard;
mod limits;
mod lists;
mod measurements;
mod own_plant;
mod predict;
mod resume;
mod run_directory;
mod serve;
mod smoke;
mod sweep;
mod traps;
