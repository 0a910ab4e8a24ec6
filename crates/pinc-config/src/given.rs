//! From the values of a config to its types.
//!
//! Each kind of value is asked for what it is expected to be, where the deserializer of [`Value`]
//! itself lets every type accept any kind: that is several times the code, for all types of a
//! config. And an error knows its key.

use serde::de::value::StringDeserializer;
use serde::de::{
    DeserializeSeed, Deserializer, EnumAccess, Error, Expected, IntoDeserializer, MapAccess,
    SeqAccess, Unexpected, VariantAccess, Visitor,
};
use std::fmt::{self, Display};
use toml::{Table, Value};

/// A value as it is given in a config.
#[derive(Clone, Debug)]
pub(crate) struct Given(pub(crate) Value);

/// What does not fit, and where.
#[derive(Debug)]
pub(crate) struct Misfit {
    message: String,
    /// Keys and indices, the innermost first.
    path: Vec<Place>,
}

#[derive(Debug)]
enum Place {
    Key(String),
    Index(usize),
}

impl Misfit {
    /// In serde's words.
    pub(crate) fn message(&self) -> &str {
        self.message.trim_end()
    }

    /// The key as configs have it, `training.phases[0].iterations`; empty for the whole.
    pub(crate) fn key(&self) -> String {
        let mut key = String::new();
        for place in self.path.iter().rev() {
            match place {
                Place::Key(name) if key.is_empty() => key.clone_from(name),
                Place::Key(name) => key = format!("{key}.{name}"),
                Place::Index(index) => key = format!("{key}[{index}]"),
            }
        }
        key
    }

    fn at(mut self, place: Place) -> Self {
        self.path.push(place);
        self
    }

    #[cold]
    fn of_kind(found: &Value, expected: &dyn Expected) -> Self {
        let found = match found {
            Value::Boolean(value) => Unexpected::Bool(*value),
            Value::Integer(value) => Unexpected::Signed(*value),
            Value::Float(value) => Unexpected::Float(*value),
            Value::String(value) => Unexpected::Str(value),
            Value::Datetime(_) => Unexpected::Other("date or time"),
            Value::Array(_) => Unexpected::Seq,
            Value::Table(_) => Unexpected::Map,
        };
        Self::invalid_type(found, expected)
    }
}

impl Display for Misfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.key(), self.message)
    }
}

impl std::error::Error for Misfit {}

impl Error for Misfit {
    fn custom<T: Display>(message: T) -> Self {
        Self { message: message.to_string(), path: Vec::new() }
    }
}

/// Methods that all do the same.
macro_rules! forward {
    ($to:ident: $($method:ident)*) => {
        $(fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
            self.$to(visitor)
        })*
    };
}

impl Given {
    fn number<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match self.0 {
            Value::Integer(value) => visitor.visit_i64(value),
            Value::Float(value) => visitor.visit_f64(value),
            other => Err(Misfit::of_kind(&other, &visitor)),
        }
    }

    fn text<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match self.0 {
            Value::String(value) => visitor.visit_string(value),
            Value::Datetime(value) => visitor.visit_string(value.to_string()),
            other => Err(Misfit::of_kind(&other, &visitor)),
        }
    }

    fn list<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match self.0 {
            Value::Array(values) => {
                let length = values.len();
                let mut elements = Elements { left: values.into_iter(), index: 0 };
                let list = visitor.visit_seq(&mut elements)?;
                match elements.left.len() {
                    0 => Ok(list),
                    _ => Err(Misfit::invalid_length(length, &"fewer elements in array")),
                }
            }
            other => Err(Misfit::of_kind(&other, &visitor)),
        }
    }

    fn table<'de, V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match self.0 {
            Value::Table(table) => visitor.visit_map(Entries::new(table)),
            other => Err(Misfit::of_kind(&other, &visitor)),
        }
    }
}

impl<'de> Deserializer<'de> for Given {
    type Error = Misfit;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match self.0 {
            Value::Boolean(value) => visitor.visit_bool(value),
            Value::Integer(_) | Value::Float(_) => self.number(visitor),
            Value::String(_) | Value::Datetime(_) => self.text(visitor),
            Value::Array(_) => self.list(visitor),
            Value::Table(_) => self.table(visitor),
        }
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        match self.0 {
            Value::Boolean(value) => visitor.visit_bool(value),
            other => Err(Misfit::of_kind(&other, &visitor)),
        }
    }

    forward!(number: deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64
        deserialize_u8 deserialize_u16 deserialize_u32 deserialize_u64
        deserialize_f32 deserialize_f64);
    forward!(text: deserialize_char deserialize_str deserialize_string deserialize_identifier);
    forward!(list: deserialize_seq);
    forward!(table: deserialize_map);
    forward!(deserialize_any: deserialize_bytes deserialize_byte_buf deserialize_unit
        deserialize_ignored_any);

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Misfit> {
        visitor.visit_some(self)
    }

    fn deserialize_unit_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        self.deserialize_any(visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        _length: usize,
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        self.list(visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _length: usize,
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        self.list(visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        self.table(visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        let choice = match self.0 {
            Value::String(name) => Choice { name, content: None },
            Value::Table(table) if table.len() == 1 => {
                let Some((name, content)) = table.into_iter().next() else {
                    return Err(Misfit::custom(NOT_ONE));
                };
                Choice { name, content: Some(content) }
            }
            Value::Table(_) => return Err(Misfit::custom(NOT_ONE)),
            _ => return Err(Misfit::invalid_type(Unexpected::UnitVariant, &"string only")),
        };
        visitor.visit_enum(choice)
    }
}

/// Of a table that stands for a choice between several kinds of thing.
pub(crate) const NOT_ONE: &str = "wanted exactly 1 element";

/// The elements of a list.
struct Elements {
    left: std::vec::IntoIter<Value>,
    index: usize,
}

impl<'de> SeqAccess<'de> for Elements {
    type Error = Misfit;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Misfit> {
        let Some(value) = self.left.next() else { return Ok(None) };
        let index = self.index;
        self.index += 1;
        seed.deserialize(Given(value)).map(Some).map_err(|error| error.at(Place::Index(index)))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left.len())
    }
}

/// The keys of a table with their values.
struct Entries {
    left: toml::map::IntoIter<String, Value>,
    /// The key that was asked for last, and its value.
    current: (String, Option<Value>),
}

impl Entries {
    fn new(table: Table) -> Self {
        Self { left: table.into_iter(), current: (String::new(), None) }
    }
}

impl<'de> MapAccess<'de> for Entries {
    type Error = Misfit;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Misfit> {
        let Some((key, value)) = self.left.next() else { return Ok(None) };
        let text: StringDeserializer<Misfit> = key.clone().into_deserializer();
        self.current = (key, Some(value));
        seed.deserialize(text).map(Some).map_err(|error| error.at(self.place()))
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Misfit> {
        let Some(value) = self.current.1.take() else {
            return Err(Misfit::custom("a value before its key"));
        };
        seed.deserialize(Given(value)).map_err(|error| error.at(self.place()))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.left.len())
    }
}

impl Entries {
    fn place(&self) -> Place {
        Place::Key(self.current.0.clone())
    }
}

/// One of several kinds of thing, by its name alone or as a table with this only key.
struct Choice {
    name: String,
    content: Option<Value>,
}

impl<'de> EnumAccess<'de> for Choice {
    type Error = Misfit;
    type Variant = Self;

    fn variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<(T::Value, Self), Misfit> {
        let name: StringDeserializer<Misfit> = self.name.clone().into_deserializer();
        Ok((seed.deserialize(name)?, self))
    }
}

impl Choice {
    /// The content of the kind `expected`, with what is said of errors in it.
    fn content(self, expected: &str) -> Result<(Given, Place), Misfit> {
        match self.content {
            Some(content) => Ok((Given(content), Place::Key(self.name))),
            None => {
                Err(Misfit::invalid_type(Unexpected::UnitVariant, &expected)
                    .at(Place::Key(self.name)))
            }
        }
    }
}

impl<'de> VariantAccess<'de> for Choice {
    type Error = Misfit;

    fn unit_variant(self) -> Result<(), Misfit> {
        match &self.content {
            None => Ok(()),
            Some(Value::Table(table)) if table.is_empty() => Ok(()),
            Some(_) => Err(Misfit::custom("expected empty table").at(Place::Key(self.name))),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Misfit> {
        let (content, place) = self.content("newtype variant")?;
        seed.deserialize(content).map_err(|error| error.at(place))
    }

    fn tuple_variant<V: Visitor<'de>>(
        self,
        _length: usize,
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        let (content, place) = self.content("tuple variant")?;
        content.list(visitor).map_err(|error| error.at(place))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Misfit> {
        let (content, place) = self.content("struct variant")?;
        content.table(visitor).map_err(|error| error.at(place))
    }
}

#[cfg(test)]
mod tests {
    use super::{Given, Misfit};
    use serde::Deserialize;
    use toml::Value;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields, rename_all = "kebab-case")]
    struct Section {
        pair: [f64; 2],
        kinds: Vec<Kind>,
        name: Option<String>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "kebab-case")]
    enum Kind {
        Plain,
        Number(f64),
        Table { count: usize },
    }

    fn read(text: &str) -> Result<Section, Misfit> {
        Section::deserialize(Given(Value::Table(text.parse().unwrap())))
    }

    #[test]
    fn values_of_all_kinds_are_read() {
        let text = "pair = [1, 2.5]\nname = 'n'\n\
                    kinds = ['plain', { number = 3 }, { table = { count = 4 } }, { plain = {} }]";
        let kinds = vec![Kind::Plain, Kind::Number(3.0), Kind::Table { count: 4 }, Kind::Plain];
        let expected = Section { pair: [1.0, 2.5], kinds, name: Some("n".to_owned()) };
        assert_eq!(read(text).unwrap(), expected);
        let found: Vec<Value> = Vec::deserialize(Given(Value::from(vec![1, 2]))).unwrap();
        assert_eq!(found, [Value::Integer(1), Value::Integer(2)]);
    }

    #[test]
    fn errors_know_their_key() {
        for (text, key, message) in [
            ("pair = [1, 'x']", "pair[1]", "invalid type: string \"x\", expected f64"),
            ("pair = [1, 2, 3]", "pair", "invalid length 3, expected fewer elements in array"),
            ("pair = 1", "pair", "invalid type: integer `1`, expected an array of length 2"),
            ("name = 1.5", "name", "invalid type: floating point `1.5`, expected a string"),
            (
                "other = 1",
                "other",
                "unknown field `other`, expected one of `pair`, `kinds`, `name`",
            ),
            ("pair = [1, 2]", "", "missing field `kinds`"),
            (
                "kinds = ['number']",
                "kinds[0].number",
                "invalid type: unit variant, expected newtype variant",
            ),
            (
                "kinds = [{ number = true }]",
                "kinds[0].number",
                "invalid type: boolean `true`, expected f64",
            ),
            (
                "kinds = [{ table = { count = -1 } }]",
                "kinds[0].table.count",
                "invalid value: integer `-1`, expected usize",
            ),
            (
                "kinds = [{ table = 3 }]",
                "kinds[0].table",
                "invalid type: integer `3`, expected struct variant Kind::Table",
            ),
            ("kinds = [{ plain = {}, number = 1 }]", "kinds[0]", "wanted exactly 1 element"),
            ("kinds = [1]", "kinds[0]", "invalid type: unit variant, expected string only"),
        ] {
            let error = read(text).unwrap_err();
            assert_eq!((error.key().as_str(), error.message()), (key, message), "{text}");
        }
    }
}
