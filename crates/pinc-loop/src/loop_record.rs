//! A closed loop's whole trace, in memory.

use crate::{ClosedLoop, StepRecord};
use pinc_mpc::MpcError;
use pinc_ode::{Dims, Trajectory};

/// The record of a loop from its beginning. A loop of many steps has a long record.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoopRecord {
    /// The dense trace: the initial point and nine points per step, the last one at its end, each
    /// with the input that holds from there on (at the end of the trace, with the last one). If the
    /// plant could not be integrated, this is the trace until then.
    pub trajectory: Trajectory,
    /// The controller's record of each step; the plant may not have taken the last one.
    pub steps: Vec<StepRecord>,
}

impl LoopRecord {
    /// Nothing yet of a plant with these dimensions.
    fn new(dims: Dims) -> Self {
        Self { trajectory: Trajectory::new(dims), steps: Vec::new() }
    }

    fn add_last_step(&mut self, step: &Trajectory) {
        for i in 0..step.len() {
            if i == 0 && !self.trajectory.is_empty() {
                self.trajectory.set_last_input(step.input(0));
            } else {
                self.trajectory.push(step.times()[i], step.state(i), step.input(i));
            }
        }
    }
}

impl ClosedLoop<'_> {
    /// Takes all the steps that are left, and returns what became of them with how that ended.
    ///
    /// # Errors
    ///
    /// As [`ClosedLoop::control`] and [`Control::advance`](crate::Control::advance).
    pub fn run_recorded(&mut self) -> (LoopRecord, Result<(), MpcError>) {
        let mut record = LoopRecord::new(self.last_step().dims());
        let ended = self.record_into(&mut record);
        (record, ended)
    }

    fn record_into(&mut self, record: &mut LoopRecord) -> Result<(), MpcError> {
        while let Some(control) = self.control()? {
            record.steps.push(*control.record());
            let advanced = control.advance();
            record.add_last_step(self.last_step());
            advanced?;
        }
        Ok(())
    }
}
