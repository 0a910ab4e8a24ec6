//! Inputs that are under way.

use super::Nmpc;

impl Nmpc {
    /// Predicts the state in which the input that is chosen now will act.
    pub(super) fn predict_delay(&mut self, x: &[f64]) {
        self.start.copy_from_slice(x);
        for u in self.pending.chunks_exact(self.dims.nu) {
            self.horizon.first_mut().step(&self.start, u, &self.parameters, &mut self.next);
            self.start.copy_from_slice(&self.next);
        }
    }

    /// Puts the input handed out, u[k-1] of the next step, under way.
    pub(super) fn push_delay_line(&mut self) {
        let m = self.previous.len();
        if !self.pending.is_empty() {
            self.pending.copy_within(m.., 0);
            let last = self.pending.len() - m;
            self.pending[last..].copy_from_slice(&self.previous);
        }
    }
}
