//! The examples run to their end; what they assert holds.

#[path = "../examples/01_kalman_filter.rs"]
mod kalman_filter;
#[path = "../examples/03_moving_horizon.rs"]
mod moving_horizon;
#[path = "../examples/02_unscented.rs"]
mod unscented;

#[test]
fn a_kalman_filter() {
    kalman_filter::main().unwrap();
}

#[test]
fn the_unscented_filter() {
    unscented::main().unwrap();
}

#[test]
fn moving_horizon_estimation() {
    moving_horizon::main().unwrap();
}
