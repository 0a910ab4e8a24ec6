//! Derivatives of plans against central differences of the solver, and against formulas.

mod differences;
mod formulas;
#[expect(dead_code, reason = "the tests of pinc-mpc use more of it")]
#[path = "../../../pinc-mpc/tests/suite/problems.rs"]
mod problems;
mod refusals;
mod stream;
#[expect(dead_code, reason = "the tests of pinc-mpc use more of it")]
#[path = "../../../pinc-mpc/tests/suite/support.rs"]
mod support;
