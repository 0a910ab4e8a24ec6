//! The references of the tracked quantities.

#[cfg(test)]
mod tests;

use crate::MpcError;
use crate::error::{check_numbers, check_range, check_setting};
use pinc_ode::{ArgumentError, PiecewiseConstant};
use std::ops::Range;

/// One reference value per control step, known in advance.
///
/// Value k is what the state *after* step k, x\[k+1\], is compared with. There may be values beyond
/// the steps of a loop, which its last steps look ahead to.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    outputs: usize,
    steps: usize,
    /// How many values there are: `steps`, and those that follow.
    rows: usize,
    values: Vec<f64>,
}

impl Reference {
    /// The reference with these values.
    ///
    /// # Shapes
    ///
    /// `values`: `[steps, outputs]`, row by row.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if there is no whole row or a value is not finite.
    pub fn new(values: Vec<f64>, outputs: usize) -> Result<Self, MpcError> {
        check_range("reference outputs", outputs, 1, usize::MAX)?;
        check_range("reference values", values.len(), outputs, usize::MAX)?;
        let ragged = values.len() % outputs;
        if ragged != 0 {
            return Err(ArgumentError::Length {
                field: "the last row of the reference",
                expected: outputs,
                found: ragged,
            }
            .into());
        }
        check_numbers("reference", &values, "finite", f64::is_finite)?;
        let steps = values.len() / outputs;
        Ok(Self { outputs, steps, rows: steps, values })
    }

    /// The reference of nothing, where a controller tracks nothing, for so many steps.
    #[must_use]
    pub fn none(steps: usize) -> Self {
        Self { outputs: 0, steps, rows: steps, values: Vec::new() }
    }

    /// The values of `signal` at the beginning of each of `steps` steps of `sample_time_s` seconds, and
    /// those that follow until the signal no longer changes.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `steps` is 0 or `sample_time_s` is not positive and finite.
    pub fn sample(
        signal: &PiecewiseConstant,
        steps: usize,
        sample_time_s: f64,
    ) -> Result<Self, MpcError> {
        let good = sample_time_s > 0.0 && sample_time_s.is_finite();
        check_setting("sample_time_s", sample_time_s, "positive and finite", good)?;
        check_range("steps", steps, 1, usize::MAX)?;
        let rows = steps.max(1 + steps_until(signal.last_start_s(), sample_time_s));
        let values = (0..rows).flat_map(|k| signal.at(k as f64 * sample_time_s));
        Ok(Self { steps, ..Self::new(values.copied().collect(), signal.width())? })
    }

    /// The reference with all of its values as steps.
    #[must_use]
    pub fn whole(self) -> Self {
        Self { steps: self.rows, ..self }
    }

    /// How many steps there are.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// How many quantities are tracked.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// The value of step `k`; after the end, the last.
    #[must_use]
    pub fn at(&self, k: usize) -> &[f64] {
        let k = k.min(self.rows - 1);
        &self.values[k * self.outputs..(k + 1) * self.outputs]
    }

    /// The steps between which the value changes: each range has one value.
    #[must_use]
    pub fn segments(&self) -> Vec<Range<usize>> {
        self.ranges(|k| self.changes(k))
    }

    /// The same, with neighbouring steps in which the value moves on as one range.
    #[must_use]
    pub fn stretches(&self) -> Vec<Range<usize>> {
        let moves_on = |k: usize| {
            let beside = if k + 1 < self.steps() { k + 1 } else { k.saturating_sub(2) };
            self.changes(k) && (k == 1 || self.changes(k.saturating_sub(1))) && self.changes(beside)
        };
        self.ranges(|k| self.changes(k) && !moves_on(k))
    }

    /// Whether all of these steps have one value.
    #[must_use]
    pub fn is_held(&self, steps: Range<usize>) -> bool {
        !steps.skip(1).any(|k| self.changes(k))
    }

    /// Whether step `k` has another value than the one before.
    fn changes(&self, k: usize) -> bool {
        k > 0 && !self.at(k).iter().zip(self.at(k - 1)).all(|(a, b)| a.total_cmp(b).is_eq())
    }

    /// The ranges of steps of which another begins where `begins` says so.
    fn ranges(&self, begins: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
        let mut starts: Vec<usize> = (0..self.steps()).filter(|&k| k == 0 || begins(k)).collect();
        starts.push(self.steps());
        starts.windows(2).map(|pair| pair[0]..pair[1]).collect()
    }

    /// Writes the preview at step `k`, as many rows as `window` holds: the values of steps
    /// k, k+1, ..; after the end, the last.
    ///
    /// # Shapes
    ///
    /// `window`: `[rows, outputs]`, row by row.
    pub fn preview(&self, k: usize, window: &mut [f64]) {
        for (i, row) in window.chunks_exact_mut(self.outputs.max(1)).enumerate() {
            row.copy_from_slice(self.at(k + i));
        }
    }

    /// Writes the preview at step `k` for stages that end at the times `ends_s`, in s from there,
    /// of which the first is the length of a step: the values of the steps in which they end.
    ///
    /// # Shapes
    ///
    /// `window`: `[stages, outputs]`, row by row.
    pub fn preview_at(&self, k: usize, ends_s: &[f64], window: &mut [f64]) {
        for (row, end) in window.chunks_exact_mut(self.outputs.max(1)).zip(ends_s) {
            row.copy_from_slice(self.at(k + steps_until(*end, ends_s[0]) - 1));
        }
    }
}

/// How many steps of `length_s` it takes to come to `time_s`, which is positive; a part that is
/// rounding is none.
pub(crate) fn steps_until(time_s: f64, length_s: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, reason = "stages are few, and times positive")]
    let steps = (time_s / length_s * (1.0 - 1e-9)).ceil() as usize;
    steps.max(1)
}
