//! Metrics and trajectories, on examples worked out by hand.

use pinc_ode::metrics::{Tracking, mean_squared_error};
use pinc_ode::{Dims, Trajectory};

/// Everything here takes a handful of operations on numbers of order 1 to 10.
#[track_caller]
fn assert_close(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-14, "{value}, expected {expected}");
}

/// Absolute errors: output 1: 1, 0, 2; output 2: 2, 1, 4.
fn example() -> Tracking {
    let mut tracking = Tracking::new(2);
    tracking.push(&[1.0, 10.0], &[0.0, 12.0]);
    tracking.push(&[2.0, 10.0], &[2.0, 9.0]);
    tracking.push(&[3.0, 10.0], &[5.0, 14.0]);
    tracking
}

#[test]
fn absolute_errors_in_both_readings() {
    // Summed over outputs: 3 + 7; averaged over the two outputs: 5.
    assert_close(example().iae_sum(), 10.0);
    assert_close(example().iae_mean(), 5.0);
}

#[test]
fn root_mean_square_is_averaged_over_outputs() {
    // Squares: 1 + 0 + 4 and 4 + 1 + 16, three samples each.
    let expected = ((5.0f64 / 3.0).sqrt() + 7.0f64.sqrt()) / 2.0;
    assert_close(example().rmse(), expected);
}

/// Sampled at steps, or on a dense trace with one more sample between two: the IAE grows with the
/// number of samples, which is why the two readings differ, the RMSE does not.
#[test]
fn steps_and_dense_trace() {
    let error = |t: f64| 2.0 - t;
    let track = |times: &[f64]| {
        let mut tracking = Tracking::new(1);
        times.iter().for_each(|&t| tracking.push(&[2.0], &[2.0 + error(t)]));
        tracking
    };
    let (steps, dense) = (track(&[0.0, 1.0, 2.0]), track(&[0.0, 0.5, 1.0, 1.5, 2.0]));
    assert_close(steps.iae_sum(), 3.0);
    assert_close(dense.iae_sum(), 5.0);
    assert_close(steps.rmse(), (5.0f64 / 3.0).sqrt());
    assert_close(dense.rmse(), (7.5f64 / 5.0).sqrt());
}

#[test]
fn errors_of_opposite_sign_do_not_cancel() {
    let mut tracking = Tracking::new(1);
    tracking.push(&[0.0], &[3.0]);
    tracking.push(&[0.0], &[-3.0]);
    assert_close(tracking.iae_sum(), 6.0);
    assert_close(tracking.rmse(), 3.0);
}

#[test]
fn no_samples_and_nan() {
    assert_close(Tracking::new(2).iae_sum(), 0.0);
    assert!(Tracking::new(2).rmse().is_nan());
    let mut tracking = Tracking::new(1);
    tracking.push(&[0.0], &[f64::NAN]);
    assert!(tracking.iae_sum().is_nan() && tracking.rmse().is_nan());
}

#[test]
#[should_panic(expected = "one number per output")]
fn sample_of_another_width_is_a_programming_error() {
    Tracking::new(2).push(&[1.0, 2.0], &[1.0]);
}

#[test]
fn mean_squared_errors() {
    let (predicted, truth) = ([1.0, 2.0, 3.0, 4.0], [0.0, 2.0, 1.0, 8.0]);
    // Physical units, squares 1, 0, 4, 16; with the second output in units of 2: 1, 0, 4, 4.
    assert_close(mean_squared_error(&predicted, &truth, &[1.0, 1.0]), 5.25);
    assert_close(mean_squared_error(&predicted, &truth, &[1.0, 2.0]), 2.25);
    assert!(mean_squared_error(&[], &[], &[1.0]).is_nan());
    assert!(mean_squared_error(&[f64::NAN], &[0.0], &[1.0]).is_nan());
}

#[test]
#[should_panic(expected = "one scale per output")]
fn scale_that_does_not_divide_the_samples_is_a_programming_error() {
    let _ = mean_squared_error(&[1.0, 2.0, 3.0], &[0.0; 3], &[1.0, 1.0]);
}

#[test]
#[should_panic(expected = "one scale per output")]
fn no_scale_is_a_programming_error() {
    let _ = mean_squared_error(&[1.0], &[0.0], &[]);
}

#[test]
#[should_panic(expected = "as many predictions as truths")]
fn unequal_lengths_are_a_programming_error() {
    let _ = mean_squared_error(&[1.0, 2.0], &[0.0], &[1.0]);
}

#[test]
fn trajectory_gives_back_its_samples() {
    let dims = Dims::new(2, 1);
    let mut trajectory = Trajectory::new(dims);
    assert!(trajectory.is_empty());
    trajectory.push(0.0, &[1.0, 2.0], &[5.0]);
    trajectory.push(0.5, &[3.0, 4.0], &[6.0]);
    assert_eq!((trajectory.len(), trajectory.is_empty(), trajectory.dims()), (2, false, dims));
    assert_eq!(trajectory.times(), [0.0, 0.5]);
    assert_eq!((trajectory.state(0), trajectory.input(0)), (&[1.0, 2.0][..], &[5.0][..]));
    assert_eq!((trajectory.state(1), trajectory.input(1)), (&[3.0, 4.0][..], &[6.0][..]));
}

#[test]
#[should_panic(expected = "dimensions")]
fn sample_of_other_dimensions_is_a_programming_error() {
    Trajectory::new(Dims::new(2, 1)).push(0.0, &[1.0, 2.0], &[]);
}
