//! First guesses: the caller's, and several to choose from.

use super::Nmpc;
use crate::error::check_finite;
use crate::guess::{Guess, Phase};
use crate::sqp::Outcome;
use crate::{Bounds, MpcError, SqpStatus};

/// A plan replaces another one if it is cheaper by this part of the cost: the same minimum, found
/// from two starts, differs by rounding.
const CHEAPER: f64 = 1e-7;

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

    /// Makes the caller's plan the first guess.
    #[inline(never)]
    pub(super) fn roll_out_given(&mut self) {
        self.roll_out();
        self.fallback.copy_from(&self.plan);
        (self.guess, self.phase) = (Guess::Warm { fallback: false }, Phase::Shifted);
    }

    /// Rolls the inputs of the plan out from where it starts. Where the model has no value along
    /// them, the states stay as they are.
    fn roll_out(&mut self) {
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

    /// Solves the step from more first guesses, as long as there is time, and keeps the cheapest
    /// plan that converged, or else the plan `found`. Each guess holds a constant input; these
    /// spread over the box of the inputs. Returns the outcome with the QPs of all starts, and which
    /// start it is of: 0 is the plan found.
    #[inline(never)]
    pub(super) fn try_starts(
        &mut self,
        reference: &[f64],
        found: Outcome,
        expired: &mut dyn FnMut() -> bool,
    ) -> (Outcome, Option<usize>) {
        let Some(mut best) = self.best.take() else { return (found, None) };
        let cost = |nmpc: &Self, of: &Outcome| match of.status {
            SqpStatus::Converged => of.cost + nmpc.sqp.price_of_violations(),
            _ => f64::INFINITY,
        };
        let (mut outcome, mut winner) = (found, 0);
        let mut least = cost(self, &found);
        let mut iterations = found.iterations;
        best.copy_from(&self.plan);
        for start in 1..self.config.starts {
            if expired() {
                break;
            }
            self.spread(start);
            self.roll_out();
            let other = self.optimize(reference, expired);
            iterations += other.iterations;
            let other_cost = cost(self, &other);
            if other_cost + CHEAPER * other_cost.abs() < least {
                (outcome, winner, least) = (other, start, other_cost);
                best.copy_from(&self.plan);
            }
        }
        self.plan.copy_from(&best);
        self.best = Some(best);
        (Outcome { iterations, ..outcome }, Some(winner))
    }

    /// Writes the constant inputs of a start: point `start` of a sequence of low discrepancy, the
    /// multiples of the powers of 1/g with g^(m+1) = g + 1 (M. Roberts, "The unreasonable
    /// effectiveness of quasirandom sequences", 2018), which is the golden ratio for one input.
    fn spread(&mut self, start: usize) {
        let Bounds { low, high } = &self.problem.input_bounds;
        let m = self.dims.nu;
        #[expect(clippy::cast_precision_loss, reason = "inputs and starts are few")]
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
    }
}
