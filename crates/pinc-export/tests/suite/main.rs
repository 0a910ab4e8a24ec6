//! What is generated, compiled and run.

mod budgets;
mod compile;
mod controller;
mod feedback;
mod net;
mod rust_plants;
mod variants;
mod wrappers;
