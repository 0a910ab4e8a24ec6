//! The limits of rows with their slacks, as interior-point methods see them.

use super::rows::Rows;
use crate::Qp;

/// The part of its penalty that a soft row's multiplier begins with at most.
const MOST: f64 = 0.99;

/// A finite limit of a row, with its slack t, its multiplier mu, and for a soft row its violation e:
/// see [`InteriorPoint`](super::interior_point::InteriorPoint) and
/// [`Barrier`](super::barrier::Barrier).
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    pub(super) row: usize,
    /// s: 1 at an upper limit, -1 at a lower one.
    pub(super) sign: f64,
    /// s times the limit.
    pub(super) bound: f64,
    pub(super) penalty: f64,
    pub(super) t: f64,
    pub(super) mu: f64,
    pub(super) e: f64,
    /// 1 / stiffness
    pub(super) compliance: f64,
    /// The residual of the first line.
    pub(super) off: f64,
    /// D
    pub(super) weight: f64,
    /// The part of Dmu / D that does not depend on the step.
    pub(super) term: f64,
    /// The wanted change of nu e.
    pub(super) outer: f64,
    pub(super) dt: f64,
    pub(super) dmu: f64,
    pub(super) de: f64,
}

impl Side {
    pub(super) fn new(row: usize, sign: f64, limit: f64, penalty: f64, compliance: f64) -> Self {
        let bound = sign * limit;
        let zero = 0.0;
        Self {
            row,
            sign,
            bound,
            penalty,
            t: 1.0,
            mu: 1.0,
            e: 0.0,
            compliance,
            off: zero,
            weight: zero,
            term: zero,
            outer: zero,
            dt: zero,
            dmu: zero,
            de: zero,
        }
    }

    pub(super) fn soft(&self) -> bool {
        self.penalty.is_finite()
    }

    pub(super) fn nu(&self) -> f64 {
        self.penalty - self.mu
    }

    /// nu e
    pub(super) fn give(&self) -> f64 {
        if self.soft() { self.nu() * self.e } else { 0.0 }
    }

    /// Computes D.
    pub(super) fn weigh(&mut self) {
        let give = if self.soft() { self.e / self.nu() } else { 0.0 };
        self.weight = 1.0 / (self.t / self.mu + give + self.compliance);
    }

    /// Chooses the changes of the products mu t and nu e, to reach `tau`; the corrector includes the
    /// predictor's effect.
    pub(super) fn aim(&mut self, tau: f64, corrector: bool) {
        let second = if corrector { (self.dmu * self.dt, -self.dmu * self.de) } else { (0.0, 0.0) };
        let inner = tau - self.mu * self.t - second.0;
        self.outer = tau - self.nu() * self.e - second.1;
        let give = if self.soft() { self.outer / self.nu() } else { 0.0 };
        self.term = self.off + inner / self.mu - give;
    }

    /// The step of t, mu and e, where C d changes by `moved`.
    pub(super) fn direct(&mut self, moved: f64) {
        self.dmu = self.weight * (self.sign * moved + self.term);
        self.de = if self.soft() { (self.outer + self.e * self.dmu) / self.nu() } else { 0.0 };
        self.dt = -self.off - self.sign * moved + self.de + self.compliance * self.dmu;
    }

    /// The longest step, up to `length`, that leaves nothing negative.
    pub(super) fn longest(&self, length: f64) -> f64 {
        self.longest_dual(self.longest_primal(length))
    }

    /// The same for t and e alone.
    pub(super) fn longest_primal(&self, length: f64) -> f64 {
        let length = length.min(until_zero(self.t, self.dt));
        if self.soft() { length.min(until_zero(self.e, self.de)) } else { length }
    }

    /// The same for mu and nu alone.
    pub(super) fn longest_dual(&self, length: f64) -> f64 {
        let length = length.min(until_zero(self.mu, self.dmu));
        if self.soft() { length.min(until_zero(self.nu(), -self.dmu)) } else { length }
    }

    /// Takes the point with mu t = nu e = tau near a value of 0 and the multiplier `known`: the difference
    /// t - mu is that of the room to the limit and `known`.
    pub(super) fn center(&mut self, known: f64, tau: f64) {
        let (room, apart) = (self.bound, self.bound - known);
        let root = (apart * apart + 4.0 * tau).sqrt();
        // mu^2 + apart mu - tau = 0, without cancellation.
        self.mu = if apart > 0.0 { 2.0 * tau / (root + apart) } else { 0.5 * (root - apart) };
        if self.soft() {
            self.mu = self.mu.min(MOST * self.penalty);
            self.e = tau / self.nu();
            if -room > self.e {
                self.e = -room;
                self.mu = (self.penalty - tau / self.e).max(0.5 * self.penalty);
            }
        }
        self.t = tau / self.mu;
    }

    /// The sum of the products after a step of this length.
    pub(super) fn gap(&self, length: f64) -> f64 {
        let (t, mu) = (self.t + length * self.dt, self.mu + length * self.dmu);
        let e = self.e + length * self.de;
        mu * t + if self.soft() { (self.penalty - mu) * e } else { 0.0 }
    }
}

/// The length at which a value that changes so comes to 0.
fn until_zero(value: f64, change: f64) -> f64 {
    if change < 0.0 { -value / change } else { f64::INFINITY }
}

/// Collects the finite limits of all rows and, apart from them, the hard equalities with their values.
pub(super) fn gather(
    qp: &Qp,
    compliance: f64,
    sides: &mut Vec<Side>,
    equalities: &mut Vec<(usize, f64)>,
) {
    sides.clear();
    equalities.clear();
    for (row, [low, high, penalty]) in Rows::limits(qp).enumerate() {
        if low >= high && penalty.is_infinite() {
            equalities.push((row, high));
            continue;
        }
        for (sign, limit) in [(1.0, high), (-1.0, low)] {
            if limit.is_finite() {
                sides.push(Side::new(row, sign, limit, penalty, compliance));
            }
        }
    }
}

/// Adds up the multipliers of the limits of each row that has any.
pub(super) fn add_up(sides: &[Side], mu: &mut [f64]) {
    sides.iter().for_each(|side| mu[side.row] = 0.0);
    sides.iter().for_each(|side| mu[side.row] += side.sign * side.mu);
}
