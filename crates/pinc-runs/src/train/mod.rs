//! The training stage: from a config to `model.safetensors` and `training.csv`.

use super::proof::{self, Attempt, Certificate};
use super::training_setup::{TrainerInputs, TrainingSetup};
use super::{Options, domain_error};
use crate::RunError;
use crate::progress::{Stage, Verbosity};
use pinc_config::{Effort, Experiment};
use pinc_net::{IterationRecord, PincNet, Progress, Trainer, Validation};
use pinc_ode::DynPlant;
use pinc_record::{
    CheckpointProblem, Metrics, RecordError, RunDir, Saved, TrainingMetrics, TrainingRow,
    ValidationMetrics, file, fixed_table, load_checkpoint, read_fixed_table, save_checkpoint,
};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::time::{Duration, Instant};

/// The share of the time that writing checkpoints may take.
const TIME_SHARE: f64 = 0.03;
/// How much checkpoints may write per second of training.
const BYTES_PER_S: f64 = 4e6;

/// Rounds of training and proving, at most.
const MOST_ROUNDS: usize = 30;

/// Why a training ends that the clock ends.
const TIME_LIMIT: &str = "time-limit";

/// Time between two looks at how many threads a training may use.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// How many threads a training may use, which can change while it runs. Its bits do not depend on them.
pub struct Threads<'a> {
    now: &'a (dyn Fn() -> usize + 'a),
    every: Duration,
}

impl fmt::Debug for Threads<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Threads").field("now", &(self.now)()).field("every", &self.every).finish()
    }
}

impl<'a> Threads<'a> {
    /// As many as `now` says.
    pub fn new(now: &'a (dyn Fn() -> usize + 'a)) -> Self {
        Self { now, every: LOOK_EVERY }
    }
}

/// Trains the net, or reads it if that has been done, and returns it. `threads` are those to use,
/// if not what the config says.
pub(crate) fn stage(
    plant: &dyn DynPlant,
    experiment: &Experiment,
    options: &Options<'_>,
    threads: Option<&Threads<'_>>,
    run_dir: &mut RunDir,
) -> Result<PincNet, RunError> {
    if run_dir.metrics().training.is_some() {
        // A run that was killed between its results and this has one.
        run_dir.remove(file::CHECKPOINT)?;
        let net = super::read_model(&run_dir.path(file::MODEL))?;
        remake_domain_error(plant, experiment, &net, run_dir)?;
        return Ok(net);
    }
    let setup = TrainingSetup::of(experiment)?;
    let threads_of_config = || setup.threads();
    let given = Threads { now: &threads_of_config, every: Duration::MAX };
    let threads = threads.unwrap_or(&given);
    let (inputs, test) = setup.inputs(plant, experiment)?;
    let mut session =
        Session::begin(&inputs, experiment, (threads.now)(), options.verbosity, run_dir)?;
    let work = |session: &mut Session| {
        session.work(&inputs, run_dir, &setup.training.effort, threads, options)
    };
    let outcome = work(&mut session);
    let tolerance = &setup.training.proven_tolerance;
    let (outcome, certificate) = match outcome {
        Ok(reason) if !tolerance.is_empty() => {
            let effort = &setup.training.effort;
            match session.prove(experiment, tolerance, effort, (threads, options, run_dir), work) {
                Ok(certificate) => (Ok(reason), Some(certificate)),
                Err(error) => (Err(error), None),
            }
        }
        outcome => (outcome, None),
    };
    let net = session.trainer.net();
    let net = match &certificate {
        Some(certificate) => proof::certified(net, certificate),
        None => net,
    };
    let parameters = inputs.estimates(&session.trainer);
    // The net first: it is what the time was spent on. The net of an interrupted training is in the
    // checkpoint; of one that failed, the last good net is kept.
    if !matches!(outcome, Err(RunError::Interrupted { .. })) {
        run_dir.write(file::MODEL, &net.to_bytes())?;
    }
    session.write_log(run_dir)?;
    let metrics = TrainingMetrics { parameters, ..session.metrics(outcome?) };
    let found = setup.found(experiment, &metrics.parameters)?;
    let (plant, test) = found.as_ref().map_or((plant, &test), |of| (&*of.plant, &of.test));
    let mut domain_error = domain_error::judge(plant, &net, &setup, experiment.seed, run_dir)?;
    // What is found with the net is no equation to prove anything of.
    if let (Some(of), None, true) = (&mut domain_error, &found, run_dir.keeps_traces()) {
        of.proven = domain_error::proven(experiment, &net);
    }
    run_dir.note(&[file::MODEL, file::TRAINING, file::DOMAIN_ERROR]);
    run_dir.update(|all| {
        all.training = Some(metrics);
        all.validation = Some(ValidationMetrics::new(&test.evaluate(&net), domain_error));
    })?;
    run_dir.remove(file::CHECKPOINT)?;
    Ok(net)
}

/// Writes the table of a finished training's errors over the domain again, if it is not what it was.
fn remake_domain_error(
    plant: &dyn DynPlant,
    experiment: &Experiment,
    net: &PincNet,
    run_dir: &mut RunDir,
) -> Result<(), RunError> {
    let Metrics { training: Some(training), validation: Some(validation), .. } = run_dir.metrics()
    else {
        return Ok(());
    };
    let is_wanted = validation.domain_error.is_some() && run_dir.keeps_traces();
    if !is_wanted || run_dir.is_as_noted(file::DOMAIN_ERROR) {
        return Ok(());
    }
    let setup = TrainingSetup::of(experiment)?;
    let found = setup.found(experiment, &training.parameters)?;
    let plant = found.as_ref().map_or(plant, |of| &*of.plant);
    domain_error::judge(plant, net, &setup, experiment.seed, run_dir)?;
    run_dir.note(&[file::DOMAIN_ERROR]);
    Ok(run_dir.update(|_| ())?)
}

/// A training at work.
struct Session {
    trainer: Trainer,
    threads: usize,
    fingerprint: String,
    /// The rows of `training.csv`.
    rows: Vec<TrainingRow>,
    /// The last validation's `mse_gen`.
    validated: Option<f64>,
    iteration: u64,
    /// Wall time of the optimizer.
    optimizer: Duration,
    /// Wall time of the stage before this session began.
    earlier: Duration,
    begun: Instant,
    stage: Stage,
}

impl Session {
    fn begin(
        inputs: &TrainerInputs<'_>,
        experiment: &Experiment,
        threads: usize,
        verbosity: Verbosity,
        run_dir: &RunDir,
    ) -> Result<Self, RunError> {
        let begun = Instant::now();
        let mut fingerprint = experiment.normalized().fingerprint();
        if let Some(data) = &inputs.measured {
            // The config only names the files; a training is resumed with the same measurements or not at all.
            fingerprint.extend(data.digest.iter().map(|byte| format!("{byte:02x}")));
        }
        let fresh = Self {
            trainer: inputs.trainer(threads)?,
            threads,
            fingerprint,
            rows: Vec::new(),
            validated: None,
            iteration: 0,
            optimizer: Duration::ZERO,
            earlier: Duration::ZERO,
            begun,
            stage: Stage::begin(verbosity, "training", inputs.iterations()),
        };
        match run_dir.path(file::CHECKPOINT) {
            path if path.exists() => fresh.resume_from(&path, run_dir),
            _ => Ok(fresh),
        }
    }

    /// Continues on as many threads, if they are others than now.
    fn use_threads(&mut self, inputs: &TrainerInputs<'_>, threads: usize) -> Result<(), RunError> {
        if threads != self.threads {
            let state = self.trainer.checkpoint().clone();
            self.trainer = inputs.trainer(threads)?.resume(state)?;
            self.threads = threads;
        }
        Ok(())
    }

    /// The session, resumed from the checkpoint at `path`.
    fn resume_from(self, path: &Path, run_dir: &RunDir) -> Result<Self, RunError> {
        let saved = load_checkpoint(path, &self.fingerprint)?;
        let problem = |problem| RecordError::Checkpoint { path: path.to_owned(), problem };
        let rows = read_fixed_table::<TrainingRow>(&run_dir.path(file::TRAINING)).ok().flatten();
        let mut rows = rows.unwrap_or_default();
        rows.retain(|row| row.iteration <= saved.iteration);
        // One row per iteration.
        if u64::try_from(rows.len()) != Ok(saved.iteration) {
            return Err(problem(CheckpointProblem::TrainingLog).into());
        }
        let trainer = self.trainer.resume(saved.trainer);
        Ok(Self {
            trainer: trainer
                .map_err(|error| problem(CheckpointProblem::Training(Box::new(error))))?,
            rows,
            iteration: saved.iteration,
            optimizer: Duration::from_secs_f64(saved.optimizer_s),
            earlier: Duration::from_secs_f64(saved.wall_s),
            ..self
        })
    }

    /// Trains to the end and returns why that was the end.
    fn work(
        &mut self,
        inputs: &TrainerInputs<'_>,
        run_dir: &RunDir,
        effort: &Effort,
        threads: &Threads<'_>,
        options: &Options<'_>,
    ) -> Result<String, RunError> {
        let (mut last_checkpoint, mut last_look) = (Instant::now(), Instant::now());
        let mut pause_s = effort.checkpoint_every_s;
        loop {
            if let Err(stop) = options.check_interrupt(run_dir.dir()) {
                self.write_checkpoint(run_dir)?;
                return Err(stop);
            }
            if is_over(effort, self.wall()) {
                return Ok(TIME_LIMIT.to_owned());
            }
            if last_look.elapsed() >= threads.every {
                self.use_threads(inputs, (threads.now)())?;
                last_look = Instant::now();
            }
            let clock = Instant::now();
            let progress = self.trainer.step()?;
            self.optimizer += clock.elapsed();
            match progress {
                Progress::Finished(reason) => {
                    // The last net too may be the best.
                    if self.trainer.validation_due() {
                        self.trainer.validate();
                    }
                    return Ok(reason.to_string());
                }
                Progress::Iterated(iterated) => self.log(iterated),
            }
            if last_checkpoint.elapsed().as_secs_f64() >= pause_s {
                let clock = Instant::now();
                let bytes = self.write_checkpoint(run_dir)?;
                last_checkpoint = Instant::now();
                pause_s = pause(effort.checkpoint_every_s, clock.elapsed(), bytes);
            }
        }
    }

    /// Adds the places with the worst errors to the sample and trains on, until it is proven that no
    /// error is beyond `tolerance`.
    fn prove(
        &mut self,
        experiment: &Experiment,
        tolerance: &BTreeMap<String, f64>,
        effort: &Effort,
        (threads, options, run_dir): (&Threads<'_>, &Options<'_>, &RunDir),
        mut work: impl FnMut(&mut Self) -> Result<String, RunError>,
    ) -> Result<Box<Certificate>, RunError> {
        let refused = |reason: String| proof::not_proven(experiment, &reason);
        let too_late = || refused("training.time_limit_s is over".to_owned());
        let begun = Instant::now();
        for _ in 0..MOST_ROUNDS {
            let (net, threads) = (self.trainer.net(), (threads.now)());
            let tolerance = proof::tolerances(&net, tolerance);
            // A net that was trained to the limit has as long for its proof.
            let check = || match is_over(effort, begun.elapsed()) {
                true => Err(too_late()),
                false => options.check_interrupt(run_dir.dir()),
            };
            let workers = (threads, options.verbosity);
            match proof::attempt(experiment, &net, &tolerance, workers, &check)? {
                Attempt::Proven(certificate) => return Ok(certificate),
                Attempt::Open(share) => {
                    return Err(refused(format!(
                        "nothing can be proven in {:.3} % of the domain's volume, where the equation \
                         is not smooth: take a smaller [domain]",
                        100.0 * share
                    )));
                }
                Attempt::Refuted => {}
            }
            // What was done before an interruption is drawn again the same.
            let seed = experiment.seed ^ self.trainer.totals().iterations;
            let worst = proof::worst_points(experiment, &net, &tolerance, seed, threads)?;
            self.trainer.refine(&worst)?;
            self.stage.set_total(self.trainer.totals().iterations + Trainer::REFINEMENT);
            if work(self)? == TIME_LIMIT {
                return Err(too_late());
            }
        }
        Err(refused(format!(
            "errors are still beyond it after {MOST_ROUNDS} rounds of training: take a larger net, a \
             smaller [domain] or a shorter T"
        )))
    }

    /// Validates if it is time to, and adds a row to the log.
    fn log(&mut self, iterated: IterationRecord) {
        let validation = self.trainer.validation_due().then(|| self.trainer.validate());
        self.iteration = iterated.iteration;
        self.rows.push(row(&iterated, self.optimizer, validation.as_ref()));
        self.validated = validation.map(|v| v.mse_gen).or(self.validated);
        self.stage.advance(iterated.iteration, || match self.validated {
            Some(mse) => format!("loss {:.2e}, validation MSE {mse:.2e}", iterated.loss),
            None => format!("loss {:.2e}", iterated.loss),
        });
    }

    fn wall(&self) -> Duration {
        self.earlier + self.begun.elapsed()
    }

    fn write_log(&self, run_dir: &RunDir) -> Result<(), RunError> {
        Ok(run_dir.write(file::TRAINING, fixed_table(&self.rows).as_bytes())?)
    }

    /// Writes the log first, so that it always reaches as far as the checkpoint.
    /// Returns the size of the checkpoint.
    fn write_checkpoint(&self, run_dir: &RunDir) -> Result<usize, RunError> {
        self.write_log(run_dir)?;
        let saved = Saved {
            fingerprint: self.fingerprint.clone(),
            iteration: self.iteration,
            optimizer_s: self.optimizer.as_secs_f64(),
            wall_s: self.wall().as_secs_f64(),
            trainer: self.trainer.checkpoint(),
        };
        let bytes = save_checkpoint(&saved);
        run_dir.write(file::CHECKPOINT, &bytes)?;
        Ok(bytes.len())
    }

    fn metrics(self, stop_reason: String) -> TrainingMetrics {
        let totals = self.trainer.totals();
        let wall_s = self.wall().as_secs_f64();
        let checked = self.rows.iter().rfind(|row| row.fresh_loss.is_some());
        self.stage
            .end(&format!("{stop_reason} after {} iterations, {wall_s:.1} s", totals.iterations));
        TrainingMetrics {
            source: self.trainer.net().source(),
            wall_s,
            optimizer_s: self.optimizer.as_secs_f64(),
            iterations: totals.iterations,
            loss_evaluations: totals.loss_evaluations,
            stop_reason,
            loss: checked.map(|row| row.loss),
            fresh_loss: checked.and_then(|row| row.fresh_loss),
            parameters: BTreeMap::new(),
        }
    }
}

/// The time from a checkpoint to the next one, in s: the time that is asked for, and no less than
/// makes writing one a small share of the training, and of what the disk is given.
fn pause(every_s: f64, took: Duration, bytes: usize) -> f64 {
    let by_size = bytes as f64 / BYTES_PER_S;
    every_s.max(took.as_secs_f64() / TIME_SHARE).max(by_size)
}

/// The row of an iteration in `training.csv`.
fn row(
    iterated: &IterationRecord,
    elapsed: Duration,
    validation: Option<&Validation>,
) -> TrainingRow {
    TrainingRow {
        iteration: iterated.iteration,
        loss_evaluations: iterated.loss_evaluations,
        elapsed_s: elapsed.as_secs_f64(),
        loss: iterated.loss,
        validation_mse: validation.map(|validation| validation.mse_gen),
        phase: iterated.phase,
        loss_data: iterated.loss_data,
        loss_physics: iterated.loss_physics,
        gradient_norm: iterated.gradient_norm,
        collocation_points: iterated.collocation_points,
        fresh_loss: iterated.fresh_loss,
        loss_measured: iterated.loss_measured,
    }
}

/// Whether `time_limit_s` is over after this time.
fn is_over(effort: &Effort, after: Duration) -> bool {
    effort.time_limit_s.is_some_and(|limit| after.as_secs_f64() >= limit)
}

#[cfg(test)]
mod tests;
