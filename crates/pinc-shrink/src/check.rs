//! The check of a net's plan by the model.

use crate::{Policy, ShrinkError, check_controller};
use pinc_mpc::{Bounds, IntervalEnd, Nmpc, Planner, Program, SqpStatus, Tracked};
use pinc_ode::Dims;
use std::mem::swap;

/// A plan breaks its bounds if it is outside by more than this part of a bound's size.
pub(crate) const TOLERANCE: f64 = 1e-6;

/// The parts of the way from the shifted plan to the net's that are tried.
const PARTS: [f64; 3] = [0.0, 0.5, 1.0];

/// The number of the net's plan.
const NETS: usize = 3;

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
/// model and from the state measured, no more than the shifted plan if that is within the bounds; and
/// it leaves the bounds on states and outputs, by the model, only if all four do. The shifted plan may,
/// in its last stage: there is no terminal set in which an input is known that stays within the bounds.
/// The model's errors, and states between control steps, are not covered.
///
/// It is a [`Planner`]: a controller that has it is used as it is without it. A step ends as
/// [`SqpStatus::Kept`] if the net's plan was taken, and as [`SqpStatus::Replaced`] if another one was.
/// Where all four leave the bounds the controller optimizes, from the best of them: with it as the last
/// resort a plan leaves the bounds only if the controller finds none within them either.
///
/// Source: Hose, Koehler, Zeilinger and Trimpe, "Approximate non-linear model predictive control
/// with safety-augmented neural networks" (2023).
#[derive(Clone, Debug)]
pub struct Checked {
    policy: Policy,
    rater: Rater,
    shifted: Vec<f64>,
    candidate: Vec<f64>,
    trial: Vec<f64>,
    is_alone: bool,
}

impl Checked {
    /// Checks the plans of a net in place of the controller `nmpc`.
    ///
    /// # Errors
    ///
    /// [`ShrinkError::Feature`] if the controller has something that a net does not replace,
    /// [`ShrinkError::Model`] if its model is not the one of the net's plans.
    pub fn new(policy: Policy, nmpc: &mut Nmpc) -> Result<Self, ShrinkError> {
        check_controller(nmpc)?;
        policy.net.check_model(nmpc)?;
        Ok(Self::of(policy, nmpc))
    }

    pub(crate) fn of(policy: Policy, nmpc: &mut Nmpc) -> Self {
        let zeros = || vec![0.0; policy.net.outputs.middle.len()];
        let [shifted, candidate, trial] = [(); 3].map(|()| zeros());
        Self { policy, rater: Rater::new(nmpc), shifted, candidate, trial, is_alone: false }
    }

    /// The same without the controller as the last resort, as in exported C.
    #[must_use]
    pub fn alone(self) -> Self {
        Self { is_alone: true, ..self }
    }

    /// Plans from a state for the values to follow and the input applied last: moves `plan`,
    /// `[Nu, m]`, from the plan before, shifted and within its bounds, to the plan to follow. Returns
    /// the number of the plan that was taken, and its rating.
    pub fn decide(
        &mut self,
        program: &mut Program<'_>,
        at: [&[f64]; 3],
        plan: &mut [f64],
    ) -> (usize, Rating) {
        let [x, reference, u_before] = at;
        let last = plan.len() - u_before.len();
        self.policy.plan(x, reference, u_before, &mut self.candidate);
        self.shifted.copy_from_slice(plan);
        self.shifted[last..].copy_from_slice(&self.candidate[last..]);
        let (mut best, mut taken) = (self.rater.rate(program, at, plan), 0);
        for (k, part) in PARTS.into_iter().enumerate() {
            self.between(part, u_before);
            let new = self.rater.rate(program, at, &self.trial);
            if new.is_better_than(best) {
                (best, taken) = (new, k + 1);
                plan.copy_from_slice(&self.trial);
            }
        }
        (taken, best)
    }

    /// The ratings of the plans of the last decision, made from there with `plan` before it, by number.
    pub(crate) fn ratings(
        &mut self,
        program: &mut Program<'_>,
        at: [&[f64]; 3],
        plan: &[f64],
    ) -> [Rating; PARTS.len() + 1] {
        let first = self.rater.rate(program, at, plan);
        let mut all = [first; PARTS.len() + 1];
        for (rating, part) in all[1..].iter_mut().zip(PARTS) {
            self.between(part, at[2]);
            *rating = self.rater.rate(program, at, &self.trial);
        }
        all
    }

    /// Writes to `trial` a plan between the shifted one and the net's, moved into its bounds.
    fn between(&mut self, part: f64, u_before: &[f64]) {
        let ends = self.shifted.iter().zip(&self.candidate);
        for (trial, (old, new)) in self.trial.iter_mut().zip(ends) {
            *trial = (1.0 - part) * old + part * new;
        }
        self.policy.limits.project(u_before, &mut self.trial);
    }
}

impl Planner for Checked {
    fn plan(
        &mut self,
        program: &mut Program<'_>,
        [x, reference, u_before]: [&[f64]; 3],
        inputs: &mut [f64],
    ) -> (SqpStatus, f64) {
        let now = &reference[..self.rater.tracked.len()];
        let (taken, rating) = self.decide(program, [x, now, u_before], inputs);
        let status = match taken {
            _ if rating.violation > TOLERANCE && !self.is_alone => SqpStatus::InfeasibleQp,
            NETS => SqpStatus::Kept,
            _ => SqpStatus::Replaced,
        };
        (status, rating.cost)
    }
}

/// Rates plans by rollouts of a controller's model. A rollout that is not finite breaks all bounds.
#[derive(Clone, Debug)]
pub struct Rater {
    dims: Dims,
    n1: usize,
    /// Where the tracked quantities are in a [`point`](Self::point).
    pub(crate) tracked: Vec<usize>,
    /// Q of each stage, and R of each change.
    pub(crate) q: Vec<Vec<f64>>,
    pub(crate) r: Vec<Vec<f64>>,
    /// The bounds of each stage, in the same order at all stages.
    pub(crate) limits: Vec<Vec<Limit>>,
    /// The points at both ends of an interval.
    begin: Vec<f64>,
    end: Vec<f64>,
}

impl Rater {
    /// Rates plans of this controller.
    #[must_use]
    pub fn new(nmpc: &mut Nmpc) -> Self {
        let problem = nmpc.problem().clone();
        let dims = nmpc.model().dims();
        let outputs = if problem.uses_outputs() { dims.ny } else { 0 };
        let program = nmpc.program();
        let q = (1..=problem.horizon).map(|j| match j < problem.n1 {
            true => vec![0.0; problem.tracked.len().pow(2)],
            false => program.tracking_weight(j).iter().map(|q| 0.5 * q).collect(),
        });
        let q = q.collect();
        let r = (0..problem.control_horizon).map(|i| {
            let entry = |at| problem.weights.r.at(i).entry(at / dims.nu, at % dims.nu);
            (0..dims.nu * dims.nu).map(entry).collect()
        });
        let points = vec![0.0; dims.nx + dims.nu + outputs];
        Self {
            dims,
            n1: problem.n1,
            tracked: problem.tracked.iter().map(|tracked| place(*tracked, dims)).collect(),
            q,
            r: r.collect(),
            limits: (1..=problem.horizon).map(|j| limits(nmpc, j)).collect(),
            begin: points.clone(),
            end: points,
        }
    }

    /// Rates a plan from a state for the values to follow and the input applied last.
    pub fn rate(
        &mut self,
        program: &mut Program<'_>,
        [x, reference, u_before]: [&[f64]; 3],
        plan: &[f64],
    ) -> Rating {
        let Dims { nx, nu, .. } = self.dims;
        let (mut cost, mut violation) = (0.0, 0.0_f64);
        for (i, (input, r)) in plan.chunks_exact(nu).zip(&self.r).enumerate() {
            let before = if i == 0 { u_before } else { &plan[(i - 1) * nu..i * nu] };
            cost += square(r, nu, |k| input[k] - before[k]);
        }
        let horizon = self.q.len();
        self.end[..nx].copy_from_slice(x);
        for j in 1..=horizon {
            let acting = (j - 1).min(self.r.len() - 1);
            let u = &plan[acting * nu..(acting + 1) * nu];
            swap(&mut self.begin, &mut self.end);
            fill(program, j - 1, (self.dims, u), &mut self.begin);
            let (model, p) = program.model(j - 1);
            model.step(&self.begin[..nx], u, p, &mut self.end[..nx]);
            fill(program, j - 1, (self.dims, u), &mut self.end);
            violation =
                violation.max(urgency(horizon, j) * self.outside(j, [&self.begin, &self.end]));
            let error = |k: usize| self.end[self.tracked[k]] - reference[k];
            cost += square(&self.q[j - 1], self.tracked.len(), error);
        }
        Rating { cost, violation }
    }

    /// Returns state, input and outputs at an end of an interval, one behind the other; outputs only
    /// if the controller uses any.
    pub(crate) fn point(&self, program: &mut Program<'_>, x: &[f64], u: &[f64]) -> Vec<f64> {
        let mut point = self.begin.clone();
        point[..x.len()].copy_from_slice(x);
        fill(program, 0, (self.dims, u), &mut point);
        point
    }

    /// By how much the points at both ends of the first interval that has bounds on outputs are
    /// outside their bounds.
    pub(crate) fn outside_now(&self, ends: [&[f64]; 2]) -> f64 {
        self.outside(self.n1, ends)
    }

    /// By how much the points at both ends of the interval that leads to stage `j` are outside their
    /// bounds, as a part of the bounds' sizes. What is not finite breaks all bounds.
    fn outside(&self, j: usize, [begin, end]: [&[f64]; 2]) -> f64 {
        if !end.iter().all(|value| value.is_finite()) {
            return f64::MAX;
        }
        let limits = self.limits[j - 1].iter().map(|Limit { place, at_start, low, high }| {
            let value = if *at_start { begin[*place] } else { end[*place] };
            (low - value).max(value - high) / size(*low, *high)
        });
        limits.fold(0.0, f64::max)
    }
}

/// Writes input and outputs behind the state of a point.
fn fill(program: &mut Program<'_>, stage: usize, (dims, u): (Dims, &[f64]), point: &mut [f64]) {
    let (x, rest) = point.split_at_mut(dims.nx);
    let (input, outputs) = rest.split_at_mut(dims.nu);
    input.copy_from_slice(u);
    if !outputs.is_empty() {
        let (model, p) = program.model(stage);
        model.output(x, u, p, outputs);
    }
}

/// v' M v
fn square(matrix: &[f64], n: usize, v: impl Fn(usize) -> f64) -> f64 {
    let entries = matrix.iter().enumerate();
    entries.map(|(at, entry)| v(at / n) * entry * v(at % n)).sum()
}

/// How much a violation at stage `j` counts: the later, the less, since later plans may avoid it.
pub(crate) fn urgency(horizon: usize, j: usize) -> f64 {
    (horizon + 1 - j) as f64 / horizon as f64
}

/// Where a tracked quantity is in a point.
fn place(tracked: Tracked, dims: Dims) -> usize {
    match tracked {
        Tracked::State(state) => state,
        Tracked::Input(input) => dims.nx + input,
        Tracked::Output(output) => dims.nx + dims.nu + output,
    }
}

/// A quantity with bounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// Where it is in a point.
    pub(crate) place: usize,
    /// Whether it is bounded at the start of the interval, instead of its end.
    pub(crate) at_start: bool,
    pub(crate) low: f64,
    pub(crate) high: f64,
}

/// The bounds of stage `j`, from 1 on, in the same order at all stages.
fn limits(nmpc: &mut Nmpc, j: usize) -> Vec<Limit> {
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

/// The size by which violations of two bounds are measured.
pub(crate) fn size(low: f64, high: f64) -> f64 {
    match (low.is_finite(), high.is_finite()) {
        (true, true) => 0.5 * (high - low),
        (true, false) => 1.0 + low.abs(),
        (false, true) => 1.0 + high.abs(),
        (false, false) => 1.0,
    }
}
