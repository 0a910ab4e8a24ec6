//! Endings of solutions: a deadline at each reading of the clock, a perfect guess, inputs that are
//! not numbers.

use super::{SHARP, residual};
use crate::condense::CondensedQp;
use crate::riccati::RiccatiQp;
use crate::{OcpDims, Qp, QpSolver, QpStatus, QpStep, QpWork};

/// An oscillator driven hither and thither, with many inputs at their bounds; some may be violated.
pub(crate) fn program() -> Qp {
    let horizon = 40;
    let dims = OcpDims::new(2, 1, horizon);
    let mut qp = Qp::new(dims, [1.0, 0.0, 0.0, 1.0].repeat(horizon), vec![0.1; horizon]);
    qp.a = [0.9, 0.3, -0.3, 0.9].repeat(horizon);
    qp.b = [0.1, 0.5].repeat(horizon);
    let wave = |i: usize| f64::from(u8::try_from(i * i % 17).unwrap()) - 8.0;
    qp.gradient.iter_mut().enumerate().for_each(|(i, entry)| *entry = wave(i));
    let inputs = dims.all_states();
    qp.bounds.low[inputs..].fill(-1.0);
    qp.bounds.high[inputs..].fill(1.5);
    qp.bounds.penalty[inputs..].iter_mut().step_by(5).for_each(|penalty| *penalty = 3.0);
    qp.bounds.low[..inputs].fill(-0.8);
    qp.bounds.high[..inputs].fill(0.8);
    qp.bounds.penalty[..inputs].fill(20.0);
    qp.increments.low.fill(-0.7);
    qp.increments.high.fill(0.7);
    qp
}

fn methods(qp: &Qp) -> [Box<dyn QpSolver>; 3] {
    let from_scratch = Some(CondensedQp::new(qp));
    [
        Box::new(CondensedQp::new(qp)),
        Box::new(RiccatiQp::new(qp)),
        Box::new(RiccatiQp::new(qp).with_from_scratch(from_scratch)),
    ]
}

/// The status, and how often the time was looked at, where it is up from look `last` on.
fn cut_off(
    solver: &mut dyn QpSolver,
    qp: &Qp,
    step: &mut QpStep,
    last: usize,
) -> (QpStatus, usize) {
    let mut looks = 0;
    let status = solver.solve(qp, step, &mut || {
        looks += 1;
        looks > last
    });
    (status, looks)
}

#[test]
fn the_time_is_looked_at_all_along_and_obeyed() {
    let qp = program();
    let cold = QpStep::new(qp.dims);
    for (m, mut method) in methods(&qp).into_iter().enumerate() {
        let (status, looks) = cut_off(method.as_mut(), &qp, &mut cold.clone(), usize::MAX);
        assert_eq!(status, QpStatus::Solved);
        // It is looked at 54, 30 and 58 times.
        assert!(looks >= [50, 28, 54][m], "method {m}: {looks} looks");
        for last in 0..looks {
            let mut step = cold.clone();
            let (status, taken) = cut_off(method.as_mut(), &qp, &mut step, last);
            assert_eq!(status, QpStatus::Expired, "method {m}, look {last} of {looks}");
            assert!(step.is_finite() && taken == last + 1, "method {m}, look {last}: {taken}");
            // The multipliers that are left are a guess to go on from.
            step.d.fill(0.0);
            let status = method.solve(&qp, &mut step, &mut || false);
            assert_eq!(status, QpStatus::Solved, "method {m}, look {last}");
            assert!(residual(&qp, &step) < SHARP, "method {m}, look {last}");
        }
    }
}

#[test]
fn the_solution_as_the_guess_takes_one_factorization() {
    let qp = program();
    let mut solution = QpStep::new(qp.dims);
    CondensedQp::new(&qp).solve(&qp, &mut solution, &mut || false);
    let mut from_scratch = Vec::new();
    for (m, mut method) in methods(&qp).into_iter().enumerate() {
        let mut step = solution.clone();
        assert_eq!(method.solve(&qp, &mut step, &mut || false), QpStatus::Solved);
        let work = method.take_work();
        assert!(work.factorizations == 1 && work.changes <= 1, "method {m}: {work:?}");
        assert_eq!(method.take_work(), QpWork::default());
        method.solve(&qp, &mut QpStep::new(qp.dims), &mut || false);
        from_scratch.push(method.take_work().factorizations);
    }
    // Condensing takes the place of the interior point: it takes 23 and 5.
    assert!(from_scratch[1] > 12 && from_scratch[2] <= 6, "{from_scratch:?}");
}

#[test]
pub(crate) fn programs_with_numbers_that_are_not_finite_have_no_solution() {
    for bad in [f64::NAN, f64::INFINITY] {
        for part in 0..4 {
            let mut qp = program();
            let mut all = methods(&qp);
            let parts = [&mut qp.gradient, &mut qp.a, &mut qp.b, &mut qp.c];
            *parts.into_iter().nth(part).unwrap().last_mut().unwrap() = bad;
            for (m, method) in all.iter_mut().enumerate() {
                let status = method.solve(&qp, &mut QpStep::new(qp.dims), &mut || false);
                assert_eq!(status, QpStatus::Failed, "method {m}, {bad} in part {part}");
            }
        }
    }
}
