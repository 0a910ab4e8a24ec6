use super::{Progress, span};
use pinc_record::Ending;
use pinc_record::work::Estimate;
use pinc_runs::progress::Verbosity;
use std::time::Duration;

#[test]
fn trials_that_failed_are_counted() {
    let mut progress = Progress::begin(Verbosity::Quiet, 4, 3, Estimate::new(1, 0.0, 3.0));
    let failed = || Ending::Failed { error: "a reason".to_owned() };
    progress.finished(&Ending::Done, Duration::ZERO);
    assert_eq!((progress.left, progress.failed), (2, 0));
    progress.found(&failed());
    progress.finished(&failed(), Duration::ZERO);
    assert_eq!((progress.left, progress.failed), (0, 2));
    assert!(progress.message().starts_with("2 failed"), "{}", progress.message());
}

/// The unit is the one in which the number has two or three digits.
#[test]
fn spans_of_time_are_said_in_a_unit_that_suits_them() {
    for (seconds, said) in [
        (0.4, "0 s"),
        (99.4, "99 s"),
        (100.0, "2 min"),
        (5999.0, "100 min"),
        (6000.0, "1.7 h"),
        (86_400.0, "24.0 h"),
    ] {
        assert_eq!(span(seconds), said);
    }
}

/// Writing tables takes a fiftieth of the time at most, and is done every 10 s at most.
#[test]
fn tables_are_written_less_often_the_longer_they_take() {
    let mut progress = Progress::begin(Verbosity::Quiet, 4, 4, Estimate::new(2, 0.0, 4.0));
    assert_eq!(progress.pause(), Duration::from_secs(10));
    progress.wrote_tables(Duration::from_millis(20));
    assert_eq!(progress.pause(), Duration::from_secs(10));
    progress.wrote_tables(Duration::from_secs(3));
    assert_eq!(progress.pause(), Duration::from_secs(150));
}

/// What is left is said once the time of a trial is known: two at a time, of 30 s each.
#[test]
fn the_time_left_follows_from_trials_that_are_over() {
    let mut progress = Progress::begin(Verbosity::Quiet, 9, 9, Estimate::new(2, 0.0, 9.0));
    assert_eq!(progress.message(), "");
    progress.finished(&Ending::Done, Duration::from_secs(30));
    assert_eq!(progress.message(), "about 2 min left");
    progress.dropped(6);
    assert_eq!(progress.left, 2);
    progress.dropped(6);
    assert_eq!(progress.left, 0);
    let note = progress.note();
    assert_eq!((note.lanes, note.trials.to_bits()), (2, 1.0_f64.to_bits()));
    progress.error = Some(pinc_runs::RunError::Failed("it fell over".to_owned()));
    assert_eq!(progress.end().unwrap_err().to_string(), "it fell over");
}
