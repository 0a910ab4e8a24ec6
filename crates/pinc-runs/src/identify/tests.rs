use super::{RecordedRow, filled};
use std::path::Path;

/// Steps of 0.1 s of Unix times: a double has these to 2.4e-7 s only.
#[test]
fn times_are_whole_steps_apart_as_far_as_doubles_tell() {
    let row =
        |t: f64| RecordedRow { t, u: vec![0.0], known: Vec::new(), y: vec![1.0], truth: None };
    let rows = |times: &[f64]| (2..).zip(times.iter().map(|t| row(*t))).collect();
    let path = Path::new("times.csv");
    let times = [1700000000.0, 1700000000.1, 1700000000.2, 1700000007.3, 1700000017.5];
    let whole = filled(path, &rows(&times), 0.1).unwrap();
    assert_eq!(whole.t.len(), 176);
    // T as the shortest step in the data has it.
    let whole = filled(path, &rows(&times), times[1] - times[0]).unwrap();
    assert_eq!(whole.t.len(), 176);
    for apart in
        [[1700000000.0, 1700000000.1002], [0.0, 0.100001], [0.0, 1e-9], [1.7e9, 1.7e9 + 0.04]]
    {
        assert!(filled(path, &rows(&apart), 0.1).is_err(), "{apart:?}");
    }
    assert!(filled(path, &rows(&[0.0, 0.4]), 0.1).is_ok());
}
