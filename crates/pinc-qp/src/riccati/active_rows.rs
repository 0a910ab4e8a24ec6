//! The primal-dual active-set method.

use super::newton::{Newton, stiffness};
use super::rows::Rows;
use crate::algebra::largest;
use crate::{Qp, QpWork};

/// Residuals below this, relative to 1 + the largest number involved, count as 0.
const TOLERANCE: f64 = 1e-11;

/// The tolerance for the slope, which must be exact for exact inputs if some multipliers are large.
const SLOPE_TOLERANCE: f64 = 3e-13;

/// What rounding leaves of the gradient, where it cancels against the Hessian times the step.
const ROUNDING: f64 = 2e-15;

/// Where a multiplier is below this, and below the distance to the limit, its row is more likely to
/// have come off the limit than to go back. A shifted plan that nears its bounds for ever has many
/// of them; if held, they are released and held again without end.
const SMALL_MULTIPLIER: f64 = 1e-5;

/// What is off by more than this, relative to 1 + its size, when the held rows have been met but
/// roughly, is so when they are met exactly.
const FAR: f64 = 1e-4;

/// How many times the set of active rows may change.
const CHANGES: usize = 12;

/// How many steps the rows of one set may take to be met.
const STEPS: usize = 20;

/// Rows that come nearer so slowly, over half of the steps, are held more stiffly by a factor, at most so
/// often for one set.
const NEARER: f64 = 0.99;
const STIFFENING: f64 = 100.0;
const STIFFENINGS: usize = 2;

/// After how many of them the time is looked at: with a good guess there is a solution by then.
const UNASKED: usize = 3;

/// The least multiplier that a row is noted with, so that it is taken for active again.
const NOTED: f64 = 1e-3;

/// How much work a guess of the active rows is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Patience {
    /// How many linear systems may be solved.
    pub(super) steps: usize,
    /// The search ends when more rows are wrong than so many times one more than there were at the
    /// least: sets that come round again only take the time of the next method.
    pub(super) relapse: usize,
}

impl Patience {
    /// There is no other method left.
    pub(super) const ENDLESS: Self = Self { steps: usize::MAX, relapse: usize::MAX };
}

/// What is assumed of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum RowStatus {
    /// Its multiplier is 0.
    Inactive,
    /// It is at this limit, the upper one or not.
    Held { bound: f64, upper: bool },
    /// It is soft and violated: its multiplier is its penalty, with the sign.
    Violated(f64),
}

/// Solves a QP from a guess of its active rows: the rows that are held are met with equality; then
/// those that pull the wrong way are let go, those that are violated are held, and so on until
/// nothing changes. This is Newton's method on the non-smooth optimality conditions (Hintermueller,
/// Ito and Kunisch, SIAM J. Optim. 13 (2002)): a few factorizations from a good guess, without a
/// guarantee from a bad one.
///
/// Held rows are met by the method of multipliers, which dependent rows do not disturb:
/// mu <- mu + D (C d - bound), with so large a D that a few steps suffice.
#[derive(Clone, Debug)]
pub(super) struct ActiveRows {
    rows: Rows,
    statuses: Vec<RowStatus>,
    /// The rows that are not inactive, in ascending order: few of all.
    active: Vec<usize>,
    /// Those that are held, with their bounds.
    held: Vec<(usize, f64)>,
    /// The rows that become active, and the multipliers of those that are.
    added: Vec<(usize, RowStatus)>,
    kept: Vec<f64>,
    stiffness: f64,
    /// For programs whose Hessian stays.
    constant_stiffness: f64,
    /// What all solutions took.
    pub(super) work: QpWork,
    /// How many steps it may still take.
    steps_left: usize,
    /// Whether a set is changed as soon as it is clearly wrong, before its rows have been met. That
    /// takes fewer steps, and gives up more programs.
    hasty: bool,
}

impl ActiveRows {
    pub(super) fn new(qp: &Qp) -> Self {
        let rows = Rows::new(qp.dims);
        Self {
            rows,
            statuses: vec![RowStatus::Inactive; rows.len()],
            active: Vec::with_capacity(rows.len()),
            held: Vec::with_capacity(rows.len()),
            added: Vec::with_capacity(rows.len()),
            kept: Vec::with_capacity(rows.len()),
            stiffness: stiffness(qp),
            constant_stiffness: stiffness(qp),
            work: QpWork::default(),
            steps_left: 0,
            hasty: false,
        }
    }

    /// Takes rows with a multiplier in `list` for active. Small ones of rows away from their limits do
    /// not count.
    pub(super) fn guess(&mut self, qp: &Qp, list: &[f64]) {
        let Self { rows, statuses, active, .. } = self;
        active.iter().for_each(|&row| statuses[row] = RowStatus::Inactive);
        active.clear();
        let counts = |low: f64, high: f64, mu: f64| (mu != 0.0) | (low >= high);
        rows.find(qp, list, counts, |row, [low, high, mu]| {
            let penalty = rows.limits_of(qp, row)[2];
            let upper = mu > 0.0;
            let bound = if upper { high } else { low };
            let room = bound.abs().min(SMALL_MULTIPLIER);
            let status = if low >= high && penalty.is_infinite() {
                RowStatus::Held { bound: high, upper: true }
            } else if mu.abs() <= room || !bound.is_finite() {
                return;
            } else if mu.abs() >= penalty {
                RowStatus::Violated(penalty.copysign(mu))
            } else {
                RowStatus::Held { bound, upper }
            };
            statuses[row] = status;
            active.push(row);
        });
    }

    /// Solves `qp` from the guess and the point `at` as long as there is `patience`; whether that
    /// succeeded.
    /// Between factorizations and steps `expired` is asked whether the time is up, which is a
    /// failure.
    pub(super) fn solve(
        &mut self,
        qp: &Qp,
        at: &mut Newton,
        patience: Patience,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        self.steps_left = patience.steps;
        self.hasty = patience != Patience::ENDLESS;
        self.stiffness = match qp.has_stage_cost() {
            true => stiffness(qp),
            false => self.constant_stiffness,
        };
        let mut most = usize::MAX;
        for change in 0..CHANGES {
            if change > 0 && expired() {
                return false;
            }
            match self.meet(qp, at, expired) {
                Some(true) => match self.reconsider(qp, at) {
                    0 => {
                        self.clear_rounding(qp, &mut at.mu);
                        return true;
                    }
                    wrong if wrong > most => return false,
                    wrong => most = most.min(patience.relapse.saturating_mul(wrong + 1)),
                },
                Some(false) if self.release(qp, at) => {}
                Some(false) | None => return false,
            }
        }
        false
    }

    /// Clears multipliers that pull the wrong way by rounding: on that side there may be no limit.
    fn clear_rounding(&self, qp: &Qp, mu: &mut [f64]) {
        for &row in &self.active {
            let [low, high, _] = self.rows.limits_of(qp, row);
            if let RowStatus::Held { upper, .. } = self.statuses[row]
                && low < high
                && (mu[row] > 0.0) != upper
            {
                mu[row] = 0.0;
            }
        }
    }

    /// Writes multipliers by which the last set of active rows is guessed again.
    pub(super) fn note(&self, qp: &Qp, list: &mut [f64]) {
        let rows = self.statuses.iter().zip(Rows::limits(qp));
        for (mu, (status, [_, _, penalty])) in list.iter_mut().zip(rows) {
            *mu = match *status {
                RowStatus::Inactive => 0.0,
                RowStatus::Violated(penalty) => penalty,
                RowStatus::Held { upper, .. } => {
                    let sign = if upper { 1.0 } else { -1.0 };
                    sign * (sign * *mu).max(NOTED).min(0.5 * penalty)
                }
            };
        }
    }

    /// Rows that cannot be met together have multipliers that drift for ever: lets go the one of
    /// them whose multiplier comes to 0 first, if there is one.
    fn release(&mut self, qp: &Qp, at: &Newton) -> bool {
        let mut first = None;
        for &row in &self.active {
            let [low, high, _] = self.rows.limits_of(qp, row);
            if let RowStatus::Held { upper, .. } = self.statuses[row]
                && low < high
            {
                let sign = if upper { 1.0 } else { -1.0 };
                let change = self.stiffness * at.moved[row] + at.terms[row];
                let time = sign * at.mu[row] / -(sign * change);
                if sign * change < 0.0 && first.is_none_or(|(least, _)| time < least) {
                    first = Some((time, row));
                }
            }
        }
        let Some((_, row)) = first else { return false };
        self.work.changes += 1;
        self.statuses[row] = RowStatus::Inactive;
        self.active.retain(|other| *other != row);
        true
    }

    /// Finds the point at which the held rows are met; whether there is one, or `None` if that
    /// cannot be told.
    fn meet(
        &mut self,
        qp: &Qp,
        at: &mut Newton,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        self.held.clear();
        self.kept.clear();
        self.kept.extend(self.active.iter().map(|&row| at.mu[row]));
        at.weights.fill(0.0);
        at.terms.fill(0.0);
        at.mu.fill(0.0);
        for (&row, &mu) in self.active.iter().zip(&self.kept) {
            match self.statuses[row] {
                RowStatus::Inactive => {}
                RowStatus::Held { bound, .. } => {
                    at.weights[row] = self.stiffness;
                    at.mu[row] = mu;
                    self.held.push((row, bound));
                }
                RowStatus::Violated(penalty) => at.mu[row] = penalty,
            }
        }
        for stiffening in 0..=STIFFENINGS {
            self.work.factorizations += 1;
            if !at.factor(qp, expired) {
                return None;
            }
            let mut halfway = 0.0;
            for step in 0..STEPS {
                at.residuals(qp);
                if self.is_met(qp, at) {
                    return Some(true);
                }
                if self.hasty && step > 0 && self.is_contradicted(qp, at) {
                    return Some(true);
                }
                if step >= UNASKED && expired() {
                    return None;
                }
                if step == STEPS / 2 {
                    halfway = self.farthest(at);
                }
                self.steps_left = self.steps_left.checked_sub(1)?;
                for &(row, bound) in &self.held {
                    at.terms[row] = self.stiffness * (at.values[row] - bound);
                }
                at.solve(qp);
                at.advance(1.0);
                for &(row, _) in &self.held {
                    at.mu[row] += self.stiffness * at.moved[row] + at.terms[row];
                }
            }
            at.residuals(qp);
            if self.is_met(qp, at) {
                return Some(true);
            }
            // Rows that cannot be met together stay where they are.
            if self.farthest(at) > NEARER * halfway || stiffening == STIFFENINGS {
                break;
            }
            self.stiffness *= STIFFENING;
            self.held.iter().for_each(|&(row, _)| at.weights[row] = self.stiffness);
        }
        Some(false)
    }

    /// How far the held row that is farthest from its limit is from it.
    fn farthest(&self, at: &Newton) -> f64 {
        let off = self.held.iter().map(|&(row, bound)| (at.values[row] - bound).abs());
        off.fold(0.0, f64::max)
    }

    fn is_met(&self, qp: &Qp, at: &Newton) -> bool {
        let size = 1.0 + largest(&at.lambda).max(largest(&at.mu));
        let slope = SLOPE_TOLERANCE * size + ROUNDING * largest(&qp.gradient);
        if !slope.is_finite() || largest(&at.slope) > slope {
            return false;
        }
        let extent = 1.0 + largest(&at.d);
        let off = self.farthest(at).max(largest(&at.defect));
        extent.is_finite() && off <= TOLERANCE * extent
    }

    /// Whether the point contradicts a status by far: by more than another step would change it.
    fn is_contradicted(&self, qp: &Qp, at: &Newton) -> bool {
        let pulls = self.active.iter().any(|&row| match self.statuses[row] {
            RowStatus::Held { upper, .. } => {
                let ([low, high, _], mu) = (self.rows.limits_of(qp, row), at.mu[row]);
                let pull = if upper { mu } else { -mu };
                pull < -FAR * (1.0 + mu.abs()) && low < high
            }
            RowStatus::Inactive | RowStatus::Violated(_) => false,
        });
        let mut any = pulls;
        self.rows.find(qp, &at.values, is_outside, |row, [low, high, value]| {
            any |= self.statuses[row] == RowStatus::Inactive
                && (value > high + FAR * (1.0 + high.abs())
                    || value < low - FAR * (1.0 + low.abs()));
        });
        any
    }

    /// Changes the statuses that the point contradicts, and counts them.
    fn reconsider(&mut self, qp: &Qp, at: &Newton) -> usize {
        let Self { rows, statuses, active, added, .. } = self;
        let slack = |bound: f64| 10.0 * TOLERANCE * (1.0 + bound.abs());
        added.clear();
        rows.find(qp, &at.values, is_outside, |row, [low, high, value]| {
            if statuses[row] != RowStatus::Inactive {
            } else if value > high + slack(high) {
                added.push((row, RowStatus::Held { bound: high, upper: true }));
            } else if value < low - slack(low) {
                added.push((row, RowStatus::Held { bound: low, upper: false }));
            }
        });
        let mut changes = added.len();
        active.retain(|&row| {
            let ([low, high, penalty], value) = (rows.limits_of(qp, row), at.values[row]);
            let next = match statuses[row] {
                RowStatus::Held { upper, .. } => {
                    let mu = at.mu[row];
                    let pull = if upper { mu } else { -mu };
                    let rounding = TOLERANCE * (1.0 + mu.abs());
                    if pull < -rounding && low < high {
                        RowStatus::Inactive
                    } else if mu.abs() > penalty {
                        RowStatus::Violated(penalty.copysign(mu))
                    } else {
                        statuses[row]
                    }
                }
                RowStatus::Violated(penalty) if penalty > 0.0 && value < high - slack(high) => {
                    RowStatus::Held { bound: high, upper: true }
                }
                RowStatus::Violated(penalty) if penalty < 0.0 && value > low + slack(low) => {
                    RowStatus::Held { bound: low, upper: false }
                }
                unchanged => unchanged,
            };
            changes += usize::from(next != statuses[row]);
            statuses[row] = next;
            next != RowStatus::Inactive
        });
        for &(row, status) in &*added {
            statuses[row] = status;
            active.push(row);
        }
        active.sort_unstable();
        self.work.changes += changes;
        changes
    }
}

/// Whether a value is beyond a limit.
fn is_outside(low: f64, high: f64, value: f64) -> bool {
    (value > high) | (value < low)
}

#[cfg(test)]
mod tests {
    use super::super::tests::scalar;
    use super::*;
    use crate::QpStep;

    /// x = u, at most 1 and 2; the least of (u - middle)^2 / 2. The rows are x, u and the
    /// increment.
    fn program(middle: f64) -> Qp {
        let mut qp = scalar(0.0, 1.0);
        qp.gradient[1] = -middle;
        qp.bounds.high = vec![2.0, 1.0];
        qp
    }

    /// u, the status of the two bounds, and how many factorizations and changes it took; `None` if
    /// there is no solution.
    fn solved(
        qp: &Qp,
        multipliers: [f64; 3],
        patience: Patience,
    ) -> Option<(f64, [RowStatus; 2], [usize; 2])> {
        let (mut rows, mut at) = (ActiveRows::new(qp), Newton::new(qp.dims));
        at.start(&QpStep::new(qp.dims));
        rows.guess(qp, &multipliers);
        let found = rows.solve(qp, &mut at, patience, &mut || false);
        let work = [rows.work.factorizations, rows.work.changes];
        found.then(|| (at.d[1], [rows.statuses[0], rows.statuses[1]], work))
    }

    const HELD: RowStatus = RowStatus::Held { bound: 1.0, upper: true };

    #[test]
    fn one_of_two_rows_that_cannot_be_met_together_is_let_go() {
        // In haste it is seen after a few steps that they cannot.
        for patience in [Patience::ENDLESS, Patience { steps: 6, relapse: 2 }] {
            let (u, statuses, work) = solved(&program(5.0), [1.0, 1.0, 0.0], patience).unwrap();
            assert!((u - 1.0).abs() < 1e-10, "{u}");
            assert_eq!((statuses, work), ([RowStatus::Inactive, HELD], [2, 1]));
        }
    }

    #[test]
    fn rows_are_held_let_go_and_violated_as_their_multipliers_say() {
        use RowStatus::{Inactive, Violated};
        let soft = |middle: f64| {
            let mut qp = program(middle);
            qp.bounds.penalty[1] = 3.0;
            qp
        };
        for (qp, guess, u, statuses, work) in [
            // Held without need; not held, where u = 5 violates both.
            (program(0.5), [0.0, 1.0, 0.0], 0.5, [Inactive; 2], [2, 1]),
            (program(5.0), [0.0; 3], 1.0, [Inactive, HELD], [3, 3]),
            // The multiplier of a row that is met would be 2, 4 and 3.5.
            (soft(3.0), [0.0, 1.0, 0.0], 1.0, [Inactive, HELD], [1, 0]),
            (soft(4.5), [0.0, 1.0, 0.0], 1.5, [Inactive, Violated(3.0)], [2, 1]),
            (soft(4.5), [0.0, 3.0, 0.0], 1.5, [Inactive, Violated(3.0)], [1, 0]),
            // Taken for violated, which it is not.
            (soft(3.0), [0.0, 3.0, 0.0], 1.0, [Inactive, HELD], [2, 1]),
        ] {
            let found = solved(&qp, guess, Patience::ENDLESS).unwrap();
            assert!((found.0 - u).abs() < 1e-10, "{} {u}", found.0);
            assert_eq!((found.1, found.2), (statuses, work));
        }
    }

    /// x = 100 u, where one of the curvatures is nearly 0 and the one along u is 1e4.
    #[test]
    fn rows_that_come_near_slowly_are_held_more_stiffly() {
        let mut qp = scalar(1.0, 1e-8);
        (qp.b[0], qp.gradient[1]) = (100.0, -3e4);
        qp.bounds.high[1] = 1.0;
        let (u, statuses, work) = solved(&qp, [0.0, 1.0, 0.0], Patience::ENDLESS).unwrap();
        assert!((u - 1.0).abs() < 1e-9, "{u}");
        assert_eq!((statuses, work), ([RowStatus::Inactive, HELD], [3, 0]));
    }

    #[test]
    fn an_equality_is_held_whatever_its_multiplier() {
        let mut qp = program(-3.0);
        (qp.bounds.low[0], qp.bounds.low[1]) = (0.0, 1.0);
        // Alone, and with a row that contradicts it, which is let go.
        for (guess, work) in [([0.0; 3], [1, 0]), ([-1.0, 0.0, 0.0], [2, 1])] {
            for patience in [Patience::ENDLESS, Patience { steps: 24, relapse: 2 }] {
                let found = solved(&qp, guess, patience).unwrap();
                assert!((found.0 - 1.0).abs() < 1e-10, "{}", found.0);
                assert_eq!((found.1, found.2), ([RowStatus::Inactive, HELD], work));
            }
        }
    }

    /// The least is next to the limit, within rounding, and there is no limit on the other side.
    #[test]
    fn a_multiplier_of_rounding_belongs_to_no_other_limit() {
        let qp = program(1.0 - 5e-12);
        let mut step = QpStep::new(qp.dims);
        step.multipliers.bounds[1] = 1.0;
        let mut at = Newton::new(qp.dims);
        at.start(&step);
        let mut rows = ActiveRows::new(&qp);
        rows.guess(&qp, &at.mu.clone());
        assert!(rows.solve(&qp, &mut at, Patience::ENDLESS, &mut || false));
        assert_eq!(rows.statuses, [RowStatus::Inactive, HELD, RowStatus::Inactive]);
        assert!(at.mu[1] == 0.0, "{:e}", at.mu[1]);
    }

    #[test]
    fn the_statuses_are_guessed_again_from_what_was_noted() {
        let mut qp = program(0.0);
        qp.bounds.low[0] = -1.0;
        (qp.bounds.penalty[0], qp.bounds.penalty[1]) = (5.0, 3.0);
        (qp.increments.low[0], qp.increments.high[0]) = (-1.0, 1.0);
        let lower = RowStatus::Held { bound: -1.0, upper: false };
        for (statuses, mu, noted) in [
            ([lower, RowStatus::Violated(3.0), RowStatus::Inactive], [-2.0; 3], [-2.0, 3.0, 0.0]),
            // A multiplier of the wrong sign, one that is close to its penalty.
            ([lower, HELD, lower], [0.1, 2.9, -9.0], [-NOTED, 1.5, -9.0]),
        ] {
            let mut rows = ActiveRows::new(&qp);
            rows.statuses.copy_from_slice(&statuses);
            rows.active = vec![0, 1, 2];
            let mut list = mu;
            rows.note(&qp, &mut list);
            assert_eq!(list.to_vec(), noted.to_vec());
            rows.statuses.fill(HELD);
            rows.guess(&qp, &list);
            assert_eq!(rows.statuses, statuses);
        }
    }

    #[test]
    fn patience_ends() {
        let guess = [0.0, 1.0, 0.0];
        let of = |steps| solved(&program(0.5), guess, Patience { steps, relapse: 2 }).is_some();
        assert!(!of(0) && !of(1) && of(20));
    }
}
