//! Bounds that a tube tightens, step by step.

use pinc_ad::Scalar;
use pinc_mpc::{
    BoundSchedule, Bounds, MpcError, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Timetable, Tracked,
    Weights,
};
use pinc_ode::{LinearizationBuffer, Model, Plant, Rk4, Stages, Variable};
use pinc_plants::FourTanks;
use pinc_tube::{AlongPlan, BackOffs, EllipsoidTube, Feedback, Sources, Tube, TubeModel};

const N: usize = 6;
const NU: usize = 4;
const START: [f64; 4] = [8.5, 13.0, 2.2, 2.2];

fn model() -> Rk4<FourTanks> {
    Rk4::new(FourTanks::antonelo(), 10.0, 4)
}

fn problem() -> NmpcProblem {
    NmpcProblem {
        tracked: Tracked::states([0, 1]),
        control_horizon: NU,
        state_bounds: Bounds::new(vec![2.0, 2.0, 0.6, 0.6], vec![9.0, 20.0, 5.5, 5.5]),
        input_bounds: Bounds::new(vec![0.0; 2], vec![3.6; 2]),
        ..NmpcProblem::new(model().dims(), N, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    }
}

/// A tube for errors of at most `size` cm in each step.
fn tube(size: f64) -> EllipsoidTube {
    let sources = Sources { boxes: vec![size; 4], ..Sources::default() };
    let units = vec![10.0; 4];
    EllipsoidTube::new((model().dims(), N), sources, None, Feedback::Riccati, units).unwrap()
}

fn controller(size: f64) -> Nmpc {
    Nmpc::builder(problem()).model(Box::new(model())).tube(Box::new(tube(size))).build().unwrap()
}

/// Where the stages of the controller's plan begin, and their inputs; both shifted by one.
fn shifted(nmpc: &Nmpc) -> [Vec<f64>; 2] {
    let plan = nmpc.plan();
    let mut x = plan.states().to_vec();
    // The last stage stands twice.
    x.truncate(4 * (N - 1));
    x.extend_from_within(4 * (N - 2)..);
    let input = |stage: usize| 2 * (stage + 1).min(NU - 1);
    let u = (0..N).flat_map(|j| plan.inputs()[input(j)..input(j) + 2].to_vec()).collect();
    [x, u]
}

/// The back-offs along a plan, independent of the controller.
fn back_offs(size: f64, [x, u]: &[Vec<f64>; 2]) -> BackOffs {
    let (mut model, stages) = (model(), Stages { x, u, p: &[] });
    let mut at = LinearizationBuffer::new(model.dims(), N);
    model.linearize(stages, at.as_mut());
    let zeros = |size: usize| vec![0.0; size];
    let mut found = BackOffs { states: zeros(4 * N), inputs: zeros(2 * NU), ..BackOffs::default() };
    let along = AlongPlan::new(stages, [&at.a, &at.b], model.dims(), 0);
    tube(size).write(along, &mut found);
    found
}

#[test]
fn a_step_has_the_bounds_tightened_along_the_shifted_plan_of_the_step_before() {
    let mut nmpc = controller(0.05);
    let reference = [9.2, 14.2].repeat(N);
    let mut x = START.to_vec();
    let mut expected = back_offs(0.05, &[START.repeat(N), vec![0.0; 2 * N]]);
    for step in 0..6 {
        let report = nmpc.step(&x, &reference).unwrap();
        assert_eq!(report.status, SqpStatus::Converged, "{step}");
        let u = report.u.to_vec();
        let found = nmpc.tightened().unwrap();
        assert!(found.fits);
        for (found, expected) in [
            (&found.back_offs.states, &expected.states),
            (&found.back_offs.inputs, &expected.inputs),
        ] {
            for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
                assert!((found - expected).abs() < 1e-9, "{step}, {i}: {found} {expected}");
            }
        }
        // The plan expects the states within the back-offs.
        let ranges = nmpc.expected().unwrap();
        assert_eq!(ranges.len(), N);
        for (j, [low, high]) in ranges.iter().enumerate() {
            for i in 0..4 {
                let (x, by) = (nmpc.plan().states()[4 * j + i], expected.states[4 * j + i]);
                assert!((low[i] - x + by).abs() < 1e-9 && (high[i] - x - by).abs() < 1e-9);
            }
        }
        // The first level is to go beyond its bound, and stops where the bound has moved to.
        let levels = nmpc.plan().states().chunks_exact(4).enumerate();
        let least = levels.map(|(j, level)| 9.0 - expected.states[4 * j] - level[0]);
        let least = least.fold(f64::INFINITY, f64::min);
        assert!(least > -1e-6, "{step}: {least}");
        assert!(step < 2 || least < 1e-5, "{step}: {least}");
        expected = back_offs(0.05, &shifted(&nmpc));
        let mut next = vec![0.0; 4];
        model().step(&x, &u, &[], &mut next);
        x = next;
    }
}

#[test]
fn a_tube_of_no_width_changes_no_bit() {
    let mut plain = Nmpc::new(problem(), Box::new(model()), SqpConfig::default()).unwrap();
    let mut tube = controller(0.0);
    let mut x = START.to_vec();
    for _ in 0..4 {
        let reference = [9.2, 14.2].repeat(N);
        let u = plain.step(&x, &reference).unwrap().u.to_vec();
        assert_eq!(tube.step(&x, &reference).unwrap().u, u);
        let mut next = vec![0.0; 4];
        model().step(&x, &u, &[], &mut next);
        x = next;
    }
}

/// The first guess is moved into the bounds, which are those of the problem again.
#[test]
fn a_controller_that_is_reset_forgets_its_tube() {
    let far = [3.0, 15.0, 1.0, 5.0];
    let reference = [12.0, 14.2].repeat(N);
    let mut nmpc = controller(0.4);
    let first = nmpc.step(&START, &reference).unwrap().u.to_vec();
    nmpc.reset();
    nmpc.step(&far, &[4.0, 10.0].repeat(N)).unwrap();
    nmpc.reset();
    assert_eq!(nmpc.step(&START, &reference).unwrap().u, first);
}

#[test]
fn where_nothing_is_left_no_plan_fits() {
    let mut nmpc = controller(3.0);
    nmpc.step(&START, &[9.2, 14.2].repeat(N)).unwrap();
    assert!(!nmpc.tightened().unwrap().fits);
    let mut plain = Nmpc::new(problem(), Box::new(model()), SqpConfig::default()).unwrap();
    plain.step(&START, &[9.2, 14.2].repeat(N)).unwrap();
    assert!(plain.tightened().is_none() && plain.expected().is_none());
}

#[test]
fn bounds_of_a_schedule_are_tightened() {
    let (mut nmpc, dims) = (controller(0.05), model().dims());
    let mut row = BoundSchedule::row(&problem(), dims);
    // The upper bound of the first state.
    row[6] = 8.8;
    let rows = Timetable::new(row.len(), [(0, row)]).unwrap();
    let schedule = BoundSchedule::new(rows, &problem(), dims).unwrap();
    nmpc.set_bounds_at(&schedule, 0, true);
    for _ in 0..3 {
        nmpc.step(&START, &[9.2, 14.2].repeat(N)).unwrap();
    }
    let by = &nmpc.tightened().unwrap().back_offs.states;
    let levels = nmpc.plan().states().chunks_exact(4).enumerate();
    let least = levels.map(|(j, level)| 8.8 - by[4 * j] - level[0]).fold(f64::INFINITY, f64::min);
    assert!(least.abs() < 1e-5, "{least}");
}

#[test]
fn what_does_not_go_with_a_tube_is_refused() {
    let delayed = NmpcProblem { delay: 1, ..problem() };
    let tubed = Nmpc::builder(delayed).model(Box::new(model())).tube(Box::new(tube(0.05)));
    assert_eq!(tubed.build().unwrap_err(), MpcError::WithTube("a delay"));
    let near = || Box::new(model());
    let far = Box::new(Rk4::new(FourTanks::antonelo(), 20.0, 8));
    let stages = Nmpc::builder(problem()).stages(near(), 4).stages(far, 2);
    let refused = stages.tube(Box::new(tube(0.05))).build().unwrap_err();
    assert_eq!(refused, MpcError::WithTube("stages of different lengths"));
}

/// Two states that push each other, with an output of both.
#[derive(Clone, Debug)]
struct Pushed;

impl Plant for Pushed {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("x", ""), Variable::new("w", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("u", ""), Variable::new("v", "")];
        &VARIABLES
    }

    fn outputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("y", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = u[0] - x[0] * 0.5 + x[1].sin() * 0.3 - x[0] * x[0] * x[0] * 0.1;
        dx[1] = x[0] * x[1] * 0.5 - x[1] + u[1] * 0.8 - x[1] * x[1] * 0.2;
    }

    fn output<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[0] + x[1] * x[1] * 0.5;
    }
}

/// The bounds of a step that move with its plan change the merit function from trial to trial: where it
/// refuses a step, they stay, and the plan is found.
#[test]
fn many_tightenings_of_a_step_do_not_stop_it() {
    let model = Rk4::new(Pushed, 0.4, 1);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds::new(vec![-1.0, -1.0], vec![1.0, 0.8]),
        output_bounds: Some(Bounds::new(vec![f64::NEG_INFINITY], vec![1.1])),
        input_bounds: Bounds::new(vec![-2.0; 2], vec![2.0; 2]),
        ..NmpcProblem::new(model.dims(), 8, Weights::uniform(vec![1.0; 2], vec![1e-3; 2]))
    };
    for start in [[0.0, 0.0], [0.05, 0.0], [0.2, 0.1], [-0.3, 0.2]] {
        for programs in [1, 5, 30] {
            let sources = Sources {
                probability: Some(0.999),
                process_sd: vec![0.03, 0.02],
                ..Sources::default()
            };
            let units = vec![1.0; 2];
            let follows = TubeModel { model: Box::new(model.clone()), more: Vec::new() };
            let sizes = (model.dims(), 8);
            let tube = EllipsoidTube::new(sizes, sources, Some(follows), Feedback::None, units);
            let tube = tube.unwrap().tightening_programs(programs);
            let builder = Nmpc::builder(problem.clone()).model(Box::new(model.clone()));
            let mut nmpc = builder.tube(Box::new(tube)).build().unwrap();
            let report = nmpc.step(&start, &[2.0, 1.5].repeat(8)).unwrap();
            assert_eq!(report.status, SqpStatus::Converged, "{start:?} {programs}");
            assert!(nmpc.tightened().unwrap().fits, "{start:?} {programs}");
        }
    }
}
