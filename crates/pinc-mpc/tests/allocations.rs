//! A control step allocates nothing, however it ends, and a closed loop keeps little of it.
#![expect(unsafe_code, reason = "an allocator that counts must implement an unsafe trait")]

use pinc_ad::Scalar;
use pinc_loop::ClosedLoop;
use pinc_mpc::{
    Bounds, Constraints, Nmpc, NmpcProblem, QpMethod, Reference, Scenarios, SqpConfig, SqpStatus,
    StageConstraints, Tracked, Weights,
};
use pinc_ode::{Dims, Dopri5, Linearization, Model, Rk4, Stages};
use pinc_plants::{FourTanks, VanDerPol};
use pinc_tube::{EllipsoidTube, Feedback, Sources, TubeModel};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// The system's allocator, with a count of each thread's requests: the test runner's own threads
/// allocate when they please.
struct Counting;

thread_local! {
    static REQUESTS: Cell<usize> = const { Cell::new(0) };
    /// Bytes that are in use.
    static HELD: Cell<isize> = const { Cell::new(0) };
}

fn requests() -> usize {
    REQUESTS.with(Cell::get)
}

fn held() -> isize {
    HELD.with(Cell::get)
}

fn hold(bytes: usize, more: isize) {
    let bytes = isize::try_from(bytes).unwrap_or(isize::MAX);
    HELD.with(|held| held.set(held.get() + more * bytes));
}

fn count() {
    REQUESTS.with(|requests| requests.set(requests.get() + 1));
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        hold(layout.size(), 1);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        hold(layout.size(), -1);
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.dealloc(memory, layout) }
    }
    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        hold(layout.size(), -1);
        hold(size, 1);
        // SAFETY: `memory` came from `System` with this layout.
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// |u| x2 is limited from above.
#[derive(Debug)]
struct Power;

impl StageConstraints for Power {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = x[1] * u[0] - 0.4;
    }
}

fn oscillator(config: SqpConfig) -> Nmpc {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let problem = NmpcProblem {
        state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        increment_bounds: Bounds { low: vec![-0.7], high: vec![0.7] },
        constraints: Some(Constraints::new(Power)),
        delay: 1,
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
    };
    Nmpc::new(problem, Box::new(model), config).unwrap()
}

/// With a tube along a plan, from all kinds of sources.
fn with_tube(config: SqpConfig) -> Nmpc {
    let nmpc = tanks(config);
    let (problem, model) = (nmpc.problem().clone(), Rk4::new(FourTanks::antonelo(), 10.0, 4));
    let problem = NmpcProblem { output_bounds: Some(problem.state_bounds.clone()), ..problem };
    let sources = Sources {
        probability: Some(0.9),
        process_sd: vec![0.01; 4],
        boxes: vec![0.01; 4],
        ..Sources::default()
    };
    let units = vec![10.0; 4];
    let own = TubeModel { model: Box::new(model.clone()), more: Vec::new() };
    let sizes = (model.dims(), problem.horizon);
    let tube = EllipsoidTube::new(sizes, sources, Some(own), Feedback::Riccati, units).unwrap();
    let builder = Nmpc::builder(problem).model(Box::new(model)).config(config);
    builder.tube(Box::new(tube)).build().unwrap()
}

fn tanks(config: SqpConfig) -> Nmpc {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        input_bounds: Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    };
    Nmpc::new(problem, Box::new(model), config).unwrap()
}

/// Takes the steps and says how many requests there were, and how the steps ended.
fn steps(nmpc: &mut Nmpc, cases: &[([f64; 4], [f64; 2])], n: usize) -> (usize, Vec<SqpStatus>) {
    let references: Vec<_> = cases.iter().map(|(_, y)| y.repeat(5)).collect();
    let mut statuses = Vec::with_capacity(cases.len());
    let before = requests();
    for ((x, _), reference) in cases.iter().zip(&references) {
        nmpc.prepare();
        let report = nmpc.step(&x[..n], reference).unwrap();
        statuses.push(report.status);
    }
    (requests() - before, statuses)
}

#[test]
fn a_control_step_allocates_nothing() {
    let near = ([0.2, 0.1, 0.0, 0.0], [0.8, 0.0]);
    let outside = ([2.5, -2.5, 0.0, 0.0], [0.8, 0.0]);
    let level = ([8.5, 13.0, 2.2, 2.2], [9.2, 14.2]);
    let flooded = ([8.5, 13.0, 15.0, 2.2], [9.2, 14.2]);
    for qp in [QpMethod::Auto, QpMethod::Condensed, QpMethod::Riccati] {
        for real_time in [false, true] {
            let config = SqpConfig { qp, real_time, ..SqpConfig::default() };
            let cases = [near, near, outside, near, near];
            let (requests, statuses) = steps(&mut oscillator(config), &cases, 2);
            assert_eq!(requests, 0, "{qp} {statuses:?}");
            let cases = [level, level, flooded, level];
            let (requests, statuses) = steps(&mut with_tube(config), &cases, 4);
            assert_eq!(requests, 0, "tube, {qp} {statuses:?}");
            let (requests, statuses) = steps(&mut tanks(config), &[level, flooded, level], 4);
            assert_eq!(requests, 0, "{qp} {statuses:?}");
            if !real_time {
                use SqpStatus::{Converged, InfeasibleQp};
                assert_eq!(statuses, [Converged, InfeasibleQp, Converged], "{qp}");
            }
        }
    }
}

/// x\[k+1\] = p x + u
#[derive(Debug)]
struct Leaky;

impl Model for Leaky {
    fn dims(&self) -> Dims {
        Dims::new(1, 1).with_parameters(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        next[0] = p[0] * x[0] + u[0];
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        for k in 0..at.x.len() {
            out.next[k] = at.p[k] * at.x[k] + at.u[k];
            (out.a[k], out.b[k]) = (at.p[k], 1.0);
        }
    }
}

#[test]
fn a_control_step_on_a_tree_allocates_nothing() {
    for real_time in [false, true] {
        let config = SqpConfig { real_time, ..SqpConfig::default() };
        let problem = NmpcProblem {
            state_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            parameters: vec![0.9],
            scenarios: Some(Scenarios::grid(vec![0], &[vec![0.9, 0.7, 1.2]], 2)),
            ..NmpcProblem::new(Leaky.dims(), 5, Weights::uniform(vec![10.0], vec![1.0]))
        };
        let mut nmpc = Nmpc::new(problem, Box::new(Leaky), config).unwrap();
        let before = requests();
        for x in [0.5, 0.6, -3.0, 0.2] {
            nmpc.prepare();
            let status = nmpc.step(&[x], &[0.9; 5]).unwrap().status;
            assert!(real_time || x < -1.0 || status == SqpStatus::Converged, "{x} {status}");
        }
        assert_eq!(requests() - before, 0, "{real_time}");
    }
}

/// It keeps the tracked quantities at the end of a step.
#[test]
fn a_closed_loop_keeps_a_few_bytes_of_a_step() {
    let mut nmpc = oscillator(SqpConfig::default());
    let steps = 5000;
    let reference = Reference::new([0.0, 0.0].repeat(steps), 2).unwrap();
    let plant = Dopri5::new(VanDerPol::default(), 1e-9);
    let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &[0.5, 0.2]).unwrap();
    run.control().unwrap().unwrap().advance().unwrap();
    let before = held();
    run.run().unwrap();
    let most = 2 * steps * 2 * size_of::<f64>();
    let kept = usize::try_from(held() - before).unwrap();
    assert!(kept <= most, "{kept} bytes");
    // Twice the tracked quantities, since a vector doubles: there are that many.
    assert!(kept >= steps * 2 * size_of::<f64>());
}
