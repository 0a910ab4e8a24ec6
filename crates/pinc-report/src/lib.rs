#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`build`]: the report of a run directory, one HTML page, and its pictures as files.
//! - [`compare`]: runs side by side.
//! - [`results`], [`write_results`]: the paper's tables and figures beside a list of runs.
//!
//! Everything is made from the types of [`pinc_record`] that wrote the files. A picture is first a
//! [`pinc_chart::Figure`], plain data, and then drawn.

#![forbid(unsafe_code)]

mod compare;
mod control;
mod data;
mod decimation;
mod domain_error;
mod error;
mod estimates;
mod html;
mod identification;
mod model_error;
mod number_tables;
mod paper;
mod picture;
mod prediction;
mod profile;
mod report;
mod steps;
mod summary_text;
mod sweep;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod traces;
mod training;
mod trials;
mod variables;
mod zoom;

pub use compare::{Comparison, compare};
pub use error::ReportError;
pub use paper::{results, write_results};
pub use pinc_chart::{BoxMap, MapLabels, ValuedBox};
pub use report::{FigureFiles, Report, build};
