//! A step of RK4, alone and with Jacobians, by substeps: the time grows linearly with them. The
//! stages of a horizon together, of plants built in and as text.

use divan::{Bencher, black_box};
use pinc_expr::Equations;
use pinc_ode::{Dims, DynPlant, Integrator, Linearization, Model, Plant, Rk4, Stages, Variable};
use pinc_plants::{AcetoneColumn, AcetoneStill, FourTanks, VanDerPol};

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

fn step(bencher: Bencher<'_, '_>, model: &mut dyn Model, x: &[f64], u: &[f64]) {
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

/// Plants that solve equations inside: four calls a stage.
#[divan::bench]
fn step_still(bencher: Bencher<'_, '_>) {
    step(
        bencher,
        &mut *AcetoneStill::default().into_dyn().model(Integrator::Rk4, 60.0, 1).unwrap(),
        &STILL.0,
        &STILL.1,
    );
}

#[divan::bench]
fn step_column(bencher: Bencher<'_, '_>) {
    step(
        bencher,
        &mut *AcetoneColumn::default().into_dyn().model(Integrator::Rk4, 60.0, 1).unwrap(),
        &COLUMN.0,
        &COLUMN.1,
    );
}

#[divan::bench(args = [1, 2, 5, 10, 20])]
fn linearize_stages_still(bencher: Bencher<'_, '_>, stages: usize) {
    let mut model = AcetoneStill::default().into_dyn().model(Integrator::Rk4, 60.0, 1).unwrap();
    linearize_stages(bencher, &mut *model, &STILL.0, &STILL.1, stages);
}

#[divan::bench(args = [1, 2, 5, 10, 20])]
fn linearize_stages_column(bencher: Bencher<'_, '_>, stages: usize) {
    let mut model = AcetoneColumn::default().into_dyn().model(Integrator::Rk4, 60.0, 1).unwrap();
    linearize_stages(bencher, &mut *model, &COLUMN.0, &COLUMN.1, stages);
}

const STILL: ([f64; 2], [f64; 2]) = ([0.17, 0.27], [4.0, 100.0]);
const COLUMN: ([f64; 6], [f64; 2]) = ([0.1, 0.7, 0.4, 0.3, 0.6, 0.1], [3.0, 120.0]);

/// The oscillator and the tanks as text.
#[divan::bench(args = [1, 5, 10, 20])]
fn linearize_stages_van_der_pol_as_text(bencher: Bencher<'_, '_>, stages: usize) {
    let mut model = rk4(&van_der_pol_as_text(), 0.5);
    linearize_stages(bencher, &mut *model, &[1.0, -0.5], &[0.3], stages);
}

#[divan::bench(args = [1, 5, 10, 20])]
fn linearize_stages_four_tanks_as_text(bencher: Bencher<'_, '_>, stages: usize) {
    let mut model = rk4(&four_tanks_as_text(), 10.0);
    linearize_stages(bencher, &mut *model, &[9.0, 14.0, 2.5, 2.5], &[2.5, 2.5], stages);
}

/// The Rosenbrock method, two substeps.
#[divan::bench(args = [1, 5, 10, 20])]
fn rosenbrock_stages_van_der_pol(bencher: Bencher<'_, '_>, stages: usize) {
    let plant = VanDerPol::default().into_dyn();
    let mut model = plant.model(Integrator::Rosenbrock, 0.5, 2).unwrap();
    linearize_stages(bencher, &mut *model, &[1.0, -0.5], &[0.3], stages);
}

#[divan::bench(args = [1, 5, 10, 20])]
fn rosenbrock_stages_van_der_pol_as_text(bencher: Bencher<'_, '_>, stages: usize) {
    let mut model = compiled(&van_der_pol_as_text()).model(Integrator::Rosenbrock, 0.5, 2).unwrap();
    linearize_stages(bencher, &mut *model, &[1.0, -0.5], &[0.3], stages);
}

#[divan::bench(args = [1, 5, 10, 20])]
fn rosenbrock_stages_four_tanks(bencher: Bencher<'_, '_>, stages: usize) {
    let plant = FourTanks::antonelo().into_dyn();
    let mut model = plant.model(Integrator::Rosenbrock, 10.0, 2).unwrap();
    linearize_stages(bencher, &mut *model, &[9.0, 14.0, 2.5, 2.5], &[2.5, 2.5], stages);
}

#[divan::bench(args = [1, 5, 10, 20])]
fn rosenbrock_stages_four_tanks_as_text(bencher: Bencher<'_, '_>, stages: usize) {
    let mut model = compiled(&four_tanks_as_text()).model(Integrator::Rosenbrock, 10.0, 2).unwrap();
    linearize_stages(bencher, &mut *model, &[9.0, 14.0, 2.5, 2.5], &[2.5, 2.5], stages);
}

#[divan::bench(args = [10, 20, 50])]
fn rosenbrock_20_stages_of_a_rod(bencher: Bencher<'_, '_>, nodes: usize) {
    let mut model = compiled(&rod(nodes)).model(Integrator::Rosenbrock, 1.0, 2).unwrap();
    linearize_stages(bencher, &mut *model, &vec![1.0; nodes], &[0.3], 20);
}

fn van_der_pol_as_text() -> Equations {
    as_text(&[("x1", "x2"), ("x2", "(1 - x1^2)*x2 - x1 + u")], &["u"])
}

fn four_tanks_as_text() -> Equations {
    let states = [
        ("h1", "(2*u1 + 0.07*sqrt(1962*max(h3, 0)) - 0.07*sqrt(1962*max(h1, 0)))/28"),
        ("h2", "(2*u2 + 0.06*sqrt(1962*max(h4, 0)) - 0.06*sqrt(1962*max(h2, 0)))/32"),
        ("h3", "(1.3*u2 - 0.07*sqrt(1962*max(h3, 0)))/28"),
        ("h4", "(u1 - 0.06*sqrt(1962*max(h4, 0)))/32"),
    ];
    as_text(&states, &["u1", "u2"])
}

/// The 20 stages of a rod that is heated and radiates, by its nodes.
#[divan::bench(args = [10, 20, 50, 100])]
fn linearize_20_stages_of_a_rod(bencher: Bencher<'_, '_>, nodes: usize) {
    let mut model = rk4(&rod(nodes), 1.0);
    linearize_stages(bencher, &mut *model, &vec![1.0; nodes], &[0.3], 20);
}

fn rod(nodes: usize) -> Equations {
    let states: Vec<_> = (0..nodes)
        .map(|i| {
            let left = if i == 0 { "u".to_owned() } else { format!("0.2*(T{} - T{i})", i - 1) };
            let right = if i + 1 == nodes { i } else { i + 1 };
            (format!("T{i}"), format!("{left} + 0.2*(T{right} - T{i}) - 1e-3*(T{i} + 2)^4"))
        })
        .collect();
    let states: Vec<_> = states.iter().map(|(name, f)| (name.as_str(), f.as_str())).collect();
    as_text(&states, &["u"])
}

fn as_text(states: &[(&str, &str)], inputs: &[&'static str]) -> Equations {
    let name = |name: &str| Variable { name: name.to_owned().into(), unit: "".into() };
    Equations {
        states: states.iter().map(|(state, _)| name(state)).collect(),
        inputs: inputs.iter().map(|input| name(input)).collect(),
        derivatives: states.iter().map(|&(a, b)| (a.to_owned(), b.to_owned())).collect(),
        ..Equations::default()
    }
}

fn compiled(equations: &Equations) -> Box<dyn DynPlant> {
    equations.compile().expect("valid equations").into_dyn()
}

fn rk4(equations: &Equations, sample_time_s: f64) -> Box<dyn Model> {
    compiled(equations).model(Integrator::Rk4, sample_time_s, 4).unwrap()
}

fn linearize_stages(
    bencher: Bencher<'_, '_>,
    model: &mut dyn Model,
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
