//! The interior-point method.

use super::newton::{Newton, stiffness};
use super::rows::Rows;
use super::side::{Side, add_up, gather};
use crate::algebra::largest;
use crate::{FARTHEST, Qp, QpWork};

/// How many iterations may be taken.
const ITERATIONS: usize = 150;

/// Residuals and products below this, relative to 1 + the largest number involved, count as 0: as
/// near as the weights, which grow without limit, allow without loss.
const TOLERANCE: f64 = 1e-8;

/// The products are not brought below this, so that they do not vanish before the rows are met.
const LEAST_PRODUCT: f64 = 1e-10;

/// How much more stiffly a row is held than [`stiffness`] says: the iterations are many, and each
/// corrects the last.
const STIFFNESS: f64 = 1e2;

/// How far towards the boundary a step goes.
const FRACTION: f64 = 0.995;

/// How the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ending {
    Converged,
    /// The multipliers prove that this row and others contradict each other.
    Infeasible(usize),
    Failed,
}

/// Mehrotra's predictor-corrector method on the stage structure (SIAM J. Optim. 2 (1992); Rao,
/// Wright and Rawlings, J. Optim. Theory Appl. 99 (1998)).
///
/// Each finite limit is a [`Side`] with its own slack, sign s:
///
/// ```text
/// s C d + t - e = s bound,    mu t = tau                  e = 0 for a hard row
/// mu + nu = penalty,              nu e = tau                  for a soft row
/// ```
///
/// from which t, e and nu are eliminated: what is left is a weight D = 1 / (t/mu + e/nu +
/// 1/stiffness) on the row. The last term comes from the proximal method of multipliers
/// (Rockafellar, Math. Oper. Res. 1 (1976)): s C Dd + Dt - De = Dmu / stiffness - residual. It
/// keeps D from growing without limit, and vanishes with the steps. Hard equalities have no slack;
/// it is their whole weight.
#[derive(Clone, Debug)]
pub(super) struct InteriorPoint {
    sides: Vec<Side>,
    /// Rows and bounds.
    equalities: Vec<(usize, f64)>,
    stiffness: f64,
    /// For programs whose Hessian stays.
    constant_stiffness: f64,
    /// What all solutions took.
    pub(super) work: QpWork,
}

impl InteriorPoint {
    pub(super) fn new(qp: &Qp) -> Self {
        let rows = Rows::new(qp.dims).len();
        Self {
            sides: Vec::with_capacity(2 * rows),
            equalities: Vec::with_capacity(rows),
            stiffness: STIFFNESS * stiffness(qp),
            constant_stiffness: STIFFNESS * stiffness(qp),
            work: QpWork::default(),
        }
    }

    /// Solves `qp` from scratch. Whatever the ending, the last multipliers are in `at`.
    /// Between factorizations `expired` is asked whether the time is up, which is a failure.
    pub(super) fn solve(
        &mut self,
        qp: &Qp,
        at: &mut Newton,
        expired: &mut dyn FnMut() -> bool,
    ) -> Ending {
        self.stiffness = match qp.has_stage_cost() {
            true => STIFFNESS * stiffness(qp),
            false => self.constant_stiffness,
        };
        gather(qp, 1.0 / self.stiffness, &mut self.sides, &mut self.equalities);
        if !self.begin(qp, at, expired) {
            return Ending::Failed;
        }
        for _ in 0..ITERATIONS {
            self.residuals(qp, at);
            if self.converged(at) {
                return Ending::Converged;
            }
            if let Some(row) = self.contradiction(qp, at) {
                return Ending::Infeasible(row);
            }
            if expired() || !self.iterate(qp, at, expired) {
                return Ending::Failed;
            }
        }
        Ending::Failed
    }

    /// The multiplier of `row` where it matters more than the slack, with its penalty where the
    /// violation matters more than what is left to the penalty; otherwise 0.
    pub(super) fn active(&self, list: &mut [f64]) {
        list.fill(0.0);
        for side in &self.sides {
            if side.soft() && side.e > side.nu() {
                list[side.row] = side.sign * side.penalty;
            } else if side.mu > side.t {
                list[side.row] = side.sign * side.mu.min(0.5 * side.penalty);
            }
        }
    }

    /// The starting point of Vandenberghe's coneqp: the least squares of cost and slacks, with
    /// these and the multipliers then moved to the positive side.
    fn begin(&mut self, qp: &Qp, at: &mut Newton, expired: &mut dyn FnMut() -> bool) -> bool {
        at.d.fill(0.0);
        at.lambda.fill(0.0);
        at.mu.fill(0.0);
        at.weights.fill(0.0);
        at.terms.fill(0.0);
        for side in &self.sides {
            at.weights[side.row] += 1.0;
            at.terms[side.row] -= side.sign * side.bound;
        }
        for &(row, bound) in &self.equalities {
            at.weights[row] = self.stiffness;
            at.terms[row] = -self.stiffness * bound;
        }
        self.work.factorizations += 1;
        if !at.factor(qp, expired) {
            return false;
        }
        at.residuals(qp);
        at.solve(qp);
        at.advance(1.0);
        let (mut least_t, mut least_mu) = (f64::INFINITY, f64::INFINITY);
        for side in &mut self.sides {
            side.mu = side.sign * at.moved[side.row] - side.bound;
            side.t = -side.mu;
            least_t = least_t.min(side.t);
            least_mu = least_mu.min(side.mu);
        }
        let lift = |least: f64| if least < 1e-3 { 1.0 - least } else { 0.0 };
        for side in &mut self.sides {
            side.t += lift(least_t);
            side.mu += lift(least_mu);
            if side.soft() {
                side.mu = side.mu.min(0.5 * side.penalty);
                side.e = side.mu * side.t / side.nu();
            }
        }
        add_up(&self.sides, &mut at.mu);
        for &(row, bound) in &self.equalities {
            at.mu[row] = self.stiffness * (at.moved[row] - bound);
        }
        true
    }

    fn residuals(&mut self, qp: &Qp, at: &mut Newton) {
        at.residuals(qp);
        for side in &mut self.sides {
            side.off = side.sign * at.values[side.row] + side.t - side.e - side.bound;
        }
    }

    fn converged(&self, at: &Newton) -> bool {
        let size = 1.0 + largest(&at.lambda).max(largest(&at.mu));
        let extent = 1.0 + largest(&at.d);
        let off = self.sides.iter().map(|side| side.off.abs());
        let unmet = self.equalities.iter().map(|&(row, bound)| (at.values[row] - bound).abs());
        let off = off.chain(unmet).fold(largest(&at.defect), f64::max);
        let products = self.sides.iter().map(|side| side.mu * side.t + side.give());
        size.is_finite()
            && largest(&at.slope) <= TOLERANCE * size
            && off <= TOLERANCE * extent
            && products.fold(0.0, f64::max) <= TOLERANCE
    }

    /// The row that weighs most in a proof (Farkas) that the hard rows contradict each other, if
    /// the multipliers are one: with C'mu + E'lambda = 0, any feasible d has lambda'c <= mu'bound.
    fn contradiction(&self, qp: &Qp, at: &mut Newton) -> Option<usize> {
        at.terms.fill(0.0);
        let (mut limit, mut heaviest) = (0.0, (0.0, 0));
        for side in self.sides.iter().filter(|side| !side.soft()) {
            at.terms[side.row] += side.sign * side.mu;
            limit += side.mu * side.bound;
            if side.mu > heaviest.0 {
                heaviest = (side.mu, side.row);
            }
        }
        for &(row, bound) in &self.equalities {
            at.terms[row] = at.mu[row];
            limit += at.mu[row] * bound;
        }
        let (remainder, offset) = at.cancel(qp);
        (offset - limit > FARTHEST * remainder).then_some(heaviest.1)
    }

    /// A step of Mehrotra's method:
    ///
    /// ```text
    /// factor H + C'D C
    /// predictor: the direction to tau = 0, which would leave the gap gap_aff
    /// tau = gap / pairs (gap_aff / gap)^3
    /// corrector: the direction to tau, with the products of the predictor's changes
    /// alpha = 0.995 of the way to the boundary
    /// ```
    fn iterate(&mut self, qp: &Qp, at: &mut Newton, expired: &mut dyn FnMut() -> bool) -> bool {
        at.weights.fill(0.0);
        for side in &mut self.sides {
            side.weigh();
            at.weights[side.row] += side.weight;
        }
        for &(row, _) in &self.equalities {
            at.weights[row] = self.stiffness;
        }
        self.work.factorizations += 1;
        if !at.factor(qp, expired) {
            return false;
        }
        let pairs = self.sides.iter().map(|side| if side.soft() { 2.0 } else { 1.0 }).sum::<f64>();
        let mut tau = 0.0;
        if pairs > 0.0 {
            self.direct(qp, at, 0.0, false);
            let gap = |length: f64| self.sides.iter().map(|side| side.gap(length)).sum::<f64>();
            let (now, affine) = (gap(0.0), gap(self.longest().min(1.0)));
            tau = (now / pairs * (affine / now).powi(3)).max(LEAST_PRODUCT);
        }
        if expired() {
            return false;
        }
        self.direct(qp, at, tau, true);
        let alpha = (FRACTION * self.longest()).min(1.0);
        if alpha.is_nan() || alpha < 1e-12 {
            return false;
        }
        at.advance(alpha);
        for side in &mut self.sides {
            side.t += alpha * side.dt;
            side.mu += alpha * side.dmu;
            side.e += alpha * side.de;
        }
        for &(row, bound) in &self.equalities {
            at.mu[row] += alpha * self.stiffness * (at.moved[row] + at.values[row] - bound);
        }
        add_up(&self.sides, &mut at.mu);
        true
    }

    /// The direction in which the products come to `tau`.
    fn direct(&mut self, qp: &Qp, at: &mut Newton, tau: f64, corrector: bool) {
        at.terms.fill(0.0);
        for side in &mut self.sides {
            side.aim(tau, corrector);
            at.terms[side.row] += side.sign * side.weight * side.term;
        }
        for &(row, bound) in &self.equalities {
            at.terms[row] = self.stiffness * (at.values[row] - bound);
        }
        at.solve(qp);
        for side in &mut self.sides {
            side.direct(at.moved[side.row]);
        }
    }

    /// The longest step that leaves nothing negative.
    fn longest(&self) -> f64 {
        // Beyond 1 / FRACTION it makes no difference.
        self.sides.iter().fold(2.0, |length, side| side.longest(length))
    }
}
