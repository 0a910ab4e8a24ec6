//! Outputs that depend on the input: bounded at both ends of each interval, tracked at its end.

use crate::optimality::{StepInput, none, residuals_with, scale};
use crate::outputs::{METHODS, Observed, config};
use crate::support::{Lag, Linear};
use pinc_loop::{ClosedLoop, LoopRecord, Observer, PlantNow};
use pinc_mpc::{
    Bounds, Constraint, IntervalEnd, Nmpc, NmpcProblem, Reference, Side, Softness, SqpConfig,
    SqpStatus, Tracked, Weights,
};
use pinc_ode::{Dims, Dopri5, Model, Rk4};
use pinc_plants::VanDerPol;
use proptest::prelude::*;

const FREE: f64 = f64::INFINITY;

/// x' = (u - x) / 10 with the outputs x and x + u.
const LAG: Lag = Lag { rate: 0.1, outputs: &[(1.0, false), (1.0, true)] };

fn lag() -> Rk4<Lag> {
    Rk4::new(LAG, 1.0, 2)
}

/// One step of the lag under the input u: a x + (1 - a) u.
fn next(x: f64, u: f64) -> f64 {
    let mut next = [0.0];
    lag().step(&[x], &[u], &[], &mut next);
    next[0]
}

/// The bound `high` on x + u.
fn below(high: f64) -> Option<Bounds> {
    Some(Bounds::new(vec![-FREE; 2], vec![FREE, high]))
}

fn lag_problem(horizon: usize) -> NmpcProblem {
    let weights = Weights::uniform(vec![1.0], vec![1e-3]);
    NmpcProblem {
        input_bounds: Bounds::new(vec![-5.0], vec![5.0]),
        output_bounds: below(2.0),
        ..NmpcProblem::new(Dims::new(1, 1), horizon, weights)
    }
}

/// With one interval the answer is known: the most that both ends admit.
#[test]
fn the_input_applied_keeps_the_bound_at_both_ends() {
    let [b, a] = [next(0.0, 1.0), next(1.0, 0.0)];
    // Before the end the state rises or falls: the start binds, or the end.
    for (x, most) in [(1.5, 2.0 - 1.5), (-1.0, (2.0 + a) / (1.0 + b))] {
        for qp in METHODS {
            let mut nmpc = Nmpc::new(lag_problem(1), Box::new(lag()), config(qp)).unwrap();
            let step = nmpc.step(&[x], &[9.0]).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{qp}");
            assert!((step.u[0] - most).abs() < 1e-7, "{qp} {x}: {} {most}", step.u[0]);
        }
    }
}

/// In closed loop no sample is above the bound, just before and just after a change of the input,
/// and the bound is reached.
#[test]
fn a_loop_keeps_the_bound_at_every_sample() {
    for (horizon, control, delay) in [(10, 10, 0), (10, 3, 0), (8, 2, 2)] {
        let problem = NmpcProblem { control_horizon: control, delay, ..lag_problem(horizon) };
        let mut nmpc = Nmpc::new(problem, Box::new(lag()), SqpConfig::default()).unwrap();
        let reference = Reference::new(vec![0.9; 30], 1).unwrap();
        let plant = Dopri5::new(LAG, 1e-12);
        let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &[0.0]).unwrap();
        let (record, ended) = run.run_recorded();
        ended.unwrap();
        assert!(record.steps.iter().all(|step| step.status == SqpStatus::Converged));
        let most = readings(&record).concat().into_iter().fold(f64::MIN, f64::max);
        assert!((most - 2.0).abs() < 1e-6, "{most}");
        assert!(run.max_violation() < 1e-6, "{}", run.max_violation());
    }
}

/// Just after each change of the input, and just before it, from the second sample on.
fn readings(record: &LoopRecord) -> [Vec<f64>; 2] {
    let trace = &record.trajectory;
    let y = |i: usize, held: usize| trace.state(i)[0] + trace.input(held)[0];
    let after = (0..trace.len()).map(|i| y(i, i)).collect();
    [after, (1..trace.len()).map(|i| y(i, i - 1)).collect()]
}

/// Both ends are violated at their price, and have it as their multipliers.
#[test]
fn a_soft_bound_costs_at_both_ends() {
    let (b, weight, x) = (next(0.0, 1.0), 0.01, 0.4);
    let problem =
        NmpcProblem { output_softness: Softness::Penalty(vec![1.0, weight]), ..lag_problem(1) };
    // 2 b (a x + b u - r) + 2 rho u + weight (1 + (1 + b)) = 0
    let r = 0.9;
    let free = next(x, 0.0);
    let u = (2.0 * b * (r - free) - weight * (2.0 + b)) / (2.0 * (b * b + 1e-3));
    assert!(u + x > 2.0 && u < 5.0, "{u}");
    for qp in METHODS {
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(lag()), config(qp)).unwrap();
        let step = nmpc.step(&[x], &[r]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{qp}");
        assert!((step.u[0] - u).abs() < 1e-6, "{qp}: {} {u}", step.u[0]);
        let found = nmpc.plan().constraint_multipliers();
        for (found, expected) in found.iter().zip([0.0, weight, weight]) {
            assert!((found - expected).abs() < 1e-8, "{qp}: {found} {expected}");
        }
    }
}

/// What cannot be met is named with its time and the input it is taken with, and is violated as
/// little as possible.
#[test]
fn a_bound_that_cannot_be_met_is_named_with_its_end() {
    let cases = [
        // From 8 the lowest input leaves 3 at the start, and less later.
        (8.0, [-5.0, 5.0], 0, IntervalEnd::Start, "upper bound of y(x[k+0], u[k+0])[1]"),
        // With an input of 1.9 and more from 0.1 it rises in the interval.
        (0.1, [1.9, 5.0], 1, IntervalEnd::End, "upper bound of y(x[k+1], u[k+0])[1]"),
    ];
    for (x, [low, high], step, end, name) in cases {
        for softness in [Softness::Hard, Softness::Exact] {
            let problem = NmpcProblem {
                input_bounds: Bounds::new(vec![low], vec![high]),
                output_softness: softness.clone(),
                ..lag_problem(1)
            };
            for qp in METHODS {
                let mut nmpc = Nmpc::new(problem.clone(), Box::new(lag()), config(qp)).unwrap();
                let report = nmpc.step(&[x], &[2.0]).unwrap();
                let violated = (softness == Softness::Hard).then(|| {
                    assert_eq!(report.violated.unwrap().to_string(), name, "{qp}");
                    Constraint::Output { step, index: 1, side: Side::High, end: Some(end) }
                });
                assert_eq!(report.violated, violated, "{qp}");
                assert!((report.u[0] - low).abs() < 1e-6, "{qp} {x}: {}", report.u[0]);
            }
        }
    }
}

/// A model that says nothing of its outputs has rows at both ends, of which the one at the measured
/// state is left alone where the input does not reach it.
#[test]
fn a_given_output_is_not_bounded() {
    let linear = Linear::scalar(0.5, 1.0);
    let weights = Weights::uniform(vec![1.0], vec![0.1]);
    let problem = NmpcProblem {
        state_bounds: Bounds::new(vec![-FREE], vec![1.0]),
        ..NmpcProblem::new(linear.dims, 3, weights)
    };
    let outputs = NmpcProblem {
        state_bounds: Bounds::none(1),
        output_bounds: Some(problem.state_bounds.clone()),
        ..problem.clone()
    };
    assert_eq!(linear.feedthrough(), [true]);
    for qp in METHODS {
        let mut states = Nmpc::new(problem.clone(), Box::new(linear.clone()), config(qp)).unwrap();
        let mut outputs = Nmpc::new(outputs.clone(), Box::new(linear.clone()), config(qp)).unwrap();
        for x in [3.0, -2.0, 1.0] {
            let expected = states.step(&[x], &[1.5; 3]).unwrap().u[0];
            let step = outputs.step(&[x], &[1.5; 3]).unwrap();
            assert_eq!(step.status, SqpStatus::Converged, "{qp} {x}");
            assert!((step.u[0] - expected).abs() < 1e-6, "{qp} {x}: {} {expected}", step.u[0]);
        }
    }
}

/// A real-time iteration that was prepared for another state: the rows at the measured state move
/// with it.
#[test]
fn a_prepared_bound_follows_the_measured_state() {
    for qp in METHODS {
        let config = SqpConfig { real_time: true, ..config(qp) };
        let mut nmpc = Nmpc::new(lag_problem(1), Box::new(lag()), config).unwrap();
        nmpc.step(&[0.0], &[9.0]).unwrap();
        for x in [1.5, 1.2, 1.9] {
            nmpc.prepare();
            let step = nmpc.step(&[x], &[9.0]).unwrap();
            assert_eq!(step.status, SqpStatus::Prepared, "{qp}");
            assert!((step.u[0] - (2.0 - x)).abs() < 1e-6, "{qp} {x}: {}", step.u[0]);
        }
    }
}

/// Remembers the readings that it is shown.
#[derive(Debug, Default)]
struct Watching {
    y: Vec<f64>,
}

impl Observer for Watching {
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], _parameters: &mut [f64]) {
        x.copy_from_slice(plant.x);
        self.y.push(plant.y[1]);
    }

    fn advance(&mut self, _u: &[f64]) {}
}

/// What is measured and what counts as the tracking error is the reading before the input changes.
/// A bound that is too soft to hold shows in the largest violation just after a change.
#[test]
fn a_loop_reads_outputs_before_the_input_changes() {
    for delay in [0, 1] {
        let problem = NmpcProblem {
            delay,
            tracked: Tracked::outputs([1]),
            output_softness: Softness::Penalty(vec![1.0, 1e-9]),
            ..lag_problem(6)
        };
        let mut nmpc = Nmpc::new(problem, Box::new(lag()), SqpConfig::default()).unwrap();
        let reference = Reference::new([vec![3.0; 6], vec![-1.0; 6]].concat(), 1).unwrap();
        let mut seen = Watching::default();
        let run = ClosedLoop::new(&mut nmpc, Dopri5::new(LAG, 1e-12), reference, &[4.0]).unwrap();
        let mut run = run.with_initial_input(&[0.5]).unwrap().with_observer(&mut seen);
        let (record, ended) = run.run_recorded();
        ended.unwrap();
        let [after, before] = readings(&record);
        let marks: Vec<f64> = before.iter().skip(8).step_by(9).copied().collect();
        let error = |(k, y): (usize, &f64)| (y - if k < 6 { 3.0 } else { -1.0 }).abs();
        let expected = marks.iter().enumerate().map(error).sum::<f64>();
        assert!((run.tracking_at_steps().iae_mean() - expected).abs() < 1e-9, "{delay}");
        let most = after.iter().chain(&before).fold(f64::MIN, |most, y| most.max(*y));
        assert!((run.max_violation() - (most - 2.0)).abs() < 1e-9, "{delay}: {most}");
        // The state falls, so that the worst is just after the first change.
        assert!(most > before.iter().fold(f64::MIN, |most, y| most.max(*y)) + 0.01);
        // In the beginning the input is the initial one.
        let shown = [&[4.0 + 0.5], &marks[..11]].concat();
        for (found, expected) in seen.y.iter().zip(&shown) {
            assert!((found - expected).abs() < 1e-12, "{delay}: {found} {expected}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, max_global_rejects: 400, ..Default::default() })]

    /// Bounded and tracked outputs, one of them nonlinear and with the input in it: optimal by the
    /// conditions assembled a second time, by all methods.
    #[test]
    fn plans_with_bounded_outputs_are_optimal(
        (horizon, control, n1) in (1..=6_usize).prop_flat_map(|n| (Just(n), 1..=n, 1..=n)),
        start in prop::array::uniform2(-0.5..0.5_f64),
        feed in prop_oneof![-1.5..-0.3_f64, 0.3..1.5_f64],
        spread in prop::collection::vec(0.1..0.6_f64, 12),
        target in -1.0..1.0_f64,
    ) {
        let mut model = Observed { model: Rk4::new(VanDerPol::default(), 0.5, 4), feed };
        let stages = 2 * (horizon + 1 - n1);
        // Around a plan without any input.
        let middle = |i: usize| if i.is_multiple_of(2) { start[0] + start[1] } else { start[0].powi(2) };
        let side = |sign: f64| (0..stages).map(|i| middle(i) + sign * spread[i]).collect();
        let problem = NmpcProblem {
            n1,
            control_horizon: control,
            tracked: vec![Tracked::Output(1), Tracked::State(1)],
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            output_bounds: Some(Bounds::new(side(-1.0), side(1.0))),
            ..NmpcProblem::new(model.dims(), horizon, Weights::uniform(vec![5.0, 2.0], vec![0.3]))
        };
        let reference = [target, 0.0].repeat(horizon);
        let track = |j: usize, x: &[f64], u: &[f64]| {
            let force = 2.0 * 5.0 * (x[0] * x[0] + feed * u[0] - target);
            let on = if j >= n1 { force } else { 0.0 };
            (vec![2.0 * x[0] * on, 0.0], vec![feed * on])
        };
        let mut first = None;
        for qp in METHODS {
            let mut nmpc = Nmpc::new(problem.clone(), Box::new(model.clone()), config(qp)).unwrap();
            let step = nmpc.step(&start, &reference).unwrap();
            prop_assume!(step.status == SqpStatus::Converged);
            let u = step.u[0];
            prop_assert!((u - *first.get_or_insert(u)).abs() < 1e-5, "{qp}: {u} {first:?}");
            let input = StepInput { x: &start, previous: &[0.0], reference: &reference };
            let found = residuals_with(&nmpc, &mut model, &input, [&none, &track]);
            prop_assert!(found.iter().all(|&r| r <= 1e-7 * scale(&nmpc)), "{qp}: {found:?}");
        }
    }
}
