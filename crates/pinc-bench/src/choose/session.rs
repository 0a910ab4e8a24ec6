//! Trying candidates, one after the other, within a time.

use super::base::Base;
use super::in_c::InC;
use super::until::until;
use super::{ChooseOptions, Timed};
use pinc_choose::{Candidate, Loops, Purpose, Score, Tried};
use pinc_config::{Experiment, Plants, Trial, trials};
use pinc_record::{
    Ending, Finished, Invocation, OneStepMetrics, Provenance, RunDir, SweepDir, file,
};
use pinc_runs::clock::Deadline;
use pinc_runs::invocation::{cores, invocation};
use pinc_runs::progress::{Stage, Verbosity};
use pinc_runs::{
    IntegratorBox, Options, RunError, Threads, proven_net_error, run_trial, train_shared,
};
use std::path::Path;

/// The candidates tried so far, and where what came of them lies.
pub(super) struct Session<'a> {
    pub(super) base: &'a Base,
    pub(super) run_dir: RunDir,
    pub(super) sweep_dir: SweepDir,
    plants: &'a Plants,
    pub(super) begun: Invocation,
    options: &'a Options<'a>,
    /// Until when models are tried.
    trying: Deadline,
    /// Until when the best are measured again.
    deadline: Deadline,
    stage: Stage,
    /// The controllers in C, with what was tried, if these are timed.
    timed: Timed,
    in_c: Vec<(Candidate, Tried, Option<InC>)>,
    /// The box in which integrators have to be sound.
    of_box: Option<IntegratorBox<'a>>,
}

/// The directory of the controllers in C.
const IN_C: &str = "c";

/// The share of the time in which models are tried; the rest is for measuring the best again.
const TRYING: f64 = 0.85;

impl<'a> Session<'a> {
    /// A session in `dir`, in which the results of an earlier one may be.
    pub(super) fn open(
        base: &'a Base,
        dir: &Path,
        plants: &'a Plants,
        options: &'a Options<'a>,
        ChooseOptions { budget_s, timed, .. }: ChooseOptions,
    ) -> Result<Self, RunError> {
        let run_dir = RunDir::open(dir, &base.experiment, std::process::id())?;
        let begun = invocation(options.arguments);
        let provenance = Provenance::of(&base.experiment, begun.clone());
        run_dir.write_provenance(&provenance, options.resume)?;
        let sweep_dir = SweepDir::of(dir);
        if !options.resume {
            sweep_dir.clear()?;
        }
        let [trying, deadline] = [TRYING * budget_s, budget_s].map(Deadline::in_seconds);
        let stage = Stage::begin(options.verbosity, "choose", deadline.whole_s());
        let of_box = IntegratorBox::of(&*base.plant, &base.experiment);
        Ok(Self {
            base,
            run_dir,
            sweep_dir,
            plants,
            begun,
            options,
            trying,
            deadline,
            stage,
            timed,
            in_c: Vec::new(),
            of_box,
        })
    }

    /// Ends the session, in which so much was tried.
    pub(super) fn end(self, tried: usize) {
        self.stage.end(&format!("{tried} models tried"));
    }

    /// The sweep whose cases are these.
    pub(super) fn sweep(&self, cases: &str) -> Result<Experiment, RunError> {
        let own = self.base.experiment.to_toml();
        let text = format!("{own}\n[sweep]\ntimed = true\n{cases}");
        Ok(Experiment::parse(Path::new("pinc choose"), &text, &[], self.plants)?)
    }

    fn trial(&self, candidate: Candidate, purpose: Purpose) -> Result<Trial, RunError> {
        let sweep = self.sweep(&candidate.case(repetitions(purpose), &self.base.iterations()))?;
        let made = trials(&sweep).expect("the experiment was checked, and its trials with it");
        let mut trial = made.into_iter().next().expect("a sweep with one case has one trial");
        if let (Candidate::Net { .. }, Some(control)) = (candidate, &mut trial.experiment.control) {
            (control.error_tolerance, control.on_error, control.uncertainty) =
                self.base.guard.clone();
        }
        if let Purpose::Time { round, .. } = purpose {
            trial.id = format!("{}-{round}", trial.id);
            // Its single steps were looked at when it was tried.
            trial.experiment.one_step = None;
        }
        Ok(trial)
    }

    /// The errors of a candidate's single steps, from when it was tried.
    fn one_step(&self, candidate: Candidate) -> Result<Vec<OneStepMetrics>, RunError> {
        let tried = self.sweep_dir.finished(&self.trial(candidate, Purpose::Quality)?.id)?;
        Ok(tried.map_or_else(Vec::new, |tried| tried.metrics.one_step))
    }

    /// What makes an integrator unsound, as `pinc check` says it.
    fn objection(&self, candidate: Candidate) -> Option<String> {
        match candidate {
            Candidate::Integrator { integrator, substeps } => {
                self.of_box.as_ref()?.soundness(integrator, substeps).objection()
            }
            Candidate::BlackBox | Candidate::Net { .. } => None,
        }
    }

    /// A proven bound of a model's error of one step, in widths of the box where the loop may go, if
    /// a proof takes little work.
    pub(super) fn proven(&self, tried: &Tried) -> Option<f64> {
        match (tried.candidate, &tried.net) {
            (Candidate::Integrator { integrator, substeps }, _) => {
                self.of_box.as_ref()?.proven(integrator, substeps, cores())
            }
            (Candidate::BlackBox, _) => None,
            (Candidate::Net { .. }, net) => {
                let model = self.sweep_dir.net(net.as_ref()?).join(file::MODEL);
                proven_net_error(&self.base.experiment, &model).ok()?
            }
        }
    }

    /// When a trial has to end, if its time is limited: each model has one measurement at least.
    fn limit(&self, purpose: Purpose) -> Option<Deadline> {
        match purpose {
            Purpose::Quality => Some(self.trying),
            Purpose::Time { round: 1, .. } => None,
            Purpose::Time { .. } => Some(self.deadline),
        }
    }

    /// Runs a trial after its training; nothing if the time was up.
    fn run_trial(
        &self,
        trial: &Trial,
        limit: Option<Deadline>,
    ) -> Result<Option<Finished>, RunError> {
        let dir = self.sweep_dir.begin(&trial.id)?;
        let mut run_dir = RunDir::of_trial(&dir, &trial.experiment, false);
        let user = self.options.interrupt;
        let worked = until(limit, user, |interrupt| {
            let quiet = Verbosity::Quiet;
            let options = Options { resume: true, verbosity: quiet, interrupt, ..*self.options };
            self.train_and_run(trial, &mut run_dir, &options)
        });
        let ending = match worked {
            Ok(()) => Ending::Done,
            Err(RunError::Interrupted { .. }) => {
                self.options.check_interrupt(self.run_dir.dir())?;
                return Ok(None);
            }
            Err(error @ (RunError::Record(_) | RunError::Config(_))) => return Err(error),
            // This error is the same every time: the model cannot do it.
            Err(error) => Ending::Failed { error: error.to_string() },
        };
        Ok(Some(Finished { ending, metrics: run_dir.metrics().clone() }))
    }

    fn train_and_run(
        &self,
        trial: &Trial,
        run_dir: &mut RunDir,
        options: &Options<'_>,
    ) -> Result<(), RunError> {
        let mut net = None;
        if let Some((id, training)) = &trial.training {
            let place = self.sweep_dir.net(id);
            if !self.sweep_dir.is_trained(id) {
                train_shared(training, &place, &self.begun, &Threads::new(&cores), options)?;
            }
            net = Some(place);
        }
        run_trial(&trial.experiment, net.as_deref(), run_dir, options)
    }
}

impl Loops for Session<'_> {
    type Error = RunError;

    fn run(&mut self, candidate: Candidate, purpose: Purpose) -> Result<Option<Tried>, RunError> {
        match self.timed {
            Timed::Program => self.run_loop(candidate, purpose),
            Timed::ExportedC => self.run_in_c(candidate, purpose),
        }
    }
}

impl Session<'_> {
    /// The quality of the program's loop, with the time of a step in C.
    fn run_in_c(
        &mut self,
        candidate: Candidate,
        purpose: Purpose,
    ) -> Result<Option<Tried>, RunError> {
        if !self.in_c.iter().any(|(of, ..)| *of == candidate) {
            let Some(mut tried) = self.run_loop(candidate, Purpose::Quality)? else {
                return Ok(None);
            };
            let mut in_c = None;
            if let Ok(score) = &mut tried.result {
                match self.exported(candidate, &tried.place, tried.net.as_deref()) {
                    Ok(exported) => in_c = Some(exported),
                    Err(error) => score.unexported = Some(error.to_string()),
                }
            }
            self.in_c.push((candidate, tried, in_c));
        } else if self.limit(purpose).is_some_and(Deadline::is_over) {
            return Ok(None);
        }
        let known = self.in_c.iter().find(|(of, ..)| *of == candidate);
        let (_, tried, in_c) = known.expect("the candidate was added");
        let mut tried = tried.clone();
        if let (Ok(score), Some(in_c)) = (&mut tried.result, in_c) {
            match in_c.time() {
                Ok(cost) => {
                    (score.p50_us, score.p99_us) = (cost.p50_us, cost.p99_us);
                    score.instructions = cost.instructions;
                }
                Err(error) => score.unexported = Some(error.to_string()),
            }
        }
        Ok(Some(tried))
    }

    /// The controller with a candidate in C.
    fn exported(
        &self,
        candidate: Candidate,
        place: &str,
        net: Option<&str>,
    ) -> Result<InC, RunError> {
        let trial = self.trial(candidate, Purpose::Quality)?;
        let model = net.map(|net| self.sweep_dir.net(net).join(file::MODEL));
        let dir = self.run_dir.path(IN_C).join(place);
        InC::new(&trial.experiment, model.as_deref(), &dir)
    }

    fn run_loop(
        &mut self,
        candidate: Candidate,
        purpose: Purpose,
    ) -> Result<Option<Tried>, RunError> {
        let (repetitions, limit) = (repetitions(purpose), self.limit(purpose));
        let done = self.deadline.seconds_over();
        self.stage.advance(done, || candidate.to_string());
        let trial = match self.trial(candidate, purpose) {
            Ok(trial) => trial,
            // Too many substeps in a long stage, say.
            Err(RunError::Config(error)) => {
                let (net, place, result) = (None, String::new(), Err(error.to_string()));
                return Ok(Some(Tried { candidate, net, repetitions, place, result }));
            }
            Err(error) => return Err(error),
        };
        let net = trial.training.as_ref().map(|(id, _)| id.clone());
        let finished = match self.sweep_dir.finished(&trial.id)? {
            Some(finished) => finished,
            None if limit.is_some_and(Deadline::is_over) => return Ok(None),
            None => {
                let Some(mut finished) = self.run_trial(&trial, limit)? else { return Ok(None) };
                if purpose != Purpose::Quality {
                    finished.metrics.one_step = self.one_step(candidate)?;
                }
                self.sweep_dir.finish(&trial.id, &finished)?;
                finished
            }
        };
        let result = match (finished.ending, Score::of(&finished.metrics)) {
            (Ending::Failed { error }, _) => Err(error),
            (Ending::Done, Some(score)) => {
                Ok(Score { unsound: self.objection(candidate), ..score })
            }
            (Ending::Done, None) => Err("no results".to_owned()),
        };
        Ok(Some(Tried { candidate, net, repetitions, place: trial.id, result }))
    }
}

/// How often a loop is run.
fn repetitions(purpose: Purpose) -> usize {
    match purpose {
        Purpose::Quality => 1,
        Purpose::Time { repetitions, .. } => repetitions,
    }
}
