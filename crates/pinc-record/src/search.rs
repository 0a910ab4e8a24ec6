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
pub(crate) mod tests {
    use super::*;
    use crate::metrics::Metrics;
    use pinc_config::{Plants, trials};
    use serde_json::json;

    /// A search among eight candidates, of which four reach the second rung and two the third, with
    /// some values set.
    pub(crate) fn experiment(sets: &[&str]) -> Experiment {
        let config = include_str!("../../../configs/smoke/rk4-only.toml");
        let search = "[sweep.search]\ncandidates = 8\nminimize = \"rk4_iae_dense_sum\"\n\
                      ranges = [{ key = \"control.r.0\", low = 0.1, high = 10.0 }]\n\
                      [sweep.search.halving]\nkey = \"control.repetitions\"\nleast = 1\n\
                      factor = 2\nrungs = 3\n";
        let text = format!("{config}{search}");
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        Experiment::parse("search.toml".as_ref(), &text, &sets, &Plants::built_in()).unwrap()
    }

    /// A trial that ended with this IAE.
    pub(crate) fn finished(iae: f64) -> Finished {
        let times = json!({ "mean": 1.0, "sd": 0.0, "median": 1.0, "runs": 1 });
        let step_us = json!({ "p50": 1.0, "p99": 1.0, "max": 1.0 });
        let metrics = json!({
            "experiment": "e", "preset": "ours", "variables": {},
            "control": [{
                "model": "rk4", "wall_s": times, "step_us": step_us, "sqp_iterations_mean": 1.0,
                "rmse": 0.0, "iae": iae, "rmse_dense": 0.0, "iae_dense_sum": iae, "kkt_max": 0.0,
                "input_travel": 0.0,
                "max_violation": 0.0, "status": { "converged": 20 }, "reference_start_s": [0.0],
                "offset": {}, "settle_s": [], "settled_within": {},
            }],
        });
        let metrics: Metrics = serde_json::from_value(metrics).unwrap();
        Finished { ending: Ending::Done, metrics }
    }

    /// A candidate that was dropped stays so in the rungs after, whose best are of those that are
    /// left.
    #[test]
    fn a_rung_has_the_best_of_the_rung_before() {
        let experiment = experiment(&[]);
        let trials = trials(&experiment).unwrap();
        let search = Search::of(&experiment, &trials).unwrap();
        let mut results: Vec<Option<Finished>> = trials.iter().map(|_| None).collect();
        let mut left: Vec<usize> = (0..8).collect();
        for (rung, order) in [[4, 0, 5, 1, 6, 2, 7, 3], [0, 3, 1, 2, 4, 5, 6, 7]].iter().enumerate()
        {
            for (i, trial) in trials.iter().enumerate() {
                let place = trial.search.unwrap();
                if place.rung == rung && left.contains(&place.candidate) {
                    results[i] = Some(finished(1.0 + f64::from(order[place.candidate])));
                }
            }
            left.sort_by_key(|candidate| order[*candidate]);
            left.truncate([4, 2][rung]);
            for (trial, standing) in trials.iter().zip(search.eligibility(&results)) {
                let place = trial.search.unwrap();
                if place.rung == rung + 1 {
                    let expected = match left.contains(&place.candidate) {
                        true => Eligibility::Open,
                        false => Eligibility::Dropped,
                    };
                    assert_eq!(standing, expected, "{place:?}");
                }
            }
        }
    }

    /// Results by candidate in one rung: one for each of its trials that is over.
    type Rung<'a> = &'a [&'a [Result<f64, ()>]];

    /// What the search of these trials knows after these results of its first group.
    fn results(trials: &[Trial], rungs: &[Rung<'_>]) -> Vec<Option<Finished>> {
        let mut taken: HashMap<(usize, usize), usize> = HashMap::new();
        let result = |trial: &Trial| {
            let SearchPlace { group, candidate, rung } = trial.search.unwrap();
            let next = taken.entry((rung, candidate)).or_default();
            if group > 0 {
                return None;
            }
            *next += 1;
            Some(match *rungs.get(rung)?.get(candidate)?.get(*next - 1)? {
                Ok(iae) => finished(iae),
                Err(()) => {
                    let ending = Ending::Failed { error: "it fell over".to_owned() };
                    Finished { ending, ..finished(0.001) }
                }
            })
        };
        trials.iter().map(result).collect()
    }

    /// The candidates of a group that are in a rung, or may be.
    fn standing(
        trials: &[Trial],
        eligibility: &[Eligibility],
        (group, rung): (usize, usize),
        wanted: Eligibility,
    ) -> Vec<usize> {
        let of = |(trial, standing): (&Trial, &Eligibility)| {
            let place = trial.search.unwrap();
            let is_here = (place.group, place.rung) == (group, rung) && *standing == wanted;
            is_here.then_some(place.candidate)
        };
        let mut found: Vec<usize> = trials.iter().zip(eligibility).filter_map(of).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Two seeds: the medians of the candidates are 5, 4.5, 3.75, 7, 6.25, 5.5, 7.25 and 5.1, whose
    /// order is neither that of the lower nor that of the larger values.
    const PAIRS: Rung<'static> = &[
        &[Ok(1.0), Ok(9.0)],
        &[Ok(4.0), Ok(5.0)],
        &[Ok(7.0), Ok(0.5)],
        &[Ok(2.0), Ok(12.0)],
        &[Ok(6.0), Ok(6.5)],
        &[Ok(3.0), Ok(8.0)],
        &[Ok(7.0), Ok(7.5)],
        &[Ok(5.2), Ok(5.0)],
    ];

    /// A candidate's score is the median over its trials, and a group's best say nothing of another
    /// group's.
    #[test]
    fn candidates_are_judged_by_their_medians() {
        use Eligibility::{Dropped, Open, Waiting};
        let cases = "sweep.cases=[{ name = \"a\", set = {} }, \
                     { name = \"b\", set = { \"control.n2\" = 7 } }]";
        let experiment = experiment(&["sweep.seeds=[1, 2]", cases]);
        let trials = trials(&experiment).unwrap();
        let search = Search::of(&experiment, &trials).unwrap();
        let known = results(&trials, &[PAIRS]);
        let found = search.eligibility(&known);
        assert_eq!(standing(&trials, &found, (0, 1), Open), [0, 1, 2, 7]);
        assert_eq!(standing(&trials, &found, (0, 1), Dropped), [3, 4, 5, 6]);
        assert_eq!(standing(&trials, &found, (0, 2), Waiting), [0, 1, 2, 7]);
        assert_eq!(standing(&trials, &found, (0, 2), Dropped), [3, 4, 5, 6]);
        let all: Vec<usize> = (0..8).collect();
        assert_eq!(standing(&trials, &found, (1, 0), Open), all);
        assert_eq!(standing(&trials, &found, (1, 1), Waiting), all);
        let best = search.best(&known).unwrap();
        assert!((best.score - 3.75).abs() < 1e-12, "{best:?}");
        let place = trials[best.trial].search.unwrap();
        assert_eq!((place.group, place.candidate, place.rung), (0, 2, 0));

        // As long as one trial is not over, nothing is decided, and its candidate is not the best.
        let mut pairs = PAIRS.to_vec();
        pairs[2] = &[Ok(7.0)];
        let known = results(&trials, &[&pairs]);
        let found = search.eligibility(&known);
        assert_eq!(standing(&trials, &found, (0, 1), Waiting), all);
        let best = search.best(&known).unwrap();
        assert!((best.score - 4.5).abs() < 1e-12, "{best:?}");
    }

    /// A candidate of which one trial failed is as bad as can be: it goes on nowhere, even if fewer
    /// are left than there are places.
    #[test]
    fn a_candidate_that_failed_goes_on_nowhere() {
        let experiment = experiment(&["sweep.seeds=[1, 2]"]);
        let trials = trials(&experiment).unwrap();
        let search = Search::of(&experiment, &trials).unwrap();
        let mut pairs = vec![&[Ok(1.0), Err(())][..]; 8];
        pairs[3] = &[Ok(f64::INFINITY), Ok(1.0)];
        pairs[5] = &[Ok(30.0), Ok(40.0)];
        pairs[6] = &[Ok(20.0), Ok(10.0)];
        let known = results(&trials, &[&pairs]);
        let found = search.eligibility(&known);
        assert_eq!(standing(&trials, &found, (0, 1), Eligibility::Open), [5, 6]);
        let best = search.best(&known).unwrap();
        assert!((best.score - 15.0).abs() < 1e-12, "{best:?}");
        // Where all failed, none is best.
        let known = results(&trials, &[&[&[Err(()), Err(())][..]; 8][..]]);
        assert_eq!(search.best(&known), None);
        assert_eq!(search.best(&vec![None; trials.len()]), None);
    }

    /// The best is looked for among those with the largest budget that one has had in full, though
    /// scores were lower with less; of equal ones it is the first.
    #[test]
    fn the_best_has_had_the_largest_budget() {
        let experiment = experiment(&[]);
        let trials = trials(&experiment).unwrap();
        let search = Search::of(&experiment, &trials).unwrap();
        let first: [[Result<f64, ()>; 1]; 8] = std::array::from_fn(|i| [Ok(1.0 + i as f64)]);
        let first = first.each_ref().map(|of| &of[..]);
        let second: Rung<'_> = &[&[Ok(30.0)], &[Ok(20.0)], &[Ok(20.0)], &[Err(())]];
        let known = results(&trials, &[&first, second]);
        let best = search.best(&known).unwrap();
        assert!((best.score - 20.0).abs() < 1e-12, "{best:?}");
        let place = trials[best.trial].search.unwrap();
        assert_eq!((place.candidate, place.rung), (1, 1));
        // Equal ones: the first two of them reach the last rung.
        let second: Rung<'_> = &[&[Ok(20.0)][..]; 4];
        let found = search.eligibility(&results(&trials, &[&first, second]));
        assert_eq!(standing(&trials, &found, (0, 2), Eligibility::Open), [0, 1]);
    }
}
