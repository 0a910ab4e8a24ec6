//! The examples run to their end; what they assert holds.

#[path = "../examples/01_pumps.rs"]
mod pumps;
#[path = "../examples/02_segments.rs"]
mod segments;

#[test]
fn pumps_and_outlets() {
    pumps::main().unwrap();
}

#[test]
fn a_chaotic_system_in_segments() {
    segments::main().unwrap();
}
