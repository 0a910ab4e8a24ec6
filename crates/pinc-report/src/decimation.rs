//! Rows of long tables, of which a bounded number is kept.

/// Tables of at most as many rows are kept whole.
const WHOLE: usize = 20_000;

/// Takes a table row by row. All rows are kept as long as they are few; of a longer table, in each
/// of many stretches, the first row, the last, and those in which a column is least or greatest. No
/// extreme is lost, and a curve through the rows looks the same where a stretch is narrower than
/// what an eye can tell apart.
#[derive(Debug)]
pub(crate) struct Decimation<R> {
    /// Each of `length` rows, as far as they are kept.
    stretches: Vec<Vec<Entry<R>>>,
    length: usize,
    /// The rows after the last stretch.
    open: Vec<Entry<R>>,
    /// How many of them there have been.
    opened: usize,
    rows: usize,
}

/// A row, and the numbers in its columns.
#[derive(Debug)]
struct Entry<R> {
    row: R,
    columns: Vec<f64>,
}

impl<R> Decimation<R> {
    pub(crate) fn new() -> Self {
        Self { stretches: Vec::new(), length: 1, open: Vec::new(), opened: 0, rows: 0 }
    }

    /// Adds a row with the numbers in its columns, as many in every row; NaN where there is none.
    pub(crate) fn push(&mut self, row: R, columns: Vec<f64>) {
        let stretches = (WHOLE / (2 + 2 * columns.len())).max(1);
        self.rows += 1;
        self.open.push(Entry { row, columns });
        self.opened += 1;
        let whole = self.stretches.is_empty();
        if whole && self.opened <= WHOLE {
            return;
        }
        if whole {
            self.length = WHOLE.div_ceil(stretches);
            let mut rows = std::mem::take(&mut self.open).into_iter().peekable();
            while rows.peek().is_some() {
                self.open = rows.by_ref().take(self.length).collect();
                self.opened = self.open.len();
                self.close_if_full();
            }
        }
        self.close_if_full();
        if self.stretches.len() >= 2 * stretches {
            self.length *= 2;
            let mut old = std::mem::take(&mut self.stretches).into_iter();
            while let Some(mut first) = old.next() {
                first.extend(old.next().into_iter().flatten());
                self.stretches.push(extremes(first));
            }
        }
    }

    fn close_if_full(&mut self) {
        if self.opened == self.length {
            self.opened = 0;
            self.stretches.push(extremes(std::mem::take(&mut self.open)));
        }
    }

    /// How many rows were added.
    pub(crate) fn len(&self) -> usize {
        self.rows
    }

    /// Whether all rows are kept.
    pub(crate) fn is_whole(&self) -> bool {
        self.stretches.is_empty()
    }

    /// The rows that are kept.
    pub(crate) fn into_rows(self) -> impl Iterator<Item = R> {
        self.stretches.into_iter().flatten().chain(self.open).map(|entry| entry.row)
    }
}

/// The first entry, the last, and those in which a column is least or greatest.
fn extremes<R>(entries: Vec<Entry<R>>) -> Vec<Entry<R>> {
    let Some(last) = entries.len().checked_sub(1) else { return entries };
    let mut kept = vec![false; entries.len()];
    (kept[0], kept[last]) = (true, true);
    for column in 0..entries[0].columns.len() {
        let value = |i: usize| entries[i].columns[column];
        let known = || (0..=last).filter(|&i| !value(i).is_nan());
        let by_value = |a: &usize, b: &usize| value(*a).total_cmp(&value(*b));
        for place in [known().min_by(by_value), known().max_by(by_value)].into_iter().flatten() {
            kept[place] = true;
        }
    }
    let rest = entries.into_iter().zip(kept).filter(|(_, kept)| *kept).map(|(entry, _)| entry);
    let mut rest: Vec<_> = rest.collect();
    // They were collected in the place of all entries, most of which is now free.
    rest.shrink_to_fit();
    rest
}

/// Numbers of which some, evenly spread, are kept to find the median of all.
#[derive(Debug)]
pub(crate) struct Sample {
    every: usize,
    seen: usize,
    kept: Vec<f64>,
}

impl Sample {
    pub(crate) fn new() -> Self {
        Self { every: 1, seen: 0, kept: Vec::new() }
    }

    pub(crate) fn push(&mut self, value: f64) {
        if self.seen.is_multiple_of(self.every) {
            self.kept.push(value);
        }
        self.seen += 1;
        if self.kept.len() > WHOLE {
            let mut place = 0..;
            self.kept.retain(|_| place.next().is_some_and(|i: usize| i.is_multiple_of(2)));
            self.every *= 2;
        }
    }

    /// The numbers that are kept.
    pub(crate) fn into_values(self) -> Vec<f64> {
        self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns: noise with single extremes far above and below it, and a drift.
    fn columns(i: usize) -> Vec<f64> {
        let x = i as f64;
        let spike = match i {
            77_777 => 50.0,
            123_456 => -40.0,
            _ => (x * x * 0.123).sin(),
        };
        vec![spike, if i.is_multiple_of(3) { f64::NAN } else { x }]
    }

    fn kept(rows: usize) -> Decimation<usize> {
        let mut table = Decimation::new();
        (0..rows).for_each(|i| table.push(i, columns(i)));
        table
    }

    #[test]
    fn a_short_table_is_kept_as_it_is() {
        let table = kept(WHOLE);
        assert!(table.is_whole());
        assert!(table.into_rows().eq(0..WHOLE));
    }

    #[test]
    fn a_long_table_keeps_its_ends_and_its_extremes() {
        for rows in [WHOLE + 1, WHOLE + 2, 200_003, 1_000_000] {
            let table = kept(rows);
            assert!(!table.is_whole() && table.len() == rows);
            let rest: Vec<usize> = table.into_rows().collect();
            assert!(rest.is_sorted_by(|a, b| a < b));
            assert!(rest.len() <= 3 * WHOLE, "{rows}: {}", rest.len());
            assert_eq!((rest[0], rest[rest.len() - 1]), (0, rows - 1));
            if rows > 200_000 {
                assert!(rest.contains(&77_777) && rest.contains(&123_456));
            }
            // No gap is longer than two stretches, of which there are more than a thousand.
            let gap = rest.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
            assert!(gap <= 2 * rows.div_ceil(1000), "{rows}: {gap}");
        }
    }

    #[test]
    fn a_sample_is_spread_evenly() {
        let mut sample = Sample::new();
        (0..1_000_000).for_each(|i| sample.push(f64::from(i)));
        let values = sample.into_values();
        assert!(values.len() > WHOLE / 2 && values.len() <= WHOLE);
        let step = values[1] - values[0];
        assert!(values.windows(2).all(|pair| (pair[1] - pair[0] - step).abs() < 1e-9));
    }
}
