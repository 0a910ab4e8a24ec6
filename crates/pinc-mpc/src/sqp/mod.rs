//! Sequential quadratic programming with Gauss-Newton or exact Hessians.

mod elastic;
mod hessian;
mod interior;
mod line_search;
mod outcome;

pub(crate) use outcome::{Outcome, PlanState};

use crate::cost::Targets;
use crate::curvature::{At, Purpose};
use crate::horizon::Horizon;
use crate::kkt::KktResidual;
use crate::merit::Merit;
use crate::solution::Solution;
use crate::stage_cost::StageCost;
use crate::transcription::Transcription;
use crate::{BoundSchedule, MpcError, NmpcProblem, Softness, SqpConfig, SqpStatus, StepWork};
use hessian::{Hessian, HessianChoice};
use interior::{Interior, Phase};
use pinc_ode::Memory;
use pinc_qp::{Anderson, ChosenQp, Elastic, OcpDims, Qp, QpSolver, QpStatus, QpStep, Row};
use std::ops::Range;

/// A step is taken whole if it brings the KKT residual below this part of the least seen.
const CONTRACTION: f64 = 0.9;

/// SQP by line search: linearize the problem at the current plan, solve the QP, go along its step
/// and towards its multipliers, until the KKT residual is small.
///
/// With the Gauss-Newton Hessian full steps converge linearly, the faster the smaller the multipliers times the
/// curvature of their constraints. A full step is taken if it makes the KKT residual clearly the least seen so
/// far, which can happen only finitely often; otherwise steps are halved until the [`Merit`] function
/// decreases. So neither the merit function's reluctance near a solution (the Maratos effect) costs steps, nor
/// does the iteration diverge from afar. A step is accelerated by those before it ([`Anderson`]); where the
/// iteration is slow all the same, the [`HessianChoice`] takes the exact Hessian of the Lagrangian.
///
/// If a linearized problem has no solution, or its step is none of descent, hard constraints on states become
/// soft for the rest of the control step ([`Elastic`]), at a weight above their multipliers, so that they are
/// met in the end if they can be; those of [`Softness::Exact`](crate::Softness::Exact) first.
///
/// References: Nocedal and Wright, *Numerical Optimization*, chapter 18; Diehl et al., "Real-time optimization
/// for large scale processes", J. Process Control 12 (2002).
///
/// All memory is allocated at construction. What few problems or few steps need is never inlined,
/// here and in what is called: a step's code is larger than the first cache of instructions.
#[derive(Debug)]
pub(crate) struct Sqp {
    config: SqpConfig,
    pub(crate) transcription: Transcription,
    /// The problem linearized at the plan.
    qp: Qp,
    /// The problem linearized at the point that is tried.
    trial: Qp,
    /// The program at the plan with the exact Hessian.
    curved: Qp,
    hessian: HessianChoice,
    /// Whether the program lacks negative curvature.
    dropped: bool,
    /// Whether the last program with the exact Hessian had the active rows that it began with.
    settled: bool,
    solver: ChosenQp,
    step: QpStep,
    /// A step that was not good enough, while another is tried.
    other_step: QpStep,
    merit: Merit,
    acceleration: Anderson,
    /// Where the step starts.
    base: Solution,
    /// The state that the QP was prepared for.
    prepared: Vec<f64>,
    work: Vec<f64>,
    /// Whether the problem has soft constraints.
    is_soft: bool,
    elastic: Elastic,
    /// The last weight of their violations, and whether it stays: plans of one step are compared by it.
    weight: Option<f64>,
    keeps_weight: bool,
    /// Where the exact Hessian may be taken, and from one start only: a barrier leads several starts to
    /// the same minimum.
    interior: Option<Interior>,
}

/// A point with its residual and cost.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    kkt: KktResidual,
    cost: f64,
}

/// How the search along a step ended.
enum Search {
    Found(Point),
    /// The step is no good.
    NoDescent,
    /// The time is up; the plan is where the step starts.
    Expired,
    /// The time was up before the end of the step was evaluated; the plan is there.
    Unevaluated,
}

/// What a control step is given.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepInput<'a> {
    /// The measured state.
    pub(crate) x0: &'a [f64],
    pub(crate) targets: Targets<'a>,
}

impl Sqp {
    pub(crate) fn new(
        problem: &NmpcProblem,
        config: SqpConfig,
        horizon: &Horizon,
        stage_cost: Option<Box<dyn StageCost>>,
    ) -> Result<Self, MpcError> {
        let transcription = Transcription::new(problem, horizon, stage_cost);
        let qp = transcription.qp();
        let dims = qp.dims;
        let hessian = config.hessian.resolve(problem);
        let kinds =
            [&problem.state_softness, &problem.output_softness, &problem.constraint_softness];
        let exact = HessianChoice::of(hessian, transcription.leaves_out_hessian()).may_be_exact();
        Ok(Self {
            config: SqpConfig { hessian, ..config },
            solver: ChosenQp::new(&qp, config.qp)?,
            step: QpStep::new(dims),
            other_step: QpStep::new(dims),
            merit: Merit::new(dims),
            acceleration: Anderson::new(dims),
            base: Solution::new(dims),
            prepared: vec![0.0; dims.nx],
            work: vec![0.0; dims.unknowns()],
            is_soft: kinds.iter().any(|of| **of != Softness::Hard),
            elastic: Elastic::new(&qp, elastic::exact(problem, dims)),
            weight: None,
            keeps_weight: false,
            interior: (exact && config.starts == 1).then(|| Interior::new(&qp, dims)),
            trial: qp.clone(),
            curved: transcription.curved_qp(),
            hessian: HessianChoice::new(None),
            dropped: false,
            settled: false,
            transcription,
            qp,
        })
    }

    /// The sizes of the problem.
    pub(crate) fn dims(&self) -> OcpDims {
        self.qp.dims
    }

    /// Sets the model's parameters.
    pub(crate) fn set_parameters(&mut self, p: &[f64]) {
        self.transcription.set_parameters(p);
    }

    /// Sets the bounds of all stages, each of which covers some steps of `schedule`.
    pub(crate) fn set_bounds(
        &mut self,
        schedule: &BoundSchedule,
        covered: impl Fn(usize) -> Range<usize>,
        preview: bool,
    ) {
        self.transcription.set_bounds(schedule, covered, preview);
    }

    /// Sets the model's parameters, or the last of them, at each stage; whether they changed.
    pub(crate) fn set_stage_parameters<'p>(&mut self, of: impl Fn(usize) -> &'p [f64]) -> bool {
        self.transcription.set_stage_parameters(of)
    }

    /// Chooses the units for a plant that is at `x0`. Where they change, the programs are built anew.
    fn choose_units(&mut self, x0: &[f64], targets: Option<Targets<'_>>) {
        if self.transcription.choose_units(x0, targets) {
            self.rebuild_programs();
        }
    }

    #[inline(never)]
    fn rebuild_programs(&mut self) {
        self.qp = self.transcription.qp();
        self.trial = self.qp.clone();
        self.curved = self.transcription.curved_qp();
        self.elastic.restate(&self.qp);
        if let Ok(solver) = ChosenQp::new(&self.qp, self.config.qp) {
            self.solver = solver;
        }
    }

    /// Brings the plan's multipliers to the units of the optimization, or back.
    fn convert(&self, plan: &mut Solution, back: bool) {
        let units = &self.transcription.units;
        if !units.is_identity() {
            units.convert(&mut plan.multipliers, back);
        }
    }

    /// Begins a control step with the time of its first stage in s.
    pub(crate) fn begin_step(&mut self, now_s: f64) {
        (self.weight, self.keeps_weight) = (None, false);
        self.transcription.set_time(now_s);
    }

    /// Forgets all plans, and how large states and inputs turned out to be.
    pub(crate) fn forget(&mut self) {
        self.interior.iter_mut().for_each(Interior::forget);
        if self.transcription.forget() {
            self.rebuild_programs();
        }
    }

    /// Saves or restores what a control step takes over from the last ones.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>, horizon: &mut Horizon) {
        if memory.restores() {
            self.forget();
        }
        self.interior.iter_mut().for_each(|interior| interior.remember(memory));
        self.transcription.remember(memory, horizon);
        if memory.restores() {
            self.rebuild_programs();
        }
    }

    /// The work since this was last asked.
    pub(crate) fn take_work(&mut self) -> StepWork {
        let mut work = self.solver.take_work();
        self.interior.iter_mut().for_each(|interior| work += interior.take_work());
        StepWork::new(self.transcription.take_linearized(), work)
    }

    /// Moves the plan's inputs into their bounds.
    pub(crate) fn project(&self, plan: &mut Solution, previous: &[f64]) {
        self.transcription.project(plan, previous);
    }

    /// Linearizes at the plan for a plant that will be at `x0`, for [`Sqp::feed_back`].
    pub(crate) fn prepare(&mut self, horizon: &mut Horizon, x0: &[f64], plan: &Solution) {
        self.leave_elastic();
        self.choose_units(x0, None);
        self.transcription.linearize(horizon, [x0, &plan.z], &mut self.qp, &mut || false);
        self.prepared.copy_from_slice(x0);
    }

    /// Gives the program of [`Sqp::prepare`] the bounds of outputs that a tube has tightened since.
    pub(crate) fn renew_output_limits(&mut self) {
        self.transcription.renew_output_limits(&mut self.qp);
    }

    /// One QP for a plant that turns out to be at `x0`, linearized where it was prepared: the step
    /// of a real-time iteration.
    pub(crate) fn feed_back(
        &mut self,
        input: StepInput<'_>,
        plan: &mut Solution,
        expired: &mut dyn FnMut() -> bool,
    ) -> Outcome {
        self.convert(plan, false);
        let qp = &mut self.qp;
        self.transcription.move_measured([input.x0, &self.prepared], qp);
        let cost = self.transcription.measure(input.x0, &plan.z, input.targets, qp);
        let last = KktResidual::with_cost(cost, &self.qp, plan, &mut self.work);
        let cost = self.transcription.units.plain_cost(cost) + self.price_of_violations();
        let (status, conflict) = match last.max().is_finite() {
            true => self.solve_prepared(plan, expired),
            false => (SqpStatus::NumericalTrouble, None),
        };
        if status == SqpStatus::Prepared {
            self.base.copy_from(plan);
            self.set_trial(plan, 1.0, input.targets.previous);
        }
        self.convert(plan, true);
        let violated = conflict.map(|row| self.transcription.name(row));
        let (plan_state, curvature_dropped) = (PlanState::Evaluated, false);
        Outcome { status, iterations: 1, last, violated, plan_state, curvature_dropped, cost }
    }

    /// Solves the QP, with hard constraints made soft if it must be.
    fn solve_prepared(
        &mut self,
        plan: &Solution,
        expired: &mut dyn FnMut() -> bool,
    ) -> (SqpStatus, Option<Row>) {
        self.step.multipliers.copy_from(&plan.multipliers);
        match self.solver.solve(&self.qp, &mut self.step, expired) {
            QpStatus::Solved => (SqpStatus::Prepared, None),
            QpStatus::Infeasible(row) if !self.soften_more() => {
                (SqpStatus::InfeasibleQp, Some(row))
            }
            QpStatus::Infeasible(row) => match self.solve_prepared(plan, expired) {
                (SqpStatus::Prepared, _) => (SqpStatus::Prepared, self.broken_by_step()),
                (status, _) => (status, Some(row)),
            },
            QpStatus::Failed if self.elastic.is_half_soft() && self.soften_more() => {
                self.solve_prepared(plan, expired)
            }
            QpStatus::Failed => (SqpStatus::NumericalTrouble, None),
            QpStatus::Expired => (SqpStatus::Deadline, None),
        }
    }

    /// Improves the plan for a plant measured to be at `x0`, until `expired` says that there is no
    /// time left. The plan's inputs must be within their bounds and stay there.
    pub(crate) fn solve(
        &mut self,
        horizon: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        expired: &mut dyn FnMut() -> bool,
    ) -> Outcome {
        self.leave_elastic();
        self.transcription.close_orbit(input.x0);
        self.choose_units(input.x0, Some(input.targets));
        if self.transcription.choose_cost([input.x0, &plan.z], input.targets, &mut self.trial) {
            self.rebuild_programs();
        }
        self.convert(plan, false);
        let outcome = self.optimize(horizon, input, plan, expired);
        self.convert(plan, true);
        outcome
    }

    /// The iteration on the unknowns z and multipliers lambda of the plan:
    ///
    /// ```text
    /// until |KKT(z, lambda)| <= tolerance:
    ///     H = the Gauss-Newton or the exact Hessian, by how fast the last QPs were
    ///     d, lambda+ = the solution of the QP linearized at z
    ///     alpha = the length of the step, by the residual or the merit function
    ///     z, lambda = z + alpha d, lambda + alpha (lambda+ - lambda)
    /// ```
    ///
    /// A QP without a solution, or a step without descent, makes hard constraints soft.
    fn optimize(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        expired: &mut dyn FnMut() -> bool,
    ) -> Outcome {
        self.merit.reset();
        self.acceleration.reset();
        self.transcription.follow_plan(None);
        let Some(mut point) = self.try_point(model, input, plan, expired) else {
            return Outcome::expired_at_once();
        };
        std::mem::swap(&mut self.qp, &mut self.trial);
        let (mut iterations, mut least) = (0, point.kkt.max());
        let (mut conflict, mut plan_state) = (None, PlanState::Evaluated);
        let always = self.transcription.leaves_out_hessian();
        (self.hessian, self.settled) = (HessianChoice::of(self.config.hessian, always), false);
        let possible = !self.transcription.is_tightened();
        self.interior.iter_mut().for_each(|interior| interior.begin(possible));
        let status = loop {
            if let Some(status) = self.check_termination(point.kkt, iterations) {
                break status;
            }
            if expired() {
                break SqpStatus::Deadline;
            }

            // H
            self.dropped = false;
            if self.hessian.judge(iterations, point.kkt.max()) {
                self.acceleration.reset();
            }
            let slow = self.hessian.is_slow();
            if self.interior.as_mut().is_some_and(|interior| interior.is_due(iterations, slow)) {
                let from = (point, &mut iterations);
                match self.go_through_interior(model, input, plan, from, expired) {
                    Phase::Found(found) => {
                        point = found;
                        (least, self.settled) = (point.kkt.max(), true);
                    }
                    Phase::Failed => {}
                    Phase::Expired(last) => {
                        point = last;
                        break SqpStatus::Deadline;
                    }
                }
                self.hessian.restart(iterations);
                continue;
            }
            if self.hessian.current() == Hessian::Exact {
                let convexity = self.hessian.convexity();
                let purpose = Purpose::Step { settled: self.settled, convexity };
                match self.curve(model, input, plan, (purpose, slow), expired) {
                    Some(dropped) => self.dropped = dropped,
                    None => break SqpStatus::Deadline,
                }
            }

            // d, lambda+
            iterations += 1;
            self.transcription.follow_plan(Some(iterations));
            self.step.multipliers.copy_from(&plan.multipliers);
            let half_soft = self.elastic.is_half_soft();
            match self.solve_program(expired) {
                QpStatus::Solved if self.is_unsettled_by_step(plan) => continue,
                QpStatus::Solved => {}
                QpStatus::Expired => {
                    self.step_on_the_way(plan, input.targets.previous);
                    plan_state = PlanState::Partial;
                    break SqpStatus::Deadline;
                }
                QpStatus::Failed if !half_soft && self.hessian.give_up(iterations) => continue,
                QpStatus::Failed if !half_soft => break SqpStatus::NumericalTrouble,
                unsolved @ (QpStatus::Infeasible(_) | QpStatus::Failed) => {
                    if let QpStatus::Infeasible(row) = unsolved {
                        conflict = Some(row);
                    }
                    if !self.soften_more() {
                        break SqpStatus::InfeasibleQp;
                    }
                    // It is no program that the plan gains by.
                    iterations -= usize::from(half_soft);
                    self.transcription.renew_output_limits(&mut self.qp);
                    self.hessian.restart(iterations);
                    continue;
                }
            }

            // alpha, z, lambda
            match self.search(model, input, plan, (point, least), expired) {
                // The elastic weight may make too much of rounding.
                Search::Found(next) if self.elastic.is_soft() && next == point => {
                    break SqpStatus::Stalled;
                }
                Search::Found(next) => point = next,
                Search::Expired => break SqpStatus::Deadline,
                Search::Unevaluated => {
                    plan_state = PlanState::Stepped;
                    break SqpStatus::Deadline;
                }
                Search::NoDescent => {
                    // The merit function has had other bounds at each trial.
                    if self.transcription.keep_bounds() {
                        least = f64::INFINITY;
                    } else if self.hessian.give_up(iterations) {
                        continue;
                    } else if !self.soften_more() {
                        break SqpStatus::Stalled;
                    }
                    match self.try_point(model, input, plan, expired) {
                        Some(again) => point = again,
                        None => break SqpStatus::Deadline,
                    }
                    std::mem::swap(&mut self.qp, &mut self.trial);
                    self.hessian.restart(iterations);
                }
            }
            least = least.min(point.kkt.max());
        };
        let mut has_descent = |anew: bool| {
            self.transcription.measure(input.x0, &plan.z, input.targets, &mut self.qp);
            self.curve(model, input, plan, (Purpose::Judgement, anew), expired).unwrap_or(true)
        };
        let is_judged = status == SqpStatus::Converged && always;
        let curvature_dropped = is_judged && [false, true].into_iter().all(&mut has_descent);
        let (last, violated, cost) =
            (point.kkt, None, self.transcription.units.plain_cost(point.cost));
        let outcome =
            Outcome { status, iterations, last, violated, plan_state, curvature_dropped, cost };
        self.finalize(outcome, plan, conflict)
    }

    /// Writes the program with the exact Hessian: see [`Transcription::curve`].
    #[inline(never)]
    fn curve(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &Solution,
        (purpose, anew): (Purpose, bool),
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        let at = At { x0: input.x0, plan, targets: input.targets, anew };
        self.transcription.curve(model, at, (&self.qp, &mut self.curved), purpose, expired)
    }

    /// Whether the step has other active rows than those that a program with the exact Hessian held.
    fn is_unsettled_by_step(&mut self, plan: &Solution) -> bool {
        let exact = self.hessian.current() == Hessian::Exact;
        self.settled = exact && self.qp.has_same_active(&plan.multipliers, &self.step.multipliers);
        exact && self.transcription.holds() && !self.settled
    }

    /// Solves the program with the Hessian that is chosen.
    fn solve_program(&mut self, expired: &mut dyn FnMut() -> bool) -> QpStatus {
        let qp = match self.hessian.current() {
            Hessian::GaussNewton => &self.qp,
            Hessian::Exact => &self.curved,
        };
        self.solver.solve(qp, &mut self.step, expired)
    }

    /// Goes along the step as far as is good. Between two trials `expired` is asked whether the
    /// time is up; the plan is then as it was.
    fn search(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        (from, least): (Point, f64),
        expired: &mut dyn FnMut() -> bool,
    ) -> Search {
        self.base.copy_from(plan);
        let good = |point: &Point| point.kkt.max() <= CONTRACTION * least;
        if self.accelerate(plan) {
            let Some(point) = self.evaluate_trial(model, input, plan, 1.0, expired) else {
                return Search::Unevaluated;
            };
            if good(&point) {
                self.accept_trial(1.0);
                return Search::Found(point);
            }
            if expired() {
                return self.give_up(plan);
            }
            self.acceleration.take_back(&mut self.step);
        }
        let Some(whole) = self.evaluate_trial(model, input, plan, 1.0, expired) else {
            return Search::Unevaluated;
        };
        if good(&whole) {
            self.accept_trial(1.0);
            return Search::Found(whole);
        }
        self.backtrack(model, input, plan, (from, whole), expired)
    }

    /// Goes as far towards the solution of a QP as it came before the time was up: the next control
    /// step goes on from there.
    #[inline(never)]
    fn step_on_the_way(&mut self, plan: &mut Solution, previous: &[f64]) {
        self.base.copy_from(plan);
        if self.step.is_finite() {
            self.set_trial(plan, 1.0, previous);
        }
    }

    /// Whether a plan may be a saddle, or one of several. A tube follows the only solution of a step.
    pub(crate) fn may_improve(&self) -> bool {
        let transcription = &self.transcription;
        let several = self.config.starts > 1 || transcription.leaves_out_hessian();
        several && !transcription.is_tightened()
    }

    /// Writes the plan that the last step started from.
    pub(crate) fn copy_base(&self, plan: &mut Solution) {
        plan.copy_from(&self.base);
        self.convert(plan, true);
    }

    /// Goes back to where the step starts: the time is up.
    #[inline(never)]
    fn give_up(&self, plan: &mut Solution) -> Search {
        plan.copy_from(&self.base);
        Search::Expired
    }

    /// Linearizes at `plan`, into the trial QP, unless `expired` says before that the time is up.
    fn try_point(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &Solution,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<Point> {
        let cost = self.linearize_trial(model, input, plan, expired)?;
        Some(Point { kkt: KktResidual::with_cost(cost, &self.trial, plan, &mut self.work), cost })
    }

    fn residual(&mut self, plan: &Solution) -> KktResidual {
        KktResidual::new(&self.qp, plan, &mut self.work)
    }

    /// Whether to stop after so many iterations with this residual.
    fn check_termination(&self, kkt: KktResidual, iterations: usize) -> Option<SqpStatus> {
        if !kkt.max().is_finite() {
            Some(SqpStatus::NumericalTrouble)
        } else if kkt.max() <= self.config.tolerance {
            Some(SqpStatus::Converged)
        } else if iterations == self.config.max_iterations {
            Some(SqpStatus::IterationLimit)
        } else {
            None
        }
    }
}
