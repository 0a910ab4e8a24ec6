use super::Progress;
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
