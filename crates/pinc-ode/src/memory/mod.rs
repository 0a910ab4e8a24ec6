//! The memory of a controller or an estimator, as numbers.

#[cfg(test)]
mod tests;

/// The memory of a controller or an estimator, saved as numbers or restored from them. Each part
/// goes through its numbers once, in one order, for both directions.
#[derive(Debug)]
pub struct Memory<'a>(Direction<'a>);

#[derive(Debug)]
enum Direction<'a> {
    Save(&'a mut Vec<f64>),
    /// The numbers that are left, and whether one was missing or not of its kind.
    Restore(&'a [f64], bool),
}

impl<'a> Memory<'a> {
    /// A memory that appends to `numbers`.
    #[must_use]
    pub fn save(numbers: &'a mut Vec<f64>) -> Self {
        Self(Direction::Save(numbers))
    }

    /// A memory that was saved as `numbers`.
    #[must_use]
    pub fn restore(numbers: &'a [f64]) -> Self {
        Self(Direction::Restore(numbers, false))
    }

    /// Goes through numbers. NaN is a number here: one that is missing.
    pub fn numbers(&mut self, values: &mut [f64]) {
        match &mut self.0 {
            Direction::Save(numbers) => numbers.extend_from_slice(values),
            Direction::Restore(numbers, is_damaged) => {
                match numbers.split_at_checked(values.len()) {
                    Some((first, rest)) => {
                        values.copy_from_slice(first);
                        *numbers = rest;
                    }
                    None => *is_damaged = true,
                }
            }
        }
    }

    /// Goes through a count from 0 to `most`.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "counts are far below 2^53, and those read are checked"
    )]
    pub fn count(&mut self, value: &mut usize, most: usize) {
        let mut number = [*value as f64];
        self.numbers(&mut number);
        let [number] = number;
        if number.fract() == 0.0 && (0.0..=most as f64).contains(&number) {
            *value = number as usize;
        } else {
            self.refuse();
        }
    }

    /// Goes through a number of steps.
    pub fn step(&mut self, value: &mut u32) {
        let mut number = [f64::from(*value)];
        self.numbers(&mut number);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the conversion saturates, and what it changes is refused"
        )]
        let found = number[0] as u32;
        if f64::from(found).total_cmp(&number[0]).is_eq() {
            *value = found;
        } else {
            self.refuse();
        }
    }

    /// Goes through a truth value.
    pub fn flag(&mut self, value: &mut bool) {
        let mut count = usize::from(*value);
        self.count(&mut count, 1);
        *value = count == 1;
    }

    /// Goes through one of these values.
    pub fn choice<T: Copy + PartialEq>(&mut self, value: &mut T, all: &[T]) {
        let mut place = all.iter().position(|one| one == value).unwrap_or_default();
        self.count(&mut place, all.len() - 1);
        *value = all[place];
    }

    /// Whether this is a restoration.
    pub fn restores(&self) -> bool {
        matches!(self.0, Direction::Restore(..))
    }

    /// Takes what was read for damaged.
    pub fn refuse(&mut self) {
        if let Direction::Restore(_, is_damaged) = &mut self.0 {
            *is_damaged = true;
        }
    }

    /// Whether every number was there and was used: always when saving.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        match &self.0 {
            Direction::Save(_) => true,
            Direction::Restore(rest, is_damaged) => rest.is_empty() && !is_damaged,
        }
    }
}
