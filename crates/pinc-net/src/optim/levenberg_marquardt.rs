//! Levenberg-Marquardt.

use super::{
    GRADIENT_TOLERANCE, Iterate, LeastSquares, Outcome, Scratch, check_gradient_tolerance,
};
use crate::NetError;
use crate::error::check_positive;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::{factor, solve};
use faer::{Mat, MatRef, Par, Spec};
use serde::{Deserialize, Serialize};

/// Settings of the Levenberg-Marquardt method with Nielsen's damping: Madsen, Nielsen and Tingleff,
/// "Methods for non-linear least squares problems", 2nd ed. (2004), Algorithm 3.16.
///
/// Each iteration solves (J'J + mu I) d = -J'r for the step d, with J the Jacobian of the residuals
/// r, by a Cholesky factorization. For P parameters it keeps two P x P matrices (16 P^2 bytes),
/// computes J'J once per iteration, and spends P^3/6 multiply-adds on one core per trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LevenbergMarquardtConfig {
    /// First damping mu, relative to the largest entry on the diagonal of J'J.
    pub initial_damping: f64,
    /// Norm of the gradient below which the optimizer stops.
    pub gradient_tolerance: f64,
}

impl Default for LevenbergMarquardtConfig {
    /// The reference's damping for a start that is not close to the solution.
    fn default() -> Self {
        Self { initial_damping: 1e-3, gradient_tolerance: GRADIENT_TOLERANCE }
    }
}

/// The largest damping, relative to the largest entry on the diagonal of J'J: with more, a step has
/// no length, because it is at most |r| / sqrt(mu).
const MAX_DAMPING: f64 = 1e30;

/// The smallest damping, relative to the same: with less, rounding decides whether J'J + mu I is
/// positive definite.
const MIN_DAMPING: f64 = f64::EPSILON;

impl LevenbergMarquardtConfig {
    pub(super) fn validate(&self) -> Result<(), NetError> {
        check_positive("initial_damping", self.initial_damping)?;
        check_gradient_tolerance(self.gradient_tolerance)
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LevenbergMarquardt {
    config: LevenbergMarquardtConfig,
    /// Damping mu, once there is one.
    damping: Option<f64>,
    /// The factor nu by which it grows when a trial fails.
    growth: f64,
    #[serde(skip)]
    buffers: Scratch<Buffers>,
}

/// The factor by which damping grows after the first of a row of failures.
const FIRST_GROWTH: f64 = 2.0;

impl LevenbergMarquardt {
    pub(super) fn new(config: &LevenbergMarquardtConfig) -> Self {
        let (config, buffers) = (config.clone(), Scratch::default());
        Self { config, damping: None, growth: FIRST_GROWTH, buffers }
    }

    pub(super) fn step(&mut self, objective: &mut impl LeastSquares, at: &mut Iterate) -> Outcome {
        if at.gradient_norm() <= self.config.gradient_tolerance {
            return Outcome::Converged;
        }
        let Self { config, damping, growth, buffers: Scratch(buffers) } = self;
        buffers.resize(at.x.len());
        objective.normal_matrix(&at.x, &mut buffers.normal);
        let largest = buffers.largest_diagonal();
        let mut mu = damping.unwrap_or(config.initial_damping * largest);
        mu = mu.max(MIN_DAMPING * largest);
        while mu > 0.0 && mu.is_finite() && mu <= MAX_DAMPING * largest {
            if let Some(gain) = buffers.trial(objective, at, mu) {
                std::mem::swap(at, &mut buffers.next);
                *damping = Some(mu * (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0));
                *growth = FIRST_GROWTH;
                return Outcome::Moved;
            }
            mu *= *growth;
            *growth *= 2.0;
        }
        // The next attempt, on another function perhaps, starts afresh.
        (*damping, *growth) = (None, FIRST_GROWTH);
        Outcome::Stuck
    }
}

/// Memory of a step.
struct Buffers {
    /// The lower triangle of J'J, column by column.
    normal: Vec<f64>,
    /// J'J + mu I, then its Cholesky factor.
    factor: Mat<f64>,
    /// The right-hand side, then the step.
    step: Mat<f64>,
    buffer: MemBuffer,
    next: Iterate,
}

impl Default for Buffers {
    fn default() -> Self {
        let buffer = MemBuffer::new(StackReq::EMPTY);
        let (factor, step) = (Mat::new(), Mat::new());
        Self { normal: Vec::new(), factor, step, buffer, next: Iterate::default() }
    }
}

impl Buffers {
    fn resize(&mut self, variables: usize) {
        if self.factor.nrows() == variables {
            return;
        }
        self.normal = vec![0.0; variables * variables];
        self.factor = Mat::zeros(variables, variables);
        self.step = Mat::zeros(variables, 1);
        let memory = factor::cholesky_in_place_scratch::<f64>(variables, Par::Seq, Spec::default());
        self.buffer = MemBuffer::new(memory);
        self.next.resize(variables);
    }

    fn largest_diagonal(&self) -> f64 {
        let variables = self.factor.nrows();
        self.normal.iter().step_by(variables + 1).copied().fold(0.0, f64::max)
    }

    /// Tries the step for the damping `mu`, with one evaluation. If the function falls, the new
    /// point is in `next`, and the result is the decrease relative to the linear model's.
    fn trial(&mut self, objective: &mut impl LeastSquares, at: &Iterate, mu: f64) -> Option<f64> {
        self.solve(&at.gradient, mu)?;
        let step = self.step.col(0);
        // The model falls by -2 d'J'r - d'J'J d, which is d'(mu d - J'r) for this d.
        let mut model = 0.0;
        for (i, next) in self.next.x.iter_mut().enumerate() {
            *next = at.x[i] + step[i];
            model += step[i] * (mu * step[i] - 0.5 * at.gradient[i]);
        }
        self.next.reevaluate(objective);
        let falls = self.next.is_finite() && self.next.value < at.value && model > 0.0;
        falls.then(|| (at.value - self.next.value) / model)
    }

    /// `step` = -(J'J + mu I)^-1 J'r; nothing if the matrix is not positive definite.
    fn solve(&mut self, gradient: &[f64], mu: f64) -> Option<()> {
        let variables = gradient.len();
        let normal = MatRef::from_column_major_slice(&self.normal, variables, variables);
        for (j, derivative) in gradient.iter().enumerate() {
            let from = normal.col(j).subrows(j, variables - j);
            let mut to = self.factor.col_mut(j).subrows_mut(j, variables - j);
            to.copy_from(from);
            to[0] += mu;
            self.step[(j, 0)] = -0.5 * derivative;
        }
        let stack = MemStack::new(&mut self.buffer);
        let regularization = factor::LltRegularization::default();
        let matrix = self.factor.as_mut();
        factor::cholesky_in_place(matrix, regularization, Par::Seq, stack, Spec::default()).ok()?;
        let stack = MemStack::new(&mut self.buffer);
        solve::solve_in_place(self.factor.as_ref(), self.step.as_mut(), Par::Seq, stack);
        Some(())
    }
}
