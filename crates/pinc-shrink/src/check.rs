//! The check of a net's plan by the model.

use crate::Policy;
use pinc_mpc::{Bounds, IntervalEnd, Nmpc, Tracked};
use pinc_ode::Dims;

/// A plan breaks its bounds if it is outside by more than this part of a bound's size.
pub(crate) const TOLERANCE: f64 = 1e-6;

/// The parts of the way from the shifted plan to the net's that are tried.
const PARTS: [f64; 3] = [0.0, 0.5, 1.0];

/// A plan by the model: its cost, and by how much states and outputs are outside their bounds at most,
/// as a part of the bounds' sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rating {
    /// The cost J.
    pub cost: f64,
    /// The largest violation; those at later stages count less.
    pub violation: f64,
}

impl Rating {
    /// Less outside the bounds or, where both are within them, cheaper.
    fn is_better_than(self, other: Self) -> bool {
        let [own, others] = [self, other].map(|of| of.violation.max(TOLERANCE));
        own < others || (own <= others && self.cost < other.cost)
    }
}

/// A net whose plans are checked by rollouts of the model. Of four plans the cheapest is taken that
/// stays within the bounds, or, if none does, the one that breaks them least:
///
/// 0. the plan before, shifted, which holds its last input;
/// 1. the same with the last input of the net's plan;
/// 2. the one halfway between that and the net's;
/// 3. the net's plan.
///
/// What this guarantees: inputs stay within their bounds and rates; the plan in use costs, by the
/// model and from the state measured, no more than the shifted plan if that is within the bounds; and it leaves the bounds on
/// states and outputs, by the model, only if the shifted plan does. The model's errors, and states between
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
    /// Whether the plan is of the step before.
    has_decided: bool,
}

impl Checked {
    /// Checks the plans of a net. The `first` plan stands for the shifted one in the first decision:
    /// a plan of the controller, `[Nu, m]`, or the input applied last, `m`, which it holds.
    #[must_use]
    pub fn new(policy: Policy, first: &[f64]) -> Self {
        let count = policy.outputs.middle.len();
        let zeros = || vec![0.0; count];
        let plan = first.iter().copied().cycle().take(count).collect();
        Self { policy, plan, candidate: zeros(), trial: zeros(), has_decided: false }
    }

    /// Returns the plan in use, `[Nu, m]`.
    #[must_use]
    pub fn plan(&self) -> &[f64] {
        &self.plan
    }

    /// Plans from the state `x`; the controller gives problem and model. Returns the number of the
    /// plan that was taken.
    pub fn decide(
        &mut self,
        nmpc: &mut Nmpc,
        x: &[f64],
        reference: &[f64],
        u_before: &[f64],
    ) -> usize {
        let m = u_before.len();
        if self.has_decided {
            // The last input stays where it is, and is held.
            self.plan.copy_within(m.., 0);
        }
        self.has_decided = true;
        self.policy.limits.project(u_before, &mut self.plan);
        self.policy.plan(x, reference, u_before, &mut self.candidate);
        let (held, last) = (self.plan.clone(), self.plan.len() - m);
        self.plan[last..].copy_from_slice(&self.candidate[last..]);
        let at = [x, reference, u_before];
        let (mut best, mut taken, mut plan) = (rate(nmpc, at, &held), 0, held);
        for (k, part) in PARTS.into_iter().enumerate() {
            self.between(part, u_before);
            let new = rate(nmpc, at, &self.trial);
            if new.is_better_than(best) {
                (best, taken) = (new, k + 1);
                plan.copy_from_slice(&self.trial);
            }
        }
        self.plan = plan;
        taken
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
    let (m, dims) = (u_before.len(), nmpc.model().dims());
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
        let begin = point(nmpc, j - 1, &x, u);
        nmpc.program().step(j - 1, &x, u, &mut next);
        std::mem::swap(&mut x, &mut next);
        let end = point(nmpc, j - 1, &x, u);
        violation = violation.max(urgency(problem.horizon, j) * outside(nmpc, j, [&begin, &end]));
        if j < problem.n1 {
            continue;
        }
        let value = |tracked: &Tracked| end[place(*tracked, dims)];
        let errors: Vec<f64> =
            problem.tracked.iter().zip(reference).map(|(t, r)| value(t) - r).collect();
        let program = nmpc.program();
        let q = program.tracking_weight(j).chunks_exact(errors.len().max(1));
        for (error, row) in errors.iter().zip(q) {
            cost += 0.5 * error * row.iter().zip(&errors).map(|(q, e)| q * e).sum::<f64>();
        }
    }
    Rating { cost, violation }
}

/// How much a violation at stage `j` counts: the later, the less, since later plans may avoid it.
#[expect(clippy::cast_precision_loss, reason = "far below 2^53 stages")]
pub(crate) fn urgency(horizon: usize, j: usize) -> f64 {
    (horizon + 1 - j) as f64 / horizon as f64
}

/// State, input and outputs at an end of an interval, one behind the other; outputs only if the
/// controller uses any.
pub(crate) fn point(nmpc: &mut Nmpc, stage: usize, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut point = [x, u].concat();
    if nmpc.problem().uses_outputs() {
        let mut outputs = vec![0.0; nmpc.model().dims().ny];
        nmpc.program().outputs_at(stage, x, u, &mut outputs);
        point.extend(outputs);
    }
    point
}

/// Where a tracked quantity is in a [`point`].
pub(crate) fn place(tracked: Tracked, dims: Dims) -> usize {
    match tracked {
        Tracked::State(state) => state,
        Tracked::Input(input) => dims.nx + input,
        Tracked::Output(output) => dims.nx + dims.nu + output,
    }
}

/// A quantity with bounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// Where it is in a [`point`].
    pub(crate) place: usize,
    /// Whether it is bounded at the start of the interval, instead of its end.
    pub(crate) at_start: bool,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// The bounds of stage `j`, from 1 on, in the same order at all stages.
pub(crate) fn limits(nmpc: &mut Nmpc, j: usize) -> Vec<Limit> {
    let dims = nmpc.model().dims();
    let rows: Vec<_> = nmpc.program().output_rows().collect();
    let problem = nmpc.problem();
    let limit = |place, at_start, bounds: &Bounds, at: Option<usize>| {
        let of = |side: &[f64], none| at.map_or(none, |at| side[at % side.len()]);
        let (low, high) = (of(&bounds.low, f64::NEG_INFINITY), of(&bounds.high, f64::INFINITY));
        Limit { place, at_start, low, high }
    };
    let of_state = |i| limit(i, false, &problem.state_bounds, Some((j - 1) * dims.nx + i));
    let mut all: Vec<Limit> = (0..dims.nx).map(of_state).collect();
    if let Some(bounds) = &problem.output_bounds {
        let of_output = |(output, end): &(usize, Option<IntervalEnd>)| {
            let place = place(Tracked::Output(*output), dims);
            let at = j.checked_sub(problem.n1).map(|j| j * dims.ny + output);
            limit(place, *end == Some(IntervalEnd::Start), bounds, at)
        };
        all.extend(rows.iter().map(of_output));
    }
    all
}

/// By how much the points at both ends of the interval that leads to stage `j` are outside their
/// bounds, as a part of the bounds' sizes. What is not finite breaks all bounds.
pub(crate) fn outside(nmpc: &mut Nmpc, j: usize, [begin, end]: [&[f64]; 2]) -> f64 {
    if !end.iter().all(|value| value.is_finite()) {
        return f64::MAX;
    }
    let limits = limits(nmpc, j).into_iter().map(|Limit { place, at_start, low, high }| {
        let value = if at_start { begin[place] } else { end[place] };
        (low - value).max(value - high) / size(low, high)
    });
    limits.fold(0.0, f64::max)
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
