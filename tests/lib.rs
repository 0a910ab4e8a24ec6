//! Checks across crates.

/// The README: its Rust snippets are compiled and run as doctests.
#[cfg(doctest)]
#[derive(Debug)]
#[doc = include_str!("../README.md")]
pub struct Readme;
