//! Rows of numbers, one per item or one for all.

use pinc_mpc::MpcError;

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
            Err(MpcError::Length { field, expected, found })
        }
    }

    pub(crate) fn at(self, item: usize) -> &'a [f64] {
        let first = if self.shared { 0 } else { item * self.width };
        &self.values[first..first + self.width]
    }
}

/// How many rows of `width` numbers there are.
pub(crate) fn count(field: &'static str, values: &[f64], width: usize) -> Result<usize, MpcError> {
    let items = values.len() / width.max(1);
    let (expected, found) = (items * width, values.len());
    if found == expected { Ok(items) } else { Err(MpcError::Length { field, expected, found }) }
}
