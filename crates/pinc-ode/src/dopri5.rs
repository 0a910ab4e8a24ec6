//! An accurate integrator, for the reference solutions that models are compared with.

use crate::{Dims, DynRhs, OdeError, Plant};
use std::fmt::Debug;
use std::sync::Arc;

const STAGES: usize = 7;

/// Steps tried in one call before the integrator gives up. A right-hand side that chatters about a
/// jump asks for steps of the size of the tolerance: without a limit they would go on for days.
const MAX_STEPS: u32 = 1_000_000;

/// The tableau of Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comput. Appl.
/// Math. 6 (1980). The last row is also the solution of order 5.
pub(crate) const A: [&[f64]; STAGES] = [
    &[],
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
    &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];

/// Solution of order 5 minus the embedded one of order 4.
const ERROR: [f64; STAGES] = [
    71.0 / 57600.0,
    0.0,
    -71.0 / 16695.0,
    71.0 / 1920.0,
    -17253.0 / 339_200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];

/// The Dormand-Prince method of order 5(4) with automatic step size.
///
/// Each step keeps the estimated local error of component i below
/// `tolerance * (1 + |x_i|)`. To know the solution at several times, integrate from one to the
/// next: every one is hit by a step, so no interpolation error is added.
///
/// Suited to non-stiff and mildly stiff equations. Memory: eight vectors of `nx`; `integrate`
/// allocates nothing.
#[derive(Clone, Debug)]
pub struct Dopri5 {
    pub(crate) plant: Arc<dyn DynRhs>,
    dims: Dims,
    pub(crate) p: Vec<f64>,
    pub(crate) tolerance: f64,
    step: Option<f64>,
    rhs_calls: u64,
    k: [Vec<f64>; STAGES],
    stage: Vec<f64>,
    /// The first components, which alone set the step size.
    controlled: usize,
    /// Steps that stability has limited, less those that it has not.
    limited: usize,
}

/// h |lambda| beyond which stability counts as what limits a step. The method's limit on the
/// negative real axis is 3.3, about which the steps swing; those that accuracy limits are far
/// below.
const STABILITY: f64 = 2.0;

impl Dopri5 {
    /// An integrator of `plant` with this local error tolerance, absolute and relative.
    ///
    /// # Panics
    ///
    /// If `tolerance` is not positive.
    #[must_use]
    pub fn new<P: Plant>(plant: P, tolerance: f64) -> Self {
        Self::shared(Arc::new(plant), tolerance)
    }

    /// Like [`Self::new`], for a plant whose type is erased.
    ///
    /// # Panics
    ///
    /// If `tolerance` is not positive.
    #[must_use]
    pub fn shared(plant: Arc<dyn DynRhs>, tolerance: f64) -> Self {
        assert!(tolerance > 0.0, "the tolerance must be positive");
        let dims = plant.dims();
        let stage = vec![0.0; dims.nx];
        let k = std::array::from_fn(|_| stage.clone());
        Self {
            plant,
            dims,
            p: Vec::new(),
            tolerance,
            step: None,
            rhs_calls: 0,
            k,
            stage,
            controlled: dims.nx,
            limited: 0,
        }
    }

    /// The same with a step size that follows the first `components` alone. With the variational
    /// equation behind a plant's own, the plant's state then has the bits of an integration without
    /// it, and the variations are the derivatives of that state.
    ///
    /// # Panics
    ///
    /// If there are not as many.
    #[must_use]
    pub fn controlled_by(self, components: usize) -> Self {
        assert!(components <= self.dims.nx, "components of the state");
        Self { controlled: components, ..self }
    }

    /// The plant's sizes.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// Integrates with the parameters `p` (shape `np`) from now on. A plant with parameters needs
    /// them before the first call of [`Dopri5::integrate`].
    ///
    /// # Panics
    ///
    /// If `p` is not of this length.
    pub fn set_parameters(&mut self, p: &[f64]) {
        assert_eq!(p.len(), self.dims.np, "length of p");
        self.p.clear();
        self.p.extend_from_slice(p);
    }

    /// The parameters that are set; empty if none are.
    pub(crate) fn parameters(&self) -> &[f64] {
        &self.p
    }

    /// Writes the plant's outputs h(x, u, p) into `y`.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `y`: `ny`.
    pub fn output(&self, x: &[f64], u: &[f64], y: &mut [f64]) {
        self.plant.output(x, u, &self.p, y);
    }

    /// How many times the right-hand side has been evaluated.
    #[must_use]
    pub fn rhs_calls(&self) -> u64 {
        self.rhs_calls
    }

    /// Advances `x` (shape `nx`) by `duration` seconds under the constant input `u` (shape `nu`). A
    /// duration of 0 leaves `x` as it is.
    ///
    /// # Errors
    ///
    /// [`OdeError::NotFinite`], or [`OdeError::Undefined`] if the plant knows why, or
    /// [`OdeError::StepTooSmall`], also if a million steps do not
    /// suffice; `x` is then the last state reached.
    ///
    /// # Panics
    ///
    /// If `x` or `u` is of another length, `duration` is negative or not finite, or the plant has
    /// parameters and none are set.
    pub fn integrate(&mut self, x: &mut [f64], u: &[f64], duration: f64) -> Result<(), OdeError> {
        self.check(x, u, duration);
        self.integrate_until_stiff(x, u, duration, None).map(|_| ())
    }

    pub(crate) fn check(&self, x: &[f64], u: &[f64], duration: f64) {
        assert!(
            duration >= 0.0 && duration.is_finite(),
            "the duration must be finite and not negative"
        );
        assert_eq!(x.len(), self.dims.nx, "length of x");
        assert_eq!(u.len(), self.dims.nu, "length of u");
        assert_eq!(self.p.len(), self.dims.np, "parameters are set before the integration");
    }

    /// [`Dopri5::integrate`], which ends before `duration` once `most` steps were limited by
    /// stability, in this call and those before. Returns the time reached.
    pub(crate) fn integrate_until_stiff(
        &mut self,
        x: &mut [f64],
        u: &[f64],
        duration: f64,
        most: Option<usize>,
    ) -> Result<f64, OdeError> {
        if duration == 0.0 {
            // There is no step size to learn from it, and 0 would be one that never grows.
            return Ok(duration);
        }
        let mut t = 0.0;
        let mut step = self.step.unwrap_or(duration / 16.0).min(duration);
        self.plant.rhs(x, u, &self.p, &mut self.k[0]);
        self.rhs_calls += 1;
        let mut tries = 0;
        while t < duration {
            tries += 1;
            if tries > MAX_STEPS {
                return Err(OdeError::StepTooSmall { t, step });
            }
            let remaining = duration - t;
            // Stretch the last step a little rather than leave a sliver behind it.
            let last = step * (1.0 + 1e-6) >= remaining;
            let h = if last { remaining } else { step };
            if t + h <= t {
                return Err(OdeError::StepTooSmall { t, step: h });
            }
            let error = self.attempt(x, u, h);
            if !error.is_finite() && h < 1e-12 * duration {
                return Err(self.not_finite(x, u, h, t));
            }
            // The usual controller; a non-finite error shrinks the step as far as it may.
            let factor = (0.9 * error.powf(-0.2)).clamp(0.2, 5.0);
            if error <= 1.0 {
                t = if last { duration } else { t + h };
                x.copy_from_slice(&self.stage);
                if most.is_some() {
                    self.count_limited(h);
                }
                self.k.swap(0, STAGES - 1);
                step = if last { step.max(h * factor) } else { h * factor };
                if most.is_some_and(|most| self.limited >= most) {
                    break;
                }
            } else {
                step = h * if error.is_nan() { 0.2 } else { factor.min(0.9) };
            }
        }
        self.step = Some(step);
        Ok(t)
    }

    /// Whether stability limited the step just taken: the last two stages are at the same time, so
    /// that f differs by lambda times what lies between them, mostly along the fastest mode (Hairer
    /// and Wanner, *Solving Ordinary Differential Equations II*, section IV.2).
    fn count_limited(&mut self, h: f64) {
        let (mut change, mut distance) = (0.0, 0.0);
        let (sixth, seventh) = (A[STAGES - 2], A[STAGES - 1]);
        for i in 0..self.dims.nx {
            let between: f64 = seventh
                .iter()
                .enumerate()
                .map(|(j, a)| (a - sixth.get(j).unwrap_or(&0.0)) * self.k[j][i])
                .sum();
            change += (self.k[STAGES - 1][i] - self.k[STAGES - 2][i]).powi(2);
            distance += (h * between).powi(2);
        }
        if h * h * change > STABILITY * STABILITY * distance && distance > 0.0 {
            self.limited += 1;
        } else {
            self.limited = self.limited.saturating_sub(1);
        }
    }

    /// What is wrong where a step of size `h` from `x` is not finite: the plant is asked at the
    /// stages, up to the first at which it knows.
    fn not_finite(&mut self, x: &[f64], u: &[f64], h: f64, t: f64) -> OdeError {
        for (s, row) in A.iter().enumerate() {
            for (i, stage) in self.stage.iter_mut().enumerate() {
                let slope: f64 = row.iter().zip(&self.k).map(|(a, k)| a * k[i]).sum();
                *stage = x[i] + h * slope;
            }
            if let Some(reason) = self.plant.explain(&self.stage, u, &self.p) {
                return OdeError::Undefined { t, state: x.to_vec(), reason };
            }
            self.plant.rhs(&self.stage, u, &self.p, &mut self.k[s]);
        }
        OdeError::NotFinite { t, state: x.to_vec() }
    }

    /// Computes a step of size `h` from `x` into `self.stage`, the derivative there into the last
    /// stage (its first stage is there already), and returns the error in units of the tolerance.
    fn attempt(&mut self, x: &[f64], u: &[f64], h: f64) -> f64 {
        for (s, row) in A.iter().enumerate().skip(1) {
            let (known, rest) = self.k.split_at_mut(s);
            for (i, stage) in self.stage.iter_mut().enumerate() {
                let slope: f64 = row.iter().zip(known.iter()).map(|(a, k)| a * k[i]).sum();
                *stage = x[i] + h * slope;
            }
            self.plant.rhs(&self.stage, u, &self.p, &mut rest[0]);
        }
        self.rhs_calls += STAGES as u64 - 1;
        let mut worst = 0.0;
        for (i, (&old, &new)) in x.iter().zip(&self.stage).take(self.controlled).enumerate() {
            let slope: f64 = ERROR.iter().zip(&self.k).map(|(e, k)| e * k[i]).sum();
            let scale = self.tolerance * (1.0 + old.abs().max(new.abs()));
            let error = (h * slope).abs() / scale;
            // f64::max would drop a NaN; an infinite state would make the scale infinite as well.
            if error.is_nan() || !new.is_finite() {
                return f64::NAN;
            }
            worst = f64::max(worst, error);
        }
        worst
    }
}
