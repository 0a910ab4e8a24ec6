//! A correction and a prediction of each estimator on the recorded data, with RK4 x4 as the model:
//! the median time per step, and the mean and the largest number of quadratic programs of a
//! correction.
//!
//! The moving horizon estimator has a window of 10 steps.

#![expect(clippy::print_stdout, reason = "a benchmark shows what it measures")]

#[path = "../tests/suite/support.rs"]
#[expect(dead_code, reason = "the tests compare estimates too")]
mod support;

use pinc_estimate::{Ekf, Estimator, Mhe, Ukf};
use std::hint::black_box;
use std::time::Instant;
use support::{Case, oscillator, tanks};

/// How often the data are gone through.
const PASSES: usize = 20;

fn main() {
    println!("{:12} {:4} {:>8} {:>5} {:>5}", "data", "", "us", "QPs", "most");
    for (name, case) in [("four tanks", tanks()), ("oscillator", oscillator())] {
        let (model, tuning) = (|| case.model(), || case.tuning.clone());
        let estimators: [(&str, Box<dyn Estimator>); 3] = [
            ("EKF", Box::new(Ekf::new(model(), tuning()).expect("a tuning that suits"))),
            ("UKF", Box::new(Ukf::new(model(), tuning()).expect("a tuning that suits"))),
            ("MHE", Box::new(Mhe::new(model(), tuning(), 10).expect("a tuning that suits"))),
        ];
        for (kind, mut estimator) in estimators {
            let (us, programs, most) = measure(&case, estimator.as_mut());
            println!("{name:12} {kind:4} {us:8.2} {programs:5.2} {most:5}");
        }
    }
}

/// The median time of a step in us, and how many quadratic programs it solves, on average and at
/// most.
fn measure(case: &Case, estimator: &mut dyn Estimator) -> (f64, f64, usize) {
    let rows: Vec<_> = (0..case.data.len())
        .map(|k| (case.data.at(k, case.measured), case.data.at(k, case.inputs)))
        .collect();
    let (mut times, mut programs, mut most) = (Vec::new(), 0.0, 0);
    for _ in 0..PASSES {
        estimator.reset();
        for (y, u) in &rows {
            let clock = Instant::now();
            let correction = estimator.correct(black_box(y));
            estimator.predict(black_box(u));
            times.push(1e6 * clock.elapsed().as_secs_f64());
            most = most.max(correction.iterations);
            programs += f64::from(u32::try_from(correction.iterations).unwrap_or(u32::MAX));
        }
    }
    times.sort_by(f64::total_cmp);
    let steps = f64::from(u32::try_from(times.len()).unwrap_or(u32::MAX));
    (times[times.len() / 2], programs / steps, most)
}
