//! The examples run to their end; what they assert holds.

#[path = "../examples/01_closed_loop.rs"]
mod closed_loop;
#[path = "../examples/02_constraints.rs"]
mod constraints;
#[path = "../examples/03_deadline.rs"]
mod deadline;
#[path = "../examples/04_long_horizon.rs"]
mod long_horizon;

#[test]
fn a_closed_loop() {
    closed_loop::main().unwrap();
}

#[test]
fn own_constraints() {
    constraints::main().unwrap();
}

#[test]
fn a_deadline() {
    deadline::main().unwrap();
}

#[test]
fn a_long_horizon() {
    long_horizon::main().unwrap();
}
