//! The tests of pinc-config, as one program.

mod arrays;
mod common;
mod config;
mod guide;
mod times;
