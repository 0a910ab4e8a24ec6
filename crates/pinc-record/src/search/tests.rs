//! Searches.

use super::*;
use crate::metrics::Metrics;
use pinc_config::{Plants, trials};
use serde_json::json;

/// A search among eight candidates, of which four reach the second rung and two the third, with
/// some values set.
pub(crate) fn experiment(sets: &[&str]) -> Experiment {
    let config = include_str!("../../../../configs/smoke/rk4-only.toml");
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
    for (rung, order) in [[4, 0, 5, 1, 6, 2, 7, 3], [0, 3, 1, 2, 4, 5, 6, 7]].iter().enumerate() {
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
