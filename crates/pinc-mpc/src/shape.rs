//! The sizes of a control problem, and where its parts lie in flat vectors.

use crate::NmpcProblem;
use pinc_ode::Dims;
use std::ops::Range;

/// The sizes of a control problem, and where its parts lie in flat vectors.
///
/// The unknowns are `z = (x_1, .., x_N, u_0, .., u_{Nu-1})`, with `x_j` short for `x[k+j]`. The input that
/// acts in stage j is `u_{min(j, Nu-1)}`: the last is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    /// n
    pub(crate) states: usize,
    /// m
    pub(crate) inputs: usize,
    /// N = N2
    pub(crate) stages: usize,
    /// Nu
    pub(crate) moves: usize,
    /// N1
    pub(crate) first: usize,
    /// Rows of h, per constrained stage.
    pub(crate) inequalities: usize,
    /// Rows of g, per constrained stage.
    pub(crate) equalities: usize,
}

impl Shape {
    pub(crate) fn new(problem: &NmpcProblem, dims: Dims) -> Self {
        let (inequalities, equalities) =
            problem.constraints.as_ref().map_or((0, 0), |c| (c.inequalities(), c.equalities()));
        Self {
            states: dims.states,
            inputs: dims.inputs,
            stages: problem.last,
            moves: problem.control,
            first: problem.first,
            inequalities,
            equalities,
        }
    }

    /// How many numbers `x_1..x_N` are.
    pub(crate) fn all_states(self) -> usize {
        self.stages * self.states
    }

    /// How many numbers `u_0..u_{Nu-1}` are.
    pub(crate) fn all_inputs(self) -> usize {
        self.moves * self.inputs
    }

    /// How many unknowns there are.
    pub(crate) fn unknowns(self) -> usize {
        self.all_states() + self.all_inputs()
    }

    /// The number of h's and g's rows at a constrained stage.
    pub(crate) fn rows(self) -> usize {
        self.inequalities + self.equalities
    }

    /// The stages at which h and g hold: N1 to N2.
    pub(crate) fn constrained(self) -> Range<usize> {
        self.first..self.stages + 1
    }

    /// The number of h's and g's rows at all stages.
    pub(crate) fn all_rows(self) -> usize {
        self.rows() * self.constrained().len()
    }

    /// Where x_{j+1} is, the state that stage `j` leads to, in z. Also: where the rows of its
    /// dynamics are.
    pub(crate) fn next_state(self, j: usize) -> Range<usize> {
        j * self.states..(j + 1) * self.states
    }

    /// Where `x_j` is in z; `None` for the measured `x_0`.
    pub(crate) fn state(self, j: usize) -> Option<Range<usize>> {
        j.checked_sub(1).map(|j| self.next_state(j))
    }

    /// Where `u_i` is in z.
    pub(crate) fn input(self, i: usize) -> Range<usize> {
        let first = self.all_states() + i * self.inputs;
        first..first + self.inputs
    }

    /// The index of the input that acts in stage `j`: the last is held.
    pub(crate) fn acting(self, j: usize) -> usize {
        j.min(self.moves - 1)
    }

    /// Where the rows of h and g at stage `j`, from N1 to N2, are.
    pub(crate) fn stage_rows(self, j: usize) -> Range<usize> {
        let first = (j - self.first) * self.rows();
        first..first + self.rows()
    }
}
