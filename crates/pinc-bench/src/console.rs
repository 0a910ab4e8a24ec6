//! The only module that writes to the terminal.

use std::io::{self, IsTerminal, Write};

/// Writes a line to standard output. If the reader has closed its end, that is no error of the run.
pub fn line(text: &str) {
    let _ = writeln!(io::stdout().lock(), "{text}");
}

/// Writes a line to standard error.
pub fn note(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Whether somebody is looking at standard error.
pub(crate) fn is_watched() -> bool {
    io::stderr().is_terminal()
}
