//! Names and units of states and inputs.

use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use std::ops::Range;

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

    /// The array and the index of the element of an array, by its name.
    ///
    /// ```
    /// use pinc_ode::Variable;
    ///
    /// assert_eq!(Variable::split_name("T[12]"), Some(("T", 12)));
    /// assert_eq!(Variable::split_name("T12"), None);
    /// ```
    #[must_use]
    pub fn split_name(name: &str) -> Option<(&str, usize)> {
        let (array, index) = name.strip_suffix(']')?.split_once('[')?;
        let is_index = !index.is_empty() && index.bytes().all(|b| b.is_ascii_digit());
        Some((array, index.parse().ok().filter(|_| is_index)?))
    }

    /// The places of each array among these names, and of each name that is no element of one.
    ///
    /// ```
    /// use pinc_ode::Variable;
    ///
    /// assert_eq!(Variable::groups(&["T[1]", "T[2]", "E"]), [0..2, 2..3]);
    /// ```
    #[must_use]
    pub fn groups<N: AsRef<str>>(names: &[N]) -> Vec<Range<usize>> {
        let array = |i: usize| Self::split_name(names[i].as_ref()).map(|(array, _)| array);
        let mut groups: Vec<Range<usize>> = Vec::new();
        for i in 0..names.len() {
            match groups.last_mut() {
                Some(last) if array(i).is_some() && array(i) == array(last.start) => {
                    last.end = i + 1;
                }
                _ => groups.push(i..i + 1),
            }
        }
        groups
    }

    /// Names for a reader, neighbouring elements of an array as one, such as `T[1..20]`.
    #[must_use]
    pub fn grouped_names<N: AsRef<str>>(names: &[N]) -> Vec<String> {
        let name = |group: Range<usize>| {
            let [first, last] = [group.start, group.end - 1].map(|i| names[i].as_ref());
            match (Self::split_name(first), Self::split_name(last)) {
                (Some((array, from)), Some((_, to))) if from < to => {
                    format!("{array}[{from}..{to}]")
                }
                _ => first.to_owned(),
            }
        };
        Self::groups(names).into_iter().map(name).collect()
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
