//! The numbers of a control problem in which its solution is differentiated.

use pinc_mpc::{Bounds, Nmpc, NmpcProblem, PerStage, Softness, Weight};
use pinc_ode::Dims;
use std::ops::Range;

/// A kind of number that a control problem is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Given {
    /// The state in which the plan begins, `n`; with a delay, the state predicted for the time at
    /// which the input acts, which does not move with the other kinds.
    State,
    /// The reference, `[N2, tracked]`.
    Reference,
    /// u\[k-1\], `m`.
    AppliedInput,
    /// p, `np`.
    Parameters,
    /// [`Weights::q`](pinc_mpc::Weights::q).
    Q,
    /// [`Weights::r`](pinc_mpc::Weights::r).
    R,
    /// [`Weights::terminal`](pinc_mpc::Weights::terminal).
    Terminal,
    /// [`Weights::input_sequence`](pinc_mpc::Weights::input_sequence).
    InputSequence,
    /// Lower [`NmpcProblem::state_bounds`].
    StateLow,
    /// Upper [`NmpcProblem::state_bounds`].
    StateHigh,
    /// Lower [`NmpcProblem::input_bounds`].
    InputLow,
    /// Upper [`NmpcProblem::input_bounds`].
    InputHigh,
    /// Lower [`NmpcProblem::increment_bounds`].
    IncrementLow,
    /// Upper [`NmpcProblem::increment_bounds`].
    IncrementHigh,
    /// Lower [`NmpcProblem::output_bounds`].
    OutputLow,
    /// Upper [`NmpcProblem::output_bounds`].
    OutputHigh,
    /// The weights in [`NmpcProblem::state_softness`].
    StatePenalty,
    /// The weights in [`NmpcProblem::constraint_softness`].
    ConstraintPenalty,
    /// The weights in [`NmpcProblem::output_softness`].
    OutputPenalty,
}

impl Given {
    /// All of them.
    pub const ALL: [Self; 19] = [
        Self::State,
        Self::Reference,
        Self::AppliedInput,
        Self::Parameters,
        Self::Q,
        Self::R,
        Self::Terminal,
        Self::InputSequence,
        Self::StateLow,
        Self::StateHigh,
        Self::InputLow,
        Self::InputHigh,
        Self::IncrementLow,
        Self::IncrementHigh,
        Self::OutputLow,
        Self::OutputHigh,
        Self::StatePenalty,
        Self::ConstraintPenalty,
        Self::OutputPenalty,
    ];

    /// Returns the name, as `applied_input`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Reference => "reference",
            Self::AppliedInput => "applied_input",
            Self::Parameters => "parameters",
            Self::Q => "q",
            Self::R => "r",
            Self::Terminal => "terminal",
            Self::InputSequence => "input_sequence",
            Self::StateLow => "state_low",
            Self::StateHigh => "state_high",
            Self::InputLow => "input_low",
            Self::InputHigh => "input_high",
            Self::IncrementLow => "increment_low",
            Self::IncrementHigh => "increment_high",
            Self::OutputLow => "output_low",
            Self::OutputHigh => "output_high",
            Self::StatePenalty => "state_penalty",
            Self::ConstraintPenalty => "constraint_penalty",
            Self::OutputPenalty => "output_penalty",
        }
    }
}

/// Derivatives in, or changes of, all numbers that a control problem is given, each kind with the
/// shape that the problem has: a weight that is a diagonal has one number per row, a full one all
/// its numbers row by row; what is the same at all stages stands once, what differs stage by stage.
/// What a problem does not have is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct ProblemDerivative {
    values: Vec<f64>,
    layout: Layout,
}

impl ProblemDerivative {
    /// Zeros for all numbers that the problem of `nmpc` is given.
    #[must_use]
    pub fn zeros(nmpc: &Nmpc) -> Self {
        Self::new(Layout::new(nmpc.problem(), nmpc.model().dims()))
    }

    pub(crate) fn new(layout: Layout) -> Self {
        Self { values: vec![0.0; layout.starts[Given::ALL.len()]], layout }
    }

    /// Returns the numbers of one kind.
    #[must_use]
    pub fn get(&self, given: Given) -> &[f64] {
        &self.values[self.layout.range(given)]
    }

    /// Returns the numbers of one kind, to be written.
    pub fn get_mut(&mut self, given: Given) -> &mut [f64] {
        &mut self.values[self.layout.range(given)]
    }

    /// Returns all numbers, in the order of [`Given::ALL`].
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns all numbers, to be written.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }
}

/// Where the numbers of a [`ProblemDerivative`] are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layout {
    starts: [usize; Given::ALL.len() + 1],
    q: WeightShape,
    r: WeightShape,
    terminal: WeightShape,
    input_sequence: WeightShape,
}

/// The shape of a weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct WeightShape {
    size: usize,
    full: bool,
    /// How many there are.
    count: usize,
}

impl WeightShape {
    fn of(weights: &[Weight]) -> Self {
        let size = weights.first().map_or(0, Weight::size);
        let full = weights.iter().any(|weight| matches!(weight, Weight::Full(_)));
        Self { size, full, count: weights.len() }
    }

    fn each(self) -> usize {
        if self.full { self.size * self.size } else { self.size }
    }

    /// Where entry (i, k) at `stage` is, if it is a number of its own.
    fn place(self, stage: usize, i: usize, k: usize) -> Option<usize> {
        let first = stage % self.count.max(1) * self.each();
        match self.full {
            true => Some(first + i * self.size + k),
            false => (i == k).then_some(first + i),
        }
    }
}

impl Layout {
    pub(crate) fn new(problem: &NmpcProblem, dims: Dims) -> Self {
        let weights = &problem.weights;
        let per_stage = |weights: &PerStage<Weight>| WeightShape::of(weights.all());
        let one = |weight: &Option<Weight>| {
            WeightShape::of(weight.as_ref().map_or(&[], std::slice::from_ref))
        };
        let (q, r) = (per_stage(&weights.q), per_stage(&weights.r));
        let (terminal, input_sequence) = (one(&weights.terminal), one(&weights.input_sequence));
        let bounds = |bounds: &Bounds| bounds.low.len();
        let outputs = problem.output_bounds.as_ref().map_or(0, bounds);
        let penalties = |softness: &Softness| match softness {
            Softness::Penalty(weights) => weights.len(),
            Softness::Hard | Softness::Exact => 0,
        };
        let mut starts = [0; Given::ALL.len() + 1];
        for (i, given) in Given::ALL.into_iter().enumerate() {
            let length = match given {
                Given::State => dims.nx,
                Given::Reference => problem.horizon * problem.tracked.len(),
                Given::AppliedInput => dims.nu,
                Given::Parameters => problem.parameters.len(),
                Given::Q => q.count * q.each(),
                Given::R => r.count * r.each(),
                Given::Terminal => terminal.count * terminal.each(),
                Given::InputSequence => input_sequence.count * input_sequence.each(),
                Given::StateLow | Given::StateHigh => bounds(&problem.state_bounds),
                Given::InputLow | Given::InputHigh => bounds(&problem.input_bounds),
                Given::IncrementLow | Given::IncrementHigh => bounds(&problem.increment_bounds),
                Given::OutputLow | Given::OutputHigh => outputs,
                Given::StatePenalty => penalties(&problem.state_softness),
                Given::ConstraintPenalty => penalties(&problem.constraint_softness),
                Given::OutputPenalty => penalties(&problem.output_softness),
            };
            starts[i + 1] = starts[i] + length;
        }
        Self { starts, q, r, terminal, input_sequence }
    }

    fn range(&self, given: Given) -> Range<usize> {
        let place = given as usize;
        self.starts[place]..self.starts[place + 1]
    }

    /// Where number `i` of this kind is. Bounds that are the same at all stages are given once.
    pub(crate) fn place(&self, given: Given, i: usize) -> usize {
        let Range { start, end } = self.range(given);
        start + i % (end - start).max(1)
    }

    /// Where the weight of a violation is, if the problem has it.
    pub(crate) fn penalty(&self, given: Given, i: usize) -> Option<usize> {
        (!self.range(given).is_empty()).then(|| self.place(given, i))
    }

    /// Where entry (i, k) of Q at stage `j`, from 1 on, is.
    pub(crate) fn q(&self, j: usize, last: bool, i: usize, k: usize) -> Option<usize> {
        let (shape, given) = match last && self.terminal.count > 0 {
            true => (self.terminal, Given::Terminal),
            false => (self.q, Given::Q),
        };
        shape.place(j - 1, i, k).map(|place| self.range(given).start + place)
    }

    /// Where entry (i, k) of R at stage `j`, from 0 on, is.
    pub(crate) fn r(&self, j: usize, i: usize, k: usize) -> Option<usize> {
        self.r.place(j, i, k).map(|place| self.range(Given::R).start + place)
    }

    /// Where entry (i, k) of W is; `None` without W.
    pub(crate) fn input_sequence(&self, i: usize, k: usize) -> Option<usize> {
        let first = self.range(Given::InputSequence).start;
        let shape = (self.input_sequence.count > 0).then_some(self.input_sequence)?;
        shape.place(0, i, k).map(|place| first + place)
    }
}
