//! The examples run to their end; what they assert holds.
#![expect(clippy::duplicate_mod, reason = "each example takes up the net of the first")]

#[path = "../../examples/06_derivatives.rs"]
#[expect(dead_code, reason = "its `main` takes longer")]
mod derivatives;
#[path = "../../examples/02_long_horizon.rs"]
mod long_horizon;
#[path = "../../examples/04_measured_data.rs"]
mod measured_data;
#[path = "../../examples/03_save_and_load.rs"]
mod save_and_load;
#[path = "../../examples/01_train.rs"]
mod train;
#[path = "../../examples/05_unknown_parameter.rs"]
mod unknown_parameter;

#[test]
fn a_training() {
    train::main().unwrap();
}

#[test]
fn a_long_horizon() {
    long_horizon::main().unwrap();
}

#[test]
fn a_net_saved_and_loaded() {
    save_and_load::main().unwrap();
}

#[test]
fn measured_data() {
    measured_data::main().unwrap();
}

#[test]
fn an_unknown_parameter() {
    unknown_parameter::main().unwrap();
}

#[test]
fn derivatives_beside_values() {
    derivatives::short().unwrap();
}
