//! Bounds that a tube tightens.

use super::{Transcription, output_limits, split_rows};
use crate::Bounds;
use crate::horizon::Horizon;
use crate::outputs::Outputs;
use pinc_ode::Memory;
use pinc_qp::Qp;
use pinc_tube::{Tightened, Tightening, Tube};

/// How the bounds of a step follow its plan.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Following {
    /// Whether they are tightened anew wherever the problem is linearized.
    pub(super) is_anew: bool,
    /// Whether they are kept for the rest of the step.
    is_over: bool,
    /// Whether the tube follows a guess in this step, for want of a plan before it.
    is_first: bool,
}

impl Transcription {
    /// Lets `tube` tighten the bounds, of a model with `ny` outputs.
    pub(crate) fn set_tube(&mut self, tube: Box<dyn Tube>, ny: usize) {
        let [ends, _] = &self.output_bounds;
        let [given, ends] = [&self.bounds, ends].map(|of| [of.low.clone(), of.high.clone()]);
        let dims = self.dims;
        let at_starts = if dims.feedthrough > 0 { ends[0].len() } else { 0 };
        let mut starts = [f64::NEG_INFINITY, f64::INFINITY].map(|none| vec![none; at_starts]);
        for (to, from) in starts.iter_mut().zip(&ends) {
            self.output_rows.copy_starts(from, to);
        }
        let given = [given, ends, starts];
        let sizes = [dims.all_states(), dims.all_inputs(), dims.horizon * ny];
        self.tightening = Some(Tightening::new(tube, sizes, given));
    }

    /// Whether a tube tightens the bounds.
    pub(crate) fn is_tightened(&self) -> bool {
        self.tightening.is_some()
    }

    /// The tube, if there is one.
    pub(crate) fn tube(&mut self) -> Option<&mut dyn Tube> {
        self.tightening.as_mut().map(Tightening::tube)
    }

    /// Tightens the bounds of a plan from `x0`, of which `z` is the first guess, along the points
    /// where the model was linearized last: the plan of the step before, unless the guess `is_known`
    /// there; whether bounds changed. Where the model has no value there, they stay as they are.
    pub(crate) fn tighten(
        &mut self,
        horizon: &mut Horizon,
        at: [&[f64]; 2],
        is_known: bool,
    ) -> bool {
        if self.tightening.is_none() {
            return false;
        }
        let shift = !is_known && self.cache.is_filled();
        self.following.is_first = !shift && !is_known;
        if self.following.is_first {
            self.cache.follow(horizon, at, &mut || false);
        }
        self.tighten_along(usize::from(shift))
    }

    /// Tightens bounds anew wherever the problem is linearized after so many programs of a step, if the
    /// tube says so and they have not been kept since.
    pub(crate) fn follow_plan(&mut self, programs: Option<usize>) {
        let Following { is_anew, is_over, is_first } = &mut self.following;
        let most = self.tightening.as_ref().map_or(0, |of| of.programs(*is_first));
        *is_over &= programs.is_some();
        *is_anew = !*is_over && programs.is_some_and(|programs| programs < most);
    }

    /// Keeps the bounds as they are for the rest of the step; whether they would have changed.
    pub(crate) fn keep_bounds(&mut self) -> bool {
        self.following.is_over = true;
        std::mem::take(&mut self.following.is_anew)
    }

    /// Tightens the bounds along the points where the model was linearized last, moved on by `shift`
    /// stages; whether bounds changed.
    pub(super) fn tighten_along(&mut self, shift: usize) -> bool {
        let Some(tightening) = &mut self.tightening else { return false };
        let Some(along) = self.cache.ahead(shift) else { return false };
        let [ends, starts] = &mut self.output_bounds;
        let bounds = [&mut self.bounds, ends, starts];
        tightening.tighten(along, bounds.map(|of| [&mut of.low[..], &mut of.high]));
        true
    }

    /// Gives back what the tube took from the bounds.
    pub(super) fn release_bounds(&mut self) {
        let Some(tightening) = &self.tightening else { return };
        let [ends, starts] = &mut self.output_bounds;
        let bounds = [&mut self.bounds, ends, starts];
        tightening.release(bounds.map(|of| [&mut of.low[..], &mut of.high]));
    }

    /// Saves or restores the bounds of the last step, into which first guesses are moved.
    pub(super) fn remember_bounds(&mut self, memory: &mut Memory<'_>) {
        let [ends, starts] = &mut self.output_bounds;
        for Bounds { low, high } in [&mut self.bounds, ends, starts] {
            for bound in low.iter_mut().chain(high) {
                // JSON has no infinity.
                let mut number = [bound.clamp(f64::MIN, f64::MAX)];
                memory.numbers(&mut number);
                *bound = number[0] * if number[0].abs() < f64::MAX { 1.0 } else { f64::INFINITY };
            }
        }
    }

    /// Writes the limits of outputs anew into a program that is linearized already.
    #[inline(never)]
    pub(crate) fn renew_output_limits(&self, qp: &mut Qp) {
        let (dims, Some(outputs)) = (self.dims, &self.outputs) else { return };
        for j in dims.constrained() {
            let (_, rows) = split_rows(dims, j);
            for (row, of @ (output, end)) in rows.zip(self.output_rows.iter()) {
                let (y, unit) = (outputs.at(end).y(j)[output], self.units.row(row));
                let limits = output_limits(&self.output_bounds, dims, j, of);
                [qp.rows.low[row], qp.rows.high[row]] = limits.map(|limit| (limit - y) / unit);
            }
        }
    }

    /// What became of the bounds, for a plan `z` that the outputs are of.
    pub(crate) fn tightened(&self, z: &[f64]) -> Option<Tightened<'_>> {
        let of = self.tightening.as_ref()?;
        let outputs = self.outputs.as_ref().map_or([&[][..]; 2], Outputs::values);
        let [ends, starts] = &self.output_bounds;
        let bounds = [&self.bounds, ends, starts].map(|of| [&of.low[..], &of.high]);
        Some(of.judge(bounds, z, outputs))
    }
}
