//! The sizes of a control problem, and where its parts lie in flat vectors.

use std::ops::Range;

/// The sizes of a control problem, and where its parts lie in flat vectors.
///
/// The unknowns are `z = (x_1, .., x_N, u_0, .., u_{Nu-1})`, with `x_j` short for `x[k+j]`. The
/// input that acts in stage j is `u_{min(j, Nu-1)}`: the last is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OcpDims {
    /// n
    pub nx: usize,
    /// m
    pub nu: usize,
    /// N = N2
    pub horizon: usize,
    /// Nu
    pub n_controls: usize,
    /// N1
    pub n1: usize,
    /// Rows of the inequalities h, per constrained stage.
    pub inequalities: usize,
    /// Rows of the equalities g, per constrained stage.
    pub equalities: usize,
    /// Rows with two limits each, as bounded outputs have, per constrained stage.
    pub outputs: usize,
}

impl OcpDims {
    /// How many numbers `x_1..x_N` are.
    #[must_use]
    #[inline]
    pub fn all_states(self) -> usize {
        self.horizon * self.nx
    }

    /// How many numbers `u_0..u_{Nu-1}` are.
    #[must_use]
    #[inline]
    pub fn all_inputs(self) -> usize {
        self.n_controls * self.nu
    }

    /// How many unknowns there are.
    #[must_use]
    #[inline]
    pub fn unknowns(self) -> usize {
        self.all_states() + self.all_inputs()
    }

    /// The number of rows at a constrained stage: of h, of g and of outputs.
    #[must_use]
    #[inline]
    pub fn rows(self) -> usize {
        self.inequalities + self.equalities + self.outputs
    }

    /// The stages at which these rows hold: N1 to N2.
    #[must_use]
    #[inline]
    pub fn constrained(self) -> Range<usize> {
        self.n1..self.horizon + 1
    }

    /// The number of these rows at all stages.
    #[must_use]
    #[inline]
    pub fn all_rows(self) -> usize {
        self.rows() * self.constrained().len()
    }

    /// Where x_{j+1} is, the state that stage `j` leads to, in z. Also: where the rows of its
    /// dynamics are.
    #[must_use]
    #[inline]
    pub fn next_state(self, j: usize) -> Range<usize> {
        j * self.nx..(j + 1) * self.nx
    }

    /// Where `x_j` is in z; `None` for the measured `x_0`.
    #[must_use]
    #[inline]
    pub fn state(self, j: usize) -> Option<Range<usize>> {
        j.checked_sub(1).map(|j| self.next_state(j))
    }

    /// Where `u_i` is in z.
    #[must_use]
    #[inline]
    pub fn input(self, i: usize) -> Range<usize> {
        let first = self.all_states() + i * self.nu;
        first..first + self.nu
    }

    /// The index of the input that acts in stage `j`: the last is held.
    #[must_use]
    #[inline]
    pub fn acting(self, j: usize) -> usize {
        j.min(self.n_controls - 1)
    }

    /// Where the rows at stage `j`, from N1 to N2, are: those of h, of g and of outputs.
    #[must_use]
    #[inline]
    pub fn stage_rows(self, j: usize) -> Range<usize> {
        let first = (j - self.n1) * self.rows();
        first..first + self.rows()
    }
}
