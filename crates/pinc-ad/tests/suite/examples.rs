//! The examples run to their end; what they assert holds.

#[path = "../../examples/01_derivative.rs"]
mod derivative;
#[path = "../../examples/02_jacobian.rs"]
mod jacobian;
#[path = "../../examples/03_time_derivative_inside_a_gradient.rs"]
mod time_derivative;

#[test]
fn the_derivative() {
    derivative::main();
}

#[test]
fn the_jacobian() {
    jacobian::main();
}

#[test]
fn the_time_derivative_inside_a_gradient() {
    time_derivative::main();
}
