//! The progress of a long run on the terminal.

use crate::console;
use indicatif::{ProgressBar, ProgressStyle};
use std::time::{Duration, Instant};

/// Time between two plain lines.
const LINE_EVERY: Duration = Duration::from_secs(3);

/// How progress is shown, on standard error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verbosity {
    /// A bar on a terminal, plain lines elsewhere.
    Shown,
    /// Not at all.
    Quiet,
}

/// The progress of one stage.
#[derive(Debug)]
pub struct Stage(Display);

/// How it is shown.
#[derive(Debug)]
enum Display {
    Bar(ProgressBar),
    Lines { name: String, total: u64, last: Option<Instant> },
    Quiet,
}

impl Stage {
    /// A stage of `total` units of work.
    ///
    /// # Panics
    ///
    /// Never: the template is a constant that was tried.
    pub fn begin(verbosity: Verbosity, name: &str, total: u64) -> Self {
        Self(match verbosity {
            Verbosity::Quiet => Display::Quiet,
            Verbosity::Shown if console::is_watched() => {
                let template = "{prefix:>12} {bar:30} {pos}/{len} {msg} [{elapsed}]";
                let style = ProgressStyle::with_template(template)
                    .expect("the template is a constant that was tried");
                let bar = ProgressBar::new(total).with_style(style).with_prefix(name.to_owned());
                Display::Bar(bar)
            }
            Verbosity::Shown => Display::Lines { name: name.to_owned(), total, last: None },
        })
    }

    /// A stage that is not shown unless it takes long, and whose total is not known yet.
    pub(crate) fn begin_late(verbosity: Verbosity, name: &str) -> Self {
        Self(match verbosity {
            Verbosity::Quiet => Display::Quiet,
            Verbosity::Shown => {
                Display::Lines { name: name.to_owned(), total: 0, last: Some(Instant::now()) }
            }
        })
    }

    /// How many units of work there are.
    pub(crate) fn set_total(&mut self, of: u64) {
        match &mut self.0 {
            Display::Bar(bar) => bar.set_length(of),
            Display::Lines { total, .. } => *total = of,
            Display::Quiet => {}
        }
    }

    /// Ends such a stage without a word.
    pub(crate) fn end_late(self) {
        match self.0 {
            Display::Bar(bar) => bar.finish_and_clear(),
            Display::Lines { .. } | Display::Quiet => {}
        }
    }

    /// Shows that `done` units are done; `message` is called only if it is shown.
    pub fn advance(&mut self, done: u64, message: impl FnOnce() -> String) {
        match &mut self.0 {
            Display::Bar(bar) => {
                // Drawn about ten times a second; composing the text is most of the cost.
                bar.set_position(done);
                bar.set_message(message());
            }
            Display::Lines { name, total, last } => {
                if last.is_none_or(|last| last.elapsed() >= LINE_EVERY) {
                    *last = Some(Instant::now());
                    let text = format!("{name}: {done}/{total} {}", message());
                    console::note(text.trim_end());
                }
            }
            Display::Quiet => {}
        }
    }

    /// Ends the stage with a message on how it went.
    pub fn end(self, message: &str) {
        match self.0 {
            Display::Bar(bar) => bar.finish_with_message(message.to_owned()),
            Display::Lines { name, .. } => console::note(&format!("{name}: {message}")),
            Display::Quiet => {}
        }
    }
}
