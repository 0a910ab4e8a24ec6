//! Checks across crates, and the pages of the book that are made from other files.

pub mod book;

/// The README: its Rust snippets are compiled and run as doctests.
#[cfg(doctest)]
#[derive(Debug)]
#[doc = include_str!("../README.md")]
pub struct Readme;
