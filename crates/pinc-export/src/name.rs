//! The name that everything exported begins with.

use crate::ExportError;

/// No longer name is allowed: linkers and PLCs have their limits.
const LONGEST: usize = 31;

/// What would make other sense in a program.
const WORDS: [&str; 8] = ["double", "float", "int", "char", "long", "short", "void", "static"];

/// The name of an exported net or controller, by which its files and all symbols begin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Name(String);

impl Name {
    /// The name `text`.
    ///
    /// # Errors
    ///
    /// [`ExportError::Name`] if it is no identifier.
    pub fn new(text: &str) -> Result<Self, ExportError> {
        let first = text.chars().next().is_some_and(|c| c.is_ascii_alphabetic());
        let rest = text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if first && rest && text.len() <= LONGEST && !WORDS.contains(&text) {
            Ok(Self(text.to_owned()))
        } else {
            Err(ExportError::Name { found: text.to_owned() })
        }
    }

    /// The name nearest to `text`: other characters become underscores.
    #[must_use]
    pub fn nearest(text: &str) -> Self {
        let kept = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
        let name: String = text.chars().map(kept).take(LONGEST).collect();
        let name = name.trim_matches('_').to_owned();
        Self::new(&name).unwrap_or_else(|_| Self("model".to_owned()))
    }

    /// As text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_identifiers() {
        assert_eq!(Name::new("tank_2").unwrap().as_str(), "tank_2");
        for bad in ["", "2tanks", "a-b", "_x", "double", "ä", &"a".repeat(32)] {
            assert!(matches!(Name::new(bad), Err(ExportError::Name { .. })), "{bad}");
        }
        assert_eq!(Name::nearest("four-tanks-Main").as_str(), "four_tanks_main");
        assert_eq!(Name::nearest("--Tank 1--").as_str(), "tank_1");
        assert_eq!(Name::nearest("--").as_str(), "model");
        // The longest name, and the beginning of a longer one.
        assert_eq!(Name::new(&"a".repeat(31)).unwrap().as_str().len(), 31);
        assert_eq!(Name::nearest(&format!("{}-bc", "a".repeat(30))).as_str(), "a".repeat(30));
        assert_eq!(Name::nearest("void").as_str(), "model");
        assert_eq!(Name::nearest("4").as_str(), "model");
    }
}
