//! Closed loops with a plant that is not the model, and with an estimator, against the answers of
//! an independent program: the same problems in CasADi, the filter in `NumPy`.

mod trained;

use pinc_ad::Scalar;
use pinc_estimate::{
    Augmentation, Augmented, Compensated, Disturbance, Ekf, History, Measured, OutputFeedback,
    Tuning,
};
use pinc_loop::ClosedLoop;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Tracked, Weights};
use pinc_net::Domain;
use pinc_ode::{Dopri5, Model, PiecewiseConstant, Plant, Rk4, Variable};
use pinc_plants::{FourTanks, VanDerPol};
use trained::train;

/// A controlled plant, with what it is to do.
struct Task {
    model: Box<dyn Fn() -> Box<dyn Model>>,
    plant: Dopri5,
    problem: NmpcProblem,
    reference: Reference,
    start: Vec<f64>,
    /// What counts as settled.
    within: f64,
}

/// What came of it.
struct Answer {
    iae: f64,
    /// Per segment and tracked quantity.
    offsets: Vec<Vec<f64>>,
    /// In steps.
    settled: Vec<Option<usize>>,
    history: Option<History>,
}

impl Answer {
    /// The offset at the first value of the reference.
    fn first(&self, i: usize) -> f64 {
        self.offsets[0][i]
    }

    /// The largest offset of a tracked quantity over all segments.
    fn worst(&self, i: usize) -> f64 {
        self.offsets.iter().map(|offsets| offsets[i]).fold(0.0, f64::max)
    }
}

/// The loop with an estimator, or with all states seen.
fn run(task: Task, estimator: Option<(Augmentation, Tuning)>) -> Answer {
    let Task { model, plant, problem, reference, start, within } = task;
    let quantities = problem.tracked.len();
    let mut feedback = None;
    let (nmpc, observed) = match estimator {
        None => (Nmpc::new(problem, model(), SqpConfig::default()), false),
        Some((augmentation, tuning)) => {
            let augmented = Augmented::new(model(), augmentation.clone()).unwrap();
            let ekf = Ekf::new(Box::new(augmented), tuning).unwrap();
            let compensated = Compensated::new(model(), augmentation.clone()).unwrap();
            let parameters = vec![0.0; compensated.dims().np];
            let problem = NmpcProblem { parameters, ..problem };
            feedback = Some(OutputFeedback::new(Box::new(ekf), augmentation, Vec::new()));
            (Nmpc::new(problem, Box::new(compensated), SqpConfig::default()), true)
        }
    };
    let mut nmpc = nmpc.unwrap();
    let run = ClosedLoop::new(&mut nmpc, plant, reference, &start).unwrap();
    let mut run = match &mut feedback {
        Some(feedback) => run.with_observer(feedback),
        None => run,
    };
    let (record, ended) = run.run_recorded();
    ended.unwrap();
    assert_eq!(run.seen() == run.state(), !observed);
    assert!(record.steps.iter().all(|step| step.status == SqpStatus::Converged));
    let segments = run.segments(&vec![within; quantities]);
    let (iae, offsets, settled) = (
        run.tracking_dense().iae_sum(),
        segments.iter().map(|segment| segment.offset.clone()).collect(),
        segments.iter().map(|segment| segment.settled).collect(),
    );
    Answer { iae, offsets, settled, history: feedback.map(|of| of.history().clone()) }
}

fn staircase<const N: usize>(
    values: [[f64; N]; 4],
    each_s: f64,
    steps: usize,
    sample_time_s: f64,
) -> Reference {
    let starts = (0..4).map(|i| f64::from(i) * each_s).collect();
    let values = values.iter().map(|value| value.to_vec()).collect();
    let signal = PiecewiseConstant::new(starts, values).unwrap();
    Reference::sample(&signal, steps, sample_time_s).unwrap()
}

/// 2400 s of four tanks with pumps that deliver a part of what the model expects.
fn tanks(model: FourTanks, references: [[f64; 2]; 4], pumps: f64) -> Task {
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        input_bounds: Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    };
    let plant = FourTanks { pump: model.pump.map(|k| pumps * k), ..model };
    Task {
        model: Box::new(move || Box::new(Rk4::new(model, 10.0, 4))),
        plant: Dopri5::new(plant, 1e-12),
        problem,
        reference: staircase(references, 600.0, 240, 10.0),
        start: vec![2.0, 2.0, 0.6, 0.6],
        within: 0.1,
    }
}

/// The shipped references, which the gain of rank 1 can reach.
fn antonelo(pumps: f64) -> Task {
    let middle = [9.159582958982018, 14.211590549777885];
    let upper = [10.151255120853042, 15.750223780923415];
    let lower = [8.226164209850278, 12.763340653079485];
    tanks(FourTanks::antonelo(), [middle, upper, lower, middle], pumps)
}

fn johansson(pumps: f64) -> Task {
    let references = [[12.4, 12.7], [13.4, 13.2], [11.6, 12.4], [12.4, 12.7]];
    tanks(FourTanks::johansson_minimum(), references, pumps)
}

/// An estimator of the tanks with the lower levels measured.
fn two_sensors(disturbance: Disturbance) -> Option<(Augmentation, Tuning)> {
    let with = |state: f64, disturbed: f64| {
        let count = disturbance.count(2, 2);
        [vec![state; 4], vec![disturbed; count]].concat()
    };
    let tuning = Tuning {
        initial_estimate: [&[2.0, 2.0, 0.6, 0.6], &with(0.0, 0.0)[4..]].concat(),
        initial_sd: with(0.01, 0.5),
        process_sd: with(0.01, 0.1),
        measurement_sd: vec![0.01; 2],
        ..Tuning::default()
    };
    let measured = Augmentation::measured(Measured::states([0, 1]));
    Some((Augmentation { disturbance, ..measured }, tuning))
}

#[track_caller]
fn relative(found: f64, expected: f64, tolerance: f64) {
    assert!((found / expected - 1.0).abs() <= tolerance, "{found} is not {expected}");
}

#[track_caller]
fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
}

#[test]
fn worn_pumps_with_all_states_seen() {
    let answer = run(antonelo(0.95), None);
    relative(answer.iae, 1027.65, 1e-5);
    near(answer.first(0), 0.082, 5e-4);
    near(answer.first(1), 0.149, 5e-4);
    let answer = run(johansson(0.8), None);
    relative(answer.iae, 3383.65, 1e-5);
    near(answer.first(0), 0.741, 1e-3);
    near(answer.first(1), 0.590, 1e-3);
    let answer = run(antonelo(1.0), None);
    assert_eq!(answer.settled, [Some(8), Some(4), Some(4), Some(2)]);
}

/// Without a disturbance model there is an offset, larger than with all states seen.
#[test]
fn a_filter_alone_leaves_an_offset() {
    let answer = run(antonelo(0.95), two_sensors(Disturbance::None));
    relative(answer.iae, 1522.9, 4e-5);
    near(answer.first(0), 0.219, 1e-3);
    near(answer.first(1), 0.215, 1e-3);
}

#[test]
fn input_disturbances_take_the_offset_away() {
    for (task, iae) in [(antonelo(0.95), 577.76), (johansson(0.8), 632.29)] {
        let answer = run(task, two_sensors(Disturbance::Input));
        relative(answer.iae, iae, 1e-5);
        assert!(answer.worst(0) < 1e-4 && answer.worst(1) < 1e-4);
    }
}

#[test]
fn state_disturbances_take_the_offset_away() {
    for (task, iae) in [(antonelo(0.95), 605.46), (johansson(0.8), 629.42)] {
        let answer = run(task, two_sensors(Disturbance::States(vec![0, 1])));
        relative(answer.iae, iae, 1e-5);
        assert!(answer.worst(0) < 1e-4 && answer.worst(1) < 1e-4);
    }
}

/// Slowly: their offsets are not all gone when the next reference comes.
#[test]
fn output_disturbances_take_the_offset_away() {
    let cases =
        [(antonelo(0.95), 618.23, [0.0001, 0.0011]), (johansson(0.8), 710.94, [0.0016, 0.0099])];
    for (task, iae, offsets) in cases {
        let answer = run(task, two_sensors(Disturbance::Output));
        relative(answer.iae, iae, 1e-5);
        near(answer.first(0), offsets[0], 1e-4);
        near(answer.first(1), offsets[1], 1e-4);
    }
}

/// The oscillator under a load that its model does not know.
#[derive(Clone, Debug)]
struct Loaded;

impl Plant for Loaded {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        VanDerPol::default().rhs(x, &[u[0] - 0.15], p, dx);
    }
}

fn loaded_oscillator() -> Task {
    let problem = NmpcProblem {
        state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        ..NmpcProblem::new(Loaded.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
    };
    let references = [0.0, -0.5, 0.7, 0.3].map(|x1| [x1, 0.0]);
    Task {
        model: Box::new(|| Box::new(Rk4::new(VanDerPol::default(), 0.5, 4))),
        plant: Dopri5::new(Loaded, 1e-12),
        problem,
        reference: staircase(references, 15.0, 120, 0.5),
        start: vec![1.0, 0.0],
        within: 0.01,
    }
}

/// An estimator of the oscillator and its load with the position measured.
fn position_alone() -> Option<(Augmentation, Tuning)> {
    let tuning = Tuning {
        initial_estimate: vec![1.0, 0.0, 0.0],
        initial_sd: vec![1e-3, 1e-3, 0.5],
        process_sd: vec![1e-3, 1e-3, 0.1],
        measurement_sd: vec![1e-3],
        ..Tuning::default()
    };
    let position = Augmentation {
        disturbance: Disturbance::Input,
        ..Augmentation::measured(Measured::states([0]))
    };
    Some((position, tuning))
}

/// A small net as the model in controller and estimator: the disturbances compensate its errors
/// together with the plant's.
#[test]
fn with_a_net_there_is_no_offset_either() {
    let domain = Domain::new(vec![-2.0..=2.0; 2], [-1.5..=1.5]);
    let net = train(VanDerPol::default(), (0.5, 16), domain, 600);
    let model = move || -> Box<dyn Model> { Box::new(net.clone()) };
    let task = Task { model: Box::new(model), ..loaded_oscillator() };
    let answer = run(task, position_alone());
    relative(answer.iae, 143.79, 1e-2);
    assert!(answer.worst(0) < 1e-3, "{}", answer.worst(0));

    let states = [1.0..=20.0, 1.0..=20.0, 0.3..=6.0, 0.3..=6.0];
    let domain = Domain::new(states, vec![-2.0..=6.0; 2]);
    let net = train(FourTanks::johansson_minimum(), (10.0, 16), domain, 600);
    for (disturbance, iae) in
        [(Disturbance::Input, 632.29), (Disturbance::States(vec![0, 1]), 629.42)]
    {
        let net = net.clone();
        let model = move || -> Box<dyn Model> { Box::new(net.clone()) };
        let task = Task { model: Box::new(model), ..johansson(0.8) };
        let answer = run(task, two_sensors(disturbance));
        relative(answer.iae, iae, 1e-2);
        let worst = answer.worst(0).max(answer.worst(1));
        assert!(worst < 1e-3, "{worst}");
    }
}

#[test]
fn a_load_on_the_oscillator() {
    let answer = run(loaded_oscillator(), None);
    relative(answer.iae, 283.23, 2e-5);
    for (offsets, expected) in answer.offsets.iter().zip([0.177, 0.155, 0.159, 0.177]) {
        near(offsets[0], expected, 6e-4);
    }
    let answer = run(loaded_oscillator(), position_alone());
    relative(answer.iae, 143.79, 3e-5);
    for (offsets, expected) in answer.offsets.iter().zip([0.0009, 0.00004, 0.00009, 0.00003]) {
        near(offsets[0], expected, 1e-4);
    }
    let history = answer.history.unwrap();
    near(history.estimates[history.estimates.len() - 1], -0.15, 2e-5);
}

/// The four tanks with their pump constants as parameters.
#[derive(Clone, Debug)]
struct Pumps(FourTanks);

impl Plant for Pumps {
    fn states(&self) -> &[Variable] {
        self.0.states()
    }
    fn inputs(&self) -> &[Variable] {
        self.0.inputs()
    }
    fn parameters(&self) -> &[Variable] {
        static PUMPS: [Variable; 2] = [Variable::new("k1", ""), Variable::new("k2", "")];
        &PUMPS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        let unit = FourTanks { pump: [1.0; 2], ..self.0 };
        unit.rhs(x, &[u[0] * p[0], u[1] * p[1]], &[], dx);
    }
}

/// In place of disturbances, the pump constants are estimated.
#[test]
fn worn_pumps_are_identified_in_the_loop() {
    let nominal = FourTanks::antonelo().pump;
    let task = Task {
        model: Box::new(|| Box::new(Rk4::new(Pumps(FourTanks::antonelo()), 10.0, 4))),
        ..antonelo(0.8)
    };
    let pumps = Augmentation {
        parameters: nominal.to_vec(),
        estimated: vec![0, 1],
        ..Augmentation::measured(Measured::states([0, 1]))
    };
    let tuning = Tuning {
        initial_estimate: [&[2.0, 2.0, 0.6, 0.6][..], &nominal].concat(),
        initial_sd: vec![0.01, 0.01, 0.01, 0.01, 0.5, 0.5],
        process_sd: vec![0.01; 6],
        measurement_sd: vec![0.01; 2],
        ..Tuning::default()
    };
    let answer = run(task, Some((pumps, tuning)));
    relative(answer.iae, 755.70, 1e-5);
    assert!(answer.worst(0) < 1e-4 && answer.worst(1) < 1e-4);
    let history = answer.history.unwrap();
    let last = &history.estimates[history.estimates.len() - 2..];
    near(last[0], 2.66403, 1e-5);
    near(last[1], 2.67998, 1e-5);
}
