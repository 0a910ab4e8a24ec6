//! Self-scaled Broyden updates of the full inverse Hessian.

use super::inverse_hessian::InverseHessian;
use super::{
    GRADIENT_TOLERANCE, Iterate, LineSearch, Objective, Outcome, Scratch, check_gradient_tolerance,
    dot, norm, set,
};
use crate::error::check_positive;
use crate::mlp::to_f64;
use crate::{NetError, Workers};
use serde::{Deserialize, Serialize};

/// Settings of the self-scaled Broyden method (SSBroyden2): Al-Baali and Khalfan, "A wide interval
/// for efficient self-scaling quasi-Newton algorithms", Optim. Methods Softw. 20 (2005); Urban,
/// Stefanou and Pons, "Unveiling the optimization process of physics informed neural networks", J.
/// Comput. Phys. 523 (2025) 113656, Eqs. 13-23.
///
/// It keeps the whole inverse Hessian: 4 P^2 bytes for P parameters (8 MB for 1402), and a pass
/// over them in each iteration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SelfScaledBroydenConfig {
    /// Length of the first step.
    pub initial_step: f64,
    /// Norm of the gradient below which the optimizer stops.
    pub gradient_tolerance: f64,
}

impl Default for SelfScaledBroydenConfig {
    fn default() -> Self {
        Self { initial_step: 0.1, gradient_tolerance: GRADIENT_TOLERANCE }
    }
}

impl SelfScaledBroydenConfig {
    pub(super) fn validate(&self) -> Result<(), NetError> {
        check_positive("initial_step", self.initial_step)?;
        check_gradient_tolerance(self.gradient_tolerance)
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct SelfScaledBroyden {
    config: SelfScaledBroydenConfig,
    /// The inverse Hessian H; empty before the first step.
    inverse_hessian: InverseHessian,
    /// H g at the current iterate.
    newton: Vec<f64>,
    #[serde(skip)]
    buffers: Scratch<Buffers>,
}

/// Memory of a step.
#[derive(Debug, Default)]
struct Buffers {
    next: Iterate,
    direction: Vec<f64>,
    /// H g at the next iterate.
    newton: Vec<f64>,
    /// The change of the gradient.
    y: Vec<f64>,
}

impl SelfScaledBroyden {
    pub(super) fn new(config: &SelfScaledBroydenConfig) -> Self {
        Self {
            config: config.clone(),
            inverse_hessian: InverseHessian::default(),
            newton: Vec::new(),
            buffers: Scratch::default(),
        }
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
        let mut fresh = self.inverse_hessian.is_empty();
        if fresh {
            self.start(&at.gradient, norm);
        }
        self.buffers.0.next.resize(at.x.len());
        loop {
            let Buffers { next, direction, .. } = &mut self.buffers.0;
            set(direction, self.newton.iter().map(|v| -v));
            let found = LineSearch::WeakWolfe.search(objective, at, direction, 1.0, next);
            if let Some(step) = found {
                std::mem::swap(at, next);
                self.update(at, step, workers);
                return Outcome::Moved;
            }
            if fresh {
                return Outcome::Stuck;
            }
            self.start(&at.gradient, norm);
            fresh = true;
        }
    }

    /// To be called when the objective has changed: `gradient` is the new one at the same point.
    /// The inverse Hessian is kept.
    pub(super) fn refresh(&mut self, gradient: &[f64], workers: &Workers) {
        if !self.inverse_hessian.is_empty() {
            self.inverse_hessian.product(gradient, &mut self.newton, workers);
        }
    }

    /// H = (initial step / |g|) I.
    fn start(&mut self, gradient: &[f64], norm: f64) {
        let diagonal = self.config.initial_step / norm;
        self.inverse_hessian = InverseHessian::identity(gradient.len(), diagonal);
        self.newton = gradient.iter().map(|g| diagonal * g).collect();
    }

    /// The update from the step s = `step` * direction to `to`, in the notation of the references.
    /// The point before it is in the buffer of the next point.
    ///
    /// ```text
    /// b = s'B s/s'y,  h = y'H y/s'y,  k = h b - 1,  c = sqrt(k/(1 + k)),  r = min(1, h (1 - c))
    /// theta = max((r - 1)/k, min(1/r, (1 - b)/b)),  sigma = 1 + k theta,  phi = (1 - theta)/sigma
    /// v = sqrt(y'H y) (s/s'y - H y/y'H y)
    /// H <- (H - H y y'H/y'H y + phi v v')/tau + s s'/s'y
    /// ```
    fn update(&mut self, to: &Iterate, step: f64, workers: &Workers) {
        let Buffers { next: from, direction, newton, y } = &mut self.buffers.0;
        self.inverse_hessian.product(&to.gradient, newton, workers);
        let mut update = self.inverse_hessian.new_update();
        set(&mut update.hy, newton.iter().zip(&self.newton).map(|(new, old)| new - old));
        set(&mut update.s, direction.iter().map(|d| step * d));
        set(y, to.gradient.iter().zip(&from.gradient).map(|(a, b)| a - b));
        std::mem::swap(&mut self.newton, newton);
        let (sy, yhy) = (dot(&update.s, y), dot(y, &update.hy));
        // Below this, s'y is rounding.
        let least = f64::EPSILON * norm(&update.s) * norm(y);
        if !(sy > least && yhy > 0.0 && yhy.is_finite()) {
            return;
        }
        let b = -step * dot(&update.s, &from.gradient) / sy;
        let h = yhy / sy;
        let (tau, phi) = scaling(b, h, to_f64(y.len()));
        update.scale = 1.0 / tau;
        update.hh = (phi - 1.0) / (yhy * tau);
        update.hs = -phi / (sy * tau);
        update.ss = phi * yhy / (sy * sy * tau) + 1.0 / sy;
        self.newton.iter_mut().for_each(|hg| *hg *= update.scale);
        update.add_product(&to.gradient, &mut self.newton);
        self.inverse_hessian.update(update);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A function that is far from quadratic, in four variables.
    struct Bent;

    impl Objective for Bent {
        fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
            let terms = x.iter().zip(gradient).zip([1.0, 4.0, 0.3, 20.0]);
            terms
                .map(|((x, g), weight)| {
                    *g = weight * (4.0 * x * x * x + x);
                    weight * (x.powi(4) + 0.5 * x * x)
                })
                .sum()
        }
    }

    /// The first step has its length, and after each step s from which the gradient changes by y,
    /// H y = s.
    #[test]
    fn the_inverse_hessian_meets_the_secant_condition() {
        let workers = Workers::new(1).unwrap();
        let config = SelfScaledBroydenConfig { initial_step: 0.125, gradient_tolerance: 1e-9 };
        let mut method = SelfScaledBroyden::new(&config);
        let mut at = Iterate::new(&mut Bent, vec![1.0, -2.0, 1.5, 0.5]);
        for step in 0..15 {
            let from = at.clone();
            assert_eq!(method.step(&mut Bent, &mut at, &workers), Outcome::Moved);
            let change = |to: &[f64], from: &[f64]| -> Vec<f64> {
                to.iter().zip(from).map(|(to, from)| to - from).collect()
            };
            let (s, y) = (change(&at.x, &from.x), change(&at.gradient, &from.gradient));
            if step == 0 {
                assert!((norm(&s) - 0.125).abs() < 1e-15, "{}", norm(&s));
            }
            let [mut hy, mut hg] = [Vec::new(), Vec::new()];
            method.inverse_hessian.product(&y, &mut hy, &workers);
            method.inverse_hessian.product(&at.gradient, &mut hg, &workers);
            for (found, expected) in [(&hy, &s), (&hg, &method.newton)] {
                assert!(norm(&change(found, expected)) < 1e-9 * norm(expected), "step {step}");
            }
        }
    }

    /// The formulas of the references, worked out by hand.
    #[test]
    fn scaling_follows_the_formulas() {
        let half_root = 0.5_f64.sqrt();
        let nine_tenths = 0.8_f64.sqrt();
        let r = 0.5 * (1.0 - nine_tenths);
        for (b, h, variables, tau, phi) in [
            // k = 1, c = 1/sqrt 2, r = 1, theta = 1 (both bounds), sigma = 2.
            (0.5, 4.0, 3.0, half_root, 0.0),
            // theta = 1/r = 1 where (1 - b)/b = 9, sigma = 2.
            (0.1, 20.0, 5.0, 0.5_f64.powf(0.25), 0.0),
            // One variable counts as two.
            (0.5, 4.0, 1.0, 0.5, 0.0),
            // k = 1, r = 0.94, theta = (1 - b)/b = 3/5, sigma = 8/5.
            (0.625, 3.2, 3.0, 0.625_f64.sqrt(), 0.25),
            // theta = (1 - b)/b = -1/2, sigma = 1/2, which is below tau1 / sqrt sigma.
            (2.0, 1.0, 3.0, 0.5, 3.0),
            // With many variables tau1 = 1/2 times nearly 1, still above sigma.
            (2.0, 1.0, 1e9, 0.5, 3.0),
            // k = 4, theta = (r - 1)/k, sigma = r, where (1 - b)/b = -9/10.
            (10.0, 0.5, 3.0, r, (1.25 - 0.25 * r) / r),
            // k = 1/8, r = 3/4 of 2/3, theta = -1/3: sigma = 23/24 is above tau1.
            (1.5, 0.75, 1e9, 2.0 / 3.0, (4.0 / 3.0) / (23.0 / 24.0)),
        ] {
            let found = scaling(b, h, variables);
            assert!((found.0 - tau).abs() < 1e-8 * tau, "{b} {h}: {} {tau}", found.0);
            assert!((found.1 - phi).abs() < 1e-12 * phi.max(1.0), "{b} {h}: {} {phi}", found.1);
        }
    }
}
