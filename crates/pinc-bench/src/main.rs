//! The `pinc` program: see `pinc --help`.

use pinc_bench::Plants;
use std::process::ExitCode;

fn main() -> ExitCode {
    pinc_bench::program(&Plants::built_in())
}
