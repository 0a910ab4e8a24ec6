//! Tables as CSV text.

use std::fmt::Write;

/// A CSV file being made, in memory.
#[derive(Debug)]
pub(crate) struct Table {
    text: String,
}

impl Table {
    /// A table with these column names, which hold no commas or quotes.
    pub(crate) fn new<T: AsRef<str>>(columns: impl IntoIterator<Item = T>) -> Self {
        let columns: Vec<_> = columns.into_iter().map(|c| c.as_ref().to_owned()).collect();
        Self { text: columns.join(",") + "\n" }
    }

    /// Adds a row.
    pub(crate) fn push(&mut self, cells: &[String]) {
        self.text += &cells.join(",");
        self.text.push('\n');
    }

    /// Adds a row of numbers.
    pub(crate) fn push_numbers<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        let start = self.text.len();
        for value in values {
            if self.text.len() > start {
                self.text.push(',');
            }
            // Writing to a String does not fail.
            let _ = write!(self.text, "{value:?}");
        }
        self.text.push('\n');
    }

    pub(crate) fn as_bytes(&self) -> &[u8] {
        self.text.as_bytes()
    }
}

/// The shortest text that reads back as the same number.
pub(crate) fn number(value: f64) -> String {
    format!("{value:?}")
}

/// The lines of a text that `table` has the header of and whose first cell is a whole number up to
/// `last`; none if the header is another or a line does not begin with such a number.
pub(crate) fn lines_up_to(text: &str, header: &str, last: u64) -> Option<Vec<String>> {
    let mut lines = text.lines();
    if lines.next()? != header {
        return None;
    }
    let mut kept = Vec::new();
    for line in lines {
        let (first, _) = line.split_once(',')?;
        if first.parse::<u64>().ok()? <= last {
            kept.push(line.to_owned());
        }
    }
    Some(kept)
}
