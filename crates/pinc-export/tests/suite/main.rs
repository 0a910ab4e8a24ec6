//! What is generated, compiled and run.

mod compile;
mod net;
