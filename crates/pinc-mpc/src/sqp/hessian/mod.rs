//! Which Hessian the programs have.

#[cfg(test)]
mod tests;

use crate::SqpHessian;
use pinc_qp::Convexity;

/// The Hessian of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hessian {
    /// Of the quadratic cost, without the curvature of model, outputs, h and g.
    GaussNewton,
    /// Of the Lagrangian, made convex.
    Exact,
}

/// So many programs have one Hessian before it is judged.
const PATIENCE: usize = 8;
/// So many have Gauss-Newton's where the exact one is the last resort: it is used to converge, and is
/// what exported C has.
const LONG_PATIENCE: usize = 24;
/// Over so many programs the least residual must come down to a part of what it was.
const WINDOW: usize = 4;
const FAST_ENOUGH: f64 = 0.1;

/// The damping of an exact Hessian that was no good, the factor by which it then grows and otherwise
/// falls, and the largest.
const FIRST_DAMPING: f64 = 1e-5;
const DAMPING_FACTOR: f64 = 10.0;
const MOST_DAMPING: f64 = 10.0;
/// A step that is taken to this part only had a bad Hessian.
const SHORT: f64 = 0.1;

/// Chooses between the Gauss-Newton Hessian, which needs no second derivatives and converges at a
/// linear rate, the slower the larger multipliers and curvatures are, and the exact one, which is
/// expensive and may have to be made convex far from a solution.
///
/// An iteration begins with Gauss-Newton. Where a Hessian is slow, the other one is tried. There is no
/// choice where [`SqpConfig::hessian`](crate::SqpConfig) leaves none, and with a stage cost that leaves
/// out its Hessian, which has the exact one throughout: where that is slow, it is made convex otherwise.
#[derive(Clone, Copy, Debug)]
pub(super) struct HessianChoice {
    only: Option<Hessian>,
    current: Hessian,
    /// The least residual of the last programs.
    least: [f64; WINDOW],
    /// From which program on it is judged, and how many that is from the start on.
    judged_from: usize,
    patience: usize,
    has_been_slow: bool,
    is_slow: bool,
    /// Whether the exact Hessian may help where Gauss-Newton's step is no good: once for a problem.
    may_help: bool,
    convexity: Convexity,
}

impl HessianChoice {
    /// Begins an iteration by a choice that is made, with a cost that may leave out its Hessian.
    pub(super) fn of(hessian: SqpHessian, leaves_out: bool) -> Self {
        let (only, patience) = match hessian {
            _ if leaves_out => (Some(Hessian::Exact), PATIENCE),
            SqpHessian::GaussNewton => (Some(Hessian::GaussNewton), PATIENCE),
            SqpHessian::Adaptive => (None, PATIENCE),
            SqpHessian::Auto => (None, LONG_PATIENCE),
        };
        Self { patience, judged_from: patience, ..Self::new(only) }
    }

    /// Begins an iteration; `only` one Hessian may be possible.
    pub(super) fn new(only: Option<Hessian>) -> Self {
        let current = only.unwrap_or(Hessian::GaussNewton);
        Self {
            only,
            current,
            least: [f64::INFINITY; WINDOW],
            judged_from: PATIENCE,
            patience: PATIENCE,
            has_been_slow: false,
            is_slow: false,
            may_help: true,
            convexity: Convexity::default(),
        }
    }

    pub(super) fn current(&self) -> Hessian {
        self.current
    }

    /// Whether a Hessian has been slow, other than Gauss-Newton without an alternative.
    pub(super) fn has_been_slow(&self) -> bool {
        self.has_been_slow
    }

    /// Whether the last programs were slow.
    pub(super) fn is_slow(&self) -> bool {
        self.is_slow
    }

    /// Whether the exact Hessian may be taken.
    pub(super) fn may_be_exact(&self) -> bool {
        self.only != Some(Hessian::GaussNewton)
    }

    /// Takes note of the residual after so many programs; whether the next one has another Hessian.
    pub(super) fn judge(&mut self, programs: usize, residual: f64) -> bool {
        let place = programs % WINDOW;
        let before = self.least[place];
        let last = self.least[(programs + WINDOW - 1) % WINDOW];
        self.least[place] = last.min(residual);
        let slow = self.least[place] > FAST_ENOUGH * before;
        self.is_slow = programs >= self.judged_from && slow;
        self.is_slow && self.change(programs)
    }

    /// Judges anew: the problem is another one after so many programs.
    pub(super) fn restart(&mut self, programs: usize) {
        self.least = [f64::INFINITY; WINDOW];
        (self.judged_from, self.may_help) = (programs + self.patience, true);
    }

    /// How the exact Hessian is made convex.
    pub(super) fn convexity(&self) -> Convexity {
        self.convexity
    }

    /// Takes note of the part of a step that was taken: after a short one the next one is damped, as
    /// in the method of Levenberg and Marquardt.
    pub(super) fn take_note(&mut self, length: f64) {
        if length < SHORT {
            self.damp();
        } else {
            let damping = self.convexity.damping / DAMPING_FACTOR;
            self.convexity.damping = if damping < FIRST_DAMPING { 0.0 } else { damping };
        }
    }

    fn damp(&mut self) {
        if self.only == Some(Hessian::Exact) {
            let damping = &mut self.convexity.damping;
            *damping = (DAMPING_FACTOR * *damping).clamp(FIRST_DAMPING, MOST_DAMPING);
        }
    }

    /// Gives up the Hessian, whose step is no good, after so many programs; whether there is another, or
    /// the same with more damping.
    pub(super) fn give_up(&mut self, programs: usize) -> bool {
        if self.only == Some(Hessian::Exact) {
            let before = self.convexity.damping;
            self.damp();
            return self.convexity.damping > before;
        }
        let from_exact = self.current == Hessian::Exact;
        let is_new = std::mem::take(&mut self.may_help);
        (from_exact || is_new) && self.change(programs)
    }

    /// Takes the other Hessian, if there is one.
    fn change(&mut self, programs: usize) -> bool {
        if self.only == Some(Hessian::GaussNewton) {
            return false;
        }
        (self.judged_from, self.patience, self.has_been_slow) =
            (programs + PATIENCE, PATIENCE, true);
        if self.only.is_some() {
            self.convexity.shifts ^= true;
            return false;
        }
        self.current = match self.current {
            Hessian::GaussNewton => Hessian::Exact,
            Hessian::Exact => Hessian::GaussNewton,
        };
        true
    }
}
