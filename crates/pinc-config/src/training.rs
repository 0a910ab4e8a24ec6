//! The `[training]` section.

use pinc_net::TrainingConfig;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// How the net is trained, and how long this machine works on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrainingSpec {
    /// The training itself.
    #[serde(flatten)]
    pub config: TrainingConfig,
    /// The largest error of one step that is to be proven over the domain, by state, in the state's
    /// unit. The training goes on, with the worst places added to its sample, until it is; states that
    /// are not named may have any error.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub proven_tolerance: BTreeMap<String, f64>,
    /// How long this machine may work on it.
    #[serde(flatten)]
    pub effort: Effort,
}

/// How long and how hard this machine works on a training.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effort {
    /// Wall time in s after which the training stops; no limit if absent. The net then depends on
    /// the speed of the machine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit_s: Option<f64>,
    /// Number of threads; 0 for one per core. The net does not depend on it.
    pub threads: usize,
    /// Wall time between two checkpoints, in s. The net does not depend on it.
    pub checkpoint_every_s: f64,
}

impl Default for Effort {
    fn default() -> Self {
        Self { time_limit_s: None, threads: 0, checkpoint_every_s: 5.0 }
    }
}

// `#[serde(flatten)]` would do, but buffers the table, which loses the key of an error inside it.
impl<'de> Deserialize<'de> for TrainingSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(SpecVisitor)
    }
}

struct SpecVisitor;

impl<'de> Visitor<'de> for SpecVisitor {
    type Value = TrainingSpec;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TrainingSpec, A::Error> {
        let (mut effort, mut proven_tolerance) = (Effort::default(), BTreeMap::new());
        let rest = Rest { map, effort: &mut effort, proven_tolerance: &mut proven_tolerance };
        let config = TrainingConfig::deserialize(MapAccessDeserializer::new(rest))?;
        Ok(TrainingSpec { config, proven_tolerance, effort })
    }
}

/// The keys that pinc-net does not know, as serde lists keys in an error.
const OWN_KEYS: &str = "`proven_tolerance`, `time_limit_s`, `threads`, `checkpoint_every_s`";

/// A table without these keys, which it takes out on the way.
struct Rest<'a, A> {
    map: A,
    effort: &'a mut Effort,
    proven_tolerance: &'a mut BTreeMap<String, f64>,
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for Rest<'_, A> {
    type Error = A::Error;

    fn next_key_seed<K: serde::de::DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, A::Error> {
        while let Some(key) = self.map.next_key::<String>()? {
            match key.as_str() {
                "proven_tolerance" => *self.proven_tolerance = self.map.next_value()?,
                "time_limit_s" => self.effort.time_limit_s = Some(self.map.next_value()?),
                "threads" => self.effort.threads = self.map.next_value()?,
                "checkpoint_every_s" => self.effort.checkpoint_every_s = self.map.next_value()?,
                _ => {
                    let key: serde::de::value::StringDeserializer<A::Error> =
                        key.into_deserializer();
                    // The list of known keys in the message ends with the keys of this table.
                    return seed.deserialize(key).map(Some).map_err(|error: A::Error| {
                        A::Error::custom(format!("{}, {OWN_KEYS}", error.to_string().trim_end()))
                    });
                }
            }
        }
        Ok(None)
    }

    fn next_value_seed<V: serde::de::DeserializeSeed<'de>>(
        &mut self,
        seed: V,
    ) -> Result<V::Value, A::Error> {
        self.map.next_value_seed(seed)
    }
}
