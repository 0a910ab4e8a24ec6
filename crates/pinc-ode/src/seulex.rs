//! An accurate integrator for stiff plants: the linearly implicit Euler method, extrapolated.

use crate::banded::Banded;
use crate::{Dims, DynRhs, OdeError};
use std::sync::Arc;

/// Rows of the extrapolation table at most. With more of them rounding would show at a tolerance of
/// 1e-12: the weights of the last row are in the hundreds.
const MAX_ROWS: usize = 8;

/// Steps tried in one call before the integrator gives up.
const MAX_STEPS: u32 = 100_000;

/// Parts of a step in row j.
const PARTS: [u32; MAX_ROWS] = [2, 3, 4, 5, 6, 7, 8, 9];

/// The row that is aimed at first.
const FIRST_ROW: usize = 4;

/// Steps after which one more row is tried.
const STEADY: usize = 5;

/// The extrapolated linearly implicit Euler method with automatic order and step size.
///
/// ```text
/// (I / h - J) (y_(i+1) - y_i) = f(y_i, u, p),    J = df/dx at the start of the step
/// ```
///
/// is done over a step in 2, 3, 4, .. parts, and the results are extrapolated to parts of length 0:
/// order j with j rows. The estimated local error of component i is kept below
/// `tolerance * (1 + |x_i|)`, as [`Dopri5`](crate::Dopri5) does. References: P. Deuflhard, "Recent
/// progress in extrapolation methods for ordinary differential equations", SIAM Review 27 (1985);
/// Hairer and Wanner, *Solving Ordinary Differential Equations II*, section IV.9 (the code SEULEX).
///
/// A step takes one Jacobian, a factorization per row, and as many evaluations of f as all rows
/// have parts. Factorizations are banded, as wide as the Jacobian's.
#[derive(Clone, Debug)]
pub(crate) struct Seulex {
    plant: Arc<dyn DynRhs>,
    dims: Dims,
    tolerance: f64,
    step: Option<f64>,
    row: usize,
    /// Steps since one more row was tried.
    steady: usize,
    jacobian: Vec<f64>,
    band: Banded,
    /// The table's last row: changes of the state over the step.
    table: Vec<Vec<f64>>,
    change: Vec<f64>,
    y: Vec<f64>,
    slope: Vec<f64>,
    /// f at the start of the step, with which all rows begin.
    first: Vec<f64>,
    /// Whether the step tried last was given up because a number in it was not finite.
    broken: bool,
}

/// How a row ended: its error in units of the tolerance, the step that this suggests, what a step
/// costs with it, and what that is per time.
#[derive(Clone, Copy, Debug)]
struct Row {
    error: f64,
    step: f64,
    evaluations: f64,
    work: f64,
}

impl Seulex {
    pub(crate) fn new(plant: Arc<dyn DynRhs>, tolerance: f64) -> Self {
        let dims = plant.dims();
        let state = vec![0.0; dims.nx];
        Self {
            plant,
            dims,
            tolerance,
            step: None,
            row: FIRST_ROW,
            steady: 0,
            jacobian: Vec::new(),
            band: Banded::default(),
            table: vec![state.clone(); MAX_ROWS],
            change: state.clone(),
            y: state.clone(),
            slope: state.clone(),
            first: state,
            broken: false,
        }
    }

    /// Advances `x` from `from` to `duration`, in s of an interval with constant `u` and `p`.
    ///
    /// # Errors
    ///
    /// As [`Dopri5::integrate`](crate::Dopri5::integrate).
    pub(crate) fn integrate(
        &mut self,
        x: &mut [f64],
        (u, p): (&[f64], &[f64]),
        from: f64,
        duration: f64,
    ) -> Result<(), OdeError> {
        let mut t = from;
        let mut step = self.step.unwrap_or((duration - from) / 16.0);
        let mut known = false;
        self.plant.rhs(x, u, p, &mut self.first);
        for _ in 0..MAX_STEPS {
            let remaining = duration - t;
            if remaining <= 0.0 {
                self.step = Some(step);
                return Ok(());
            }
            let last = step * (1.0 + 1e-6) >= remaining;
            let h = if last { remaining } else { step };
            if t + h <= t {
                return Err(OdeError::StepTooSmall { t, step: h });
            }
            if !known {
                self.jacobian = self.plant.jacobian(x, u, p);
                self.band.set_pattern(&self.jacobian, self.dims.nx);
                known = true;
            }
            let (accepted, next) = self.attempt(x, (u, p), h);
            if accepted {
                t = if last { duration } else { t + h };
                x.iter_mut().zip(&self.change).for_each(|(x, change)| *x += change);
                step = if last { step.max(next) } else { next };
                known = false;
            } else if h < 1e-12 * duration && self.broken {
                return Err(self.not_finite(x, (u, p), t));
            } else {
                step = next;
            }
        }
        Err(OdeError::StepTooSmall { t, step })
    }

    fn not_finite(&self, x: &[f64], (u, p): (&[f64], &[f64]), t: f64) -> OdeError {
        let known = self.plant.explain(&self.y, u, p).or_else(|| self.plant.explain(x, u, p));
        match known {
            Some(reason) => OdeError::Undefined { t, state: x.to_vec(), reason },
            None => OdeError::NotFinite { t, state: x.to_vec() },
        }
    }

    /// Tries a step of size `h` from `x`. If its error is below the tolerance, the change of the
    /// state is in `self.change`, and f there in `self.first`. The size of the next step is
    /// returned in any case.
    fn attempt(&mut self, x: &[f64], at: (&[f64], &[f64]), h: f64) -> (bool, f64) {
        let mut rows: Vec<Row> = Vec::new();
        let last = (self.row + 1).min(MAX_ROWS - 1);
        self.broken = false;
        for j in 0..=last {
            let done = self.add_row(x, at, h, j);
            let error = if done { self.error(x, j) } else { f64::NAN };
            if !error.is_finite() {
                // The table is of no use: a much shorter step.
                self.broken = true;
                return (false, 0.1 * h);
            }
            rows.push(self.judge(error, h, j));
            let grows = j > 1 && error > 1.0 && error > rows[j - 1].error;
            if j > 0 && j + 1 >= self.row && error <= 1.0 {
                self.broken = !self.arrive(x, at);
                return if self.broken { (false, 0.1 * h) } else { (true, self.aim(&rows)) };
            }
            if grows {
                break;
            }
        }
        let next = self.aim(&rows);
        (false, next.min(0.5 * h))
    }

    /// Evaluates f at the end of a step. Says whether it is finite there.
    fn arrive(&mut self, x: &[f64], (u, p): (&[f64], &[f64])) -> bool {
        self.change.copy_from_slice(&self.table[0]);
        self.y.iter_mut().zip(x).zip(&self.change).for_each(|((y, x), change)| *y = x + change);
        self.plant.rhs(&self.y, u, p, &mut self.slope);
        let finite = self.slope.iter().all(|slope| slope.is_finite());
        if finite {
            std::mem::swap(&mut self.slope, &mut self.first);
        }
        finite
    }

    /// Row `j` of the table: `self.table[j - k]` becomes its entry k. Says whether all is finite.
    fn add_row(&mut self, x: &[f64], (u, p): (&[f64], &[f64]), h: f64, j: usize) -> bool {
        let parts = PARTS[j];
        let part = h / f64::from(parts);
        if !self.band.factorize(&self.jacobian, 1.0 / part) {
            return false;
        }
        self.change.fill(0.0);
        self.y.copy_from_slice(x);
        for i in 0..parts {
            match i {
                0 => self.slope.copy_from_slice(&self.first),
                _ => self.plant.rhs(&self.y, u, p, &mut self.slope),
            }
            self.band.solve(&mut self.slope);
            for (i, slope) in self.slope.iter().enumerate() {
                self.change[i] += slope;
                self.y[i] = x[i] + self.change[i];
            }
            if !self.y.iter().all(|y| y.is_finite()) {
                return false;
            }
        }
        // Aitken and Neville, from the entries of the row before, which are replaced.
        self.table[j].copy_from_slice(&self.change);
        for k in (0..j).rev() {
            let ratio = f64::from(parts) / f64::from(PARTS[k]);
            let (before, after) = self.table.split_at_mut(k + 1);
            for (old, new) in before[k].iter_mut().zip(&after[0]) {
                *old = new + (new - *old) / (ratio - 1.0);
            }
        }
        true
    }

    /// The last entry of row `j` against the one before, in units of the tolerance.
    fn error(&self, x: &[f64], j: usize) -> f64 {
        let mut worst = 0.0;
        let Some(lower) = self.table.get(1).filter(|_| j > 0) else { return 1e10 };
        for ((x, change), lower) in x.iter().zip(&self.table[0]).zip(lower) {
            let scale = self.tolerance * (1.0 + x.abs().max((x + change).abs()));
            let error = (change - lower).abs() / scale;
            if error.is_nan() {
                return f64::NAN;
            }
            worst = f64::max(worst, error);
        }
        worst
    }

    /// The step at which row `j` would just do, and its work per time there.
    fn judge(&self, error: f64, h: f64, j: usize) -> Row {
        let order = f64::from(PARTS[j] - 1);
        let factor = (0.9 * (0.5 / error.max(1e-30)).powf(1.0 / order)).clamp(0.1, 4.0);
        let evaluations = self.evaluations(j);
        Row { error, step: factor * h, evaluations, work: evaluations / (factor * h) }
    }

    /// The evaluations of f that a step with rows up to `j` costs, or what takes as long.
    fn evaluations(&self, j: usize) -> f64 {
        let evaluations: u32 = PARTS[..=j].iter().map(|parts| parts - 1).sum();
        // A Jacobian takes about as many evaluations as there are states.
        let jacobian = self.dims.nx as f64;
        f64::from(evaluations) + jacobian + self.band.cost() * f64::from(PARTS[j] - 1)
    }

    /// Chooses the row to aim at next, and returns the step that goes with it.
    fn aim(&mut self, rows: &[Row]) -> f64 {
        let reached = rows.len() - 1;
        let from = self.row.saturating_sub(1).clamp(1, reached.max(1)).min(reached);
        let cheapest = (from..=reached).min_by(|&a, &b| rows[a].work.total_cmp(&rows[b].work));
        let best = cheapest.unwrap_or(reached);
        let Row { error, step, evaluations, .. } = rows[best];
        self.row = best.clamp(2, MAX_ROWS - 2);
        // Work still falls from row to row: one more may be cheaper, with a step as much longer as
        // it takes more evaluations. Now and then that is tried in any case.
        let falls = best > 0 && rows[best].work < 0.9 * rows[best - 1].work;
        self.steady += 1;
        if best == reached && error <= 1.0 && (falls || self.steady > STEADY) && best + 2 < MAX_ROWS
        {
            self.steady = 0;
            self.row = best + 1;
            return step * self.evaluations(best + 1) / evaluations;
        }
        step
    }
}
