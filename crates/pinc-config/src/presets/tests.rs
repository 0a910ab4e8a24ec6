//! Tests of the presets.

use super::*;
use crate::TrainingSpec;
use pinc_net::{Ansatz, Domain, NetConfig, TrainingConfig, ValidationConfig};

/// The same values twice: in the library, and in the preset's file for its readers.
#[test]
fn the_preset_ours_is_what_the_library_recommends() {
    let defaults: toml::Table = Preset::Ours.defaults().parse().unwrap();
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
