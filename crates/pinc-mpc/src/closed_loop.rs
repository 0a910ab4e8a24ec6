//! The controller and the plant together.

use crate::error::check_finite;
use crate::observer::Watch;
use crate::{Constraint, MpcError, Nmpc, Observer, PlantNow, Reference, SqpStatus, Tracked};
use pinc_ode::metrics::Tracking;
use pinc_ode::{Dopri5, Trajectory};

/// Points of the dense trace per control step, the last one at its end.
pub(crate) const POINTS: usize = 9;

/// A controller in closed loop with an accurately integrated plant.
///
/// The plant need not be the controller's model: parameters that differ show how sensitive the
/// control is. There are as many steps as reference values. Each is taken in two parts, so that a
/// caller can watch, and time, the controller alone:
///
/// ```
/// # use pinc_mpc::{Bounds, ClosedLoop, Nmpc, NmpcProblem, Reference, SqpConfig, Weights};
/// # use pinc_ode::{Dopri5, Model, Rk4};
/// # use pinc_plants::VanDerPol;
/// # let plant = VanDerPol::default();
/// # let model = Rk4::new(plant, 0.5, 4);
/// # let problem = NmpcProblem {
/// #     input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
/// #     ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
/// # };
/// # let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
/// let reference = Reference::new([0.0, 0.0].repeat(20), 2)?;
/// let truth = Dopri5::new(plant, 1e-12);
/// let mut run = ClosedLoop::new(&mut nmpc, truth, reference, &[1.0, 0.0])?;
/// while let Some(control) = run.control()? {
///     control.advance()?;
/// }
/// assert_eq!(run.trajectory().len(), 20 * 9 + 1);
/// assert!(run.state()[0].abs() < 1e-3);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
pub struct ClosedLoop<'a> {
    nmpc: &'a mut Nmpc,
    plant: Dopri5,
    reference: Reference,
    x: Vec<f64>,
    /// The input that the controller has chosen, and before it those under way: the first acts now.
    inputs: Vec<f64>,
    window: Vec<f64>,
    /// Whether the controller sees later values of the reference.
    preview: bool,
    /// What tells the controller of the plant, if it does not see the state itself.
    watch: Option<Watch<'a>>,
    steps: Vec<StepRecord>,
    /// How many steps the plant has taken.
    done: usize,
    /// Whether the plant could not be integrated.
    broken: bool,
    trajectory: Trajectory,
    max_violation: f64,
}

/// What is remembered of the controller's part of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRecord {
    /// How the optimisation ended.
    pub status: SqpStatus,
    /// How many QPs were solved.
    pub sqp_iterations: usize,
    /// The largest KKT residual, [`KktResidual::max`](crate::KktResidual::max).
    pub kkt: f64,
    /// A hard constraint that could not be met.
    pub violated: Option<Constraint>,
}

/// A step between its two parts: the input is chosen, the plant has not moved. If it is dropped,
/// the plant stays, and the controller is asked again.
#[derive(Debug)]
#[must_use = "the plant moves only by `advance`"]
pub struct Control<'b, 'a> {
    run: &'b mut ClosedLoop<'a>,
}

impl<'a> ClosedLoop<'a> {
    /// The loop of `nmpc`, which forgets what it did before, and `plant`, starting in state `x`.
    /// The paper's answers are those of a plant integrated to a tolerance of 1e-12.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if plant, reference or state do not suit the controller.
    pub fn new(
        nmpc: &'a mut Nmpc,
        plant: Dopri5,
        reference: Reference,
        x: &[f64],
    ) -> Result<Self, MpcError> {
        let (dims, given) = (nmpc.model().dims(), plant.dims());
        let outputs = nmpc.problem().tracked.len();
        let measured = if nmpc.problem().uses_outputs() { given.ny } else { dims.ny };
        for (field, expected, found) in [
            ("the plant's states", dims.nx, given.nx),
            ("the plant's inputs", dims.nu, given.nu),
            ("the plant's outputs", dims.ny, measured),
            ("the reference's outputs", outputs, reference.outputs()),
        ] {
            if found != expected {
                return Err(MpcError::Length { field, expected, found });
            }
        }
        check_finite("the initial state", x, dims.nx)?;
        nmpc.reset();
        Ok(Self {
            x: x.to_vec(),
            inputs: vec![0.0; (nmpc.problem().delay + 1) * dims.nu],
            window: vec![0.0; nmpc.problem().horizon * outputs],
            preview: true,
            watch: None,
            steps: Vec::with_capacity(reference.steps()),
            done: 0,
            broken: false,
            trajectory: Trajectory::new(dims),
            max_violation: 0.0,
            nmpc,
            plant,
            reference,
        })
    }

    /// The same loop, begun with a plant that has been given the input `u` so far: it is u\[k-1\]
    /// of the first step, and what is under way where inputs are delayed.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if `u` is of the wrong length or not finite.
    pub fn with_initial_input(mut self, u: &[f64]) -> Result<Self, MpcError> {
        self.nmpc.reset_to(&self.x, u)?;
        self.inputs.chunks_exact_mut(u.len()).for_each(|input| input.copy_from_slice(u));
        Ok(self)
    }

    /// The same loop with a controller that does not know what the reference will be: it takes the
    /// present value for all later ones.
    #[must_use]
    pub fn without_preview(self) -> Self {
        Self { preview: false, ..self }
    }

    /// The same loop with a controller that sees the plant by `observer`: this gives it the state,
    /// and the parameters of its model.
    #[must_use]
    pub fn with_observer(self, observer: &'a mut dyn Observer) -> Self {
        let dims = self.nmpc.model().dims();
        Self { watch: Some(Watch::new(observer, dims.nx, dims.np)), ..self }
    }

    /// Asks the observer, if there is one.
    fn observe(&mut self) -> Result<(), MpcError> {
        let Some(watch) = &mut self.watch else { return Ok(()) };
        let mut y = vec![0.0; self.plant.dims().ny];
        self.plant.output(&self.x, &self.inputs[..self.nmpc.model().dims().nu], &mut y);
        watch.observe(PlantNow { step: self.done, x: &self.x, y: &y });
        self.nmpc.set_parameters(&watch.parameters)
    }

    /// What the controller takes for the state of the plant, shape `n`.
    #[must_use]
    pub fn seen(&self) -> &[f64] {
        self.watch.as_ref().map_or(&self.x, |watch| &watch.x)
    }

    /// Writes what is followed by the input chosen in step `k`, at the ends of the stages.
    fn write_window(&mut self, k: usize) {
        let times = self.nmpc.stage_times_s();
        let first = if self.preview { k + self.nmpc.problem().delay } else { k };
        let width = self.reference.outputs();
        for (row, time) in self.window.chunks_exact_mut(width).zip(&times[1..]) {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "stages are few, and times positive"
            )]
            let stage = (time / times[1]).round() as usize;
            let later = if self.preview { stage - 1 } else { 0 };
            row.copy_from_slice(self.reference.at(first + later));
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
        let delay = self.nmpc.problem().delay;
        self.write_window(self.done);
        self.observe()?;
        let seen = self.watch.as_ref().map_or(&self.x, |watch| &watch.x);
        let step = self.nmpc.step_within(seen, &self.window, expired)?;
        self.steps.truncate(self.done);
        self.steps.push(StepRecord {
            status: step.status,
            sqp_iterations: step.sqp_iterations,
            kkt: step.kkt.max(),
            violated: step.violated,
        });
        let chosen = delay * step.u.len();
        self.inputs[chosen..].copy_from_slice(step.u);
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

    /// One record per step taken.
    #[must_use]
    pub fn steps(&self) -> &[StepRecord] {
        &self.steps
    }

    /// The dense trace: the initial point and nine points per step, the last one at its end, each
    /// with the input that holds from there on (at the end of the trace, with the last one). If the plant
    /// could not be integrated, this is the trace until then.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// What sample `i` of the dense trace is compared with: the value of the step that led there;
    /// for the initial point, that of the first step.
    #[must_use]
    pub fn reference_at(&self, i: usize) -> &[f64] {
        self.reference.at(i.saturating_sub(1) / POINTS)
    }

    /// What is tracked, of the plant at sample `i` of the dense trace.
    ///
    /// # Panics
    ///
    /// If there is no sample `i`.
    #[must_use]
    pub fn tracked_at(&self, i: usize) -> Vec<f64> {
        let tracked = &self.nmpc.problem().tracked;
        let y = if self.nmpc.problem().tracks_outputs() { self.outputs_at(i) } else { Vec::new() };
        let value = |tracked: &Tracked| match *tracked {
            Tracked::State(state) => self.trajectory.state(i)[state],
            Tracked::Output(output) => y[output],
        };
        tracked.iter().map(value).collect()
    }

    /// The outputs of the plant at sample `i` of the dense trace, `ny`.
    ///
    /// # Panics
    ///
    /// If there is no sample `i`.
    #[must_use]
    pub fn outputs_at(&self, i: usize) -> Vec<f64> {
        let mut y = vec![0.0; self.plant.dims().ny];
        self.plant.output(self.trajectory.state(i), self.trajectory.input(i), &mut y);
        y
    }

    /// The tracking error at the ends of the steps: the metrics as printed.
    #[must_use]
    pub fn tracking_at_steps(&self) -> Tracking {
        self.tracking((1..=self.done).map(|mark| mark * POINTS))
    }

    /// The tracking error on the dense trace: the metrics of the paper's Table 1.
    #[must_use]
    pub fn tracking_dense(&self) -> Tracking {
        self.tracking(0..self.trajectory.len())
    }

    /// The tracking error at some samples of the dense trace.
    fn tracking(&self, samples: impl Iterator<Item = usize>) -> Tracking {
        let mut tracking = Tracking::new(self.reference.outputs());
        for i in samples {
            tracking.push(self.reference_at(i), &self.tracked_at(i));
        }
        tracking
    }

    /// What is followed.
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
        if self.preview { self.nmpc.problem().horizon } else { 0 }
    }

    /// The most by which a bounded state, input or output was outside its bounds on the dense trace, the
    /// initial point apart, which is given.
    #[must_use]
    pub fn max_violation(&self) -> f64 {
        self.max_violation
    }

    fn watch_bounds(&mut self, u: &[f64]) {
        let problem = self.nmpc.problem();
        let states = problem.state_bounds.violation(&self.x);
        let inputs = problem.input_bounds.violation(u);
        let outputs = problem.output_bounds.as_ref().map_or(0.0, |bounds| {
            let last = self.trajectory.len() - 1;
            bounds.violation(&self.outputs_at(last))
        });
        self.max_violation = self.max_violation.max(states).max(inputs).max(outputs);
    }
}

impl Control<'_, '_> {
    /// The input chosen, shape `m`.
    #[must_use]
    pub fn u(&self) -> &[f64] {
        let chosen = self.run.inputs.len() - self.run.nmpc.model().dims().nu;
        &self.run.inputs[chosen..]
    }

    /// What the controller did.
    #[must_use]
    pub fn record(&self) -> &StepRecord {
        &self.run.steps[self.run.done]
    }

    /// The plant's part of the step, under the input that acts now.
    ///
    /// # Errors
    ///
    /// [`MpcError::Plant`] if the plant cannot be integrated; the loop then ends here and keeps
    /// what it has.
    pub fn advance(self) -> Result<(), MpcError> {
        let Self { run } = self;
        let m = run.nmpc.model().dims().nu;
        let u = run.inputs[..m].to_vec();
        run.move_plant(&u)?;
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
        match self.trajectory.is_empty() {
            true => self.trajectory.push(0.0, &self.x, u),
            false => self.trajectory.set_last_input(u),
        }
        let done = self.done;
        #[expect(clippy::cast_precision_loss, reason = "no run has 2^53 steps")]
        let time = |part: usize| (done as f64 + part as f64 / POINTS as f64) * sample_time_s;
        let times: [f64; POINTS] = std::array::from_fn(|part| time(part + 1));
        for t in times {
            #[expect(clippy::cast_precision_loss, reason = "nine")]
            let duration = sample_time_s / POINTS as f64;
            let integrated = self.plant.integrate(&mut self.x, u, duration);
            if let Err(source) = integrated {
                self.broken = true;
                return Err(MpcError::Plant { step: done, source });
            }
            self.trajectory.push(t, &self.x, u);
            self.watch_bounds(u);
        }
        self.done += 1;
        Ok(())
    }
}
