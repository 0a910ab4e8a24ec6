//! What an iteration of an optimizer costs by itself, by the number of weights: the objective is a
//! function that costs next to nothing. L-BFGS is linear in the weights, self-scaled Broyden
//! quadratic.

use divan::{Bencher, black_box};
use pinc_net::Workers;
use pinc_net::optim::{
    Iterate, LbfgsConfig, LeastSquares, LineSearch, Objective, Optimizer, OptimizerConfig,
    SelfScaledBroydenConfig,
};

/// Weights of the oscillator's 2x10 and 4x20 nets, of the tanks' 5x20, 8x20 and 5x40, of the
/// oscillator's 4x64.
const WEIGHTS: [usize; 6] = [182, 1402, 1924, 3184, 7044, 12_930];

/// Iterations before the measured ones, to fill the memory of L-BFGS.
const WARM_UP: usize = 15;

fn main() {
    divan::main();
}

#[divan::bench(args = WEIGHTS, max_time = 0.5, sample_size = 1)]
fn lbfgs(bencher: Bencher<'_, '_>, weights: usize) {
    let config =
        LbfgsConfig { memory: 10, line_search: LineSearch::WeakWolfe, gradient_tolerance: 0.0 };
    iteration(bencher, &OptimizerConfig::Lbfgs(config), weights, 1);
}

#[divan::bench(args = WEIGHTS, max_time = 0.5, sample_size = 1)]
fn self_scaled_broyden(bencher: Bencher<'_, '_>, weights: usize) {
    let config = SelfScaledBroydenConfig { initial_step: 0.1, gradient_tolerance: 0.0 };
    iteration(bencher, &OptimizerConfig::SelfScaledBroyden(config), weights, 1);
}

#[divan::bench(args = WEIGHTS, max_time = 0.5, sample_size = 1)]
fn self_scaled_broyden_all_threads(bencher: Bencher<'_, '_>, weights: usize) {
    let config = SelfScaledBroydenConfig { initial_step: 0.1, gradient_tolerance: 0.0 };
    iteration(bencher, &OptimizerConfig::SelfScaledBroyden(config), weights, 0);
}

fn iteration(bencher: Bencher<'_, '_>, config: &OptimizerConfig, weights: usize, threads: usize) {
    let workers = Workers::new(threads).expect("threads");
    let mut optimizer = Optimizer::new(config, weights);
    let mut iterate = Iterate::new(&mut Valley, vec![-1.0; weights]);
    for _ in 0..WARM_UP {
        optimizer.step(&mut Valley, &mut iterate, &workers);
    }
    bencher.bench_local(|| black_box(optimizer.step(&mut Valley, &mut iterate, &workers)));
}

/// The sum of sqrt(1 + k x^2): each term has another curvature, which changes along the way, so
/// that no optimizer is done soon.
struct Valley;

impl Objective for Valley {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let mut sum = 0.0;
        let mut curvature = 1.0;
        for (x, g) in x.iter().zip(gradient) {
            let root = (1.0 + curvature * x * x).sqrt();
            sum += root;
            *g = curvature * x / root;
            curvature += 1.0;
        }
        sum
    }
}

impl LeastSquares for Valley {
    fn normal_matrix(&mut self, _: &[f64], _: &mut [f64]) {
        unimplemented!("not asked for by these optimizers");
    }
}
