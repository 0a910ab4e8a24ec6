//! Names and units of states and inputs.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;

/// Name and unit of a state or an input.
///
/// In files it is a table `{ name = "x1", unit = "m" }`, or the name alone where there is no unit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variable {
    /// The name, used as column name and axis label.
    pub name: Cow<'static, str>,
    /// The unit; empty for a number without dimension.
    pub unit: Cow<'static, str>,
}

impl Variable {
    /// A variable whose name and unit are known at compile time.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        Self { name: Cow::Borrowed(name), unit: Cow::Borrowed(unit) }
    }
}

/// The long form in files.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table<'a> {
    name: Cow<'a, str>,
    #[serde(default)]
    unit: Cow<'a, str>,
}

impl Serialize for Variable {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.unit.is_empty() {
            return serializer.serialize_str(&self.name);
        }
        let table = Table { name: Cow::Borrowed(&self.name), unit: Cow::Borrowed(&self.unit) };
        table.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Variable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NameOrTable)
    }
}

struct NameOrTable;

impl<'de> Visitor<'de> for NameOrTable {
    type Value = Variable;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a name, or a table { name, unit }")
    }

    fn visit_str<E>(self, name: &str) -> Result<Variable, E> {
        Ok(Variable { name: Cow::Owned(name.to_owned()), unit: Cow::Borrowed("") })
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Variable, A::Error> {
        let table = Table::deserialize(MapAccessDeserializer::new(map))?;
        let owned = |text: Cow<'_, str>| Cow::Owned(text.into_owned());
        Ok(Variable { name: owned(table.name), unit: owned(table.unit) })
    }
}
