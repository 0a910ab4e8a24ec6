use super::*;

#[test]
fn a_step_is_beyond_its_tolerance_if_one_state_is() {
    let tolerance = vec![0.1, f64::INFINITY, 1.0];
    let mut log = ErrorLog { tolerance, largest: vec![0.0; 3], ..ErrorLog::default() };
    let mut is_within = |last: [f64; 3]| {
        log.last = last.to_vec();
        log.add()
    };
    assert!(is_within([0.05, 50.0, -1.0]));
    assert!(!is_within([-0.2, 0.0, 0.0]));
    assert!(!is_within([0.0, 0.0, 1.5]));
    assert!(!is_within([0.0, 0.0, f64::NAN]));
    let metrics = log.metrics(&["a", "b", "c"].map(str::to_owned));
    assert_eq!((metrics.steps, metrics.beyond), (4, 3));
    let named = |values: [f64; 2]| ["a", "c"].map(str::to_owned).into_iter().zip(values);
    assert!(metrics.largest.into_iter().eq(named([0.2, f64::INFINITY])));
    assert!(metrics.tolerance.into_iter().eq(named([0.1, 1.0])));
}
