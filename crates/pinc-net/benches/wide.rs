//! Nets by the width of their layers against the machine's multiply-add peak, on one thread: the
//! loss with its gradient, and a horizon's steps with their Jacobians. Kernel and peak alternate,
//! and the shortest time of each counts, as on an idle machine.
//!
//! Counted are the operations of the matrix products alone, as in `pinc bench`
//! (docs/benchmarks.md); tanh, the plant and all else lower the share.
#![expect(clippy::print_stdout, reason = "a benchmark shows what it measures")]

use pinc_ad::Scalar;
use pinc_net::{
    BatchLoss, Domain, InitialScale, Isa, LossWeights, NetConfig, PincModel, PincNet, Points,
    ResidualScale, Sampler, Workers,
};
use pinc_ode::{Linearization, Model, Plant, Stages, Variable};
use std::hint::black_box;
use std::time::Instant;

/// Hidden layers of all nets.
const LAYERS: usize = 4;

const WIDTHS: [usize; 5] = [20, 32, 64, 96, 128];

/// Collocation points of the loss.
const POINTS: usize = 1024;

/// Stages of the horizon: a multiple of the lanes of all vectors.
const STAGES: usize = 16;

/// Rounds of kernel and peak.
const ROUNDS: usize = 50;

/// Rounds of the peak's multiply-adds: a millisecond.
const PEAK_ROUNDS: u64 = 500_000;

fn main() {
    println!("| net | states | loss and gradient, us | of the peak | 16 steps, us | of the peak |");
    println!("|---|---|---|---|---|---|");
    for states in [2, 20] {
        for width in WIDTHS {
            row(states, width);
        }
    }
}

fn row(states: usize, width: usize) {
    let plant = Chain::new(states);
    let domain = Domain::new(vec![-1.0..=1.0; states], vec![-1.0..=1.0]);
    let config = NetConfig::new(0.5, LAYERS, width);
    let net = PincNet::new(&plant, &config, &domain, 0).expect("a net");
    let (loss_s, of_loss) = least(&mut evaluation(&plant, &net, &domain));
    let (steps_s, of_steps) = least(&mut horizon(&net));
    let widths = net.mlp().widths();
    let weights: usize = widths.windows(2).map(|pair| pair[0] * pair[1]).sum();
    let first = widths[0] * widths[1];
    let share = |operations: usize, seconds: f64, peak: f64| {
        let operations = u32::try_from(operations).map_or(f64::NAN, f64::from);
        100.0 * operations / seconds / peak
    };
    // Value and time tangent; value and derivatives by all of (x, u), which the first layer has.
    let loss = share(4 * (3 * weights - first) * POINTS, loss_s, of_loss);
    let steps = 2 * (weights + (weights - first) * (states + 1)) * STAGES;
    let steps = share(steps, steps_s, of_steps);
    let (loss_us, steps_us) = (1e6 * loss_s, 1e6 * steps_s);
    println!(
        "| {LAYERS}x{width} | {states} | {loss_us:.0} | {loss:.0} % | {steps_us:.0} | {steps:.0} % |"
    );
}

/// The shortest time of `work` in s, and the highest peak in operations per second.
fn least(work: &mut dyn FnMut()) -> (f64, f64) {
    let isa = Isa::detect();
    let (mut shortest, mut peak) = (f64::INFINITY, 0.0_f64);
    for _ in 0..ROUNDS {
        let start = Instant::now();
        let operations = isa.multiply_add_rounds(PEAK_ROUNDS);
        let seconds = start.elapsed().as_secs_f64();
        peak = peak.max(u32::try_from(operations).map_or(f64::NAN, f64::from) / seconds);
        let start = Instant::now();
        work();
        shortest = shortest.min(start.elapsed().as_secs_f64());
    }
    (shortest, peak)
}

fn evaluation(plant: &Chain, net: &PincNet, domain: &Domain) -> impl FnMut() {
    let scale = ResidualScale::Normalized;
    let weights = LossWeights::new(net, 0.1, &scale, InitialScale::Normalized).expect("weights");
    let workers = Workers::new(1).expect("a thread");
    let mut loss = BatchLoss::new(plant, net, &weights, &workers);
    let collocation = Sampler::Sobol.collocation(POINTS, 0.5, domain, 1, 0);
    loss.set_points(&collocation, &Points::default());
    let parameters = net.mlp().parameters().to_vec();
    let mut gradient = vec![0.0; parameters.len()];
    move || {
        black_box(loss.loss_gradient(black_box(&parameters), &mut gradient));
    }
}

fn horizon(net: &PincNet) -> impl FnMut() + use<> {
    let mut model = PincModel::new(net).expect("a model");
    let n = net.dims().nx;
    let (x, u) = (vec![0.3; STAGES * n], vec![0.1; STAGES]);
    let mut next = vec![0.0; STAGES * n];
    let (mut a, mut b) = (vec![0.0; STAGES * n * n], vec![0.0; STAGES * n]);
    move || {
        let at = Stages { x: black_box(&x), u: black_box(&u), p: &[] };
        let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
        model.linearize(at, out);
        black_box(&mut next);
    }
}

/// Tanks in a row, each with the outflow of the one before: an equation that costs little.
#[derive(Clone, Debug)]
struct Chain {
    states: Vec<Variable>,
    inputs: Vec<Variable>,
}

impl Chain {
    fn new(states: usize) -> Self {
        let state = |i| Variable { name: format!("x{i}").into(), unit: "-".into() };
        Self { states: (1..=states).map(state).collect(), inputs: vec![Variable::new("u", "-")] }
    }
}

impl Plant for Chain {
    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _: &[S], dx: &mut [S]) {
        let mut inflow = u[0];
        for (x, dx) in x.iter().zip(dx) {
            *dx = inflow - *x;
            inflow = *x;
        }
    }
}
