//! The controller and the plant together.

use crate::loop_errors::LoopErrors;
use crate::observer::{Observer, PlantNow, Watch};
use crate::violation::{Violation, Violations};
use pinc_mpc::{
    BoundSchedule, Bounded, Constraint, MpcError, Nmpc, Reference, SqpStatus, StepWork, Timetable,
    Tracked, Trust, check_finite,
};
use pinc_ode::metrics::Tracking;
use pinc_ode::{ArgumentError, Simulator, Trajectory};

/// Points of the dense trace per control step, the last one at its end.
const POINTS: usize = 9;

/// A controller in closed loop with an accurately integrated plant.
///
/// The plant need not be the controller's model: parameters that differ show how sensitive the
/// control is. There are as many steps as reference values. Each is taken in two parts, so that a
/// caller can watch, and time, the controller alone. Of the trace only the last step is kept, and
/// the tracked quantities at the step marks; [`LoopRecord`](crate::LoopRecord) keeps the rest.
///
/// ```
/// # use pinc_loop::ClosedLoop;
/// # use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, Weights};
/// # use pinc_ode::{AccurateIntegrator, Model, Rk4};
/// # use pinc_plants::VanDerPol;
/// # let plant = VanDerPol::default();
/// # let model = Rk4::new(plant, 0.5, 4);
/// # let problem = NmpcProblem {
/// #     input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
/// #     ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
/// # };
/// # let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
/// let reference = Reference::new([0.0, 0.0].repeat(20), 2)?;
/// let truth = AccurateIntegrator::new(plant, 1e-12);
/// let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0, 0.0])?;
/// while let Some(control) = run.control()? {
///     control.advance()?;
///     assert_eq!(run.last_step().len(), 1 + 9);
/// }
/// assert!(run.state()[0].abs() < 1e-3);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
pub struct ClosedLoop<'a> {
    nmpc: &'a mut Nmpc,
    plant: Simulator,
    reference: Reference,
    x: Vec<f64>,
    /// The input that the controller has chosen, and before it those under way: the first acts now.
    inputs: Vec<f64>,
    /// The input that acted in the last step, and before `last_step` began.
    acted: [Vec<f64>; 2],
    window: Vec<f64>,
    /// At the ends of the stages, how many steps after the next mark the reference is looked up.
    ahead: Vec<usize>,
    /// Whether the controller sees later values of the reference.
    preview: bool,
    /// What tells the controller of the plant, if it does not see the state itself.
    watch: Option<Watch<'a>>,
    /// What the controller did last.
    record: Option<StepRecord>,
    /// Whether the input of the next step is chosen.
    chosen: bool,
    /// How many steps the plant has taken.
    done: usize,
    /// Whether the plant could not be integrated.
    broken: bool,
    /// The dense trace of the step that the plant began last, and which step that is.
    last_step: Trajectory,
    last: usize,
    errors: LoopErrors,
    violations: Violations,
    /// Bounds that change.
    bounds: Option<BoundSchedule>,
    /// The parameters of the model, where the controller knows them in advance.
    parameters: Option<Timetable>,
    /// Which outputs may depend on the input.
    feedthrough: Vec<bool>,
}

/// The record of the controller's part of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRecord {
    /// How the optimization ended.
    pub status: SqpStatus,
    /// How many QPs were solved, and iterations of the barrier method taken.
    pub sqp_iterations: usize,
    /// Other work.
    pub work: StepWork,
    /// The largest KKT residual, [`KktResidual::max`](pinc_mpc::KktResidual::max).
    pub kkt: f64,
    /// A hard constraint that could not be met.
    pub violated: Option<Constraint>,
    /// Whether negative curvature was dropped: see [`StepReport`](pinc_mpc::StepReport).
    pub curvature_dropped: bool,
    /// The cost J of the plan.
    pub cost: f64,
    /// From which of several starts the plan was found, if they were tried.
    pub start: Option<usize>,
    /// Whether the model was trusted in the plan's first step.
    pub trust: Trust,
    /// Whether the plan keeps the bounds of the controller's tube, if there is one.
    pub in_tube: Option<bool>,
}

/// A step between its two parts: the input is chosen, the plant has not moved. If it is dropped,
/// the plant stays, and the input chosen for this step is the same when it is asked for again.
#[derive(Debug)]
#[must_use = "the plant moves only by `advance`"]
pub struct Control<'b, 'a> {
    run: &'b mut ClosedLoop<'a>,
}

impl<'a> ClosedLoop<'a> {
    /// The loop of `nmpc`, which forgets what it did before, and `plant`, starting in state `x`.
    /// The paper's answers need a plant integrated to a tolerance of 1e-12.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if plant, its parameters, reference or state do not suit the controller.
    pub fn new(
        nmpc: &'a mut Nmpc,
        plant: impl Into<Simulator>,
        reference: Reference,
        x: &[f64],
    ) -> Result<Self, MpcError> {
        let (plant, problem) = (plant.into(), nmpc.problem());
        let (dims, given, outputs) = (nmpc.model().dims(), plant.dims(), problem.tracked.len());
        let measured = if problem.uses_outputs() { given.ny } else { dims.ny };
        for (field, expected, found) in [
            ("the plant's states", dims.nx, given.nx),
            ("the plant's inputs", dims.nu, given.nu),
            ("the plant's outputs", dims.ny, measured),
            ("the plant's parameters", given.np, plant.parameters().len()),
            ("the reference's outputs", outputs, reference.outputs()),
        ] {
            ArgumentError::check_length(field, found, expected)?;
        }
        check_finite("the initial state", x, dims.nx)?;
        nmpc.reset();
        Ok(Self {
            x: x.to_vec(),
            inputs: vec![0.0; (nmpc.problem().delay + 1) * dims.nu],
            acted: [vec![0.0; dims.nu], vec![0.0; dims.nu]],
            window: vec![0.0; nmpc.problem().horizon * outputs],
            ahead: nmpc.stage_ends().into_iter().map(|end| end - 1).collect(),
            preview: true,
            watch: None,
            record: None,
            chosen: false,
            done: 0,
            broken: false,
            last_step: Trajectory::new(dims),
            last: 0,
            errors: LoopErrors::new(outputs),
            violations: Violations::new(nmpc.problem(), dims),
            bounds: None,
            parameters: None,
            feedthrough: nmpc.model().feedthrough(),
            nmpc,
            plant,
            reference,
        })
    }

    /// Begins the loop with a plant that has been given the input `u` so far: it is u\[k-1\] of the
    /// first step, and what is under way where inputs are delayed.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `u` is of the wrong length or not finite.
    pub fn with_initial_input(mut self, u: &[f64]) -> Result<Self, MpcError> {
        check_finite("u", u, self.acted[0].len())?;
        self.nmpc.reset_input(u)?;
        self.chosen = false;
        self.inputs.chunks_exact_mut(u.len()).for_each(|input| input.copy_from_slice(u));
        self.acted[0].copy_from_slice(u);
        Ok(self)
    }

    /// Gives the controller the inputs of its first plan: see [`Nmpc::set_first_plan`].
    ///
    /// # Errors
    ///
    /// [`MpcError`] if they are not as many as a plan has, or not finite.
    pub fn with_first_plan(self, inputs: &[f64]) -> Result<Self, MpcError> {
        self.nmpc.set_first_plan(inputs)?;
        Ok(self)
    }

    /// Lets bounds change with the steps.
    #[must_use]
    pub fn with_bounds(self, bounds: BoundSchedule) -> Self {
        Self { bounds: Some(bounds), ..self }
    }

    /// Gives the model the parameters of `p` step by step, with an observer the last of them; the
    /// controller also knows the parameters of the steps ahead.
    #[must_use]
    pub fn with_known_parameters(self, p: Timetable) -> Self {
        Self { parameters: Some(p), ..self }
    }

    /// Hides future references and bounds from the controller: it takes the present values for all
    /// later ones.
    #[must_use]
    pub fn without_preview(self) -> Self {
        Self { preview: false, ..self }
    }

    /// Lets the controller see the plant through `observer`, which supplies the state and the
    /// parameters of its model.
    #[must_use]
    pub fn with_observer(self, observer: &'a mut dyn Observer) -> Self {
        let nx = self.nmpc.model().dims().nx;
        let watch = Watch::new(observer, nx, self.nmpc.problem().parameters.clone());
        Self { watch: Some(watch), ..self }
    }

    /// Lets `plant` take the place of the plant from now on, as it is: with its parameters set.
    ///
    /// # Panics
    ///
    /// If it has other states, inputs or outputs, by their numbers.
    pub fn set_plant(&mut self, plant: Simulator) {
        let sizes = |plant: &Simulator| plant.dims().with_parameters(0);
        assert_eq!(sizes(&plant), sizes(&self.plant), "the sizes of a plant");
        self.plant = plant;
    }

    /// Tells the controller that the parameters of its model are `p` from now on; with an observer,
    /// which supplies the others, `p` are the last of them.
    ///
    /// # Errors
    ///
    /// As [`Nmpc::set_parameters`].
    pub fn set_model_parameters(&mut self, p: &[f64]) -> Result<(), MpcError> {
        match &mut self.watch {
            Some(watch) => watch.tell(p),
            None => self.nmpc.set_parameters(p),
        }
    }

    /// Asks the observer, if there is one.
    fn observe(&mut self) -> Result<(), MpcError> {
        let Some(watch) = &mut self.watch else { return Ok(()) };
        let mut y = vec![0.0; self.plant.dims().ny];
        self.plant.output(&self.x, &self.acted[0], &mut y);
        watch.observe(PlantNow { step: self.done, x: &self.x, y: &y });
        if self.nmpc.has_tube()
            && let Some(covariance) = watch.covariance()
        {
            self.nmpc.set_covariance(covariance);
        }
        watch.aim(&mut self.window);
        self.nmpc.set_parameters(&watch.parameters)
    }

    /// Returns the state of the plant as the controller sees it, shape `n`.
    #[must_use]
    pub fn seen(&self) -> &[f64] {
        self.watch.as_ref().map_or(&self.x, |watch| &watch.x)
    }

    /// Writes what is followed by the input chosen in step `k`, at the ends of the stages.
    fn write_window(&mut self, k: usize) {
        let delay = self.nmpc.problem().delay;
        let rows = self.window.chunks_exact_mut(self.reference.outputs().max(1));
        for (row, ahead) in rows.zip(&self.ahead) {
            let later = if self.preview { delay + ahead } else { 0 };
            row.copy_from_slice(self.reference.at(k + later));
        }
    }

    /// The controller's part of the next step; `None` after the last step, and after the plant
    /// could not be integrated.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the plant has left the finite numbers.
    pub fn control(&mut self) -> Result<Option<Control<'_, 'a>>, MpcError> {
        self.control_within(&mut || false)
    }

    /// [`ClosedLoop::control`] within a time budget, as [`Nmpc::step_within`].
    ///
    /// # Errors
    ///
    /// As [`ClosedLoop::control`].
    pub fn control_within(
        &mut self,
        expired: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Control<'_, 'a>>, MpcError> {
        if self.broken || self.done == self.reference.steps() {
            return Ok(None);
        }
        // The controller takes what it has chosen for applied.
        if self.chosen {
            return Ok(Some(Control { run: self }));
        }
        let delay = self.nmpc.problem().delay;
        self.write_window(self.done);
        if let Some(bounds) = &self.bounds {
            self.nmpc.set_bounds_at(bounds, self.done, self.preview);
        }
        if let (Some(p), Some(watch)) = (&self.parameters, &mut self.watch) {
            watch.tell(p.at(self.done))?;
        }
        self.observe()?;
        if let Some(p) = &self.parameters {
            self.nmpc.set_parameters_ahead(p, self.done)?;
        }
        let seen = self.watch.as_ref().map_or(&self.x, |watch| &watch.x);
        check_finite("x", seen, seen.len())?;
        let step = self.nmpc.step_within(seen, &self.window, expired)?;
        self.record = Some(StepRecord {
            status: step.status,
            sqp_iterations: step.sqp_iterations,
            work: step.work,
            kkt: step.kkt.max(),
            violated: step.violated,
            curvature_dropped: step.curvature_dropped,
            cost: step.cost,
            start: step.start,
            trust: step.trust,
            in_tube: None,
        });
        let chosen = delay * step.u.len();
        self.inputs[chosen..].copy_from_slice(step.u);
        self.chosen = true;
        let tightened = self.nmpc.tightened();
        if let Some(record) = &mut self.record {
            record.in_tube = tightened.map(|of| of.fits);
        }
        Ok(Some(Control { run: self }))
    }

    /// Takes all the steps that are left.
    ///
    /// # Errors
    ///
    /// As [`ClosedLoop::control`] and [`Control::advance`].
    pub fn run(&mut self) -> Result<(), MpcError> {
        while let Some(control) = self.control()? {
            control.advance()?;
        }
        Ok(())
    }

    /// The state of the plant, shape `n`.
    #[must_use]
    pub fn state(&self) -> &[f64] {
        &self.x
    }

    /// The dense trace of the step taken last: the point where it began and nine more, the last one
    /// at its end, all with the input that acted. If the plant could not be integrated, this is the
    /// trace until then; before the first step it is empty.
    #[must_use]
    pub fn last_step(&self) -> &Trajectory {
        &self.last_step
    }

    /// The reference of sample `i` of [`ClosedLoop::last_step`]: the value of the step that led
    /// there; for the initial point of the loop, the value of the first step.
    #[must_use]
    pub fn reference_at(&self, i: usize) -> &[f64] {
        let k = if i == 0 { self.last.saturating_sub(1) } else { self.last };
        self.reference.at(k)
    }

    /// The outputs of the plant at sample `i` of [`ClosedLoop::last_step`], `ny`. At sample 0, where
    /// the input changes, they are the readings just before the change, under the input of the step
    /// before.
    ///
    /// # Panics
    ///
    /// If there is no sample `i`.
    #[must_use]
    pub fn outputs_at(&self, i: usize) -> Vec<f64> {
        self.outputs_with(i, if i == 0 { &self.acted[1] } else { self.last_step.input(i) })
    }

    /// The outputs of the plant in the state of sample `i` under the input `u`.
    fn outputs_with(&self, i: usize, u: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; self.plant.dims().ny];
        self.plant.output(self.last_step.state(i), u, &mut y);
        y
    }

    /// What is tracked, of the plant at sample `i` of the last step.
    fn tracked_at(&self, i: usize) -> Vec<f64> {
        let tracked = &self.nmpc.problem().tracked;
        let y = if self.nmpc.problem().tracks_outputs() { self.outputs_at(i) } else { Vec::new() };
        let value = |tracked: &Tracked| match *tracked {
            Tracked::State(state) => self.last_step.state(i)[state],
            Tracked::Output(output) => y[output],
            Tracked::Input(input) if i == 0 => self.acted[1][input],
            Tracked::Input(input) => self.last_step.input(i)[input],
        };
        tracked.iter().map(value).collect()
    }

    /// The tracking error at the ends of the steps: the metrics as printed.
    #[must_use]
    pub fn tracking_at_steps(&self) -> Tracking {
        self.with_end(self.errors.at_steps())
    }

    /// The tracking error on the dense trace: the metrics of the paper's Table 1.
    #[must_use]
    pub fn tracking_dense(&self) -> Tracking {
        self.with_end(self.errors.dense())
    }

    /// `sum` with the error at the end of the last step.
    fn with_end(&self, sum: &Tracking) -> Tracking {
        let mut sum = sum.clone();
        if let Some(tracked) = self.tracked_at_end() {
            sum.push(self.reference_at(self.last_step.len() - 1), &tracked);
        }
        sum
    }

    /// The tracked quantities at the end of the last step; [`ClosedLoop::errors`] has them at the
    /// beginning of the next step.
    pub(crate) fn tracked_at_end(&self) -> Option<Vec<f64>> {
        let is_open = self.done > 0 && !self.broken;
        is_open.then(|| self.tracked_at(self.last_step.len() - 1))
    }

    /// The errors up to the beginning of the step that the plant began last.
    pub(crate) fn errors(&self) -> &LoopErrors {
        &self.errors
    }

    /// Returns the reference.
    #[must_use]
    pub fn reference(&self) -> &Reference {
        &self.reference
    }

    /// How many steps the plant has taken.
    pub(crate) fn steps_done(&self) -> usize {
        self.done
    }

    /// The steps by which the controller knows a change of the reference in advance.
    pub(crate) fn preview_steps(&self) -> usize {
        let last = self.ahead.last().filter(|_| self.preview);
        last.map_or(0, |ahead| ahead + 1)
    }

    /// The most by which a bounded state, input or output was outside its bounds on the dense
    /// trace, the initial point apart, which is given: the largest number, whatever its unit. Outputs
    /// with feedthrough are looked at just before and just after each change of the input, from the
    /// first input on.
    #[must_use]
    pub fn max_violation(&self) -> f64 {
        self.violations().map(|violation| violation.amount).fold(0.0, f64::max)
    }

    /// The bounds that were broken on the dense trace, the initial point apart, each with its worst
    /// violation: bounds of states, inputs, outputs.
    pub fn violations(&self) -> impl Iterator<Item = &Violation> {
        self.violations.broken()
    }

    /// Looks whether the point of the trace where the input `u` begins is within the bounds from then
    /// on, unless it is given: what the input changes at once always is not.
    fn watch_start(&mut self, u: &[f64]) {
        let bounded = self.nmpc.problem().output_bounds.is_some();
        let y = if bounded { self.outputs_with(0, u) } else { Vec::new() };
        let Self { violations, feedthrough, last_step, done, .. } = self;
        violations.look(last_step.times()[0], true, |of| match of {
            Bounded::Output(i) => (feedthrough[i] || *done > 0).then(|| y[i]),
            Bounded::State(i) => (*done > 0).then(|| last_step.state(0)[i]),
            Bounded::Input(_) => None,
        });
    }

    /// Looks whether the last point of the trace, the end of the step or not, is within all bounds.
    fn watch_bounds(&mut self, u: &[f64], at_end: bool) {
        let last = self.last_step.len() - 1;
        let bounded = self.nmpc.problem().output_bounds.is_some();
        let y = if bounded { self.outputs_at(last) } else { Vec::new() };
        let Self { violations, last_step, x, .. } = self;
        violations.look(last_step.times()[last], at_end, |of| {
            Some(match of {
                Bounded::State(i) => x[i],
                Bounded::Input(i) => u[i],
                Bounded::Output(i) => y[i],
            })
        });
    }
}

impl Control<'_, '_> {
    /// The input chosen, shape `m`.
    #[must_use]
    pub fn u(&self) -> &[f64] {
        let chosen = self.run.inputs.len() - self.run.nmpc.model().dims().nu;
        &self.run.inputs[chosen..]
    }

    /// Returns the state of the plant as the controller saw it, shape `n`.
    #[must_use]
    pub fn seen(&self) -> &[f64] {
        self.run.seen()
    }

    /// Returns the parameters of the controller's model in this step, shape `np`.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.run.nmpc.parameters()
    }

    /// The states of the plan, `[N2, n]`; none if it is no solution.
    #[must_use]
    pub fn plan(&self) -> &[f64] {
        if self.record().status.is_solved() { self.run.nmpc.plan().states() } else { &[] }
    }

    /// Where the plan expects the states: see [`Nmpc::expected`].
    #[must_use]
    pub fn expected(&self) -> Option<Vec<[Vec<f64>; 2]>> {
        self.run.nmpc.expected()
    }

    /// Returns the record of the controller.
    ///
    /// # Panics
    ///
    /// Never: the controller has done something.
    #[must_use]
    pub fn record(&self) -> &StepRecord {
        self.run.record.as_ref().expect("the controller has chosen an input")
    }

    /// The plant's part of the step, under the input that acts now.
    ///
    /// # Errors
    ///
    /// [`MpcError::Plant`] if the plant cannot be integrated; the loop keeps what it has.
    pub fn advance(self) -> Result<(), MpcError> {
        let Self { run } = self;
        let m = run.nmpc.model().dims().nu;
        let u = run.inputs[..m].to_vec();
        run.move_plant(&u)?;
        run.chosen = false;
        if let Some(watch) = &mut run.watch {
            watch.advance(&u);
        }
        run.inputs.copy_within(m.., 0);
        run.nmpc.prepare();
        Ok(())
    }
}

impl ClosedLoop<'_> {
    fn move_plant(&mut self, u: &[f64]) -> Result<(), MpcError> {
        let sample_time_s = self.nmpc.model().sample_time_s();
        let done = self.done;
        let time = |part: usize| (done as f64 + part as f64 / POINTS as f64) * sample_time_s;
        self.last_step.clear();
        self.last = done;
        let [acted, before] = &mut self.acted;
        before.copy_from_slice(acted);
        acted.copy_from_slice(u);
        self.last_step.push(time(0), &self.x, u);
        if let Some(bounds) = &self.bounds {
            self.violations.set_bounds_at(bounds, done);
        }
        self.watch_start(u);
        let (reference, tracked) = (self.reference_at(0).to_vec(), self.tracked_at(0));
        match done {
            0 => self.errors.push_start(&reference, &tracked),
            _ => self.errors.push_mark(&reference, &tracked),
        }
        for part in 1..=POINTS {
            let duration = sample_time_s / POINTS as f64;
            let integrated = self.plant.integrate(&mut self.x, u, duration);
            if let Err(source) = integrated {
                self.broken = true;
                return Err(MpcError::Plant { step: done, source });
            }
            self.last_step.push(time(part), &self.x, u);
            self.watch_bounds(u, part == POINTS);
            // The end of the last part is a mark, which the next step adds.
            if part < POINTS {
                let tracked = self.tracked_at(part);
                self.errors.push_between(self.reference.at(done), &tracked);
            }
        }
        self.done += 1;
        Ok(())
    }
}
