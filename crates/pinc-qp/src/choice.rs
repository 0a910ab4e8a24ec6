//! Which method solves the QPs.

#[cfg(feature = "clarabel")]
use super::ClarabelQp;
use super::{CondensedQp, OcpDims, Qp, QpSolver, QpStatus, QpStep, QpWork, RiccatiQp};
use serde::{Deserialize, Serialize};
use std::fmt;
use thiserror::Error;

/// How many times (n + m)^3 a stage costs that is solved by the recursion, where an operation of
/// condensing counts 1: with this number the choice is least off on the table of docs/growth.md.
/// The methods change at 15 stages for 2 states and 1 input, at 108 for 30 and 1.
const RECURSION: usize = 10;

/// Up to this many free inputs a condensed program is solved from scratch in less time than the
/// interior-point method takes.
const MOST_FROM_SCRATCH: usize = 100;

/// What solves the quadratic programs of a controller.
///
/// `Condensed` solves a program in any units, each state, each input and the cost in one of its
/// own. The others compare numbers of a program with one another, and want units in which states
/// and inputs are within a factor of about 100 of one another: where they are further apart these
/// methods lose digits or fail. Clarabel wants a cost of ordinary size too, or it may call a
/// program infeasible that is not. `pinc_mpc` chooses such units itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum QpMethod {
    /// `Condensed` if it takes fewer operations and states grow by at most [`QpMethod::MOST_GROWTH`], and
    /// for programs that couple all inputs; `Riccati` otherwise and for scenario trees. `Riccati` leaves
    /// programs of up to 100 free inputs that it has no good guess for to `Condensed`. `Clarabel`, if
    /// this crate is built with it, solves programs on which these fail.
    #[default]
    Auto,
    /// The states are eliminated; a dense dual active-set method solves what is left. The fastest
    /// for short horizons; its cost grows with the square of the horizon and more. Not for scenario
    /// trees.
    Condensed,
    /// Stage by stage, an active-set and an interior-point method on a Riccati recursion: the cost
    /// is linear in the number of stages. Not for programs that couple all inputs. `Clarabel`, if this crate
    /// is built with it, says whether a program on which both fail is infeasible.
    Riccati,
    /// Clarabel's sparse interior-point method, for all that is convex. It needs the feature
    /// `clarabel`.
    Clarabel,
}

/// A method that cannot solve the programs asked of it.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum QpError {
    /// A weight on the whole sequence of inputs, which couples stages that are not neighbours.
    #[error(
        "the QP method riccati works stage by stage and cannot weight the whole input sequence"
    )]
    NotStagewise,
    /// A scenario tree, of which not all states follow from one sequence of inputs.
    #[error("the QP method condensed does not solve scenario trees: name riccati or auto")]
    CondensedTree,
    /// This build has no Clarabel.
    #[error("the QP method clarabel needs a build with the feature `clarabel`")]
    NoClarabel,
}

impl QpMethod {
    /// The factor by which a state may grow over the horizon before `Auto` solves condensed programs stage
    /// by stage instead: the condensed Hessian has entries of its square beside those of size 1.
    pub const MOST_GROWTH: f64 = 1e5;

    /// Resolves `Auto`, with n states and m inputs at a stage, and N stages of which the first Nu
    /// have an input of their own.
    ///
    /// Condensing takes about `Nu m N (3 n^2 + n m) + (Nu m)^3 / 3` operations, the recursion
    /// `10 N (n + m)^3`.
    #[must_use]
    pub fn resolve(self, [n, m]: [usize; 2], [horizon, n_controls]: [usize; 2]) -> Self {
        if self != Self::Auto {
            return self;
        }
        let product = |factors: &[usize]| factors.iter().fold(1_usize, |p, f| p.saturating_mul(*f));
        let inputs = product(&[n_controls, m]);
        let condensed = product(&[inputs, horizon, n, 3 * n + m])
            .saturating_add(product(&[inputs, inputs, inputs]) / 3);
        let recursion = product(&[RECURSION, horizon, n + m, n + m, n + m]);
        if condensed <= recursion { Self::Condensed } else { Self::Riccati }
    }
}

/// The serialized name, as `condensed`.
impl fmt::Display for QpMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// The method chosen, and what helps where it fails.
#[derive(Debug)]
pub struct ChosenQp {
    method: Box<dyn QpSolver>,
    /// Methods for programs on which it fails, in this order.
    fallbacks: Vec<Box<dyn QpSolver>>,
}

impl ChosenQp {
    /// A solver for QPs of the sizes of `qp`, with finite limits and penalties where it has them.
    ///
    /// # Errors
    ///
    /// [`QpError`] if the method cannot solve such programs, or is not part of this build.
    pub fn new(qp: &Qp, method: QpMethod) -> Result<Self, QpError> {
        let (stagewise, chain) = (qp.w.is_empty(), qp.dims.tree.is_chain());
        let OcpDims { nx, nu, horizon, n_controls, .. } = qp.dims;
        let few = method == QpMethod::Auto && chain && qp.dims.all_inputs() <= MOST_FROM_SCRATCH;
        let resolved = match method.resolve([nx, nu], [horizon, n_controls]) {
            QpMethod::Condensed if method == QpMethod::Auto && !chain => QpMethod::Riccati,
            resolved => resolved,
        };
        let leaves_unstable = method == QpMethod::Auto && chain && stagewise;
        let chosen: Box<dyn QpSolver> = match resolved {
            QpMethod::Riccati if stagewise => {
                let from_scratch = few.then(|| CondensedQp::new(qp));
                Box::new(RiccatiQp::new(qp).with_from_scratch(from_scratch))
            }
            QpMethod::Riccati if method == QpMethod::Riccati => return Err(QpError::NotStagewise),
            QpMethod::Clarabel => general(qp).ok_or(QpError::NoClarabel)?,
            _ if !chain && !stagewise => return Err(QpError::NotStagewise),
            QpMethod::Condensed if !chain => return Err(QpError::CondensedTree),
            QpMethod::Condensed if leaves_unstable => {
                Box::new(CondensedQp::new(qp).for_stable_plants())
            }
            QpMethod::Condensed | QpMethod::Riccati | QpMethod::Auto => {
                Box::new(CondensedQp::new(qp))
            }
        };
        let mut fallbacks = Vec::new();
        if leaves_unstable && resolved == QpMethod::Condensed {
            fallbacks.push(Box::new(RiccatiQp::new(qp)) as Box<dyn QpSolver>);
        }
        if matches!(method, QpMethod::Auto | QpMethod::Riccati) {
            fallbacks.extend(general(qp));
        }
        Ok(Self { method: chosen, fallbacks })
    }
}

/// Clarabel, if it is part of this build.
#[cfg(feature = "clarabel")]
fn general(qp: &Qp) -> Option<Box<dyn QpSolver>> {
    Some(Box::new(ClarabelQp::new(qp)))
}

/// Clarabel, if it is part of this build.
#[cfg(not(feature = "clarabel"))]
fn general(_qp: &Qp) -> Option<Box<dyn QpSolver>> {
    None
}

/// The status, which is [`QpStatus::Failed`] where the solution is not finite.
fn checked(status: QpStatus, step: &QpStep) -> QpStatus {
    if status == QpStatus::Solved && !step.is_finite() { QpStatus::Failed } else { status }
}

impl QpSolver for ChosenQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep, expired: &mut dyn FnMut() -> bool) -> QpStatus {
        let mut status = checked(self.method.solve(qp, step, expired), step);
        for fallback in &mut self.fallbacks {
            if status != QpStatus::Failed {
                break;
            }
            if expired() {
                step.d.fill(0.0);
                step.multipliers.clear();
                return QpStatus::Expired;
            }
            tracing::debug!("a quadratic program is left to another method");
            status = checked(fallback.solve(qp, step, expired), step);
        }
        status
    }

    fn take_work(&mut self) -> QpWork {
        let mut work = self.method.take_work();
        self.fallbacks.iter_mut().for_each(|fallback| work += fallback.take_work());
        work
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kind, Row};

    /// Gives this status and step, and counts its calls.
    #[derive(Debug)]
    struct Scripted {
        status: QpStatus,
        d: f64,
        calls: usize,
    }

    impl QpSolver for Scripted {
        fn solve(&mut self, _: &Qp, step: &mut QpStep, _: &mut dyn FnMut() -> bool) -> QpStatus {
            self.calls += 1;
            step.d.fill(self.d);
            self.status
        }

        fn take_work(&mut self) -> QpWork {
            QpWork { factorizations: std::mem::take(&mut self.calls), ..QpWork::default() }
        }
    }

    fn program() -> Qp {
        Qp::new(OcpDims::new(1, 1, 1), vec![1.0], vec![1.0])
    }

    /// The status, d and the number of solutions tried, with and without a fallback.
    fn chosen(
        first: (QpStatus, f64),
        second: Option<(QpStatus, f64)>,
        expired: bool,
    ) -> (QpStatus, f64, usize) {
        let scripted =
            |(status, d)| -> Box<dyn QpSolver> { Box::new(Scripted { status, d, calls: 0 }) };
        let mut solver = ChosenQp {
            method: scripted(first),
            fallbacks: second.map(scripted).into_iter().collect(),
        };
        let qp = program();
        let mut step = QpStep::new(qp.dims);
        step.multipliers.bounds.fill(1.0);
        let status = solver.solve(&qp, &mut step, &mut || expired);
        if status == QpStatus::Expired {
            assert_eq!(step.multipliers.bounds, [0.0; 2]);
        }
        (status, step.d[0], solver.take_work().factorizations)
    }

    #[test]
    fn what_the_method_fails_on_is_left_to_the_fallback() {
        use QpStatus::{Expired, Failed, Infeasible, Solved};
        let nan = f64::NAN;
        let row = Infeasible(Row { kind: Kind::Bound, index: 0, upper: true });
        let other = Some((Solved, 2.0));
        for (first, second, expired, expected) in [
            ((Solved, 1.0), other, false, (Solved, 1.0, 1)),
            ((row, 1.0), other, false, (row, 1.0, 1)),
            ((row, 1.0), other, true, (row, 1.0, 1)),
            ((Failed, 1.0), other, false, (Solved, 2.0, 2)),
            ((Failed, 1.0), other, true, (Expired, 0.0, 1)),
            ((Failed, 1.0), None, false, (Failed, 1.0, 1)),
            // A step that is not finite is none.
            ((Solved, nan), other, false, (Solved, 2.0, 2)),
            ((Failed, 1.0), Some((row, 2.0)), false, (row, 2.0, 2)),
        ] {
            assert_eq!(chosen(first, second, expired), expected);
        }
        assert_eq!(chosen((Solved, nan), None, false).0, Failed);
        assert_eq!(chosen((Failed, 1.0), Some((Solved, nan)), false).0, Failed);
    }

    /// Which method was built, by the memory that it has.
    #[test]
    fn programs_of_few_inputs_are_condensed_where_there_is_no_guess() {
        let built = |inputs: usize, method| {
            let dims = OcpDims { horizon: inputs, n_controls: inputs, ..program().dims };
            let qp = Qp::new(dims, vec![1.0; inputs], vec![1.0; inputs]);
            let text = format!("{:?}", ChosenQp::new(&qp, method).unwrap().method);
            (text.starts_with("RiccatiQp"), text.contains("CondensedQp"))
        };
        assert_eq!(built(MOST_FROM_SCRATCH, QpMethod::Auto), (true, true));
        assert_eq!(built(MOST_FROM_SCRATCH + 1, QpMethod::Auto), (true, false));
        assert_eq!(built(MOST_FROM_SCRATCH, QpMethod::Riccati), (true, false));
        assert_eq!(built(2, QpMethod::Auto), (false, true));
    }

    /// A plant that grows by e^2 in a step: condensed, its first inputs lose all digits.
    #[test]
    fn what_grows_much_over_the_horizon_is_left_to_the_recursion() {
        let horizon = 14;
        let mut qp = Qp::new(OcpDims::new(1, 1, horizon), vec![1.0; horizon], vec![0.1; horizon]);
        (qp.a, qp.b) = (vec![2.0_f64.exp(); horizon], vec![0.3; horizon]);
        qp.c[0] = 1.0;
        let solve = |method| {
            let mut step = QpStep::new(qp.dims);
            let status = ChosenQp::new(&qp, method).unwrap().solve(&qp, &mut step, &mut || false);
            assert_eq!(status, QpStatus::Solved);
            step.d
        };
        let exact = solve(QpMethod::Riccati);
        let off = |d: &[f64]| d.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off(&solve(QpMethod::Auto)) < 1e-12);
        assert!(off(&solve(QpMethod::Condensed)) > 1e-9);
    }

    /// Where the methods cross in `benches/growth.rs` of pinc-mpc.
    #[test]
    fn the_choice_changes_where_the_methods_cross() {
        for (sizes, last_condensed) in [
            ([2, 1], 14),
            ([4, 2], 14),
            ([10, 1], 41),
            ([10, 3], 18),
            ([30, 1], 107),
            ([30, 10], 17),
            ([100, 3], 118),
        ] {
            let resolve = |n: usize| QpMethod::Auto.resolve(sizes, [n, n]);
            assert_eq!(resolve(last_condensed), QpMethod::Condensed, "{sizes:?}");
            assert_eq!(resolve(last_condensed + 1), QpMethod::Riccati, "{sizes:?}");
        }
        // Few free inputs leave little to condense.
        assert_eq!(QpMethod::Auto.resolve([4, 2], [80, 5]), QpMethod::Condensed);
        assert_eq!(QpMethod::Riccati.resolve([2, 1], [5; 2]), QpMethod::Riccati);
    }
}
