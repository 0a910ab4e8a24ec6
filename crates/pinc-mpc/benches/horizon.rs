//! A real-time iteration by the length of the horizon, with each method for its QPs: one
//! linearization of all stages and one QP, whatever the state. RK4 x4 is the model, and the plant
//! in the loop.

use divan::{Bencher, black_box};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, QpMethod, SqpConfig, Tracked, Weights};
use pinc_ode::{Dims, Model, Plant, Rk4};
use pinc_plants::{FourTanks, VanDerPol};
use std::fmt;

fn main() {
    divan::main();
}

/// N2 = Nu
const HORIZONS: [usize; 6] = [5, 10, 20, 40, 80, 160];

/// Steps after which the reference is the other one.
const HELD: usize = 25;

/// A horizon and a method.
#[derive(Clone, Copy)]
struct Size {
    horizon: usize,
    qp: QpMethod,
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} N={}", self.qp, self.horizon)
    }
}

fn sizes() -> impl Iterator<Item = Size> {
    let methods = [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel];
    methods.into_iter().flat_map(|qp| HORIZONS.map(|horizon| Size { horizon, qp }))
}

#[divan::bench(args = sizes(), sample_count = 200, sample_size = 1)]
fn van_der_pol(bencher: Bencher<'_, '_>, size: Size) {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let bounds = [
        Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        Bounds { low: vec![-1.0], high: vec![1.0] },
    ];
    let references = [[0.8, 0.0], [-0.5, 0.0]];
    let mut run = Loop::new(size, model, bounds, &[0.2, 0.1], references);
    bencher.bench_local(|| run.step());
}

#[divan::bench(args = sizes(), sample_count = 200, sample_size = 1)]
fn four_tanks(bencher: Bencher<'_, '_>, size: Size) {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let bounds = [
        Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
    ];
    let references = [[9.16, 14.21], [8.0, 12.41]];
    let mut run = Loop::new(size, model, bounds, &[8.5, 13.0, 2.2, 2.2], references);
    bencher.bench_local(|| run.step());
}

/// A closed loop that goes on for ever between two references.
struct Loop<P> {
    nmpc: Nmpc,
    plant: Rk4<P>,
    x: Vec<f64>,
    next: Vec<f64>,
    references: [Vec<f64>; 2],
    steps: usize,
}

impl<P: Plant> Loop<P> {
    /// Q = 10 I, R = I; the first two states are controlled.
    fn new(
        Size { horizon, qp }: Size,
        model: Rk4<P>,
        [state_bounds, input_bounds]: [Bounds; 2],
        x: &[f64],
        references: [[f64; 2]; 2],
    ) -> Self {
        let dims @ Dims { nu, .. } = model.dims();
        let weights = Weights::uniform(vec![10.0; 2], vec![1.0; nu]);
        let problem = NmpcProblem {
            tracked: Tracked::states([0, 1]),
            state_bounds,
            input_bounds,
            ..NmpcProblem::new(dims, horizon, weights)
        };
        let config = SqpConfig { qp, real_time: true, ..SqpConfig::default() };
        let plant = model.clone();
        let nmpc = Nmpc::new(problem, Box::new(model), config).expect("a valid problem");
        let references = references.map(|reference| reference.repeat(horizon));
        Self { nmpc, plant, x: x.to_vec(), next: x.to_vec(), references, steps: 0 }
    }

    fn step(&mut self) {
        let reference = &self.references[self.steps / HELD % 2];
        let step = self.nmpc.step(&self.x, reference).expect("numbers of the right shape");
        self.plant.step(&self.x, black_box(step.u), &[], &mut self.next);
        std::mem::swap(&mut self.x, &mut self.next);
        self.steps += 1;
    }
}
