//! Linear plants with drawn disturbances, under the tube's own feedback.

use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Stages};
use pinc_tube::{
    AlongPlan, BackOffs, EllipsoidTube, Feedback, Interval, Sources, StageError, Tube, TubeModel,
};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

const N: usize = 6;
const A: [f64; 4] = [1.1, 0.3, -0.2, 0.9];
const B: [f64; 2] = [0.1, 0.5];
const DIMS: Dims = Dims::new(2, 1);

/// A parameter moves the state by p times this in each step.
const BY_P: [f64; 2] = [0.3, -0.4];

/// y = C x + .7 p
const C: [f64; 2] = [0.5, -0.3];
const OUTPUT_BY_P: f64 = 0.7;

/// A x + B u + p (.3, -.4)
#[derive(Debug)]
struct Linear;

impl Model for Linear {
    fn dims(&self) -> Dims {
        DIMS.with_parameters(1).with_outputs(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        for i in 0..2 {
            next[i] = A[2 * i] * x[0] + A[2 * i + 1] * x[1] + B[i] * u[0] + BY_P[i] * p[0];
        }
    }

    fn linearize(&mut self, _: Stages<'_>, out: Linearization<'_>) {
        // The tests give A and B.
        out.e.copy_from_slice(&BY_P);
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.output(at.x, at.u, at.p, out.y);
        out.c.copy_from_slice(&C);
        out.d.fill(0.0);
        out.e.copy_from_slice(&[OUTPUT_BY_P]);
    }

    fn output(&mut self, x: &[f64], _: &[f64], p: &[f64], y: &mut [f64]) {
        y[0] = C[0] * x[0] + C[1] * x[1] + OUTPUT_BY_P * p[0];
    }
}

/// An error of this size in each step, of either sign.
#[derive(Debug)]
struct Error([f64; 2]);

impl StageError for Error {
    fn write(&mut self, _: &[f64], _: &[f64], _: &[f64], error: &mut [f64]) {
        error.copy_from_slice(&[self.0[0], -self.0[1]]);
    }
}

/// The tube of `sources` around the origin, with its back-offs.
fn tube(sources: Sources, covariance: Option<&[f64; 4]>) -> (EllipsoidTube, BackOffs) {
    let plan = Stages { x: &[0.0; 2 * N], u: &[0.0; N], p: &[] };
    let units = vec![1.0, 2.0];
    let model = TubeModel { model: Box::new(Linear), more: vec![0.0] };
    let new = EllipsoidTube::new((DIMS, N), sources, Some(model), Feedback::Riccati, units);
    let mut tube = new.unwrap();
    if let Some(covariance) = covariance {
        tube.set_covariance(covariance);
    }
    let zeros = |size: usize| vec![0.0; size];
    let mut found = BackOffs { states: zeros(2 * N), inputs: zeros(N), ..BackOffs::default() };
    tube.write(AlongPlan::new(plan, [&A.repeat(N), &B.repeat(N)], DIMS, 0), &mut found);
    (tube, found)
}

/// The regulator's weights are 1 whatever the units are.
#[test]
fn gains_do_not_depend_on_units() {
    let gains = |units: Vec<f64>| {
        let new = EllipsoidTube::new((DIMS, N), boxed(), None, Feedback::Riccati, units);
        let mut tube = new.unwrap();
        let plan = Stages { x: &[0.0; 2 * N], u: &[0.0; N], p: &[] };
        let mut found =
            BackOffs { states: vec![0.0; 2 * N], inputs: vec![0.0; N], ..BackOffs::default() };
        tube.write(AlongPlan::new(plan, [&A.repeat(N), &B.repeat(N)], DIMS, 0), &mut found);
        tube.gains().to_vec()
    };
    let expected = gains(vec![1.0; 2]);
    // At the last stage S = I.
    let [k0, k1] = [expected[2 * N - 2], expected[2 * N - 1]];
    let h = 1.0 + B[0] * B[0] + B[1] * B[1];
    for (k, column) in [(k0, 0), (k1, 1)] {
        let by = (B[0] * A[column] + B[1] * A[2 + column]) / h;
        assert!((k + by).abs() < 1e-14, "{k} {by}");
    }
    assert_eq!(gains(vec![1024.0, 1.0 / 64.0]), expected);
}

/// Errors of the model within boxes.
fn boxed() -> Sources {
    Sources { boxes: vec![0.3, 0.1], ..Sources::default() }
}

/// The states and inputs of a plant under the feedback `gains`, disturbed in each step.
fn run(gains: &[f64], mut x: [f64; 2], mut w: impl FnMut() -> [f64; 2]) -> Vec<([f64; 2], f64)> {
    let step = |k: usize| {
        let u = gains[2 * k] * x[0] + gains[2 * k + 1] * x[1];
        let mut next = [0.0; 2];
        Linear.step(&x, &[u], &[0.0], &mut next);
        let w = w();
        x = [next[0] + w[0], next[1] + w[1]];
        (x, u)
    };
    (0..N).map(step).collect()
}

/// Quantiles of chi-squared with two degrees of freedom: -2 ln(1 - q).
#[test]
fn deviations_have_the_tubes_covariance_and_stay_within_with_the_stated_probability() {
    let (sd, covariance) = ([0.3, 0.1], [0.2, 0.1, 0.1, 0.4]);
    let probability = 0.95;
    let sources = Sources {
        probability: Some(probability),
        process_sd: sd.to_vec(),
        estimate: true,
        ..Sources::default()
    };
    let (tube, back_offs) = tube(sources, Some(&covariance));
    assert_eq!(tube.covariances()[..4], covariance);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
    const RUNS: usize = 40_000;
    let (mut beyond, mut outside, mut inputs) = ([0; N], [[0; 2]; N], [0; N]);
    for _ in 0..RUNS {
        // The Cholesky factor of the covariance.
        let (a, b) = (normal(), normal());
        let root = covariance[0].sqrt();
        let below = covariance[1] / root;
        let start = [root * a, below * a + (covariance[3] - below * below).sqrt() * b];
        let path = run(tube.gains(), start, || [sd[0] * normal(), sd[1] * normal()]);
        for (k, (x, u)) in path.into_iter().enumerate() {
            let [p, q, _, r] = tube.covariances()[4 * (k + 1)..4 * (k + 2)] else { panic!() };
            let normalized =
                (r * x[0] * x[0] - 2.0 * q * x[0] * x[1] + p * x[1] * x[1]) / (p * r - q * q);
            beyond[k] += usize::from(normalized > -2.0 * (0.1_f64).ln());
            for (i, outside) in outside[k].iter_mut().enumerate() {
                *outside += usize::from(x[i] > back_offs.states[2 * k + i]);
            }
            inputs[k] += usize::from(u > back_offs.inputs[k]);
        }
    }
    let share = |count: usize| f64::from(u32::try_from(count).unwrap()) / RUNS as f64;
    for k in 0..N {
        // Four standard deviations of a share.
        assert!((share(beyond[k]) - 0.1).abs() < 0.006, "{k}: {}", share(beyond[k]));
        for outside in outside[k] {
            assert!((share(outside) - 0.05).abs() < 0.0045, "{k}: {}", share(outside));
        }
        if k > 0 {
            assert!((share(inputs[k]) - 0.05).abs() < 0.0045, "{k}: {}", share(inputs[k]));
        }
    }
    assert_eq!(back_offs.inputs[0].to_bits(), 0.0_f64.to_bits());
}

/// The covariance of two states and a parameter.
const OF_ALL: [f64; 9] = [0.2, 0.1, -0.15, 0.1, 0.4, 0.05, -0.15, 0.05, 0.3];

/// The parameter is drawn with the state, and stays as it is.
#[test]
fn an_estimated_parameter_counts_with_its_covariance_and_correlation() {
    let dims = DIMS.with_parameters(1);
    let sources = Sources { probability: Some(0.9), estimate: true, ..Sources::default() };
    let units = vec![1.0, 2.0];
    let model = TubeModel { model: Box::new(Linear), more: vec![] };
    let new = EllipsoidTube::new((dims, N), sources, Some(model), Feedback::Riccati, units);
    let mut tube = new.unwrap();
    tube.set_covariance(&OF_ALL);
    let zeros = |size: usize| vec![0.0; size];
    let [outputs, starts] = [zeros(N), zeros(N)];
    let mut found = BackOffs { states: zeros(2 * N), inputs: zeros(N), outputs, starts };
    let plan = Stages { x: &[0.0; 2 * N], u: &[0.0; N], p: &[0.0; N] };
    // Twice: nothing is left of the first.
    for _ in 0..2 {
        tube.write(AlongPlan::new(plan, [&A.repeat(N), &B.repeat(N)], dims, 0), &mut found);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
    const RUNS: usize = 40_000;
    let (mut states, mut inputs, mut ends, mut starts) = ([[0; 2]; N], [0; N], [0; N], [0; N]);
    for _ in 0..RUNS {
        let [x0, x1, p] = drawn([normal(), normal(), normal()]);
        let path = run(tube.gains(), [x0, x1], || BY_P.map(|by| by * p));
        let y = |[a, b]: [f64; 2]| C[0] * a + C[1] * b + OUTPUT_BY_P * p;
        let mut before = [x0, x1];
        for (k, (x, u)) in path.into_iter().enumerate() {
            for (i, outside) in states[k].iter_mut().enumerate() {
                *outside += usize::from(x[i] > found.states[2 * k + i]);
            }
            inputs[k] += usize::from(u > found.inputs[k]);
            ends[k] += usize::from(y(x) > found.outputs[k]);
            starts[k] += usize::from(y(before) > found.starts[k]);
            before = x;
        }
    }
    for k in 0..N {
        let of_inputs = if k > 0 { &inputs[k..=k] } else { &[] };
        for outside in states[k].iter().chain([&ends[k], &starts[k]]).chain(of_inputs) {
            let share = f64::from(u32::try_from(*outside).unwrap()) / RUNS as f64;
            // Four standard deviations.
            assert!((share - 0.1).abs() < 0.006, "{k}: {share}");
        }
    }
}

/// A draw of covariance [`OF_ALL`], from independent ones of 1: by its Cholesky factor.
fn drawn(normal: [f64; 3]) -> [f64; 3] {
    let mut root = [[0.0_f64; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| root[i][k] * root[j][k]).sum();
            let rest = OF_ALL[3 * i + j] - sum;
            root[i][j] = if i == j { rest.sqrt() } else { rest / root[j][j] };
        }
    }
    root.map(|row| row.iter().zip(normal).map(|(of, normal)| of * normal).sum())
}

#[test]
fn bounded_disturbances_never_leave_the_tube_and_come_near_its_edge() {
    let (boxes, error, half) = ([0.1, 0.05], [0.02, 0.03], 0.2);
    let sources = Sources {
        boxes: boxes.to_vec(),
        parameters: vec![Interval { place: 0, low: -half, high: 0.5 * half }],
        error: Some(Box::new(Error(error))),
        ..Sources::default()
    };
    let (tube, back_offs) = tube(sources, None);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut nearest = [0.0_f64; N];
    for _ in 0..20_000 {
        // Corners, and a parameter that stays.
        let p = rng.random_range(-half..=0.5 * half);
        let p = if rng.random_bool(0.7) { -half } else { p };
        let mut sign = || if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let w = || [0, 1].map(|i| sign() * (boxes[i] + error[i]) + BY_P[i] * p);
        for (k, (x, u)) in run(tube.gains(), [0.0; 2], w).into_iter().enumerate() {
            for i in 0..2 {
                let edge = back_offs.states[2 * k + i];
                assert!(x[i].abs() <= edge, "{k}: {x:?} {edge}");
                nearest[k] = nearest[k].max(x[i].abs() / edge);
            }
            assert!(u.abs() <= back_offs.inputs[k] + 1e-15, "{k}: {u}");
        }
    }
    // The ellipsoids contain the sums of boxes; they are not much larger.
    assert!(nearest.iter().all(|near| *near > 0.7), "{nearest:?}");
}

/// The plant with its states in other units has the same tube in these, under the same feedback, though
/// the controller's own units stay.
#[test]
fn units_of_states_do_not_matter() {
    let in_units = |of: [f64; 2]| {
        let scaled = |a: &[f64; 4]| -> Vec<f64> {
            (0..4).map(|at| a[at] * of[at / 2] / of[at % 2]).collect()
        };
        let (a, b) = (scaled(&A), [B[0] * of[0], B[1] * of[1]]);
        let gain = vec![-0.9 / of[0], -1.1 / of[1]];
        let sources = Sources {
            probability: Some(0.9),
            process_sd: vec![0.1 * of[0], 0.02 * of[1]],
            boxes: vec![0.1 * of[0], 0.05 * of[1]],
            ..Sources::default()
        };
        let units = vec![1.0, 2.0];
        let feedback = Feedback::Given(gain);
        let mut tube = EllipsoidTube::new((DIMS, N), sources, None, feedback, units).unwrap();
        let zeros = |size: usize| vec![0.0; size];
        let mut found = BackOffs { states: zeros(2 * N), inputs: zeros(N), ..BackOffs::default() };
        let plan = Stages { x: &[0.0; 2 * N], u: &[0.0; N], p: &[] };
        tube.write(AlongPlan::new(plan, [&a.repeat(N), &b.repeat(N)], DIMS, 0), &mut found);
        let states = found.states.iter().zip(of.iter().cycle()).map(|(by, unit)| by / unit);
        states.chain(found.inputs.iter().copied()).collect::<Vec<f64>>()
    };
    let expected = in_units([1.0, 1.0]);
    // All but the input of the first stage deviate.
    assert_eq!(expected.iter().filter(|by| **by > 0.0).count(), 3 * N - 1, "{expected:?}");
    for of in [[1e6, 1.0], [1.0, 1e6], [1e-6, 1e3], [1e5, 1e-5], [1e-6, 1e-6]] {
        for (found, expected) in in_units(of).into_iter().zip(&expected) {
            assert!(
                (found - expected).abs() <= 1e-9 * (1.0 + expected),
                "{of:?}: {found} {expected}"
            );
        }
    }
}
