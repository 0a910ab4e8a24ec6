//! A finding of an examination.

use serde::Serialize;
use std::fmt;

/// How serious a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// A fact.
    Fact,
    /// Probably not what is wanted.
    Warning,
    /// A run cannot succeed.
    Error,
}

/// One thing found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How serious it is.
    pub severity: Severity,
    /// The key of the config that it is about, or a place in the plant; empty for the plant as a
    /// whole.
    pub place: String,
    /// The finding in words.
    pub what: String,
    /// Why it matters; empty for a fact.
    pub why: String,
    /// The advised change; empty for a fact.
    pub change: String,
}

impl Finding {
    pub(crate) fn fact(place: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(Severity::Fact, place, what)
    }

    pub(crate) fn warning(place: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(Severity::Warning, place, what)
    }

    pub(crate) fn error(place: impl Into<String>, what: impl Into<String>) -> Self {
        Self::new(Severity::Error, place, what)
    }

    fn new(severity: Severity, place: impl Into<String>, what: impl Into<String>) -> Self {
        let (place, what) = (place.into(), what.into());
        Self { severity, place, what, why: String::new(), change: String::new() }
    }

    /// This finding with the reason why it matters.
    pub(crate) fn because(self, why: impl Into<String>) -> Self {
        Self { why: why.into(), ..self }
    }

    /// This finding with the advised change.
    pub(crate) fn change(self, change: impl Into<String>) -> Self {
        Self { change: change.into(), ..self }
    }
}

/// How far the lines below the first are indented.
const INDENT: &str = "        ";

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.severity {
            Severity::Fact => "      ",
            Severity::Warning => "warn  ",
            Severity::Error => "ERROR ",
        })?;
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        f.write_str(&self.what)?;
        for (heading, text) in [("why", &self.why), ("change", &self.change)] {
            if !text.is_empty() {
                let text = text.replace('\n', &format!("\n{INDENT}    "));
                write!(f, "\n{INDENT}{heading}: {text}")?;
            }
        }
        Ok(())
    }
}
