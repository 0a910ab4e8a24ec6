//! Explicit Runge-Kutta methods as tables of numbers.

use crate::dopri5;

/// The coefficients of an explicit Runge-Kutta method: row s has those by which the slopes before
/// it make stage s, and the last row those by which they make the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tableau(&'static [&'static [f64]]);

impl Tableau {
    /// The classical method of order 4: see [`Classical`](crate::Classical).
    pub const CLASSICAL: Self = Self(&[
        &[],
        &[1.0 / 2.0],
        &[0.0, 1.0 / 2.0],
        &[0.0, 0.0, 1.0],
        &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
    ]);

    /// The solution of order 5 of the method of Dormand and Prince: see
    /// [`DormandPrince`](crate::DormandPrince).
    pub const DORMAND_PRINCE: Self = Self(&dopri5::A);

    /// The rows: one per stage, with as many coefficients as there are stages before it, and that
    /// of the result.
    #[must_use]
    pub fn rows(self) -> &'static [&'static [f64]] {
        self.0
    }

    /// Evaluations of the right-hand side in a step.
    pub(super) fn stages(self) -> usize {
        self.0.len() - 1
    }

    /// What a step of `h` seconds does with the slope of each stage.
    pub(super) fn stages_of(self, h: f64) -> Vec<Stage> {
        let count = self.stages();
        // The place of each stage and of the result, where something has been added already.
        let mut places: Vec<Option<usize>> = vec![None; count + 1];
        let mut free: Vec<usize> = Vec::new();
        let mut used = 1;
        let mut input = 0;
        let mut stages = Vec::new();
        for s in 0..count {
            let mut moves = Vec::new();
            for (target, place) in places.iter_mut().enumerate().skip(s + 1) {
                let factor = h * self.0[target][s];
                // The next stage needs a place in any case.
                if factor == 0.0 && target > s + 1 {
                    continue;
                }
                let from = place.unwrap_or(0);
                let to = match *place {
                    _ if s + 1 == count => 0,
                    Some(place) => place,
                    None => free.pop().unwrap_or_else(|| {
                        used += 1;
                        used - 1
                    }),
                };
                *place = Some(to);
                moves.push(Move { from, to, factor });
            }
            stages.push(Stage { input, moves });
            if input > 0 {
                free.push(input);
            }
            input = places[s + 1].unwrap_or(0);
        }
        stages
    }
}

/// A stage of a step: its slope, computed from what is in the place `input`, is added to later
/// stages and to the result. What is in place 0 at the beginning is the state, in the end the
/// result.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stage {
    pub(super) input: usize,
    pub(super) moves: Vec<Move>,
}

/// `to := from + factor slope`
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Move {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) factor: f64,
}

/// The number of places that some stages need, with place 0.
pub(super) fn places(stages: &[Stage]) -> usize {
    let moves = stages.iter().flat_map(|stage| &stage.moves);
    moves.map(|step| step.to + 1).max().unwrap_or(1)
}
