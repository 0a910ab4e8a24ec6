//! The closed loops of the paper with RK4 as the model, against the answers that an interior-point
//! solver of nonlinear programs (IPOPT, tolerance 1e-10) gives for the same problems.

use pinc_config::{Experiment, ModelKind, Plants};
use pinc_loop::ClosedLoop;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Tracked, Weights};
use pinc_ode::{Dopri5, PiecewiseConstant, Plant, Rk4};
use pinc_plants::{FourTanks, VanDerPol};
use pinc_runs::{Options, Verbosity};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// The paper's model: RK4 with 4 substeps.
const SUBSTEPS: usize = 4;
/// The tolerance of the plant's integration.
const TRUTH: f64 = 1e-12;

/// What a run came to: IAE and RMSE on the dense trace and as printed.
struct Answer {
    iae_dense: f64,
    rmse_dense: f64,
    iae_printed: f64,
    rmse_printed: f64,
    max_violation: f64,
}

fn run<P: Plant>(
    plant: P,
    sample_time_s: f64,
    problem: NmpcProblem,
    reference: Reference,
    start: &[f64],
) -> Answer {
    let model = Rk4::new(plant.clone(), sample_time_s, SUBSTEPS);
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    let truth = Dopri5::new(plant, TRUTH);
    let steps = reference.steps();
    let mut run = ClosedLoop::new(&mut nmpc, truth, reference, start).unwrap();
    let (record, ended) = run.run_recorded();
    ended.unwrap();
    assert_eq!(record.steps.len(), steps);
    assert_eq!(record.trajectory.len(), 9 * steps + 1);
    for (k, step) in record.steps.iter().enumerate() {
        assert_eq!(step.status, SqpStatus::Converged, "step {k}");
        assert!(step.kkt <= 1e-8, "step {k}: {:e}", step.kkt);
    }
    let (dense, at_steps) = (run.tracking_dense(), run.tracking_at_steps());
    Answer {
        iae_dense: dense.iae_sum(),
        rmse_dense: dense.rmse(),
        iae_printed: at_steps.iae_mean(),
        rmse_printed: at_steps.rmse(),
        max_violation: run.max_violation(),
    }
}

fn staircase(values: [[f64; 2]; 4], each_s: f64, steps: usize, sample_time_s: f64) -> Reference {
    let starts = (0..4).map(|i| f64::from(i) * each_s).collect();
    let values = values.iter().map(|value| value.to_vec()).collect();
    let signal = PiecewiseConstant::new(starts, values).unwrap();
    Reference::sample(&signal, steps, sample_time_s).unwrap()
}

/// 60 s of the oscillator with Q = q I and R = r.
fn van_der_pol(q: f64, r: f64) -> Answer {
    oscillator(Weights::uniform(vec![q; 2], vec![r]))
}

fn oscillator(weights: Weights) -> Answer {
    let plant = VanDerPol::default();
    let problem = NmpcProblem {
        state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        ..NmpcProblem::new(plant.dims(), 5, weights)
    };
    let values = [[0.0, 0.0], [-0.5, 0.0], [0.8, 0.0], [1.0, 0.0]];
    let reference = staircase(values, 15.0, 120, 0.5);
    run(plant, 0.5, problem, reference, &[1.0, 0.0])
}

/// 2400 s of the four tanks.
fn four_tanks(factors: [f64; 5]) -> Answer {
    let plant = FourTanks::antonelo();
    let weights = Weights::scaled(vec![10.0; 2], vec![1.0; 2], &factors, &factors);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        input_bounds: Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ..NmpcProblem::new(plant.dims(), 5, weights)
    };
    let middle = [9.159582958982018, 14.211590549777885];
    let upper = [10.151255120853042, 15.750223780923415];
    let lower = [8.226164209850278, 12.763340653079485];
    let reference = staircase([middle, upper, lower, middle], 600.0, 240, 10.0);
    let start = [2.0, 2.0, 0.6, 0.6];
    run(plant, 10.0, problem, reference, &start)
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} +- {tolerance}");
}

// The tolerances leave room for the digits that are not given and for what solvers differ by where
// the oscillator's problem is degenerate (its last reference is on two bounds): 2e-5 in u.

#[test]
fn van_der_pol_as_printed() {
    let answer = van_der_pol(10.0, 1.0);
    close(answer.iae_dense, 113.574, 0.02);
    close(answer.rmse_dense, 0.14106, 1e-4);
    close(answer.iae_printed, 5.874, 1e-3);
    close(answer.rmse_printed, 0.13083, 1e-5);
    // Bounds hold for the model at the steps; the plant may pass them between the steps, and by
    // RK4's error.
    assert!(answer.max_violation < 0.05, "{}", answer.max_violation);
}

#[test]
fn van_der_pol_states_only() {
    let answer = van_der_pol(1.0, 0.0);
    close(answer.iae_dense, 112.422, 0.02);
    close(answer.rmse_dense, 0.14041, 1e-4);
}

/// The cost of the authors' program: weights that fall along the horizon, and increments of inputs
/// with wrong indices,
///
/// ```text
/// J = T [ sum_i (N - i) 10 |e_i|^2 + 5 ((u0 - ul)^2 + (u1 - ul)^2) + 10 ((u0 - u4)^2 + (u1 - u0)^2) ]
/// ```
///
/// with ul the input applied last. It is behind the paper's Table 1 (122 and 0.15).
#[test]
fn van_der_pol_as_released() {
    let factors = [5.0, 4.0, 3.0, 2.0, 1.0].map(|factor| factor * 0.5);
    // Over (ul, u0, .., u4).
    let mut w = vec![vec![0.0; 6]; 6];
    for (weight, i, k) in [(5.0, 1, 0), (5.0, 2, 0), (10.0, 1, 5), (10.0, 2, 1)] {
        let weight = 0.5 * weight;
        w[i][i] += weight;
        w[k][k] += weight;
        w[i][k] -= weight;
        w[k][i] -= weight;
    }
    let weights = Weights::scaled(vec![10.0; 2], vec![0.0], &factors, &[0.0; 5]);
    let answer = oscillator(weights.with_input_sequence(w));
    close(answer.iae_dense, 121.98, 0.01);
    close(answer.rmse_dense, 0.1507, 1e-4);
}

/// The shipped config, with which `pinc control` makes the row of Table 1.
#[test]
fn the_shipped_config_makes_table_1() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/van-der-pol/control.toml");
    let sets = ["preset=as-released", "control.repetitions=1"].map(str::to_owned);
    let experiment = Experiment::load(&path, &sets, &Plants::built_in()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let options = Options {
        resume: false,
        verbosity: Verbosity::Quiet,
        interrupt: &AtomicBool::new(false),
        arguments: &[],
    };
    let only = Some(ModelKind::RK4);
    let run = pinc_runs::control(&experiment, dir.path(), &options, None, only).unwrap();
    let answer = &run.metrics().control[0];
    close(answer.iae_dense_sum, 121.98, 0.01);
    close(answer.rmse_dense, 0.1507, 1e-4);
}

#[test]
fn four_tanks_as_printed() {
    let answer = four_tanks([1.0; 5]);
    close(answer.iae_dense, 544.040, 0.05);
    close(answer.rmse_dense, 0.80714, 1e-4);
    close(answer.iae_printed, 24.087, 1e-3);
    close(answer.rmse_printed, 0.66143, 1e-5);
}

#[test]
fn four_tanks_as_released() {
    // Stage i is counted (N - i) T times.
    let answer = four_tanks([50.0, 40.0, 30.0, 20.0, 10.0]);
    close(answer.iae_dense, 544.408, 0.05);
    close(answer.rmse_dense, 0.80774, 1e-4);
}
