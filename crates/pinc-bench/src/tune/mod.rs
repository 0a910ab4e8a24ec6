//! `pinc tune`: candidates for keys of the controller, tried as trials of a sweep are.

mod cost;
mod evolution;

use crate::sweep::{finish_trial, write_report};
use cost::{Cost, Score};
use evolution::{Drawn, Evolution};
use pinc_config::{Candidate, CaseSpec, Experiment, ModelKind, Trial, TuneSpec, trials};
use pinc_record::{Finished, Invocation, Provenance, RunDir, SweepDir, write_atomically};
use pinc_runs::invocation::{cores, invocation};
use pinc_runs::progress::{Stage, Verbosity};
use pinc_runs::{Options, RunError, Threads, train_shared};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The table of all candidates, the config with the best, and the sweep that compares it with the
/// config as it is written.
const TABLE: &str = "tune.csv";
const TUNED: &str = "tuned.toml";
const HELD_OUT: &str = "held-out";

/// The names of the two cases of that sweep.
const CASES: [&str; 2] = ["as written", "tuned"];

/// The result of a tuning; its `Display` is a short table.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// The config with the best candidate's values.
    pub config: PathBuf,
    /// Charts of the loops that were held out.
    pub report: PathBuf,
    /// The cost of these with the config as it is written, and tuned.
    pub held_out: [f64; 2],
    text: String,
}

impl std::fmt::Display for Tuned {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (config, report) = (self.config.display(), self.report.display());
        write!(f, "{}config: {config}\nreport: {report}", self.text)
    }
}

/// Tunes the controller of `experiment` as its `[tune]` says, with the first of its models or
/// `only` one, and compares the result with the config on loops that it was not tuned on. Results
/// are in `dir`; `options` say whether those of an earlier call are reused. The result follows from
/// the config, on any number of cores.
///
/// # Errors
///
/// [`RunError`] if a section is missing, a metric of the cost unknown, a loop of the config as it is
/// written cannot be made, or a file cannot be read or written.
pub fn tune(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    only: Option<ModelKind>,
) -> Result<Tuned, RunError> {
    let missing = |section| RunError::missing_section(experiment, section, "pinc tune");
    let spec = experiment.tune.as_ref().ok_or_else(|| missing("tune"))?;
    let base = base(experiment, only)?;
    let cost = Cost::of(&base)?;
    let run_dir = RunDir::open(dir, experiment, std::process::id())?;
    let begun = invocation(options.arguments);
    run_dir.write_provenance(&Provenance::of(experiment, begun.clone()), options.resume)?;
    let sweep_dir = SweepDir::of(dir);
    if !options.resume {
        sweep_dir.clear()?;
    }
    let session = Session { base, run_dir, sweep_dir, begun, options };
    let (tried, best) = session.search(spec, cost)?;
    let Search { cost, candidates, refused } = tried;
    session.run_dir.write(TABLE, cost.table(spec, &candidates).as_bytes())?;
    let values = &candidates[best].0;
    let (report, scores) = session.judge(values, &cost)?;
    let config = session.write_config(experiment, &cost, &candidates, (best, &scores))?;
    let mut text = cost.compared(spec, experiment, values, &scores);
    if let [first, ..] = &refused[..] {
        let (refused, total) = (refused.len(), spec.candidates);
        let _ = writeln!(
            text,
            "Note: the config does not admit {refused} of {total} candidates: {first}"
        );
    }
    if scores[0].is_better(&scores[1]) {
        let advice = "on held-out loops the config is better as it is written: more loops would \
                      tell candidates apart better";
        let _ = writeln!(text, "Note: {advice}");
    }
    let _ = writeln!(text, "candidates: {}", session.run_dir.path(TABLE).display());
    let held_out = scores.map(|score| score.cost);
    Ok(Tuned { config, report, held_out, text })
}

/// The experiment of the trials: one loop with one model, and nothing else.
fn base(experiment: &Experiment, only: Option<ModelKind>) -> Result<Experiment, RunError> {
    let mut base = experiment.clone();
    (base.sweep, base.prediction, base.one_step) = (None, None, None);
    let control = base.control.as_mut();
    let control = control.expect("the section [tune] was checked for it");
    let first = control.models.first().copied();
    if let Some(only) = only.filter(|only| !control.models.contains(only)) {
        return Err(RunError::missing_model(experiment, "--only", only));
    }
    control.models = only.or(first).into_iter().collect();
    if control.models == [ModelKind::Policy] {
        let problem = "`pinc tune` changes a controller, and the model \"policy\" is a net in its \
                       place: name another of control.models with --only";
        return Err(RunError::usage(experiment.source(), problem));
    }
    if !control.models.contains(&ModelKind::Pinc) {
        (control.error_tolerance, control.on_error) = Default::default();
    }
    control.repetitions = 1;
    if base.sample_time_s().is_none() {
        return Err(RunError::missing_section(&base, "model", "pinc tune"));
    }
    if base.control.iter().any(|control| control.models.contains(&ModelKind::Pinc))
        && base.training.is_none()
    {
        return Err(RunError::missing_section(&base, "training", "pinc tune with a net"));
    }
    Ok(base)
}

/// A candidate and what came of it.
type Tried = (Candidate, Score);

/// What a search has tried, the config as it is written first.
struct Search {
    cost: Cost,
    candidates: Vec<Tried>,
    /// Why the config does not admit some of them.
    refused: Vec<String>,
}

/// Where candidates are tried.
struct Session<'a> {
    base: Experiment,
    run_dir: RunDir,
    sweep_dir: SweepDir,
    begun: Invocation,
    options: &'a Options<'a>,
}

impl Session<'_> {
    /// Tries candidates until there are as many as asked for, and returns them with the place of
    /// the best.
    fn search(&self, spec: &TuneSpec, mut cost: Cost) -> Result<(Search, usize), RunError> {
        let total = spec.candidates as u64;
        let mut stage = Stage::begin(self.options.verbosity, "tune", total);
        let written = self.trials(&Candidate::new()).map_err(|problem| {
            RunError::usage(self.base.source(), format!("`tune.draws`: {problem}"))
        })?;
        let results = self.run(&[written])?.concat();
        if let Some(name) = cost.missing(&results) {
            let problem = format!("`tune.cost`: the loops have no metric `{name}`; name others");
            return Err(RunError::usage(self.base.source(), problem));
        }
        cost.set_scales(&results);
        let mut tried = vec![(Candidate::new(), cost.score(&results))];
        let (mut best, mut size, mut refused) = (0, 1, Vec::new());
        let mut random = ChaCha8Rng::seed_from_u64(self.base.seed);
        let mut evolution = Evolution::new(spec.start(&self.base), size);
        while tried.len() <= spec.candidates {
            if evolution.is_over() {
                size *= 2;
                let place = spec.ranges.iter().map(|_| random.random()).collect();
                evolution = Evolution::new(place, size);
            }
            let mut drawn = evolution.draw(&mut random);
            let left = spec.candidates + 1 - tried.len();
            let is_last = drawn.len() >= left;
            drawn.truncate(left);
            let candidates: Vec<Candidate> =
                drawn.iter().map(|drawn| spec.candidate(&drawn.place)).collect();
            // A candidate that the config does not admit has no trials.
            let made = candidates.iter().map(|values| self.trials(values));
            let made = made.map(|made| {
                made.unwrap_or_else(|problem| {
                    refused.push(problem);
                    Vec::new()
                })
            });
            let made: Vec<Vec<Trial>> = made.collect();
            let results = self.run(&made)?;
            let scores = results.iter().map(|results| cost.score(results));
            let begin = tried.len();
            tried.extend(candidates.into_iter().zip(scores));
            for (i, (_, score)) in tried.iter().enumerate().skip(begin) {
                if score.is_better(&tried[best].1) {
                    best = i;
                }
            }
            if !is_last {
                let mut sorted: Vec<(usize, &Drawn)> = drawn.iter().enumerate().collect();
                sorted.sort_by(|(a, _), (b, _)| tried[begin + a].1.compare(&tried[begin + b].1));
                let sorted: Vec<&Drawn> = sorted.into_iter().map(|(_, drawn)| drawn).collect();
                evolution.learn(&sorted);
            }
            let done = (tried.len() - 1) as u64;
            let [now, before] = [best, 0].map(|i| tried[i].1.to_string());
            stage.advance(done, || format!("cost {now}, as written {before}"));
        }
        stage.end(&format!("{total} candidates, cost {}", tried[best].1));
        if refused.len() == spec.candidates {
            let problem = format!("`tune.ranges`: the config admits no candidate: {}", refused[0]);
            return Err(RunError::usage(self.base.source(), problem));
        }
        Ok((Search { cost, candidates: tried, refused }, best))
    }

    /// The trials of a candidate, or why the config does not admit it.
    fn trials(&self, values: &Candidate) -> Result<Vec<Trial>, String> {
        let case = CaseSpec { name: CASES[1].to_owned(), set: values.clone() };
        let sweep = self.base.tuning(vec![case], false);
        let made = sweep.map_or_else(|| Ok(Vec::new()), |sweep| trials(&sweep));
        made.map_err(|(key, problem)| format!("{key}: {problem}"))
    }

    /// Runs the trials of each candidate that are not over yet, on all cores.
    fn run(&self, candidates: &[Vec<Trial>]) -> Result<Vec<Vec<Finished>>, RunError> {
        let all: Vec<&Trial> = candidates.iter().flatten().collect();
        for trial in &all {
            if let Some((id, training)) = &trial.training
                && !self.sweep_dir.is_trained(id)
            {
                let net = self.sweep_dir.net(id);
                train_shared(training, &net, &self.begun, &Threads::new(&cores), self.options)?;
            }
        }
        // Candidates that are equal have the same trials, each in one directory.
        let distinct: BTreeMap<&str, &Trial> =
            all.into_iter().map(|trial| (trial.id.as_str(), trial)).collect();
        let results = distinct.into_par_iter().map(|(id, trial)| Ok((id, self.one(trial)?)));
        let results = results.collect::<Result<BTreeMap<_, _>, RunError>>()?;
        let of = |trials: &Vec<Trial>| {
            trials.iter().filter_map(|trial| results.get(trial.id.as_str())).cloned().collect()
        };
        Ok(candidates.iter().map(of).collect())
    }

    fn one(&self, trial: &Trial) -> Result<Finished, RunError> {
        self.options.check_interrupt(self.run_dir.dir())?;
        if let Some(finished) = self.sweep_dir.finished(&trial.id)? {
            return Ok(finished);
        }
        let quiet = Options { resume: true, verbosity: Verbosity::Quiet, ..*self.options };
        let finished = finish_trial(&self.sweep_dir, trial, (false, None), &quiet)?;
        self.sweep_dir.finish(&trial.id, &finished)?;
        Ok(finished)
    }

    /// Writes the config with the values of the best candidate.
    fn write_config(
        &self,
        experiment: &Experiment,
        cost: &Cost,
        tried: &[Tried],
        (best, [before, after]): (usize, &[Score; 2]),
    ) -> Result<PathBuf, RunError> {
        let (values, score) = &tried[best];
        let mut tuned = experiment.with_candidate(values).map_err(|(key, problem)| {
            RunError::usage(experiment.source(), format!("`{key}`: {problem}"))
        })?;
        tuned.name += "-tuned";
        let mut text = format!(
            "# {} tuned: cost {score}, as written {}\n# held out: cost {after}, as written {before}\n\
             # cost: {cost}\n",
            experiment.name, tried[0].1
        );
        for (key, value) in values {
            let _ = writeln!(text, "# {key} = {value}");
        }
        let path = self.run_dir.path(TUNED);
        write_atomically(&path, format!("{text}\n{}", tuned.to_toml()).as_bytes())?;
        Ok(path)
    }

    /// Compares the best candidate with the config on loops that were held out: the report, and the
    /// scores of both.
    fn judge(&self, values: &Candidate, cost: &Cost) -> Result<(PathBuf, [Score; 2]), RunError> {
        let sets = [Candidate::new(), values.clone()];
        let cases = CASES.into_iter().zip(sets);
        let cases = cases.map(|(name, set)| CaseSpec { name: name.to_owned(), set }).collect();
        let experiment = self.base.tuning(cases, true).expect("the section [tune] is there");
        let dir = self.run_dir.path(HELD_OUT);
        let all = trials(&experiment).map_err(|(key, problem)| {
            RunError::usage(self.base.source(), format!("`{key}`: {problem}"))
        })?;
        let of = |name: &str| -> Vec<Trial> {
            let own = all.iter().filter(|trial| trial.cells.iter().any(|cell| cell == name));
            own.cloned().collect()
        };
        let results = self.run(&CASES.map(of))?;
        let report = write_report(&experiment, &all, &dir, &self.sweep_dir, &self.begun)?;
        Ok((report, [0, 1].map(|case| cost.score(&results[case]))))
    }
}
