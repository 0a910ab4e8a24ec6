//! The `pinc` program: see `pinc --help`.

use pinc::{Plants, program};
use std::process::ExitCode;

fn main() -> ExitCode {
    program(&Plants::built_in())
}
