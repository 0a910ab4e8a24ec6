//! The handover from a controller to its substitute, or to its own next process.

use super::Nmpc;
use crate::guess::Phase;
use pinc_ode::Memory;

impl Nmpc {
    /// Takes over what the next step of `other`, a controller for the same problem, starts from.
    pub(super) fn continue_from(&mut self, other: &Self) {
        self.plan.copy_from(&other.plan);
        self.fallback.copy_from(&other.fallback);
        self.previous.copy_from_slice(&other.previous);
        self.pending.copy_from_slice(&other.pending);
        self.start.copy_from_slice(&other.start);
        self.guess = other.guess;
        self.steps = other.steps;
        self.plan_state = other.plan_state;
        self.phase = other.phase.without_linearization();
    }

    /// Saves what the next step starts from, or restores it into a controller for the same problem,
    /// which then goes on without a bump. After a restoration for which
    /// [`Memory::is_complete`] does not hold, [`Nmpc::reset`] it.
    pub fn remember(&mut self, memory: &mut Memory<'_>) {
        for plan in [&mut self.plan, &mut self.fallback] {
            memory.numbers(&mut plan.z);
            plan.multipliers.parts_mut().into_iter().for_each(|part| memory.numbers(part));
        }
        for part in [&mut self.previous, &mut self.pending, &mut self.start, &mut self.parameters] {
            memory.numbers(part);
        }
        self.guess.remember(memory);
        memory.step(&mut self.steps);
        self.phase.remember(memory);
        self.plan_state.remember(memory);
        self.sqp.remember(memory, &mut self.horizon);
        if memory.restores() {
            self.sqp.set_parameters(&self.parameters);
            if self.phase == Phase::Linearized {
                self.sqp.prepare(&mut self.horizon, &self.start, &self.plan);
            }
        }
    }
}
