//! Expressions over indices, written out for values of these.

use super::index::{Cursor, Indices};
use crate::error::ExpressionProblem;
use crate::lexer::{self, Misplaced};
use crate::parser::DEEPEST;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// All expressions together have this many characters at most.
pub(crate) const LONGEST: usize = 4_000_000;

/// The function that adds up over a range.
const SUM: &str = "sum";

/// What an expression may name.
#[derive(Debug, Default)]
pub(super) struct Names<'a> {
    /// The elements of each array.
    pub(super) arrays: BTreeMap<&'a str, BTreeSet<usize>>,
    /// All other names.
    pub(super) scalars: BTreeSet<&'a str>,
}

impl Names<'_> {
    /// Whether an index may have this name.
    pub(super) fn is_free(&self, name: &str, indices: &Indices<'_>) -> bool {
        crate::parser::reserved(name).is_none()
            && indices.value(name).is_none()
            && !self.arrays.contains_key(name)
            && !self.scalars.contains(name)
    }

    /// Those that there are, as a reader is told.
    pub(super) fn listed(&self) -> Vec<String> {
        let ends = |elements: &BTreeSet<usize>| Some((*elements.first()?, *elements.last()?));
        let arrays = self.arrays.iter().filter_map(|(name, elements)| {
            ends(elements).map(|(first, last)| format!("{name}[{first}..{last}]"))
        });
        arrays.chain(self.scalars.iter().map(|&name| name.to_owned())).collect()
    }

    /// The element `name[index]`.
    pub(super) fn element(&self, name: &str, index: usize) -> Result<String, ExpressionProblem> {
        match self.arrays.get(name) {
            Some(elements) if elements.contains(&index) => Ok(format!("{name}[{index}]")),
            Some(elements) => Err(ExpressionProblem::NoElement {
                element: format!("{name}[{index}]"),
                first: elements.first().copied().unwrap_or_default(),
                last: elements.last().copied().unwrap_or_default(),
            }),
            None if self.scalars.contains(name) => {
                Err(ExpressionProblem::NotAnArray(name.to_owned()))
            }
            None => {
                let (found, known) = (name.to_owned(), self.listed());
                Err(ExpressionProblem::UnknownName { found, known })
            }
        }
    }
}

/// An expression without indices.
#[derive(Debug, Default)]
pub(super) struct Expanded {
    pub(super) text: String,
    /// Where each piece begins, and the bytes of the expression that it is made of.
    pieces: Vec<(usize, Range<usize>)>,
}

impl Expanded {
    fn push(&mut self, text: &str, place: Range<usize>) {
        self.pieces.push((self.text.len(), place));
        self.text.push_str(text);
    }

    /// The bytes of the expression that the ones at `bytes` are made of.
    pub(super) fn origin(&self, bytes: &Range<usize>) -> Range<usize> {
        let next = self.pieces.partition_point(|(start, _)| *start <= bytes.start);
        let Some((_, place)) = next.checked_sub(1).and_then(|last| self.pieces.get(last)) else {
            return 0..0;
        };
        place.clone()
    }
}

/// The expression `text`, with `indices` and sums written out.
pub(super) fn expand<'a>(
    text: &'a str,
    names: &Names<'_>,
    indices: &mut Indices<'a>,
) -> Result<Expanded, Misplaced> {
    let mut expanded = Expanded::default();
    let mut cursor = Cursor::new(text);
    Expander { names, to: &mut expanded }.up_to(text.len(), &mut cursor, indices)?;
    // What is missing at the end is found there.
    expanded.pieces.push((expanded.text.len(), text.len()..text.len()));
    Ok(expanded)
}

struct Expander<'n, 'a> {
    names: &'n Names<'a>,
    to: &'n mut Expanded,
}

impl Expander<'_, '_> {
    fn up_to<'a>(
        &mut self,
        end: usize,
        cursor: &mut Cursor<'a>,
        indices: &mut Indices<'a>,
    ) -> Result<(), Misplaced> {
        while cursor.at < end {
            let start = cursor.at;
            let Some(first) = cursor.rest().chars().next() else { break };
            match first {
                'a'..='z' | 'A'..='Z' | '_' => self.word(cursor, indices)?,
                _ => {
                    let length = match first {
                        '0'..='9' | '.' => lexer::number_length(cursor.rest()).max(1),
                        other => other.len_utf8(),
                    };
                    cursor.at += length;
                    self.to.push(&cursor.text[start..cursor.at], start..cursor.at);
                }
            }
        }
        Ok(())
    }

    /// A name, with what belongs to it.
    fn word<'a>(
        &mut self,
        cursor: &mut Cursor<'a>,
        indices: &mut Indices<'a>,
    ) -> Result<(), Misplaced> {
        let Some((name, place)) = cursor.name() else { return Ok(()) };
        let mut ahead = cursor.clone();
        if name == SUM && ahead.accept("(") {
            return self.sum(cursor, place, indices);
        }
        if ahead.accept("[") {
            let index = ahead.index(indices)?;
            if !ahead.accept("]") {
                return Err(ahead.unexpected("`]`"));
            }
            let place = place.start..ahead.at;
            let element = self.names.element(name, index);
            let element = element.map_err(|problem| (place.clone(), indices.at(problem)))?;
            self.to.push(&element, place);
            *cursor = ahead;
            return Ok(());
        }
        if let Some(value) = indices.value(name) {
            self.to.push(&value.to_string(), place);
        } else if self.names.arrays.contains_key(name) {
            let problem = ExpressionProblem::WholeArray(name.to_owned());
            return Err((place, indices.at(problem)));
        } else {
            self.to.push(name, place);
        }
        Ok(())
    }

    /// `sum(i = 1..n, term)`, from the parenthesis on.
    fn sum<'a>(
        &mut self,
        cursor: &mut Cursor<'a>,
        place: Range<usize>,
        indices: &mut Indices<'a>,
    ) -> Result<(), Misplaced> {
        cursor.accept("(");
        let Some((index, at)) = cursor.bound_name() else {
            return Err(cursor.unexpected("an index with a range, as in sum(i = 1..n, x[i])"));
        };
        if !self.names.is_free(index, indices) {
            return Err((at, ExpressionProblem::IndexTaken(index.to_owned())));
        }
        let range = cursor.range(indices)?;
        if !cursor.accept(",") {
            return Err(cursor.unexpected("`,` and what is to be added up"));
        }
        let (start, end) = (cursor.at, closing(cursor.text, cursor.at));
        let Some(end) = end else {
            cursor.at = cursor.text.len();
            return Err(cursor.unexpected("`)`"));
        };
        self.to.push("(", place.clone());
        if range.is_empty() {
            self.to.push("0", place.clone());
        }
        if indices.bound.len() > DEEPEST {
            return Err((place, ExpressionProblem::TooDeep));
        }
        for (k, value) in range.enumerate() {
            if self.to.text.len() > LONGEST {
                return Err((place, ExpressionProblem::TooLong));
            }
            self.to.push(if k == 0 { "(" } else { " + (" }, place.clone());
            cursor.at = start;
            indices.bound.push((index, value));
            self.up_to(end, cursor, indices)?;
            indices.bound.pop();
            self.to.push(")", end..end + 1);
        }
        self.to.push(")", end..end + 1);
        cursor.at = end + 1;
        Ok(())
    }
}

/// The place of the parenthesis that closes the one before `from`.
fn closing(text: &str, from: usize) -> Option<usize> {
    let mut open = 0_usize;
    let found = text[from..].char_indices().find(|(_, c)| match c {
        '(' => {
            open += 1;
            false
        }
        ')' if open > 0 => {
            open -= 1;
            false
        }
        other => *other == ')',
    });
    found.map(|(place, _)| from + place)
}
