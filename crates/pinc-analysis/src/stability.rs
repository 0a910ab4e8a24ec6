//! Which steps of an explicit Runge-Kutta method are stable.

use crate::Complex;
use pinc_ode::Integrator;

/// |R| may exceed 1 by this much: of an undamped oscillation it is 1 but for the method's error.
const SLACK: f64 = 1e-6;

/// Where the search for a number of substeps ends.
const MOST: usize = 1 << 20;

/// The stability function R of an explicit Runge-Kutta method.
///
/// Applied to x' = lambda x, a step of h multiplies x by R(h lambda); where |R| > 1, a mode that
/// should decay grows from step to step instead. R is a polynomial with the coefficients 1 and
/// b' A^(k-1) 1, k = 1, 2, .. of the method's tableau. Reference: Hairer and Wanner, *Solving
/// Ordinary Differential Equations II*, section IV.2.
///
/// ```
/// use pinc_analysis::{Complex, StabilityFunction};
/// use pinc_ode::Integrator;
///
/// let rk4 = StabilityFunction::of(Integrator::Rk4).unwrap();
/// let fast = Complex { re: -500.0, im: 0.0 };
/// assert!((rk4.real_limit() - 2.785).abs() < 1e-3);
/// // |lambda| T = 5 is more than 2.785.
/// assert_eq!(rk4.stable_substeps(&[fast], 0.01), Some(2));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct StabilityFunction {
    /// From the constant on.
    coefficients: Vec<f64>,
}

impl StabilityFunction {
    /// The stability function of an explicit method; `None` for other methods.
    #[must_use]
    pub fn of(integrator: Integrator) -> Option<Self> {
        let (weights, stages) = integrator.tableau()?.rows().split_last()?;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut power = vec![1.0; stages.len()];
        let mut coefficients = vec![1.0];
        for _ in 0..stages.len() {
            coefficients.push(dot(weights, &power));
            power = stages.iter().map(|row| dot(row, &power)).collect();
        }
        Some(Self { coefficients })
    }

    /// R(z), the factor by which a step multiplies a mode with h lambda = z.
    #[must_use]
    pub fn amplification(&self, z: Complex) -> Complex {
        let zero = Complex { re: 0.0, im: 0.0 };
        self.coefficients.iter().rev().fold(zero, |sum, c| Complex {
            re: sum.re * z.re - sum.im * z.im + c,
            im: sum.re * z.im + sum.im * z.re,
        })
    }

    /// The largest |h lambda| on the negative real axis for which a step is stable: 2.785 for
    /// RK4, 3.307 for RK5.
    #[must_use]
    pub fn real_limit(&self) -> f64 {
        let stable = |z: f64| self.amplification(Complex { re: -z, im: 0.0 }).abs() <= 1.0;
        let (mut low, mut high) = (1.0, 8.0);
        while high - low > 1e-12 {
            let middle = f64::midpoint(low, high);
            if stable(middle) { low = middle } else { high = middle }
        }
        low
    }

    /// Whether no mode that decays grows by steps of `step_s` seconds.
    #[must_use]
    pub fn is_stable(&self, modes: &[Complex], step_s: f64) -> bool {
        let decaying = modes.iter().filter(|mode| mode.re <= 0.0);
        decaying
            .map(|mode| self.amplification(mode.times(step_s)).abs())
            .all(|factor| factor <= 1.0 + SLACK)
    }

    /// The least number of substeps of a step T = `step_s` that are stable for these eigenvalues
    /// (in 1/s); `None` if a million are not.
    #[must_use]
    pub fn stable_substeps(&self, modes: &[Complex], step_s: f64) -> Option<usize> {
        let stable = |n: usize| self.is_stable(modes, step_s / n as f64);
        let mut high = 1;
        while !stable(high) {
            high *= 2;
            if high > MOST {
                return None;
            }
        }
        let mut low = high / 2;
        while high - low > 1 {
            let middle = usize::midpoint(low, high);
            if stable(middle) { high = middle } else { low = middle }
        }
        Some(high)
    }
}
