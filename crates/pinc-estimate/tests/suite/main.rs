//! The estimators against answers of other programs, and against what theory says of them.

mod consistency;
mod filters;
mod gate;
mod models;
mod moving_horizon;
mod recorded;
mod support;
mod target;
mod widening;
