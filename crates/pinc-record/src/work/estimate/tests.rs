//! Estimates of a sweep's duration.

use super::*;

#[test]
fn trainings_are_estimated_by_their_effort_and_trials_by_their_number() {
    let mut estimate = Estimate::new(2, 10.0 + 90.0, 302.0);
    assert_eq!(estimate.seconds(), None);
    estimate.trainings.over(10.0, Duration::from_secs(60));
    assert_eq!(estimate.seconds(), None, "no trial is over yet");
    estimate.trials.over(1.0, Duration::from_millis(20));
    let left = 0.5 * (9.0 * 60.0 + 301.0 * 0.02);
    assert!((estimate.seconds().unwrap() - left).abs() < 1e-9);
    estimate.trainings.over(90.0, Duration::from_secs(540));
    (0..301).for_each(|_| estimate.trials.over(1.0, Duration::from_millis(20)));
    assert!(estimate.seconds().unwrap() < 1e-9);
    // Numerical models alone: nothing is trained.
    let mut estimate = Estimate::new(1, 0.0, 3.0);
    estimate.trials.over(1.0, Duration::from_secs(2));
    assert!((estimate.seconds().unwrap() - 4.0).abs() < 1e-9);
}

/// A process that works on as many things, and has said at `at_s` what it has done in total.
fn worker(at_s: f64, lanes: usize, [trained, trained_s, trials, trials_s]: [f64; 4]) -> WorkerNote {
    WorkerNote { at_s, lanes, trained, trained_s, trials, trials_s }
}

/// Of three processes one is silent: its work says how long others take, but it does none of
/// what is left.
#[test]
fn processes_at_work_share_what_is_left() {
    let notes = [
        worker(100.0, 2, [10.0, 50.0, 1.0, 3.0]),
        worker(110.0, 3, [20.0, 40.0, 4.0, 2.0]),
        worker(20.0, 8, [15.0, 45.0, 5.0, 5.0]),
    ];
    // Of effort 45 in 135 s, 7 are left; of 10 trials in 10 s, 30.
    let seconds = Estimate::together(&notes, 120.0, 7.0, 30.0).unwrap();
    assert!((seconds - (7.0 * 3.0 + 30.0) / 5.0).abs() < 1e-12, "{seconds}");
    // 60 s later none has said anything.
    assert_eq!(Estimate::together(&notes, 171.0, 7.0, 30.0), None);
    assert_eq!(Estimate::together(&[], 0.0, 0.0, 0.0), None);
    // Nothing is left of the trainings, of which none was done.
    let trials = [worker(0.0, 4, [0.0, 0.0, 2.0, 6.0])];
    assert_eq!(Estimate::together(&trials, 1.0, 0.0, 8.0), Some(6.0));
    assert_eq!(Estimate::together(&trials, 1.0, 0.1, 8.0), None);
}

/// A note has what this process has done; what others have done is only less to do.
#[test]
fn a_note_has_the_work_of_its_own_process() {
    let mut estimate = Estimate::new(3, 60.0, 9.0);
    estimate.trained(20.0, Duration::from_secs(4));
    estimate.ran(Duration::from_secs(1));
    estimate.ran(Duration::from_secs(2));
    (0..4).for_each(|_| estimate.found());
    assert_eq!(estimate.note(7.0), worker(7.0, 3, [20.0, 4.0, 2.0, 3.0]));
    // Effort 40 at 0.2 s each, and three trials of 1.5 s.
    assert!((estimate.seconds().unwrap() - (8.0 + 4.5) / 3.0).abs() < 1e-12);
    // Nobody at all is one.
    assert_eq!(Estimate::new(0, 0.0, 0.0).note(0.0).lanes, 1);
}

/// A net of two hidden layers of 8 that maps time, a state and an input to the state has
/// 8 (3 + 1) + 8 (8 + 1) + (8 + 1) weights, each visited at every point in every iteration.
#[test]
fn the_effort_of_a_training_is_its_visits_of_weights() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
    let phases = "training.phases=[{ optimizer = { adam = { learning_rate = 0.1 } }, iterations = 30 }, \
                  { optimizer = { adam = { learning_rate = 0.1 } }, iterations = 12 }]";
    let points = ["training.collocation_points=256", "training.initial_points=40"];
    let sets = [points[0], points[1], phases, "model.ansatz=\"direct\""];
    let load = |sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
        Experiment::load(path.as_ref(), &sets, &pinc_config::Plants::built_in()).unwrap()
    };
    let expected = f64::from((8 * 4 + 8 * 9 + 9) * (256 + 40) * (30 + 12));
    assert!((effort(&load(&sets)) - expected).abs() < 1e-6 * expected);
    // With the hard initial condition there are no initial points.
    let expected = f64::from((8 * 4 + 8 * 9 + 9) * 256 * (30 + 12));
    assert!((effort(&load(&sets[..3])) - expected).abs() < 1e-6 * expected);
    let mut untrained = load(&sets);
    untrained.training = None;
    assert!(effort(&untrained).abs() < 1e-12);
}

/// Of eight candidates four reach the second rung and two the third: a trial there is run with
/// this probability.
#[test]
fn undecided_trials_count_by_the_share_that_is_run() {
    let experiment = crate::search::tests::experiment(&[]);
    let trials = pinc_config::trials(&experiment).unwrap();
    let (now, later): (Vec<&Trial>, Vec<&Trial>) =
        trials.iter().partition(|trial| trial.search.unwrap().rung == 0);
    let expected = expected(&experiment, now.into_iter(), later.into_iter());
    assert_eq!(expected.len(), 24);
    for (trial, share) in expected {
        let wanted = [1.0, 0.5, 0.25][trial.search.unwrap().rung];
        assert!((share - wanted).abs() < 1e-12, "{:?}: {share}", trial.search);
    }
}
