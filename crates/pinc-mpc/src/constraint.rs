//! The names of constraints.

use crate::Bounds;
use crate::outputs::{IntervalEnd, OutputRows};
use pinc_qp::{Kind, OcpDims, Row};
use std::fmt;

/// A constraint of the control problem, by name. Steps are counted from the measured state: `step`
/// is j in x\[k+j\] and u\[k+j\].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Constraint {
    /// A bound on a predicted state.
    State {
        /// j of x\[k+j\].
        step: usize,
        /// Which state.
        index: usize,
        /// Which of its bounds.
        side: Side,
    },
    /// The value that a predicted state must have, both of whose bounds are the same.
    StateValue {
        /// j of x\[k+j\].
        step: usize,
        /// Which state.
        index: usize,
    },
    /// A bound on an input.
    Input {
        /// j of u\[k+j\].
        step: usize,
        /// Which input.
        index: usize,
        /// Which of its bounds.
        side: Side,
    },
    /// A bound on an input's change.
    Increment {
        /// j of du\[k+j\].
        step: usize,
        /// Which input.
        index: usize,
        /// Which of its bounds.
        side: Side,
    },
    /// A bound on an output of the model.
    Output {
        /// j of y\[k+j\].
        step: usize,
        /// Which output.
        index: usize,
        /// Which of its bounds.
        side: Side,
        /// Which input it is taken with, if it may depend on the input: u\[k+j\] at the start of an
        /// interval, u\[k+j-1\] at its end.
        end: Option<IntervalEnd>,
    },
    /// A row of h.
    Inequality {
        /// j of h(x\[k+j\], u\[k+j\]).
        step: usize,
        /// Which row.
        index: usize,
    },
    /// A row of g.
    Equality {
        /// j of g(x\[k+j\], u\[k+j\]).
        step: usize,
        /// Which row.
        index: usize,
    },
}

/// Which of two bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower one.
    Low,
    /// The upper one.
    High,
}

impl Constraint {
    pub(crate) fn new(dims: OcpDims, (bounds, outputs): (&Bounds, &OutputRows), row: Row) -> Self {
        let side = if row.upper { Side::High } else { Side::Low };
        let all_states = dims.all_states();
        match row.kind {
            Kind::Bound if row.index < all_states => {
                let (step, index) = (dims.tree.depth(row.index / dims.nx + 1), row.index % dims.nx);
                match bounds.low[row.index] < bounds.high[row.index] {
                    true => Self::State { step, index, side },
                    false => Self::StateValue { step, index },
                }
            }
            Kind::Bound => {
                let place = row.index - all_states;
                let (step, index) = (dims.tree.depth(place / dims.nu), place % dims.nu);
                Self::Input { step, index, side }
            }
            Kind::Increment => {
                let (step, index) = (dims.tree.depth(row.index / dims.nu), row.index % dims.nu);
                Self::Increment { step, index, side }
            }
            Kind::Row => {
                let step = dims.tree.depth(dims.n1 + row.index / dims.rows());
                let index = row.index % dims.rows();
                match index.checked_sub(dims.general()) {
                    Some(place) => Self::output(outputs, step, place, side),
                    None => match index.checked_sub(dims.inequalities) {
                        None => Self::Inequality { step, index },
                        Some(index) => Self::Equality { step, index },
                    },
                }
            }
        }
    }

    /// The bound in row `place` of the bounds of outputs at a stage.
    fn output(outputs: &OutputRows, stage: usize, place: usize, side: Side) -> Self {
        let (index, end) = outputs.iter().nth(place).expect("a row of an output");
        let step = match end {
            Some(IntervalEnd::Start) => stage - 1,
            Some(IntervalEnd::End) | None => stage,
        };
        Self::Output { step, index, side, end }
    }
}

/// As `upper bound of x[k+3][0]`: the variable by its place.
impl fmt::Display for Constraint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bound = |side: &Side| match side {
            Side::Low => "lower bound of",
            Side::High => "upper bound of",
        };
        match self {
            Self::State { step, index, side } => write!(f, "{} x[k+{step}][{index}]", bound(side)),
            Self::StateValue { step, index } => write!(f, "given value of x[k+{step}][{index}]"),
            Self::Input { step, index, side } => write!(f, "{} u[k+{step}][{index}]", bound(side)),
            Self::Increment { step, index, side } => {
                write!(f, "{} du[k+{step}][{index}]", bound(side))
            }
            Self::Output { step, index, side, end } => {
                let input = match end {
                    None => return write!(f, "{} y[k+{step}][{index}]", bound(side)),
                    Some(IntervalEnd::Start) => *step,
                    Some(IntervalEnd::End) => step - 1,
                };
                write!(f, "{} y(x[k+{step}], u[k+{input}])[{index}]", bound(side))
            }
            Self::Inequality { step, index } => write!(f, "h[{index}] <= 0 at k+{step}"),
            Self::Equality { step, index } => write!(f, "g[{index}] = 0 at k+{step}"),
        }
    }
}
