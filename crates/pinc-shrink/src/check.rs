//! The check of a net's plan by the model.

use crate::Policy;
use pinc_mpc::{Nmpc, Tracked};

/// A plan breaks its bounds if it is outside by more than this part of a bound's size.
const TOLERANCE: f64 = 1e-6;

/// The parts of the way from the shifted plan to the net's that are tried, the longest last.
const PARTS: [f64; 3] = [0.25, 0.5, 1.0];

/// A plan by the model: its cost, and by how much its states are outside their bounds at most, as a
/// part of the bounds' sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rating {
    /// The cost J.
    pub cost: f64,
    /// The largest violation.
    pub violation: f64,
}

/// A net whose plans are checked by rollouts of the model: a plan is kept if it stays within the
/// bounds and costs no more than the plan before it, shifted. Otherwise the plan half or a quarter of
/// the way from the shifted one is taken, if that does; if not, the shifted plan goes on. If that
/// breaks the bounds, a plan that breaks them less is taken.
///
/// What this guarantees: inputs stay within their bounds and rates; the plan in use costs, by the
/// model and from the state measured, no more than the shifted plan; and it leaves the bounds on
/// states, by the model, only if the shifted plan does. The model's errors, and states between
/// control steps, are not covered, and there is no guarantee that a plan within the bounds exists.
///
/// Source: Hose, Koehler, Zeilinger and Trimpe, "Approximate non-linear model predictive control
/// with safety-augmented neural networks" (2023).
#[derive(Clone, Debug)]
pub struct Checked {
    policy: Policy,
    plan: Vec<f64>,
    candidate: Vec<f64>,
    trial: Vec<f64>,
    /// Whether there is a plan.
    planned: bool,
}

impl Checked {
    /// Checks the plans of a net.
    #[must_use]
    pub fn new(policy: Policy) -> Self {
        let count = policy.outputs.middle.len();
        let zeros = || vec![0.0; count];
        Self { policy, plan: zeros(), candidate: zeros(), trial: zeros(), planned: false }
    }

    /// Forgets the plan.
    pub fn reset(&mut self) {
        self.planned = false;
    }

    /// Returns the plan in use, `[Nu, m]`.
    #[must_use]
    pub fn plan(&self) -> &[f64] {
        &self.plan
    }

    /// Plans from the state `x`; the controller gives problem and model. Before the first plan, one
    /// that holds the last input stands for the shifted one. Returns which part of the way from the
    /// shifted plan to the net's was taken: 1, 0.5, 0.25 or 0.
    pub fn decide(
        &mut self,
        nmpc: &mut Nmpc,
        x: &[f64],
        reference: &[f64],
        u_before: &[f64],
    ) -> f64 {
        let m = u_before.len();
        if self.planned {
            // The last input stays where it is, and is held.
            self.plan.copy_within(m.., 0);
        } else {
            self.plan.chunks_exact_mut(m).for_each(|input| input.copy_from_slice(u_before));
        }
        self.planned = true;
        self.policy.limits.project(u_before, &mut self.plan);
        self.policy.plan(x, reference, u_before, &mut self.candidate);
        let at = [x, reference, u_before];
        let old = rate(nmpc, at, &self.plan);
        let mut part = 0.0;
        for trial in PARTS {
            self.between(trial, u_before);
            let new = rate(nmpc, at, &self.trial);
            let better = new.violation < old.violation.max(TOLERANCE)
                && (old.violation >= TOLERANCE || new.cost <= old.cost);
            if better {
                part = trial;
            }
        }
        self.between(part, u_before);
        std::mem::swap(&mut self.plan, &mut self.trial);
        part
    }

    /// Writes to `trial` a plan between the one in use and the net's, moved into its bounds.
    fn between(&mut self, part: f64, u_before: &[f64]) {
        let ends = self.plan.iter().zip(&self.candidate);
        for (trial, (old, new)) in self.trial.iter_mut().zip(ends) {
            *trial = (1.0 - part) * old + part * new;
        }
        self.policy.limits.project(u_before, &mut self.trial);
    }
}

/// Rates a plan by a rollout of the controller's model. A rollout that is not finite breaks all
/// bounds.
pub fn rate(nmpc: &mut Nmpc, [x, reference, u_before]: [&[f64]; 3], plan: &[f64]) -> Rating {
    let problem = nmpc.problem().clone();
    let m = u_before.len();
    let mut program = nmpc.program();
    let (mut x, mut next) = (x.to_vec(), vec![0.0; x.len()]);
    let (mut cost, mut violation) = (0.0, 0.0_f64);
    for (i, input) in plan.chunks_exact(m).enumerate() {
        let before = if i == 0 { u_before } else { &plan[(i - 1) * m..i * m] };
        let r = problem.weights.r.at(i);
        let change: Vec<f64> = input.iter().zip(before).map(|(u, before)| u - before).collect();
        for (row, left) in change.iter().enumerate() {
            let products = change.iter().enumerate();
            cost += products.map(|(k, right)| left * r.entry(row, k) * right).sum::<f64>();
        }
    }
    for j in 1..=problem.horizon {
        let acting = (j - 1).min(problem.control_horizon - 1);
        let u = &plan[acting * m..(acting + 1) * m];
        program.step(j - 1, &x, u, &mut next);
        std::mem::swap(&mut x, &mut next);
        let first = (j - 1) * x.len() % problem.state_bounds.low.len();
        for (i, value) in x.iter().enumerate() {
            let (low, high) =
                (problem.state_bounds.low[first + i], problem.state_bounds.high[first + i]);
            let outside =
                if value.is_finite() { (low - value).max(value - high) } else { f64::MAX };
            violation = violation.max(outside / size(low, high));
        }
        if j < problem.n1 {
            continue;
        }
        let value = |tracked: &Tracked| match *tracked {
            Tracked::State(state) => x[state],
            Tracked::Input(input) => u[input],
            // Refused by `shrink`.
            Tracked::Output(_) => f64::NAN,
        };
        let errors: Vec<f64> =
            problem.tracked.iter().zip(reference).map(|(t, r)| value(t) - r).collect();
        let q = program.tracking_weight(j).chunks_exact(errors.len().max(1));
        for (error, row) in errors.iter().zip(q) {
            cost += 0.5 * error * row.iter().zip(&errors).map(|(q, e)| q * e).sum::<f64>();
        }
    }
    Rating { cost, violation }
}

/// The size by which violations of two bounds are measured.
pub(crate) fn size(low: f64, high: f64) -> f64 {
    match (low.is_finite(), high.is_finite()) {
        (true, true) => 0.5 * (high - low),
        (true, false) => 1.0 + low.abs(),
        (false, true) => 1.0 + high.abs(),
        (false, false) => 1.0,
    }
}
