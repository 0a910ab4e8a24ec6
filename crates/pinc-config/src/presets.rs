//! The readings of the paper that an experiment can be run in, as data.

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
            Self::Ours => include_str!("../presets/ours.toml"),
            Self::AsPrinted => include_str!("../presets/as-printed.toml"),
            Self::AsReleased => include_str!("../presets/as-released.toml"),
        };
        text.parse().expect("the built-in presets are valid TOML, which a test checks")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrainingSpec;
    use pinc_net::{Ansatz, Domain, NetConfig, TrainingConfig, ValidationConfig};

    /// The same values twice: in the library, and in the preset's file for its readers.
    #[test]
    fn the_preset_ours_is_what_the_library_recommends() {
        let defaults = Preset::Ours.defaults();
        let section = |name: &str| defaults[name].clone();
        let training: TrainingSpec = section("training").try_into().unwrap();
        assert_eq!(training.config, TrainingConfig::recommended());

        let ansatz: Ansatz = section("model")["ansatz"].clone().try_into().unwrap();
        assert_eq!(ansatz, NetConfig::new(1.0, 1, 1).ansatz);

        let domain = Domain::new([0.0..=1.0], []);
        let mut validation = section("validation");
        let own = validation.as_table_mut().unwrap();
        own.insert("duration_s".to_owned(), 10.0.into());
        own.insert("domain".to_owned(), toml::Value::try_from(&domain).unwrap());
        let validation: ValidationConfig = validation.try_into().unwrap();
        assert_eq!(validation, ValidationConfig::new(10.0, domain));
    }
}
