//! The examples run to their end; what they assert holds.

#[path = "../examples/01_pumps.rs"]
mod pumps;

#[test]
fn pumps_and_outlets() {
    pumps::main().unwrap();
}
