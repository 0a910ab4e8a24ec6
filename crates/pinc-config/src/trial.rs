//! From a `[sweep]` section to its trials.

use crate::{DrawsSpec, Experiment, ModelKind, Plants, Problem, SearchSpec, SweepSpec};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::collections::HashMap;
use toml::{Table, Value};

/// The first stream of random numbers that draws come from, one per group; those below are others'.
const STREAM: u64 = 1 << 33;

/// Digits of an [`id`]: enough for a collision to be out of the question.
const DIGITS: usize = 16;

/// The column of a sweep's tables with the names of cases.
pub const CASE: &str = "case";
/// The column with the numbers of candidates of a search.
pub const CANDIDATE: &str = "candidate";
/// The column with the names of groups of draws.
pub const DRAWN: &str = "drawn";
/// The column with the numbers of draws.
pub const DRAW: &str = "draw";
/// The column with the seeds.
pub const SEED: &str = "seed";

/// The key of the noise that a seeded draw has to itself.
const NOISE_SEED: &str = "control.noise_seed";

/// One trial of a sweep.
#[derive(Clone, Debug)]
pub struct Trial {
    /// A hash of what is run: the same trial has the same name in every sweep directory.
    pub id: String,
    /// The cells of [`columns`].
    pub cells: Vec<String>,
    /// The experiment to run: the sweep's with this trial's values.
    pub experiment: Experiment,
    /// The training that it needs, which others may share, and the hash of that.
    pub training: Option<(String, Experiment)>,
    /// Its place in a search, if there is one.
    pub search: Option<SearchPlace>,
}

/// The place of a trial in a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SearchPlace {
    /// Cases and axes of the grid have a search each: the number of this one.
    pub group: usize,
    /// The candidate, from 0.
    pub candidate: usize,
    /// The rung of the halving, from 0.
    pub rung: usize,
}

impl Trial {
    /// Returns the key that the trials of one process share: their training, if there is one.
    #[must_use]
    pub fn unit(&self) -> &str {
        self.training.as_ref().map_or(&self.id, |(id, _)| id)
    }
}

impl Experiment {
    /// What is left where only the net is trained. A net of a family does not depend on what the
    /// plant's own values are for the parameters that it takes as inputs.
    pub(crate) fn training_alone(&self) -> Self {
        let mut alone = self.normalized();
        (alone.prediction, alone.control, alone.one_step) = (None, None, None);
        let ranges = self.domain.iter().flat_map(|domain| &domain.parameters);
        let middle = ranges.map(|of| (of.name.clone(), of.low + 0.5 * (of.high - of.low)));
        alone.plant = alone.plant.with_parameters(&middle.collect());
        alone
    }
}

/// The columns that tell the trials of a sweep apart, the seed last.
pub fn columns(sweep: &SweepSpec) -> Vec<String> {
    let mut columns = cell_columns(sweep);
    if !sweep.draws.is_empty() {
        columns.push(DRAW.to_owned());
        columns.extend(drawn_keys(sweep));
    }
    let searched = sweep.search.iter().flat_map(|search| &search.ranges);
    columns.extend(searched.map(|range| range.key.clone()));
    columns.push(SEED.to_owned());
    columns
}

/// Returns the [`columns`] that tell the cells of a sweep apart: a cell has one trial per seed and
/// draw. They are the first ones.
pub fn cell_columns(sweep: &SweepSpec) -> Vec<String> {
    let mut columns = group_columns(sweep);
    if let Some(search) = &sweep.search {
        columns.push(CANDIDATE.to_owned());
        columns.extend(search.halving.iter().map(|halving| halving.key.clone()));
    }
    if !sweep.draws.is_empty() {
        columns.push(DRAWN.to_owned());
    }
    columns
}

/// Returns the [`columns`] with alternatives that are not searched: cases and axes of the grid.
fn group_columns(sweep: &SweepSpec) -> Vec<String> {
    let mut columns = Vec::new();
    if !sweep.cases.is_empty() {
        columns.push(CASE.to_owned());
    }
    columns.extend(sweep.grid.iter().map(|axis| axis.key.clone()));
    columns
}

/// The keys of all groups of draws, each once.
fn drawn_keys(sweep: &SweepSpec) -> Vec<String> {
    let is_seeded = sweep.draws.iter().any(|draws| draws.seeded);
    let mut keys: Vec<String> = is_seeded.then(|| NOISE_SEED.to_owned()).into_iter().collect();
    for range in sweep.draws.iter().flat_map(|draws| &draws.ranges) {
        if !keys.contains(&range.key) {
            keys.push(range.key.clone());
        }
    }
    keys
}

/// The trials of an experiment with a sweep, in an order in which every cell has its first seed
/// before any has its second. Equal ones are one trial with several rows.
///
/// # Errors
///
/// The key that is wrong, and what is wrong with it: an axis that names no value, or a value that
/// the config does not admit.
pub fn trials(experiment: &Experiment) -> Result<Vec<Trial>, (String, Problem)> {
    let Some(sweep) = &experiment.sweep else { return Ok(Vec::new()) };
    let columns = columns(sweep);
    let made = made(experiment, choices(sweep, experiment.seed));
    let made = made.map(|(choice, experiment)| Ok(choice.trial(experiment?, &columns)));
    let mut trials = made.collect::<Result<Vec<_>, _>>()?;
    let (of_group, mut groups) = (group_columns(sweep).len(), HashMap::new());
    for trial in &mut trials {
        if let Some(place) = &mut trial.search {
            let next = groups.len();
            place.group = *groups.entry(trial.cells[..of_group].to_vec()).or_insert(next);
        }
    }
    Ok(trials)
}

/// The models in the loops of a sweep, each once: first the experiment's, then models that only
/// some trials have, in the order of the trials.
#[must_use]
pub fn sweep_models(experiment: &Experiment, trials: &[Trial]) -> Vec<ModelKind> {
    let trials = trials.iter().map(|trial| &trial.experiment);
    let loops = std::iter::once(experiment).chain(trials).filter_map(|e| e.control.as_ref());
    let mut models = Vec::new();
    for model in loops.flat_map(|control| &control.models) {
        if !models.contains(model) {
            models.push(*model);
        }
    }
    models
}

/// Checks that all trials can be made.
pub(crate) fn check(experiment: &Experiment) -> Result<(), (String, Problem)> {
    let Some(sweep) = &experiment.sweep else { return Ok(()) };
    let alone = sweep.search.as_ref().map(|_| choices(&undrawn(sweep), experiment.seed));
    let all = choices(sweep, experiment.seed).into_iter().chain(alone.into_iter().flatten());
    made(experiment, all).try_for_each(|(_, experiment)| experiment.map(drop))
}

/// The sweep without what its candidates are judged by: seeds and draws.
fn undrawn(sweep: &SweepSpec) -> SweepSpec {
    SweepSpec { seeds: Vec::new(), draws: Vec::new(), ..sweep.clone() }
}

/// A candidate of a search, with the experiment's own seed and none of the draws: its names, each
/// with its column, and its experiment.
#[must_use]
pub fn candidate(
    experiment: &Experiment,
    place: SearchPlace,
) -> Option<(Vec<(String, String)>, Experiment)> {
    let sweep = undrawn(experiment.sweep.as_ref()?);
    let search = sweep.search.as_ref()?;
    let i = (place.group * search.rungs() + place.rung) * search.candidates + place.candidate;
    let choice = choices(&sweep, experiment.seed).into_iter().nth(i);
    let (mut choice, alone) = made(experiment, choice).next()?;
    choice.names.retain(|(column, _)| column != SEED);
    Some((choice.names, alone.ok()?))
}

/// Choices, and what each makes of the experiment.
fn made(
    experiment: &Experiment,
    choices: impl IntoIterator<Item = Choice>,
) -> impl Iterator<Item = (Choice, Result<Experiment, (String, Problem)>)> {
    let mut base = experiment.to_table_as_written();
    base.remove("sweep");
    base.remove("tune");
    let plants = experiment.plants().clone();
    choices.into_iter().map(move |choice| {
        let made = choice.experiment(base.clone(), &plants);
        (choice, made)
    })
}

/// One combination of a sweep's alternatives.
#[derive(Clone, Debug, Default)]
struct Choice {
    /// What it is called, by column.
    names: Vec<(String, String)>,
    /// What it sets, by key.
    values: Vec<(String, Value)>,
    /// Candidate and rung of a search.
    candidate: Option<(usize, usize)>,
}

impl Choice {
    /// This choice and another one.
    fn and(&self, other: &Self) -> Self {
        Self {
            names: self.names.iter().chain(&other.names).cloned().collect(),
            values: self.values.iter().chain(&other.values).cloned().collect(),
            candidate: self.candidate.or(other.candidate),
        }
    }

    fn description(&self) -> String {
        let named = self.names.iter().map(|(column, name)| format!("{column} = {name}"));
        named.collect::<Vec<_>>().join(", ")
    }

    fn experiment(&self, base: Table, plants: &Plants) -> Result<Experiment, (String, Problem)> {
        let values = self.values.iter().map(|(key, value)| (key.as_str(), value.clone()));
        Experiment::with_values(base, plants, values).map_err(|(key, problem)| {
            let (trial, problem) = (self.description(), Box::new(problem));
            ("sweep".to_owned(), Problem::Trial { trial, key, problem })
        })
    }

    fn trial(&self, experiment: Experiment, columns: &[String]) -> Trial {
        let name = |column: &String| {
            let named = self.names.iter().find(|(key, _)| key == column);
            named.map_or_else(String::new, |(_, name)| name.clone())
        };
        let training = experiment.asks_for_a_net().then(|| {
            let alone = experiment.training_alone();
            // A net is the same under another name, as for the held-out loops of a tuning.
            let mut nameless = alone.clone();
            nameless.name.clear();
            (id(&nameless), alone)
        });
        Trial {
            id: id(&experiment),
            cells: columns.iter().map(name).collect(),
            experiment,
            training,
            search: self.candidate.map(|(candidate, rung)| SearchPlace {
                group: 0,
                candidate,
                rung,
            }),
        }
    }
}

/// All combinations: seeds outermost, draws innermost, candidates after rungs.
fn choices(sweep: &SweepSpec, seed: u64) -> Vec<Choice> {
    let seeds = if sweep.seeds.is_empty() { vec![seed] } else { sweep.seeds.clone() };
    // The experiment was made from TOML, which has no larger numbers.
    let number = |seed: u64| Value::Integer(i64::try_from(seed).unwrap_or(i64::MAX));
    let mut axes = vec![seeds.iter().map(|&seed| one(SEED, number(seed))).collect()];
    axes.push(sweep.cases.iter().map(case).collect());
    for axis in &sweep.grid {
        axes.push(axis.values.iter().map(|value| together(&axis.key, &axis.also, value)).collect());
    }
    axes.extend(sweep.search.as_ref().map(|search| candidates(search, seed)));
    let groups = sweep.draws.iter().zip(STREAM..);
    axes.push(groups.flat_map(|(draws, stream)| drawn(draws, seed, stream)).collect());
    let cross = |before: Vec<Choice>, axis: Vec<Choice>| match axis.is_empty() {
        true => before,
        false => before.iter().flat_map(|b| axis.iter().map(|choice| b.and(choice))).collect(),
    };
    axes.into_iter().fold(vec![Choice::default()], cross)
}

/// One value of one key.
fn one(key: &str, value: Value) -> Choice {
    let name = text(&value);
    Choice {
        names: vec![(key.to_owned(), name)],
        values: vec![(key.to_owned(), value)],
        candidate: None,
    }
}

/// One value of a key and of those beside it.
fn together(key: &str, also: &[String], value: &Value) -> Choice {
    let mut choice = one(key, value.clone());
    choice.values.extend(also.iter().map(|key| (key.clone(), value.clone())));
    choice
}

fn case(case: &crate::CaseSpec) -> Choice {
    let values = case.set.iter().map(|(key, value)| (key.clone(), value.clone())).collect();
    Choice { names: vec![(CASE.to_owned(), case.name.clone())], values, candidate: None }
}

/// The candidates of a search, on each rung of its halving.
fn candidates(search: &SearchSpec, seed: u64) -> Vec<Choice> {
    let drawn = search.drawn(seed);
    let choice = |rung: usize, candidate: usize| {
        let mut choice = Choice {
            names: vec![(CANDIDATE.to_owned(), (candidate + 1).to_string())],
            candidate: Some((candidate, rung)),
            ..Choice::default()
        };
        for (range, value) in search.ranges.iter().zip(&drawn[candidate]) {
            choice = choice.and(&together(&range.key, &range.also, value));
        }
        if let Some(halving) = &search.halving {
            let budget = Value::Integer(halving.budget(rung));
            choice = choice.and(&together(&halving.key, &halving.also, &budget));
        }
        choice
    };
    let rungs = 0..search.rungs();
    rungs
        .flat_map(|rung| (0..drawn.len()).map(move |i| (rung, i)))
        .map(|(r, i)| choice(r, i))
        .collect()
}

/// The draws of one group.
fn drawn(draws: &DrawsSpec, seed: u64, stream: u64) -> Vec<Choice> {
    let mut rng = ChaCha8Rng::seed_from_u64(draws.seed.unwrap_or(seed));
    rng.set_stream(stream);
    let mut draw = |i: usize| {
        let mut choice = Choice {
            names: vec![
                (DRAWN.to_owned(), draws.name.clone()),
                (DRAW.to_owned(), (i + 1).to_string()),
            ],
            ..Choice::default()
        };
        if draws.seeded {
            choice = choice.and(&one(NOISE_SEED, Value::Integer(rng.random::<u32>().into())));
        }
        for range in &draws.ranges {
            let value = Value::Float(range.low + (range.high - range.low) * rng.random::<f64>());
            choice = choice.and(&one(&range.key, value));
        }
        choice
    };
    (0..draws.count).map(&mut draw).collect()
}

/// A value as a cell of a table.
fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Float(number) => format!("{number:?}"),
        other => other.to_string(),
    }
}

/// What makes an experiment's numbers, as a hash.
fn id(experiment: &Experiment) -> String {
    let mut digits = experiment.normalized().fingerprint();
    digits.truncate(DIGITS);
    digits
}
