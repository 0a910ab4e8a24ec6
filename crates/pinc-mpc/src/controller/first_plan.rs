//! A first guess that the caller gives.

use super::Nmpc;
use crate::MpcError;
use crate::error::check_finite;
use crate::guess::{Guess, Phase};

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

    /// Rolls the inputs of the plan out from where it starts.
    #[inline(never)]
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
        self.fallback.copy_from(&self.plan);
        (self.guess, self.phase) = (Guess::Warm { fallback: false }, Phase::Shifted);
    }
}
