//! The pattern of a matrix's nonzero entries.

use std::ops::Range;

/// The places of a matrix where it is not zero everywhere, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SparsityPattern {
    columns: usize,
    /// The first entry of each row, and the end.
    starts: Vec<usize>,
    /// The column of each entry.
    places: Vec<usize>,
}

impl SparsityPattern {
    /// The pattern of a matrix of `columns` columns whose rows have entries in these columns, in
    /// ascending order.
    ///
    /// # Panics
    ///
    /// If there is no such column, or the columns of a row do not ascend.
    #[must_use]
    pub fn new<R: IntoIterator<Item = usize>>(
        columns: usize,
        rows: impl IntoIterator<Item = R>,
    ) -> Self {
        let (mut starts, mut places) = (vec![0], Vec::new());
        for row in rows {
            let begin = places.len();
            places.extend(row);
            assert!(places[begin..].is_sorted_by(|a, b| a < b), "columns must ascend");
            assert!(places[begin..].iter().all(|&column| column < columns), "no such column");
            starts.push(places.len());
        }
        Self { columns, starts, places }
    }

    /// The number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// The number of columns.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The number of entries.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.places.len()
    }

    /// The entries of a row, counted through the matrix.
    ///
    /// # Panics
    ///
    /// If there is no such row.
    #[must_use]
    #[inline(always)]
    pub fn row(&self, row: usize) -> Range<usize> {
        self.starts[row]..self.starts[row + 1]
    }

    /// The column of each entry.
    #[must_use]
    #[inline(always)]
    pub fn places(&self) -> &[usize] {
        &self.places
    }
}
