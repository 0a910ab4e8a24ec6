//! A step of a net, alone and with Jacobians, by plant and size.

use divan::{Bencher, black_box};
use pinc_net::{Domain, NetConfig, PincModel, PincNet};
use pinc_ode::{Dims, Linearization, Model, Plant, Stages};
use pinc_plants::{FourTanks, VanDerPol};

/// Hidden layers and neurons.
const SIZES: [(usize, usize); 7] = [(2, 8), (2, 16), (2, 24), (4, 20), (5, 20), (8, 20), (4, 64)];

fn main() {
    divan::main();
}

#[divan::bench(args = SIZES)]
fn step_van_der_pol(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    step(bencher, VanDerPol::default(), size);
}

#[divan::bench(args = SIZES)]
fn step_four_tanks(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    step(bencher, FourTanks::antonelo(), size);
}

#[divan::bench(args = SIZES)]
fn linearize_van_der_pol(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    linearize(bencher, VanDerPol::default(), size, 1);
}

#[divan::bench(args = SIZES)]
fn linearize_four_tanks(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    linearize(bencher, FourTanks::antonelo(), size, 1);
}

#[divan::bench(args = SIZES)]
fn linearize_5_stages_van_der_pol(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    linearize(bencher, VanDerPol::default(), size, 5);
}

#[divan::bench(args = SIZES)]
fn linearize_5_stages_four_tanks(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    linearize(bencher, FourTanks::antonelo(), size, 5);
}

#[divan::bench(args = SIZES)]
fn linearize_10_stages_four_tanks(bencher: Bencher<'_, '_>, size: (usize, usize)) {
    linearize(bencher, FourTanks::antonelo(), size, 10);
}

/// An untrained net: a step costs the same.
fn net<P: Plant>(plant: P, (hidden_layers, neurons): (usize, usize)) -> PincModel {
    let dims = plant.dims();
    let domain = Domain::new(vec![1.0..=3.0; dims.nx], vec![-1.0..=1.0; dims.nu]);
    let config = NetConfig::new(0.5, hidden_layers, neurons);
    PincModel::new(&PincNet::new(&plant, &config, &domain, 0).expect("a net")).expect("a model")
}

fn step<P: Plant>(bencher: Bencher<'_, '_>, plant: P, size: (usize, usize)) {
    let mut model = net(plant, size);
    let Dims { nx: n, nu: m, .. } = model.dims();
    let (x, u, mut next) = (vec![1.5; n], vec![0.3; m], vec![0.0; n]);
    bencher.bench_local(|| model.step(black_box(&x), black_box(&u), &[], black_box(&mut next)));
}

fn linearize<P: Plant>(bencher: Bencher<'_, '_>, plant: P, size: (usize, usize), points: usize) {
    let mut model = net(plant, size);
    let Dims { nx: n, nu: m, .. } = model.dims();
    let (x, u, mut next) = (vec![1.5; points * n], vec![0.3; points * m], vec![0.0; points * n]);
    let (mut a, mut b) = (vec![0.0; points * n * n], vec![0.0; points * n * m]);
    bencher.bench_local(|| {
        let (x, u) = (black_box(&x[..]), black_box(&u[..]));
        model.linearize(
            Stages { x, u, p: &[] },
            Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
        );
        black_box((&mut next, &mut a, &mut b));
    });
}
