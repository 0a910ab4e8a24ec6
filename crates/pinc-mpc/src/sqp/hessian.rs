//! Which Hessian the programs have.

use crate::SqpHessian;

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
/// Over so many programs the least residual must come down to a part of what it was.
const WINDOW: usize = 4;
const FAST_ENOUGH: f64 = 0.1;

/// Chooses between the Gauss-Newton Hessian, which needs no second derivatives and converges at a
/// linear rate, the slower the larger multipliers and curvatures are, and the exact one, which is
/// expensive and may have to be made convex far from a solution.
///
/// An iteration begins with Gauss-Newton. Where a Hessian is slow, the other one is tried. There is no
/// choice where [`SqpConfig::hessian`](crate::SqpConfig) leaves none, and with a stage cost that leaves
/// out its Hessian, which has the exact one throughout.
#[derive(Clone, Copy, Debug)]
pub(super) struct HessianChoice {
    only: Option<Hessian>,
    current: Hessian,
    /// The least residual of the last programs.
    least: [f64; WINDOW],
    /// From which program on it is judged.
    judged_from: usize,
    has_changed: bool,
}

impl HessianChoice {
    /// Begins an iteration on a chain or a tree, with a cost that may leave out its Hessian.
    pub(super) fn of(hessian: SqpHessian, leaves_out: bool, is_chain: bool) -> Self {
        let gauss_newton = match hessian {
            SqpHessian::Auto => is_chain,
            SqpHessian::GaussNewton => true,
            SqpHessian::Adaptive => false,
        };
        Self::new(if leaves_out {
            Some(Hessian::Exact)
        } else {
            gauss_newton.then_some(Hessian::GaussNewton)
        })
    }

    /// Begins an iteration; `only` one Hessian may be possible.
    pub(super) fn new(only: Option<Hessian>) -> Self {
        let current = only.unwrap_or(Hessian::GaussNewton);
        Self {
            only,
            current,
            least: [f64::INFINITY; WINDOW],
            judged_from: PATIENCE,
            has_changed: false,
        }
    }

    pub(super) fn current(&self) -> Hessian {
        self.current
    }

    /// Whether a Hessian has been slow.
    pub(super) fn has_changed(&self) -> bool {
        self.has_changed
    }

    /// Takes note of the residual after so many programs; whether the next one has another Hessian.
    pub(super) fn judge(&mut self, programs: usize, residual: f64) -> bool {
        let place = programs % WINDOW;
        let before = self.least[place];
        let last = self.least[(programs + WINDOW - 1) % WINDOW];
        self.least[place] = last.min(residual);
        let slow = self.least[place] > FAST_ENOUGH * before;
        programs >= self.judged_from && slow && self.change(programs)
    }

    /// Judges anew: the problem is another one after so many programs.
    pub(super) fn restart(&mut self, programs: usize) {
        self.least = [f64::INFINITY; WINDOW];
        self.judged_from = programs + PATIENCE;
    }

    /// Gives up the exact Hessian, whose step is no good, after so many programs; whether there is
    /// another.
    pub(super) fn give_up(&mut self, programs: usize) -> bool {
        self.current == Hessian::Exact && self.change(programs)
    }

    /// Takes the other Hessian, if there is one.
    fn change(&mut self, programs: usize) -> bool {
        if self.only.is_some() {
            return false;
        }
        (self.judged_from, self.has_changed) = (programs + PATIENCE, true);
        self.current = match self.current {
            Hessian::GaussNewton => Hessian::Exact,
            Hessian::Exact => Hessian::GaussNewton,
        };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Hessians of programs with these residuals.
    fn hessians(only: Option<Hessian>, residuals: impl Iterator<Item = f64>) -> Vec<Hessian> {
        let mut choice = HessianChoice::new(only);
        let each = residuals.enumerate().map(|(k, residual)| {
            choice.judge(k, residual);
            choice.current()
        });
        each.collect()
    }

    #[test]
    fn a_slow_hessian_is_changed_and_a_fast_one_is_kept() {
        use Hessian::{Exact, GaussNewton};
        let falling = |factor: f64| (0..24).map(move |k| factor.powi(k));
        // 0.5^4 is below a tenth, 0.6^4 above.
        assert_eq!(hessians(None, falling(0.5)), [GaussNewton; 24]);
        let slow = [[GaussNewton; 8], [Exact; 8], [GaussNewton; 8]].concat();
        assert_eq!(hessians(None, falling(0.6)), slow);
        assert_eq!(hessians(Some(Exact), falling(1.0)), [Exact; 24]);
        // A rise at the beginning counts for nothing.
        let late = [1.0, 1e3, 1e3, 1e2, 1.0, 0.1, 1e-2, 1e-3, 1e-4];
        assert_eq!(hessians(None, late.into_iter()), [GaussNewton; 9]);
    }

    #[test]
    fn only_the_exact_hessian_is_given_up() {
        let mut choice = HessianChoice::new(None);
        assert!(!choice.give_up(1));
        assert!((0..=8).any(|k| choice.judge(k, 1.0)));
        assert!(choice.give_up(10));
        assert_eq!(choice.current(), Hessian::GaussNewton);
        assert!(!HessianChoice::new(Some(Hessian::Exact)).give_up(1));
    }

    #[test]
    fn another_problem_is_judged_by_its_own_residuals() {
        let mut choice = HessianChoice::new(None);
        (0..5).for_each(|k| assert!(!choice.judge(k, 1e-3)));
        choice.restart(5);
        assert!((5..20).all(|k| !choice.judge(k, 1e3 * 0.5_f64.powi(i32::try_from(k).unwrap()))));
    }
}
