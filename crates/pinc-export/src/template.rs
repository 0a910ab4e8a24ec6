//! Templates of generated files, and the texts that they are filled with.

use crate::{GeneratedFile, Name};
use std::fmt::Write as _;

/// What the places of templates are filled with.
///
/// A template is C with places `@KEY@`, and with the prefixes `pinc_` and `PINC_`, which are
/// replaced by the export's.
#[derive(Clone, Debug)]
pub(crate) struct Template {
    name: String,
    places: Vec<(&'static str, String)>,
}

impl Template {
    pub(crate) fn new(name: &Name) -> Self {
        Self { name: name.as_str().to_owned(), places: Vec::new() }
    }

    /// Fills the places `@key@` with a text, which may have places filled before.
    pub(crate) fn set(&mut self, key: &'static str, text: impl ToString) -> &mut Self {
        let text = self.fill(&text.to_string());
        self.places.retain(|(old, _)| *old != key);
        self.places.push((key, text));
        self
    }

    /// The template `text`, filled.
    pub(crate) fn fill(&self, text: &str) -> String {
        let mut filled = text.replace("@name@", &self.name);
        filled = filled.replace("pinc_", &format!("{}_", self.name));
        filled = filled.replace("PINC_", &format!("{}_", self.name.to_uppercase()));
        for (key, text) in &self.places {
            filled = filled.replace(&format!("@{key}@"), text);
        }
        filled
    }

    /// The file of the name's `_suffix`, filled from a template.
    pub(crate) fn file(&self, suffix: &str, text: &str) -> GeneratedFile {
        GeneratedFile::text(format!("{}_{suffix}", self.name), self.fill(text))
    }

    /// The file `path`, filled from a template.
    pub(crate) fn named(&self, path: &str, text: &str) -> GeneratedFile {
        GeneratedFile::text(path.to_owned(), self.fill(text))
    }
}

/// A number as a constant of C.
pub(crate) fn constant(value: f64) -> String {
    match value {
        _ if value == f64::INFINITY => "INFINITY".to_owned(),
        _ if value == f64::NEG_INFINITY => "-INFINITY".to_owned(),
        _ => format!("{value:?}"),
    }
}

/// Constants, some on a line, each as `wrap` makes them.
fn lines(values: &[f64], wrap: impl Fn(String) -> String) -> String {
    let mut text = String::new();
    for row in values.chunks(4) {
        let row: Vec<_> = row.iter().map(|&v| wrap(constant(v))).collect();
        let _ = writeln!(text, "    {},", row.join(", "));
    }
    text
}

/// The constants of an array of the type of all numbers.
pub(crate) fn numbers(values: &[f64]) -> String {
    lines(values, |v| format!("PINC_N({v})"))
}

/// An array of the type of all numbers.
pub(crate) fn array(name: &str, values: &[f64]) -> String {
    array_with(name, values, "")
}

/// An array with zeros behind the values: as many as `more` adds to the length.
pub(crate) fn array_with(name: &str, values: &[f64], more: &str) -> String {
    // C has no arrays of length 0.
    let values = if values.is_empty() { &[0.0][..] } else { values };
    let (count, list) = (values.len(), numbers(values));
    format!("static const PINC_REAL pinc_{name}[{count}{more}] = {{\n{list}}};\n")
}

/// A table of whole numbers; C has none of length 0.
pub(crate) fn places(name: &str, values: &[usize]) -> String {
    let list = if values.is_empty() { &[0][..] } else { values };
    let rows: Vec<String> = list
        .chunks(16)
        .map(|row| row.iter().map(|v| format!("{v},")).collect::<Vec<_>>().join(" "))
        .collect();
    format!("static const int pinc_{name}[{}] = {{\n    {}\n}};\n", list.len(), rows.join("\n    "))
}

/// A table of doubles, `rows` of the same length.
pub(crate) fn table(name: &str, rows: &[Vec<f64>]) -> String {
    let width = rows.first().map_or(1, Vec::len);
    let mut text = format!("static const double pinc_{name}[{}][{width}] = {{\n", rows.len());
    for row in rows {
        let _ = write!(text, "    {{\n{}    }},\n", lines(row, |v| v));
    }
    text + "};\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_places_are_filled() {
        let mut template = Template::new(&Name::new("osc").unwrap());
        template.set("A", "pinc_a").set("B", "[@A@]");
        let filled = template.fill("#define PINC_X @A@ @B@ /* @name@ */");
        assert_eq!(filled, "#define OSC_X osc_a [osc_a] /* osc */");
    }

    #[test]
    fn numbers_match_c() {
        assert_eq!([0.1, -2.0, 1e300, 5e-324].map(constant), ["0.1", "-2.0", "1e300", "5e-324"]);
        assert_eq!(constant(f64::NEG_INFINITY), "-INFINITY");
    }

    /// C has no arrays of length 0: those without numbers have one that is not used.
    #[test]
    fn arrays_match_c() {
        let five = array("a", &[1.0, -2.5, 0.0, 3.0, f64::INFINITY]);
        assert_eq!(
            five,
            "static const PINC_REAL pinc_a[5] = {\n    PINC_N(1.0), PINC_N(-2.5), PINC_N(0.0), PINC_N(3.0),\n    \
             PINC_N(INFINITY),\n};\n"
        );
        let none = "static const PINC_REAL pinc_a[1] = {\n    PINC_N(0.0),\n};\n";
        assert_eq!(array("a", &[]), none);
        let rows = array_with("a", &[1.0, 2.0], " / 2][2");
        assert!(rows.starts_with("static const PINC_REAL pinc_a[2 / 2][2] = {\n"), "{rows}");
        assert_eq!(places("p", &[]), "static const int pinc_p[1] = {\n    0,\n};\n");
        assert_eq!(places("p", &[3, 1]), "static const int pinc_p[2] = {\n    3, 1,\n};\n");
        let long = places("p", &[7; 17]);
        assert_eq!(long.lines().count(), 4, "sixteen in a line: {long}");
        let two = table("t", &[vec![1.0, 2.0], vec![3.0, 4.0]]);
        assert_eq!(
            two,
            "static const double pinc_t[2][2] = {\n    {\n    1.0, 2.0,\n    },\n    {\n    3.0, \
             4.0,\n    },\n};\n"
        );
    }
}
