//! Plants whose equations are text.

mod algebraic;
mod arrays;
#[path = "../../../pinc-ad/tests/suite/common.rs"]
mod common;
mod cost;
mod nets;
mod numbers;
mod on_dual_numbers;
mod outputs;
mod sparse;
mod syntax;
mod time;
mod traced;
