//! Equations of Rust plants, recorded as a graph by running them once on numbers that record.

use crate::algebraic::{Algebraic, LARGEST_BLOCK, MOST_UNKNOWNS};
use crate::error::ExpressionProblem;
use crate::graph::{Function, Graph, Value};
use crate::structure::Block;
use pinc_ad::{ImplicitEquations, Scalar};
use std::cell::RefCell;
use std::fmt::{self, Debug};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// What [`Traced`] numbers are recorded in.
pub(crate) struct Tracer(RefCell<Recording>);

/// What was recorded.
pub(crate) struct Recording {
    pub(crate) graph: Graph,
    pub(crate) algebraic: Algebraic,
    /// The place of the first unknown among the variables.
    first_unknown: usize,
    /// Whether equations inside the equation are solved by the steps that it takes itself, and not
    /// declared.
    unrolled: bool,
    /// Whether the equation has solved one inside by its own steps.
    solves: bool,
    problem: Option<ExpressionProblem>,
}

impl Tracer {
    /// For an equation of `variables` states, inputs and parameters. Equations that it solves
    /// inside become algebraic variables, or, `unrolled`, the steps of their solution.
    pub(crate) fn new(variables: usize, unrolled: bool) -> Self {
        Self(RefCell::new(Recording {
            graph: Graph::default(),
            algebraic: Algebraic::default(),
            first_unknown: variables,
            unrolled,
            solves: false,
            problem: None,
        }))
    }

    /// The variable with this place among all.
    pub(crate) fn variable(&self, place: usize) -> Traced<'_> {
        self.record(|graph| graph.variable(place))
    }

    pub(crate) fn constant(&self, value: f64) -> Traced<'_> {
        self.record(|graph| graph.constant(value))
    }

    fn record(&self, make: impl FnOnce(&mut Graph) -> Value) -> Traced<'_> {
        Traced { tracer: self, value: make(&mut self.0.borrow_mut().graph) }
    }

    /// What was recorded, or why the equation cannot be.
    pub(crate) fn finish(self) -> Result<Recording, ExpressionProblem> {
        let mut recording = self.0.into_inner();
        match recording.problem.take() {
            Some(problem) => Err(problem),
            None => Ok(recording),
        }
    }
}

/// A number that records what is done with it.
///
/// The graph computes on `f64` what the equation does, bit for bit: no operation is replaced by
/// another one.
#[derive(Clone, Copy)]
pub(crate) struct Traced<'t> {
    tracer: &'t Tracer,
    pub(crate) value: Value,
}

impl Debug for Traced<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Traced").field(&self.value).finish()
    }
}

impl<'t> Traced<'t> {
    fn record(self, make: impl FnOnce(&mut Graph, Value) -> Value) -> Self {
        self.tracer.record(|graph| make(graph, self.value))
    }

    fn function(self, function: Function) -> Self {
        self.record(|graph, a| graph.function(function, a))
    }

    /// New algebraic variables in the given boxes, searched from `start`.
    fn unknowns<const N: usize>(self, start: [Self; N], limits: &[[f64; 2]; N]) -> [Self; N] {
        let recording = &mut *self.tracer.0.borrow_mut();
        let Recording { graph, algebraic, first_unknown, problem, .. } = recording;
        let before = algebraic.names.len();
        let all = before + N;
        if N > LARGEST_BLOCK || all > MOST_UNKNOWNS {
            let (found, most) =
                if N > LARGEST_BLOCK { (N, LARGEST_BLOCK) } else { (all, MOST_UNKNOWNS) };
            problem.get_or_insert(ExpressionProblem::TooManyUnknowns { found, most });
        }
        let places: Vec<usize> = (before..all).collect();
        algebraic.names.extend(places.iter().map(|place| format!("unknown {}", place + 1)));
        algebraic.starts.extend(start.map(|start| start.value));
        algebraic.limits.extend(limits);
        algebraic.blocks.push(Block { unknowns: places.clone(), equations: places });
        std::array::from_fn(|i| Self {
            tracer: self.tracer,
            value: graph.variable(*first_unknown + before + i),
        })
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident $recorded:ident),*) => {$(
        impl $trait for Traced<'_> {
            type Output = Self;
            fn $method(self, b: Self) -> Self {
                self.record(|graph, a| graph.$recorded(a, b.value))
            }
        }
        impl $trait<f64> for Traced<'_> {
            type Output = Self;
            fn $method(self, b: f64) -> Self {
                self.$method(self.constant(b))
            }
        }
    )*};
}
operators!(Add add add, Sub sub sub, Mul mul mul, Div div quotient);

impl Neg for Traced<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        self.record(Graph::neg)
    }
}

macro_rules! functions {
    ($($method:ident $function:ident),*) => {$(
        fn $method(self) -> Self {
            self.function(Function::$function)
        }
    )*};
}

impl Scalar for Traced<'_> {
    /// An iteration on plain numbers is recorded with the rest: its steps are then differentiated
    /// too, which is as exact as the iteration.
    type Plain = Self;
    /// So that a last step carries derivatives of second order.
    const ORDER: usize = 2;

    fn constant(self, value: f64) -> Self {
        self.tracer.constant(value)
    }
    fn plain(self) -> Self {
        self
    }
    fn constants(self, value: Self) -> Self {
        value
    }
    functions!(sqrt Sqrt, exp Exp, ln Log, sin Sin, cos Cos, tan Tan, atan Atan, tanh Tanh);
    functions!(abs Abs, sign Sign);
    fn powf(self, p: f64) -> Self {
        self.record(|graph, a| graph.powf(a, p))
    }
    fn min(self, other: Self) -> Self {
        self.record(|graph, a| graph.minimum(a, other.value))
    }
    fn max(self, other: Self) -> Self {
        self.record(|graph, a| graph.maximum(a, other.value))
    }
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        self.record(|graph, test| graph.choose(test, yes.value, no.value))
    }

    /// A recording has no values. The iteration that asks ends, and the recording is refused.
    fn all_nonpositive(self) -> bool {
        let Recording { problem, solves, .. } = &mut *self.tracer.0.borrow_mut();
        problem.get_or_insert(match solves {
            true => ExpressionProblem::NotListed,
            false => ExpressionProblem::Iterates,
        });
        true
    }

    fn declare<E: ImplicitEquations<K, N>, const K: usize, const N: usize>(
        equations: &E,
        x: &[Self; K],
        start: [Self; N],
        limits: &[[f64; 2]; N],
    ) -> Option<[Self; N]> {
        let first = start[0];
        if first.tracer.0.borrow().unrolled {
            first.tracer.0.borrow_mut().solves = true;
            return None;
        }
        let z = first.unknowns(start, limits);
        let mut residuals = z;
        equations.residuals(x, &z, &mut residuals);
        let values = residuals.map(|residual| residual.value);
        first.tracer.0.borrow_mut().algebraic.residuals.extend(values);
        Some(z)
    }
}
