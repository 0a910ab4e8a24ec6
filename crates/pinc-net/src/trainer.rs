//! Training: Algorithm 1 of the paper, with a sample that can grow.

use crate::error::{check, check_length, check_positive};
use crate::kernel::UnknownParameter;
use crate::labels::Labels;
use crate::loss::LossTerms;
use crate::optim::{Iterate, LeastSquares, Objective, Optimizer, Outcome};
use crate::sampling::{Points, Purpose, Sampler, initial_conditions};
use crate::{
    Ansatz, BatchLoss, IterationRecord, Measurements, NetError, PincNet, Progress, SelectNet,
    StopReason, Totals, Training, TrainingConfig, TrainingTarget, Validation, ValidationSet,
    Workers,
};
use pinc_ode::DynRhs;
use serde::{Deserialize, Serialize};

/// The complete state of a training. A training resumed from it gives the same bits as one that
/// was never interrupted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    phase: usize,
    phase_iterations: u64,
    totals: Totals,
    collocation_points: usize,
    /// Points of the sample beside those that are drawn.
    extra: Points,
    iterate: Iterate,
    terms: LossTerms,
    optimizer: Optimizer,
    best: Option<(f64, Vec<f64>)>,
    validated_at: Option<u64>,
    finished: Option<StopReason>,
}

impl Checkpoint {
    /// Work done so far.
    #[must_use]
    pub fn totals(&self) -> Totals {
        self.totals
    }
}

/// A training in progress.
///
/// It neither prints nor reads a clock: the caller steps it, validates when a validation is due,
/// and takes checkpoints; or [`Trainer::run`] does the first two.
#[derive(Debug)]
pub struct Trainer {
    net: PincNet,
    config: TrainingConfig,
    validation: ValidationSet,
    seed: u64,
    workers: Workers,
    loss: BatchLoss,
    fresh: Option<BatchLoss>,
    /// The targets of a distilled net at the points of the sample.
    labels: Option<Labels>,
    /// Parameters of the plant that are trained with the net.
    unknown: Vec<UnknownParameter>,
    state: Checkpoint,
}

/// The loss, with a count of evaluations and the terms of the last one.
struct Counted<'a> {
    loss: &'a mut BatchLoss,
    evaluations: &'a mut u64,
    terms: &'a mut LossTerms,
}

impl Objective for Counted<'_> {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let terms = self.loss.loss_gradient(x, gradient);
        *self.evaluations += 1;
        *self.terms = terms;
        terms.total()
    }
}

impl LeastSquares for Counted<'_> {
    fn normal_matrix(&mut self, x: &[f64], out: &mut [f64]) {
        self.loss.normal_matrix(x, out);
    }
}

impl Trainer {
    /// Iterations of [`Trainer::refine`], at most.
    pub const REFINEMENT: u64 = 1000;

    /// Begins the `training` of a fresh net. `validation` is usually [`Training::validation_set`],
    /// with held-out measurements or without.
    ///
    /// # Errors
    ///
    /// [`NetError`] if a setting makes no sense, the plant has no finite velocity in the domain, or
    /// the threads cannot be started.
    pub fn new(
        plant: &dyn DynRhs,
        training: &Training,
        validation: ValidationSet,
    ) -> Result<Self, NetError> {
        let Training { config, seed, .. } = training;
        config.validate()?;
        let (source, seed) = (config.source, *seed);
        let net = PincNet::new(plant, &training.net, &training.domain, seed)?;
        let net = PincNet { source, ..net };
        let weights = config.weights(&net)?;
        let workers = Workers::new(training.threads)?;
        let loss = BatchLoss::new(plant, &net, &weights, &workers);
        let labels_for =
            |purpose| Labels::for_net(plant, &net, config.derivatives.is_some(), (seed, purpose));
        let mut fresh = None;
        if let Some(growth) = &config.growth {
            let fresh = fresh.insert(BatchLoss::new(plant, &net, &weights, &workers));
            let points = fresh_points(&net, growth.fresh_points, seed);
            match &mut labels_for(Purpose::FreshDirections)? {
                None => fresh.set_points(&points, &Points::default()),
                Some(labels) => fresh.set_measurements(labels.of(&points, &workers)?, 1.0),
            }
        }
        let labels = labels_for(Purpose::Directions)?;
        let parameters = net.mlp().parameters().to_vec();
        let state = Checkpoint {
            phase: 0,
            phase_iterations: 0,
            totals: Totals::default(),
            collocation_points: config.collocation_points,
            extra: Points::new(net.dims()),
            iterate: Iterate { gradient: vec![0.0; parameters.len()], x: parameters, value: 0.0 },
            terms: LossTerms::default(),
            optimizer: Optimizer::new(&config.phases[0].optimizer, net.mlp().parameters().len()),
            best: None,
            validated_at: None,
            finished: None,
        };
        let mut trainer = Self {
            net,
            config: config.clone(),
            validation,
            seed,
            workers,
            loss,
            fresh,
            labels,
            unknown: Vec::new(),
            state,
        };
        trainer.sample()?;
        trainer.reevaluate();
        Ok(trainer)
    }

    /// Trains the parameters of `family` with the net, before measurements are added, to which they
    /// are fitted: an inverse problem. They start at `start`, one for each, and the net takes none
    /// of them. Since the plant is not known, nets are not validated, and the last one is kept.
    ///
    /// # Errors
    ///
    /// [`NetError`] if a length does not fit, a start is not finite, the net takes parameters or is
    /// trained on an integrator instead of the equation.
    pub fn with_unknown(mut self, family: &dyn DynRhs, start: &[f64]) -> Result<Self, NetError> {
        let (key, per) = ("data.parameters", "unknown parameter");
        check_length(key, start.len(), family.dims().np, per)?;
        for start in start {
            check(start.is_finite(), key, start, "a number")?;
        }
        let is_plain = self.net.dims().np == 0 && self.labels.is_none();
        let expected = "none for a net that takes parameters, or is trained on an integrator";
        check(is_plain, key, "unknown parameters", expected)?;
        let weights = self.config.weights(&self.net)?;
        let loss = || BatchLoss::inverse(family, &self.net, &weights, start, &self.workers);
        let (mut fresh, loss) = (self.fresh.is_some().then(loss), loss());
        if let (Some(fresh), Some(growth)) = (&mut fresh, &self.config.growth) {
            let points = fresh_points(&self.net, growth.fresh_points, self.seed);
            fresh.set_points(&points, &Points::default());
        }
        (self.loss, self.fresh) = (loss, fresh);
        self.unknown = start.iter().map(|&start| UnknownParameter::new(start)).collect();
        let variables = self.net.mlp().parameters().len() + self.unknown.len();
        let state = &mut self.state;
        state.iterate.x.resize(variables, 0.0);
        state.iterate.gradient.resize(variables, 0.0);
        state.optimizer = Optimizer::new(&self.config.phases[0].optimizer, variables);
        self.sample()?;
        self.reevaluate();
        Ok(self)
    }

    /// The present estimates of the parameters that are trained with the net.
    #[must_use]
    pub fn estimates(&self) -> Vec<f64> {
        let q = &self.state.iterate.x[self.net.mlp().parameters().len()..];
        self.unknown.iter().zip(q).map(|(unknown, &q)| unknown.at(q)).collect()
    }

    /// Adds measurements to be fitted beside the equation, before the first iteration: the loss
    /// gets the term `weight` `MSE_D`, squared in the units of `initial_scale`.
    ///
    /// # Errors
    ///
    /// [`NetError::Setting`] if `weight` is not positive, there are no measurements, or the net is
    /// trained on an integrator instead of the equation.
    pub fn with_measurements(
        mut self,
        measurements: &Measurements,
        weight: f64,
    ) -> Result<Self, NetError> {
        check(measurements.values() > 0, "data", "no usable value", "at least one")?;
        check(self.labels.is_none(), "source", "integrator", "\"physics\" with [data]")?;
        check_positive("data.weight", weight)?;
        self.loss.set_measurements(measurements, weight);
        self.sample()?;
        self.reevaluate();
        Ok(self)
    }

    /// Continues from where `checkpoint` was taken.
    ///
    /// # Errors
    ///
    /// [`NetError::Checkpoint`] if it does not fit: it must come from the same [`Training`].
    pub fn resume(mut self, checkpoint: Checkpoint) -> Result<Self, NetError> {
        if checkpoint.iterate.x.len() != self.state.iterate.x.len() {
            return Err(NetError::Checkpoint { what: "the number of parameters" });
        }
        if checkpoint.phase >= self.config.phases.len() {
            return Err(NetError::Checkpoint { what: "the number of phases" });
        }
        self.state = checkpoint;
        self.sample()?;
        Ok(self)
    }

    /// One iteration of the optimizer.
    ///
    /// # Errors
    ///
    /// [`NetError::NotFinite`] if the loss or its gradient is NaN or infinite; [`Trainer::net`]
    /// then still returns the last good net.
    pub fn step(&mut self) -> Result<Progress, NetError> {
        if let Some(reason) = self.state.finished {
            return Ok(Progress::Finished(reason));
        }
        self.check_finite()?;
        if self.state.phase_iterations >= self.phase_limit() {
            return self.end_phase(StopReason::IterationsDone);
        }
        let good = self.state.iterate.x.clone();
        let state = &mut self.state;
        let mut objective = Counted {
            loss: &mut self.loss,
            evaluations: &mut state.totals.loss_evaluations,
            terms: &mut state.terms,
        };
        match state.optimizer.step(&mut objective, &mut state.iterate, &self.workers) {
            Outcome::Moved => {}
            Outcome::Converged => return self.end_phase(StopReason::GradientTolerance),
            Outcome::Stuck => {
                if self.grow()? {
                    return self.step();
                }
                return self.end_phase(StopReason::NoFurtherDescent);
            }
        }
        self.state.totals.iterations += 1;
        self.state.phase_iterations += 1;
        if let Err(error) = self.check_finite() {
            self.state.iterate.x = good;
            return Err(error);
        }
        let fresh_loss = self.check_fresh_points()?;
        Ok(Progress::Iterated(self.record(fresh_loss)))
    }

    /// Adds `points` to the sample for good and trains the net selected so far for
    /// [`Trainer::REFINEMENT`] more iterations of the last phase. From then on the last net is selected, whatever its accuracy.
    ///
    /// # Errors
    ///
    /// As [`Trainer::step`].
    pub fn refine(&mut self, points: &Points) -> Result<(), NetError> {
        let net = self.net();
        let weights = net.mlp().parameters();
        self.state.iterate.x[..weights.len()].copy_from_slice(weights);
        self.state.extra.extend(points);
        self.state.finished = None;
        (self.state.phase, self.state.phase_iterations) = (self.config.phases.len() - 1, 0);
        self.sample()?;
        self.reevaluate();
        self.state.optimizer.refresh(&self.state.iterate, &self.workers);
        Ok(())
    }

    /// How many iterations the present phase has at most.
    fn phase_limit(&self) -> u64 {
        let own = self.config.phases[self.state.phase].iterations;
        if self.state.extra.is_empty() { own } else { Self::REFINEMENT }
    }

    /// Iterates to the end and validates whenever a validation is due.
    ///
    /// # Errors
    ///
    /// As [`Trainer::step`].
    pub fn run(&mut self) -> Result<StopReason, NetError> {
        loop {
            let progress = self.step()?;
            if self.validation_due() {
                self.validate();
            }
            if let Progress::Finished(reason) = progress {
                return Ok(reason);
            }
        }
    }

    fn record(&self, fresh_loss: Option<f64>) -> IterationRecord {
        let Checkpoint { phase, totals, collocation_points, iterate, terms, .. } = &self.state;
        IterationRecord {
            iteration: totals.iterations,
            phase: *phase,
            loss_evaluations: totals.loss_evaluations,
            loss: iterate.value,
            loss_data: terms.data,
            loss_physics: terms.physics,
            loss_measured: terms.measured,
            gradient_norm: iterate.gradient_norm(),
            collocation_points: *collocation_points,
            fresh_loss,
        }
    }

    /// Whether a validation is due by the schedule: every `validation_every` iterations and at the
    /// end of each phase; never where parameters of the plant are unknown.
    #[must_use]
    pub fn validation_due(&self) -> bool {
        let iterations = self.state.totals.iterations;
        let phase_over = self.state.phase_iterations >= self.phase_limit();
        let due = iterations.is_multiple_of(self.config.validation_every)
            || phase_over
            || self.state.finished.is_some();
        due && self.unknown.is_empty() && self.state.validated_at != Some(iterations)
    }

    /// Validates the current net, keeps it if it is the best so far, and ends the training if it
    /// reaches [`TrainingConfig::target_one_step_rms`].
    pub fn validate(&mut self) -> Validation {
        let current = self.net.with_parameters(&self.state.iterate.x);
        let validation = self.validation.evaluate(&current);
        self.state.validated_at = Some(self.state.totals.iterations);
        let score = validation.score();
        let better = self.state.best.as_ref().is_none_or(|(best, _)| score < *best);
        let wanted = self.config.target_one_step_rms;
        let refined = !self.state.extra.is_empty();
        let reached =
            !refined && wanted.is_some_and(|target| validation.one_step_mse.sqrt() <= target);
        if reached || better && score.is_finite() {
            self.state.best = Some((score, self.state.iterate.x.clone()));
        }
        if reached {
            self.state.finished = Some(StopReason::TargetReached);
        }
        validation
    }

    /// The net selected so far: the best on validation, or the last.
    #[must_use]
    pub fn net(&self) -> PincNet {
        match (&self.state.best, self.config.keep) {
            (Some((_, parameters)), SelectNet::Best) if self.state.extra.is_empty() => {
                self.net.with_parameters(parameters)
            }
            _ => {
                let weights = self.net.mlp().parameters().len();
                self.net.with_parameters(&self.state.iterate.x[..weights])
            }
        }
    }

    /// Returns the scenarios that validate the nets.
    #[must_use]
    pub fn validation_set(&self) -> &ValidationSet {
        &self.validation
    }

    /// The complete state of the training.
    #[must_use]
    pub fn checkpoint(&self) -> &Checkpoint {
        &self.state
    }

    /// Work done so far.
    #[must_use]
    pub fn totals(&self) -> Totals {
        self.state.totals
    }

    fn check_finite(&self) -> Result<(), NetError> {
        let iteration = self.state.totals.iterations;
        let LossTerms { data, physics, measured } = self.state.terms;
        for (term, value) in [
            ("the loss term MSE_y", data),
            ("the loss term MSE_F", physics),
            ("the loss term MSE_D", measured),
            ("the gradient of the loss", self.state.iterate.gradient_norm()),
        ] {
            if !value.is_finite() {
                return Err(NetError::NotFinite { term, iteration });
            }
        }
        Ok(())
    }

    /// Continues with the next phase, or ends the training.
    fn end_phase(&mut self, reason: StopReason) -> Result<Progress, NetError> {
        let phase = &self.config.phases[self.state.phase];
        if phase.restore_best
            && let Some((_, parameters)) = &self.state.best
        {
            self.state.iterate.x.clone_from(parameters);
            self.reevaluate();
        }
        if self.state.phase + 1 == self.config.phases.len() {
            self.state.finished = Some(reason);
            return Ok(Progress::Finished(reason));
        }
        self.state.phase += 1;
        self.state.phase_iterations = 0;
        let config = &self.config.phases[self.state.phase].optimizer;
        self.state.optimizer = Optimizer::new(config, self.state.iterate.x.len());
        self.step()
    }

    /// Evaluates the loss on fresh points when that is due, and enlarges the sample if the net
    /// overfits it.
    fn check_fresh_points(&mut self) -> Result<Option<f64>, NetError> {
        let (Some(growth), Some(fresh)) = (&self.config.growth, &mut self.fresh) else {
            return Ok(None);
        };
        if !self.state.totals.iterations.is_multiple_of(growth.check_every) {
            return Ok(None);
        }
        let of_sample = |terms: LossTerms| match self.config.source {
            TrainingTarget::Physics => terms.physics,
            TrainingTarget::Integrator => terms.measured,
        };
        let fresh = of_sample(fresh.loss(&self.state.iterate.x));
        if fresh > growth.overfit_ratio * of_sample(self.state.terms) {
            self.grow()?;
        }
        Ok(Some(fresh))
    }

    /// Enlarges the sample; false if it may not grow any further.
    fn grow(&mut self) -> Result<bool, NetError> {
        let Some(growth) = &self.config.growth else {
            return Ok(false);
        };
        let points = self.state.collocation_points;
        if points >= growth.max_points {
            return Ok(false);
        }
        self.state.collocation_points = (points * growth.factor).min(growth.max_points);
        self.sample()?;
        self.reevaluate();
        self.state.optimizer.refresh(&self.state.iterate, &self.workers);
        Ok(true)
    }

    /// Draws the sample, which depends on the seed and the number of points only.
    fn sample(&mut self) -> Result<(), NetError> {
        let (points, initial) = (self.state.collocation_points, self.config.initial_points);
        let (sample_time_s, domain) = (self.net.sample_time_s(), self.net.domain());
        let sampler = self.config.sampler;
        let (mut collocation, conditions) = match self.net.time_only() {
            None => (
                sampler.collocation(points, sample_time_s, domain, initial, self.seed),
                initial_conditions(initial, domain, self.seed),
            ),
            Some(scenario) => {
                let mut one = Points::new(self.net.dims());
                one.push(0.0, &scenario.initial_state, &scenario.input, &[]);
                (sampler.scenario(points, sample_time_s, scenario, self.seed), one)
            }
        };
        collocation.extend(&self.state.extra);
        if let Some(labels) = &mut self.labels {
            self.loss.set_measurements(labels.of(&collocation, &self.workers)?, 1.0);
            return Ok(());
        }
        let hard = self.net.ansatz == Ansatz::HardLinear;
        let conditions = if hard { Points::default() } else { conditions };
        self.loss.set_points(&collocation, &conditions);
        Ok(())
    }

    /// Recomputes value and gradient after a change of the sample or the parameters.
    fn reevaluate(&mut self) {
        let mut objective = Counted {
            loss: &mut self.loss,
            evaluations: &mut self.state.totals.loss_evaluations,
            terms: &mut self.state.terms,
        };
        self.state.iterate.reevaluate(&mut objective);
    }
}

/// Points of the same distribution that the net is never trained on.
fn fresh_points(net: &PincNet, count: usize, seed: u64) -> Points {
    match net.time_only() {
        None => {
            Sampler::Sobol.sample(count, net.sample_time_s(), net.domain(), 1, seed, Purpose::Fresh)
        }
        Some(scenario) => {
            Sampler::Independent.scenario(count, net.sample_time_s(), scenario, !seed)
        }
    }
}
