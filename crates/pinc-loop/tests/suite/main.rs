//! Closed loops: their traces, errors, interruptions and broken bounds.

mod broken_bounds;
mod closed_loop;
mod parameters;
#[expect(dead_code, reason = "the tests of pinc-mpc use more of it")]
#[path = "../../../pinc-mpc/tests/suite/problems.rs"]
mod problems;
#[path = "../../../pinc-mpc/tests/suite/support.rs"]
mod support;
