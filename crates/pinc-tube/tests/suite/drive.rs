//! A differential drive: the tightening that numpy finds, `tests/data/zoro.py`.

use pinc_ode::{Dims, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};
use pinc_tube::{AlongPlan, BackOffs, EllipsoidTube, Feedback, Interval, Sources, Tube, TubeModel};

const T: f64 = 0.2;
const N: usize = 8;
const NU: usize = 6;

/// x+ = x + p T v cos(th + T w/2), y+ = y + p T v sin(th + T w/2), th+ = th + T w, with the output
/// p |(x, y)| + 0.1 v.
#[derive(Debug)]
struct Drive;

impl Model for Drive {
    fn dims(&self) -> Dims {
        Dims::new(3, 2).with_parameters(1).with_outputs(1)
    }

    fn sample_time_s(&self) -> f64 {
        T
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let (sin, cos) = (x[2] + 0.5 * T * u[1]).sin_cos();
        next[0] = x[0] + p[0] * T * u[0] * cos;
        next[1] = x[1] + p[0] * T * u[0] * sin;
        next[2] = x[2] + T * u[1];
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims();
        for k in 0..at.count(dims) {
            let (Stages { x, u, p }, out) = (at.point(k, dims), out.point(k, dims));
            self.step(x, u, p, out.next);
            let (sin, cos) = (x[2] + 0.5 * T * u[1]).sin_cos();
            let way = p[0] * T * u[0];
            let half = 0.5 * T * way;
            out.a.copy_from_slice(&[1.0, 0.0, -way * sin, 0.0, 1.0, way * cos, 0.0, 0.0, 1.0]);
            out.b.copy_from_slice(&[
                p[0] * T * cos,
                -half * sin,
                p[0] * T * sin,
                half * cos,
                0.0,
                T,
            ]);
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        y[0] = p[0] * x[0].hypot(x[1]) + 0.1 * u[0];
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let distance = at.x[0].hypot(at.x[1]);
        self.output(at.x, at.u, at.p, out.y);
        let by = |x: f64| at.p[0] * x / distance;
        out.c.copy_from_slice(&[by(at.x[0]), by(at.x[1]), 0.0]);
        out.d.copy_from_slice(&[0.1, 0.0]);
        out.e[0] = distance;
    }
}

#[test]
fn back_offs_match_numpy() {
    let rows: Vec<Vec<f64>> = include_str!("../data/zoro.txt")
        .lines()
        .map(|line| line.split(' ').map(|number| number.parse().unwrap()).collect())
        .collect();
    let [x, u, states, inputs, outputs] = rows.try_into().unwrap();
    let dims = Drive.dims();
    let plan = Stages { x: &x[..3 * N], u: &u, p: &[1.0; N] };
    let mut at = LinearizationBuffer::new(dims, N);
    Drive.linearize(plan, at.as_mut());
    let sources = Sources {
        probability: Some(0.99),
        process_sd: vec![0.01, 0.02, 0.005],
        boxes: vec![0.004, 0.003, 0.002],
        parameters: vec![Interval { place: 0, low: 0.9, high: 1.05 }],
        estimate: true,
        error: None,
    };
    let units = vec![2.0, 3.0, 1.5];
    let model = TubeModel { model: Box::new(Drive), more: Vec::new() };
    let feedback = Feedback::Riccati;
    let mut tube = EllipsoidTube::new((dims, N), sources, Some(model), feedback, units).unwrap();
    let covariance =
        [[4e-4, 1e-4, 0.0, 0.0], [1e-4, 9e-4, -5e-5, 0.0], [0.0, -5e-5, 1e-4, 0.0], [0.0; 4]];
    tube.set_covariance(covariance.as_flattened());
    let mut found = BackOffs {
        states: vec![f64::NAN; 3 * N],
        inputs: vec![f64::NAN; 2 * NU],
        outputs: vec![f64::NAN; N],
        ..BackOffs::default()
    };
    // Twice: nothing is left of the first.
    for _ in 0..2 {
        tube.write(AlongPlan::new(plan, [&at.a, &at.b], dims, 0), &mut found);
        for (name, found, expected) in [
            ("states", &found.states, &states),
            ("inputs", &found.inputs, &inputs),
            ("outputs", &found.outputs, &outputs),
        ] {
            assert_eq!(found.len(), expected.len(), "{name}");
            for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
                // The quantile is good to 2e-9.
                let error = (found - expected).abs();
                assert!(error <= 1e-8 * (1.0 + expected), "{name}[{i}]: {found} {expected}");
            }
        }
    }
}
