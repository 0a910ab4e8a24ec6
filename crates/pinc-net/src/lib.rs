//! PINC.
