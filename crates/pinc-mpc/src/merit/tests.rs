use super::*;
use pinc_qp::{ChosenQp, OcpDims, QpMethod, QpSolver, QpStatus};

/// A program that starts outside everything: off its dynamics, a bound, an increment, a hard
/// row, and three soft ones, of which two cannot be met at their prices.
fn program() -> Qp {
    let dims = OcpDims { inequalities: 2, ..OcpDims::new(1, 1, 2) };
    let mut qp = Qp::new(dims, vec![2.0, 3.0], vec![1.0, 0.5]);
    (qp.a, qp.b, qp.c) = (vec![0.9, 1.2], vec![0.5, 0.8], vec![0.3, -0.4]);
    qp.gradient = vec![0.5, -1.0, 0.7, 0.2];
    (qp.bounds.low[0], qp.bounds.high[2]) = (0.1, 3.0);
    (qp.bounds.low[1], qp.bounds.penalty[1]) = (3.0, 0.2);
    qp.increments.low[1] = 0.05;
    qp.rows_x = vec![1.0, 0.5, -1.0, 0.0];
    qp.rows_u = vec![0.0, 1.0, 0.3, 1.0];
    qp.rows.high = vec![2.0, -0.2, -0.1, -4.0];
    qp.rows.penalty = vec![f64::INFINITY, 5.0, f64::INFINITY, 0.3];
    qp
}

/// The program at `t` of the step, whose gradient does not matter.
fn moved(qp: &Qp, step: &QpStep, t: f64) -> Qp {
    let mut moved = qp.clone();
    moved.c.iter_mut().for_each(|c| *c *= 1.0 - t);
    let d = &step.d;
    for (limits, values) in [
        (&mut moved.bounds, d.clone()),
        (&mut moved.increments, vec![d[2], d[3] - d[2]]),
        (&mut moved.rows, (0..4).map(|r| qp.rows_x[r] * d[r / 2] + qp.rows_u[r] * d[3]).collect()),
    ] {
        for (i, value) in values.iter().enumerate() {
            limits.low[i] -= t * value;
            limits.high[i] -= t * value;
        }
    }
    moved
}

#[test]
fn the_slope_matches_the_function() {
    let qp = program();
    let mut step = QpStep::new(qp.dims);
    let mut solver = ChosenQp::new(&qp, QpMethod::Condensed).unwrap();
    assert_eq!(solver.solve(&qp, &mut step, &mut || false), QpStatus::Solved);
    let mut merit = Merit::new(qp.dims);
    merit.update_penalties(&step.multipliers);
    let along: f64 = qp.gradient.iter().zip(&step.d).map(|(g, d)| g * d).sum();
    let t = 1e-3;
    let [before, after] = [0.0, t].map(|t| merit.value(&moved(&qp, &step, t), t * along));
    let slope = merit.directional_derivative(&qp, &step);
    assert!(slope < -0.1, "{slope}");
    // Every part is linear along the step until a limit is reached.
    assert!(((after - before) / t - slope).abs() < 1e-9, "{} {slope}", (after - before) / t);
}

/// Each violation counts with its weight: sigma, or the price of a soft row.
#[test]
fn all_violations_count() {
    let qp = program();
    let mut merit = Merit::new(qp.dims);
    let mut multipliers = Multipliers::new(qp.dims);
    // Powell's rule: at once up to 2, half the way down to 1, up to 4.
    for (multiplier, sigma) in [(2.0, 2.0), (1.0, 1.5), (-4.0, 4.0)] {
        multipliers.parts_mut().into_iter().flatten().for_each(|weight| *weight = multiplier);
        merit.update_penalties(&multipliers);
        // c: 0.3 + 0.4; bounds 0.1, and 3 at 0.2; increment 0.05; rows 0.2 at 5, 0.1, and 4 at
        // 0.3.
        let hard = sigma * (0.7 + 0.1 + 0.05 + 0.1);
        let expected = 7.0 + hard + 0.2 * 3.0 + 5.0 * 0.2 + 0.3 * 4.0;
        assert!((merit.value(&qp, 7.0) - expected).abs() < 1e-12, "{multiplier}");
    }
    merit.reset();
    assert!((merit.value(&qp, 7.0) - 9.8).abs() < 1e-12);
}
