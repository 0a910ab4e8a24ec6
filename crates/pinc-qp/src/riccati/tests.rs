//! The interior-point method alone: what it leaves inexact, the active rows would put right.

use super::RiccatiQp;
use super::interior_point::{Ending, InteriorPoint};
use super::newton::Newton;
use super::rows::Rows;
use crate::condense::CondensedQp;
use crate::tests::endings::program;
use crate::{Kind, OcpDims, Qp, QpSolver, QpStatus, QpStep};

/// The ending, the point and the method.
fn solved(qp: &Qp) -> (Ending, Newton, InteriorPoint) {
    let (mut at, mut method) = (Newton::new(qp.dims), InteriorPoint::new(qp));
    let ending = method.solve(qp, &mut at, &mut || false);
    (ending, at, method)
}

#[test]
fn the_interior_point_comes_near_the_solution_in_few_iterations() {
    let qp = program();
    let mut exact = QpStep::new(qp.dims);
    CondensedQp::new(&qp).solve(&qp, &mut exact, &mut || false);
    let (ending, mut at, method) = solved(&qp);
    assert_eq!(ending, Ending::Converged);
    // It takes 10.
    assert!(method.work.factorizations <= 11, "{:?}", method.work);
    for (d, exact) in at.d.iter().zip(&exact.d) {
        assert!((d - exact).abs() < 1e-7, "{d} {exact}");
    }
    method.active(&mut at.mu);
    let [_, bounds, increments, rows] = exact.multipliers.parts();
    let penalties = qp.limits().map(|(_, limits)| &limits.penalty[..]).concat();
    let exact = [bounds, increments, rows].concat();
    for (row, ((found, exact), penalty)) in at.mu.iter().zip(exact).zip(penalties).enumerate() {
        // Below its penalty, where the row is not violated.
        let expected =
            if exact.abs() < penalty { exact.clamp(-0.5 * penalty, 0.5 * penalty) } else { exact };
        assert!((found - expected).abs() < 1e-5, "row {row}: {found} {expected}");
    }
}

#[test]
fn the_interior_point_gives_up_when_the_time_is_up() {
    let qp = program();
    let (_, mut at, mut method) = solved(&qp);
    let iterations = std::mem::take(&mut method.work.factorizations);
    let mut looks = 0;
    method.solve(&qp, &mut at, &mut || {
        looks += 1;
        false
    });
    // Before each iteration and in the middle of it.
    assert!(looks >= 2 * (iterations - 1), "{looks} {iterations}");
    for last in 0..looks {
        let mut looks = 0;
        let ending = method.solve(&qp, &mut at, &mut || {
            looks += 1;
            looks > last
        });
        assert_eq!((ending, looks), (Ending::Failed, last + 1));
    }
}

/// x = u, over one stage, with the weights q and r.
pub(super) fn scalar(q: f64, r: f64) -> Qp {
    let mut qp = Qp::new(OcpDims::new(1, 1, 1), vec![q], vec![r]);
    qp.b[0] = 1.0;
    qp
}

/// The same with limits on both.
fn pair([low, high]: [[f64; 2]; 2]) -> Qp {
    let mut qp = scalar(1.0, 1.0);
    (qp.bounds.low, qp.bounds.high) = (low.to_vec(), high.to_vec());
    qp
}

#[test]
fn rows_are_met_violated_or_proved_to_contradict_each_other() {
    let free = f64::INFINITY;
    // What x is where the rows are hard, if there is one, and where they may be violated at 3 per
    // unit, with the cost x^2.
    for (low, high, hard, soft) in [
        ([2.0, -free], [free, 1.0], None, 1.0),
        ([-free, 2.0], [1.0, free], None, 1.0),
        ([-free, 1.0], [1.0, free], Some(1.0), 1.0),
        ([2.0, -free], [free, 2.5], Some(2.0), 1.5),
        ([2.0, -free], [2.0, 1.0], None, 1.0),
        ([2.0, -free], [2.0, 3.0], Some(2.0), 1.5),
        ([2.0, 2.0], [2.0, free], Some(2.0), 2.0),
        ([2.0, 2.5], [2.0, free], None, 2.0),
        ([-free, -1.0], [-2.0, 5.0], None, -1.0),
    ] {
        for (penalty, expected) in [(free, hard), (3.0, Some(soft))] {
            let mut qp = pair([low, high]);
            qp.bounds.penalty.fill(penalty);
            let (ending, at, method) = solved(&qp);
            let case = format!("{low:?} {high:?} {penalty}: {ending:?} {:?}", at.d);
            assert!(method.work.factorizations <= 8, "{case} {:?}", method.work);
            match (expected, ending) {
                (Some(x), Ending::Converged) => assert!((at.d[0] - x).abs() < 1e-7, "{case}"),
                (None, Ending::Infeasible(row)) => {
                    // The one that is off pulls.
                    let upper = at.mu[row] > 0.0;
                    assert!(if upper { high } else { low }[row].is_finite(), "{case}");
                    assert!(at.mu[row].abs() > 1.0, "{case}");
                }
                _ => panic!("{case}"),
            }
        }
    }
}

/// Each of 14 states is 20 times the one before and an input: condensing multiplies by 20^13.
fn unstable() -> Qp {
    let (horizon, dims) = (14, pair([[0.0; 2]; 2]).dims);
    let dims = OcpDims { horizon, n_controls: horizon, ..dims };
    let mut qp = Qp::new(dims, vec![1.0; horizon], vec![1e-3; horizon]);
    qp.a.fill(20.0);
    qp.b.fill(1.0);
    qp.c[0] = 1.0;
    qp.gradient
        .iter_mut()
        .enumerate()
        .for_each(|(i, entry)| *entry = 0.1 * f64::from(u8::try_from(i).unwrap()));
    let inputs = dims.all_states();
    qp.bounds.low[inputs..].fill(-40.0);
    qp.bounds.high[inputs..].fill(40.0);
    qp
}

#[test]
fn what_rounding_has_spoiled_is_no_solution() {
    let qp = unstable();
    let (mut exact, mut spoiled) = (QpStep::new(qp.dims), QpStep::new(qp.dims));
    assert_eq!(RiccatiQp::new(&qp).solve(&qp, &mut exact, &mut || false), QpStatus::Solved);
    CondensedQp::new(&qp).solve(&qp, &mut spoiled, &mut || false);
    let mut newton = Newton::new(qp.dims);
    assert!(newton.is_solved_by(&qp, &exact));
    assert!(!newton.is_solved_by(&qp, &spoiled));
    // Each part counts: states and inputs, the multipliers of the dynamics and of bounds.
    for part in 0..3 {
        let mut near = QpStep::new(qp.dims);
        near.d.copy_from_slice(&exact.d);
        near.multipliers.copy_from(&exact.multipliers);
        let [dynamics, bounds, ..] = near.multipliers.parts_mut();
        let values = [&mut near.d[..], dynamics, bounds];
        values.into_iter().nth(part).unwrap()[3] += 1e-6;
        assert!(!newton.is_solved_by(&qp, &near), "part {part}");
    }
}

#[test]
fn rows_are_counted_kind_by_kind() {
    let dims = OcpDims { inequalities: 2, ..pair([[0.0; 2]; 2]).dims };
    let rows = Rows::new(dims);
    let kinds: Vec<_> = (0..rows.len()).map(|i| rows.row(i, true)).collect();
    let expected =
        [(Kind::Bound, 0), (Kind::Bound, 1), (Kind::Increment, 0), (Kind::Row, 0), (Kind::Row, 1)];
    assert_eq!(kinds.len(), expected.len());
    for (row, (kind, index)) in kinds.iter().zip(expected) {
        assert_eq!((row.kind, row.index, row.upper), (kind, index, true));
    }
}
