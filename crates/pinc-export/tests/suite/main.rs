//! Tests that compile and run the generated code.

mod budgets;
mod compile;
mod controller;
mod feedback;
mod feedback_fmu;
mod fmu;
mod net;
mod rust_plants;
mod start;
mod variants;
mod wrappers;
