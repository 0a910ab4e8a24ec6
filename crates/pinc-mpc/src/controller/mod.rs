//! The controller.

mod delay;
mod first_plan;
mod handover;
mod searched;

use crate::builder::NmpcBuilder;
use crate::cost::Targets;
use crate::error::{check_finite, check_length};
use crate::guard::{Guard, Trust};
use crate::guess::{Guess, Phase};
use crate::horizon::Horizon;
use crate::report::{Planned, StepReport};
use crate::scenarios::AtNodes;
use crate::solution::Solution;
use crate::sqp::{Outcome, PlanState, Sqp, StepInput};
use crate::{MpcError, NmpcProblem, PlanSearch, Planner, SqpConfig, SqpStatus};
use pinc_ode::{ArgumentError, Model};
use pinc_qp::{OcpDims, all_finite};

/// For how many steps a plan that was followed goes on without having been improved, while the time
/// does not suffice: then the plan on its way is followed, since a loop must not stay open.
const MOST_WAITING: usize = 5;

/// Nonlinear model predictive control, Algorithm 2 of the paper, with any [`Model`] as the model.
///
/// Each [`Nmpc::step`] solves the [`NmpcProblem`], starting from the last plan, shifted by a step (on a
/// tree of scenarios, in its place), and returns the plan's first input.
///
/// The input is always within its bounds and the bounds of its increments, however the optimization ends. A
/// plan that is not optimal but true to the model (to the square root of the tolerance) is followed: suboptimal
/// control suffices (Scokaert, Mayne and Rawlings, IEEE Trans. Autom. Control 44 (1999)). Otherwise the input
/// is the next one of the last plan, whose last input is held when the plan has run out (before there is a
/// plan, it is 0, moved into the bounds). The next step then starts afresh from the measured state, so that one
/// failure does not lead to the next. If only the deadline was hit, the next step resumes where this one ended.
/// The unfinished plan is followed in three cases: until there has been a plan that is true to the model; if a
/// QP was solved from such a plan, as in a real-time iteration; and if the last good plan is five steps old.
///
/// # Delays
///
/// If an input takes [`NmpcProblem::delay`] steps to act, the model first goes through the inputs
/// that are under way, and the problem starts at the resulting state, without delay.
///
/// # Real time
///
/// [`Nmpc::step_within`] stops where a caller's clock says so. With [`SqpConfig::real_time`] a step
/// is one QP, and [`Nmpc::prepare`] does what can be done of it before the state is known.
///
/// ```
/// use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Weights};
/// use pinc_ode::{Model, Rk4};
/// use pinc_plants::VanDerPol;
///
/// let model = Rk4::new(VanDerPol::default(), 0.5, 4);
/// let weights = Weights::uniform(vec![10.0, 10.0], vec![1.0]);
/// let problem = NmpcProblem {
///     state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
///     input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
///     ..NmpcProblem::new(model.dims(), 5, weights)
/// };
/// let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
/// let step = nmpc.step(&[1.0, 0.0], &[0.0; 10])?;
/// assert_eq!(step.status, SqpStatus::Converged);
/// assert!(step.u[0].abs() <= 1.0);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
pub struct Nmpc {
    pub(crate) problem: NmpcProblem,
    pub(crate) horizon: Horizon,
    pub(crate) parameters: Vec<f64>,
    config: SqpConfig,
    dims: OcpDims,
    pub(crate) sqp: Sqp,
    plan: Solution,
    /// The last plan that was followed, shifted.
    fallback: Solution,
    guess: Guess,
    pub(crate) phase: Phase,
    /// What is known of the plan. If it was not evaluated and the model has no value there, the
    /// next step starts afresh.
    plan_state: PlanState,
    /// The steps made so far.
    steps: u32,
    /// u\[k-1\]
    previous: Vec<f64>,
    /// The inputs that are under way, the next to act first, `[delay, m]`.
    pending: Vec<f64>,
    /// The state in which the problem begins: the measured one, or where the inputs under way lead.
    pub(crate) start: Vec<f64>,
    next: Vec<f64>,
    pub(crate) guard: Option<Guard>,
    /// The reference at the nodes of a tree.
    at_nodes: Option<AtNodes>,
    pub(crate) search: Option<Box<dyn PlanSearch>>,
    planner: Option<Box<dyn Planner>>,
    /// The best plan so far, where several may be found.
    best: Option<Solution>,
}

impl Nmpc {
    /// A controller for `problem` with the model `model`.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the problem does not suit the model, or `config` is no sensible choice.
    pub fn new(
        problem: NmpcProblem,
        model: Box<dyn Model>,
        config: SqpConfig,
    ) -> Result<Self, MpcError> {
        NmpcBuilder::new(problem).model(model).config(config).build()
    }

    /// Begins a controller for `problem` that needs more than one model and the choices of the
    /// optimization.
    pub fn builder(problem: NmpcProblem) -> NmpcBuilder {
        NmpcBuilder::new(problem)
    }

    /// The controller of these parts, which fit together.
    pub(crate) fn of(problem: NmpcProblem, horizon: Horizon, config: SqpConfig, sqp: Sqp) -> Self {
        let dims = sqp.dims();
        let plan = Solution::new(dims);
        Self {
            at_nodes: AtNodes::new(&problem, dims),
            best: sqp.may_improve().then(|| plan.clone()),
            parameters: problem.parameters.clone(),
            pending: vec![0.0; problem.delay * dims.nu],
            problem,
            horizon,
            config,
            dims,
            sqp,
            fallback: plan.clone(),
            plan,
            guess: Guess::Cold,
            phase: Phase::Solved,
            plan_state: PlanState::Evaluated,
            steps: 0,
            previous: vec![0.0; dims.nu],
            start: vec![0.0; dims.nx],
            next: vec![0.0; dims.nx],
            guard: None,
            search: None,
            planner: None,
        }
    }

    /// The controller with a guard, whose substitute must be for a problem of the same sizes.
    pub(crate) fn with_guard(mut self, guard: Option<Guard>) -> Result<Self, MpcError> {
        if let Some(other) = guard.as_ref().and_then(|guard| guard.substitute.as_deref()) {
            for (field, expected, found) in [
                ("the substitute's states", self.dims.nx, other.dims.nx),
                ("the substitute's inputs", self.dims.nu, other.dims.nu),
                ("the substitute's horizon", self.dims.horizon, other.dims.horizon),
                ("the substitute's delay", self.problem.delay, other.problem.delay),
            ] {
                ArgumentError::check_length(field, found, expected)?;
            }
        }
        self.guard = guard;
        Ok(self)
    }

    /// The problem that is solved.
    #[must_use]
    pub fn problem(&self) -> &NmpcProblem {
        &self.problem
    }

    /// The model of the first stage.
    #[must_use]
    pub fn model(&self) -> &dyn Model {
        self.horizon.first()
    }

    /// The times of x\[k\], x\[k+1\], .., x\[k+N2\], in s from the first.
    #[must_use]
    pub fn stage_times_s(&self) -> &[f64] {
        self.horizon.times()
    }

    /// Leaves out the exact Hessian, as generated C does, which `SqpHessian::Auto` takes in slow steps.
    pub fn leave_out_exact_hessian(&mut self) {
        self.sqp.leave_out_exact_hessian();
        let others = self.guard.iter_mut().filter_map(|guard| guard.substitute.as_mut());
        others.for_each(|other| other.leave_out_exact_hessian());
    }

    /// The parameters p of the model.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Sets the parameters p of the model at all stages, `np`, from the next step on.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `p` is of the wrong length or not finite; nothing has happened then.
    pub fn set_parameters(&mut self, p: &[f64]) -> Result<(), MpcError> {
        check_finite("parameters", p, self.parameters.len())?;
        self.parameters.copy_from_slice(p);
        self.sqp.set_parameters(p);
        self.begin_anew();
        Ok(())
    }

    /// The plan of the last step, with its multipliers.
    #[must_use]
    pub fn plan(&self) -> &Solution {
        &self.plan
    }

    /// The choices of the optimization.
    #[must_use]
    pub fn config(&self) -> &SqpConfig {
        &self.config
    }

    /// Forgets everything: the next step is again the first one, with u\[k-1\] = 0, and 0 under way.
    pub fn reset(&mut self) {
        self.plan.clear();
        self.sqp.forget();
        self.guess = Guess::Cold;
        self.phase = Phase::Solved;
        self.plan_state = PlanState::Evaluated;
        self.steps = 0;
        self.previous.fill(0.0);
        self.pending.fill(0.0);
    }

    /// Begins anew at a plant that is at `x` and has been given `u_applied` so far: that is
    /// u\[k-1\] and all that is under way, and the first plan stays at `x` and holds `u_applied`. With a
    /// stage cost its states follow from these inputs.
    ///
    /// # Shapes
    ///
    /// `x`: `n`; `u_applied`: as of [`Nmpc::reset_input`].
    ///
    /// # Errors
    ///
    /// [`MpcError`] if an argument is of the wrong length or not finite; nothing has happened then.
    pub fn reset_to(&mut self, x: &[f64], u_applied: &[f64]) -> Result<(), MpcError> {
        check_finite("x", x, self.dims.nx)?;
        self.reset_input(u_applied)?;
        self.place(x);
        Ok(())
    }

    /// [`Nmpc::reset_to`] where the state is not known yet: the first plan stays at the state of
    /// the first step.
    ///
    /// # Shapes
    ///
    /// `u_applied`: `m`; or `[delay, m]`, what is under way, the next to act first.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `u_applied` is of the wrong length or not finite; nothing has happened then.
    pub fn reset_input(&mut self, u_applied: &[f64]) -> Result<(), MpcError> {
        let (m, given) = (self.dims.nu, u_applied.len());
        let is_queue = given > m && given == self.pending.len();
        check_finite("u_applied", u_applied, if is_queue { given } else { m })?;
        self.reset();
        let last = &u_applied[given - m..];
        self.previous.copy_from_slice(last);
        self.pending.chunks_exact_mut(given).for_each(|u| u.copy_from_slice(u_applied));
        self.plan.hold(last);
        self.guess = Guess::Held;
        Ok(())
    }

    /// Checks an input for [`Nmpc::set_applied_input`], for callers that have more to do with it.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `u` is of the wrong length, not finite or beyond its bounds.
    pub fn check_applied_input(&self, u: &[f64]) -> Result<(), MpcError> {
        check_length("u_applied", u, self.dims.nu)?;
        self.problem.input_bounds.check_applied(u)
    }

    /// Says which input the plant was really given in place of the last one chosen, for instance by
    /// a safety system or an operator: it is u\[k-1\] in the next step. With a delay it takes the
    /// place of the last input under way.
    ///
    /// # Shapes
    ///
    /// `u`: `m`.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `u` is of the wrong length, not finite or beyond its bounds; nothing has happened then.
    pub fn set_applied_input(&mut self, u: &[f64]) -> Result<(), MpcError> {
        self.check_applied_input(u)?;
        self.previous.copy_from_slice(u);
        if let Some(last) = self.pending.len().checked_sub(u.len()) {
            self.pending[last..].copy_from_slice(u);
        }
        Ok(())
    }

    /// Chooses the input for a plant measured to be at `x`. Where a number of `x` is missing, NaN
    /// or infinite, the status is [`SqpStatus::BadArgument`] and the last input is held, within its
    /// bounds; the step counts, and with a delay that input is under way.
    ///
    /// # Shapes
    ///
    /// `x`: `n`; `reference`: yref\[k+1\]..yref\[k+N2\], `[N2, outputs]`, row by row; with a delay
    /// of d steps yref\[k+d+1\]..yref\[k+d+N2\]. Columns are in the order of
    /// [`NmpcProblem::tracked`]. yref\[k+1\] is for the end of step k; in a closed loop it is the
    /// reference's value at the *beginning* of that step, so a row that ends exactly at a change has
    /// the value from before it.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if an argument is of the wrong length or the reference is not finite; nothing
    /// has happened then.
    pub fn step(&mut self, x: &[f64], reference: &[f64]) -> Result<StepReport<'_>, MpcError> {
        self.step_within(x, reference, &mut || false)
    }

    /// [`Nmpc::step`] within a time budget: `expired` says whether the time is up. It is asked
    /// every few microseconds of work on small plants: within linearizations, every 32 stages (8,
    /// with more than 8 states and inputs), before each QP and within it, in the middle of large
    /// factorizations and between them, and between trials of a step's length. Clarabel alone is
    /// not interrupted. The status is then [`SqpStatus::Deadline`].
    ///
    /// The next step resumes from the plan reached: a plan on the way to the solution of a QP, or one that
    /// there was no time to judge. The residual then belongs to the plan before, whose input is applied if it
    /// is true to the model; it is infinite if the first linearization did not finish.
    ///
    /// # Errors
    ///
    /// As [`Nmpc::step`].
    pub fn step_within(
        &mut self,
        x: &[f64],
        reference: &[f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> Result<StepReport<'_>, MpcError> {
        check_length("x", x, self.dims.nx)?;
        let outputs = self.problem.tracked.len();
        check_finite("reference", reference, self.problem.horizon * outputs)?;
        if !all_finite(x) {
            return Ok(self.hold());
        }
        let Some(mut guard) = self.guard.take() else {
            return Ok(self.plan_step(x, reference, expired).report(self.plan.first_input()));
        };
        let found = self.guarded_step(&mut guard, x, reference, expired);
        self.guard = Some(guard);
        Ok(found?.report(self.plan.first_input()))
    }

    /// A step that the judge of `guard` looks at, and that its substitute makes over if it is not
    /// trusted, or if no plan was found although there was time.
    fn guarded_step(
        &mut self,
        guard: &mut Guard,
        x: &[f64],
        reference: &[f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> Result<Planned, MpcError> {
        if let Some(substitute) = &mut guard.substitute {
            substitute.continue_from(self);
        }
        let planned = self.plan_step(x, reference, expired);
        let repeats = guard.substitute.is_some() && planned.status != SqpStatus::Deadline;
        if !(planned.followed || repeats) {
            return Ok(planned);
        }
        let u = self.plan.first_input();
        // The judge also measures the error, which a substitute may need.
        let trusted = guard.judge.trusts(&self.start, u, &self.parameters) && planned.followed;
        let trust = match (trusted, &mut guard.substitute) {
            (true, _) => Trust::Trusted,
            (false, None) => Trust::Doubted,
            (false, Some(substitute)) => {
                guard.judge.substitute_parameters(&self.parameters, &mut guard.parameters);
                substitute.set_parameters(&guard.parameters)?;
                let planned = substitute.plan_step(x, reference, expired);
                self.continue_from(substitute);
                return Ok(Planned { trust: Trust::Substituted, ..planned });
            }
        };
        Ok(Planned { trust, ..planned })
    }

    /// A step from a finite state, without a guard.
    fn plan_step(
        &mut self,
        x: &[f64],
        reference: &[f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> Planned {
        let is_cold = self.steps == 0 || !self.is_warm();
        if self.guess == Guess::Held {
            self.place(x);
        }
        self.predict_delay(x);
        if self.guess == Guess::Given {
            self.roll_out_given();
        }
        self.shift_warm_start();
        self.begin_step();
        let at = [&self.start[..], &self.plan.z];
        let is_known = self.phase == Phase::Linearized;
        if self.sqp.transcription.tighten(&mut self.horizon, at, is_known) {
            self.sqp.project(&mut self.plan, &self.previous);
            if is_known {
                self.sqp.renew_output_limits();
            }
        }
        let planned = self.plan_otherwise(reference);
        let planned = planned.filter(|of| of.status != SqpStatus::InfeasibleQp);
        if self.config.real_time && planned.is_none() {
            self.prepare_linearization();
        }
        let mut outcome = planned.unwrap_or_else(|| self.optimize(reference, expired));
        let rolled_out = is_cold && self.rolls_out();
        if self.is_lost(&outcome, rolled_out) {
            if rolled_out {
                self.plan.copy_from(&self.fallback);
            }
            self.plan.stay_at(&self.start);
            self.sqp.project(&mut self.plan, &self.previous);
            outcome = self.optimize(reference, expired);
        }
        let mut start = None;
        if self.best.is_some() && planned.is_none() {
            (outcome, start) = self.improve(reference, (outcome, is_cold), expired);
        }
        if self.search.is_some() {
            outcome = self.look_further(reference, outcome, expired);
        }
        let (status, followed) = self.accept(&outcome);
        self.admit();
        self.previous.copy_from_slice(self.plan.first_input());
        self.push_delay_line();
        let planned = Planned::of(&outcome, status, followed, self.sqp.take_work());
        Planned { start, ..planned }
    }

    /// Begins the step at the time at which its plan does, and counts it.
    fn begin_step(&mut self) {
        let delay = self.problem.delay as f64;
        self.sqp.begin_step((f64::from(self.steps) + delay) * self.horizon.times()[1]);
        self.steps = self.steps.saturating_add(1);
    }

    /// A step without a state: the last input is held.
    fn hold(&mut self) -> StepReport<'_> {
        self.steps = self.steps.saturating_add(1);
        self.problem.input_bounds.clamp(&mut self.previous);
        self.push_delay_line();
        Planned::held(self.sqp.take_work()).report(&self.previous)
    }

    fn optimize(&mut self, reference: &[f64], expired: &mut dyn FnMut() -> bool) -> Outcome {
        let reference = self.at_nodes.as_mut().map_or(reference, |nodes| nodes.spread(reference));
        let targets = Targets { reference, previous: &self.previous };
        let input = StepInput { x0: &self.start, targets };
        if self.config.real_time {
            self.sqp.feed_back(input, &mut self.plan, expired)
        } else {
            self.sqp.solve(&mut self.horizon, input, &mut self.plan, expired)
        }
    }

    /// Does what can be done of the next real-time iteration before the state is measured: moves
    /// the plan on and linearizes along it. If it is not called, the step does it; without
    /// [`SqpConfig::real_time`], or without a plan to start from, nothing is done.
    pub fn prepare(&mut self) {
        let linearizes = self.config.real_time && self.planner.is_none();
        if linearizes && self.is_warm() && self.phase != Phase::Linearized {
            if self.phase == Phase::Solved {
                // Where the plan leads, as long as nothing is measured.
                self.start.copy_from_slice(&self.plan.states()[..self.dims.nx]);
            }
            self.shift_warm_start();
            self.prepare_linearization();
        }
    }

    fn prepare_linearization(&mut self) {
        if self.phase != Phase::Linearized {
            self.sqp.prepare(&mut self.horizon, &self.start, &self.plan);
            self.phase = Phase::Linearized;
        }
    }

    /// Keeps the new plan if it is worth following, or else takes the first guess. Gives the
    /// status, and whether the plan is followed.
    fn accept(&mut self, outcome: &Outcome) -> (SqpStatus, bool) {
        let Outcome { mut status, iterations, last, mut plan_state, .. } = *outcome;
        let finite = self.plan.is_finite();
        if !finite {
            status = SqpStatus::NumericalTrouble;
        }
        let (mut has_fallback, mut waited) = match self.guess {
            Guess::Cold | Guess::Held | Guess::Given => (false, 0),
            Guess::Warm { fallback } => (fallback, 0),
            Guess::Tentative { waited } => (true, waited),
        };
        let credible = last.dynamics <= self.config.tolerance.sqrt();
        if credible && plan_state == PlanState::Partial {
            // What is true to the model is the plan before.
            if self.horizon.is_uniform() {
                self.sqp.copy_base(&mut self.fallback);
                (has_fallback, waited) = (true, 0);
            } else {
                self.sqp.copy_base(&mut self.plan);
                plan_state = PlanState::Evaluated;
            }
        }
        use SqpStatus::{Converged, Kept, Prepared, Replaced, Rounded};
        let solved = matches!(status, Converged | Rounded | Prepared | Kept | Replaced);
        let started_good = self.guess == Guess::Warm { fallback: true };
        let good = finite
            && match plan_state {
                PlanState::Evaluated => solved || credible,
                // As a real-time iteration, if that started from a good plan.
                PlanState::Stepped => credible || started_good,
                PlanState::Partial => false,
            };
        let usable = finite && !good && status == SqpStatus::Deadline && self.has_guess();
        let tentative = usable && has_fallback && waited < MOST_WAITING;
        // With nothing to fall back on, a plan on its way is better than none.
        let followed = good || usable && !tentative;
        self.guess = match (tentative, followed) {
            (true, _) => Guess::Tentative { waited: waited + 1 },
            (false, true) => Guess::Warm { fallback: good },
            (false, false) => Guess::Cold,
        };
        self.plan_state = plan_state;
        self.phase = Phase::Solved;
        if !solved {
            tracing::debug!(%status, iterations, kkt = last.max(), "the step did not converge");
        }
        if tentative {
            let first = self.dims.input(0);
            self.plan.z[first].copy_from_slice(self.fallback.first_input());
        } else if !followed {
            self.plan.copy_from(&self.fallback);
        }
        self.sqp.project(&mut self.plan, &self.previous);
        (status, followed)
    }

    /// Whether the plan's states are worth starting from.
    fn is_warm(&self) -> bool {
        matches!(self.guess, Guess::Warm { .. } | Guess::Tentative { .. })
    }

    /// Whether a plan that cannot be followed yet is a better guess for the next step than to stay:
    /// there was one before, or the optimization has brought one. On stages of different lengths
    /// there is no memory to keep two plans.
    fn has_guess(&self) -> bool {
        self.horizon.is_uniform() && (self.is_warm() || self.plan != self.fallback)
    }
}
