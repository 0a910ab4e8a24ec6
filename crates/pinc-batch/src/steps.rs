//! One controller, many control steps.

use crate::delay::add_prediction;
use crate::rows::{Rows, applied_before, count};
use crate::share::{share, threads};
use pinc_mpc::{MpcError, Nmpc, SqpStatus};
use pinc_sensitivity::{ProblemDerivative, Regularity, Sensitivity};

/// Copies of a controller, one per thread, for steps and loops that each start afresh.
#[derive(Debug)]
pub struct NmpcBatch {
    pub(crate) workers: Vec<Nmpc>,
    pub(crate) interrupted: fn() -> bool,
}

/// What a batch of control steps is given. All but `x` may have one row for all steps.
///
/// # Shapes
///
/// `x`: `[steps, n]`; `reference`: `[steps, N2, outputs]` or `[N2, outputs]`; `u_before`, the input
/// applied last: `[steps, m]` or `[m]`, with a delay also all that is under way, the next to act first:
/// `[steps, delay, m]`; `parameters`: `[steps, np]` or `[np]`, or empty for those that the controller
/// has.
#[derive(Clone, Copy, Debug)]
pub struct Situations<'a> {
    /// The states in which the plant is.
    pub x: &'a [f64],
    /// The references over the horizon.
    pub reference: &'a [f64],
    /// The inputs applied last. With a delay, one fills all that is under way.
    pub u_before: &'a [f64],
    /// The parameters of the model.
    pub parameters: &'a [f64],
}

/// The results of a batch of control steps, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct StepBatch {
    /// The inputs to apply, `[steps, m]`.
    pub u: Vec<f64>,
    /// The plans' inputs, `[steps, Nu, m]`.
    pub inputs: Vec<f64>,
    /// How the optimizations ended.
    pub statuses: Vec<SqpStatus>,
    /// How many QPs were solved, and iterations of the barrier method taken.
    pub sqp_iterations: Vec<usize>,
    /// The largest KKT residuals.
    pub kkt: Vec<f64>,
}

/// The results of a batch of control steps with derivatives.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct GradientBatch {
    /// The steps.
    pub steps: StepBatch,
    /// Whether the plans are differentiable.
    pub regularities: Vec<Regularity>,
    /// The gradients in all that the problem is given. That in the input before is for a step in
    /// which all that is under way moves with it.
    pub gradients: Vec<ProblemDerivative>,
    /// The gradients in each input under way, `[steps, delay, m]`; without a delay in the input
    /// before.
    pub by_under_way: Vec<f64>,
}

/// The rows of [`Situations`], checked.
struct Checked<'a> {
    steps: usize,
    x: Rows<'a>,
    reference: Rows<'a>,
    u_before: Rows<'a>,
    parameters: Option<Rows<'a>>,
}

/// One step's results.
struct Step {
    u: Vec<f64>,
    inputs: Vec<f64>,
    status: SqpStatus,
    sqp_iterations: usize,
    kkt: f64,
}

impl NmpcBatch {
    /// Makes one controller for each of `threads` threads, 0: one per core. All must be the same.
    ///
    /// # Errors
    ///
    /// An error of `make`.
    pub fn new<E>(threads: usize, mut make: impl FnMut() -> Result<Nmpc, E>) -> Result<Self, E> {
        let workers = (0..self::threads(threads)).map(|_| make()).collect::<Result<_, _>>()?;
        Ok(Self { workers, interrupted: || false })
    }

    /// Lets methods ask from time to time, on the thread that called them, whether to stop. If so they
    /// return early, without the results of some of the last items.
    pub fn ask_to_stop(&mut self, interrupted: fn() -> bool) {
        self.interrupted = interrupted;
    }

    /// Returns the controller.
    #[must_use]
    pub fn nmpc(&self) -> &Nmpc {
        &self.workers[0]
    }

    /// Takes control steps, each from a plan that stays at its state and holds its last input.
    /// Where a number of a state is not finite the input before is held.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a list is of the wrong length, a number of references, inputs or parameters is
    /// not finite, or no allowed move leads from an input before to the inputs' bounds.
    pub fn steps(&mut self, at: Situations<'_>) -> Result<StepBatch, MpcError> {
        let at = self.check(at)?;
        let steps =
            share(&mut self.workers, at.steps, self.interrupted, |nmpc, k| at.step(nmpc, k));
        Ok(StepBatch::collect(steps.into_iter().collect::<Result<_, _>>()?))
    }

    /// Takes control steps, and returns for each the gradient of a function of its plan's inputs,
    /// from the gradient `by_inputs` of that function. `smoothing` is as in [`Sensitivity::new`].
    /// The gradients are in the numbers of `at`, also with a delay.
    ///
    /// # Shapes
    ///
    /// `by_inputs`: `[steps, k m]`, with the gradients in the first k inputs, or `[m]` for all steps.
    ///
    /// # Errors
    ///
    /// As [`NmpcBatch::steps`]; also if `by_inputs` is of the wrong length. Where a number of a state
    /// is not finite, the gradient is NaN.
    pub fn gradients(
        &mut self,
        at: Situations<'_>,
        by_inputs: &[f64],
        smoothing: Option<f64>,
    ) -> Result<GradientBatch, MpcError> {
        let at = self.check(at)?;
        let m = self.nmpc().model().dims().nu;
        let shared = by_inputs.len() == m;
        let width = if shared { m } else { by_inputs.len() / at.steps.max(1) };
        let by_inputs = Rows::new("by_inputs", by_inputs, width, at.steps)?;
        let one = |nmpc: &mut Nmpc, k: usize| {
            let step = at.step(nmpc, k)?;
            let (reference, under_way) = (at.reference.at(k), at.u_before.at(k));
            let before = &under_way[under_way.len() - m..];
            let mut sensitivity = Sensitivity::new(nmpc, reference, before, smoothing)?;
            let mut gradient = sensitivity.adjoint(&[], by_inputs.at(k))?;
            let mut regularity = sensitivity.regularity();
            if step.status == SqpStatus::BadArgument {
                // There is no plan for this state.
                gradient.values_mut().fill(f64::NAN);
                regularity = Regularity::NotOptimal;
            }
            let by_under_way = add_prediction(nmpc, [at.x.at(k), under_way], &mut gradient);
            Ok((step, ((regularity, gradient), by_under_way)))
        };
        let done = share(&mut self.workers, at.steps, self.interrupted, one);
        let done: Vec<_> = done.into_iter().collect::<Result<_, MpcError>>()?;
        let (steps, derivatives): (Vec<_>, Vec<_>) = done.into_iter().unzip();
        let (derivatives, by_under_way): (Vec<_>, Vec<_>) = derivatives.into_iter().unzip();
        let (regularities, gradients) = derivatives.into_iter().unzip();
        let (steps, by_under_way) = (StepBatch::collect(steps), by_under_way.concat());
        Ok(GradientBatch { steps, regularities, gradients, by_under_way })
    }

    /// Calls `job` for each of so many items with a controller that only one thread has, and returns
    /// the results in their order. The controller comes from another item, so that `job` must begin
    /// afresh, as by [`Nmpc::reset_input`], for results that are the same on any number of threads.
    pub fn each<R: Send>(
        &mut self,
        items: usize,
        job: impl Fn(&mut Nmpc, usize) -> R + Sync,
    ) -> Vec<R> {
        share(&mut self.workers, items, self.interrupted, job)
    }

    fn check<'a>(&self, at: Situations<'a>) -> Result<Checked<'a>, MpcError> {
        let nmpc = self.nmpc();
        let (dims, problem) = (nmpc.model().dims(), nmpc.problem());
        let steps = count("x", at.x, dims.nx)?;
        let window = problem.horizon * problem.tracked.len();
        let queue = problem.delay * dims.nu;
        let is_queue = queue > dims.nu && at.u_before.len() == steps * queue;
        let parameters = (!at.parameters.is_empty())
            .then(|| Rows::new("parameters", at.parameters, dims.np, steps));
        Ok(Checked {
            steps,
            x: Rows::new("x", at.x, dims.nx, steps)?,
            reference: Rows::new("reference", at.reference, window, steps)?,
            u_before: applied_before(
                nmpc,
                at.u_before,
                if is_queue { queue } else { dims.nu },
                steps,
            )?,
            parameters: parameters.transpose()?,
        })
    }
}

impl Checked<'_> {
    fn step(&self, nmpc: &mut Nmpc, k: usize) -> Result<Step, MpcError> {
        if let Some(parameters) = self.parameters {
            nmpc.set_parameters(parameters.at(k))?;
        }
        nmpc.reset_input(self.u_before.at(k))?;
        let step = nmpc.step(self.x.at(k), self.reference.at(k))?;
        let (u, status) = (step.u.to_vec(), step.status);
        let (sqp_iterations, kkt) = (step.sqp_iterations, step.kkt.max());
        Ok(Step { u, inputs: nmpc.plan().inputs().to_vec(), status, sqp_iterations, kkt })
    }
}

impl StepBatch {
    fn collect(steps: Vec<Step>) -> Self {
        let mut all = Self::default();
        for Step { u, inputs, status, sqp_iterations, kkt } in steps {
            all.u.extend(u);
            all.inputs.extend(inputs);
            all.statuses.push(status);
            all.sqp_iterations.push(sqp_iterations);
            all.kkt.push(kkt);
        }
        all
    }
}
