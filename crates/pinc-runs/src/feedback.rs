//! Output feedback in the closed loop: sensors, an estimator, and a controller that uses it.

use super::control::LoopSetup;
use crate::RunError;
use pinc_config::{
    ControlSpec, EstimatorKind, EstimatorSpec, MeasurementSpec, ModelKind, Variables,
};
use pinc_estimate::{
    Augmentation, Augmented, Correction, Ekf, Estimator, EstimatorStatus, History, Mhe,
    OutputFeedback, SteadyTarget, Tuning, Ukf,
};
use pinc_loop::{Observer, PlantNow};
use pinc_ode::{DynPlant, Model};
use pinc_record::{EstimateRow, EstimateTable, EstimatorMetrics, StepTimes};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Which stream of random numbers the noise is drawn from.
const NOISE: u64 = 0x006e_6f69_7365;

/// Sensors and estimator, with an eye on the clock.
#[derive(Debug)]
pub(super) struct TimedFeedback {
    feedback: OutputFeedback,
    pub(super) target: Option<SteadyTarget>,
    /// How long each correction and prediction took, in us.
    correct_us: Vec<f64>,
    predict_us: Vec<f64>,
    /// The time of the last correction.
    last: Rc<Cell<Duration>>,
}

impl Observer for TimedFeedback {
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], parameters: &mut [f64]) {
        let clock = Instant::now();
        self.feedback.observe(plant, x, parameters);
        self.last.set(clock.elapsed());
        self.correct_us.push(1e6 * self.last.get().as_secs_f64());
    }

    fn covariance(&mut self) -> Option<&[f64]> {
        self.feedback.covariance()
    }

    fn aim(&mut self, parameters: &[f64], reference: &mut [f64]) {
        if let Some(target) = &mut self.target {
            target.aim(parameters, reference);
        }
    }

    fn advance(&mut self, u: &[f64]) {
        let clock = Instant::now();
        self.feedback.advance(u);
        self.predict_us.push(1e6 * clock.elapsed().as_secs_f64());
    }
}

impl TimedFeedback {
    /// Says how long the last correction took.
    pub(super) fn clock(&self) -> Rc<Cell<Duration>> {
        Rc::clone(&self.last)
    }

    /// What the estimator did.
    pub(super) fn history(&self) -> &History {
        self.feedback.history()
    }

    /// The nearest values that can be held, of what is controlled and cannot be at its last reference.
    pub(super) fn nearest_held(&self, control: &ControlSpec) -> BTreeMap<String, f64> {
        let Some(target) = &self.target else { return BTreeMap::new() };
        let [asked, held] = target.last();
        let missed = |&i: &usize| {
            let sizes = control.references.iter().map(|reference| reference.value[i].abs());
            let size = Some(sizes.fold(asked[i].abs(), f64::max)).filter(|size| *size > 0.0);
            (asked[i] - held[i]).abs() > 1e-6 * size.unwrap_or(1.0)
        };
        let all = (0..asked.len()).filter(missed);
        all.map(|i| (control.controlled[i].clone(), held[i])).collect()
    }

    /// For each step, the time of its correction and prediction together.
    pub(super) fn step_us(&self) -> Vec<f64> {
        let pairs = self.correct_us.iter().zip(&self.predict_us);
        pairs.map(|(correct, predict)| correct + predict).collect()
    }
}

/// An estimator of `spec` in the loop of `control`, with the model `model`, at a plant that has been
/// given `initial_input` so far, or 0.
pub(super) fn estimator(
    (control, spec): (&ControlSpec, &EstimatorSpec),
    augmentation: &Augmentation,
    model: Box<dyn Model>,
    initial_input: Option<&[f64]>,
) -> Result<Box<dyn Estimator>, RunError> {
    let model = Box::new(Augmented::new(model, augmentation.clone())?);
    let tuning = Tuning { parameters: augmentation.known_values(), ..spec.tuning(control) };
    let mut estimator: Box<dyn Estimator> = match spec.kind {
        EstimatorKind::Ukf => Box::new(Ukf::new(model, tuning)?),
        EstimatorKind::Mhe => Box::new(Mhe::new(model, tuning, spec.window.unwrap_or(1))?),
        _ => Box::new(Ekf::new(model, tuning)?),
    };
    if let Some(u) = initial_input {
        estimator.reset_input(u);
    }
    Ok(estimator)
}

impl LoopSetup<'_> {
    /// The estimator's section, with what is measured.
    pub(super) fn sections(&self) -> Option<(&EstimatorSpec, MeasurementSpec)> {
        let estimator = self.spec.estimator.as_ref()?;
        Some((estimator, self.spec.measurement.clone().unwrap_or_default()))
    }

    /// What is measured and estimated beside the state.
    pub(super) fn augmentation(
        &self,
        spec: &EstimatorSpec,
        measurement: &MeasurementSpec,
        plant: &dyn DynPlant,
    ) -> Augmentation {
        let parameters = (self.parameters, self.estimated, self.known);
        spec.augmentation(measurement, &Variables::of(plant), parameters)
    }

    /// The parameters of a controller's model with this augmentation, before anything is measured.
    pub(super) fn told_by(&self, spec: &EstimatorSpec, augmentation: &Augmentation) -> Vec<f64> {
        let states = spec.process_sd.len();
        let mut parameters = spec.tuning(self.spec).initial_estimate.split_off(states);
        parameters.extend(augmentation.known_values());
        parameters
    }

    /// Sensors and estimator for one run, if there are any.
    pub(super) fn feedback(
        &self,
        kind: ModelKind,
        plant: &dyn DynPlant,
    ) -> Result<Option<TimedFeedback>, RunError> {
        let Some((spec, measurement)) = self.sections() else { return Ok(None) };
        let augmentation = self.augmentation(spec, &measurement, plant);
        let model = self.model(kind, plant)?;
        let initial_input = self.spec.initial_input.as_deref();
        let estimator = estimator((self.spec, spec), &augmentation, model, initial_input)?;
        let steps = pinc_config::steps(self.spec.duration_s, self.sample_time_s);
        let noise = self.noise(&measurement, steps);
        let feedback = OutputFeedback::new(estimator, augmentation, noise);
        Ok(Some(TimedFeedback {
            feedback,
            target: self.target(kind, plant)?,
            correct_us: Vec::new(),
            predict_us: Vec::new(),
            last: Rc::default(),
        }))
    }

    /// The noise of all measurements, row by row: the same for all models.
    fn noise(&self, measurement: &MeasurementSpec, steps: usize) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(NOISE);
        let sd = measurement.noise_sd.iter().flatten();
        let row = std::iter::repeat_n(sd, steps).flatten();
        row.map(|sd| {
            let normal: f64 = StandardNormal.sample(&mut rng);
            sd * normal
        })
        .collect()
    }

    /// The estimates of a loop as a table.
    pub(super) fn estimates(&self, history: &History) -> EstimateTable {
        let variables = Variables::of(self.truth);
        let (spec, measurement) = self.sections().expect("a history is of an estimator");
        let names = spec.names(&measurement, &variables);
        let measured = measurement.names(&variables);
        let t = |k: usize| k as f64 * self.sample_time_s;
        table(history, (names, measured), t)
    }
}

/// What an estimator did as a table, of what is estimated and measured, at these times of steps.
pub(super) fn table(
    history: &History,
    (names, measured): (Vec<String>, Vec<String>),
    t: impl Fn(usize) -> f64,
) -> EstimateTable {
    let (nz, ny) = (names.len(), measured.len());
    let row = |(k, correction): (usize, &Correction)| EstimateRow {
        t: t(k),
        estimate: history.estimates[k * nz..(k + 1) * nz].to_vec(),
        sd: history.sd[k * nz..(k + 1) * nz].to_vec(),
        measured: history.measured[k * ny..(k + 1) * ny].to_vec(),
        innovation: history.innovations[k * ny..(k + 1) * ny].to_vec(),
        nis: correction.nis,
        nees: history.nees.get(k).copied().unwrap_or(f64::NAN),
        rejected: correction.rejected,
    };
    let rows = history.corrections.iter().enumerate().map(row).collect();
    EstimateTable { names, measured, rows }
}

/// The numbers of a finished estimator, with the times of all of its steps.
pub(super) fn metrics(
    history: &History,
    (states, measured): (&[String], &[String]),
    times_us: Vec<f64>,
) -> EstimatorMetrics {
    let real = |count: usize| count as f64;
    let judged: Vec<_> = history.corrections.iter().filter(|c| !c.nis.is_nan()).collect();
    let nis_steps = judged.len();
    let without = history.corrections.iter().filter(|c| c.measured > 0 && c.nis.is_nan());
    let errors = || history.nees.iter().filter(|nees| !nees.is_nan());
    let nees_steps = errors().count();
    let rmse = states.iter().cloned().zip(&history.squared_errors);
    let steps = real(history.corrections.len());
    let mut status: BTreeMap<String, usize> = BTreeMap::new();
    let predictions = history.predictions.iter().filter(|s| **s != EstimatorStatus::Updated);
    for ended in history.corrections.iter().map(|c| &c.status).chain(predictions) {
        *status.entry(ended.to_string()).or_default() += 1;
    }
    EstimatorMetrics {
        nis_mean: judged.iter().map(|c| c.nis).sum::<f64>() / real(nis_steps),
        nis_expected: real(judged.iter().map(|c| c.measured).sum()) / real(nis_steps),
        nis_steps,
        nis_undefined: without.filter(|c| c.status != EstimatorStatus::NotFinite).count(),
        nees_mean: errors().sum::<f64>() / real(nees_steps),
        nees_steps,
        rejected: rejected(history, measured),
        estimate_rmse: rmse.map(|(name, sum)| (name, (sum / steps).sqrt())).collect(),
        nearest_held: BTreeMap::new(),
        targets_not_found: None,
        estimator_us: StepTimes::of(times_us),
        estimator_status: status,
    }
}

/// How many measurements of each quantity were rejected, where any were: they are there, but have no
/// innovation.
fn rejected(history: &History, measured: &[String]) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    let width = measured.len();
    let rows = history.measured.chunks_exact(width).zip(history.innovations.chunks_exact(width));
    for ((y, innovation), _) in rows.zip(&history.corrections).filter(|(_, c)| c.rejected > 0) {
        for ((name, y), innovation) in measured.iter().zip(y).zip(innovation) {
            if y.is_finite() && innovation.is_nan() {
                *counts.entry(name.clone()).or_default() += 1;
            }
        }
    }
    counts
}
