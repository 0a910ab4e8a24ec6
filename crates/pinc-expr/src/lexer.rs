//! From the text of an expression to its words.

use crate::error::ExpressionProblem;
use pinc_ode::Variable;
use std::ops::Range;

/// A word of an expression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Token<'a> {
    Number(f64),
    Name(&'a str),
    /// One of `+ - * / ^ ( ) ,`
    Symbol(char),
    End,
}

impl Token<'_> {
    /// The word as it is called in a message.
    pub(crate) fn describe(self) -> String {
        match self {
            Self::Number(v) => format!("the number {v}"),
            Self::Name(name) => format!("`{name}`"),
            Self::Symbol(symbol) => format!("`{symbol}`"),
            Self::End => "the expression ends here".to_owned(),
        }
    }
}

/// A problem with a piece of the text.
pub(crate) type Misplaced = (Range<usize>, ExpressionProblem);

/// The words of a text, one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Lexer<'a> {
    text: &'a str,
    position: usize,
}

impl<'a> Lexer<'a> {
    pub(crate) fn new(text: &'a str) -> Self {
        Self { text, position: 0 }
    }

    /// The next word and its place; [`Token::End`] again and again at the end.
    pub(crate) fn next(&mut self) -> Result<(Token<'a>, Range<usize>), Misplaced> {
        let rest = &self.text[self.position..];
        let start = self.position + (rest.len() - rest.trim_start().len());
        let rest = &self.text[start..];
        let Some(first) = rest.chars().next() else {
            return Ok((Token::End, start..start));
        };
        let (token, length) = match first {
            '0'..='9' | '.' => {
                let length = number_length(rest);
                let number = rest[..length].parse().ok().filter(|v: &f64| v.is_finite());
                let Some(number) = number else {
                    let problem = ExpressionProblem::Number(rest[..length].to_owned());
                    return Err((start..start + length, problem));
                };
                (Token::Number(number), length)
            }
            'a'..='z' | 'A'..='Z' | '_' => {
                let length = rest.find(|c: char| !is_name(c)).unwrap_or(rest.len());
                let length = length + element_length(&rest[length..]);
                (Token::Name(&rest[..length]), length)
            }
            '*' if rest.starts_with("**") => {
                return Err((start..start + 2, ExpressionProblem::DoubleStar));
            }
            '+' | '-' | '*' | '/' | '^' | '(' | ')' | ',' => (Token::Symbol(first), 1),
            other => {
                let end = start + other.len_utf8();
                return Err((start..end, ExpressionProblem::Character(other)));
            }
        };
        self.position = start + length;
        Ok((token, start..self.position))
    }
}

fn is_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}

/// The length of the `[3]` that `text` begins with, if it does.
fn element_length(text: &str) -> usize {
    let Some(rest) = text.strip_prefix('[') else { return 0 };
    let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
    if digits > 0 && rest[digits..].starts_with(']') { digits + 2 } else { 0 }
}

/// Whether a name can stand in an expression; of an element of an array, the array's name.
pub(crate) fn is_valid_name(name: &str) -> bool {
    let name = Variable::split_name(name).map_or(name, |(array, _)| array);
    name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') && name.chars().all(is_name)
}

/// The length of the number that `text` begins with: digits, point and digits, exponent.
pub(crate) fn number_length(text: &str) -> usize {
    let digits = |from: usize| {
        let rest = &text.as_bytes()[from..];
        from + rest.iter().take_while(|b| b.is_ascii_digit()).count()
    };
    let mut end = digits(0);
    if text[end..].starts_with('.') {
        end = digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let sign = usize::from(text[end + 1..].starts_with(['+', '-']));
        let exponent_end = digits(end + 1 + sign);
        if exponent_end > end + 1 + sign {
            end = exponent_end;
        }
    }
    end
}
