//! Properties of Kalman filters on any model.

use crate::support::{oscillator, tanks};
use pinc_estimate::{Ekf, Estimator, EstimatorStatus, Mhe, Tuning, Ukf};
use pinc_ode::{Dims, Linearization, Memory, Model, OutputLinearization, Stages};
use proptest::prelude::*;

/// x+ = A x + B u, y = C x + D u.
#[derive(Clone, Debug)]
pub(crate) struct Linear {
    pub(crate) a: [[f64; 2]; 2],
    pub(crate) b: [f64; 2],
    pub(crate) c: [[f64; 2]; 2],
    pub(crate) d: [f64; 2],
}

impl Model for Linear {
    fn dims(&self) -> Dims {
        Dims::new(2, 1)
    }
    fn sample_time_s(&self) -> f64 {
        1.0
    }
    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        for (next, (a, b)) in next.iter_mut().zip(self.a.iter().zip(self.b)) {
            *next = a[0] * x[0] + a[1] * x[1] + b * u[0];
        }
    }
    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (point, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.step(point.x, point.u, &[], out.next);
            out.a.copy_from_slice(self.a.as_flattened());
            out.b.copy_from_slice(&self.b);
        }
    }
    fn output(&mut self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        for (y, (c, d)) in y.iter_mut().zip(self.c.iter().zip(self.d)) {
            *y = c[0] * x[0] + c[1] * x[1] + d * u[0];
        }
    }
    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (point, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.output(point.x, point.u, &[], out.y);
            out.c.copy_from_slice(self.c.as_flattened());
            out.d.copy_from_slice(&self.d);
        }
    }
}

/// The same with a known parameter, x+ = A x + B u + e p, y = C x + D u + f p.
#[derive(Clone, Debug)]
struct Told {
    linear: Linear,
    e: [f64; 2],
    f: [f64; 2],
}

impl Told {
    fn add(gain: [f64; 2], p: &[f64], to: &mut [f64]) {
        to.iter_mut().zip(gain).for_each(|(to, gain)| *to += gain * p[0]);
    }
}

impl Model for Told {
    fn dims(&self) -> Dims {
        Dims::new(2, 1).with_parameters(1)
    }
    fn sample_time_s(&self) -> f64 {
        1.0
    }
    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.linear.step(x, u, p, next);
        Self::add(self.e, p, next);
    }
    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        assert!(out.e.is_empty(), "nobody needs the derivatives by what is known");
        for k in 0..at.count(self.dims()) {
            let (point, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.step(point.x, point.u, point.p, out.next);
            out.a.copy_from_slice(self.linear.a.as_flattened());
            out.b.copy_from_slice(&self.linear.b);
        }
    }
    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.linear.output(x, u, p, y);
        Self::add(self.f, p, y);
    }
    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (point, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.output(point.x, point.u, point.p, out.y);
            out.c.copy_from_slice(self.linear.c.as_flattened());
            out.d.copy_from_slice(&self.linear.d);
        }
    }
}

type Matrix = [[f64; 2]; 2];

fn product(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}

fn transposed(a: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn with_diagonal(a: Matrix, diagonal: [f64; 2]) -> Matrix {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| a[i][j] + if i == j { diagonal[i] } else { 0.0 })
    })
}

fn inverse(a: Matrix) -> Matrix {
    let determinant = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    [[a[1][1], -a[0][1]], [-a[1][0], a[0][0]]].map(|row| row.map(|entry| entry / determinant))
}

/// The Kalman filter of textbooks, with matrices: the estimates after each correction, and the sum
/// of v' S^-1 v.
fn textbook(model: &Linear, tuning: &Tuning, data: &[([f64; 2], f64)]) -> (Vec<[f64; 2]>, f64) {
    let square = |sd: &[f64]| [sd[0] * sd[0], sd[1] * sd[1]];
    let (q, r) = (square(&tuning.process_sd), square(&tuning.measurement_sd));
    let mut p = with_diagonal([[0.0; 2]; 2], square(&tuning.initial_sd));
    let mut z = [tuning.initial_estimate[0], tuning.initial_estimate[1]];
    let (mut found, mut nis) = (Vec::new(), 0.0);
    let apply = |m: Matrix, v: [f64; 2]| m.map(|row| row[0] * v[0] + row[1] * v[1]);
    // Measured before the input changes; in the beginning there was none.
    let mut held = 0.0;
    for (y, u) in data {
        let cross = product(p, transposed(model.c));
        let s = inverse(with_diagonal(product(model.c, cross), r));
        let expected = apply(model.c, z);
        let v = [0, 1].map(|i| y[i] - expected[i] - model.d[i] * held);
        let change = apply(product(cross, s), v);
        nis += apply(s, v)[0] * v[0] + apply(s, v)[1] * v[1];
        z = [z[0] + change[0], z[1] + change[1]];
        let less = product(product(cross, s), transposed(cross));
        p = std::array::from_fn(|i| std::array::from_fn(|j| p[i][j] - less[i][j]));
        found.push(z);
        let moved = apply(model.a, z);
        z = [moved[0] + model.b[0] * u, moved[1] + model.b[1] * u];
        held = *u;
        p = with_diagonal(product(product(model.a, p), transposed(model.a)), q);
    }
    (found, nis)
}

pub(crate) fn linear() -> impl Strategy<Value = Linear> {
    // Eigenvalues of 1.2 at most: nothing grows beyond what rounding leaves intact.
    let entry = || -0.6..0.6_f64;
    let square = || prop::array::uniform2(prop::array::uniform2(entry()));
    let column = || prop::array::uniform2(entry());
    (square(), column(), square(), column()).prop_map(|(a, b, c, d)| Linear { a, b, c, d })
}

pub(crate) fn tuning() -> Tuning {
    Tuning {
        initial_estimate: vec![0.5, -0.5],
        initial_sd: vec![1.0, 2.0],
        process_sd: vec![0.1, 0.3],
        measurement_sd: vec![0.2, 0.4],
        ..Tuning::default()
    }
}

proptest! {
    #[test]
    fn on_a_linear_model_both_are_the_kalman_filter(
        model in linear(),
        data in prop::collection::vec((prop::array::uniform2(-3.0..3.0_f64), -1.0..1.0_f64), 1..30),
    ) {
        let (expected, nis) = textbook(&model, &tuning(), &data);
        let kalman = Ekf::new(Box::new(model.clone()), tuning()).unwrap();
        let unscented = Ukf::new(Box::new(model), tuning()).unwrap();
        // The sigma points are a thousandth of a standard deviation apart: their covariances have
        // fewer digits.
        let filters: [(Box<dyn Estimator>, f64); 2] =
            [(Box::new(kalman), 1e-11), (Box::new(unscented), 1e-5)];
        for (mut filter, tolerance) in filters {
            let mut sum = 0.0;
            for ((y, u), expected) in data.iter().zip(&expected) {
                let correction = filter.correct(y);
                prop_assert_eq!(correction.status, EstimatorStatus::Updated);
                prop_assert_eq!(correction.measured, 2);
                sum += correction.nis;
                for (found, expected) in filter.estimate().iter().zip(expected) {
                    let size = 1.0 + expected.abs();
                    prop_assert!((found - expected).abs() < tolerance * size);
                }
                filter.predict(&[*u]);
            }
            prop_assert!((sum - nis).abs() < 10.0 * tolerance * (1.0 + nis), "{sum} {nis}");
        }
    }

    /// What a known parameter does to states and readings is known, too: the estimate is that of the
    /// textbook's filter from the readings without it, plus what it does to the state.
    #[test]
    fn what_a_known_parameter_does_is_known(
        linear in linear(),
        gains in prop::array::uniform4(-2.0..2.0_f64),
        told in prop::collection::vec(
            ((prop::array::uniform2(-3.0..3.0_f64), -1.0..1.0_f64), -5.0..5.0_f64),
            1..30,
        ),
        restored_at in 0_usize..30,
    ) {
        let [e, f] = [[gains[0], gains[1]], [gains[2], gains[3]]];
        let mut model = Told { linear: linear.clone(), e, f };
        let (mut x, mut moved, mut readings) = ([0.0; 2], Vec::new(), Vec::new());
        for ((without, _), p) in &told {
            let mut by_p = [0.0; 2];
            model.output(&x, &[0.0], &[*p], &mut by_p);
            readings.push([without[0] + by_p[0], without[1] + by_p[1]]);
            moved.push(x);
            let mut next = [0.0; 2];
            model.step(&x, &[0.0], &[*p], &mut next);
            x = next;
        }
        let without: Vec<_> = told.iter().map(|(without, _)| *without).collect();
        let (expected, _) = textbook(&linear, &tuning(), &without);
        let tuning = Tuning { parameters: vec![0.0], ..tuning() };
        let filters = || -> [(Box<dyn Estimator>, f64); 3] {
            let boxed = || Box::new(model.clone());
            [
                (Box::new(Ekf::new(boxed(), tuning.clone()).unwrap()), 1e-10),
                (Box::new(Ukf::new(boxed(), tuning.clone()).unwrap()), 1e-5),
                (Box::new(Mhe::new(boxed(), tuning.clone(), 4).unwrap()), 1e-6),
            ]
        };
        for ((mut filter, tolerance), (mut other, _)) in filters().into_iter().zip(filters()) {
            for (k, ((_, u), p)) in told.iter().enumerate() {
                if k == restored_at {
                    let mut numbers = Vec::new();
                    filter.remember(&mut Memory::save(&mut numbers));
                    let mut memory = Memory::restore(&numbers);
                    other.remember(&mut memory);
                    prop_assert!(memory.is_complete());
                    std::mem::swap(&mut filter, &mut other);
                }
                filter.set_parameters(&[*p]);
                prop_assert_eq!(filter.correct(&readings[k]).status, EstimatorStatus::Updated);
                for ((z, expected), moved) in filter.estimate().iter().zip(expected[k]).zip(moved[k]) {
                    let expected = expected + moved;
                    let size = 1.0 + expected.abs() + moved.abs();
                    prop_assert!((z - expected).abs() < tolerance * size, "{z} {expected}");
                }
                filter.predict(&[*u]);
            }
        }
    }

    /// Two sensors of one state, one with a hundredth of the noise of the other: the estimate is the
    /// mean of both readings and the first guess, each weighted by its precision.
    #[test]
    fn a_sensor_counts_by_its_noise(
        y in prop::array::uniform2(-1.0..1.0_f64),
        first_is_better in any::<bool>(),
    ) {
        let model = Linear { a: [[1.0, 0.0], [0.0, 1.0]], b: [0.0; 2], c: [[1.0, 0.0]; 2], d: [0.0; 2] };
        let sd = if first_is_better { [0.05, 5.0] } else { [5.0, 0.05] };
        let tuning = Tuning { measurement_sd: sd.to_vec(), ..tuning() };
        let weights = [1.0, sd[0].powi(-2), sd[1].powi(-2)];
        let sum: f64 = weights.iter().sum();
        let expected = (0.5 * weights[0] + y[0] * weights[1] + y[1] * weights[2]) / sum;
        let all: [(Box<dyn Estimator>, f64); 3] = [
            (Box::new(Ekf::new(Box::new(model.clone()), tuning.clone()).unwrap()), 1e-11),
            (Box::new(Ukf::new(Box::new(model.clone()), tuning.clone()).unwrap()), 1e-5),
            (Box::new(Mhe::new(Box::new(model), tuning, 3).unwrap()), 1e-9),
        ];
        for (mut estimator, tolerance) in all {
            prop_assert_eq!(estimator.correct(&y).measured, 2);
            let (z, sd) = (estimator.estimate()[0], estimator.covariance()[0].sqrt());
            prop_assert!((z - expected).abs() < tolerance, "{} {}", z, expected);
            prop_assert!((sd * sum.sqrt() - 1.0).abs() < 1e-4, "{}", sd);
        }
    }

    /// A sensor that fails is as if it were not there.
    #[test]
    fn a_missing_measurement_is_skipped(
        model in linear(),
        data in prop::collection::vec((-3.0..3.0_f64, any::<bool>()), 1..20),
    ) {
        // A sensor with so much noise that it says nothing.
        let deaf = Tuning { measurement_sd: vec![0.2, 1e9], ..tuning() };
        for unscented in [false, true] {
            let build = |tuning| -> Box<dyn Estimator> {
                if unscented {
                    Box::new(Ukf::new(Box::new(model.clone()), tuning).unwrap())
                } else {
                    Box::new(Ekf::new(Box::new(model.clone()), tuning).unwrap())
                }
            };
            let (mut skips, mut ignores) = (build(tuning()), build(deaf.clone()));
            for (y, infinite) in &data {
                let missing = if *infinite { f64::INFINITY } else { f64::NAN };
                let correction = skips.correct(&[*y, missing]);
                prop_assert_eq!(correction.measured, 1);
                prop_assert!(skips.innovation()[1].is_nan());
                ignores.correct(&[*y, 0.0]);
                for (a, b) in skips.estimate().iter().zip(ignores.estimate()) {
                    prop_assert!((a - b).abs() < 1e-6 * (1.0 + a.abs()));
                }
                let before = skips.estimate().to_vec();
                let nothing = skips.correct(&[missing; 2]);
                prop_assert_eq!(nothing.status, EstimatorStatus::NothingMeasured);
                prop_assert_eq!(skips.estimate(), &before[..]);
                skips.predict(&[0.5]);
                ignores.predict(&[0.5]);
            }
        }
    }
}

#[test]
fn reset_forgets_everything() {
    for case in [tanks(), oscillator()] {
        let build: [Box<dyn Estimator>; 2] = [
            Box::new(Ekf::new(case.model(), case.tuning.clone()).unwrap()),
            Box::new(Ukf::new(case.model(), case.tuning.clone()).unwrap()),
        ];
        for mut filter in build {
            let first = case.run(filter.as_mut());
            assert_ne!(filter.estimate(), &case.tuning.initial_estimate[..]);
            filter.reset();
            assert_eq!(filter.estimate(), &case.tuning.initial_estimate[..]);
            assert_eq!(case.run(filter.as_mut()), first);
        }
    }
}

#[test]
fn estimates_are_clipped_to_their_bounds() {
    let case = oscillator();
    let tuning =
        Tuning { low: vec![-0.5; 2], high: vec![f64::INFINITY, 0.5], ..case.tuning.clone() };
    let build: [Box<dyn Estimator>; 2] = [
        Box::new(Ekf::new(case.model(), tuning.clone()).unwrap()),
        Box::new(Ukf::new(case.model(), tuning).unwrap()),
    ];
    for mut filter in build {
        let found = case.run(filter.as_mut());
        let inside = |z: &[f64]| z[0] >= -0.5 && (-0.5..=0.5).contains(&z[1]);
        assert!(found.iter().all(|(z, _)| inside(z)));
        let at_bounds = found.iter().filter(|(z, _)| z[1] >= 0.5 || z[0] <= -0.5).count();
        assert!(at_bounds > 10, "{at_bounds}");
    }
}

/// Where the model has no value, what was known stays known.
#[test]
fn no_value_is_no_estimate() {
    let mut broken =
        Linear { a: [[1.0; 2]; 2], b: [1.0; 2], c: [[1.0, 0.0], [0.0, 1.0]], d: [0.0; 2] };
    broken.a[0][0] = f64::NAN;
    let build: [Box<dyn Estimator>; 2] = [
        Box::new(Ekf::new(Box::new(broken.clone()), tuning()).unwrap()),
        Box::new(Ukf::new(Box::new(broken), tuning()).unwrap()),
    ];
    for mut filter in build {
        filter.correct(&[1.0, 2.0]);
        let before = (filter.estimate().to_vec(), filter.covariance().to_vec());
        assert_eq!(filter.predict(&[0.0]), EstimatorStatus::NotFinite);
        assert_eq!((filter.estimate().to_vec(), filter.covariance().to_vec()), before);
        for y in [1e200, -1e308] {
            let correction = filter.correct(&[y, 2.0]);
            assert_eq!(correction.status, EstimatorStatus::Rejected);
            assert_eq!((correction.measured, correction.rejected), (1, 1));
        }
        assert!(filter.estimate().iter().all(|z| z.is_finite()));
    }
}

/// Until the first prediction a reading is expected under the input that was given so far, which a
/// window that grows still knows of its first state.
#[test]
fn the_first_reading_is_under_the_input_given_so_far() {
    let mut model =
        Linear { a: [[0.9, 0.2], [0.0, 0.7]], b: [0.5, 1.0], c: [[1.0, 0.0]; 2], d: [2.0, -3.0] };
    let tuning = Tuning {
        initial_estimate: vec![0.5, -0.2],
        initial_sd: vec![1.0; 2],
        process_sd: vec![0.1; 2],
        measurement_sd: vec![0.1; 2],
        ..Tuning::default()
    };
    let boxed = || Box::new(model.clone());
    let all: [Box<dyn Estimator>; 3] = [
        Box::new(Ekf::new(boxed(), tuning.clone()).unwrap()),
        Box::new(Ukf::new(boxed(), tuning.clone()).unwrap()),
        Box::new(Mhe::new(boxed(), tuning.clone(), 4).unwrap()),
    ];
    for mut estimator in all {
        for begun in [Some(1.5), None, Some(-1.0)] {
            match begun {
                Some(u) => estimator.reset_input(&[u]),
                None => estimator.reset(),
            }
            let (mut x, mut u) = (tuning.initial_estimate.clone(), begun.unwrap_or(0.0));
            for k in 0..4 {
                let (mut y, mut next) = ([0.0; 2], [0.0; 2]);
                model.output(&x, &[u], &[], &mut y);
                estimator.correct(&y);
                let off = estimator.estimate().iter().zip(&x).map(|(z, x)| (z - x).abs());
                assert!(off.fold(0.0, f64::max) < 1e-8, "step {k} after {begun:?}: {estimator:?}");
                assert!(estimator.innovation().iter().all(|v| v.abs() < 1e-8), "{estimator:?}");
                u = 0.3 * f64::from(k) - 0.7;
                estimator.predict(&[u]);
                model.step(&x, &[u], &[], &mut next);
                x.copy_from_slice(&next);
            }
        }
    }
}

/// y = x + |x| / 2 of a state that stays.
#[derive(Debug)]
struct Kink;

impl Model for Kink {
    fn dims(&self) -> Dims {
        Dims::new(1, 0).with_outputs(1)
    }
    fn sample_time_s(&self) -> f64 {
        1.0
    }
    fn step(&mut self, x: &[f64], _u: &[f64], _p: &[f64], next: &mut [f64]) {
        next.copy_from_slice(x);
    }
    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        out.next.copy_from_slice(at.x);
        out.a.fill(1.0);
    }
    fn output(&mut self, x: &[f64], _u: &[f64], _p: &[f64], y: &mut [f64]) {
        y[0] = x[0] + 0.5 * x[0].abs();
    }
}

/// Points alpha standard deviations away see a kink within the uncertainty.
#[test]
fn far_points_see_a_kink() {
    let (sd, noise, y) = (0.5, 0.1, 0.33_f64);
    for alpha in [1.0_f64, 0.5] {
        let tuning = Tuning {
            initial_estimate: vec![0.0],
            initial_sd: vec![sd],
            process_sd: vec![0.0],
            measurement_sd: vec![noise],
            alpha: Some(alpha),
            ..Tuning::default()
        };
        let mut filter = Ukf::new(Box::new(Kink), tuning).unwrap();
        filter.correct(&[y]);
        // By the formulas of the scaled points -s, 0 and s with beta = 2.
        let (s, w) = (alpha * sd, 0.5 / (alpha * alpha));
        let mean = w * (1.5 * s - 0.5 * s);
        let middle = 1.0 - 2.0 * w + 3.0 - alpha * alpha;
        let variance = w * ((1.5 * s - mean).powi(2) + (-0.5 * s - mean).powi(2))
            + middle * mean * mean
            + noise * noise;
        let gain = w * s * 2.0 * s / variance;
        let expected = (gain * (y - mean), sd * sd - gain * gain * variance);
        assert!((filter.estimate()[0] - expected.0).abs() < 1e-12, "{filter:?}");
        assert!((filter.covariance()[0] - expected.1).abs() < 1e-12, "{filter:?}");
    }
    for alpha in [0.0, -1.0, 1.5, f64::NAN] {
        let tuning = Tuning { alpha: Some(alpha), ..tuning() };
        let model =
            Linear { a: [[1.0; 2]; 2], b: [1.0; 2], c: [[1.0, 0.0], [0.0, 1.0]], d: [0.0; 2] };
        let error = Ukf::new(Box::new(model), tuning).unwrap_err().to_string();
        assert!(error.contains("alpha"), "{error}");
    }
}
