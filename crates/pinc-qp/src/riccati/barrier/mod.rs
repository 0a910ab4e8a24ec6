//! The interior-point method for nonlinear programs, which are linearized anew at each point.

#[cfg(test)]
mod tests;

use super::newton::Newton;
use super::rows::Rows;
use super::side::{Side, add_up, gather};
use crate::algebra::largest;
use crate::convexify::{largest_entry, shift_hessian};
use crate::multipliers::scale_of_sum;
use crate::{Multipliers, Qp, QpWork};
use std::mem::take;

/// tau falls where the residual of its problem is below this multiple of it, by this factor or to
/// this power, whichever is less, and not below the last.
const NEAR: f64 = 10.0;
const FACTOR: f64 = 0.2;
const POWER: f64 = 1.5;
const LEAST: f64 = 1e-10;

/// How far towards the boundary a step goes.
const FRACTION: f64 = 0.995;

/// A step that is stopped by the boundary this early is none.
const SHORTEST: f64 = 1e-12;

/// How far mu t may be from tau, as a factor.
const SPREAD: f64 = 1e10;

/// The largest weights of limits and the weight of equalities, in terms of the Hessian's largest entry:
/// a row that gives way to its weight leaves a violation that the slope of the merit function does not
/// know.
const STIFFNESS: [f64; 2] = [1e13, 1e9];

/// The first shift of the Hessian and the largest, in terms of its largest entry; how it grows, and how
/// much less is tried after a shift.
const FIRST_SHIFT: f64 = 1e-4;
const SHIFTS: [f64; 2] = [1e-6, 1e6];
const GROWTH: f64 = 8.0;
const EASING: f64 = 3.0;

/// The part of the violation's weight that must be gained along a step.
const GAINED: f64 = 0.1;

/// A primal-dual barrier method for a nonlinear program that is given by its linearizations, with the
/// Hessian of its Lagrangian. With slacks t of all limits, and e of soft ones,
///
/// ```text
/// min  J + sum (penalty e - tau log t - tau log e)    s.t.    dynamics,  s C(z) + t - e = s bound
/// ```
///
/// is solved for a tau that falls to 0. A step is Newton's in all variables, on the stage structure;
/// where the Hessian, the rows' weights included, has negative curvature on the dynamics, it is
/// shifted ([`Qp::shift_weights`]). The caller goes along the step as far as [`Barrier::merit`] falls enough.
///
/// References: Waechter and Biegler, Math. Program. 106 (2006), with a merit function in place of the
/// filter; Nocedal and Wright, *Numerical Optimization*, section 19.4. All memory is allocated at
/// construction.
#[derive(Debug)]
pub struct Barrier {
    newton: Newton,
    sides: Vec<Side>,
    /// Rows and bounds.
    equalities: Vec<(usize, f64)>,
    stiffness: f64,
    tau: f64,
    /// The last shift of the Hessian.
    shift: f64,
    /// The weight of violations.
    sigma: f64,
    /// The length of the step of the multipliers of limits.
    dual_length: f64,
    work: QpWork,
}

impl Barrier {
    /// For programs of the sizes of `qp`.
    #[must_use]
    pub fn new(qp: &Qp) -> Self {
        let rows = Rows::new(qp.dims).len();
        Self {
            newton: Newton::new(qp.dims),
            sides: Vec::with_capacity(2 * rows),
            equalities: Vec::with_capacity(rows),
            stiffness: 1.0,
            tau: LEAST,
            shift: 0.0,
            sigma: 0.0,
            dual_length: 1.0,
            work: QpWork::default(),
        }
    }

    /// Begins at the point where `qp` is the program's linearization, with these multipliers and tau:
    /// slacks and multipliers of limits are the nearest on the central path.
    pub fn begin(&mut self, qp: &Qp, multipliers: &Multipliers, tau: f64) {
        (self.tau, self.sigma, self.shift) = (tau.max(LEAST), 0.0, 0.0);
        let Self { newton: Newton { rows, lambda, mu, .. }, sides, equalities, .. } = self;
        lambda.copy_from_slice(&multipliers.dynamics);
        rows.read(multipliers, mu);
        gather(qp, 0.0, sides, equalities);
        for side in &mut *sides {
            side.center((side.sign * mu[side.row]).max(0.0), self.tau);
        }
        add_up(sides, mu);
    }

    /// Takes the linearization at the point, with d = 0.
    pub fn measure(&mut self, qp: &Qp) {
        self.newton.d.fill(0.0);
        self.newton.residuals(qp);
        let rows = self.newton.rows;
        for side in &mut self.sides {
            side.bound = bound(side, rows.limits_of(qp, side.row));
            side.off = side.t - side.e - side.bound;
        }
        for (row, bound) in &mut self.equalities {
            [_, *bound, _] = rows.limits_of(qp, *row);
        }
    }

    /// Brings tau down as far as the point that was measured allows.
    pub fn lower_tau(&mut self) {
        while self.tau > LEAST && self.residual() <= NEAR * self.tau {
            self.tau = (FACTOR * self.tau).min(self.tau.powf(POWER)).max(LEAST);
            self.sigma = 0.0;
        }
    }

    /// The residual of the problem with tau.
    fn residual(&self) -> f64 {
        let Newton { lambda, slope, defect, .. } = &self.newton;
        let sum = self.sides.iter().map(|side| side.mu).sum::<f64>()
            + lambda.iter().map(|lambda| lambda.abs()).sum::<f64>();
        let scale = scale_of_sum(sum, self.sides.len() + lambda.len());
        let unmet = self.equalities.iter().map(|(_, bound)| bound.abs());
        let off = self.sides.iter().map(|side| side.off.abs()).chain(unmet);
        let products = self.sides.iter().map(|side| {
            let give = if side.soft() { (side.give() - self.tau).abs() } else { 0.0 };
            give.max((side.mu * side.t - self.tau).abs())
        });
        let products = products.fold(largest(slope), f64::max);
        off.fold(largest(defect), f64::max).max(products / scale)
    }

    /// Writes the step `d` at the point that was measured, where `qp` has the Hessian of the Lagrangian,
    /// which is shifted if it must be. The longest step that leaves nothing negative, at most 1; `None`
    /// if there is none.
    pub fn direct(
        &mut self,
        qp: &mut Qp,
        d: &mut [f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<f64> {
        let (at, tau, size) = (&mut self.newton, self.tau, largest_entry(qp));
        let [limits, equalities] = STIFFNESS.map(|stiffness| stiffness * size);
        self.stiffness = equalities;
        at.weights.fill(0.0);
        at.terms.fill(0.0);
        for side in &mut self.sides {
            side.compliance = 1.0 / limits;
            side.weigh();
            side.aim(tau, false);
            at.weights[side.row] += side.weight;
            at.terms[side.row] += side.sign * side.weight * side.term;
        }
        for &(row, bound) in &self.equalities {
            at.weights[row] = self.stiffness;
            at.terms[row] = -self.stiffness * bound;
        }
        self.factor(qp, size, expired)?;
        let at = &mut self.newton;
        at.solve(qp);
        let [mut primal, mut dual] = [1.0 / FRACTION; 2];
        for side in &mut self.sides {
            side.direct(at.moved[side.row]);
            primal = side.longest_primal(primal);
            dual = side.longest_dual(dual);
        }
        self.dual_length = FRACTION * dual;
        d.copy_from_slice(at.step());
        let length = FRACTION * primal;
        (length >= SHORTEST).then_some(length)
    }

    /// Factors, with the least shift of a sequence that makes that possible; `size` is the largest entry
    /// of the Hessian.
    fn factor(&mut self, qp: &mut Qp, size: f64, expired: &mut dyn FnMut() -> bool) -> Option<()> {
        let [least, most] = SHIFTS.map(|shift| shift * size);
        let before = take(&mut self.shift);
        loop {
            self.work.factorizations += 1;
            if self.newton.factor(qp, expired) {
                return Some(());
            }
            let next = match self.shift {
                0.0 if before > 0.0 => (before / EASING).max(least),
                0.0 => FIRST_SHIFT * size,
                shift => GROWTH * shift,
            };
            let possible = next < most;
            if !possible || expired() {
                return None;
            }
            shift_hessian(qp, next - self.shift);
            self.shift = next;
        }
    }

    /// The merit function at the point where `qp` is the linearization, and its slope along the step:
    /// the cost with its barriers and sigma times all violations. sigma grows if the step would not be
    /// one of descent.
    pub fn begin_search(&mut self, qp: &Qp, d: &[f64], cost: f64) -> [f64; 2] {
        let mut slope: f64 = qp.gradient.iter().zip(d).map(|(g, d)| g * d).sum();
        for side in &self.sides {
            slope -= self.tau * side.dt / side.t;
            if side.soft() {
                slope += (side.penalty - self.tau / side.e) * side.de;
            }
        }
        let [barriers, off] = self.parts(qp, 0.0);
        if off > 0.0 {
            // d'H d of all variables, by the first-order conditions of the step.
            let curvature = self.price_of_defects() - slope;
            let promised = slope + 0.5 * curvature.max(0.0);
            self.sigma = self.sigma.max(promised / ((1.0 - GAINED) * off));
        }
        let violation = self.sigma * off;
        [cost + barriers + violation, slope - violation]
    }

    /// The multipliers after the step times what the equations are off.
    fn price_of_defects(&self) -> f64 {
        let at = &self.newton;
        let sides = self.sides.iter().map(|side| (side.mu + side.dmu) * side.off);
        let equalities = self
            .equalities
            .iter()
            .map(|&(row, bound)| -bound * (at.mu[row] + self.stiffness * (at.moved[row] - bound)));
        at.price_of_defect() + sides.chain(equalities).sum::<f64>()
    }

    /// The merit function `length` of the step away, where `qp` is the linearization.
    #[must_use]
    pub fn merit(&self, qp: &Qp, cost: f64, length: f64) -> f64 {
        let [barriers, off] = self.parts(qp, length);
        cost + barriers + self.sigma * off
    }

    /// The barriers, and the sum of all violations.
    fn parts(&self, qp: &Qp, length: f64) -> [f64; 2] {
        let rows = self.newton.rows;
        let (mut barriers, mut off) = (0.0, qp.c.iter().map(|c| c.abs()).sum::<f64>());
        for side in &self.sides {
            let (t, e) = (side.t + length * side.dt, side.e + length * side.de);
            barriers -= self.tau * t.ln();
            if side.soft() {
                barriers += side.penalty * e - self.tau * e.ln();
            }
            off += (t - e - bound(side, rows.limits_of(qp, side.row))).abs();
        }
        for &(row, _) in &self.equalities {
            let [_, high, _] = rows.limits_of(qp, row);
            off += high.abs();
        }
        [barriers, off]
    }

    /// Goes `length` of the step with slacks and the multipliers of equations, and as far as it goes
    /// with those of limits.
    pub fn advance(&mut self, length: f64) {
        self.newton.advance_lambda(length);
        for side in &mut self.sides {
            side.t += length * side.dt;
            side.e += length * side.de;
            let center = self.tau / side.t;
            let mu = side.mu + self.dual_length * side.dmu;
            side.mu = mu.clamp(center / SPREAD, SPREAD * center);
        }
        for &(row, bound) in &self.equalities {
            let moved = self.newton.moved[row];
            self.newton.mu[row] += length * self.stiffness * (moved - bound);
        }
        add_up(&self.sides, &mut self.newton.mu);
    }

    /// Writes the multipliers.
    pub fn write(&self, multipliers: &mut Multipliers) {
        self.newton.rows.write(&self.newton.mu, multipliers);
        multipliers.dynamics.copy_from_slice(&self.newton.lambda);
    }

    /// The work since this was last asked.
    pub fn take_work(&mut self) -> QpWork {
        take(&mut self.work)
    }
}

/// s times the limit of a side.
fn bound(side: &Side, [low, high, _]: [f64; 3]) -> f64 {
    if side.sign > 0.0 { high } else { -low }
}
