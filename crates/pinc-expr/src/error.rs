//! Errors in the equations of a plant.

use std::ops::Range;
use thiserror::Error;

/// Equations that do not make a plant: what is wrong, and where.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("`{key}`: {problem}{}", .text.as_ref().map(Excerpt::to_string).unwrap_or_default())]
pub struct ExpressionError {
    /// The field of [`Equations`](crate::Equations), with the name or index in it:
    /// `derivatives.x1`.
    pub key: String,
    /// The piece of an expression that is wrong, for a problem with one.
    pub text: Option<Excerpt>,
    /// The problem.
    pub problem: ExpressionProblem,
}

/// A piece of an expression; printed, it is the line with the piece underlined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Excerpt {
    /// The whole expression.
    pub text: String,
    /// The bytes of the piece.
    pub bytes: Range<usize>,
}

impl std::fmt::Display for Excerpt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (before, rest) = self.text.split_at(self.bytes.start);
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        let line_end = rest.find('\n').map_or(self.text.len(), |i| before.len() + i);
        let line = &self.text[line_start..line_end];
        let column = before[line_start..].chars().count();
        let piece = &self.text[self.bytes.start..self.bytes.end.min(line_end)];
        let carets = "^".repeat(piece.chars().count().max(1));
        write!(f, "\n    {line}\n    {:column$}{carets} column {}", "", column + 1)
    }
}

/// A problem with equations.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ExpressionProblem {
    /// No state or no input.
    #[error("empty, expected at least one")]
    Empty,
    /// A name that could not stand in an expression.
    #[error("`{0}` is not a name; expected a letter, then letters, digits and _")]
    Name(String),
    /// A name with a meaning of its own.
    #[error("the name `{name}` is taken: {meaning}")]
    Reserved {
        /// The name.
        name: String,
        /// What it means.
        meaning: &'static str,
    },
    /// A name given twice.
    #[error("the name `{name}` is taken by `{first}`")]
    Duplicate {
        /// The name.
        name: String,
        /// The key that has it already.
        first: String,
    },
    /// A state whose derivative is not given.
    #[error("missing; expected the time derivative of the state `{0}`")]
    MissingDerivative(String),
    /// A derivative of something else than a state.
    #[error("`{found}` is not a state; expected one of {}", known.join(", "))]
    UnknownState {
        /// The name.
        found: String,
        /// The states.
        known: Vec<String>,
    },
    /// A parameter to vary that does not exist.
    #[error("`{found}` is not a parameter; expected one of {}", known.join(", "))]
    UnknownParameter {
        /// The name.
        found: String,
        /// The parameters.
        known: Vec<String>,
    },
    /// A parameter that is NaN or infinite.
    #[error("{0} given, expected a finite number")]
    NotFinite(f64),
    /// A parameter that no expression has.
    #[error("no expression uses this parameter; remove it")]
    UnusedParameter,
    /// The output of a net that no expression has.
    #[error("no expression uses this output; remove it")]
    UnusedOutput,
    /// The parameters of a net's name are not its weights.
    #[error("{found} weights, expected {expected} for the net of this name")]
    Weights {
        /// How many there are.
        found: usize,
        /// How many the net has.
        expected: usize,
    },
    /// Intermediate expressions that need one another.
    #[error("defined by itself: {}", .0.join(" needs "))]
    Cycle(Vec<String>),
    /// A box of an algebraic variable that is none.
    #[error("the box goes from {low} to {high}; expected finite numbers, low < high")]
    Box {
        /// Its lower end.
        low: f64,
        /// Its upper end.
        high: f64,
    },
    /// A search for an algebraic variable that begins outside its box.
    #[error("the search starts at {start}, outside the box from {low} to {high}")]
    Start {
        /// Where it starts.
        start: f64,
        /// The lower end of the box.
        low: f64,
        /// The upper end.
        high: f64,
    },
    /// A start that depends on an algebraic variable.
    #[error("depends on the algebraic variable `{0}`; expected states, inputs and parameters only")]
    StartNeedsUnknown(String),
    /// More algebraic variables than can be solved for.
    #[error("{found} algebraic variables that depend on one another, expected {most} at most")]
    TooManyUnknowns {
        /// How many there are.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// Algebraic equations that cannot determine the algebraic variables.
    #[error("{0}")]
    Singular(Box<Deficiency>),
    /// Algebraic equations where there may be none.
    #[error(
        "algebraic equations, and outputs beside them, cannot be generated as code: their solution is \
         a search for roots. A net of the plant can, where states alone are controlled, bounded and \
         measured"
    )]
    NotListed,
    /// A plant in Rust that iterates in a way of its own.
    #[error(
        "the equation asks how far an iteration is (`all_nonpositive`), which cannot be recorded; \
         solve the equation inside it by `solve_implicit`"
    )]
    Iterates,
    /// Too many values to be kept at once: states, inputs, parameters that vary, and intermediate
    /// values from where they are computed to where they are needed last.
    #[error(
        "the equations need {0} values at once, expected {most} at most: states, inputs and \
         intermediate values until their last use. Make arrays shorter, or write the plant in Rust, \
         whose right-hand side has no such limit",
        most = crate::program::MOST_REGISTERS
    )]
    TooLarge(usize),
    /// A character that means nothing.
    #[error("unexpected character `{0}`")]
    Character(char),
    /// The power of other languages.
    #[error("`**` is not known; a power is written `^`")]
    DoubleStar,
    /// A number that is none, or none that fits.
    #[error("`{0}` is not a finite number")]
    Number(String),
    /// A name that stands for nothing.
    #[error("unknown name `{found}`; expected one of {}{}", known.join(", "), time(found))]
    UnknownName {
        /// The name.
        found: String,
        /// Those that could stand there.
        known: Vec<String>,
    },
    /// A function that does not exist.
    #[error("unknown function `{found}`; expected one of {}", known.join(", "))]
    UnknownFunction {
        /// The name.
        found: String,
        /// The functions.
        known: Vec<String>,
    },
    /// A function with the wrong number of arguments.
    #[error("`{function}` with {found} arguments, expected {expected}")]
    Arguments {
        /// The function.
        function: &'static str,
        /// How many it was given.
        found: usize,
        /// How many it takes.
        expected: usize,
    },
    /// Something else than what must follow.
    #[error("{found}, expected {expected}")]
    Expected {
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// A size that no array can have.
    #[error("a size of {0}, expected 1 to {most}", most = crate::arrays::LARGEST)]
    Size(usize),
    /// What stands for an index and is none.
    #[error("`{0}` is no index, expected a whole number from 0 to {most}", most = crate::arrays::LARGEST)]
    Index(String),
    /// A name between brackets that stands for no whole number.
    #[error("unknown index `{found}`; {}", indices(known))]
    UnknownIndex {
        /// The name.
        found: String,
        /// The indices and sizes that could stand there.
        known: Vec<String>,
    },
    /// A range whose end is before its beginning.
    #[error("the range {from}..{to} runs backwards, expected one like 1..n")]
    Range {
        /// The first value.
        from: i64,
        /// The last one.
        to: i64,
    },
    /// An equation for elements that are not said; the text is an example of what to write.
    #[error("no range of elements given; expected one, as {0}")]
    NoRange(String),
    /// An index with the name of something else.
    #[error("the index `{0}` has the name of something else, expected a name that is free")]
    IndexTaken(String),
    /// An element that an array does not have.
    #[error("`{element}` does not exist, expected an index from {first} to {last}")]
    NoElement {
        /// The element.
        element: String,
        /// The first index of the array.
        first: usize,
        /// The last one.
        last: usize,
    },
    /// Brackets behind something that is no array.
    #[error("`{0}` is not an array")]
    NotAnArray(String),
    /// An array without brackets.
    #[error("`{0}` is an array, expected one of its elements, as {0}[1]")]
    WholeArray(String),
    /// Arrays with very many elements.
    #[error("the arrays have more than {most} elements", most = crate::arrays::MOST)]
    TooMany,
    /// Arrays and sums that become too much text.
    #[error("written out, the equations have more than {most} characters", most = crate::arrays::LONGEST)]
    TooLong,
    /// What is wrong for some values of the indices.
    #[error("{problem} (at {index})")]
    Element {
        /// The values, as `i = 3`.
        index: String,
        /// The problem.
        problem: Box<ExpressionProblem>,
    },
    /// More parentheses in one another than anyone writes.
    #[error("nested more than {most} deep", most = crate::parser::DEEPEST)]
    TooDeep,
}

/// Equations with fewer algebraic variables than there are of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deficiency {
    /// The equations, by the algebraic variables to which they are given.
    pub equations: Vec<String>,
    /// The algebraic variables in them.
    pub unknowns: Vec<String>,
    /// Those for which no equation is left.
    pub undetermined: Vec<String>,
}

impl std::fmt::Display for Deficiency {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let advice = "differentiate it by the time, replacing derivatives of states by their \
         equations, until one of them appears, and leave out the states that it then determines";
        let open = self.undetermined.join(", ");
        if self.unknowns.is_empty() {
            return write!(
                f,
                "this equation contains no algebraic variable, and nothing determines {open}: the \
                 system is of index 2 or more; {advice}"
            );
        }
        write!(
            f,
            "the equations of {} contain no algebraic variables but {}, and nothing determines \
             {open}: they depend on one another, or the system is of index 2 or more; of an \
             equation too many, {advice}",
            self.equations.join(", "),
            self.unknowns.join(", "),
        )
    }
}

fn time(name: &str) -> &'static str {
    if name == "t" { "; the time may not stand in an equation" } else { "" }
}

fn indices(known: &[String]) -> String {
    if known.is_empty() {
        return "expected a whole number, since there are no [sizes] and no index here".to_owned();
    }
    format!("expected a whole number or one of {}", known.join(", "))
}

impl ExpressionProblem {
    /// The misspelt word and the words that could stand there, of a problem with one.
    #[must_use]
    pub fn misspelt(&self) -> Option<(&str, &[String])> {
        match self {
            Self::UnknownState { found, known }
            | Self::UnknownParameter { found, known }
            | Self::UnknownName { found, known }
            | Self::UnknownIndex { found, known }
            | Self::UnknownFunction { found, known } => Some((found, known)),
            Self::Element { problem, .. } => problem.misspelt(),
            _ => None,
        }
    }

    pub(crate) fn at(self, key: impl Into<String>) -> ExpressionError {
        ExpressionError { key: key.into(), text: None, problem: self }
    }
}
