//! A step of the controller by the length of the horizon, with each method for its QPs: RK4 x4 as the model, from
//! the same state each time and from the plan of the step before.

use divan::{Bencher, black_box};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, QpMethod, SqpConfig, Weights};
use pinc_ode::{FourTanks, Predictor, Rk4, VanDerPol};
use std::fmt;

fn main() {
    divan::main();
}

/// N2 = Nu
const HORIZONS: [usize; 6] = [5, 10, 20, 40, 80, 160];

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

#[divan::bench(args = sizes(), sample_count = 20, sample_size = 1)]
fn van_der_pol(bencher: Bencher<'_, '_>, size: Size) {
    step(
        bencher,
        size,
        Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)),
        [
            Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
            Bounds { low: vec![-1.0], high: vec![1.0] },
        ],
        (&[0.2, 0.1], &[0.8, 0.0]),
    );
}

#[divan::bench(args = sizes(), sample_count = 20, sample_size = 1)]
fn four_tanks(bencher: Bencher<'_, '_>, size: Size) {
    step(
        bencher,
        size,
        Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4)),
        [
            Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
            Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ],
        (&[8.5, 13.0, 2.2, 2.2], &[9.159_582_958_982_018, 14.211_590_549_777_885]),
    );
}

/// Q = 10 I, R = I; the first two states are controlled.
fn step(
    bencher: Bencher<'_, '_>,
    Size { horizon, qp }: Size,
    model: Box<dyn Predictor>,
    [state_bounds, input_bounds]: [Bounds; 2],
    (x, reference): (&[f64], &[f64]),
) {
    let dims = model.dims();
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0; dims.inputs]);
    let problem = NmpcProblem {
        controlled: vec![0, 1],
        state_bounds,
        input_bounds,
        ..NmpcProblem::new(dims, horizon, weights)
    };
    let config = SqpConfig { qp, ..SqpConfig::default() };
    let mut nmpc = Nmpc::new(problem, model, config).expect("a valid problem");
    let reference = reference.repeat(horizon);
    let mut step = || {
        black_box(nmpc.step(x, &reference).expect("numbers of the right shape").u);
    };
    // The first steps have no plan to start from.
    (0..3).for_each(|_| step());
    bencher.bench_local(step);
}
