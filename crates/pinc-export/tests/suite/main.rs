//! What is generated, compiled and run.

mod compile;
mod controller;
mod net;
mod wrappers;
