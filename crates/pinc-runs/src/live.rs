//! A controller with its estimator, stepped by a plant that is somewhere else.

use super::chosen::{Chosen, ModelFile};
use super::first_plan::first_plan;
use super::guard::Guard;
use super::model_error::{self, SharedLog};
use super::{LoopSetup, feedback};
use crate::RunError;
use crate::clock::Deadline;
use pinc_config::{ControlSpec, Experiment, ModelKind, OutsidePolicy, Variables, sha256};
use pinc_estimate::{Augmentation, Estimator, EstimatorStatus, SteadyTarget};
use pinc_mpc::{BoundSchedule, Nmpc, Reference, Solution, SqpStatus, Trust};
use pinc_ode::{DynPlant, Memory};
use pinc_record::{ModelErrorMetrics, OutsideDomain, read_file};
use pinc_sensitivity::Sensitivity;
use std::borrow::Cow;
use std::time::Instant;

/// The controller of a config, with its estimator if it has one, for a plant that is somewhere
/// else: each step takes what was measured and gives the input to apply.
#[derive(Debug)]
pub struct LiveController {
    nmpc: Nmpc,
    /// The plan of the last step, where the controller has moved its own on to prepare the next.
    pub(super) made: Option<Solution>,
    spec: ControlSpec,
    variables: Variables,
    observer: Option<LiveEstimator>,
    guard: Option<Guard<'static>>,
    /// The estimated errors of the net, where they are asked for.
    error_log: Option<SharedLog>,
    error: Vec<f64>,
    /// The p of the controller's model, with an estimator its unknowns before those that are known,
    /// and the names.
    parameters: Vec<f64>,
    parameter_names: Vec<String>,
    /// How many are unknown.
    unknowns: usize,
    /// The places of those that are measured.
    measured_parameters: Vec<usize>,
    kind: ModelKind,
    /// The digest of the net's model file.
    model_sha256: Option<String>,
    /// What is followed if a step does not say it.
    reference: Reference,
    /// Bounds that change from the first step on.
    bounds: Option<BoundSchedule>,
    window: Vec<f64>,
    first_plan: Option<Vec<f64>>,
    /// The state that the controller took the plant to be in, and the input that it chose.
    x: Vec<f64>,
    u: Vec<f64>,
    /// The input applied before it.
    before: Vec<f64>,
    /// The input chosen last, and before it those under way: the first acts in the step begun last.
    inputs: Vec<f64>,
    done: usize,
}

/// The estimator of a live controller.
#[derive(Debug)]
struct LiveEstimator {
    estimator: Box<dyn Estimator>,
    target: Option<SteadyTarget>,
    augmentation: Augmentation,
    measured: Vec<String>,
    /// The covariance of the state and of these.
    covariance: Vec<f64>,
    status: EstimatorStatus,
}

/// The reference of a step of a [`LiveController`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Follow<'a> {
    /// The config's references, from the first step on.
    Config,
    /// A value per controlled quantity, held over the horizon.
    Held(&'a [f64]),
    /// A row per stage of the horizon, for the ends of the steps ahead (with a delay of d steps, d
    /// steps later). The config's references give a row the value at the beginning of the step that
    /// ends there: a row that ends exactly at a change has the value from before it.
    Stages(&'a [Vec<f64>]),
}

/// The result of a step of a [`LiveController`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct LiveStep<'a> {
    /// The input to apply, within its bounds whatever the status.
    pub u: &'a [f64],
    /// How the optimization ended.
    pub status: SqpStatus,
    /// The state that the controller took the plant to be in: what was measured, NaN where that is
    /// missing, or the estimate.
    pub x: &'a [f64],
    /// The estimated disturbances and parameters; empty without an estimator.
    pub unknowns: &'a [f64],
    /// How the estimator's correction ended, if there is an estimator.
    pub estimator: Option<EstimatorStatus>,
    /// How many quadratic programs were solved, and iterations of the barrier method taken.
    pub sqp_iterations: usize,
    /// The KKT residual that the optimization ended with.
    pub kkt: f64,
    /// The cost of the plan, with `control.cost`.
    pub cost: Option<f64>,
    /// Whether negative curvature was dropped, so that the plan is not proven to be a minimum.
    pub curvature_dropped: bool,
    /// From which of `sqp.starts` the plan was found, in a step that tried several; 0 is the start
    /// without others.
    pub start: Option<usize>,
    /// With `control.target`: whether a steady state was found for each row of the reference.
    pub target_found: Option<bool>,
    /// Whether the plan keeps the bounds that the controller's tube has tightened, if there is one.
    pub in_tube: Option<bool>,
    /// How long the step took, in us.
    pub step_us: f64,
    /// Whether the net was trusted in the plan's first step.
    pub trust: Trust,
    /// The estimated error of the net in that step, one per state in its unit; empty without
    /// `control.error_tolerance`.
    pub model_error: &'a [f64],
}

impl LiveController {
    /// The controller of `experiment` with the net of `model`, or `only` one of the config's
    /// models, or else the first of them. `command` is named in errors.
    ///
    /// # Errors
    ///
    /// [`RunError`] if the controller cannot be made.
    pub fn new(
        experiment: &Experiment,
        model: Option<ModelFile<'_>>,
        only: Option<ModelKind>,
        command: &'static str,
    ) -> Result<Self, RunError> {
        let chosen = Chosen::of(experiment, model, only, command)?;
        let (setup, spec) = (chosen.setup(), chosen.spec);
        let (nmpc, error_log) = setup.judged_controller(chosen.kind, &*chosen.plant)?;
        let net = chosen.net().cloned().map(Cow::Owned);
        let unknowns = setup.unknowns(&*chosen.plant);
        let guard = net.map(|net| Guard::new(net, spec.outside_domain, unknowns));
        let guard = guard.map(|guard| guard.of_member(chosen.member.clone()));
        let dims = nmpc.model().dims();
        let observer = LiveEstimator::of(&setup, chosen.kind, &*chosen.plant)?;
        let mut live = Self {
            unknowns: observer.as_ref().map_or(0, |of| dims.np - of.augmentation.known.len()),
            observer,
            guard,
            error: vec![0.0; error_log.as_ref().map_or(0, |_| dims.nx)],
            error_log,
            parameters: nmpc.parameters().to_vec(),
            measured_parameters: chosen.places_of_measured(),
            parameter_names: chosen.names_of_parameters(),
            kind: chosen.kind,
            model_sha256: match &spec.policy {
                Some(path) if chosen.kind == ModelKind::Policy => Some(sha256(read_file(path)?)),
                _ => chosen.given.as_ref().map(|(bytes, _)| sha256(bytes)),
            },
            reference: setup.reference()?,
            first_plan: first_plan(setup.spec, &Variables::of(setup.truth), setup.sample_time_s)?,
            bounds: setup.bounds()?,
            window: vec![0.0; spec.n2 * spec.controlled.len()],
            x: vec![0.0; dims.nx],
            u: vec![0.0; dims.nu],
            before: vec![0.0; dims.nu],
            inputs: vec![0.0; (spec.delay_steps + 1) * dims.nu],
            variables: Variables::of(&*chosen.plant),
            spec: spec.clone(),
            nmpc,
            made: None,
            done: 0,
        };
        live.reset()?;
        Ok(live)
    }

    /// Forgets everything: the next step is again the first.
    ///
    /// # Errors
    ///
    /// [`RunError`] if `control.initial_input` does not suit the controller.
    pub fn reset(&mut self) -> Result<(), RunError> {
        self.nmpc.reset();
        self.made = None;
        if let Some(observer) = &mut self.observer {
            observer.estimator.reset();
            observer.target.iter_mut().for_each(SteadyTarget::reset);
        }
        // The measured parameters are forgotten.
        self.parameters.copy_from_slice(&self.nmpc.problem().parameters);
        if !self.measured_parameters.is_empty() {
            self.nmpc.set_parameters(&self.parameters)?;
        }
        self.inputs.fill(0.0);
        self.u.fill(0.0);
        self.done = 0;
        if let Some(u) = &self.spec.initial_input {
            self.nmpc.reset_input(u)?;
            self.u.copy_from_slice(u);
            self.inputs.chunks_exact_mut(u.len()).for_each(|input| input.copy_from_slice(u));
            if let Some(observer) = &mut self.observer {
                observer.estimator.reset_input(u);
            }
        }
        if let Some(inputs) = &self.first_plan {
            self.nmpc.set_first_plan(inputs)?;
        }
        Ok(())
    }

    /// Saves what the next step starts from, or restores it.
    pub(super) fn remember(&mut self, memory: &mut Memory<'_>) {
        self.nmpc.remember(memory);
        self.parameters.copy_from_slice(self.nmpc.parameters());
        memory.numbers(&mut self.inputs);
        let last = self.inputs.len() - self.u.len();
        self.u.copy_from_slice(&self.inputs[last..]);
        memory.count(&mut self.done, usize::MAX);
        if let Some(observer) = &mut self.observer {
            observer.estimator.remember(memory);
            observer.target.iter_mut().for_each(|target| target.remember(memory));
        }
    }

    /// The controller with its model.
    #[must_use]
    pub fn nmpc(&self) -> &Nmpc {
        &self.nmpc
    }

    /// The plan of the last step.
    #[must_use]
    pub fn plan(&self) -> &Solution {
        self.made.as_ref().unwrap_or_else(|| self.nmpc.plan())
    }

    /// Differentiates the plan of the last step, as [`Sensitivity::new`].
    ///
    /// # Errors
    ///
    /// [`RunError`] if `smoothing` is not positive, inputs are whole numbers, the next step has been
    /// prepared, or the config has `control.target`: how the target moves is not differentiated.
    pub fn sensitivity(&mut self, smoothing: Option<f64>) -> Result<Sensitivity<'_>, RunError> {
        if self.made.is_some() {
            let problem = "a controller that has prepared its next step, as with control.sqp.real_time, \
                           cannot differentiate the last; use a batch";
            return Err(RunError::usage("the plan", problem));
        }
        if self.spec.target {
            let problem =
                "true given, expected false for derivatives: how the target moves is left out";
            return Err(RunError::usage("`control.target`", problem));
        }
        Ok(Sensitivity::new(&mut self.nmpc, &self.window, &self.before, smoothing)?)
    }

    /// The section of the config.
    #[must_use]
    pub fn spec(&self) -> &ControlSpec {
        &self.spec
    }

    /// Which of the config's models it works with.
    #[must_use]
    pub fn kind(&self) -> ModelKind {
        self.kind
    }

    /// The SHA-256 of the model file, or of a policy's, in hexadecimal digits, where the model is a net.
    #[must_use]
    pub fn model_sha256(&self) -> Option<&str> {
        self.model_sha256.as_deref()
    }

    /// The plant's variables.
    #[must_use]
    pub fn variables(&self) -> &Variables {
        &self.variables
    }

    /// The names of what is measured: with an estimator what that is told, or else all states.
    #[must_use]
    pub fn measured(&self) -> Vec<String> {
        let of_estimator = self.observer.as_ref().map(|observer| observer.measured.clone());
        of_estimator.unwrap_or_else(|| self.variables.state_names())
    }

    /// The names of the disturbances and parameters that are estimated.
    #[must_use]
    pub fn unknowns(&self) -> &[String] {
        &self.parameter_names[..self.unknowns]
    }

    /// The names of the model's parameters p; with an estimator those of its unknowns, then those that
    /// it is told.
    #[must_use]
    pub fn parameter_names(&self) -> &[String] {
        &self.parameter_names
    }

    /// The most numbers that a step takes, measurements, a reference per stage, an input, and
    /// parameters, and those of a state.
    pub fn request_numbers(&mut self) -> usize {
        let of_step = self.measured().len() + self.window.len() + self.u.len();
        of_step + self.measured_parameters.len() + self.state().numbers.len()
    }

    /// How often the estimated error of the net was beyond its tolerance; none without
    /// `control.error_tolerance`.
    #[must_use]
    pub fn model_error(&self) -> Option<ModelErrorMetrics> {
        let states = self.variables.state_names();
        self.error_log.as_ref().map(|log| model_error::read(log, |log| log.metrics(&states)))
    }

    /// How often the net was used outside its training domain.
    #[must_use]
    pub fn outside_domain(&self) -> OutsideDomain {
        self.guard.as_ref().map_or_else(OutsideDomain::default, |guard| guard.seen().clone())
    }

    /// Takes the values of `control.measured_parameters`, in that order, for what the parameters
    /// are from now on, and returns those before.
    ///
    /// # Errors
    ///
    /// [`RunError::Usage`] if there is not one finite value for each: nothing has happened then.
    pub fn set_measured_parameters(&mut self, values: &[f64]) -> Result<Vec<f64>, RunError> {
        length("parameters", values, self.measured_parameters.len(), "measured parameter")?;
        finite("parameters", values)?;
        let places = self.measured_parameters.iter();
        let before = places.clone().map(|&place| self.parameters[place]).collect();
        for (&place, &value) in places.zip(values) {
            self.parameters[place] = value;
        }
        self.nmpc.set_parameters(&self.parameters)?;
        Ok(before)
    }

    /// Chooses the input for a plant of which `y` was measured: with an estimator the measured
    /// quantities; without one all states. What is missing is NaN; without an estimator the last
    /// input is then held, with the status [`SqpStatus::BadArgument`]. `u_applied` is the input that
    /// the plant was really given since the last step, if that was not the one chosen.
    ///
    /// # Errors
    ///
    /// [`RunError::Usage`] if an argument is of a wrong length, a reference is not finite, or
    /// `u_applied` is not finite or beyond the input's bounds: nothing has happened then.
    /// [`RunError::Failed`] if the step takes a net out of its domain and
    /// the config refuses that.
    pub fn step(
        &mut self,
        y: &[f64],
        follow: Follow<'_>,
        u_applied: Option<&[f64]>,
    ) -> Result<LiveStep<'_>, RunError> {
        self.step_within(y, follow, u_applied, self.spec.budget_us)
    }

    /// [`LiveController::step`] with a time budget of `budget_us` in place of the config's.
    ///
    /// # Errors
    ///
    /// As [`LiveController::step`].
    pub fn step_within(
        &mut self,
        y: &[f64],
        follow: Follow<'_>,
        u_applied: Option<&[f64]>,
        budget_us: Option<f64>,
    ) -> Result<LiveStep<'_>, RunError> {
        self.check(y, follow, u_applied)?;
        if let Some(us) = budget_us.filter(|us| !(*us > 0.0 && us.is_finite())) {
            return Err(argument("budget_us", us, "a positive time in us"));
        }
        let mut before = Vec::new();
        if self.spec.outside_domain == OutsidePolicy::Refuse && self.guard.is_some() {
            self.remember(&mut Memory::save(&mut before));
        }
        self.made = None;
        self.write_window(follow);
        let clock = Instant::now();
        let deadline = budget_us.map(|us| Deadline::in_seconds(1e-6 * us));
        self.observe(y, u_applied);
        let mut target_found = None;
        if let Some(observer) = &mut self.observer {
            self.nmpc.set_parameters(&self.parameters)?;
            if self.nmpc.has_tube() {
                let LiveEstimator { estimator, augmentation, covariance, .. } = &mut *observer;
                augmentation.read_covariance(estimator.covariance(), self.x.len(), covariance);
                self.nmpc.set_covariance(covariance);
            }
            target_found =
                observer.target.as_mut().map(|of| of.aim(&self.parameters, &mut self.window));
        }
        self.before.copy_from_slice(u_applied.unwrap_or(&self.u));
        if let Some(u) = u_applied {
            self.nmpc.set_applied_input(u)?;
        }
        if let Some(bounds) = &self.bounds {
            self.nmpc.set_bounds_at(bounds, self.done, self.spec.preview);
        }
        let mut expired = || deadline.is_some_and(Deadline::is_over);
        let step = self.nmpc.step_within(&self.x, &self.window, &mut expired)?;
        let (status, sqp_iterations, kkt) = (step.status, step.sqp_iterations, step.kkt.max());
        let (trust, curvature_dropped, start) = (step.trust, step.curvature_dropped, step.start);
        let cost = self.spec.cost.as_ref().map(|_| step.cost);
        self.u.copy_from_slice(step.u);
        let step_us = 1e6 * clock.elapsed().as_secs_f64();
        let chosen = self.inputs.len() - self.u.len();
        self.inputs[chosen..].copy_from_slice(&self.u);
        self.done += 1;
        if let Some(log) = &self.error_log {
            model_error::read(log, |log| self.error.copy_from_slice(log.last()));
        }
        if let Some(guard) = &mut self.guard
            && status != SqpStatus::BadArgument
        {
            let plan = if status.is_solved() { self.nmpc.plan().states() } else { &[] };
            let looked = guard.look_along(plan, &self.x, &self.u, self.nmpc.parameters());
            if looked.is_err() {
                self.remember(&mut Memory::restore(&before));
            }
            looked?;
        }
        let observer = self.observer.as_ref();
        Ok(LiveStep {
            target_found,
            in_tube: self.nmpc.tightened().map(|of| of.fits),
            u: &self.u,
            status,
            x: &self.x,
            unknowns: &self.parameters[..self.unknowns],
            estimator: observer.map(|observer| observer.status),
            sqp_iterations,
            kkt,
            cost,
            curvature_dropped,
            start,
            step_us,
            trust,
            model_error: &self.error,
        })
    }

    /// Does what can be done of the next step before its measurement is there.
    pub fn prepare(&mut self) {
        if self.nmpc.config().real_time && self.made.is_none() {
            self.made = Some(self.nmpc.plan().clone());
        }
        self.nmpc.prepare();
    }

    /// Makes the state of what was measured.
    fn observe(&mut self, y: &[f64], u_applied: Option<&[f64]>) {
        let m = self.u.len();
        let last = self.inputs.len() - m;
        if let Some(u) = u_applied {
            self.inputs[last..].copy_from_slice(u);
        }
        let Some(observer) = &mut self.observer else {
            self.x.copy_from_slice(y);
            return;
        };
        if self.done > 0 {
            // The estimator goes on by the input that acted since, which is known only now.
            observer.estimator.predict(&self.inputs[..m]);
            self.inputs.copy_within(m.., 0);
        }
        observer.estimator.set_parameters(&self.parameters[self.unknowns..]);
        observer.status = observer.estimator.correct(y).status;
        let z = observer.estimator.estimate();
        observer.augmentation.read(z, &mut self.x, &mut self.parameters);
    }

    /// Checks the arguments, so that a step that is refused has changed nothing.
    fn check(
        &self,
        y: &[f64],
        follow: Follow<'_>,
        u_applied: Option<&[f64]>,
    ) -> Result<(), RunError> {
        let outputs = self.spec.controlled.len();
        match &self.observer {
            Some(observer) => length("y", y, observer.measured.len(), "measured quantity")?,
            None => length("y", y, self.x.len(), "state")?,
        }
        if let Some(u) = u_applied {
            length("u_applied", u, self.u.len(), "input")?;
            self.nmpc.check_applied_input(u)?;
        }
        match follow {
            Follow::Config => {}
            Follow::Held(row) => {
                length("reference", row, outputs, "controlled quantity")?;
                finite("reference", row)?;
            }
            Follow::Stages(rows) => {
                if rows.len() != self.spec.n2 {
                    let expected = format!("{}, one per step of the horizon", self.spec.n2);
                    return Err(argument("reference", format!("{} rows", rows.len()), &expected));
                }
                for row in rows {
                    length("a row of reference", row, outputs, "controlled quantity")?;
                    finite("a row of reference", row)?;
                }
            }
        }
        Ok(())
    }

    /// Writes what is followed by the input of this step.
    fn write_window(&mut self, follow: Follow<'_>) {
        let width = self.spec.controlled.len();
        let mut stages = self.window.chunks_exact_mut(width.max(1));
        match follow {
            Follow::Held(row) => stages.for_each(|to| to.copy_from_slice(row)),
            Follow::Stages(rows) => {
                stages.zip(rows).for_each(|(to, row)| to.copy_from_slice(row));
            }
            Follow::Config if self.spec.preview => {
                let first = self.done + self.spec.delay_steps;
                let ends = &self.nmpc.stage_times_s()[1..];
                self.reference.preview_at(first, ends, &mut self.window);
            }
            Follow::Config => {
                let now = self.reference.at(self.done);
                stages.by_ref().for_each(|to| to.copy_from_slice(now));
            }
        }
    }
}

impl LiveEstimator {
    /// The estimator of the config, if it has one.
    fn of(
        setup: &LoopSetup<'_>,
        kind: ModelKind,
        plant: &dyn DynPlant,
    ) -> Result<Option<Self>, RunError> {
        let Some((spec, measurement)) = setup.sections() else { return Ok(None) };
        let augmentation = setup.augmentation(spec, &measurement, plant);
        let model = setup.model(kind, plant)?;
        Ok(Some(Self {
            estimator: feedback::estimator(
                (setup.spec, spec),
                &augmentation,
                model,
                setup.spec.initial_input.as_deref(),
            )?,
            target: setup.target(kind, plant)?,
            augmentation,
            measured: measurement.names(&Variables::of(plant)),
            covariance: Vec::new(),
            status: EstimatorStatus::NothingMeasured,
        }))
    }
}

fn length(what: &'static str, found: &[f64], expected: usize, each: &str) -> Result<(), RunError> {
    if found.len() == expected {
        return Ok(());
    }
    let expected = format!("{expected}, one per {each}");
    Err(argument(what, format!("{} numbers", found.len()), &expected))
}

fn argument(what: &str, found: impl std::fmt::Display, expected: &str) -> RunError {
    RunError::usage(what, format!("{found} given, expected {expected}"))
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), RunError> {
    match values.iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(value) => Err(argument(what, value, "finite numbers")),
    }
}
