//! The readings of the paper that an experiment can be run in, as data.

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use toml::Table;

/// A reading of the paper. Its defaults are the TOML file of its name in `presets/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The best that this project can do.
    Ours,
    /// The paper's equations, literally.
    AsPrinted,
    /// What the authors' program did.
    AsReleased,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Ours, Self::AsPrinted, Self::AsReleased];

    /// The preset's name in configs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::AsPrinted => "as-printed",
            Self::AsReleased => "as-released",
        }
    }

    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.name() == name)
    }

    /// The sections of a config, with this preset's values.
    pub(crate) fn defaults(self) -> Table {
        let text = match self {
            Self::Ours => include_str!("../../presets/ours.toml"),
            Self::AsPrinted => include_str!("../../presets/as-printed.toml"),
            Self::AsReleased => include_str!("../../presets/as-released.toml"),
        };
        text.parse().expect("the built-in presets are valid TOML, which a test checks")
    }
}
