//! How a real-time iteration grows: medians in us by the number of stages N, of states and of
//! inputs, with bounds on the inputs that are active or never reached, by each method for the
//! quadratic programs. `cargo bench -p pinc-mpc --bench growth` prints a table in Markdown; the
//! method that the automatic choice takes is in bold. A dash is where a smaller N took too long.
//!
//! The model is a chain of first-order lags with inputs all along it, which costs next to nothing:
//! what is measured is the controller and its quadratic programs.

#![expect(clippy::print_stdout, reason = "the table is what it is for")]

use pinc_mpc::{Bounds, Nmpc, NmpcProblem, QpMethod, SqpConfig, Weights};
use pinc_ode::{Dims, Linearization, Model, Stages};
use std::time::Instant;

/// N2 = Nu
const HORIZONS: [usize; 6] = [5, 10, 20, 40, 80, 160];
/// Numbers of states and inputs.
const SIZES: [[usize; 2]; 7] = [[2, 1], [4, 2], [10, 1], [10, 3], [30, 1], [30, 10], [100, 3]];
/// Steps after which the reference is the other one.
const HELD: usize = 8;
/// Steps of a measurement.
const STEPS: usize = 48;
/// When a measurement ends early, and after which median longer horizons are left out, in s.
const PATIENCE_S: [f64; 2] = [2.0, 0.2];

fn main() {
    print!("| states, inputs, bounds | method |");
    HORIZONS.iter().for_each(|n| print!(" {n} |"));
    println!("\n|---|---|{}", "---|".repeat(HORIZONS.len()));
    for size in SIZES {
        for active in [false, true] {
            for method in [QpMethod::Condensed, QpMethod::Riccati] {
                print_row(size, active, method);
            }
        }
    }
}

fn print_row([n, m]: [usize; 2], active: bool, method: QpMethod) {
    print!("| {n}, {m}, {} | {method} |", if active { "active" } else { "not reached" });
    let mut patient = true;
    for horizon in HORIZONS {
        if !patient {
            print!(" – |");
            continue;
        }
        let median = Loop::new([n, m], horizon, active, method).median_s();
        patient = median < PATIENCE_S[1];
        let chosen = QpMethod::Auto.resolve([n, m], [horizon, horizon]) == method;
        let mark = if chosen { "**" } else { "" };
        print!(" {mark}{:.1}{mark} |", 1e6 * median);
    }
    println!();
}

/// `x_i <- x_i + (x_{i-1} - x_i) / 8 + inputs / 4`, input k at states k, k + m, ..
#[derive(Debug)]
struct Lags {
    dims: Dims,
}

impl Lags {
    fn a(row: usize, column: usize) -> f64 {
        match row.checked_sub(column) {
            Some(0) => 0.875,
            Some(1) => 0.125,
            _ => 0.0,
        }
    }

    fn b(&self, row: usize, column: usize) -> f64 {
        if row % self.dims.nu == column { 0.25 } else { 0.0 }
    }
}

impl Model for Lags {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        for (row, next) in next.iter_mut().enumerate() {
            let before = if row > 0 { x[row - 1] } else { 0.0 };
            *next = 0.875 * x[row] + 0.125 * before + 0.25 * u[row % self.dims.nu];
        }
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let Dims { nx, nu, .. } = self.dims;
        for k in 0..at.count(self.dims) {
            let (at, out) = (at.point(k, self.dims), out.point(k, self.dims));
            self.step(at.x, at.u, at.p, out.next);
            let places = |width: usize| (0..nx).flat_map(move |r| (0..width).map(move |c| (r, c)));
            out.a.iter_mut().zip(places(nx)).for_each(|(a, (r, c))| *a = Self::a(r, c));
            out.b.iter_mut().zip(places(nu)).for_each(|(b, (r, c))| *b = self.b(r, c));
        }
    }
}

/// A closed loop between two references.
struct Loop {
    nmpc: Nmpc,
    plant: Lags,
    references: [Vec<f64>; 2],
}

impl Loop {
    /// Q = 10 I, R = I, all states are controlled. The references need inputs of 1; bounds of 0.75
    /// are active, those of 100 never.
    fn new([n, m]: [usize; 2], horizon: usize, active: bool, qp: QpMethod) -> Self {
        let dims = Dims::new(n, m);
        let bound = if active { 0.75 } else { 100.0 };
        let weights = Weights::uniform(vec![10.0; n], vec![1.0; m]);
        let problem = NmpcProblem {
            input_bounds: Bounds { low: vec![-bound; m], high: vec![bound; m] },
            ..NmpcProblem::new(dims, horizon, weights)
        };
        let config = SqpConfig { qp, real_time: true, ..SqpConfig::default() };
        let nmpc = Nmpc::new(problem, Box::new(Lags { dims }), config).expect("a valid problem");
        let mut rest = vec![0.0; n];
        for row in 0..n {
            rest[row] = if row > 0 { rest[row - 1] } else { 0.0 } + 2.0;
        }
        let references = [1.0, -1.0].map(|sign| {
            let at_rest: Vec<f64> = rest.iter().map(|x| sign * x).collect();
            at_rest.repeat(horizon)
        });
        Self { nmpc, plant: Lags { dims }, references }
    }

    fn median_s(&mut self) -> f64 {
        let n = self.plant.dims.nx;
        let (mut x, mut next) = (vec![0.0; n], vec![0.0; n]);
        let mut times = Vec::with_capacity(STEPS);
        let begin = Instant::now();
        for k in 0..STEPS {
            let reference = &self.references[k / HELD % 2];
            let clock = Instant::now();
            let step = self.nmpc.step(&x, reference).expect("numbers of the right shape");
            times.push(clock.elapsed().as_secs_f64());
            self.plant.step(&x, step.u, &[], &mut next);
            std::mem::swap(&mut x, &mut next);
            if begin.elapsed().as_secs_f64() > PATIENCE_S[0] {
                break;
            }
        }
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    }
}
