//! The iteration of Gauss and Newton, damped as by Levenberg and Marquardt.

use crate::linear::Linear;
use crate::problem::Problem;
use crate::progress::{GAIN, Progress};
use crate::shooting::{Block, Shooting};
use crate::trajectory::{Evaluation, Trajectory};
use std::fmt;

const ITERATIONS: usize = 200;
/// A step that lowers the cost by less than this share is the last: it is some 1e-7 of the
/// half widths of the intervals.
const NEGLIGIBLE: f64 = 1e-15;
/// The share if rounding lets no step lower the cost.
const ROUNDING: f64 = 1e-9;
/// Gaps between segments, in scales of the states, that are none.
const CLOSED: f64 = 1e-10;
const DAMPING: (f64, f64) = (1e-14, 1e12);

/// How a fit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FitStatus {
    /// At a minimum, as far as the linearization says.
    Converged,
    /// The iterations were used up.
    IterationLimit,
    /// No step made the cost smaller, though the linearization says that one should.
    Stalled,
    /// The derivatives are not finite.
    NotFinite,
}

impl fmt::Display for FitStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::IterationLimit => "iteration limit",
            Self::Stalled => "stalled",
            Self::NotFinite => "not finite",
        })
    }
}

/// A fit under way, and its end.
#[derive(Debug)]
pub(crate) struct Fit<'a> {
    pub(crate) p: Vec<f64>,
    pub(crate) recordings: Vec<Shooting<'a>>,
    pub(crate) linear: Linear,
    pub(crate) status: FitStatus,
    /// Whether it came to that before the iterations were used up.
    ended: bool,
    iterations: usize,
    damping: f64,
    /// The weight of gaps in the merit.
    penalty: f64,
    /// The cost at the start.
    first: f64,
    progress: Progress,
    /// What the priors add to the cost at the present point.
    prior_cost: f64,
    /// Where a step might lead.
    trial: Trial,
    block: Block,
}

#[derive(Debug)]
struct Trial {
    p: Vec<f64>,
    nodes: Vec<Vec<f64>>,
    trajectories: Vec<Trajectory>,
    prior_cost: f64,
}

impl<'a> Fit<'a> {
    /// At the start, whose trajectories have been simulated.
    pub(crate) fn new(
        problem: &Problem,
        p: Vec<f64>,
        recordings: Vec<Shooting<'a>>,
        with: &Evaluation<'_>,
    ) -> Self {
        Self {
            trial: Trial {
                p: p.clone(),
                nodes: recordings.iter().map(|of| of.nodes.x.clone()).collect(),
                trajectories: recordings.iter().map(|of| of.trajectory.clone()).collect(),
                prior_cost: 0.0,
            },
            linear: Linear::new(problem.unknown.len(), &recordings),
            block: Block::new(with.dims),
            status: FitStatus::IterationLimit,
            ended: false,
            progress: Progress::default(),
            iterations: 0,
            damping: 1e-3,
            penalty: 0.0,
            first: problem.prior_cost(&p)
                + recordings.iter().map(|of| of.trajectory.cost).sum::<f64>(),
            prior_cost: problem.prior_cost(&p),
            p,
            recordings,
        }
    }

    pub(crate) fn cost(&self) -> f64 {
        self.prior_cost + self.recordings.iter().map(|of| of.trajectory.cost).sum::<f64>()
    }

    /// How much the states depend on the initial one, at most.
    pub(crate) fn growth(&self) -> f64 {
        self.recordings.iter().map(|of| of.growth).fold(1.0, f64::max)
    }

    pub(crate) fn gaps(&self) -> f64 {
        self.recordings.iter().map(Shooting::gaps).sum()
    }

    /// Linearizes at the present point. Gives whether that is possible.
    pub(crate) fn linearize(&mut self, problem: &Problem, with: &mut Evaluation<'_>) -> bool {
        for of in &mut self.recordings {
            of.linearize(problem, &self.p, with, &mut self.block);
        }
        self.linear.take(problem, &self.p, &mut self.recordings)
    }

    /// Iterates to the end, and linearizes there for the intervals.
    pub(crate) fn run(&mut self, problem: &Problem, with: &mut Evaluation<'_>) {
        self.run_until(ITERATIONS, problem, with);
        if let Some((p, nodes)) = self.progress.better(self.cost()) {
            self.p = p;
            self.prior_cost = problem.prior_cost(&self.p);
            for (of, nodes) in self.recordings.iter_mut().zip(nodes) {
                of.nodes.x = nodes;
                of.simulate(problem, &self.p, with);
            }
        }
        if self.status != FitStatus::NotFinite && !self.linearize(problem, with) {
            self.status = FitStatus::NotFinite;
        }
    }

    /// Iterates to the end, or until `iterations` have been done in all; [`Fit::run`] goes on from
    /// there as if it had not been interrupted.
    pub(crate) fn run_until(
        &mut self,
        iterations: usize,
        problem: &Problem,
        with: &mut Evaluation<'_>,
    ) {
        while !self.ended && self.iterations < iterations && !with.is_interrupted() {
            self.iterations += 1;
            with.work.iterations += 1;
            if !self.linearize(problem, with) {
                (self.status, self.ended) = (FitStatus::NotFinite, true);
                return;
            }
            let stepped = self.descend(problem, with);
            // Data without noise leave only rounding.
            let exact = self.cost() <= 1e-28 * self.first && self.gaps() <= CLOSED;
            if let Some(status) = exact.then_some(FitStatus::Converged).or(stepped) {
                (self.status, self.ended) = (status, true);
            }
        }
    }

    /// Tries steps until one makes the cost smaller, for the last steps as a whole. Gives how the
    /// fit ended, if it did.
    fn descend(&mut self, problem: &Problem, with: &mut Evaluation<'_>) -> Option<FitStatus> {
        let (cost, gaps) = (self.cost(), self.gaps());
        let mut factor = 4.0;
        loop {
            self.linear.solve(problem, &self.p, &self.recordings, self.damping);
            let lowered = cost - self.linear.step.cost;
            let closed = gaps <= CLOSED;
            if closed && lowered <= NEGLIGIBLE * cost && self.damping < 1.0 {
                self.accept(problem, with, cost);
                return Some(FitStatus::Converged);
            }
            // The merit is the cost and a penalty of the gaps that makes any step a descent.
            if gaps > CLOSED {
                let least = if self.penalty > 0.0 { self.penalty } else { 1e-3 * cost / gaps };
                self.penalty = least.max(-2.0 * lowered / gaps);
            }
            let merit = cost + self.penalty * gaps;
            let expected = lowered + self.penalty * gaps;
            let steps = if self.is_multiple() { 6 } else { 1 };
            let mut alpha = 1.0;
            for _ in 0..steps {
                self.evaluate(problem, with, alpha);
                let (new_cost, new_gaps) = self.trial_merit();
                let gain = (merit - new_cost - self.penalty * new_gaps) / (alpha * expected);
                if gain > 1e-4 {
                    self.take_trial();
                    if alpha > 0.9 && gain > 0.5 {
                        self.damping =
                            (self.damping * if gain > 0.9 { 0.05 } else { 0.3 }).max(DAMPING.0);
                    } else if gain < 0.25 || alpha < 0.2 {
                        self.damping = (self.damping * 2.0).min(DAMPING.1);
                    }
                    return self.taken(problem, cost);
                }
                let nearby = new_gaps <= CLOSED && self.progress.allows(new_cost);
                if closed && nearby && expected > GAIN * cost {
                    self.take_trial();
                    self.damping = (self.damping * 2.0).min(DAMPING.1);
                    return self.taken(problem, cost);
                }
                alpha *= 0.4;
            }
            if gaps <= 1e-6 && lowered <= ROUNDING * cost && self.damping < 1.0 {
                return Some(FitStatus::Converged);
            }
            self.damping *= factor;
            factor *= 2.0;
            if self.damping > DAMPING.1 {
                return Some(self.where_steps_fail(problem, cost));
            }
        }
    }

    /// Notes a step from `cost`. Gives how the fit ended, if steps gain nothing any more.
    fn taken(&mut self, problem: &Problem, cost: f64) -> Option<FitStatus> {
        if self.gaps() > CLOSED {
            return None;
        }
        let nodes = || self.recordings.iter().map(|of| of.nodes.x.clone()).collect();
        let on = self.progress.step(self.cost(), || (self.p.clone(), nodes()));
        (!on).then(|| self.where_steps_fail(problem, cost))
    }

    /// Takes the last step, if it does not raise the cost.
    fn accept(&mut self, problem: &Problem, with: &mut Evaluation<'_>, cost: f64) {
        self.evaluate(problem, with, 1.0);
        if self.trial_merit().0 <= cost {
            self.take_trial();
        }
    }

    /// Whether it is a minimum after all, where no step helped.
    fn where_steps_fail(&mut self, problem: &Problem, cost: f64) -> FitStatus {
        self.linear.solve(problem, &self.p, &self.recordings, 1e-10);
        let minimum = cost - self.linear.step.cost <= GAIN * cost && self.gaps() <= 1e-6;
        if minimum { FitStatus::Converged } else { FitStatus::Stalled }
    }

    pub(crate) fn is_multiple(&self) -> bool {
        self.recordings.iter().any(|of| of.nodes.starts.len() > 1)
    }

    /// Simulates `alpha` of the step.
    fn evaluate(&mut self, problem: &Problem, with: &mut Evaluation<'_>, alpha: f64) {
        let Trial { p, nodes, trajectories, prior_cost } = &mut self.trial;
        let step = &self.linear.step;
        p.copy_from_slice(&self.p);
        for (unknown, dp) in problem.unknown.iter().zip(&step.dp) {
            let value = p[unknown.place] + alpha * dp;
            p[unknown.place] = value.max(unknown.low).min(unknown.high);
        }
        *prior_cost = problem.prior_cost(p);
        let parts = self.recordings.iter().zip(&step.q).zip(nodes).zip(trajectories);
        for (((of, q), nodes), trajectory) in parts {
            nodes.copy_from_slice(&of.nodes.x);
            of.advance((q, &step.dp), alpha, nodes);
            let from = (&of.nodes.starts[..], &nodes[..], &p[..]);
            with.simulate(problem, of.recording, from, trajectory);
        }
    }

    /// Cost and gaps of the trial; NaN where it is not finite.
    fn trial_merit(&self) -> (f64, f64) {
        if !self.trial.trajectories.iter().all(Trajectory::is_finite) {
            return (f64::NAN, f64::NAN);
        }
        let trajectories = self.trial.trajectories.iter().map(|t| t.cost).sum::<f64>();
        let cost = self.trial.prior_cost + trajectories;
        let gaps = self.recordings.iter().zip(&self.trial.trajectories).map(|(of, trial)| {
            let gaps = trial.defects.iter().zip(of.scale.iter().cycle());
            gaps.map(|(d, scale)| (d / scale).abs()).sum::<f64>()
        });
        (cost, gaps.sum())
    }

    fn take_trial(&mut self) {
        std::mem::swap(&mut self.p, &mut self.trial.p);
        self.prior_cost = self.trial.prior_cost;
        let trials = self.trial.nodes.iter_mut().zip(&mut self.trial.trajectories);
        for (of, (nodes, trajectory)) in self.recordings.iter_mut().zip(trials) {
            std::mem::swap(&mut of.nodes.x, nodes);
            std::mem::swap(&mut of.trajectory, trajectory);
        }
    }
}
