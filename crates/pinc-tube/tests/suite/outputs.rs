//! Outputs that depend on the input, and parameters at which the model has no value.

use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Stages};
use pinc_tube::{
    AlongPlan, BackOffs, EllipsoidTube, Feedback, Interval, Sources, Tube, TubeModel,
    normal_quantile,
};

const N: usize = 3;
const DIMS: Dims = Dims::new(1, 1);
const A: f64 = 0.5;
const B: f64 = 1.0;
const C: f64 = 3.0;
const D: f64 = -2.0;
const K: f64 = -0.2;

/// x\[k+1\] = (A x + B u) / p, y = C x + D u
#[derive(Debug)]
struct Linear;

impl Model for Linear {
    fn dims(&self) -> Dims {
        DIMS.with_parameters(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        next[0] = (A * x[0] + B * u[0]) / p[0];
    }

    fn linearize(&mut self, _: Stages<'_>, _: Linearization<'_>) {
        unreachable!("the test gives A and B")
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        (out.y[0], out.c[0], out.d[0]) = (C * at.x[0] + D * at.u[0], C, D);
        out.e.fill(0.0);
    }
}

fn back_offs(sources: Sources) -> BackOffs {
    let units = vec![1.0];
    let model = TubeModel { model: Box::new(Linear), more: vec![1.0] };
    let feedback = Feedback::Given(vec![K]);
    let mut tube = EllipsoidTube::new((DIMS, N), sources, Some(model), feedback, units).unwrap();
    tube.set_covariance(&[0.09]);
    let plan = Stages { x: &[0.0; N], u: &[0.0; N], p: &[] };
    let zeros = || vec![0.0; N];
    let mut found =
        BackOffs { states: zeros(), inputs: zeros(), outputs: zeros(), starts: zeros() };
    tube.write(AlongPlan::new(plan, [&[A; N], &[B; N]], DIMS, 0), &mut found);
    found
}

/// At the start of an interval state and input deviate together, by the state there; at its end by two
/// states, of which no more is known than how large they are.
#[test]
fn an_output_has_a_distance_at_either_end_of_an_interval() {
    let sources = Sources {
        probability: Some(0.99),
        process_sd: vec![0.1],
        estimate: true,
        ..Sources::default()
    };
    let found = back_offs(sources);
    let (z, mut sd) = (normal_quantile(0.99), 0.3);
    for j in 0..N {
        let k = if j == 0 { 0.0 } else { K };
        let next = ((A + B * k) * sd).hypot(0.1);
        for (found, expected) in [
            (found.starts[j], z * (C + D * k).abs() * sd),
            (found.outputs[j], z * (C * next + (D * k).abs() * sd)),
            (found.states[j], z * next),
        ] {
            assert!((found - expected).abs() < 1e-12, "{j}: {found}, {expected}");
        }
        sd = next;
    }
}

#[test]
fn without_a_value_at_one_end_of_an_interval_there_is_no_distance() {
    for [low, high] in [[0.0, 2.0], [-1.0, 0.0]] {
        let parameters = vec![Interval { place: 0, low, high }];
        let found = back_offs(Sources { parameters, ..Sources::default() });
        assert!(found.states.iter().all(|by| by.is_nan()), "{low}: {found:?}");
    }
}

/// x\[k+1\] = x + exp(u p)
#[derive(Debug)]
struct Exponential;

impl Model for Exponential {
    fn dims(&self) -> Dims {
        DIMS.with_parameters(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        next[0] = x[0] + (u[0] * p[0]).exp();
    }

    fn linearize(&mut self, _: Stages<'_>, _: Linearization<'_>) {
        unreachable!("the test gives A and B")
    }

    fn linearize_output(&mut self, _: Stages<'_>, _: OutputLinearization<'_>) {
        // It has no outputs.
    }
}

/// Where a parameter moves the state further at its lower end, this counts with the other sign, as the
/// parameter is the same in all steps: p raises the state where u = 1 and lowers it where u = -1.
#[test]
fn steps_deviate_along_one_direction_of_a_parameter() {
    let parameters = vec![Interval { place: 0, low: -0.5, high: 0.5 }];
    let sources = Sources { parameters, ..Sources::default() };
    let units = vec![1.0];
    let model = TubeModel { model: Box::new(Exponential), more: vec![0.0] };
    let feedback = Feedback::Given(vec![K]);
    let mut tube = EllipsoidTube::new((DIMS, N), sources, Some(model), feedback, units).unwrap();
    let plan = Stages { x: &[0.0; N], u: &[1.0, -1.0, 1.0], p: &[] };
    let mut found = BackOffs { states: vec![0.0; N], inputs: vec![0.0; N], ..BackOffs::default() };
    tube.write(AlongPlan::new(plan, [&[A; N], &[B; N]], DIMS, 0), &mut found);
    let (farther, m) = (0.5_f64.exp() - 1.0, A + B * K);
    let first = farther;
    let second = m * first - farther;
    let third = m * second + farther;
    for (found, expected) in found.states.iter().zip([first, second, third]) {
        assert!((found - expected.abs()).abs() < 1e-12, "{found} {expected}");
    }
}
