//! The examples run to their end; what they assert holds.

#[path = "../../examples/02_config_and_check.rs"]
mod config_and_check;
#[path = "../../examples/01_net_in_the_loop.rs"]
mod net_in_the_loop;

#[test]
fn a_net_in_the_loop() {
    net_in_the_loop::main().unwrap();
}

#[test]
fn a_config_and_its_check() {
    config_and_check::main().unwrap();
}
