//! Results that count again near where they were computed.

use crate::Memory;

/// The results of some stages, each with the numbers of its *place*: all that it depends on.
#[derive(Debug)]
pub struct Recent {
    width: usize,
    size: usize,
    /// `[stages, width]`; NaN where there is none.
    places: Vec<f64>,
    /// `[stages, size]`
    results: Vec<f64>,
    /// Whether it is the result of the stage before too, if that comes to this place.
    moves: Vec<bool>,
    /// The place asked for, and how near a known one must be in each of its numbers.
    place: Vec<f64>,
    near: Vec<f64>,
}

impl Recent {
    /// Room for `stages` results of `size` numbers that depend on `width` numbers.
    #[must_use]
    pub fn new(stages: usize, width: usize, size: usize) -> Self {
        Self {
            width,
            size,
            places: vec![f64::NAN; stages * width],
            results: vec![0.0; stages * size],
            moves: vec![false; stages],
            place: vec![f64::NAN; width],
            near: vec![0.0; width],
        }
    }

    /// Sets the place to ask for, each number with the distance at which another one is near.
    ///
    /// # Panics
    ///
    /// If there are more numbers than a place has.
    pub fn set_place(&mut self, numbers: impl Iterator<Item = (f64, f64)>) {
        for (k, (number, near)) in numbers.enumerate() {
            (self.place[k], self.near[k]) = (number, near);
        }
    }

    /// The result of a stage, if it, or that of the stage `after`, was computed near the place.
    pub fn find(&mut self, stage: usize, after: Option<usize>) -> Option<&[f64]> {
        let Self { width, size, places, results, moves, place, near } = self;
        let is_near = |from: &usize| {
            let known = &places[from * *width..][..*width];
            let pairs = known.iter().zip(&*place).zip(&*near);
            pairs.fold(true, |all, ((known, number), near)| all & ((known - number).abs() <= *near))
        };
        let from = [Some(stage), after.filter(|&after| moves[after])].into_iter().flatten();
        let from = from.into_iter().find(is_near)?;
        if from != stage {
            places.copy_within(from * *width..(from + 1) * *width, stage * *width);
            results.copy_within(from * *size..(from + 1) * *size, stage * *size);
            moves[stage] = true;
        }
        Some(&results[stage * *size..][..*size])
    }

    /// Keeps the result of a stage at the place; whether it is that of the stage before too, if that
    /// comes to this place, as when a plan moves on.
    pub fn keep(&mut self, stage: usize, result: &[f64], moves: bool) {
        self.places[stage * self.width..][..self.width].copy_from_slice(&self.place);
        self.results[stage * self.size..][..self.size].copy_from_slice(result);
        self.moves[stage] = moves;
    }

    /// Forgets all results.
    pub fn forget(&mut self) {
        self.places.fill(f64::NAN);
    }

    /// Saves or restores the results, if there are any.
    pub fn remember(&mut self, memory: &mut Memory<'_>) {
        let mut any = self.places.iter().any(|number| !number.is_nan());
        memory.flag(&mut any);
        if !any {
            return self.forget();
        }
        memory.numbers(&mut self.places);
        memory.numbers(&mut self.results);
        self.moves.iter_mut().for_each(|moves| memory.flag(moves));
    }
}
