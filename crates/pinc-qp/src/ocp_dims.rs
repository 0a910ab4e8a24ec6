//! The sizes of a control problem, and where its parts lie in flat vectors.

use crate::Tree;
use std::ops::Range;

/// The sizes of a control problem, and where its parts lie in flat vectors.
///
/// The unknowns are `z = (x_1, .., x_N, u_0, .., u_{Nu-1})`, with `x_j` short for `x[k+j]`. The
/// input that acts in stage j is `u_{min(j, Nu-1)}`: the last is held.
///
/// On a [`Tree`] that branches, `x_j` is the state of node j, and stage j - 1 leads there from the
/// node [`OcpDims::origin`]. All stages that leave a node have the node's input, so that an input
/// never depends on a branch still to come. N and Nu are then numbers of nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OcpDims {
    /// n
    pub nx: usize,
    /// m
    pub nu: usize,
    /// N = N2; the number of nodes after the root.
    pub horizon: usize,
    /// Nu; the number of nodes with an input of their own, all nodes of some depths, beyond the last
    /// branching.
    pub n_controls: usize,
    /// N1; the first node of a depth.
    pub n1: usize,
    /// Rows of the inequalities h, per constrained stage.
    pub inequalities: usize,
    /// Rows of the equalities g, per constrained stage.
    pub equalities: usize,
    /// Rows with two limits each, as bounded outputs have, per constrained stage.
    pub outputs: usize,
    /// Bounded outputs that depend on the input: each has two rows with two limits per constrained
    /// stage, one at either end of the interval that leads there.
    pub feedthrough: usize,
    /// How the stages follow one another.
    pub tree: Tree,
}

/// Rows that have the same state and input in them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowBlock {
    /// Where they are among all rows.
    pub rows: Range<usize>,
    /// j of their state `x_j`; 0 is the measured state, which does not move.
    pub state: usize,
    /// i of their input `u_i`.
    pub input: usize,
}

impl OcpDims {
    /// A chain of `horizon` stages, each with an input of its own, without rows; n1 is 1. Further
    /// fields are set by struct update.
    #[must_use]
    pub fn new(nx: usize, nu: usize, horizon: usize) -> Self {
        Self {
            nx,
            nu,
            horizon,
            n_controls: horizon,
            n1: 1,
            inequalities: 0,
            equalities: 0,
            outputs: 0,
            feedthrough: 0,
            tree: Tree::CHAIN,
        }
    }

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

    /// The number of rows of h and of g at a constrained stage.
    #[must_use]
    #[inline]
    pub fn general(self) -> usize {
        self.inequalities + self.equalities
    }

    /// The number of rows at a constrained stage: of h, of g and of outputs.
    #[must_use]
    #[inline]
    pub fn rows(self) -> usize {
        self.general() + self.outputs + 2 * self.feedthrough
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

    /// The node that stage `j` leads from.
    #[must_use]
    #[inline]
    pub fn origin(self, j: usize) -> usize {
        self.tree.origin(j)
    }

    /// The index of the input that acts in the stages from node `j` on: the last is held.
    #[must_use]
    #[inline]
    pub fn acting(self, j: usize) -> usize {
        if j < self.n_controls { j } else { self.held(j) }
    }

    /// [`OcpDims::acting`] beyond the control horizon.
    #[inline]
    fn held(self, j: usize) -> usize {
        if self.tree.is_chain() { self.n_controls - 1 } else { self.held_on_path(j) }
    }

    /// Out of line, so that loops stay short.
    #[cold]
    #[inline(never)]
    fn held_on_path(self, j: usize) -> usize {
        let scenarios = self.tree.scenarios();
        self.n_controls - scenarios + (j - self.n_controls) % scenarios
    }

    /// The index of the input of stage `j`.
    #[must_use]
    #[inline]
    pub fn input_of(self, j: usize) -> usize {
        self.acting(self.origin(j))
    }

    /// The index of the input before input `i`; `None` for the first, which follows on the input
    /// applied last.
    #[must_use]
    #[inline]
    pub fn input_before(self, i: usize) -> Option<usize> {
        i.checked_sub(1).map(|stage| self.origin(stage))
    }

    /// The inputs of nodes that a branching leads to, each with the input before it; and where among
    /// all inputs' numbers those are that come before the others, one by one.
    #[inline]
    pub(crate) fn inputs_before(self) -> (impl Iterator<Item = (usize, usize)>, Range<usize>) {
        let first = self.tree.first_chain_node();
        let (later, last) = (first + self.tree.scenarios(), self.n_controls);
        let branching = (1..later.min(last)).map(move |i| (i, self.origin(i - 1)));
        (branching, first * self.nu..(first + last.saturating_sub(later)) * self.nu)
    }

    /// The place among all inputs' numbers of the number before number `v`.
    #[must_use]
    #[inline]
    pub fn entry_before(self, v: usize) -> Option<usize> {
        if self.tree.is_chain() {
            return v.checked_sub(self.nu);
        }
        self.input_before(v / self.nu).map(|before| before * self.nu + v % self.nu)
    }

    /// The stages that leave node `j`.
    #[inline]
    pub fn stages_from(self, j: usize) -> Range<usize> {
        let children = self.tree.children(j);
        children.start.min(self.horizon + 1) - 1..children.end.min(self.horizon + 1) - 1
    }

    /// Where the rows at stage `j`, from N1 to N2, are: rows of h, of g, of outputs, and of outputs
    /// with feedthrough at the end and then at the start of the interval that leads to `x_j`.
    #[must_use]
    #[inline]
    pub fn stage_rows(self, j: usize) -> Range<usize> {
        let first = (j - self.n1) * self.rows();
        first..first + self.rows()
    }

    /// The rows at stage `j`, from N1 to N2, that constrain the state `x_j` and the input that acts
    /// there: rows of h, of g and of outputs without feedthrough.
    #[must_use]
    #[inline]
    pub fn rows_here(self, j: usize) -> RowBlock {
        let first = self.stage_rows(j).start;
        let rows = first..first + self.general() + self.outputs;
        RowBlock { rows, state: j, input: self.acting(j) }
    }

    /// The rows of outputs with feedthrough at the end of the interval that leads to `x_j`, j from
    /// N1 to N2: of `x_j` and the input of that interval.
    #[must_use]
    #[inline]
    pub fn rows_at_end(self, j: usize) -> RowBlock {
        let first = self.rows_here(j).rows.end;
        RowBlock { rows: first..first + self.feedthrough, state: j, input: self.input_of(j - 1) }
    }

    /// The rows at the start of that interval: of the state that it begins at and the same input.
    #[must_use]
    #[inline]
    pub fn rows_at_start(self, j: usize) -> RowBlock {
        let first = self.rows_at_end(j).rows.end;
        let rows = first..first + self.feedthrough;
        RowBlock { rows, state: self.origin(j - 1), input: self.input_of(j - 1) }
    }

    /// All rows at stage `j`, from N1 to N2, in their order.
    #[must_use]
    #[inline]
    pub fn row_blocks(self, j: usize) -> [RowBlock; 3] {
        [self.rows_here(j), self.rows_at_end(j), self.rows_at_start(j)]
    }

    /// j of the state `x_j` and i of the input `u_i` in a row.
    #[must_use]
    #[inline]
    pub fn row_place(self, row: usize) -> (usize, usize) {
        let [here, end, start] = self.row_blocks(self.n1 + row / self.rows());
        let block = if row < here.rows.end {
            here
        } else if row < end.rows.end {
            end
        } else {
            start
        };
        (block.state, block.input)
    }

    /// The stages that have rows: N1 to N2, or none.
    #[must_use]
    #[inline]
    pub fn stages_with_rows(self) -> Range<usize> {
        if self.rows() > 0 { self.constrained() } else { 0..0 }
    }

    /// All rows, in their order.
    #[inline]
    pub fn all_row_blocks(self) -> impl Iterator<Item = RowBlock> {
        let blocks = self.stages_with_rows().flat_map(move |j| self.row_blocks(j));
        blocks.filter(|block| !block.rows.is_empty())
    }

    /// The least and the largest value of number `i` of (x, u), over the stages of a plan z from `x0`.
    #[must_use]
    pub fn range(self, [x0, z]: [&[f64]; 2], i: usize) -> [f64; 2] {
        let (states, inputs) = z.split_at(self.all_states());
        let (first, values, place, width) = match i.checked_sub(self.nx) {
            None => (x0[i], states, i, self.nx),
            Some(input) => (inputs[input], inputs, input, self.nu),
        };
        let values = values.iter().skip(place).step_by(width);
        values.fold([first; 2], |[low, high], value| [low.min(*value), high.max(*value)])
    }

    /// The largest absolute value of such a number.
    #[must_use]
    pub fn largest(self, plan: [&[f64]; 2], i: usize) -> f64 {
        let [low, high] = self.range(plan, i);
        high.max(-low)
    }

    /// Moves a vector of the unknowns on by one stage: each node takes over from the node one stage
    /// deeper (see [`Tree::successor`]), the last ones stay.
    pub fn shift_unknowns(self, vector: &mut [f64]) {
        let (x, u) = vector.split_at_mut(self.all_states());
        self.shift(x, 1, self.nx);
        self.shift(u, 0, self.nu);
    }

    /// Moves on numbers of nodes from `first` on, `width` of each node.
    pub(crate) fn shift(self, values: &mut [f64], first: usize, width: usize) {
        let count = values.len().checked_div(width).unwrap_or(0);
        if self.tree.is_chain() && count > 1 {
            values.copy_within(width.., 0);
            return;
        }
        for place in 0..count {
            let source = self.tree.successor(first + place) - first;
            if source < count {
                values.copy_within(source * width..(source + 1) * width, place * width);
            }
        }
    }
}
