//! Derivatives as sums of numbers and multiples of values, so that constant factors and terms
//! meet and fold, however far apart they stand in the equation.

use super::dag::{Dag, Id};

/// Longer sums become one value before they are used again, so that they are added up once.
const LONGEST: usize = 4;

/// `constant + sum_i factor_i value_i`, by ascending values that are not numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Linear {
    constant: f64,
    terms: Vec<(Id, f64)>,
}

impl Linear {
    pub(super) fn constant(constant: f64) -> Self {
        Self { constant, terms: Vec::new() }
    }

    /// A value as it is.
    pub(super) fn value(dag: &Dag, value: Id) -> Self {
        match dag.number(value) {
            Some(constant) => Self::constant(constant),
            None => Self { constant: 0.0, terms: vec![(value, 1.0)] },
        }
    }

    /// Whether it is 0, always.
    pub(super) fn is_zero(&self) -> bool {
        self.terms.is_empty() && self.constant == 0.0
    }

    fn is_constant(&self) -> bool {
        self.terms.is_empty()
    }

    pub(super) fn scale(mut self, factor: f64) -> Self {
        self.constant *= factor;
        self.terms.iter_mut().for_each(|(_, f)| *f *= factor);
        self.terms.retain(|(_, f)| *f != 0.0);
        self
    }

    pub(super) fn add(&self, other: &Self) -> Self {
        let mut terms = Vec::with_capacity(self.terms.len() + other.terms.len());
        let (mut a, mut b) = (self.terms.iter().peekable(), other.terms.iter().peekable());
        loop {
            let term = match (a.peek(), b.peek()) {
                (Some(x), Some(y)) if x.0 == y.0 => {
                    let sum = (x.0, x.1 + y.1);
                    a.next();
                    b.next();
                    sum
                }
                (Some(x), Some(y)) if x.0 > y.0 => {
                    let term = **y;
                    b.next();
                    term
                }
                (Some(x), _) => {
                    let term = **x;
                    a.next();
                    term
                }
                (None, Some(y)) => {
                    let term = **y;
                    b.next();
                    term
                }
                (None, None) => break,
            };
            // Terms that cancel are gone; a factor that is not a number stays visible.
            if term.1 != 0.0 {
                terms.push(term);
            }
        }
        Self { constant: self.constant + other.constant, terms }
    }

    /// The product of two, of which long ones become values.
    pub(super) fn times(&self, other: &Self, dag: &mut Dag) -> Self {
        if self.is_constant() {
            return other.clone().scale(self.constant);
        }
        if other.is_constant() {
            return self.clone().scale(other.constant);
        }
        let ((a, f), (b, g)) = (self.single(dag), other.single(dag));
        let product = dag.mul(a, b);
        Self { constant: 0.0, terms: vec![(product, f * g)] }
    }

    /// It as a multiple of one value.
    fn single(&self, dag: &mut Dag) -> (Id, f64) {
        match self.terms[..] {
            [term] if self.constant == 0.0 => term,
            _ => (self.to_value(dag), 1.0),
        }
    }

    /// `self` where `test <= 0`, else `other`.
    pub(super) fn choose(&self, test: Id, other: &Self, dag: &mut Dag) -> Self {
        // A constant factor stays outside, where it can meet others.
        let factor = match (self.is_constant(), other.is_constant()) {
            (true, true) if other.constant == 0.0 => self.constant,
            (true, true) if self.constant == 0.0 => other.constant,
            _ => 1.0,
        };
        let factor = if factor.is_finite() && factor != 0.0 { factor } else { 1.0 };
        let [yes, no] = [self, other].map(|side| {
            let side = if side.is_constant() {
                Self::constant(side.constant / factor)
            } else {
                side.clone()
            };
            side.to_value(dag)
        });
        let chosen = dag.choose(test, yes, no);
        Self::value(dag, chosen).scale(factor)
    }

    /// This sum, as one value if it is long.
    pub(super) fn shortened(self, dag: &mut Dag) -> Self {
        if self.terms.len() > LONGEST {
            let value = self.to_value(dag);
            return Self::value(dag, value);
        }
        self
    }

    /// It as a value: multiplications and additions, the plain terms first.
    pub(super) fn to_value(&self, dag: &mut Dag) -> Id {
        let Self { constant, terms } = self;
        let mut terms = terms.clone();
        let rank = |factor: f64| match factor {
            1.0 => 0,
            -1.0 => 1,
            _ => 2,
        };
        terms.sort_by_key(|&(_, factor)| rank(factor));
        let mut sum = (*constant != 0.0 || terms.is_empty()).then(|| dag.constant(*constant));
        for (value, factor) in terms {
            let next = match sum {
                None => match rank(factor) {
                    0 => value,
                    1 => dag.neg(value),
                    _ => {
                        let factor = dag.constant(factor);
                        dag.mul(value, factor)
                    }
                },
                Some(sum) => match rank(factor) {
                    0 => dag.add(sum, value),
                    1 => dag.sub(sum, value),
                    _ => {
                        let factor = dag.constant(factor);
                        dag.mul_add(value, factor, sum)
                    }
                },
            };
            sum = Some(next);
        }
        sum.unwrap_or_else(|| dag.constant(*constant))
    }
}
