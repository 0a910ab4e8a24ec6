//! Mistakes in a config, with their place.

use crate::lines::line_of;
use pinc_expr::{Excerpt, ExpressionError};
use pinc_ode::Variable;
use std::fmt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A config that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not TOML.
    #[error("{}:{line}: not valid TOML: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What the parser says.
        message: String,
    },
    /// A `--set` or `--unset` that cannot be applied.
    #[error("{argument}: {problem}")]
    Set {
        /// The option with its argument.
        argument: String,
        /// What is wrong with it.
        problem: SetProblem,
    },
    /// A key that is missing, unknown or has an unusable value.
    #[error("{origin}: `{key}`: {problem}")]
    Key {
        /// Where the value was written.
        origin: Origin,
        /// The key path, as `control.nu`.
        key: String,
        /// What is wrong with it.
        problem: Box<Problem>,
    },
}

/// Where a value of a config was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A line of the file.
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// In a `--set`, or where an `--unset` took it away: the option with its argument.
    Set(String),
    /// In the built-in defaults of a preset.
    Preset(&'static str),
}

impl ConfigError {
    /// A problem with a key of the file `path`, in the line in which its `text` has the key, or the
    /// innermost table around it.
    pub fn at_key(path: &Path, text: &str, key: impl Into<String>, problem: Problem) -> Self {
        let key = key.into();
        let origin = Origin::Line { path: path.to_owned(), line: line_of(text, &key) };
        Self::Key { origin, key, problem: Box::new(problem) }
    }
}

impl Problem {
    /// The problem of a word or name that is not among those known there.
    #[must_use]
    pub fn word(found: &str, known: &[String]) -> Self {
        let nearest = nearest(found, known);
        Self::Word { found: found.to_owned(), known: known.to_vec(), nearest }
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { path, line } => write!(f, "{}:{line}", path.display()),
            Self::Set(argument) => write!(f, "{argument}"),
            Self::Preset(name) => write!(f, "built-in preset {name}"),
        }
    }
}

/// A problem with a `--set` or `--unset` argument.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SetProblem {
    /// It has no `=` or no key.
    #[error("expected key=value, as training.lambda=0.5")]
    NoKey,
    /// It names no key to take away.
    #[error("expected a key, as training.lambda")]
    NothingToUnset,
    /// The value is neither TOML nor a bare word.
    #[error(
        "the value is not TOML (a string with other characters than a-z, 0-9, - and _ needs \
        quotes): {0}"
    )]
    Value(String),
    /// No such key is to be taken away.
    #[error("there is no key `{0}`; expected one that the config or its preset has")]
    Absent(String),
    /// The path leads through something that holds no keys.
    #[error("`{0}` is not a table, or has no such element")]
    Path(String),
}

/// More digits than the longest number of ordinary size has.
const LONG_NUMBER: usize = 24;

/// A problem with a key or its value.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Problem {
    /// A mandatory key that is not there.
    #[error("missing; expected {0}")]
    Missing(&'static str),
    /// A key that nobody knows.
    #[error("unknown key{}{}", one_of(.known), did_you_mean(.nearest))]
    Unknown {
        /// The keys that may stand there.
        known: Vec<String>,
        /// The one that looks most alike.
        nearest: Option<String>,
    },
    /// A word that is none of those expected.
    #[error("`{found}` is not known{}{}", one_of(.known), did_you_mean(.nearest))]
    Word {
        /// The word.
        found: String,
        /// The words that may stand there.
        known: Vec<String>,
        /// The one that looks most alike.
        nearest: Option<String>,
    },
    /// A value of the wrong type; the text names both types.
    #[error("{}", short_numbers(.0))]
    Type(String),
    /// NaN or infinity.
    #[error("{0} given, expected a finite number")]
    NotFinite(f64),
    /// A value out of its range.
    #[error("{} given, expected {}", short_numbers(.found), short_numbers(.expected))]
    Value {
        /// The value.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// A list of the wrong length.
    #[error("{found} values given, expected {expected}{}", entries(.names, .per))]
    Length {
        /// The length it has.
        found: usize,
        /// The length it must have.
        expected: usize,
        /// What there is one of each for.
        per: &'static str,
        /// The names of those, in order, where they have names.
        names: Vec<String>,
    },
    /// What is wrong with one trial of a sweep.
    #[error("in the trial with {trial}: `{key}`: {problem}")]
    Trial {
        /// The values that make the trial.
        trial: String,
        /// The key path.
        key: String,
        /// What is wrong with it.
        problem: Box<Problem>,
    },
    /// An equation of the plant.
    #[error("{}{}{}", .error.problem, did_you_mean(.nearest), excerpt(.error))]
    Expression {
        /// What is wrong with it, and the piece that is.
        error: Box<ExpressionError>,
        /// The name that looks most like an unknown one.
        nearest: Option<String>,
    },
    /// A section that the run needs.
    #[error("this section is missing; {0}")]
    Section(&'static str),
}

/// What a list has one value for.
fn entries(names: &[String], per: &str) -> String {
    match names {
        [] => format!(", one per {per}"),
        names => format!(": {}", Variable::grouped_names(names).join(", ")),
    }
}

fn one_of(known: &[String]) -> String {
    if known.is_empty() {
        return String::new();
    }
    format!("; expected one of {}", Variable::grouped_names(known).join(", "))
}

/// A text whose numbers have no hundreds of zeros.
fn short_numbers(text: &str) -> String {
    let short = |word: &str| {
        let number = word.trim_matches(|c| "`,:".contains(c));
        let value = number.parse::<f64>().ok().filter(|_| number.len() > LONG_NUMBER);
        value.map_or_else(|| word.to_owned(), |v| word.replace(number, &format!("{v:e}")))
    };
    text.split(' ').map(short).collect::<Vec<_>>().join(" ")
}

fn excerpt(error: &ExpressionError) -> String {
    error.text.as_ref().map(Excerpt::to_string).unwrap_or_default()
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or_else(String::new, |word| format!("; did you mean `{word}`?"))
}

/// The one of `known`, if any, that `word` is most likely a misspelling of.
#[must_use]
pub fn nearest(word: &str, known: &[String]) -> Option<String> {
    if word.len() > 100 {
        return None;
    }
    let distance = strsim::damerau_levenshtein;
    let lower = word.to_lowercase();
    let similar = known.iter().map(|k| (distance(&lower, &k.to_lowercase()), distance(word, k), k));
    let (distance, _, best) = similar.min()?;
    // A third of the letters wrong is a misspelling; more is another word.
    (3 * distance <= word.len().max(3)).then(|| best.clone())
}
