//! The counted work of a solution.

use std::ops::AddAssign;

/// The work of one or more solutions, the same on every machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QpWork {
    /// How many matrices were factored: matrices of condensed programs, or recursions over all
    /// stages.
    pub factorizations: usize,
    /// How many rows joined or left the set of active ones.
    pub changes: usize,
}

impl AddAssign for QpWork {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.factorizations += other.factorizations;
        self.changes += other.changes;
    }
}
