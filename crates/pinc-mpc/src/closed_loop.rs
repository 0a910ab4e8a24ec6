//! The controller and the plant together.

use crate::error::check_finite;
use crate::{Constraint, MpcError, Nmpc, Reference, SqpStatus};
use pinc_ode::metrics::Tracking;
use pinc_ode::{Dopri5, Trajectory};

/// Points of the dense trace per control step, the last one at its end.
const POINTS: usize = 9;

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
    /// Room for the model's outputs.
    outputs: Vec<f64>,
    /// Whether the controller sees later values of the reference.
    preview: bool,
    steps: Vec<StepRecord>,
    /// How many steps the plant has taken.
    done: usize,
    /// Whether the plant could not be integrated.
    broken: bool,
    trajectory: Trajectory,
    at_steps: Tracking,
    dense: Tracking,
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
        for (field, expected, found) in [
            ("the plant's states", dims.nx, given.nx),
            ("the plant's inputs", dims.nu, given.nu),
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
            outputs: vec![0.0; dims.ny],
            preview: true,
            steps: Vec::with_capacity(reference.steps()),
            done: 0,
            broken: false,
            trajectory: Trajectory::new(dims),
            at_steps: Tracking::new(outputs),
            dense: Tracking::new(outputs),
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

    /// Writes what is followed from step `k` on, at the ends of the stages.
    fn write_window(&mut self, k: usize) {
        let times = self.nmpc.stage_times_s();
        let width = self.reference.outputs();
        for (row, time) in self.window.chunks_exact_mut(width).zip(&times[1..]) {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "stages are few, and times positive"
            )]
            let stage = (time / times[1]).round() as usize;
            let later = if self.preview { stage - 1 } else { 0 };
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
        let delay = self.nmpc.problem().delay;
        self.write_window(self.done + delay);
        let step = self.nmpc.step_within(&self.x, &self.window, expired)?;
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
    /// with the input that led there (the initial one with the first). If the plant could not be
    /// integrated, this is the trace until then.
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

    /// The tracking error at the ends of the steps: the metrics as printed.
    #[must_use]
    pub fn tracking_at_steps(&self) -> &Tracking {
        &self.at_steps
    }

    /// The tracking error on the dense trace: the metrics of the paper's Table 1.
    #[must_use]
    pub fn tracking_dense(&self) -> &Tracking {
        &self.dense
    }

    /// The most by which a bounded state or input was outside its bounds on the dense trace, the
    /// initial point apart, which is given.
    #[must_use]
    pub fn max_violation(&self) -> f64 {
        self.max_violation
    }

    /// Appends the plant's state at time `t` to the trace, and gives its controlled part.
    fn sample(&mut self, t: f64, u: &[f64]) -> Vec<f64> {
        self.trajectory.push(t, &self.x, u);
        let mut y = vec![0.0; self.reference.outputs()];
        self.nmpc.tracked(&self.x, u, &mut self.outputs, &mut y);
        self.dense.push(self.reference.at(self.done), &y);
        y
    }

    fn watch_bounds(&mut self, u: &[f64]) {
        let problem = self.nmpc.problem();
        let states = problem.state_bounds.violation(&self.x);
        let inputs = problem.input_bounds.violation(u);
        self.max_violation = self.max_violation.max(states).max(inputs);
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
        run.inputs.copy_within(m.., 0);
        run.nmpc.prepare();
        Ok(())
    }
}

impl ClosedLoop<'_> {
    fn move_plant(&mut self, u: &[f64]) -> Result<(), MpcError> {
        let sample_time_s = self.nmpc.model().sample_time_s();
        if self.trajectory.is_empty() {
            self.sample(0.0, u);
        }
        let done = self.done;
        #[expect(clippy::cast_precision_loss, reason = "no run has 2^53 steps")]
        let time = |part: usize| (done as f64 + part as f64 / POINTS as f64) * sample_time_s;
        let times: [f64; POINTS] = std::array::from_fn(|part| time(part + 1));
        for (part, t) in times.into_iter().enumerate() {
            #[expect(clippy::cast_precision_loss, reason = "nine")]
            let duration = sample_time_s / POINTS as f64;
            let integrated = self.plant.integrate(&mut self.x, u, duration);
            if let Err(source) = integrated {
                self.broken = true;
                return Err(MpcError::Plant { step: done, source });
            }
            let y = self.sample(t, u);
            self.watch_bounds(u);
            if part + 1 == POINTS {
                self.at_steps.push(self.reference.at(done), &y);
            }
        }
        self.done += 1;
        Ok(())
    }
}
