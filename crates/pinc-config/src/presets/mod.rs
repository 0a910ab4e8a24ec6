//! The readings of the paper that an experiment can be run in, as data.

#[cfg(test)]
mod tests;

use pinc_toml::Presets;
use serde::{Deserialize, Serialize};

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
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::AsPrinted => "as-printed",
            Self::AsReleased => "as-released",
        }
    }

    /// Its defaults: the sections of a config.
    const fn defaults(self) -> &'static str {
        match self {
            Self::Ours => include_str!("../../presets/ours.toml"),
            Self::AsPrinted => include_str!("../../presets/as-printed.toml"),
            Self::AsReleased => include_str!("../../presets/as-released.toml"),
        }
    }
}

/// All of them, for a file to choose from.
pub(crate) const PRESETS: Presets = Presets {
    texts: &[
        (Preset::Ours.name(), Preset::Ours.defaults()),
        (Preset::AsPrinted.name(), Preset::AsPrinted.defaults()),
        (Preset::AsReleased.name(), Preset::AsReleased.defaults()),
    ],
    expected: "the name of a preset: \"ours\", \"as-printed\" or \"as-released\"",
};
