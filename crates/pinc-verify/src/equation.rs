//! The right-hand side of a plant over Taylor models, and its Jacobian over intervals.

use crate::function::Smooth;
use crate::interval::Interval;
use crate::taylor::{Arithmetic, Taylor};
use pinc_expr::{Function, Instruction, Listing};
use std::borrow::Cow;

/// A right-hand side f(x, u, p), whose variables are counted together in this order.
#[derive(Clone, Debug)]
pub(crate) struct Equation {
    listing: Listing,
    states: usize,
}

/// A value over Taylor models; numbers stay numbers.
#[derive(Clone, Debug)]
enum Value<'a> {
    Number(f64),
    Model(Cow<'a, Taylor>),
}

/// A value over intervals, with its derivatives by the states.
#[derive(Clone, Debug)]
struct Enclosure {
    value: Interval,
    slopes: Vec<Interval>,
}

impl Equation {
    pub(crate) fn new(listing: Listing) -> Self {
        let states = listing.results.len();
        Self { listing, states }
    }

    pub(crate) fn states(&self) -> usize {
        self.states
    }

    pub(crate) fn listing(&self) -> &Listing {
        &self.listing
    }

    /// f over Taylor models of all variables.
    pub(crate) fn evaluate(&self, over: &Arithmetic, variables: &[Taylor]) -> Vec<Taylor> {
        let values = self.values(over, variables);
        let of = |place: &usize| values[*place].model(over).into_owned();
        self.listing.results.iter().map(of).collect()
    }

    /// The values of all instructions.
    fn values<'a>(&self, over: &Arithmetic, variables: &'a [Taylor]) -> Vec<Value<'a>> {
        let mut values: Vec<Value<'a>> = Vec::with_capacity(self.listing.instructions.len());
        for instruction in &self.listing.instructions {
            let value = apply(over, variables, &values, *instruction);
            values.push(value);
        }
        values
    }

    /// The variable of box `lane` that drives the instruction whose value is known worst, relative to
    /// its size, over `variables`; none if all are known to rounding.
    pub(crate) fn driver(
        &self,
        over: &Arithmetic,
        variables: &[Taylor],
        lane: usize,
    ) -> Option<usize> {
        let values = self.values(over, variables);
        let unknown: Vec<f64> = values.iter().map(|value| value.unknown_share(lane)).collect();
        let worst = unknown.iter().copied().fold(0.0, f64::max);
        // What follows from a value that is not known is known no better.
        let first = unknown.iter().position(|share| *share >= worst)?;
        let mut changes = vec![0.0; over.basis.variables()];
        for operand in self.listing.instructions[first].operands() {
            if let Value::Model(model) = &values[operand] {
                over.add_changes(model, lane, &mut changes);
            }
        }
        let most = (0..changes.len()).max_by(|a, b| changes[*a].total_cmp(&changes[*b]))?;
        let drives = worst > 1e-9 && changes[most] > 0.0 && changes[most].is_finite();
        drives.then_some(most)
    }

    /// df/dx, row by row, over intervals of all variables: entries that hold the derivatives at
    /// every point, [`Interval::ENTIRE`] where f is not smooth.
    pub(crate) fn jacobian(&self, variables: &[Interval]) -> Vec<Interval> {
        let values = self.enclosures(variables);
        self.listing.results.iter().flat_map(|place| values[*place].slopes.clone()).collect()
    }

    /// All instructions over intervals.
    fn enclosures(&self, variables: &[Interval]) -> Vec<Enclosure> {
        let mut values: Vec<Enclosure> = Vec::with_capacity(self.listing.instructions.len());
        for instruction in &self.listing.instructions {
            let value = enclose(self.states, variables, &values, *instruction);
            values.push(value);
        }
        values
    }
}

impl<'a> Value<'a> {
    fn model<'b>(&'b self, over: &Arithmetic) -> Cow<'b, Taylor> {
        match self {
            Self::Number(number) => Cow::Owned(over.constant([*number; crate::kernel::LANES])),
            Self::Model(model) => Cow::Borrowed(model.as_ref()),
        }
    }

    fn owned(model: Taylor) -> Self {
        Self::Model(Cow::Owned(model))
    }

    /// The remainder in a box, in parts of the largest absolute value that is known.
    fn unknown_share(&self, lane: usize) -> f64 {
        match self {
            Self::Number(_) => 0.0,
            Self::Model(model) => {
                let size: f64 = model.coefficients.iter().map(|of| of[lane].abs()).sum();
                crate::taylor::unless_nan(model.remainder[lane] / (size + f64::MIN_POSITIVE))
            }
        }
    }
}

/// The value of an instruction whose operands are among `values`.
fn apply<'a>(
    over: &Arithmetic,
    variables: &'a [Taylor],
    values: &[Value<'a>],
    instruction: Instruction,
) -> Value<'a> {
    use Value::{Model, Number};
    let model = |place: usize| values[place].model(over);
    Value::owned(match instruction {
        Instruction::Variable(index) => return Model(Cow::Borrowed(&variables[index])),
        Instruction::Constant(number) => return Number(number),
        Instruction::Add(a, b) => match (&values[a], &values[b]) {
            (Model(model), Number(number)) | (Number(number), Model(model)) => {
                over.offset(model, *number)
            }
            _ => over.add(&model(a), &model(b)),
        },
        Instruction::Sub(a, b) => match (&values[a], &values[b]) {
            (Number(number), Model(model)) => over.combine(&[model], &[-1.0], *number),
            _ => over.sub(&model(a), &model(b)),
        },
        Instruction::Mul(a, b) => match (&values[a], &values[b]) {
            (Model(model), Number(number)) | (Number(number), Model(model)) => {
                over.scale(model, *number)
            }
            _ => over.mul(&model(a), &model(b)),
        },
        Instruction::Div(a, b) => match &values[a] {
            Number(number) => over.scale(&over.compose(Smooth::Recip, &model(b)), *number),
            Model(_) => over.div(&model(a), &model(b)),
        },
        Instruction::Neg(a) => over.scale(&model(a), -1.0),
        Instruction::Power(a, p) => over.compose(Smooth::Power(p), &model(a)),
        Instruction::Min(a, b) => {
            over.choose(&over.sub(&model(a), &model(b)), &model(a), &model(b))
        }
        Instruction::Max(a, b) => {
            over.choose(&over.sub(&model(a), &model(b)), &model(b), &model(a))
        }
        Instruction::Where(test, yes, no) => over.choose(&model(test), &model(yes), &model(no)),
        Instruction::Function(function, a) => apply_function(over, function, &model(a)),
    })
}

fn apply_function(over: &Arithmetic, function: Function, a: &Taylor) -> Taylor {
    let compose = |function| over.compose(function, a);
    match function {
        Function::Sqrt => compose(Smooth::Sqrt),
        Function::Exp => compose(Smooth::Exp),
        Function::Log => compose(Smooth::Ln),
        Function::Sin => compose(Smooth::Sin),
        Function::Cos => compose(Smooth::Cos),
        Function::Tan => over.div(&compose(Smooth::Sin), &compose(Smooth::Cos)),
        Function::Tanh => compose(Smooth::Tanh),
        Function::Atan => compose(Smooth::Atan),
        Function::Abs => over.choose(a, &over.scale(a, -1.0), a),
        Function::Sign => {
            let [one, minus] = [1.0, -1.0].map(|sign| over.constant([sign; crate::kernel::LANES]));
            let not_positive = over.choose(&over.scale(a, -1.0), &over.unknown(), &minus);
            over.choose(a, &not_positive, &one)
        }
    }
}

/// The enclosure of an instruction whose operands are among `values`.
fn enclose(
    states: usize,
    variables: &[Interval],
    values: &[Enclosure],
    instruction: Instruction,
) -> Enclosure {
    let constant = |value: Interval| Enclosure { value, slopes: vec![ZERO; states] };
    let linear = |value: Interval, terms: &[(Interval, usize)]| {
        let slope = |i: usize| {
            let products = terms.iter().map(|(by, place)| times(*by, values[*place].slopes[i]));
            products.fold(ZERO, |sum, product| if product == ZERO { sum } else { sum + product })
        };
        Enclosure { value, slopes: (0..states).map(slope).collect() }
    };
    let at = |place: usize| values[place].value;
    match instruction {
        Instruction::Variable(index) => {
            let mut found = constant(variables[index]);
            if let Some(slope) = found.slopes.get_mut(index) {
                *slope = ONE;
            }
            found
        }
        Instruction::Constant(number) => constant(Interval::point(number)),
        Instruction::Add(a, b) => linear(at(a) + at(b), &[(ONE, a), (ONE, b)]),
        Instruction::Sub(a, b) => linear(at(a) - at(b), &[(ONE, a), (-ONE, b)]),
        Instruction::Mul(a, b) => linear(at(a) * at(b), &[(at(b), a), (at(a), b)]),
        Instruction::Div(a, b) => {
            let (quotient, inverse) = (at(a) / at(b), at(b).recip());
            linear(quotient, &[(inverse, a), (-(quotient * inverse), b)])
        }
        Instruction::Neg(a) => linear(-at(a), &[(-ONE, a)]),
        Instruction::Power(a, p) => {
            let slope = Interval::point(p) * at(a).power(p - 1.0);
            linear(at(a).power(p), &[(slope, a)])
        }
        Instruction::Min(a, b) => choose(at(a) - at(b), &values[a], &values[b]),
        Instruction::Max(a, b) => choose(at(a) - at(b), &values[b], &values[a]),
        Instruction::Where(test, yes, no) => choose(at(test), &values[yes], &values[no]),
        Instruction::Function(function, a) => {
            let (value, slope) = enclose_function(function, at(a));
            linear(value, &[(slope, a)])
        }
    }
}

const ZERO: Interval = Interval { low: 0.0, high: 0.0 };
const ONE: Interval = Interval { low: 1.0, high: 1.0 };

/// a b, exact if one is 0 or 1.
fn times(a: Interval, b: Interval) -> Interval {
    match (a, b) {
        (ZERO, b) | (b, ZERO) if b != Interval::ENTIRE => ZERO,
        (ONE, other) | (other, ONE) => other,
        _ => a * b,
    }
}

fn choose(of: Interval, yes: &Enclosure, no: &Enclosure) -> Enclosure {
    if of.high <= 0.0 {
        yes.clone()
    } else if of.low > 0.0 {
        no.clone()
    } else {
        let unknown = Interval::ENTIRE;
        Enclosure { value: unknown, slopes: vec![unknown; yes.slopes.len()] }
    }
}

/// A function's values and slopes on an interval.
fn enclose_function(function: Function, a: Interval) -> (Interval, Interval) {
    let square = |of: Interval| of * of;
    let smooth = |ok: bool, slope: Interval| if ok { slope } else { Interval::ENTIRE };
    match function {
        Function::Sqrt => {
            let root = a.sqrt();
            (root, Interval::point(0.5) * root.recip())
        }
        Function::Exp => (a.exp(), a.exp()),
        Function::Log => (a.ln(), smooth(a.low > 0.0, a.recip())),
        Function::Sin => (a.sin(), a.cos()),
        Function::Cos => (a.cos(), -a.sin()),
        Function::Tan => {
            let tangent = a.sin() / a.cos();
            (tangent, ONE + square(tangent))
        }
        Function::Tanh => (a.tanh(), ONE - square(a.tanh())),
        Function::Atan => (a.atan(), (ONE + square(a)).recip()),
        Function::Abs if a.low > 0.0 => (a, ONE),
        Function::Abs if a.high < 0.0 => (-a, -ONE),
        Function::Sign if a.low > 0.0 => (ONE, ZERO),
        Function::Sign if a.high < 0.0 => (-ONE, ZERO),
        Function::Abs | Function::Sign => (Interval::ENTIRE, Interval::ENTIRE),
    }
}
