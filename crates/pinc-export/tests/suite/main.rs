//! Tests that compile and run the generated code.

mod budgets;
mod change;
mod compile;
mod controller;
mod feedback;
mod feedback_fmu;
mod fmu;
mod fmu_modes;
mod guard;
mod net;
mod refusals;
mod rust_plants;
mod sensitivity;
mod single;
mod start;
mod variants;
mod wrappers;
