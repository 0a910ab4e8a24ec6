//! Ledgers of a sweep.

use super::*;
use crate::search::tests::{experiment, finished};
use pinc_config::trials;

/// A trial that ended with an error.
fn failed() -> Finished {
    Finished { ending: Ending::Failed { error: "it fell over".to_owned() }, ..finished(1.0) }
}

/// A trial that ended as it should, in whose loop a bound was broken by this share.
fn broken(share: f64, hard: bool) -> Finished {
    let mut finished = finished(2.0);
    finished.metrics.control[0].violations = vec![ViolationMetrics {
        of: "h".to_owned(),
        unit: "cm".to_owned(),
        side: "high".to_owned(),
        bound: 1.0,
        hard,
        amount: share,
        time_s: 1.0,
        at_steps: share,
        share,
        from_step: 1,
    }];
    finished
}

/// Each trial is counted once: over or not, failed or not, dropped by the search or not; bounds
/// count in loops of trials that are done, soft ones too, if it is visible.
#[test]
fn trials_are_counted_by_how_they_stand() {
    let experiment = experiment(&[]);
    let trials = trials(&experiment).unwrap();
    let mut ledger = Ledger::new(&experiment, &trials);
    assert_eq!(ledger.counts().pending(), 24);
    let first: Vec<&Trial> =
        trials.iter().filter(|trial| trial.search.unwrap().rung == 0).collect();
    assert_eq!(first.len(), 8);
    // Two fail, one of them with a broken bound, which counts for nothing.
    let of = |i: usize| match i {
        0 => failed(),
        1 => Finished { ending: failed().ending, ..broken(0.1, true) },
        2 => broken(0.1, true),
        3 => broken(0.1, false),
        4 => broken(0.9e-4, true),
        _ => finished(3.0 + i as f64),
    };
    first.iter().enumerate().for_each(|(i, trial)| ledger.note(trial, &of(i)));
    let counts = ledger.counts();
    assert_eq!((counts.trials, counts.done, counts.failed), (24, 6, 2));
    // Four of eight candidates go on; the others have a trial in two rungs each.
    assert_eq!((counts.dropped, counts.pending()), (8, 8));
    let bounds = BrokenBounds { model: ModelKind::RK4, trials: 2 };
    assert_eq!(counts.broken_bounds, [bounds]);
    let best = ledger.best().unwrap();
    assert!(ledger.knows(&trials[best.trial]) && (best.score - 2.0).abs() < 1e-12);
    // A trial of a dropped candidate that was run all the same is no dropped one.
    let standing = ledger.eligibility();
    let i = standing.iter().position(|of| *of == Eligibility::Dropped).unwrap();
    assert!(!ledger.knows(&trials[i]));
    ledger.note(&trials[i], &finished(1.0));
    let counts = ledger.counts();
    assert_eq!((counts.done, counts.dropped, counts.pending()), (7, 7, 8));
}

/// All candidates draw the only value, so that a rung has one trial eight times: it is over for
/// all at once, and is run as long as one of the candidates is in.
#[test]
fn equal_trials_are_one() {
    let range = "sweep.search.ranges=[{ key = \"control.n2\", values = [6] }]";
    let experiment = experiment(&[range]);
    let trials = trials(&experiment).unwrap();
    let mut ledger = Ledger::new(&experiment, &trials);
    let (first, others): (Vec<&Trial>, Vec<&Trial>) =
        trials.iter().partition(|trial| trial.search.unwrap().rung == 0);
    assert!(first.iter().all(|trial| trial.id == first[0].id));
    ledger.note(first[5], &finished(4.0));
    assert!(first.iter().all(|trial| ledger.knows(trial)));
    assert!(!others.iter().any(|trial| ledger.knows(trial)));
    assert_eq!(ledger.counts().done, 8);
    let of_second = others.iter().find(|trial| trial.search.unwrap().rung == 1).unwrap();
    let standing = ledger.eligibility_by_id();
    assert_eq!(standing[of_second.id.as_str()], Eligibility::Open);
    assert_eq!(ledger.counts().dropped, 8);
}

/// What is in a directory is taken up, but for what is known already.
#[test]
fn a_directory_adds_what_was_not_known() {
    let experiment = experiment(&[]);
    let trials = trials(&experiment).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let sweep_dir = SweepDir::of(dir.path());
    for (trial, iae) in [(&trials[0], 5.0), (&trials[1], 6.0)] {
        sweep_dir.begin(&trial.id).unwrap();
        sweep_dir.finish(&trial.id, &finished(iae)).unwrap();
    }
    let mut ledger = Ledger::new(&experiment, &trials);
    ledger.note(&trials[0], &failed());
    ledger.look_up(&sweep_dir).unwrap();
    assert_eq!(ledger.results()[0], Some(failed()));
    assert_eq!(ledger.results()[1], Some(finished(6.0)));
    assert!(ledger.results()[2..].iter().all(Option::is_none));
    assert_eq!(ledger.counts().trials, 24);
}
