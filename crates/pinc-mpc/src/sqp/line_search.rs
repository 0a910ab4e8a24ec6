//! The length of a step that the residual does not decide.

use super::hessian::Hessian;
use super::{Point, Search, Sqp, StepInput};
use crate::horizon::Horizon;
use crate::solution::Solution;
use pinc_qp::{QpSolver, QpStatus, RowBlock};

/// The part of the promised decrease of the merit function that a step must bring.
const SUFFICIENT: f64 = 1e-4;
/// How often a step is halved.
const HALVINGS: usize = 20;
/// Where the merit function falls by this part of what its slope promises, it is not convex on the way.
const CONCAVE: f64 = 0.5;
/// The part of that fall by which violations may grow.
const BROKEN: f64 = 0.1;
/// So many steps with the same active rows are too many for the exact Hessian: it is slow.
const SLOW: usize = 4;
/// How often a step is doubled.
const DOUBLINGS: usize = 10;

impl Sqp {
    /// Sets the plan `length` of the step away from the base, and linearizes there, unless
    /// `expired` says before that the time is up.
    pub(super) fn evaluate_trial(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        length: f64,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<Point> {
        self.set_trial(plan, length, input.targets.previous);
        self.try_point(model, input, plan, expired)
    }

    /// Accelerates the step by the ones before it that had the same active rows. Returns whether there are
    /// enough of them. With the exact Hessian convergence is quadratic, which acceleration would disturb,
    /// unless the iteration turns out to be slow.
    pub(super) fn accelerate(&mut self, plan: &Solution) -> bool {
        if !self.qp.has_same_active(&plan.multipliers, &self.step.multipliers) {
            self.acceleration.reset();
        }
        let least = match self.hessian.current() {
            Hessian::GaussNewton => 1,
            Hessian::Exact => SLOW,
        };
        self.acceleration.accelerate(&mut self.step, least)
    }

    pub(super) fn set_trial(&self, plan: &mut Solution, length: f64, previous: &[f64]) {
        for ((z, base), d) in plan.z.iter_mut().zip(&self.base.z).zip(&self.step.d) {
            *z = base + length * d;
        }
        if !self.transcription.units.are_plain() {
            self.move_in_units(plan, length);
        }
        // Beyond the program's own there is no estimate of the multipliers where curvature was dropped.
        let length = if self.dropped { length.min(1.0) } else { length };
        let parts = plan.multipliers.parts_mut().into_iter();
        let ends = self.base.multipliers.parts().into_iter().zip(self.step.multipliers.parts());
        for (part, (from, to)) in parts.zip(ends) {
            for ((multiplier, from), to) in part.iter_mut().zip(from).zip(to) {
                *multiplier = from + length * (to - from);
            }
        }
        // A step may be outside by the tolerance of its solver, or by rounding.
        self.project(plan, previous);
    }

    pub(super) fn accept_trial(&mut self, length: f64) {
        self.hessian.take_note(length);
        self.acceleration.advance(&self.step.d, length);
        std::mem::swap(&mut self.qp, &mut self.trial);
    }

    /// Linearizes at `plan`, into the trial QP, unless `expired` says before that the time is up; gives the
    /// cost.
    #[inline(always)]
    pub(super) fn linearize_trial(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &Solution,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<f64> {
        let (StepInput { x0, targets }, qp) = (input, &mut self.trial);
        let linearized = self.transcription.linearize(model, [x0, &plan.z], qp, expired);
        linearized.then(|| self.transcription.measure(x0, &plan.z, targets, qp))
    }

    /// Sets the plan `length` of the step away from the base, the step being in other units.
    #[inline(never)]
    fn move_in_units(&self, plan: &mut Solution, length: f64) {
        let units = &self.transcription.units;
        let steps = self.step.d.iter().enumerate();
        for ((z, base), (v, d)) in plan.z.iter_mut().zip(&self.base.z).zip(steps) {
            *z = base + length * d * units.unknown(v);
        }
    }

    /// Halves the step until the merit function decreases.
    #[inline(never)]
    pub(super) fn backtrack(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        (from, whole): (Point, Point),
        expired: &mut dyn FnMut() -> bool,
    ) -> Search {
        self.merit.update_penalties(&self.step.multipliers);
        let start = self.merit.value(&self.qp, from.cost);
        let slope = self.merit.directional_derivative(&self.qp, &self.step).min(0.0);
        // What rounding makes of sums of this size.
        let noise = 1e-14 * start.abs();
        let (mut point, mut length) = (whole, 1.0);
        for halving in 0..HALVINGS {
            let merit = self.merit.value(&self.trial, point.cost);
            if halving == 0 && merit > start + SUFFICIENT * slope + noise && self.corrects(expired)
            {
                // Nothing is lost but time if it is no better.
                match self.evaluate_trial(model, input, plan, 1.0, expired) {
                    Some(corrected)
                        if self.merit.value(&self.trial, corrected.cost)
                            <= start + SUFFICIENT * slope + noise =>
                    {
                        self.accept_trial(1.0);
                        return Search::Found(corrected);
                    }
                    Some(_) => std::mem::swap(&mut self.step, &mut self.other_step),
                    None => return self.give_up(plan),
                }
            }
            if merit <= start + SUFFICIENT * length * slope + noise {
                let is_concave = halving == 0 && self.dropped && merit - start <= CONCAVE * slope;
                if is_concave && slope < 0.0 {
                    return self.extend(model, input, plan, (point, merit, slope), expired);
                }
                self.accept_trial(length);
                return Search::Found(point);
            }
            if expired() {
                return self.give_up(plan);
            }
            length *= 0.5;
            match self.evaluate_trial(model, input, plan, length, expired) {
                Some(shorter) => point = shorter,
                None => return self.give_up(plan),
            }
        }
        plan.copy_from(&self.base);
        Search::NoDescent
    }

    /// Doubles a whole step as long as the merit function, now at `merit`, falls as it did: where negative
    /// curvature was dropped, the program says nothing of how far it falls.
    #[inline(never)]
    fn extend(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        (mut point, mut merit, slope): (Point, f64, f64),
        expired: &mut dyn FnMut() -> bool,
    ) -> Search {
        let mut length = 1.0;
        for _ in 0..DOUBLINGS {
            let Some(longer) = self.evaluate_trial(model, input, plan, 2.0 * length, expired)
            else {
                return self.give_up(plan);
            };
            let further = self.merit.value(&self.trial, longer.cost);
            let violation = further - longer.cost - (merit - point.cost);
            if further - merit <= CONCAVE * length * slope
                && violation <= BROKEN * (merit - further)
            {
                (point, merit, length) = (longer, further, 2.0 * length);
                continue;
            }
            match self.evaluate_trial(model, input, plan, length, expired) {
                Some(same) => point = same,
                None => return self.give_up(plan),
            }
            break;
        }
        self.accept_trial(length);
        Search::Found(point)
    }

    /// The second-order correction of the step, which takes its place: the program with the dynamics
    /// and rows as they are at the end of the step, so that their curvature does not make the merit
    /// function refuse it. Only where an iteration has been slow; whether there is one. Reference:
    /// Nocedal and Wright, *Numerical Optimization*, section 18.3.
    fn corrects(&mut self, expired: &mut dyn FnMut() -> bool) -> bool {
        if !self.hessian.has_been_slow() {
            return false;
        }
        if self.hessian.current() == Hessian::GaussNewton {
            self.curved.copy_from(&self.qp);
        }
        let (program, trial, d) = (&mut self.curved, &self.trial, &self.step.d);
        program.c.iter_mut().zip(&trial.c).for_each(|(c, defect)| *c += defect);
        let dims = program.dims;
        for RowBlock { rows, state, input } in dims.all_row_blocks() {
            for row in rows {
                let [by_x, by_u] = program.row_jacobians(row..row + 1);
                let dx = dims.state(state).map_or(&[][..], |state| &d[state]);
                let moved: f64 = by_x.iter().zip(dx).map(|(a, b)| a * b).sum();
                let moved =
                    moved + by_u.iter().zip(&d[dims.input(input)]).map(|(a, b)| a * b).sum::<f64>();
                program.rows.low[row] = trial.rows.low[row] + moved;
                program.rows.high[row] = trial.rows.high[row] + moved;
            }
        }
        self.other_step.multipliers.copy_from(&self.step.multipliers);
        let status = self.solver.solve(program, &mut self.other_step, expired);
        let solved = status == QpStatus::Solved;
        if solved {
            std::mem::swap(&mut self.step, &mut self.other_step);
        }
        solved
    }
}
