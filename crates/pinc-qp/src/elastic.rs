//! Hard limits that are soft for a while.

use crate::{Limits, Qp};

/// Which of the hard limits of a program are soft.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    None,
    Exact,
    All,
}

/// The penalties of a [`Qp`] without a solution: its hard limits on states, and its rows, become soft at a
/// weight, those first that are `exact`, which means soft where they have to be. Limits on inputs and increments
/// stay hard.
///
/// Reference: Gill, Murray and Saunders, "SNOPT", SIAM Review 47 (2005), for the elastic mode.
#[derive(Clone, Debug)]
pub struct Elastic {
    level: Level,
    /// The penalties of bounds and rows as the program has them.
    stated: [Vec<f64>; 2],
    exact: [Vec<bool>; 2],
}

impl Elastic {
    /// No limit of `qp` is soft that it has as hard. `exact` tells of bounds and rows which are exact.
    #[must_use]
    pub fn new(qp: &Qp, exact: [Vec<bool>; 2]) -> Self {
        let stated = [qp.bounds.penalty.clone(), qp.rows.penalty.clone()];
        Self { level: Level::None, stated, exact }
    }

    /// The same for a program of these penalties.
    pub fn restate(&mut self, qp: &Qp) {
        let exact = std::mem::take(&mut self.exact);
        *self = Self::new(qp, exact);
    }

    /// Whether hard limits are soft.
    #[inline]
    #[must_use]
    pub fn is_soft(&self) -> bool {
        self.level != Level::None
    }

    /// Whether some of the hard limits are soft and others not yet. A method may fail there on what it cannot
    /// prove to be infeasible.
    #[inline]
    #[must_use]
    pub fn is_half_soft(&self) -> bool {
        self.level == Level::Exact
    }

    /// Makes more limits of `qp` soft, and writes what that needs with [`Elastic::write`]; false if all are.
    pub fn soften_more(&mut self, qp: &Qp) -> bool {
        self.level = match self.level {
            Level::None if self.has_exact_and_others(qp) => Level::Exact,
            Level::None | Level::Exact => Level::All,
            Level::All => return false,
        };
        true
    }

    /// Gives the soft ones of the hard limits of `qp` this penalty.
    pub fn write(&self, qp: &mut Qp, weight: f64) {
        let all = self.level == Level::All;
        self.for_each(qp, |penalty, stated, exact| {
            if stated.is_infinite() && (all || exact && self.is_soft()) {
                *penalty = weight;
            }
        });
    }

    /// Makes all limits as they were.
    #[inline]
    pub fn leave(&mut self, qps: [&mut Qp; 2]) {
        if self.is_soft() {
            self.level = Level::None;
            qps.into_iter().for_each(|qp| self.restore(qp));
        }
    }

    #[inline(never)]
    fn restore(&self, qp: &mut Qp) {
        self.for_each(qp, |penalty, stated, _| *penalty = stated);
    }

    /// Gives `qp` its own penalties, except those that are exact.
    pub fn harden(&self, qp: &mut Qp) {
        self.for_each(qp, |penalty, stated, exact| {
            if !exact {
                *penalty = stated;
            }
        });
    }

    /// Hands the penalty of each limit on states, and of each row, to `change`, with the one that the program
    /// has and whether the limit is exact.
    fn for_each(&self, qp: &mut Qp, mut change: impl FnMut(&mut f64, f64, bool)) {
        let states = qp.dims.all_states();
        let found = [&mut qp.bounds.penalty[..states], &mut qp.rows.penalty];
        for ((found, stated), exact) in found.into_iter().zip(&self.stated).zip(&self.exact) {
            for ((found, stated), exact) in found.iter_mut().zip(stated).zip(exact) {
                change(found, *stated, *exact);
            }
        }
    }

    /// Whether some hard limits are exact, and others not.
    fn has_exact_and_others(&self, qp: &Qp) -> bool {
        let bounds = qp.bounds.iter().zip(&self.exact[0]).take(qp.dims.all_states());
        let hard =
            bounds.chain(Limits::iter(&qp.rows).zip(&self.exact[1])).filter(|(limits, _)| {
                let [low, high, penalty] = *limits;
                penalty.is_infinite() && (low.is_finite() || high.is_finite())
            });
        let [mut exact, mut others] = [false; 2];
        hard.for_each(|(_, is_exact)| if *is_exact { exact = true } else { others = true });
        exact && others
    }
}
