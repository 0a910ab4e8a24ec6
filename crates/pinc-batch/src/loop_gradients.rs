//! The gradient of a closed loop's cost, by adjoints through controller and plant.

use crate::NmpcBatch;
use crate::rows::{Rows, applied_before, count};
use crate::share::share;
use pinc_mpc::{MpcError, Nmpc, Reference, Tracked};
use pinc_ode::{
    ArgumentError, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages,
};
use pinc_sensitivity::{Given, ProblemDerivative, Regularity, Sensitivity};

/// The cost of a closed loop of K steps,
///
/// ```text
/// sum_{k=1..K} errors_i (y_i[k] - yref_i[k])^2 + increments_i (u_i[k-1] - u_i[k-2])^2
///              + violations_i (how far x_i[k] is outside its bounds)^2
/// ```
///
/// with the tracked quantities y and the bounds on states of the controller's first stage.
#[derive(Clone, Copy, Debug)]
pub struct LoopCost<'a> {
    /// Weights of the tracked quantities' errors at the ends of the steps.
    pub errors: &'a [f64],
    /// Weights of the inputs' increments, `m`.
    pub increments: &'a [f64],
    /// Weights of the violations of bounds on states, `n`.
    pub violations: &'a [f64],
}

/// What a batch of loops with gradients is given. The plant moves by a model.
#[derive(Clone, Copy, Debug)]
pub struct GradientLoops<'a> {
    /// The states in which the loops begin, `[loops, n]`.
    pub x: &'a [f64],
    /// What they follow: one reference per loop, or one for all.
    pub references: &'a [Reference],
    /// The inputs applied before: `[loops, m]` or `[m]`.
    pub u_before: &'a [f64],
    /// The plant's parameters: `[loops, np]` or `[np]`, of the model that is the plant.
    pub parameters: &'a [f64],
    /// What the loops cost.
    pub cost: LoopCost<'a>,
    /// The barrier parameter of smoothed gradients, as in [`Sensitivity::new`].
    pub smoothing: Option<f64>,
    /// Whether the controller sees later values of the reference.
    pub preview: bool,
}

/// A closed loop's cost and its gradient.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoopGradient {
    /// The cost.
    pub cost: f64,
    /// The gradient in all that the controller's problem is given at every step. `State` and
    /// `AppliedInput` are those before the first step; `Reference` is 0. Bounds count as the
    /// controller's only: the limits from which [`LoopCost::violations`] are measured are constants,
    /// so that descent may tighten a bound but gains nothing by judging with a wider one.
    pub gradient: ProblemDerivative,
    /// In how many steps the plan was not differentiable.
    pub irregular: usize,
}

/// A step of a loop: where it began, and how its input depends on what the controller was given.
struct Step {
    x: Vec<f64>,
    u: Vec<f64>,
    /// A gradient per input.
    by_given: Vec<ProblemDerivative>,
}

impl NmpcBatch {
    /// Runs closed loops of the controller and `plant`, and differentiates their costs. `make` makes
    /// the plant: a model with the controller's states, inputs and outputs.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a list is of the wrong length or a number not finite, no allowed move leads from
    /// an input before to the inputs' bounds, the plant has other sizes, or the controller's problem
    /// has a delay, which the gradient does not cover.
    pub fn loop_gradients(
        &mut self,
        given: GradientLoops<'_>,
        make: impl Fn() -> Box<dyn Model> + Sync,
    ) -> Result<Vec<LoopGradient>, MpcError> {
        let nmpc = self.nmpc();
        let (dims, problem) = (nmpc.model().dims(), nmpc.problem());
        let plant = make().dims();
        let loops = count("x", given.x, dims.nx)?;
        for (field, expected, found) in [
            ("the problem's delay", 0, problem.delay),
            ("the plant's states", dims.nx, plant.nx),
            ("the plant's inputs", dims.nu, plant.nu),
            ("the plant's outputs", dims.ny, plant.ny),
            ("cost.errors", problem.tracked.len(), given.cost.errors.len()),
            ("cost.increments", dims.nu, given.cost.increments.len()),
            ("cost.violations", dims.nx, given.cost.violations.len()),
        ] {
            ArgumentError::check_length(field, found, expected)?;
        }
        if given.references.len() != 1 && given.references.len() != loops {
            let (expected, found) = (loops, given.references.len());
            return Err(ArgumentError::Length { field: "references", expected, found }.into());
        }
        let x = Rows::new("x", given.x, dims.nx, loops)?;
        let u_before = applied_before(nmpc, given.u_before, dims.nu, loops)?;
        let p = Rows::new("parameters", given.parameters, plant.np, loops)?;
        let found = share(&mut self.workers, loops, self.interrupted, |nmpc, k| {
            let reference = &given.references[k % given.references.len()];
            let plant = Plant { model: make(), p: p.at(k) };
            Backward { given: &given, reference, plant }.run(nmpc, x.at(k), u_before.at(k))
        });
        found.into_iter().collect()
    }
}

/// The plant of a loop, with its parameters.
struct Plant<'a> {
    model: Box<dyn Model>,
    p: &'a [f64],
}

/// A loop on its way forward and back.
struct Backward<'a> {
    given: &'a GradientLoops<'a>,
    reference: &'a Reference,
    plant: Plant<'a>,
}

impl Backward<'_> {
    fn run(
        mut self,
        nmpc: &mut Nmpc,
        x: &[f64],
        u_before: &[f64],
    ) -> Result<LoopGradient, MpcError> {
        nmpc.reset_input(u_before)?;
        let (mut steps, mut irregular) = (Vec::new(), 0);
        let (mut x, mut before) = (x.to_vec(), u_before.to_vec());
        for k in 0..self.reference.steps() {
            let (step, regular) = self.step(nmpc, k, &x, &before)?;
            irregular += usize::from(!regular);
            let mut next = x.clone();
            self.plant.model.step(&x, &step.u, self.plant.p, &mut next);
            (x, before) = (next, step.u.clone());
            steps.push(step);
        }
        self.back(nmpc, steps, (&x, u_before), irregular)
    }

    /// Takes step `k`, and differentiates its input; whether that was possible.
    fn step(
        &self,
        nmpc: &mut Nmpc,
        k: usize,
        x: &[f64],
        before: &[f64],
    ) -> Result<(Step, bool), MpcError> {
        let outputs = self.reference.outputs();
        let mut window = vec![0.0; nmpc.problem().horizon * outputs];
        match self.given.preview {
            true => self.reference.preview_at(k, &nmpc.stage_times_s()[1..], &mut window),
            false => window
                .chunks_exact_mut(outputs.max(1))
                .for_each(|row| row.copy_from_slice(self.reference.at(k))),
        }
        let u = nmpc.step(x, &window)?.u.to_vec();
        let mut sensitivity = Sensitivity::new(nmpc, &window, before, self.given.smoothing)?;
        let mut by_given = Vec::new();
        for i in 0..u.len() {
            let mut seed = vec![0.0; u.len()];
            seed[i] = 1.0;
            by_given.push(sensitivity.adjoint(&[], &seed)?);
        }
        let regular = sensitivity.regularity() == Regularity::Regular;
        Ok((Step { x: x.to_vec(), u, by_given }, regular))
    }

    /// From the last step to the first:
    ///
    /// ```text
    /// by_x[k]   = the cost's gradient at x[k] + A' by_x[k+1] + (du[k]/dx[k])' by_u[k]
    /// by_u[k]   = the cost's gradient at u[k] + B' by_x[k+1] + (du[k+1]/du[k])' by_u[k+1]
    /// gradient += (du[k]/dgiven)' by_u[k]
    /// ```
    fn back(
        &mut self,
        nmpc: &Nmpc,
        steps: Vec<Step>,
        (last, u_before): (&[f64], &[f64]),
        irregular: usize,
    ) -> Result<LoopGradient, MpcError> {
        let dims = self.plant.model.dims();
        let (mut cost, mut gradient) = (0.0, None::<ProblemDerivative>);
        let (mut by_x, mut by_u_later) = (vec![0.0; dims.nx], vec![0.0; dims.nu]);
        for k in (0..steps.len()).rev() {
            let Step { x, u, by_given } = &steps[k];
            let next = steps.get(k + 1).map_or(last, |step| &step.x);
            let before = if k == 0 { u_before } else { &steps[k - 1].u };
            let mut by_u = std::mem::take(&mut by_u_later);
            cost += self.add_end(nmpc, k, [next, u], [&mut by_x, &mut by_u]);
            let mut jacobians = LinearizationBuffer::new(dims, 1);
            let Linearization { next, a, b, .. } = jacobians.as_mut();
            let out = Linearization { next, a, b, e: &mut [] };
            self.plant.model.linearize(Stages { x, u, p: self.plant.p }, out);
            let mut by_start = vec![0.0; dims.nx];
            add_transposed(&jacobians.b, &by_x, &mut by_u);
            add_transposed(&jacobians.a, &by_x, &mut by_start);
            by_u_later = vec![0.0; dims.nu];
            for (i, weight) in self.given.cost.increments.iter().enumerate() {
                let increment = u[i] - before[i];
                cost += weight * increment * increment;
                by_u[i] += 2.0 * weight * increment;
                by_u_later[i] -= 2.0 * weight * increment;
            }
            for (of_input, by_u) in by_given.iter().zip(&by_u) {
                let sum = |to: &mut [f64], from: &[f64]| {
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += by_u * from);
                };
                sum(&mut by_start, of_input.get(Given::State));
                sum(&mut by_u_later, of_input.get(Given::AppliedInput));
                let total = gradient.get_or_insert_with(|| {
                    let mut zero = of_input.clone();
                    zero.values_mut().fill(0.0);
                    zero
                });
                sum(total.values_mut(), of_input.values());
            }
            by_x = by_start;
        }
        let Some(mut gradient) = gradient else {
            return Err(ArgumentError::Length { field: "references", expected: 1, found: 0 }.into());
        };
        gradient.get_mut(Given::State).copy_from_slice(&by_x);
        gradient.get_mut(Given::AppliedInput).copy_from_slice(&by_u_later);
        gradient.get_mut(Given::Reference).fill(0.0);
        Ok(LoopGradient { cost, gradient, irregular })
    }

    /// The cost of errors and violations at the end of step `k`; adds its gradient.
    fn add_end(
        &mut self,
        nmpc: &Nmpc,
        k: usize,
        [x, u]: [&[f64]; 2],
        [by_x, by_u]: [&mut [f64]; 2],
    ) -> f64 {
        let dims = self.plant.model.dims();
        let problem = nmpc.problem();
        let (mut y, mut c, mut d) =
            (vec![0.0; dims.ny], vec![0.0; dims.ny * dims.nx], vec![0.0; dims.ny * dims.nu]);
        let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut [] };
        self.plant.model.linearize_output(Stages { x, u, p: self.plant.p }, out);
        let mut cost = 0.0;
        let references = self.reference.at(k).iter().zip(self.given.cost.errors);
        for (tracked, (reference, weight)) in problem.tracked.iter().zip(references) {
            let value = match *tracked {
                Tracked::State(state) => x[state],
                Tracked::Output(output) => y[output],
                Tracked::Input(input) => u[input],
            };
            let error = value - reference;
            cost += weight * error * error;
            let slope = 2.0 * weight * error;
            match *tracked {
                Tracked::State(state) => by_x[state] += slope,
                Tracked::Output(output) => {
                    let row = |width: usize| output * width..(output + 1) * width;
                    add_scaled(by_x, slope, &c[row(dims.nx)]);
                    add_scaled(by_u, slope, &d[row(dims.nu)]);
                }
                Tracked::Input(input) => by_u[input] += slope,
            }
        }
        let bounds = problem.state_bounds.low.iter().zip(&problem.state_bounds.high);
        for (i, ((low, high), weight)) in bounds.zip(self.given.cost.violations).enumerate() {
            let outside = (x[i] - high).max(0.0) - (low - x[i]).max(0.0);
            cost += weight * outside * outside;
            by_x[i] += 2.0 * weight * outside;
        }
        cost
    }
}

fn add_scaled(sum: &mut [f64], factor: f64, vector: &[f64]) {
    sum.iter_mut().zip(vector).for_each(|(sum, value)| *sum += factor * value);
}

/// sum += matrix' vector
fn add_transposed(matrix: &[f64], vector: &[f64], sum: &mut [f64]) {
    let width = sum.len();
    for (row, factor) in matrix.chunks_exact(width).zip(vector) {
        add_scaled(sum, *factor, row);
    }
}
