//! Bounds and parameters that change with the control steps.

use crate::support::Lag;
use pinc_loop::ClosedLoop;
use pinc_mpc::{
    BoundSchedule, Bounded, Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Timetable,
    Tracked, Weights,
};
use pinc_ode::{Dims, Dopri5, Linearization, Model, OutputLinearization, Rk4, Stages};

/// x' = (u - x) / 4 with the output x + u.
const LAG: Lag = Lag { rate: 0.25, outputs: &[(1.0, true)] };

const STAGES: usize = 5;
const FREE: usize = 3;

/// Bounds of x, u and y in each step of the loop: the lower ones, then the upper ones.
const ROWS: [(usize, [f64; 6]); 4] = [
    (0, [-1.0, -2.0, -3.0, 0.8, 2.0, 2.4]),
    (3, [-1.0, -1.5, -3.0, 0.5, 1.2, 1.9]),
    (5, [0.1, -2.0, -3.0, 0.9, 2.0, 2.0]),
    (9, [0.1, -2.0, -3.0, 0.2, 0.4, 0.6]),
];

fn row(step: usize) -> [f64; 6] {
    ROWS.iter().rfind(|(start, _)| *start <= step).unwrap().1
}

fn rows() -> Timetable {
    Timetable::new(6, ROWS.map(|(start, row)| (start, row.to_vec()))).unwrap()
}

/// Follows 1.
fn problem() -> NmpcProblem {
    let [low_x, low_u, low_y, high_x, high_u, high_y] = row(0).map(|bound| vec![bound]);
    NmpcProblem {
        control_horizon: FREE,
        state_bounds: Bounds::new(low_x, high_x),
        input_bounds: Bounds::new(low_u, high_u),
        output_bounds: Some(Bounds::new(low_y, high_y)),
        ..NmpcProblem::new(model().dims(), STAGES, Weights::uniform(vec![5.0], vec![0.1]))
    }
}

fn model() -> Rk4<Lag> {
    Rk4::new(LAG, 1.0, 2)
}

/// The bounds of the stages of a plan that begins at `step`, one after the other: both steps that
/// meet at a mark bound its state.
fn by_stage(step: usize, preview: bool) -> NmpcProblem {
    let at = |ahead: usize| row(if preview { step + ahead } else { step });
    let side = |place: usize, stages: usize| -> [Vec<f64>; 2] {
        [
            (0..stages).map(|j| at(j)[place]).collect(),
            (0..stages).map(|j| at(j)[place + 3]).collect(),
        ]
    };
    let both = |place: usize, meet: fn(f64, f64) -> f64| -> Vec<f64> {
        (0..STAGES).map(|j| meet(at(j)[place], at(j + 1)[place])).collect()
    };
    let [low_u, high_u] = side(1, FREE);
    let [low_y, high_y] = side(2, STAGES);
    NmpcProblem {
        state_bounds: Bounds::new(both(0, f64::max), both(3, f64::min)),
        input_bounds: Bounds::new(low_u, high_u),
        output_bounds: Some(Bounds::new(low_y, high_y)),
        ..problem()
    }
}

/// Each plan of a loop is the plan of a controller that was built with the bounds of its stages.
#[test]
fn bounds_of_a_plan_follow_its_steps() {
    for preview in [true, false] {
        let (problem, dims) = (problem(), model().dims());
        let schedule = BoundSchedule::new(rows(), &problem, dims).unwrap();
        let mut nmpc = Nmpc::new(problem, Box::new(model()), SqpConfig::default()).unwrap();
        let (mut x, mut u, mut next, mut at_bound) = (vec![0.2], vec![0.0], vec![0.0], 0);
        nmpc.reset_to(&x, &u).unwrap();
        for step in 0..12 {
            nmpc.set_bounds_at(&schedule, step, preview);
            let mut other =
                Nmpc::new(by_stage(step, preview), Box::new(model()), SqpConfig::default())
                    .unwrap();
            other.reset_to(&x, &u).unwrap();
            let expected = other.step(&x, &[1.0; STAGES]).unwrap();
            let (status, wanted) = (expected.status, expected.u.to_vec());
            let found = nmpc.step(&x, &[1.0; STAGES]).unwrap();
            assert_eq!(found.status, status, "step {step}");
            assert!((found.u[0] - wanted[0]).abs() < 1e-7, "{step}: {} {}", found.u[0], wanted[0]);
            u.copy_from_slice(found.u);
            model().step(&x, &u, &[], &mut next);
            let values = [next[0], u[0], next[0] + u[0]];
            let high = values.iter().zip(&row(step)[3..]).any(|(v, high)| *v > high - 1e-6);
            at_bound += usize::from(high);
            x.copy_from_slice(&next);
        }
        assert!(at_bound > 6, "{at_bound}: bounds matter");
    }
}

/// In the loop, bounds that are known in advance are kept at all times, those that turn up are not.
#[test]
fn the_loop_keeps_bounds_that_it_knows() {
    let broken = |preview: bool| {
        let (problem, dims) = (problem(), model().dims());
        let schedule = BoundSchedule::new(rows(), &problem, dims).unwrap();
        let mut nmpc = Nmpc::new(problem, Box::new(model()), SqpConfig::default()).unwrap();
        let reference = Reference::new(vec![1.0; 14], 1).unwrap();
        let run = ClosedLoop::new(&mut nmpc, Dopri5::new(LAG, 1e-12), reference, &[0.2]).unwrap();
        let run = run.with_bounds(schedule);
        let mut run = if preview { run } else { run.without_preview() };
        run.run().unwrap();
        let of_state = |of: &&pinc_loop::Violation| of.of == Bounded::State(0) && of.amount > 1e-5;
        run.violations().find(of_state).copied()
    };
    assert_eq!(broken(true), None);
    // At t = 9 the bound of x falls from 0.9 to 0.2, and x takes time to follow.
    let violation = broken(false).unwrap();
    assert!((violation.bound - 0.2).abs() < 1e-12 && violation.time_s >= 9.0, "{violation:?}");
    assert!(violation.amount > 0.1, "{violation:?}");
}

/// y = 2 x, which the input does not change at once, is bounded at a mark by both steps that meet there,
/// as x is.
#[test]
fn an_output_of_states_alone_is_bounded_as_they_are() {
    let plan = |of_output: bool| {
        let inf = f64::INFINITY;
        let highs = |high: f64| if of_output { [inf, inf, 2.0 * high] } else { [high, inf, inf] };
        let row = |high: f64| [vec![-inf; 3], highs(high).to_vec()].concat();
        let model = Rk4::new(Lag { rate: 0.25, outputs: &[(2.0, false)] }, 1.0, 2);
        let [x, _, y] = highs(0.8).map(|high| Bounds::new(vec![-inf], vec![high]));
        let problem = NmpcProblem {
            state_bounds: x,
            output_bounds: Some(y),
            ..NmpcProblem::new(model.dims(), 6, Weights::uniform(vec![5.0], vec![0.1]))
        };
        let rows = Timetable::new(6, [(0, row(0.8)), (3, row(0.3))]).unwrap();
        let schedule = BoundSchedule::new(rows, &problem, model.dims()).unwrap();
        let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
        nmpc.set_bounds_at(&schedule, 0, true);
        nmpc.step(&[0.5], &[1.0; 6]).unwrap();
        nmpc.plan().states().to_vec()
    };
    let (states, outputs) = (plan(false), plan(true));
    assert!((outputs[2] - 0.3).abs() < 1e-7, "{outputs:?}");
    for (x, expected) in outputs.iter().zip(&states) {
        assert!((x - expected).abs() < 1e-7, "{outputs:?} {states:?}");
    }
}

#[test]
fn schedules_that_do_not_suit_the_problem_are_refused() {
    let refused = |change: fn(&mut Vec<f64>)| {
        let mut row = row(0).to_vec();
        change(&mut row);
        let width = row.len();
        let rows = Timetable::new(width, [(0, row)]).unwrap();
        BoundSchedule::new(rows, &problem(), model().dims()).unwrap_err().to_string()
    };
    assert!(refused(|row| row[0] = 3.0).contains("at most the upper bound"));
    assert!(refused(|row| row[3] = f64::INFINITY).contains("finite, as in the problem"));
    assert!(refused(|row| row.truncate(4)).contains("4 numbers, but 6 are expected"));
    assert!(Timetable::new(1, [(1, vec![0.0])]).is_err());
    assert!(Timetable::new(1, [(0, vec![0.0]), (0, vec![1.0])]).is_err());
    assert!(Timetable::new(1, []).is_err());
}

/// The disturbance of each step.
fn p(step: usize) -> f64 {
    [0.3, 0.3, -0.4, 1.1][step.min(11) / 3]
}

/// x+ = x + u/2 + sin(x) p/5 and y = (2 + p) x, with the disturbance p given, or of the step that a second
/// state counts.
#[derive(Clone, Debug)]
struct Disturbed {
    counted: bool,
}

impl Model for Disturbed {
    fn dims(&self) -> Dims {
        let dims = if self.counted { Dims::new(2, 1) } else { Dims::new(1, 1).with_parameters(1) };
        dims.with_outputs(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    #[expect(clippy::cast_possible_truncation, reason = "few steps")]
    fn step(&mut self, x: &[f64], u: &[f64], given: &[f64], next: &mut [f64]) {
        let p = if self.counted { p(x[1].round() as usize) } else { given[0] };
        next[0] = x[0] + 0.5 * u[0] + 0.2 * p * x[0].sin() + 0.1 * p;
        if self.counted {
            next[1] = x[1] + 1.0;
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "few steps")]
    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (at, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.step(at.x, at.u, at.p, out.next);
            let p = if self.counted { p(at.x[1].round() as usize) } else { at.p[0] };
            out.a[0] = 1.0 + 0.2 * p * at.x[0].cos();
            out.b[0] = 0.5;
            if self.counted {
                out.a[1..].copy_from_slice(&[0.0, 0.0, 1.0]);
                out.b[1] = 0.0;
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "few steps")]
    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (at, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            let p = if self.counted { p(at.x[1].round() as usize) } else { at.p[0] };
            out.y[0] = (2.0 + p) * at.x[0];
            (out.c[0], out.d[0]) = (2.0 + p, 0.0);
            out.c[1..].fill(0.0);
        }
    }
}

/// Parameters that are known in advance give the plans of a model that counts the steps itself, also where
/// an output has them, which is read at a mark with those from then on.
#[test]
fn parameters_may_differ_by_stage() {
    follow_known_parameters(&Tracked::states([0]));
    follow_known_parameters(&Tracked::outputs([0]));
}

fn follow_known_parameters(tracked: &[Tracked]) {
    let rows = (0..12).map(|step| (step, vec![p(step)]));
    let table = Timetable::new(1, rows).unwrap();
    let weights = || Weights::uniform(vec![2.0], vec![0.3]);
    let of = |counted: bool| {
        let model = Disturbed { counted };
        let problem = NmpcProblem {
            tracked: tracked.to_vec(),
            parameters: vec![0.0; model.dims().np],
            ..NmpcProblem::new(model.dims(), 4, weights())
        };
        Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap()
    };
    let mut nmpc = of(false);
    let (mut x, mut before, mut next) = (0.6, [0.0], [0.0]);
    for step in 0..10 {
        nmpc.set_parameters_ahead(&table, step).unwrap();
        let u = nmpc.step(&[x], &[1.0; 4]).unwrap().u[0];
        // A first guess counts its steps, as a shifted plan does not at its end.
        let mut counting = of(true);
        counting.reset_to(&[x, step as f64], &before).unwrap();
        counting.set_first_plan(&[before[0]; 4]).unwrap();
        let expected = counting.step(&[x, step as f64], &[1.0; 4]).unwrap();
        assert_eq!(expected.status, SqpStatus::Converged);
        let expected = expected.u[0];
        assert!((u - expected).abs() < 1e-8, "step {step}: {u} {expected}");
        Disturbed { counted: false }.step(&[x], &[u], &[p(step)], &mut next);
        (x, before) = (next[0], [u]);
    }
    assert!(
        nmpc.set_parameters_ahead(&Timetable::new(2, [(0, vec![0.0; 2])]).unwrap(), 0).is_err()
    );
}
