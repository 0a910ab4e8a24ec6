//! Which Hessian the programs have.

/// The Hessian of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hessian {
    /// Of the quadratic cost, without the curvature of model, outputs, h and g.
    GaussNewton,
    /// Of the Lagrangian, made convex.
    Exact,
}

/// After so many programs with one Hessian it is judged.
const PATIENCE: usize = 8;
/// By then the least residual must have come down to this part.
const FAST_ENOUGH: f64 = 0.1;

/// Chooses between the Gauss-Newton Hessian, which needs no second derivatives and converges at a
/// linear rate, the slower the larger multipliers and curvatures are, and the exact one, which is
/// expensive and may have to be made convex far from a solution.
///
/// An iteration begins with Gauss-Newton. Where a Hessian is slow, the other one is tried. A stage
/// cost that leaves out its Hessian has the exact one throughout.
#[derive(Clone, Copy, Debug)]
pub(super) struct HessianChoice {
    only: Option<Hessian>,
    current: Hessian,
    /// Since when the current one is on trial: the number of the program, and the least residual
    /// then.
    since: (usize, f64),
}

impl HessianChoice {
    /// Begins an iteration; `only` one Hessian may be possible.
    pub(super) fn new(only: Option<Hessian>) -> Self {
        let current = only.unwrap_or(Hessian::GaussNewton);
        Self { only, current, since: (0, f64::INFINITY) }
    }

    pub(super) fn current(&self) -> Hessian {
        self.current
    }

    /// Whether the next program has another Hessian than the last, after so many of them, given the
    /// least residual so far.
    pub(super) fn judge(&mut self, programs: usize, least: f64) -> bool {
        let (first, before) = self.since;
        if programs == 0 {
            self.since = (0, least);
        } else if programs >= first + PATIENCE {
            let slow = least > FAST_ENOUGH * before;
            self.since = (programs, least);
            return slow && self.change();
        }
        false
    }

    /// Gives up the exact Hessian, whose step is no good, after so many programs; whether there is
    /// another.
    pub(super) fn give_up(&mut self, programs: usize, least: f64) -> bool {
        self.since = (programs, least);
        self.current == Hessian::Exact && self.change()
    }

    /// Takes the other Hessian, if there is one.
    fn change(&mut self) -> bool {
        if self.only.is_some() {
            return false;
        }
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

    /// The Hessians of programs whose residual falls by `factor` with each.
    fn hessians(only: Option<Hessian>, factor: f64, programs: u32) -> Vec<Hessian> {
        let mut choice = HessianChoice::new(only);
        let each = (0..programs).map(|k| {
            choice.judge(k as usize, factor.powi(i32::try_from(k).unwrap()));
            choice.current()
        });
        each.collect()
    }

    #[test]
    fn a_slow_hessian_is_changed_and_a_fast_one_is_kept() {
        use Hessian::{Exact, GaussNewton};
        // 0.7^8 is below a tenth, 0.8^8 above.
        assert_eq!(hessians(None, 0.7, 60), [GaussNewton; 60]);
        let slow = [[GaussNewton; 8], [Exact; 8], [GaussNewton; 8]].concat();
        assert_eq!(hessians(None, 0.8, 24), slow);
        assert_eq!(hessians(Some(Exact), 1.0, 24), [Exact; 24]);
    }

    #[test]
    fn only_the_exact_hessian_is_given_up() {
        let mut choice = HessianChoice::new(None);
        choice.judge(0, 1.0);
        assert!(!choice.give_up(1, 1.0));
        assert!(choice.judge(9, 1.0));
        assert!(choice.give_up(10, 1.0));
        assert_eq!(choice.current(), Hessian::GaussNewton);
        assert!(!HessianChoice::new(Some(Hessian::Exact)).give_up(1, 1.0));
    }
}
