//! One step of the controller with RK4 x4 as the model, from the same state each time: the first
//! step, with nothing to start from, and a later one, which starts from the plan of the one before.

use divan::{Bencher, black_box};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, Tracked, Weights};
use pinc_ode::{Model, Rk4};
use pinc_plants::{FourTanks, VanDerPol};

fn main() {
    divan::main();
}

/// A control problem, a state and the references over the horizon.
struct Case {
    nmpc: Nmpc,
    x: Vec<f64>,
    reference: Vec<f64>,
}

#[divan::bench]
fn first_step_van_der_pol(bencher: Bencher<'_, '_>) {
    first_step(bencher, van_der_pol());
}

#[divan::bench]
fn first_step_four_tanks(bencher: Bencher<'_, '_>) {
    first_step(bencher, four_tanks());
}

#[divan::bench]
fn later_step_van_der_pol(bencher: Bencher<'_, '_>) {
    later_step(bencher, van_der_pol());
}

#[divan::bench]
fn later_step_four_tanks(bencher: Bencher<'_, '_>) {
    later_step(bencher, four_tanks());
}

fn first_step(bencher: Bencher<'_, '_>, mut case: Case) {
    bencher.bench_local(|| {
        case.nmpc.reset();
        case.step();
    });
}

fn later_step(bencher: Bencher<'_, '_>, mut case: Case) {
    case.step();
    bencher.bench_local(|| case.step());
}

impl Case {
    fn step(&mut self) {
        let report = self.nmpc.step(&self.x, &self.reference).expect("numbers of the right shape");
        black_box(report.u);
    }
}

/// The closed loop's problem of the oscillator (the paper's Section 5), on its way to 0.8.
fn van_der_pol() -> Case {
    case(
        Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)),
        Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        Bounds { low: vec![-1.0], high: vec![1.0] },
        (&[0.2, 0.1], &[0.8, 0.0]),
    )
}

/// The controller of the tanks, on their way up.
fn four_tanks() -> Case {
    case(
        Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4)),
        Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        (&[8.5, 13.0, 2.2, 2.2], &[9.159_582_958_982_018, 14.211_590_549_777_885]),
    )
}

/// N1 = 1, N2 = Nu = 5, Q = 10 I, R = I; the first two states are controlled.
fn case(
    model: Box<dyn Model>,
    state_bounds: Bounds,
    input_bounds: Bounds,
    (x, reference): (&[f64], &[f64]),
) -> Case {
    let dims = model.dims();
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0; dims.nu]);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds,
        input_bounds,
        ..NmpcProblem::new(dims, 5, weights)
    };
    let nmpc = Nmpc::new(problem, model, SqpConfig::default()).expect("a valid problem");
    Case { nmpc, x: x.to_vec(), reference: reference.repeat(5) }
}
