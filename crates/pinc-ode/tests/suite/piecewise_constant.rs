//! Piecewise-constant signals: boundaries, rounding and what is refused.

use pinc_ode::{OdeError, PiecewiseConstant};

fn staircase(starts: Vec<f64>) -> PiecewiseConstant {
    let values = (0..starts.len()).map(|k| vec![level(k)]).collect();
    PiecewiseConstant::new(starts, values).unwrap()
}

fn level(k: usize) -> f64 {
    f64::from(u32::try_from(k).unwrap())
}

#[track_caller]
fn assert_level(signal: &PiecewiseConstant, t: f64, k: usize) {
    assert_eq!(signal.at(t), [level(k)], "at {t:e} s");
}

/// k T is meant to be the start of step k, however k T and the start came about.
#[test]
fn multiples_of_the_step_are_starts() {
    for step in [0.1, 0.5, 10.0] {
        let products: Vec<_> = (0..5000).map(|k| level(k) * step).collect();
        let sums: Vec<_> =
            (0..5000).scan(0.0, |t, _| Some(std::mem::replace(t, *t + step))).collect();
        for starts in [&products, &sums] {
            let signal = staircase(starts.clone());
            for k in 0..5000 {
                assert_level(&signal, products[k], k);
                assert_level(&signal, sums[k], k);
                assert_level(&signal, (level(k) + 0.5) * step, k);
                assert_level(&signal, (level(k) + 0.999) * step, k);
            }
        }
    }
}

/// Times that are not starts but for rounding belong to the step they are in.
#[test]
fn just_before_a_start_is_before_it() {
    let signal = staircase(vec![0.0, 0.5, 1.0]);
    for (t, k) in [(0.5 - 1e-8, 0), (0.5 - 1e-12, 1), (0.5, 1), (1.0 - 1e-7, 1), (1.0, 2)] {
        assert_level(&signal, t, k);
    }
}

/// Steps of 1 ms stay apart after 1e7 s, where a double is exact to 2 ns; so does a start by
/// itself.
#[test]
fn late_short_steps_are_distinguished() {
    let late = 1e7;
    let starts = [0.0].into_iter().chain((0..100).map(|k| late + level(k) * 1e-3)).collect();
    let signal = staircase(starts);
    assert_level(&signal, late - 1e-3, 0);
    for k in 0..100 {
        assert_level(&signal, late + level(k) * 1e-3, k + 1);
        assert_level(&signal, late + (level(k) + 0.99) * 1e-3, k + 1);
    }
    assert_level(&signal, late + (0.1 + 0.2) * 1e-3 * 10.0, 4);
}

#[test]
fn first_and_last_values_hold_beyond_the_ends() {
    let signal = staircase(vec![0.0, 2.0]);
    assert_level(&signal, -1.0, 0);
    assert_level(&signal, 1e9, 1);
    assert_level(&signal, f64::INFINITY, 1);
    let constant = PiecewiseConstant::new(vec![0.0], vec![vec![4.0, 5.0]]).unwrap();
    assert_eq!(constant.width(), 2);
    assert_eq!(constant.at(0.0), [4.0, 5.0]);
}

#[track_caller]
fn assert_refused(starts: &[f64], values: &[&[f64]], why: &str) {
    let values = values.iter().map(|v| v.to_vec()).collect();
    let error = PiecewiseConstant::new(starts.to_vec(), values).unwrap_err();
    let OdeError::PiecewiseConstant { reason } = &error else {
        panic!("{error:?}");
    };
    assert_eq!(*reason, why);
    assert!(error.to_string().ends_with(why), "{error}");
}

#[test]
fn what_is_no_signal() {
    let first = "the first start time is not 0";
    assert_refused(&[], &[], first);
    assert_refused(&[1.0], &[&[1.0]], first);
    assert_refused(&[f64::NAN], &[&[1.0]], first);
    let count = "there are not as many values as start times";
    assert_refused(&[0.0], &[], count);
    assert_refused(&[0.0], &[&[1.0], &[2.0]], count);
    let order = "the start times do not increase";
    assert_refused(&[0.0, 0.0], &[&[1.0], &[2.0]], order);
    assert_refused(&[0.0, 2.0, 1.0], &[&[1.0], &[2.0], &[3.0]], order);
    assert_refused(&[0.0, f64::NAN], &[&[1.0], &[2.0]], order);
    assert_refused(&[0.0, f64::INFINITY], &[&[1.0], &[2.0]], order);
    let width = "the values are of different lengths";
    assert_refused(&[0.0, 1.0], &[&[1.0], &[2.0, 3.0]], width);
    let finite = "a value is not finite";
    assert_refused(&[0.0], &[&[f64::NAN]], finite);
    assert_refused(&[0.0, 1.0], &[&[1.0], &[f64::INFINITY]], finite);
}
