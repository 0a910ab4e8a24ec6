//! Who is still in a search, judged by the results that are there.

use crate::sweep_dir::{Ending, Finished};
use crate::tables::TrialMetric;
use pinc_config::{Experiment, SearchPlace, SearchSpec, Trial};
use std::collections::HashMap;

/// Whether a trial of a sweep is to be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Eligibility {
    /// It is, or was.
    Open,
    /// That depends on others, which are not over.
    Waiting,
    /// Its candidate is not among the best of the rung before.
    Dropped,
}

/// A search with its trials by group, rung and candidate.
#[derive(Debug)]
pub struct Search<'a> {
    spec: &'a SearchSpec,
    metric: TrialMetric,
    trials: usize,
    /// The trials of each candidate, by rung, by group.
    groups: Vec<Vec<Vec<Vec<usize>>>>,
}

/// The best candidate of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Best {
    /// The place of its first trial.
    pub trial: usize,
    /// The median of what is to be small.
    pub score: f64,
}

impl<'a> Search<'a> {
    /// The search of an experiment; none if it has none, or no metric of that name.
    #[must_use]
    pub fn of(experiment: &'a Experiment, trials: &[Trial]) -> Option<Self> {
        let spec = experiment.sweep.as_ref()?.search.as_ref()?;
        let metric = TrialMetric::searched(experiment).ok()??;
        let mut groups: Vec<Vec<Vec<Vec<usize>>>> = Vec::new();
        for (i, trial) in trials.iter().enumerate() {
            let Some(SearchPlace { group, candidate, rung }) = trial.search else { continue };
            while groups.len() <= group {
                groups.push(vec![vec![Vec::new(); spec.candidates]; spec.rungs()]);
            }
            groups[group][rung][candidate].push(i);
        }
        Some(Self { spec, metric, trials: trials.len(), groups })
    }

    /// How each trial stands, when these are over.
    #[must_use]
    pub fn eligibility(&self, results: &[Option<Finished>]) -> Vec<Eligibility> {
        let mut eligibility = vec![Eligibility::Open; self.trials];
        for group in &self.groups {
            let mut left: Vec<usize> = (0..self.spec.candidates).collect();
            let mut known = true;
            for (rung, candidates) in group.iter().enumerate() {
                for (candidate, trials) in candidates.iter().enumerate() {
                    let of_candidate = match (left.contains(&candidate), known) {
                        (false, _) => Eligibility::Dropped,
                        (true, true) => Eligibility::Open,
                        (true, false) => Eligibility::Waiting,
                    };
                    trials.iter().for_each(|&trial| eligibility[trial] = of_candidate);
                }
                if known {
                    match self.best_of(candidates, &left, rung + 1, results) {
                        Some(best) => left = best,
                        None => known = false,
                    }
                }
            }
        }
        eligibility
    }

    /// Returns the candidates `left` that reach a rung; none as long as one is not over.
    fn best_of(
        &self,
        candidates: &[Vec<usize>],
        left: &[usize],
        rung: usize,
        results: &[Option<Finished>],
    ) -> Option<Vec<usize>> {
        let halving = self.spec.halving.as_ref()?;
        let scores = left.iter().map(|&i| Some((self.score(&candidates[i], results)?, i)));
        let mut scores: Vec<(f64, usize)> = scores.collect::<Option<_>>()?;
        // The first of equal ones.
        scores.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        scores.retain(|(score, _)| score.is_finite());
        scores.truncate(halving.survivors(self.spec.candidates, rung));
        Some(scores.into_iter().map(|(_, i)| i).collect())
    }

    /// The median over a candidate's trials, infinite if one failed; none as long as one is not
    /// over.
    fn score(&self, trials: &[usize], results: &[Option<Finished>]) -> Option<f64> {
        let mut values = Vec::new();
        for &trial in trials {
            let finished = results[trial].as_ref()?;
            let value = self.metric.cell(&finished.metrics).and_then(|cell| cell.parse().ok());
            values.push(match (&finished.ending, value) {
                (Ending::Done, Some(value)) if f64::is_finite(value) => value,
                _ => return Some(f64::INFINITY),
            });
        }
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        match values.len() % 2 {
            0 if values.is_empty() => None,
            0 => Some(f64::midpoint(values[middle - 1], values[middle])),
            _ => Some(values[middle]),
        }
    }

    /// The best candidate of those with the largest budget that any one has had in full.
    #[must_use]
    pub fn best(&self, results: &[Option<Finished>]) -> Option<Best> {
        let mut scored: HashMap<usize, Vec<Best>> = HashMap::new();
        for group in &self.groups {
            for (rung, candidates) in group.iter().enumerate() {
                let of = |trials: &Vec<usize>| {
                    let score = self.score(trials, results).filter(|score| score.is_finite())?;
                    Some(Best { trial: *trials.first()?, score })
                };
                scored.entry(rung).or_default().extend(candidates.iter().filter_map(of));
            }
        }
        let rung = (0..self.spec.rungs())
            .rev()
            .find(|rung| scored.get(rung).is_some_and(|scored| !scored.is_empty()))?;
        let better = |a: &&Best, b: &&Best| a.score.total_cmp(&b.score).then(a.trial.cmp(&b.trial));
        scored.get(&rung)?.iter().min_by(better).copied()
    }
}

#[cfg(test)]
pub(crate) mod tests;
