//! The only module that writes to the terminal.

use crate::RunError;
use std::borrow::Cow;
use std::io::{self, ErrorKind, IsTerminal, Write};

/// Lines longer than this are shown without their middle.
const LONG: usize = 1000;
/// What is left of them at either end.
const END: usize = 400;

/// Writes a line to standard output. A reader that has closed its end is no error of the run.
///
/// # Errors
///
/// [`RunError::StandardOutput`] if the line cannot be written for another reason.
pub fn line(text: &str) -> Result<(), RunError> {
    written(writeln!(io::stdout().lock(), "{}", plain(text)))
}

/// Accepts a reader that wants no more, and no other reason why standard output takes nothing.
///
/// # Errors
///
/// [`RunError::StandardOutput`] for any other failure.
pub fn written(result: io::Result<()>) -> Result<(), RunError> {
    match result {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(RunError::StandardOutput(error)),
        _ => Ok(()),
    }
}

/// Writes a line to standard error.
pub fn note(text: &str) {
    let shown: Vec<_> = text.lines().map(|line| plain(&shortened(line)).into_owned()).collect();
    let _ = writeln!(io::stderr().lock(), "{}", shown.join("\n"));
}

/// A text whose characters do nothing to a terminal: configs and arguments come from anywhere.
fn plain(text: &str) -> Cow<'_, str> {
    let acts = |c: char| (c.is_control() && c != '\n' && c != '\t') || turns(c);
    if !text.contains(acts) {
        return text.into();
    }
    let mut plain = String::with_capacity(text.len());
    for c in text.chars() {
        match acts(c) {
            true => plain.extend(c.escape_default()),
            false => plain.push(c),
        }
    }
    plain.into()
}

/// Whether a character changes the direction of the text after it.
fn turns(c: char) -> bool {
    matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// A line that can be read, with how much of it is left out.
#[must_use]
pub fn shortened(line: &str) -> Cow<'_, str> {
    let length = line.chars().count();
    if length <= LONG {
        return line.into();
    }
    let (begin, end): (String, String) =
        (line.chars().take(END).collect(), line.chars().skip(length - END).collect());
    format!("{begin} [.. {} characters ..] {end}", length - 2 * END).into()
}

/// Whether somebody is looking at standard error.
pub(crate) fn is_watched() -> bool {
    io::stderr().is_terminal()
}

/// Asks whoever looks at standard error a question, if somebody does: whether the answer is yes.
pub fn confirmed(question: &str) -> Option<bool> {
    if !is_watched() || !io::stdin().is_terminal() {
        return None;
    }
    let _ = write!(io::stderr().lock(), "{} [y/N] ", plain(question));
    let mut answer = String::new();
    let read = io::stdin().read_line(&mut answer);
    Some(read.is_ok() && matches!(answer.trim(), "y" | "Y" | "yes"))
}

#[cfg(test)]
mod tests;
