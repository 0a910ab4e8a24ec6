//! What is generated, compiled and run.

mod compile;
mod controller;
mod feedback;
mod net;
mod variants;
mod wrappers;
