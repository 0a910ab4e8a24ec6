use super::super::tests::scalar;
use super::*;
use crate::condense::CondensedQp;
use crate::tests::endings::program;
use crate::tests::programs::programs;
use crate::{QpSolver, QpStatus, QpStep};
use proptest::prelude::*;

/// The program as seen from `d`, and its cost there.
fn seen_from(qp: &Qp, d: &[f64]) -> (Qp, f64) {
    let mut at = Newton::new(qp.dims);
    at.d.copy_from_slice(d);
    at.residuals(qp);
    let mut seen = qp.clone();
    seen.gradient.copy_from_slice(&at.slope);
    seen.c.copy_from_slice(&at.defect);
    let (bounds, increments, rows) = at.rows.split(&at.values);
    for (limits, values) in
        [(&mut seen.bounds, bounds), (&mut seen.increments, increments), (&mut seen.rows, rows)]
    {
        for (i, value) in values.iter().enumerate() {
            limits.low[i] -= value;
            limits.high[i] -= value;
        }
    }
    let slopes = qp.gradient.iter().zip(&at.slope).zip(d);
    (seen, slopes.map(|((g, slope), d)| 0.5 * (g + slope) * d).sum())
}

/// The cost of `d` with that of violations.
fn priced(qp: &Qp, d: &[f64]) -> f64 {
    let (seen, cost) = seen_from(qp, d);
    let prices = Rows::limits(&seen).filter(|[.., penalty]| penalty.is_finite());
    cost + prices.map(|[low, high, penalty]| penalty * low.max(-high).max(0.0)).sum::<f64>()
}

/// The solution from `d` on, with the multipliers, and how often the program was factored; `None` if
/// it was not found.
fn solved(qp: &Qp, mut d: Vec<f64>) -> Option<(Vec<f64>, Multipliers, usize)> {
    let (mut barrier, mut step) = (Barrier::new(qp), QpStep::new(qp.dims));
    let (mut seen, mut cost) = seen_from(qp, &d);
    barrier.begin(&seen, &step.multipliers, 0.1);
    for _ in 0..200 {
        barrier.measure(&seen);
        barrier.lower_tau();
        if barrier.tau <= LEAST && barrier.residual() <= NEAR * LEAST {
            let mut multipliers = Multipliers::new(qp.dims);
            barrier.write(&mut multipliers);
            return Some((d, multipliers, barrier.take_work().factorizations));
        }
        let mut length = barrier.direct(&mut seen, &mut step.d, &mut || false)?;
        let [start, slope] = barrier.begin_search(&seen, &step.d, cost);
        loop {
            let moved: Vec<f64> = d.iter().zip(&step.d).map(|(d, by)| d + length * by).collect();
            let (there, cost_there) = seen_from(qp, &moved);
            let merit = barrier.merit(&there, cost_there, length);
            if merit <= start + 1e-4 * length * slope + 1e-12 * start.abs() {
                barrier.advance(length);
                (d, seen, cost) = (moved, there, cost_there);
                break;
            }
            length *= 0.5;
            if length < 1e-9 {
                return None;
            }
        }
    }
    None
}

#[test]
fn the_barrier_comes_to_the_solution_of_a_program() {
    let qp = program();
    let mut exact = QpStep::new(qp.dims);
    CondensedQp::new(&qp).solve(&qp, &mut exact, &mut || false);
    let (d, multipliers, factorizations) = solved(&qp, vec![0.0; qp.dims.unknowns()]).unwrap();
    for (d, exact) in d.iter().zip(&exact.d) {
        assert!((d - exact).abs() < 1e-6, "{d} {exact}");
    }
    for (found, exact) in multipliers.parts().into_iter().zip(exact.multipliers.parts()) {
        for (found, exact) in found.iter().zip(exact) {
            assert!((found - exact).abs() < 1e-5, "{found} {exact}");
        }
    }
    assert!(factorizations <= 25, "{factorizations}");
}

proptest! {
    #[test]
    fn the_barrier_comes_to_the_solutions_of_random_programs(qp in programs(false)) {
        // Between limits that coincide there is no interior.
        let mut qp = qp;
        for limits in [&mut qp.bounds, &mut qp.increments, &mut qp.rows] {
            limits.low.iter_mut().for_each(|low| *low -= 0.1);
            limits.high.iter_mut().for_each(|high| *high += 0.1);
        }
        let mut exact = QpStep::new(qp.dims);
        prop_assume!(
            CondensedQp::new(&qp).solve(&qp, &mut exact, &mut || false) == QpStatus::Solved
        );
        let found = solved(&qp, vec![0.0; qp.dims.unknowns()]);
        prop_assert!(found.is_some());
        let [cost, least] = [&found.unwrap().0, &exact.d].map(|d| priced(&qp, d));
        prop_assert!((cost - least).abs() < 1e-5 * (1.0 + least.abs()), "{cost} {least}");
    }
}

/// x = u between -1 and 2; the least of -u^2 / 2 + slope u, which is at one of the bounds.
fn concave(slope: f64) -> Qp {
    let mut qp = scalar(0.0, 0.0).with_end_cost();
    qp.t[0] = -1.0;
    qp.gradient[1] = slope;
    (qp.bounds.low[1], qp.bounds.high[1]) = (-1.0, 2.0);
    qp
}

#[test]
fn where_curvature_is_negative_the_barrier_goes_downhill() {
    for (slope, bound) in [(0.3, -1.0), (-0.3, 2.0)] {
        let (d, multipliers, _) = solved(&concave(slope), vec![0.0; 2]).unwrap();
        assert!((d[1] - bound).abs() < 1e-8, "{d:?}");
        // bound - slope - mu = 0
        assert!((multipliers.bounds[1] - (bound - slope)).abs() < 1e-6, "{multipliers:?}");
    }
}

/// x = u + 1 for the least 50 x^2 + 50 u^2, from x = u = 0: the cost is flat there, but what mends the
/// dynamics adds 25 to it.
#[test]
fn violations_weigh_more_than_the_cost_of_mending_them() {
    let mut qp = scalar(100.0, 0.0).with_end_cost();
    (qp.t[0], qp.c[0]) = (100.0, 1.0);
    let (mut barrier, mut step) = (Barrier::new(&qp), QpStep::new(qp.dims));
    barrier.begin(&qp, &step.multipliers, 1e-3);
    barrier.measure(&qp);
    let length = barrier.direct(&mut qp.clone(), &mut step.d, &mut || false).unwrap();
    assert!(step.d.iter().zip([0.5, -0.5]).all(|(d, x)| (d - x).abs() < 1e-12), "{step:?}");
    let [start, slope] = barrier.begin_search(&qp, &step.d, 0.0);
    let (there, cost) = seen_from(&qp, &step.d.iter().map(|d| length * d).collect::<Vec<_>>());
    let merit = barrier.merit(&there, cost, length);
    assert!(slope < 0.0 && merit < start + 0.1 * length * slope, "{start} {slope} {merit}");
}

/// Where no shift is large enough, none is looked for.
#[test]
fn a_hessian_beyond_all_numbers_has_no_step() {
    let mut qp = concave(0.3);
    qp.t[0] = f64::NEG_INFINITY;
    let (mut barrier, mut step) = (Barrier::new(&qp), QpStep::new(qp.dims));
    barrier.begin(&qp, &step.multipliers, 1e-3);
    barrier.measure(&qp);
    assert_eq!(barrier.direct(&mut qp.clone(), &mut step.d, &mut || false), None);
}

#[test]
fn the_barrier_ends_when_the_time_is_up() {
    let qp = concave(0.3);
    let (mut barrier, mut step) = (Barrier::new(&qp), QpStep::new(qp.dims));
    barrier.begin(&qp, &step.multipliers, 1e-3);
    barrier.measure(&qp);
    assert_eq!(barrier.direct(&mut qp.clone(), &mut step.d, &mut || true), None);
    // The Hessian is shifted where there is time.
    assert!(barrier.direct(&mut qp.clone(), &mut step.d, &mut || false).is_some());
    assert!(barrier.shift > 0.0);
}
