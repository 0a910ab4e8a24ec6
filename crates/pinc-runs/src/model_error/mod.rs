//! The error of the net in a loop: its estimate in each control step, and what came of it.

use crate::RunError;
use pinc_config::{ControlSpec, OnError};
use pinc_estimate::{Augmentation, Disturbance, InnerArguments, Measured};
use pinc_mpc::Judge;
use pinc_net::PincNet;
use pinc_ode::DynPlant;
use pinc_record::ModelErrorMetrics;
use pinc_tube::StageError;
use pinc_verify::ErrorEstimate;
use std::sync::{Arc, Mutex, PoisonError};

/// What a judge has seen, for those who report it.
pub(crate) type SharedLog = Arc<Mutex<ErrorLog>>;

/// The estimated errors of the net in the first steps of plans.
#[derive(Debug, Default)]
pub(crate) struct ErrorLog {
    /// The tolerance of each state; infinite where there is none.
    tolerance: Vec<f64>,
    steps: usize,
    beyond: usize,
    /// The largest absolute error of each state.
    largest: Vec<f64>,
    /// The errors in the step judged last.
    last: Vec<f64>,
}

impl ErrorLog {
    /// Adds the step whose errors are in `last`; whether all are within their tolerances.
    fn add(&mut self) -> bool {
        self.steps += 1;
        let mut within = true;
        for ((error, most), tolerance) in
            self.last.iter().zip(&mut self.largest).zip(&self.tolerance)
        {
            // What is no number is beyond any tolerance.
            let size = if error.is_nan() { f64::INFINITY } else { error.abs() };
            *most = most.max(size);
            within &= size <= *tolerance;
        }
        self.beyond += usize::from(!within);
        within
    }

    /// The totals, with the names of the states.
    pub(crate) fn metrics(&self, states: &[String]) -> ModelErrorMetrics {
        let judged = |values: &[f64]| {
            let named = states.iter().zip(values).zip(&self.tolerance);
            let judged = named.filter(|(_, tolerance)| tolerance.is_finite());
            judged.map(|((name, value), _)| (name.clone(), *value)).collect()
        };
        ModelErrorMetrics {
            steps: self.steps,
            beyond: self.beyond,
            largest: judged(&self.largest),
            tolerance: judged(&self.tolerance),
        }
    }

    /// The errors in the step judged last, one per state.
    pub(crate) fn last(&self) -> &[f64] {
        &self.last
    }
}

/// What the log says, whatever became of a thread that wrote to it.
pub(crate) fn read<R>(log: &SharedLog, f: impl FnOnce(&ErrorLog) -> R) -> R {
    f(&log.lock().unwrap_or_else(PoisonError::into_inner))
}

/// The estimated error of the net in a controller.
#[derive(Debug)]
pub(crate) struct NetError {
    estimate: ErrorEstimate,
    arguments: InnerArguments,
}

impl NetError {
    pub(crate) fn new(
        net: &PincNet,
        plant: &dyn DynPlant,
        augmentation: Option<&Augmentation>,
    ) -> Result<Self, RunError> {
        let arguments = InnerArguments::new(plant.dims(), augmentation.cloned());
        Ok(Self { estimate: ErrorEstimate::new(net, plant)?, arguments })
    }
}

impl StageError for NetError {
    fn write(&mut self, x: &[f64], u: &[f64], p: &[f64], error: &mut [f64]) {
        let [x, u, p] = self.arguments.of(x, u, p);
        self.estimate.write(x, u, p, error);
    }
}

/// Trusts the net where its estimated error is within the tolerances of `control.error_tolerance`.
#[derive(Debug)]
pub(crate) struct ErrorJudge {
    estimate: NetError,
    error: Vec<f64>,
    corrects: bool,
    log: SharedLog,
}

impl ErrorJudge {
    pub(crate) fn new(
        spec: &ControlSpec,
        net: &PincNet,
        plant: &dyn DynPlant,
        augmentation: Option<&Augmentation>,
    ) -> Result<(Self, SharedLog), RunError> {
        let zeros = vec![0.0; plant.states().len()];
        let log = Arc::new(Mutex::new(ErrorLog {
            tolerance: tolerances(spec, plant),
            largest: zeros.clone(),
            last: zeros.clone(),
            ..ErrorLog::default()
        }));
        let judge = Self {
            estimate: NetError::new(net, plant, augmentation)?,
            error: zeros,
            corrects: spec.on_error == OnError::Correct,
            log: Arc::clone(&log),
        };
        Ok((judge, log))
    }
}

impl Judge for ErrorJudge {
    fn trusts(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> bool {
        self.estimate.write(x, u, p, &mut self.error);
        let mut log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        log.last.copy_from_slice(&self.error);
        log.add()
    }

    fn substitute_parameters(&self, p: &[f64], substitute: &mut [f64]) {
        let (corrections, rest) = substitute.split_at_mut(substitute.len() - p.len());
        rest.copy_from_slice(p);
        if self.corrects {
            for (to, error) in corrections.iter_mut().zip(&self.error) {
                // Where the estimate is no number nothing can be corrected.
                *to = if error.is_finite() { -error } else { 0.0 };
            }
        }
    }
}

/// The tolerance of each state; infinite where there is none.
pub(crate) fn tolerances(spec: &ControlSpec, plant: &dyn DynPlant) -> Vec<f64> {
    let named = |name: &str| spec.error_tolerance.get(name).copied();
    plant.states().iter().map(|state| named(&state.name).unwrap_or(f64::INFINITY)).collect()
}

/// A model of `states` states with a correction of each as its first parameters, before its own.
pub(crate) fn correction(states: usize, parameters: &[f64]) -> Augmentation {
    Augmentation {
        measured: (0..states).map(Measured::State).collect(),
        disturbance: Disturbance::States((0..states).collect()),
        parameters: parameters.to_vec(),
        estimated: (0..parameters.len()).collect(),
        known: Vec::new(),
    }
}

#[cfg(test)]
mod tests;
