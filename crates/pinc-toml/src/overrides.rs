//! `--set` and `--unset`.

use crate::problem::{ConfigError, SetProblem};
use toml::{Table, Value};

/// The option that takes a key away.
const UNSET: &str = "--unset ";

/// One `--set key.path=value`, or one `--unset key.path`, which has no value.
#[derive(Debug)]
pub(crate) struct Override {
    /// As errors show it.
    pub(crate) argument: String,
    pub(crate) key: String,
    pub(crate) value: Option<Value>,
}

impl Override {
    pub(crate) fn parse(text: &str) -> Result<Self, ConfigError> {
        let argument = if text.starts_with(UNSET) { text.into() } else { format!("--set {text}") };
        let fail = |problem| ConfigError::Set { argument: argument.clone(), problem };
        let (key, text) = match text.strip_prefix(UNSET) {
            Some(key) => (key, None),
            None => {
                let (key, text) = text.split_once('=').ok_or_else(|| fail(SetProblem::NoKey))?;
                (key, Some(text))
            }
        };
        let keys: Vec<_> = key.split('.').map(str::trim).collect();
        if keys.iter().any(|key| key.is_empty()) {
            let is_set = text.is_some();
            return Err(fail(if is_set { SetProblem::NoKey } else { SetProblem::NothingToUnset }));
        }
        let key = keys.join(".");
        let Some(text) = text else { return Ok(Self { argument, key, value: None }) };
        let value = match format!("value = {text}").parse::<Table>() {
            Ok(mut table) if table.len() == 1 => table.remove("value"),
            Ok(_) => None,
            Err(_) if is_bare_word(text.trim()) => Some(Value::String(text.trim().to_owned())),
            Err(error) => return Err(fail(SetProblem::Value(error.message().to_owned()))),
        };
        let one = || fail(SetProblem::Value("one value expected".to_owned()));
        let value = Some(value.ok_or_else(one)?);
        Ok(Self { argument, key, value })
    }

    /// The section that it mentions, if it gives a value there.
    pub(crate) fn section(&self) -> Option<&str> {
        self.value.as_ref().and(self.key.split('.').next())
    }
}

/// Whether a text that is not a TOML value can only be meant as a string.
fn is_bare_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}
