//! Self-scaled Broyden updates of the full inverse Hessian.

use super::lbfgs::default_gradient_tolerance;
use super::{Iterate, LineSearch, Objective, Outcome, check, dot};
use crate::mlp::to_f64;
use crate::simd::{Simd, Task};
use crate::{NetError, Workers};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Settings of the self-scaled Broyden method (SSBroyden2): Al-Baali and Khalfan, "A wide interval for
/// efficient self-scaling quasi-Newton algorithms", Optim. Methods Softw. 20 (2005); Urban, Stefanou and
/// Pons, "Unveiling the optimization process of physics informed neural networks", J. Comput. Phys. 523
/// (2025) 113656, Eqs. 13-23.
///
/// It keeps the whole inverse Hessian: 8 P^2 bytes for P parameters (16 MB for 1402), and a pass over
/// them in each iteration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelfScaledBroydenConfig {
    /// Length of the first step.
    #[serde(default = "default_initial_step")]
    pub initial_step: f64,
    /// Stop when the norm of the gradient falls below this.
    #[serde(default = "default_gradient_tolerance")]
    pub gradient_tolerance: f64,
}

fn default_initial_step() -> f64 {
    0.1
}

impl SelfScaledBroydenConfig {
    pub(super) fn validate(&self) -> Result<(), NetError> {
        let positive = |v: f64| v > 0.0 && v.is_finite();
        check("initial_step", self.initial_step, positive, "a positive number")?;
        let tolerance = self.gradient_tolerance;
        check("gradient_tolerance", tolerance, |v| v >= 0.0, "a number that is not negative")
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SelfScaledBroyden {
    config: SelfScaledBroydenConfig,
    /// The inverse Hessian H without the pending update, row by row; empty before the first step.
    inverse_hessian: Vec<f64>,
    pending: Option<Update>,
    /// H g at the current iterate, the update included.
    newton: Vec<f64>,
}

/// H <- scale H + hh Hy Hy' + hs (Hy s' + s Hy') + ss s s'. It is applied when H is next read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Update {
    s: Vec<f64>,
    hy: Vec<f64>,
    scale: f64,
    hh: f64,
    hs: f64,
    ss: f64,
}

impl SelfScaledBroyden {
    pub(super) fn new(config: &SelfScaledBroydenConfig) -> Self {
        let config = config.clone();
        Self { config, inverse_hessian: Vec::new(), pending: None, newton: Vec::new() }
    }

    pub(super) fn step(
        &mut self,
        objective: &mut impl Objective,
        at: &mut Iterate,
        workers: &Workers,
    ) -> Outcome {
        let norm = at.gradient_norm();
        if norm <= self.config.gradient_tolerance {
            return Outcome::Converged;
        }
        let mut fresh = self.newton.is_empty();
        if fresh {
            self.start(&at.gradient, norm);
        }
        let mut next = at.clone();
        loop {
            let direction: Vec<f64> = self.newton.iter().map(|v| -v).collect();
            let found = LineSearch::WeakWolfe.search(objective, at, &direction, 1.0, &mut next);
            if let Some(step) = found {
                self.learn(at, &next, &direction, step, workers);
                std::mem::swap(at, &mut next);
                return Outcome::Moved;
            }
            if fresh {
                return Outcome::Stuck;
            }
            self.start(&at.gradient, norm);
            fresh = true;
        }
    }

    /// Tells that the objective has changed: `gradient` is the new one at the same point. What has been
    /// learnt of the curvature is kept.
    pub(super) fn refresh(&mut self, gradient: &[f64], workers: &Workers) {
        if !self.newton.is_empty() {
            self.newton = self.product(gradient, workers);
        }
    }

    /// H = (initial step / |g|) I.
    fn start(&mut self, gradient: &[f64], norm: f64) {
        let n = gradient.len();
        let diagonal = self.config.initial_step / norm;
        self.inverse_hessian.clear();
        self.inverse_hessian.resize(n * n, 0.0);
        self.inverse_hessian.iter_mut().step_by(n + 1).for_each(|h| *h = diagonal);
        self.pending = None;
        self.newton = gradient.iter().map(|g| diagonal * g).collect();
    }

    /// The update from the step s = `step` * `direction`, in the notation of the references:
    ///
    /// ```text
    /// b = s'B s/s'y,  h = y'H y/s'y,  k = h b - 1,  c = sqrt(k/(1 + k)),  r = min(1, h (1 - c))
    /// theta = max((r - 1)/k, min(1/r, (1 - b)/b)),  sigma = 1 + k theta,  phi = (1 - theta)/sigma
    /// v = sqrt(y'H y) (s/s'y - H y/y'H y)
    /// H <- (H - H y y'H/y'H y + phi v v')/tau + s s'/s'y
    /// ```
    fn learn(
        &mut self,
        from: &Iterate,
        to: &Iterate,
        direction: &[f64],
        step: f64,
        workers: &Workers,
    ) {
        let hg = self.product(&to.gradient, workers);
        let hy: Vec<f64> = hg.iter().zip(&self.newton).map(|(new, old)| new - old).collect();
        let s: Vec<f64> = direction.iter().map(|d| step * d).collect();
        let y: Vec<f64> = to.gradient.iter().zip(&from.gradient).map(|(a, b)| a - b).collect();
        let (sy, yhy) = (dot(&s, &y), dot(&y, &hy));
        if !(sy > 0.0 && yhy > 0.0 && yhy.is_finite()) {
            self.newton = hg;
            return;
        }
        let b = -step * dot(&s, &from.gradient) / sy;
        let h = yhy / sy;
        let (tau, phi) = scaling(b, h, to_f64(s.len()));
        let update = Update {
            scale: 1.0 / tau,
            hh: (phi - 1.0) / (yhy * tau),
            hs: -phi / (sy * tau),
            ss: phi * yhy / (sy * sy * tau) + 1.0 / sy,
            s,
            hy,
        };
        self.newton = update.apply_to_vector(&hg, &to.gradient);
        self.pending = Some(update);
    }

    /// H g, applying the pending update on the way: one pass over H.
    fn product(&mut self, gradient: &[f64], workers: &Workers) -> Vec<f64> {
        let n = gradient.len();
        let mut result = vec![0.0; n];
        let update = self.pending.take();
        // Rows are independent, so the split over threads does not touch the result.
        let rows = n.div_ceil(4 * workers.pool.current_num_threads()).max(1);
        let matrix = &mut self.inverse_hessian;
        workers.pool.install(|| {
            let parts = matrix.par_chunks_mut(rows * n).zip(result.par_chunks_mut(rows));
            parts.enumerate().for_each(|(i, (matrix, result))| {
                let first = i * rows;
                let task = Rows { matrix, result, first, gradient, update: update.as_ref() };
                workers.isa.dispatch(task);
            });
        });
        result
    }
}

/// The scaling tau and the parameter phi of the Broyden family.
fn scaling(b: f64, h: f64, variables: f64) -> (f64, f64) {
    // k >= 0 by the inequality of Cauchy and Schwarz; rounding may say otherwise.
    let k = (h * b - 1.0).max(f64::EPSILON);
    let c = (k / (1.0 + k)).sqrt();
    let r = (h * (1.0 - c)).min(1.0);
    let theta = ((r - 1.0) / k).max((1.0 / r).min((1.0 - b) / b));
    let sigma = 1.0 + k * theta;
    let root = sigma.abs().powf(-1.0 / (variables - 1.0).max(1.0));
    let tau1 = (1.0 / b).min(1.0);
    let tau = if theta > 0.0 { tau1 * root.min(1.0 / theta) } else { (tau1 * root).min(sigma) };
    (tau, (1.0 - theta) / sigma)
}

impl Update {
    /// (updated H) g, from `hg` = H g.
    fn apply_to_vector(&self, hg: &[f64], gradient: &[f64]) -> Vec<f64> {
        let (hy_g, s_g) = (dot(&self.hy, gradient), dot(&self.s, gradient));
        let along_hy = self.hh * hy_g + self.hs * s_g;
        let along_s = self.hs * hy_g + self.ss * s_g;
        let vectors = self.hy.iter().zip(&self.s);
        hg.iter()
            .zip(vectors)
            .map(|(hg, (hy, s))| self.scale * hg + along_hy * hy + along_s * s)
            .collect()
    }
}

/// Updates some rows of H and multiplies them by the gradient.
struct Rows<'a> {
    matrix: &'a mut [f64],
    result: &'a mut [f64],
    first: usize,
    gradient: &'a [f64],
    update: Option<&'a Update>,
}

impl Task for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let n = self.gradient.len();
        let rows = self.matrix.chunks_exact_mut(n).zip(self.result);
        for (i, (row, result)) in rows.enumerate() {
            if let Some(update) = self.update {
                let (hy, s) = (update.hy[self.first + i], update.s[self.first + i]);
                let along_hy = update.hh * hy + update.hs * s;
                let along_s = update.hs * hy + update.ss * s;
                update_row(row, update, along_hy, along_s, zero);
            }
            *result = dot_lanes(row, self.gradient, zero);
        }
    }
}

/// row <- scale row + `along_hy` Hy + `along_s` s
#[inline(always)]
fn update_row<V: Simd>(row: &mut [f64], update: &Update, along_hy: f64, along_s: f64, zero: V) {
    let scale = zero.constant(update.scale);
    let (by_hy, by_s) = (zero.constant(along_hy), zero.constant(along_s));
    let whole = row.len() / V::LANES * V::LANES;
    for k in (0..whole).step_by(V::LANES) {
        let load = |from: &[f64]| {
            let from = &from[k..k + V::LANES];
            zero.generate(|i| from[i])
        };
        let sum = by_hy.mul_add(load(&update.hy), by_s * load(&update.s));
        scale.mul_add(load(row), sum).write(&mut row[k..k + V::LANES]);
    }
    let rest = row[whole..].iter_mut().zip(&update.hy[whole..]).zip(&update.s[whole..]);
    for ((row, hy), s) in rest {
        *row = update.scale * *row + along_hy * hy + along_s * s;
    }
}

/// a'b with four independent sums.
#[inline(always)]
fn dot_lanes<V: Simd>(a: &[f64], b: &[f64], zero: V) -> f64 {
    let mut sums = [zero; 4];
    let width = 4 * V::LANES;
    let whole = a.len() / width * width;
    for (a, b) in a.chunks_exact(width).zip(b.chunks_exact(width)) {
        for (j, sum) in sums.iter_mut().enumerate() {
            let lane = |from: &[f64]| {
                let from = &from[j * V::LANES..(j + 1) * V::LANES];
                zero.generate(|i| from[i])
            };
            *sum = lane(a).mul_add(lane(b), *sum);
        }
    }
    let [p, q, r, s] = sums;
    ((p + q) + (r + s)).sum() + dot(&a[whole..], &b[whole..])
}
