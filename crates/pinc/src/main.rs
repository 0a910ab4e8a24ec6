//! The `pinc` program: see `pinc --help`.

#![forbid(unsafe_code)]

use pinc::{Plants, program};
use std::process::ExitCode;

fn main() -> ExitCode {
    program(&Plants::built_in())
}
