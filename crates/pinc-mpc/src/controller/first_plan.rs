//! First guesses: the caller's, and several to choose from.

use super::Nmpc;
use crate::error::check_finite;
use crate::guess::{Guess, Phase};
use crate::sqp::{Outcome, PlanState};
use crate::{Bounds, MpcError, SqpStatus};
use pinc_qp::all_finite;

/// A plan replaces another one if it is cheaper by this part of the cost: the same minimum, found
/// from two starts, differs by rounding.
const CHEAPER: f64 = 1e-7;

/// How far inputs move to leave a saddle, in parts of their ranges, and how many saddles are left.
const ASIDE: f64 = 1e-3;
const SADDLES: usize = 4;

impl Nmpc {
    /// Gives the inputs of the next step's first guess, in place of ones that stay as they are: its
    /// states follow by the model. The plan found is a local minimum near it.
    ///
    /// # Shapes
    ///
    /// `inputs`: `[Nu, m]`, row by row.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `inputs` is of the wrong length or not finite; nothing has happened then.
    pub fn set_first_plan(&mut self, inputs: &[f64]) -> Result<(), MpcError> {
        check_finite("the first plan", inputs, self.dims.all_inputs())?;
        self.plan.z[self.dims.all_states()..].copy_from_slice(inputs);
        self.plan.multipliers.clear();
        self.guess = Guess::Given;
        Ok(())
    }

    /// Whether the states of a first guess follow from its inputs: with an economic cost.
    pub(super) fn rolls_out(&self) -> bool {
        self.sqp.transcription.leaves_out_hessian() && self.problem.tree().is_chain()
    }

    /// Whether a guess led where the model has no value or, `rolled_out`, far from any solution, so that
    /// a plan at rest is the better beginning.
    pub(super) fn is_lost(&self, outcome: &Outcome, rolled_out: bool) -> bool {
        let far = outcome.last.max() > self.config.tolerance.sqrt();
        let unknown = self.plan_state != PlanState::Evaluated;
        (outcome.status == SqpStatus::NumericalTrouble && (unknown || rolled_out))
            || (outcome.status == SqpStatus::Stalled && rolled_out && far)
    }

    /// Begins the first plan at `x`.
    pub(super) fn place(&mut self, x: &[f64]) {
        self.plan.stay_at(x);
        let rolls_out = self.rolls_out();
        self.guess = if rolls_out { Guess::Given } else { Guess::Warm { fallback: false } };
    }

    /// Makes the last plan the first guess of the next, unless it is already.
    pub(super) fn shift_warm_start(&mut self) {
        if self.phase != Phase::Solved {
            return;
        }
        self.phase = Phase::Shifted;
        let tentative = matches!(self.guess, Guess::Tentative { .. });
        // A shifted tree would begin where one branch leads, and the plans of the others elsewhere.
        let stays = self.is_warm() && !self.dims.tree.is_chain();
        if stays && !tentative {
            self.fallback.copy_from(&self.plan);
        }
        if self.horizon.is_uniform() {
            let is_orbit = self.problem.periodic.len() == self.dims.nx;
            if !stays {
                self.plan.shift(is_orbit);
            }
            if stays || tentative {
                self.fallback.shift(is_orbit);
            }
        } else {
            self.fallback.copy_from(&self.plan);
            self.plan.resample(&self.fallback, self.horizon.times());
        }
        if !self.is_warm() {
            // Where the model has no value for what is under way, the states stay as they are.
            if all_finite(&self.start) {
                self.plan.stay_at(&self.start);
            } else {
                self.plan.multipliers.clear();
            }
        }
        self.sqp.transcription.clear_unlimited(&mut self.plan.multipliers);
        self.sqp.project(&mut self.plan, &self.previous);
        if stays || tentative {
            self.sqp.project(&mut self.fallback, &self.previous);
        } else {
            self.fallback.copy_from(&self.plan);
        }
    }

    /// Makes the caller's plan the first guess.
    #[inline(never)]
    pub(super) fn roll_out_given(&mut self) {
        self.roll_out();
        self.fallback.copy_from(&self.plan);
        (self.guess, self.phase) = (Guess::Warm { fallback: false }, Phase::Shifted);
    }

    /// Rolls the inputs of the plan out from where it starts. Where the model has no value along
    /// them, the states stay as they are.
    pub(super) fn roll_out(&mut self) {
        let dims = self.dims;
        self.sqp.project(&mut self.plan, &self.previous);
        for j in 0..dims.horizon {
            let z = &self.plan.z;
            let x = dims.state(j).map_or(&self.start[..], |state| &z[state]);
            let u = &z[dims.input(dims.acting(j))];
            self.horizon.at(j).step(x, u, &self.parameters, &mut self.next);
            self.plan.z[dims.next_state(j)].copy_from_slice(&self.next);
        }
        if !self.plan.is_finite() {
            self.plan.stay_at(&self.start);
        }
    }

    /// Looks for cheaper plans than the one `found`, as long as there is time: a step without a plan
    /// to start from is solved from other first guesses, each of which holds one of the inputs that
    /// [`Nmpc::spread`] spreads over their box; and a plan that met its conditions but is no minimum
    /// is solved again from beside it. Returns the outcome of the cheapest plan that converged, or
    /// else the one found, with the QPs of all, and from which start it is, if there were several.
    #[inline(never)]
    pub(super) fn improve(
        &mut self,
        reference: &[f64],
        (found, is_cold): (Outcome, bool),
        expired: &mut dyn FnMut() -> bool,
    ) -> (Outcome, Option<usize>) {
        let Some(mut best) = self.best.take() else { return (found, None) };
        best.copy_from(&self.plan);
        self.sqp.keep_weight();
        let (mut outcome, mut iterations) = (found, found.iterations);
        let mut least = found.cost_if_converged();
        let starts = if is_cold { self.config.starts } else { 1 };
        let mut winner = (starts > 1).then_some(0);
        for attempt in 1..starts + SADDLES {
            let start = (attempt < starts).then_some(attempt);
            let is_saddle = outcome.curvature_dropped && outcome.status == SqpStatus::Converged;
            if start.is_none() && !is_saddle || expired() {
                break;
            }
            match start {
                Some(start) => self.spread(start),
                None => {
                    self.plan.copy_from(&best);
                    self.move_aside();
                }
            }
            let other = self.optimize(reference, expired);
            iterations += other.iterations;
            let cost = other.cost_if_converged();
            if cost + CHEAPER * cost.abs() < least {
                (outcome, least) = (other, cost);
                best.copy_from(&self.plan);
                winner = start.or(winner);
            } else if start.is_none() {
                break;
            }
        }
        self.plan.copy_from(&best);
        self.best = Some(best);
        (Outcome { iterations, ..outcome }, winner)
    }

    /// Moves each input of the plan by a small part of its range, one way or the other.
    fn move_aside(&mut self) {
        let Bounds { low, high } = &self.problem.input_bounds;
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let mut turn = 0.0_f64;
        let inputs = self.plan.z[self.dims.all_states()..].iter_mut();
        for (i, u) in inputs.enumerate() {
            let i = i % self.dims.nu;
            let range = high[i] - low[i];
            let size = if range.is_finite() { range } else { u.abs().max(1.0) };
            turn = (turn + golden).fract();
            *u += ASIDE * size * (2.0 * turn - 1.0);
        }
        self.sqp.project(&mut self.plan, &self.previous);
    }

    /// Writes the first guess of a start, with constant inputs: point `start` of a sequence of low
    /// discrepancy, the multiples of the powers of 1/g with g^(m+1) = g + 1, the golden ratio for one
    /// input (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
    fn spread(&mut self, start: usize) {
        let Bounds { low, high } = &self.problem.input_bounds;
        let m = self.dims.nu;
        let (count, multiple) = (m as f64, start as f64);
        let g = (0..64).fold(2.0_f64, |g, _| (1.0 + g).powf(1.0 / (count + 1.0)));
        self.plan.multipliers.clear();
        let inputs = &mut self.plan.z[self.dims.all_states()..];
        let (mut power, ends) = (1.0, low.iter().zip(high).take(m));
        for (i, (low, high)) in ends.enumerate() {
            power /= g;
            let u = low + (high - low) * (0.5 + multiple * power).fract();
            inputs.iter_mut().skip(i).step_by(m).for_each(|input| *input = u);
        }
        self.roll_out();
    }
}
