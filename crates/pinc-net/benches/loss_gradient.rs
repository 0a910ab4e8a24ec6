//! Loss and gradient of the batched kernel on one thread. Items are points times weights: a rate
//! that stays the same means that the time grows linearly in both.

use divan::{Bencher, black_box, counter::ItemsCount};
use pinc_net::{
    Ansatz, BatchLoss, Domain, InitialScale, LossWeights, NetConfig, PincNet, ResidualScale,
    Sampler, Workers, initial_conditions,
};
use pinc_ode::Plant;
use pinc_plants::{FourTanks, VanDerPol};

const POINTS: [usize; 4] = [100, 1000, 10_000, 100_000];
const WIDTHS: [usize; 6] = [5, 10, 15, 20, 40, 64];
const DEPTHS: [usize; 4] = [1, 2, 5, 10];

fn main() {
    divan::main();
}

#[divan::bench(args = POINTS, max_time = 1)]
fn points_van_der_pol_4x20(bencher: Bencher<'_, '_>, points: usize) {
    van_der_pol(bencher, points, 4, 20);
}

#[divan::bench(args = POINTS, max_time = 1)]
fn points_four_tanks_5x20(bencher: Bencher<'_, '_>, points: usize) {
    let domain = Domain {
        state_low: vec![2.0, 2.0, 0.5, 0.5],
        state_high: vec![20.0, 20.0, 6.0, 6.0],
        input_low: vec![0.0; 2],
        input_high: vec![5.0; 2],
        parameters: Vec::new(),
    };
    let net = config(10.0, 5, 20);
    loss_gradient(bencher, &FourTanks::antonelo(), &domain, &net, points);
}

#[divan::bench(args = WIDTHS, max_time = 0.5)]
fn width_of_4_layers(bencher: Bencher<'_, '_>, neurons: usize) {
    van_der_pol(bencher, 10_000, 4, neurons);
}

#[divan::bench(args = DEPTHS, max_time = 0.5)]
fn depth_of_20_neurons(bencher: Bencher<'_, '_>, hidden_layers: usize) {
    van_der_pol(bencher, 10_000, hidden_layers, 20);
}

fn van_der_pol(bencher: Bencher<'_, '_>, points: usize, hidden_layers: usize, neurons: usize) {
    let domain = Domain {
        state_low: vec![-3.0; 2],
        state_high: vec![3.0; 2],
        input_low: vec![-1.0],
        input_high: vec![1.0],
        parameters: Vec::new(),
    };
    let net = config(0.5, hidden_layers, neurons);
    loss_gradient(bencher, &VanDerPol::default(), &domain, &net, points);
}

fn config(sample_time_s: f64, hidden_layers: usize, neurons: usize) -> NetConfig {
    NetConfig { sample_time_s, hidden_layers, neurons, ansatz: Ansatz::Direct, time_only: None }
}

/// The loss over `points` collocation points and a hundredth as many initial conditions.
fn loss_gradient<P: Plant>(
    bencher: Bencher<'_, '_>,
    plant: &P,
    domain: &Domain,
    config: &NetConfig,
    points: usize,
) {
    let net = PincNet::new(plant, config, domain, 0).expect("a valid net");
    let (residual, initial) = (ResidualScale::Normalized, InitialScale::Normalized);
    let weights = LossWeights::new(&net, 0.1, &residual, initial).expect("valid weights");
    let workers = Workers::new(1).expect("a thread");
    let mut loss = BatchLoss::new(plant, &net, &weights, &workers);
    let scenarios = points / 100;
    let collocation =
        Sampler::Sobol.collocation(points, config.sample_time_s, domain, scenarios, 0);
    loss.set_points(&collocation, &initial_conditions(scenarios, domain, 0));
    let parameters = net.mlp().parameters();
    let mut gradient = vec![0.0; parameters.len()];
    bencher
        .counter(ItemsCount::new(points * parameters.len()))
        .bench_local(|| loss.loss_gradient(black_box(parameters), black_box(&mut gradient)));
}
