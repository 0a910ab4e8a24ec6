//! From the text of an expression to a value, by precedence climbing (Pratt's method).
//!
//! ```text
//! sum     = product { ("+" | "-") product }
//! product = factor { ("*" | "/") factor }
//! factor  = ("-" | "+") factor | power
//! power   = atom [ "^" factor ]                   2^-x, and a^b^c = a^(b^c), -a^2 = -(a^2)
//! atom    = number | name | function "(" sum { "," sum } ")" | "(" sum ")"
//! ```

use crate::error::{Excerpt, ExpressionError, ExpressionProblem};
use crate::graph::{Function, Graph, Value};
use crate::lexer::{Lexer, Misplaced, Token};
use std::collections::BTreeMap;
use std::ops::Range;

/// How deep expressions may be nested.
pub(crate) const DEEPEST: usize = 100;

/// The functions of two arguments.
const PAIRS: [&str; 2] = ["min", "max"];

/// What a name that is taken from the start means, if it is one.
pub(crate) fn reserved(name: &str) -> Option<&'static str> {
    match name {
        "pi" => Some("the number pi"),
        "t" => Some("the time"),
        "scenario" => Some("a column of the tables of trajectories"),
        _ if function_names().any(|function| function == name) => Some("a function"),
        _ => None,
    }
}

fn function_names() -> impl Iterator<Item = &'static str> {
    Function::ALL.into_iter().map(|(name, _)| name).chain(PAIRS)
}

/// The value of the expression `text`, which stands at `key`, made of the values in `scope`.
pub(crate) fn parse(
    key: &str,
    text: &str,
    scope: &BTreeMap<&str, Value>,
    graph: &mut Graph,
) -> Result<Value, ExpressionError> {
    Parser::new(text, scope, graph).and_then(Parser::whole).map_err(|(bytes, problem)| {
        let text = Some(Excerpt { text: text.to_owned(), bytes });
        ExpressionError { key: key.to_owned(), text, problem }
    })
}

/// The names that stand in `text`, as far as it consists of words.
pub(crate) fn names(text: &str) -> impl Iterator<Item = &str> {
    let mut lexer = Lexer::new(text);
    std::iter::from_fn(move || {
        lexer.next().ok().map(|(token, _)| token).filter(|token| *token != Token::End)
    })
    .filter_map(|token| match token {
        Token::Name(name) => Some(name),
        _ => None,
    })
}

struct Parser<'a, 's> {
    lexer: Lexer<'a>,
    token: Token<'a>,
    place: Range<usize>,
    depth: usize,
    scope: &'s BTreeMap<&'s str, Value>,
    graph: &'s mut Graph,
}

impl<'a, 's> Parser<'a, 's> {
    fn new(
        text: &'a str,
        scope: &'s BTreeMap<&'s str, Value>,
        graph: &'s mut Graph,
    ) -> Result<Self, Misplaced> {
        let mut lexer = Lexer::new(text);
        let (token, place) = lexer.next()?;
        Ok(Self { lexer, token, place, depth: 0, scope, graph })
    }

    fn whole(mut self) -> Result<Value, Misplaced> {
        let value = self.sum()?;
        match self.token {
            Token::End => Ok(value),
            _ => Err(self.unexpected("an operator or the end")),
        }
    }

    /// Goes on to the next word and returns the place of this one.
    fn advance(&mut self) -> Result<Range<usize>, Misplaced> {
        let (token, place) = self.lexer.next()?;
        self.token = token;
        Ok(std::mem::replace(&mut self.place, place))
    }

    /// Goes on if the word is `symbol`.
    fn accept(&mut self, symbol: char) -> Result<bool, Misplaced> {
        let found = self.token == Token::Symbol(symbol);
        if found {
            self.advance()?;
        }
        Ok(found)
    }

    fn unexpected(&self, expected: &'static str) -> Misplaced {
        let found = self.token.describe();
        (self.place.clone(), ExpressionProblem::Expected { found, expected })
    }

    fn sum(&mut self) -> Result<Value, Misplaced> {
        let mut sum = self.product()?;
        loop {
            if self.accept('+')? {
                let b = self.product()?;
                sum = self.graph.add(sum, b);
            } else if self.accept('-')? {
                let b = self.product()?;
                sum = self.graph.sub(sum, b);
            } else {
                return Ok(sum);
            }
        }
    }

    fn product(&mut self) -> Result<Value, Misplaced> {
        let mut product = self.factor()?;
        loop {
            if self.accept('*')? {
                let b = self.factor()?;
                product = self.graph.mul(product, b);
            } else if self.accept('/')? {
                let b = self.factor()?;
                product = self.graph.div(product, b);
            } else {
                return Ok(product);
            }
        }
    }

    /// Every way down into an expression leads through here.
    fn factor(&mut self) -> Result<Value, Misplaced> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err((self.place.clone(), ExpressionProblem::TooDeep));
        }
        let value = if self.accept('-')? {
            let a = self.factor()?;
            self.graph.neg(a)
        } else if self.accept('+')? {
            self.factor()?
        } else {
            self.power()?
        };
        self.depth -= 1;
        Ok(value)
    }

    fn power(&mut self) -> Result<Value, Misplaced> {
        let base = self.atom()?;
        if !self.accept('^')? {
            return Ok(base);
        }
        let exponent = self.factor()?;
        Ok(self.graph.power(base, exponent))
    }

    fn atom(&mut self) -> Result<Value, Misplaced> {
        match self.token {
            Token::Number(number) => {
                self.advance()?;
                Ok(self.graph.constant(number))
            }
            Token::Name(name) => {
                let place = self.advance()?;
                if self.accept('(')? { self.call(name, place) } else { self.named(name, place) }
            }
            Token::Symbol('(') => {
                self.advance()?;
                let value = self.sum()?;
                if self.accept(')')? {
                    Ok(value)
                } else {
                    Err(self.unexpected("an operator or `)`"))
                }
            }
            _ => Err(self.unexpected("a number, a name or `(`")),
        }
    }

    fn named(&mut self, name: &str, place: Range<usize>) -> Result<Value, Misplaced> {
        if let Some(&value) = self.scope.get(name) {
            return Ok(value);
        }
        if name == "pi" {
            return Ok(self.graph.constant(std::f64::consts::PI));
        }
        if function_names().any(|function| function == name) {
            return Err(self.unexpected("`(` after a function"));
        }
        let known = self.scope.keys().copied().chain(["pi"]).map(str::to_owned).collect();
        Err((place, ExpressionProblem::UnknownName { found: name.to_owned(), known }))
    }

    /// The call of a function, from behind its opening parenthesis on.
    fn call(&mut self, name: &'a str, place: Range<usize>) -> Result<Value, Misplaced> {
        let mut arguments = vec![self.sum()?];
        while self.accept(',')? {
            arguments.push(self.sum()?);
        }
        if !self.accept(')')? {
            return Err(self.unexpected("an operator, `,` or `)`"));
        }
        let wrong = |function, expected| {
            let found = arguments.len();
            (place.clone(), ExpressionProblem::Arguments { function, found, expected })
        };
        if let Some((name, function)) = Function::ALL.into_iter().find(|(n, _)| *n == name) {
            let [a] = arguments[..] else { return Err(wrong(name, 1)) };
            return Ok(self.graph.function(function, a));
        }
        let Some(function) = PAIRS.into_iter().find(|function| *function == name) else {
            let known = function_names().map(str::to_owned).collect();
            return Err((
                place,
                ExpressionProblem::UnknownFunction { found: name.to_owned(), known },
            ));
        };
        let [a, b] = arguments[..] else { return Err(wrong(function, 2)) };
        Ok(if function == "min" { self.graph.minimum(a, b) } else { self.graph.maximum(a, b) })
    }
}
