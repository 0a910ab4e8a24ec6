//! The stages of the horizon where they differ in length: `control.stages_s`.

use crate::ControlSpec;
use pinc_mpc::{Weight, Weights};
use pinc_ode::Integrator;

impl ControlSpec {
    /// The lengths of the horizon's stages in s, and how many in a row are so long, for control
    /// steps of `sample_time_s`.
    #[must_use]
    pub fn stages(&self, sample_time_s: f64) -> Vec<(f64, usize)> {
        let Some(lengths) = &self.stages_s else { return vec![(sample_time_s, self.n2)] };
        let mut stages: Vec<(f64, usize)> = Vec::new();
        for &length in lengths {
            match stages.last_mut() {
                Some((last, count)) if last.total_cmp(&length).is_eq() => *count += 1,
                _ => stages.push((length, 1)),
            }
        }
        stages
    }

    /// How far the controller looks ahead, in s, for control steps of `sample_time_s`.
    #[must_use]
    pub fn horizon_s(&self, sample_time_s: f64) -> f64 {
        let length = |(length, count): (f64, usize)| length * count as f64;
        self.stages(sample_time_s).into_iter().map(length).sum()
    }

    /// The substeps of an integrator in a control step.
    #[must_use]
    pub fn own_substeps(&self, integrator: Integrator) -> usize {
        match integrator {
            Integrator::Rk4 => self.rk4_substeps,
            Integrator::Rk5 => self.rk5_substeps,
            Integrator::Rosenbrock => self.rosenbrock_substeps,
        }
    }

    /// The integrator that makes steps in place of a net: the first of `models`, or RK4.
    #[must_use]
    pub fn substitute(&self) -> Integrator {
        self.models.iter().find_map(|kind| kind.integrator()).unwrap_or(Integrator::Rk4)
    }

    /// The key of these in `[control]`.
    #[must_use]
    pub fn substeps_key(integrator: Integrator) -> String {
        format!("{integrator}_substeps")
    }

    /// The substeps of an integrator in a stage of `length_s`: the number in a control step of
    /// `sample_time_s`, times the ratio of lengths, rounded up, so that substeps are no longer than
    /// in a control step.
    #[must_use]
    pub fn substeps(&self, integrator: Integrator, length_s: f64, sample_time_s: f64) -> usize {
        let per_step = self.own_substeps(integrator);
        let needed = per_step as f64 * length_s / sample_time_s;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a positive number, of which the config was checked to be small"
        )]
        // Lengths that are multiples up to rounding are multiples.
        let substeps = (needed * (1.0 - 1e-12)).ceil() as usize;
        substeps.max(1)
    }

    /// Sets the substeps of an integrator in a control step.
    pub fn set_substeps(&mut self, integrator: Integrator, substeps: usize) {
        match integrator {
            Integrator::Rk4 => self.rk4_substeps = substeps,
            Integrator::Rk5 => self.rk5_substeps = substeps,
            Integrator::Rosenbrock => self.rosenbrock_substeps = substeps,
        }
    }

    /// The weights of stages of different length, if they are: a stage counts in Q as many times as
    /// it is longer than the first, as its steps would.
    pub(crate) fn weights_by_length(&self, r: &Weight) -> Option<Weights> {
        let lengths = self.stages_s.as_ref()?;
        let w: Vec<f64> = lengths.iter().map(|length| length / lengths[0]).collect();
        let v = vec![1.0; self.nu.min(self.n2)];
        Some(Weights::scaled(self.q.clone(), r.clone(), &w, &v))
    }
}
