//! The examples run to their end; what they assert holds.

#[path = "../../examples/02_integrators.rs"]
mod integrators;
#[path = "../../examples/03_linearize.rs"]
mod linearize;
#[path = "../../examples/01_own_plant.rs"]
mod own_plant;

#[test]
fn an_own_plant() {
    own_plant::main().unwrap();
}

#[test]
fn integrators_compared() {
    integrators::main().unwrap();
}

#[test]
fn a_model_linearized() {
    linearize::main();
}
