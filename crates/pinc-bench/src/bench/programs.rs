//! Time of the controller's quadratic programs. pinc-mpc does not expose its solvers: the time of a
//! control step without its model is the time of the solvers and of the checks around them.

use super::cases::Case;
use super::results::QpTime;
use pinc_config::ModelKind;
use pinc_mpc::{Nmpc, QpMethod};
use pinc_ode::{Dims, Gradients, Linearization, Model, Stages};
use pinc_record::{median, to_f64};
use pinc_runs::{LoopSetup, RunError};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// The methods that are measured.
const METHODS: [QpMethod; 3] = [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel];

/// The time of a program by each method, in the shipped closed loop with Runge-Kutta.
pub(super) fn run(case: Case, repetitions: usize) -> Result<Vec<QpTime>, RunError> {
    METHODS.iter().map(|&method| measure(case, method, repetitions)).collect()
}

fn measure(case: Case, method: QpMethod, repetitions: usize) -> Result<QpTime, RunError> {
    let experiment = case.experiment(&[&format!("control.sqp.qp={method}")])?;
    let spec = experiment.control.as_ref().expect("the shipped loops have a controller");
    let sample_time_s = experiment.sample_time_s().expect("the shipped loops train a net");
    let plant = &*experiment.plant.dyn_plant();
    let setup = LoopSetup::numerical(spec, sample_time_s, plant);
    let in_model = Spent::default();
    let model = Watched { model: setup.model(ModelKind::RK4, plant)?, spent: in_model.clone() };
    let mut nmpc = Nmpc::new(setup.problem(), Box::new(model), spec.sqp)?;
    let mut times = Vec::new();
    for _ in 0..repetitions {
        let mut run = setup.begin(&mut nmpc)?;
        in_model.take_ns();
        let in_controller = Spent::default();
        let mut programs = 0;
        while let Some(control) = in_controller.watch(|| run.control())? {
            programs += control.record().sqp_iterations;
            control.advance()?;
        }
        let ns = in_controller.take_ns() - in_model.take_ns();
        times.push(1e-3 * to_f64(ns) / to_f64(programs as u64));
    }
    Ok(QpTime {
        plant: case.name(),
        solver: method.to_string(),
        us: median(&times),
        note: "control step less its model, per program: includes the SQP's own checks",
    })
}

/// A sum of times, in ns, that its clones share.
#[derive(Clone, Debug, Default)]
struct Spent(Arc<AtomicU64>);

impl Spent {
    /// Does `work` and adds its time.
    fn watch<T>(&self, work: impl FnOnce() -> T) -> T {
        let clock = Instant::now();
        let result = work();
        let ns = u64::try_from(clock.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.0.fetch_add(ns, Ordering::Relaxed);
        result
    }

    /// The sum, which begins anew.
    fn take_ns(&self) -> u64 {
        self.0.swap(0, Ordering::Relaxed)
    }
}

/// A model whose time is known.
#[derive(Debug)]
struct Watched {
    model: Box<dyn Model>,
    spent: Spent,
}

impl Model for Watched {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.spent.watch(|| self.model.step(x, u, p, next));
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.spent.watch(|| self.model.linearize(at, out));
    }

    fn pull_back(&mut self, at: Stages<'_>, weights: &[f64], out: Gradients<'_>) -> bool {
        self.spent.watch(|| self.model.pull_back(at, weights, out))
    }
}
