//! Rows of numbers, one per item or one for all.

use pinc_mpc::{MpcError, Nmpc, check_finite};
use pinc_ode::ArgumentError;

/// Rows of `width` numbers: as many as there are items, or one for all of them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<'a> {
    values: &'a [f64],
    width: usize,
    shared: bool,
}

impl<'a> Rows<'a> {
    pub(crate) fn new(
        field: &'static str,
        values: &'a [f64],
        width: usize,
        items: usize,
    ) -> Result<Self, MpcError> {
        let (expected, found) = (items * width, values.len());
        let shared = found == width;
        if found == expected || shared {
            Ok(Self { values, width, shared })
        } else {
            Err(ArgumentError::Length { field, expected, found }.into())
        }
    }

    pub(crate) fn at(self, item: usize) -> &'a [f64] {
        let first = if self.shared { 0 } else { item * self.width };
        &self.values[first..first + self.width]
    }
}

/// The inputs applied before, in rows of m, or of all that is under way. As of a config, a move within
/// its bounds leads from the last ones to the inputs' bounds.
pub(crate) fn applied_before<'a>(
    nmpc: &Nmpc,
    values: &'a [f64],
    width: usize,
    items: usize,
) -> Result<Rows<'a>, MpcError> {
    let field = "u_before";
    let rows = Rows::new(field, values, width, items)?;
    check_finite(field, values, values.len())?;
    let (problem, m) = (nmpc.problem(), nmpc.model().dims().nu);
    let before = problem.input_bounds.before(&problem.increment_bounds);
    for (index, &value) in values.iter().enumerate() {
        if index % width >= width - m && !before.admits(index % m, value) {
            let expected = "where a move within its bounds leads to those of the input";
            return Err(ArgumentError::Number { field, index, expected, value }.into());
        }
    }
    Ok(rows)
}

/// How many rows of `width` numbers there are.
pub(crate) fn count(field: &'static str, values: &[f64], width: usize) -> Result<usize, MpcError> {
    let items = values.len() / width.max(1);
    ArgumentError::check_length(field, values.len(), items * width)?;
    Ok(items)
}
