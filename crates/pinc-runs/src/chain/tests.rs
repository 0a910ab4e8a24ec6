//! Rows of a chain in any order of their times.

use super::*;

/// y = 2 y0 + 100 u t: not a flow, so that every place where a chain is taken up shows.
fn net(t: f64, y0: &[f64], u: &[f64]) -> Vec<f64> {
    vec![2.0 * y0[0] + 100.0 * u[0] * t]
}

fn values(chain: &mut Chain, rows: &[(f64, f64)]) -> Vec<(f64, bool)> {
    let rows = rows.iter();
    rows.map(|&(t, u)| {
        let sample = chain.advance(&mut net, t, &[u]);
        (sample.state[0], sample.mark)
    })
    .collect()
}

#[test]
fn on_the_grid_the_net_is_chained() {
    let mut chain = Chain::new(0.5, 0.0, &[1.0], &[0.0]);
    // At 0.25 the input is still 0; at 0.5 the state is 2, and the input becomes 1.
    let rows = [(0.25, 0.0), (0.5, 1.0), (0.75, 1.0), (1.0, 1.0), (2.0, 1.0)];
    let expected = [(2.0, false), (2.0, true), (29.0, false), (54.0, true), (366.0, true)];
    assert_eq!(values(&mut chain, &rows), expected);
}

#[test]
fn an_input_that_changes_within_an_interval_restarts_the_chain() {
    let mut chain = Chain::new(0.5, 10.0, &[1.0], &[0.0]);
    // Restart at 10.25 from 2, with u = 1: the marks are then 10.75, 11.25, ..
    let rows = [(10.25, 1.0), (10.5, 1.0), (10.75, 1.0)];
    let expected = [(2.0, false), (29.0, false), (54.0, true)];
    assert_eq!(values(&mut chain, &rows), expected);
}

#[test]
fn marks_are_found_after_many_steps() {
    let mut chain = Chain::new(0.1, 0.0, &[0.0], &[0.0]);
    for k in 1..=2000 {
        let sample = chain.advance(&mut net, f64::from(k) * 0.1, &[0.0]);
        assert!(sample.mark, "step {k}");
    }
}

/// In seconds since 1970, T = 0.1 s is 4e5 units in the last place of t.
#[test]
fn times_of_a_clock_are_counted_from_the_first_row() {
    let offsets = [0.05, 0.1, 0.15, 0.2, 0.3, 0.31, 0.4, 0.5];
    let at = |first: f64| {
        let mut chain = Chain::new(0.1, first, &[1.0], &[0.01]);
        offsets.map(|offset| {
            let sample = chain.advance(&mut net, first + offset, &[0.01]);
            (sample.state[0], sample.mark)
        })
    };
    for first in [1e4, 1e8, 1_764_200_000.3] {
        for ((found, mark), expected) in at(first).into_iter().zip(at(0.0)) {
            // The times are rounded to 2.4e-7 s, which the net takes times 100 u = 1.
            assert!((found - expected.0).abs() < 1e-6, "{first}: {found}, not {}", expected.0);
            assert_eq!(mark, expected.1, "{first}");
        }
    }
}
