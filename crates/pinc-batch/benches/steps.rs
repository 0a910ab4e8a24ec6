//! Batches of first steps from random states with RK4 x4 as the model, with and without the gradient
//! of the input, on one thread.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use pinc_batch::{NmpcBatch, Situations};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, Tracked, Weights};
use pinc_ode::{Model, Rk4};
use pinc_plants::{FourTanks, VanDerPol};

/// Steps of a batch.
const STEPS: usize = 2000;

fn main() {
    divan::main();
}

/// A batch with the box of its states, and a reference and an input for all.
struct Case {
    batch: NmpcBatch,
    states: Vec<[f64; 2]>,
    reference: Vec<f64>,
    u_before: Vec<f64>,
}

#[divan::bench]
fn steps_of_the_oscillator(bencher: Bencher<'_, '_>) {
    steps(bencher, oscillator());
}

#[divan::bench]
fn steps_of_the_tanks(bencher: Bencher<'_, '_>) {
    steps(bencher, tanks());
}

#[divan::bench]
fn gradients_of_the_oscillator(bencher: Bencher<'_, '_>) {
    gradients(bencher, oscillator());
}

#[divan::bench]
fn gradients_of_the_tanks(bencher: Bencher<'_, '_>) {
    gradients(bencher, tanks());
}

fn steps(bencher: Bencher<'_, '_>, case: Case) {
    run(bencher, case, |batch, at| {
        drop(black_box(batch.steps(at)));
    });
}

fn gradients(bencher: Bencher<'_, '_>, case: Case) {
    let seed = vec![1.0; case.u_before.len()];
    run(bencher, case, |batch, at| {
        drop(black_box(batch.gradients(at, &seed, None)));
    });
}

fn run(
    bencher: Bencher<'_, '_>,
    mut case: Case,
    mut job: impl FnMut(&mut NmpcBatch, Situations<'_>),
) {
    // The fractional parts of multiples of irrational numbers fill the box evenly.
    let x: Vec<f64> = (0..STEPS * case.states.len())
        .map(|i| {
            let [low, high] = case.states[i % case.states.len()];
            low + (high - low) * (i as f64 * 0.618_033_988_749_895).fract()
        })
        .collect();
    let at =
        Situations { x: &x, reference: &case.reference, u_before: &case.u_before, parameters: &[] };
    bencher.counter(ItemsCount::new(STEPS)).bench_local(|| job(&mut case.batch, at));
}

fn case(
    problem: &NmpcProblem,
    model: impl Model + Clone + 'static,
    states: Vec<[f64; 2]>,
    target: &[f64],
    u_before: Vec<f64>,
) -> Case {
    let make = || Nmpc::new(problem.clone(), Box::new(model.clone()), SqpConfig::default());
    let batch = NmpcBatch::new(1, make).expect("a problem that suits the model");
    Case { batch, states, reference: target.repeat(problem.horizon), u_before }
}

fn oscillator() -> Case {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let problem = NmpcProblem {
        state_bounds: Bounds::new(vec![-1.0; 2], vec![1.0; 2]),
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
    };
    case(&problem, model, vec![[-0.9, 0.9], [-0.3, 0.3]], &[0.5, 0.0], vec![0.0])
}

fn tanks() -> Case {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds::new(vec![2.0, 2.0, 0.6, 0.6], vec![20.0, 20.0, 5.5, 5.5]),
        input_bounds: Bounds::new(vec![0.0; 2], vec![5.0; 2]),
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    };
    let levels = vec![[2.0, 20.0], [2.0, 20.0], [0.6, 5.5], [0.6, 5.5]];
    case(&problem, model, levels, &[12.0, 14.0], vec![2.0, 2.0])
}
