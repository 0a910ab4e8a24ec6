//! A step of RK4, alone and with Jacobians, by substeps: the time grows linearly with them.

use divan::{Bencher, black_box};
use pinc_ode::{Dims, Linearization, Model, Plant, Rk4, Stages};
use pinc_plants::{FourTanks, VanDerPol};

const SUBSTEPS: [usize; 5] = [1, 4, 5, 10, 50];

fn main() {
    divan::main();
}

#[divan::bench(args = SUBSTEPS)]
fn step_van_der_pol(bencher: Bencher<'_, '_>, substeps: usize) {
    step(bencher, &mut van_der_pol(substeps), &[1.0, -0.5], &[0.3]);
}

#[divan::bench(args = SUBSTEPS)]
fn step_four_tanks(bencher: Bencher<'_, '_>, substeps: usize) {
    step(bencher, &mut four_tanks(substeps), &[9.0, 14.0, 2.5, 2.5], &[2.5, 2.5]);
}

#[divan::bench(args = SUBSTEPS)]
fn linearize_van_der_pol(bencher: Bencher<'_, '_>, substeps: usize) {
    linearize(bencher, &mut van_der_pol(substeps), &[1.0, -0.5], &[0.3]);
}

#[divan::bench(args = SUBSTEPS)]
fn linearize_four_tanks(bencher: Bencher<'_, '_>, substeps: usize) {
    linearize(bencher, &mut four_tanks(substeps), &[9.0, 14.0, 2.5, 2.5], &[2.5, 2.5]);
}

fn van_der_pol(substeps: usize) -> Rk4<VanDerPol> {
    Rk4::new(VanDerPol::default(), 0.5, substeps)
}

fn four_tanks(substeps: usize) -> Rk4<FourTanks> {
    Rk4::new(FourTanks::antonelo(), 10.0, substeps)
}

fn step<P: Plant>(bencher: Bencher<'_, '_>, model: &mut Rk4<P>, x: &[f64], u: &[f64]) {
    let mut next = vec![0.0; x.len()];
    bencher.bench_local(|| model.step(black_box(x), black_box(u), &[], black_box(&mut next)));
}

fn linearize<P: Plant>(bencher: Bencher<'_, '_>, model: &mut Rk4<P>, x: &[f64], u: &[f64]) {
    let Dims { nx: n, nu: m, .. } = model.dims();
    let (mut next, mut a, mut b) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n * m]);
    bencher.bench_local(|| {
        model.linearize(
            Stages { x: black_box(x), u: black_box(u), p: &[] },
            Linearization { next: black_box(&mut next), a: &mut a, b: &mut b, e: &mut [] },
        );
        black_box((&mut a, &mut b));
    });
}

/// The stages of a horizon together.
#[divan::bench(args = [1, 5, 10, 20])]
fn linearize_stages_van_der_pol(bencher: Bencher<'_, '_>, stages: usize) {
    linearize_stages(bencher, &mut van_der_pol(4), &[1.0, -0.5], &[0.3], stages);
}

#[divan::bench(args = [1, 5, 10, 20])]
fn linearize_stages_four_tanks(bencher: Bencher<'_, '_>, stages: usize) {
    linearize_stages(bencher, &mut four_tanks(4), &[9.0, 14.0, 2.5, 2.5], &[2.5, 2.5], stages);
}

fn linearize_stages<P: Plant>(
    bencher: Bencher<'_, '_>,
    model: &mut Rk4<P>,
    x: &[f64],
    u: &[f64],
    stages: usize,
) {
    let Dims { nx: n, nu: m, .. } = model.dims();
    let (x, u) = (x.repeat(stages), u.repeat(stages));
    let (mut next, mut a, mut b) =
        (x.clone(), vec![0.0; stages * n * n], vec![0.0; stages * n * m]);
    bencher.bench_local(|| {
        let (x, u) = (black_box(&x), black_box(&u));
        model.linearize(
            Stages { x, u, p: &[] },
            Linearization { next: black_box(&mut next), a: &mut a, b: &mut b, e: &mut [] },
        );
        black_box((&mut a, &mut b));
    });
}
