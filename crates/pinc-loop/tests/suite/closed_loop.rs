//! The closed loop: what it samples, how it ends.

use crate::problems::van_der_pol;
use crate::support::{Lag, Linear, scalar_problem};
use pinc_ad::Scalar;
use pinc_loop::{ClosedLoop, LoopRecord, Observer, PlantNow};
use pinc_mpc::{
    Bounded, Bounds, MpcError, Nmpc, NmpcProblem, Reference, Side, Softness, SqpConfig, SqpStatus,
    Tracked, Weights,
};
use pinc_ode::metrics::Tracking;
use pinc_ode::{Dims, Dopri5, OdeError, Plant, Rk4, Variable};
use pinc_plants::VanDerPol;

/// x' = rate x^2 + u, which from x = 1 without input is at 1/(1 - rate t).
#[derive(Clone, Debug)]
struct Runaway {
    rate: f64,
}

impl Plant for Runaway {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = x[0] * x[0] * self.rate + u[0];
    }
}

/// x' = u, y = (x, -x).
#[derive(Clone, Debug)]
struct TwoSensors(Runaway);

impl Plant for TwoSensors {
    fn states(&self) -> &[Variable] {
        self.0.states()
    }

    fn inputs(&self) -> &[Variable] {
        self.0.inputs()
    }

    fn outputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("y1", ""), Variable::new("y2", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        self.0.rhs(x, u, p, dx);
    }

    fn output<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], y: &mut [S]) {
        y.copy_from_slice(&[x[0], -x[0]]);
    }
}

/// A controller of the model x\[k+1\] = x\[k\] + u\[k\] that may not act.
fn idle() -> Nmpc {
    let mut problem = scalar_problem(2, 2);
    problem.input_bounds.low = vec![0.0];
    problem.input_bounds.high = vec![0.0];
    problem.state_bounds.high = vec![2.5];
    let model = Box::new(Linear::scalar(1.0, 1.0));
    Nmpc::new(problem, model, SqpConfig::default()).unwrap()
}

#[test]
fn the_trace_has_nine_points_a_step() {
    let mut nmpc = idle();
    let reference = Reference::new(vec![7.0, 8.0, 9.0], 1).unwrap();
    let truth = Dopri5::new(Runaway { rate: 0.25 }, 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0]).unwrap();
    let mut seen = Vec::new();
    while let Some(control) = run.control().unwrap() {
        control.advance().unwrap();
        let step = run.last_step();
        assert_eq!(step.len(), 1 + 9);
        let sample = |i: usize| (step.times()[i], step.state(i)[0], run.reference_at(i)[0]);
        // The first point of a step is the last one of the step before.
        seen.extend((usize::from(!seen.is_empty())..step.len()).map(sample));
    }
    assert_eq!(seen.len(), 3 * 9 + 1);

    // The plant by its formula, on the same points; local errors of 1e-12, some tens of steps.
    let mut dense = Tracking::new(1);
    let mut at_steps = Tracking::new(1);
    let references = [7.0, 8.0, 9.0];
    for i in 0..=27_u32 {
        let t = f64::from(i) / 9.0;
        let x = 1.0 / (1.0 - 0.25 * t);
        let sample = i as usize;
        let (seen_t, seen_x, seen_r) = seen[sample];
        assert!((seen_t - t).abs() < 1e-14);
        assert!((seen_x - x).abs() < 1e-9);
        let r = references[if i == 0 { 0 } else { (sample - 1) / 9 }];
        assert!((seen_r - r).abs() < 1e-15);
        dense.push(&[r], &[x]);
        if i > 0 && i % 9 == 0 {
            at_steps.push(&[r], &[x]);
        }
    }
    assert!((run.tracking_dense().iae_sum() - dense.iae_sum()).abs() < 1e-8);
    assert!((run.tracking_dense().rmse() - dense.rmse()).abs() < 1e-9);
    assert!((run.tracking_at_steps().iae_sum() - at_steps.iae_sum()).abs() < 1e-8);
    // x(3) = 4 against its bound of 2.5, which the model knows nothing of.
    assert!((run.max_violation() - 1.5).abs() < 1e-9);
    let broken: Vec<_> = run.violations().collect();
    assert_eq!(broken.len(), 1);
    assert_eq!(
        (broken[0].of, broken[0].side, broken[0].hard),
        (Bounded::State(0), Side::High, true)
    );
    let numbers = [broken[0].bound, broken[0].amount, broken[0].at_steps, broken[0].size];
    for (found, expected) in numbers.into_iter().zip([2.5, 1.5, 1.5, 4.0]) {
        assert!((found - expected).abs() < 1e-9, "{broken:?}");
    }
    assert!((broken[0].time_s - 3.0).abs() < 1e-12);
}

/// Each bound has its own worst violation with its time, at the ends of steps and between them.
#[test]
fn broken_bounds_are_distinguished() {
    let problem = NmpcProblem {
        state_bounds: Bounds::new(vec![-0.6, f64::NEG_INFINITY], vec![0.55, 0.15]),
        state_softness: Softness::Penalty(vec![3.0, 3.0]),
        ..van_der_pol()
    };
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    let reference = Reference::new([[0.8, 0.0].repeat(10), [-0.8, 0.0].repeat(10)].concat(), 2);
    let truth = Dopri5::new(VanDerPol::default(), 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference.unwrap(), &[0.5, 0.2]).unwrap();
    let (LoopRecord { trajectory: trace, .. }, ended) = run.run_recorded();
    ended.unwrap();
    let mut expected = Vec::new();
    for (i, side, bound) in [(0, Side::Low, -0.6), (0, Side::High, 0.55), (1, Side::High, 0.15)] {
        let amount = |k: &usize| {
            let value = trace.state(*k)[i];
            if side == Side::Low { bound - value } else { value - bound }
        };
        let worst = (1..trace.len()).max_by(|a, b| amount(a).total_cmp(&amount(b))).unwrap();
        let ends = (9..trace.len()).step_by(9).map(|k| amount(&k)).fold(0.0, f64::max);
        if amount(&worst) > 0.0 {
            expected.push((i, side, bound, amount(&worst), trace.times()[worst], ends));
        }
    }
    assert!(expected.len() >= 2, "{expected:?}");
    let broken: Vec<_> = run.violations().collect();
    assert_eq!(broken.len(), expected.len());
    for (found, (i, side, bound, amount, time_s, ends)) in broken.into_iter().zip(expected) {
        assert_eq!((found.of, found.side, found.hard), (Bounded::State(i), side, false));
        let found = [found.bound, found.amount, found.time_s, found.at_steps].map(f64::to_bits);
        assert_eq!(found, [bound, amount, time_s, ends].map(f64::to_bits));
    }
    let largest = run.violations().map(|of| of.amount).fold(0.0, f64::max);
    assert_eq!(run.max_violation().to_bits(), largest.to_bits());
}

/// The plant integrated again under the inputs of the trace, each from its time on, gives the
/// trace.
#[test]
fn the_inputs_of_the_trace_hold_from_their_times_on() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let mut nmpc = Nmpc::new(van_der_pol(), Box::new(model), SqpConfig::default()).unwrap();
    let reference = Reference::new([0.8, 0.0].repeat(12), 2).unwrap();
    let truth = Dopri5::new(VanDerPol::default(), 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[0.5, 0.2]).unwrap();
    let (LoopRecord { trajectory: trace, .. }, ended) = run.run_recorded();
    ended.unwrap();
    assert_eq!(trace.len(), 12 * 9 + 1);
    let mut again = Dopri5::new(VanDerPol::default(), 1e-12);
    let mut x = trace.state(0).to_vec();
    for i in 1..trace.len() {
        let duration = trace.times()[i] - trace.times()[i - 1];
        again.integrate(&mut x, trace.input(i - 1), duration).unwrap();
        for (found, expected) in x.iter().zip(trace.state(i)) {
            assert!((found - expected).abs() < 1e-9, "sample {i}: {found} {expected}");
        }
    }
    // The inputs differ from step to step, or all this says nothing.
    assert!((trace.input(0)[0] - trace.input(9)[0]).abs() > 1e-3);
}

/// x' = u at rest: the errors come from the reference alone.
#[test]
fn segments_end_where_the_controller_prepares_the_next() {
    let run_with = |preview: bool| {
        let mut nmpc = idle();
        let values = [vec![1.0; 14], vec![1.5; 3], vec![0.75; 12]].concat();
        let reference = Reference::new(values, 1).unwrap();
        let truth = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
        let run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0]).unwrap();
        let mut run = if preview { run } else { run.without_preview() };
        run.run().unwrap();
        assert!((run.largest_errors()[0] - 0.5).abs() < 1e-9);
        run.segments(&[0.1])
    };
    for preview in [true, false] {
        let segments = run_with(preview);
        let steps: Vec<_> = segments.iter().map(|segment| segment.steps.clone()).collect();
        assert_eq!(steps, [0..14, 14..17, 17..29]);
        let offsets: Vec<f64> = segments.iter().map(|segment| segment.offset[0]).collect();
        for (found, expected) in offsets.iter().zip([0.0, f64::NAN, 0.25]) {
            let is_near = (found - expected).abs() < 1e-9 || found.is_nan() && expected.is_nan();
            assert!(is_near, "{offsets:?}");
        }
        let settled: Vec<_> = segments.iter().map(|segment| segment.settled).collect();
        assert_eq!(settled, [Some(0), None, None]);
    }
}

/// A reference that moves on from the beginning is one segment, which nothing comes to rest at.
#[test]
fn a_reference_that_moves_on_has_no_offset() {
    let mut nmpc = idle();
    let ramp: Vec<f64> = (0..40_u8).map(|k| 1.0 + 0.1 * f64::from(k.min(25))).collect();
    let reference = Reference::new(ramp, 1).unwrap();
    let truth = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0]).unwrap().without_preview();
    run.run().unwrap();
    assert_eq!(run.segments(&[f64::INFINITY]), []);
    let segments = run.segments(&[0.1]);
    let steps: Vec<_> = segments.iter().map(|segment| segment.steps.clone()).collect();
    assert_eq!(steps, [0..25, 25..40]);
    assert!(segments[0].offset[0].is_nan(), "{segments:?}");
    assert!((segments[1].offset[0] - 2.5).abs() < 1e-9, "{segments:?}");
}

/// x = 1/(1 - t/25) under a reference of 1 for ten steps, then of 2: of the ten marks of each, the
/// last five count.
#[test]
fn segments_are_judged_by_their_own_marks() {
    let segments = |preview: bool, steps: usize| {
        let mut nmpc = idle();
        let reference = Reference::new([[1.0; 10], [2.0; 10]].concat(), 1).unwrap();
        let truth = Dopri5::new(Runaway { rate: 0.04 }, 1e-12);
        let run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0]).unwrap();
        let mut run = if preview { run } else { run.without_preview() };
        for _ in 0..steps {
            run.control().unwrap().unwrap().advance().unwrap();
        }
        let segments = run.segments(&[0.5]).into_iter();
        segments.map(|segment| (segment.offset[0], segment.settled)).collect::<Vec<_>>()
    };
    let near = |found: Vec<(f64, Option<usize>)>, expected: &[(f64, Option<usize>)]| {
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for (found, expected) in found.iter().zip(expected) {
            let is_near =
                (found.0 - expected.0).abs() < 1e-9 || found.0.is_nan() && expected.0.is_nan();
            assert!(is_near && found.1 == expected.1, "{found:?}");
        }
    };
    let mean = |marks: std::ops::RangeInclusive<u32>, reference: f64| {
        marks.map(|t| (1.0 / (1.0 - f64::from(t) / 25.0) - reference).abs()).sum::<f64>() / 5.0
    };
    let (first, second) = (mean(6..=10, 1.0), mean(16..=20, 2.0));
    near(segments(false, 20), &[(first, None), (second, None)]);
    // With a preview of two steps the controller prepares the 2 after eight, which are too few.
    near(segments(true, 20), &[(f64::NAN, Some(0)), (second, None)]);
    // What has not begun is not judged, nor what has hardly.
    near(segments(false, 10), &[(first, None)]);
    near(segments(false, 13), &[(first, None), (f64::NAN, Some(0))]);
}

#[test]
fn a_plant_that_cannot_be_integrated_leaves_earlier_results() {
    let mut nmpc = idle();
    let reference = Reference::new(vec![0.0; 5], 1).unwrap();
    // Infinite at t = 1/0.62 = 1 + 5.5/9: in the second step, past 5 of its 9 points.
    let truth = Dopri5::new(Runaway { rate: 0.62 }, 1e-9);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0]).unwrap();
    assert_eq!(run.tracking_dense(), Tracking::new(1));
    let (record, ended) = run.run_recorded();
    let error = ended.unwrap_err();
    let MpcError::Plant { step, source } = error else {
        panic!("{error}");
    };
    assert_eq!(step, 1);
    assert!(matches!(source, OdeError::NotFinite { .. } | OdeError::StepTooSmall { .. }));
    assert_eq!(record.trajectory.len(), 1 + 9 + 5);
    assert_eq!(record.steps.len(), 2);
    assert_eq!(run.last_step().len(), 1 + 5);
    assert!(run.control().unwrap().is_none());
    // Every sample counts once; what is followed is 0.
    let samples = 0..record.trajectory.len();
    let expected: f64 = samples.map(|i| record.trajectory.state(i)[0]).sum();
    assert!((run.tracking_dense().iae_sum() - expected).abs() < 1e-12 * expected);
}

#[test]
fn the_controller_forgets_earlier_runs() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let mut nmpc = Nmpc::new(van_der_pol(), Box::new(model), SqpConfig::default()).unwrap();
    let reference = Reference::new([0.8, 0.0].repeat(12), 2).unwrap();
    let mut runs = Vec::new();
    for _ in 0..2 {
        let truth = Dopri5::new(VanDerPol::default(), 1e-9);
        let mut run = ClosedLoop::new(&mut nmpc, truth, reference.clone(), &[0.5, 0.2]).unwrap();
        let (record, ended) = run.run_recorded();
        ended.unwrap();
        runs.push(record);
    }
    assert_eq!(runs[0], runs[1]);
}

#[test]
fn a_step_that_is_dropped_is_the_same_when_it_is_asked_for_again() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let mut nmpc = Nmpc::new(van_der_pol(), Box::new(model), SqpConfig::default()).unwrap();
    let reference = Reference::new([0.8, 0.0].repeat(3), 2).unwrap();
    let truth = Dopri5::new(VanDerPol::default(), 1e-9);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[0.5, 0.2]).unwrap();
    let dropped = run.control().unwrap().unwrap().u().to_vec();
    assert_eq!(run.control().unwrap().unwrap().u(), dropped);
    let mut controls = 0;
    while let Some(control) = run.control().unwrap() {
        assert_eq!(control.record().status, SqpStatus::Converged);
        assert!(control.u()[0].abs() <= 1.0);
        control.advance().unwrap();
        controls += 1;
    }
    assert_eq!(controls, 3);
}

/// Sees a state that is 0.25 too high, and remembers what it was told.
#[derive(Debug, Default)]
struct TooHigh {
    asked: Vec<(usize, f64)>,
    inputs: Vec<f64>,
}

impl Observer for TooHigh {
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], parameters: &mut [f64]) {
        assert!(parameters.is_empty());
        assert_eq!(plant.y, plant.x);
        self.asked.push((plant.step, plant.x[0]));
        x[0] = plant.x[0] + 0.25;
    }

    fn advance(&mut self, u: &[f64]) {
        self.inputs.push(u[0]);
    }
}

#[test]
fn an_observer_is_asked_once_a_step_and_believed() {
    let build = || {
        let model = Box::new(Linear::scalar(1.0, 1.0));
        Nmpc::new(scalar_problem(2, 2), model, SqpConfig::default()).unwrap()
    };
    let (mut nmpc, mut alone) = (build(), build());
    let reference = Reference::new(vec![0.0; 3], 1).unwrap();
    let mut observer = TooHigh::default();
    let truth = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
    let run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0]).unwrap();
    let mut run = run.with_observer(&mut observer);
    let (mut states, mut inputs) = (Vec::new(), Vec::new());
    // In every step the first control is dropped.
    while run.control().unwrap().is_some() {
        let control = run.control().unwrap().unwrap();
        let (x, seen) = (control.seen()[0] - 0.25, control.seen().to_vec());
        let expected = alone.step(&seen, &[0.0; 2]).unwrap().u[0];
        assert!((control.u()[0] - expected).abs() < 1e-12, "{} {expected}", control.u()[0]);
        states.push(x);
        inputs.push(expected);
        control.advance().unwrap();
        alone.set_applied_input(&[expected]).unwrap();
    }
    assert_eq!(observer.asked.iter().map(|(step, _)| *step).collect::<Vec<_>>(), [0, 1, 2]);
    for ((_, found), expected) in observer.asked.iter().zip(states) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    for (found, expected) in observer.inputs.iter().zip(inputs) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    assert_eq!(observer.inputs.len(), 3);
}

/// Remembers the first output that it is told.
#[derive(Debug, Default)]
struct Readings(Vec<f64>);

impl Observer for Readings {
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], _parameters: &mut [f64]) {
        self.0.push(plant.y[0]);
        x.copy_from_slice(plant.x);
    }

    fn advance(&mut self, _u: &[f64]) {}
}

/// A reading is taken just before the input changes: under the input of the step before, and at
/// first under the one that the plant was given so far.
#[test]
fn readings_are_those_before_the_input_changes() {
    const LAG: Lag = Lag { rate: 0.1, outputs: &[(1.0, true)] };
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-5.0], vec![5.0]),
        output_bounds: Some(Bounds::new(vec![-9.0], vec![9.0])),
        ..NmpcProblem::new(Dims::new(1, 1), 3, Weights::uniform(vec![1.0], vec![0.1]))
    };
    let model = Box::new(Rk4::new(LAG, 1.0, 2));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let reference = Reference::new(vec![1.0, 1.0, 0.0], 1).unwrap();
    let mut readings = Readings::default();
    let run = ClosedLoop::new(&mut nmpc, Dopri5::new(LAG, 1e-12), reference, &[1.5]).unwrap();
    let mut run = run.with_initial_input(&[0.7]).unwrap().with_observer(&mut readings);
    let (mut before, mut expected) = (0.7, Vec::new());
    while let Some(control) = run.control().unwrap() {
        let u = control.u()[0];
        control.advance().unwrap();
        expected.push(run.last_step().state(0)[0] + before);
        assert_eq!(run.outputs_at(0), expected[expected.len() - 1..]);
        assert!((u - before).abs() > 0.01, "{u} {before}");
        before = u;
    }
    assert_eq!(readings.0, expected);
}

/// The error of a tracked input is that of the input which acts in the step.
#[test]
fn an_input_is_tracked_while_it_acts() {
    let problem = NmpcProblem {
        tracked: vec![Tracked::Input(0)],
        input_bounds: Bounds::new(vec![-5.0], vec![5.0]),
        ..NmpcProblem::new(Dims::new(1, 1), 3, Weights::uniform(vec![1.0], vec![0.5]))
    };
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let values = [1.0, -1.0, 0.5];
    let reference = Reference::new(values.to_vec(), 1).unwrap();
    let truth = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
    let run = ClosedLoop::new(&mut nmpc, truth, reference, &[0.0]).unwrap();
    let (mut run, mut expected) = (run.without_preview(), 0.0);
    for value in values {
        let control = run.control().unwrap().unwrap();
        expected += (control.u()[0] - value).abs();
        control.advance().unwrap();
    }
    let found = run.tracking_at_steps().iae_sum();
    assert!(expected > 0.1 && (found - expected).abs() < 1e-12, "{found} {expected}");
}

#[test]
fn a_plant_may_change_on_the_way() {
    let mut nmpc = idle();
    let reference = Reference::new(vec![1.0; 2], 1).unwrap();
    let at_rest = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, at_rest, reference, &[1.0]).unwrap();
    run.control().unwrap().unwrap().advance().unwrap();
    assert_eq!(run.last_step().state(9), [1.0]);
    run.set_plant(Dopri5::new(Runaway { rate: 0.25 }, 1e-12).into());
    run.control().unwrap().unwrap().advance().unwrap();
    // x = 1/(1 - rate t) after a second.
    assert!((run.last_step().state(9)[0] - 1.0 / 0.75).abs() < 1e-9);
    assert!(run.control().unwrap().is_none());
}

#[test]
#[should_panic(expected = "the sizes of a plant")]
fn a_plant_of_another_size_is_a_programming_error() {
    let mut nmpc = idle();
    let reference = Reference::new(vec![1.0; 2], 1).unwrap();
    let plant = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &[1.0]).unwrap();
    run.set_plant(Dopri5::new(VanDerPol::default(), 1e-12).into());
}

#[test]
fn parts_that_do_not_fit_are_errors() {
    let reference = |outputs| Reference::new(vec![0.0; 4], outputs).unwrap();
    let truth = || Dopri5::new(Runaway { rate: 0.1 }, 1e-9);
    let mut nmpc = idle();
    let refused = |error: MpcError| error.to_string();
    assert_eq!(
        ClosedLoop::new(&mut nmpc, truth(), reference(2), &[1.0]).map_err(refused).unwrap_err(),
        "the reference's outputs: 2 numbers, but 1 are expected"
    );
    assert_eq!(
        ClosedLoop::new(&mut nmpc, truth(), reference(1), &[1.0, 2.0])
            .map_err(refused)
            .unwrap_err(),
        "the initial state: 2 numbers, but 1 are expected"
    );
    assert_eq!(
        ClosedLoop::new(&mut nmpc, truth(), reference(1), &[f64::NAN])
            .map_err(refused)
            .unwrap_err(),
        "the initial state[0] is NaN, but must be finite"
    );
    let other = Dopri5::new(VanDerPol::default(), 1e-9);
    assert_eq!(
        ClosedLoop::new(&mut nmpc, other, reference(1), &[1.0]).map_err(refused).unwrap_err(),
        "the plant's states: 2 numbers, but 1 are expected"
    );
    let without = Dopri5::new(crate::parameters::Gain, 1e-9);
    assert_eq!(
        ClosedLoop::new(&mut nmpc, without, reference(1), &[1.0]).map_err(refused).unwrap_err(),
        "the plant's parameters: 0 numbers, but 2 are expected"
    );
    // Outputs have to equal the model's only if the controller uses them.
    let two_sensors = || Dopri5::new(TwoSensors(Runaway { rate: 0.0 }), 1e-9);
    assert!(ClosedLoop::new(&mut nmpc, two_sensors(), reference(1), &[1.0]).is_ok());
    let problem = NmpcProblem { tracked: Tracked::outputs([0]), ..scalar_problem(2, 2) };
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    assert_eq!(
        ClosedLoop::new(&mut nmpc, two_sensors(), reference(1), &[1.0])
            .map_err(refused)
            .unwrap_err(),
        "the plant's outputs: 2 numbers, but 1 are expected"
    );
}

/// With a delay of two steps the preview begins two steps later: a controller that hardly minds its
/// input has the integrator at each reference in time.
#[test]
fn a_delayed_input_is_chosen_by_the_reference_when_it_acts() {
    let weights = Weights::uniform(vec![1.0], vec![1e-10]);
    let problem = NmpcProblem { delay: 2, weights, ..scalar_problem(3, 3) };
    let model = Linear::scalar(1.0, 1.0);
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    let values = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, -0.5, 2.0, 2.0, 2.0];
    let reference = Reference::new(values.to_vec(), 1).unwrap();
    let truth = Dopri5::new(Runaway { rate: 0.0 }, 1e-12);
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[0.0]).unwrap();
    let (record, ended) = run.run_recorded();
    ended.unwrap();
    for (k, value) in values.iter().enumerate() {
        let x = record.trajectory.state(9 * (k + 1))[0];
        assert!((x - value).abs() < 1e-6, "after step {k}: {x} instead of {value}");
    }
}
