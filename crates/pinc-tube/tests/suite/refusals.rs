//! Refused tubes, and errors that are not numbers.

use pinc_ode::{Dims, Stages};
use pinc_tube::{
    AlongPlan, BackOffs, EllipsoidTube, Feedback, Interval, Sources, StageError, Tube, TubeError,
};

const DIMS: Dims = Dims::new(1, 1);

fn tube(sources: Sources, feedback: Feedback) -> Result<EllipsoidTube, TubeError> {
    let units = vec![2.0];
    EllipsoidTube::new((DIMS, 1), sources, None, feedback, units)
}

#[test]
fn wrong_sources_are_refused_by_name() {
    let none = Sources::default;
    for (sources, expected) in [
        (Sources { process_sd: vec![0.1], ..none() }, "needs a probability"),
        (Sources { estimate: true, ..none() }, "needs a probability"),
        (Sources { boxes: vec![0.1; 2], ..none() }, "boxes has 2 numbers, but must have 1"),
        (Sources { boxes: vec![-0.1], ..none() }, "boxes has -0.1, but must be 0 or more"),
        (Sources { probability: Some(0.4), ..none() }, "probability has 0.4"),
        (
            Sources { parameters: vec![Interval { place: 0, low: 0.0, high: 1.0 }], ..none() },
            "need a model",
        ),
    ] {
        let refused = tube(sources, Feedback::None).unwrap_err().to_string();
        assert!(refused.contains(expected), "{refused}");
    }
    let refused = tube(none(), Feedback::Given(vec![1.0; 2])).unwrap_err().to_string();
    assert!(refused.contains("feedback has 2 numbers, but must have 1"), "{refused}");
}

#[derive(Debug)]
struct Broken;

impl StageError for Broken {
    fn write(&mut self, _: &[f64], _: &[f64], _: &[f64], error: &mut [f64]) {
        error[0] = f64::NAN;
    }
}

#[test]
fn an_error_that_is_no_number_counts_as_a_large_one() {
    let sources = Sources { error: Some(Box::new(Broken)), ..Sources::default() };
    let mut tube = tube(sources, Feedback::None).unwrap();
    let mut found = BackOffs { states: vec![0.0], inputs: vec![0.0], ..BackOffs::default() };
    let plan = Stages { x: &[0.0], u: &[0.0], p: &[] };
    tube.write(AlongPlan::new(plan, [&[1.0], &[1.0]], DIMS, 0), &mut found);
    assert!((found.states[0] - 2000.0).abs() < 1e-9, "{found:?}");
}

/// The covariance of the state counts only where the estimate is a source: 1.2816 standard deviations
/// of 2 at 90 %.
#[test]
fn a_covariance_that_is_no_source_widens_nothing() {
    for (estimate, expected) in [(true, 2.563_103), (false, 0.0)] {
        let sources = Sources { probability: Some(0.9), estimate, ..Sources::default() };
        let mut tube = tube(sources, Feedback::None).unwrap();
        tube.set_covariance(&[4.0]);
        let mut found = BackOffs { states: vec![0.0], inputs: vec![0.0], ..BackOffs::default() };
        let plan = Stages { x: &[0.0], u: &[0.0], p: &[] };
        tube.write(AlongPlan::new(plan, [&[1.0], &[1.0]], DIMS, 0), &mut found);
        assert!((found.states[0] - expected).abs() < 1e-5, "{found:?}");
    }
}
