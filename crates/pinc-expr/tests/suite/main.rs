//! Plants whose equations are text.

#[path = "../../../pinc-ad/tests/suite/common.rs"]
mod common;
mod numbers;
mod outputs;
mod sparse;
mod syntax;
