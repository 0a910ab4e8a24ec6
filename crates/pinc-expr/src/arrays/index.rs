//! The text between brackets: indices, sizes and ranges, which are whole numbers.

use crate::error::ExpressionProblem;
use crate::lexer::Misplaced;
use crate::parser::DEEPEST;
use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};

/// The largest size of an array, and the largest index.
pub(crate) const LARGEST: usize = 10_000;

/// All arrays of a table together have this many elements at most.
pub(crate) const MOST: usize = 100_000;

/// The whole numbers that have names at a place.
#[derive(Clone, Debug)]
pub(super) struct Indices<'a> {
    pub(super) sizes: &'a BTreeMap<String, usize>,
    /// The indices, the outermost first.
    pub(super) bound: Vec<(&'a str, usize)>,
}

impl<'a> Indices<'a> {
    pub(super) fn new(sizes: &'a BTreeMap<String, usize>) -> Self {
        Self { sizes, bound: Vec::new() }
    }

    pub(super) fn value(&self, name: &str) -> Option<usize> {
        let bound = self.bound.iter().rev().find(|(index, _)| *index == name);
        bound.map(|(_, value)| *value).or_else(|| self.sizes.get(name).copied())
    }

    /// A problem, with the values of the indices if there are any.
    pub(super) fn at(&self, problem: ExpressionProblem) -> ExpressionProblem {
        if self.bound.is_empty() {
            return problem;
        }
        let values = self.bound.iter().map(|(name, value)| format!("{name} = {value}"));
        let index = values.collect::<Vec<_>>().join(", ");
        ExpressionProblem::Element { index, problem: Box::new(problem) }
    }

    fn known(&self) -> Vec<String> {
        let bound = self.bound.iter().map(|(name, _)| (*name).to_owned());
        bound.chain(self.sizes.keys().cloned()).collect()
    }
}

/// A place in a text.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    pub(super) text: &'a str,
    pub(super) at: usize,
}

impl<'a> Cursor<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self { text, at: 0 }
    }

    pub(super) fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn skip_space(&mut self) {
        self.at += self.rest().len() - self.rest().trim_start().len();
    }

    /// Goes behind `word` if it comes next.
    pub(super) fn accept(&mut self, word: &str) -> bool {
        self.skip_space();
        let found = self.rest().starts_with(word);
        self.at += if found { word.len() } else { 0 };
        found
    }

    pub(super) fn is_at_end(&mut self) -> bool {
        self.skip_space();
        self.rest().is_empty()
    }

    /// Goes behind a name if one comes next.
    pub(super) fn name(&mut self) -> Option<(&'a str, Range<usize>)> {
        self.skip_space();
        let rest = self.rest();
        let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let length = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        if length == 0 || rest.starts_with(|c: char| c.is_ascii_digit()) {
            return None;
        }
        let place = self.at..self.at + length;
        self.at = place.end;
        Some((&rest[..length], place))
    }

    /// Another word than `expected` comes next.
    pub(super) fn unexpected(&mut self, expected: &'static str) -> Misplaced {
        self.skip_space();
        let place = self.at..self.at + self.rest().chars().next().map_or(0, char::len_utf8);
        let found = match &self.text[place.clone()] {
            "" => "the text ends here".to_owned(),
            character => format!("`{character}`"),
        };
        (place, ExpressionProblem::Expected { found, expected })
    }

    /// The index `i`, if `i =` comes next.
    pub(super) fn bound_name(&mut self) -> Option<(&'a str, Range<usize>)> {
        let mut ahead = self.clone();
        let name = ahead.name()?;
        ahead.accept("=").then(|| {
            *self = ahead;
            name
        })
    }

    /// A range `1..n`, which may be empty but does not run backwards.
    pub(super) fn range(
        &mut self,
        indices: &Indices<'_>,
    ) -> Result<RangeInclusive<usize>, Misplaced> {
        self.skip_space();
        let start = self.at;
        let from = self.signed(indices)?;
        if !self.accept("..") {
            return Err(self.unexpected("`..` and the last value of the index"));
        }
        let to = self.signed(indices)?;
        if to < from - 1 || from < 0 {
            let problem = indices.at(ExpressionProblem::Range { from, to });
            return Err((start..self.at, problem));
        }
        if from > to {
            // No value: from this on up to one less.
            return Ok(RangeInclusive::new(1, 0));
        }
        Ok(self.as_index(start, from, indices)?..=self.as_index(start, to, indices)?)
    }

    /// A whole number of 0 or more.
    pub(super) fn index(&mut self, indices: &Indices<'_>) -> Result<usize, Misplaced> {
        self.skip_space();
        let start = self.at;
        let value = self.signed(indices)?;
        self.as_index(start, value, indices)
    }

    fn as_index(
        &self,
        start: usize,
        value: i64,
        indices: &Indices<'_>,
    ) -> Result<usize, Misplaced> {
        let index = usize::try_from(value).ok().filter(|index| *index <= LARGEST);
        index.ok_or_else(|| {
            let problem = ExpressionProblem::Index(value.to_string());
            (start..self.at, indices.at(problem))
        })
    }

    fn signed(&mut self, indices: &Indices<'_>) -> Result<i64, Misplaced> {
        self.sum(indices, 0)
    }

    fn sum(&mut self, indices: &Indices<'_>, depth: usize) -> Result<i64, Misplaced> {
        self.skip_space();
        let start = self.at;
        let mut value = self.product(indices, depth)?;
        loop {
            let (sign, found) = match (self.accept("+"), self.accept("-")) {
                (true, _) => (1, true),
                (_, found) => (-1, found),
            };
            if !found {
                return Ok(value);
            }
            let term = self.product(indices, depth)?;
            let sum = term.checked_mul(sign).and_then(|term| value.checked_add(term));
            value = self.whole(start, sum, indices)?;
        }
    }

    fn product(&mut self, indices: &Indices<'_>, depth: usize) -> Result<i64, Misplaced> {
        self.skip_space();
        let start = self.at;
        let mut value = self.factor(indices, depth)?;
        loop {
            let is_product = self.accept("*");
            if !is_product && !self.accept("/") {
                return Ok(value);
            }
            let factor = self.factor(indices, depth)?;
            let result = if is_product {
                value.checked_mul(factor)
            } else {
                value.checked_rem(factor).filter(|rest| *rest == 0).map(|_| value / factor)
            };
            value = self.whole(start, result, indices)?;
        }
    }

    fn whole(
        &self,
        start: usize,
        value: Option<i64>,
        indices: &Indices<'_>,
    ) -> Result<i64, Misplaced> {
        value.ok_or_else(|| {
            let place = start..self.at;
            let text = self.text[place.clone()].to_owned();
            (place, indices.at(ExpressionProblem::Index(text)))
        })
    }

    fn factor(&mut self, indices: &Indices<'_>, depth: usize) -> Result<i64, Misplaced> {
        self.skip_space();
        if depth > DEEPEST {
            return Err((self.at..self.at, ExpressionProblem::TooDeep));
        }
        if self.accept("-") {
            return self.factor(indices, depth + 1).map(|value| -value);
        }
        if self.accept("(") {
            let value = self.sum(indices, depth + 1)?;
            return if self.accept(")") { Ok(value) } else { Err(self.unexpected("`)`")) };
        }
        if let Some((name, place)) = self.name() {
            let value = indices.value(name).and_then(|value| i64::try_from(value).ok());
            return value.ok_or_else(|| {
                let (found, known) = (name.to_owned(), indices.known());
                (place, indices.at(ExpressionProblem::UnknownIndex { found, known }))
            });
        }
        let digits = self.rest().bytes().take_while(u8::is_ascii_digit).count();
        if digits == 0 {
            return Err(self.unexpected("a whole number, an index or a size"));
        }
        let start = self.at;
        self.at += digits;
        let number = self.text[start..self.at].parse::<u32>().ok();
        self.whole(start, number.map(i64::from), indices)
    }
}
