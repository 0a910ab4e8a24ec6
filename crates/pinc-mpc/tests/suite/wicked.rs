//! A model that returns anything, or panics: whatever the method, the inputs are finite and within
//! their limits, the status is never better than the truth, and a caller who catches a panic can go
//! on with the controller.
//!
//! `PINC_WICKED_STEPS=1000000` in the environment takes so many steps.

use crate::stream::Stream;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, QpMethod, Softness, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Dims, Linearization, Model, Stages};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Control steps, unless the environment says otherwise.
const STEPS: usize = 20_000;

/// The steps that each controller takes.
const EACH: usize = 50;

/// The panic of a model.
#[derive(Debug)]
struct OfModel;

/// What is done, or nothing if the model panics meanwhile. The library does not panic.
fn unless_model_panics<T>(what: impl FnOnce() -> T) -> Option<T> {
    match catch_unwind(AssertUnwindSafe(what)) {
        Ok(value) => Some(value),
        Err(panic) if panic.is::<OfModel>() => None,
        Err(panic) => resume_unwind(panic),
    }
}

/// A sound linear model, of which calls now and then return anything else.
#[derive(Debug)]
struct Wicked {
    stream: Stream,
    dims: Dims,
}

impl Wicked {
    /// Any number: without value, infinite, of any magnitude, or ordinary.
    fn any(&mut self) -> f64 {
        let sign = if self.stream.below(2) == 0 { 1.0 } else { -1.0 };
        match self.stream.below(12) {
            0 => f64::NAN,
            1 => sign * f64::INFINITY,
            2 => sign * 10.0_f64.powf(self.stream.within([-308.0, 308.0])),
            3 => sign * 10.0_f64.powf(self.stream.within([20.0, 308.0])),
            4 => 0.0,
            _ => self.stream.within([-3.0, 3.0]),
        }
    }

    /// Spoils some of the numbers, in one call in three. One in 200 panics.
    fn spoil(&mut self, parts: [&mut [f64]; 3]) {
        if self.stream.below(200) == 0 {
            // Without a message, which a panic prints even if it is caught.
            resume_unwind(Box::new(OfModel));
        }
        let [share, which] = [self.stream.below(9), self.stream.below(4)];
        for (i, part) in (0..).zip(parts) {
            for value in part {
                if share < 3 && (which == 3 || which == i) && self.stream.below(1 + 4 * share) == 0
                {
                    *value = self.any();
                }
            }
        }
    }
}

impl Model for Wicked {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        for (i, next) in next.iter_mut().enumerate() {
            *next = 0.9 * x[i] + 0.2 * x[0] + 0.5 * u[i % u.len()];
        }
        self.spoil([next, &mut [], &mut []]);
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims;
        for k in 0..at.count(dims) {
            let (at, out) = (at.point(k, dims), out.point(k, dims));
            out.a.fill(0.0);
            out.b.fill(0.0);
            for i in 0..dims.nx {
                out.next[i] = 0.9 * at.x[i] + 0.2 * at.x[0] + 0.5 * at.u[i % dims.nu];
                out.a[i * dims.nx + i] += 0.9;
                out.a[i * dims.nx] += 0.2;
                out.b[i * dims.nu + i % dims.nu] = 0.5;
            }
            self.spoil([out.next, out.a, out.b]);
        }
    }
}

fn bounds(stream: &mut Stream, count: usize, low: [f64; 2], high: [f64; 2]) -> Bounds {
    if stream.below(2) == 0 {
        return Bounds::none(count);
    }
    let mut list = |range| (0..count).map(|_| stream.within(range)).collect();
    Bounds { low: list(low), high: list(high) }
}

/// A controller of any kind.
fn controller(stream: &mut Stream, qp: QpMethod, real_time: bool, free: usize) -> Nmpc {
    let dims = Dims::new(1 + stream.index(3), 1 + stream.index(2));
    let softness = |stream: &mut Stream, count| match stream.below(3) {
        0 => Softness::Hard,
        1 => Softness::Exact,
        _ => Softness::Penalty(vec![stream.within([0.1, 100.0]); count]),
    };
    let problem = NmpcProblem {
        control_horizon: free,
        state_bounds: bounds(stream, dims.nx, [-4.0, -1.0], [1.0, 4.0]),
        state_softness: softness(stream, dims.nx),
        input_bounds: bounds(stream, dims.nu, [-2.0, 0.5], [0.5, 2.0]),
        increment_bounds: bounds(stream, dims.nu, [-0.5, 0.0], [0.0, 0.5]),
        delay: stream.index(2),
        ..NmpcProblem::new(
            dims,
            free + stream.index(3),
            Weights::uniform(vec![10.0; dims.nx], vec![1.0; dims.nu]),
        )
    };
    let config = SqpConfig { qp, real_time, max_iterations: 8, ..SqpConfig::default() };
    let model = Wicked { stream: Stream::new(stream.bits()), dims };
    Nmpc::new(problem, Box::new(model), config).unwrap()
}

fn take_steps(nmpc: &mut Nmpc, stream: &mut Stream, what: &str) {
    let problem = nmpc.problem().clone();
    let Dims { nx, nu, .. } = nmpc.model().dims();
    let mut previous = vec![0.0; nu];
    for k in 0..EACH {
        if stream.below(4) == 0 {
            let _ = unless_model_panics(|| nmpc.prepare());
        }
        let x: Vec<f64> = (0..nx).map(|_| stream.within([-5.0, 5.0])).collect();
        let y = vec![stream.within([-2.0, 2.0]); problem.horizon * nx];
        let controller = &mut *nmpc;
        let step = unless_model_panics(move || controller.step(&x, &y).unwrap());
        let Some(step) = step else { continue };
        for (c, (&u, &before)) in step.u.iter().zip(&previous).enumerate() {
            assert!(u.is_finite(), "{what}, step {k}: {u}");
            let (low, high) = (problem.input_bounds.low[c], problem.input_bounds.high[c]);
            assert!((low..=high).contains(&u), "{what}, step {k}: {u}");
            // From outside its bounds an input may go as far as to the nearest.
            let least = (before + problem.increment_bounds.low[c]).min(high);
            let most = (before + problem.increment_bounds.high[c]).max(low);
            assert!((least..=most).contains(&u), "{what}, step {k}: {before} to {u}");
        }
        let converged = step.status == SqpStatus::Converged;
        assert!(!converged || step.kkt.max() <= 1e-8, "{what}, step {k}: {:?}", step.kkt);
        let valued = step.kkt.max().is_finite();
        assert!(valued || step.status == SqpStatus::NumericalTrouble, "{what}, step {k}");
        previous.copy_from_slice(step.u);
        let plan = nmpc.plan();
        let numbers = [plan.states(), plan.inputs(), plan.dynamics_multipliers()];
        assert!(numbers.into_iter().flatten().all(|v| v.is_finite()), "{what}, step {k}");
    }
}

#[test]
fn inputs_are_sound_whatever_the_model_returns() {
    let steps = std::env::var("PINC_WICKED_STEPS").map_or(STEPS, |n| n.parse().unwrap());
    let mut stream = Stream::new(3);
    let methods = [QpMethod::Auto, QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel];
    for run in 0..steps.div_ceil(EACH) {
        let (qp, real_time) = (methods[run % 4], run / 4 % 2 == 0);
        // Every second controller has one free input.
        let free = if run / 8 % 2 == 0 { 1 } else { 1 + stream.index(10) };
        let mut nmpc = controller(&mut stream, qp, real_time, free);
        let what = format!("run {run}: {qp}, real time {real_time}, Nu {free}");
        take_steps(&mut nmpc, &mut stream, &what);
    }
}
