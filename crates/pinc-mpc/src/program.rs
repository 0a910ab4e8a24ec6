//! The optimization problem of a control step, evaluated at any plan.

use crate::constraints::ConstraintWork;
use crate::cost::Targets;
use crate::stage_cost::{QuadBlock, StagePoint};
use crate::{Bounds, Constraint, IntervalEnd, KktResidual, Nmpc, Solution};
use pinc_ode::{Gradients, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};
use pinc_qp::{Multipliers, Qp, Row};

/// The optimization problem of a controller's last step, in the plant's units, for whoever
/// differentiates it. See [`Solution`] for its unknowns z and its rows.
#[derive(Debug)]
pub struct Program<'a>(&'a mut Nmpc);

/// An output at the end of an interval.
#[derive(Clone, Copy, Debug)]
pub struct OutputPoint<'a> {
    /// Its value.
    pub y: f64,
    /// Its derivatives in the state, `n`.
    pub by_x: &'a [f64],
    /// Its derivatives in the input, `m`.
    pub by_u: &'a [f64],
}

impl Nmpc {
    /// Returns the optimization problem of the last step.
    pub fn program(&mut self) -> Program<'_> {
        Program(self)
    }
}

impl Program<'_> {
    /// Returns the controller.
    #[must_use]
    pub fn nmpc(&self) -> &Nmpc {
        self.0
    }

    /// Returns the state in which the plan begins, `n`.
    #[must_use]
    pub fn start(&self) -> &[f64] {
        &self.0.start
    }

    /// Returns the quadratic program with its constant numbers.
    #[must_use]
    pub fn constants(&self) -> &Qp {
        self.0.sqp.transcription.plain()
    }

    /// Gives a program of [`Program::constants`] the weights of violations that the last step needed.
    pub fn soften(&self, qp: &mut Qp) {
        self.0.sqp.soften(qp);
    }

    /// Linearizes the problem at `z` for a reference, `[N2, outputs]`, and the input applied last;
    /// `qp` was made from [`Program::constants`].
    pub fn evaluate(&mut self, z: &[f64], reference: &[f64], u_before: &[f64], qp: &mut Qp) {
        let Nmpc { horizon, sqp, start, .. } = &mut *self.0;
        let targets = Targets { reference, previous: u_before };
        sqp.transcription.evaluate_plain(horizon, [start, z], targets, qp);
        sqp.transcription.take_linearized();
    }

    /// Returns a program that was evaluated at the plan `at`, and its multipliers, both in the units
    /// of the optimization, and how far the plan is from optimal.
    #[must_use]
    pub fn judge(&self, qp: &Qp, at: &Solution) -> (Qp, Multipliers, KktResidual) {
        let (mut qp, mut at) = (qp.clone(), at.clone());
        let units = &self.0.sqp.transcription.units;
        if !units.is_identity() {
            units.scale_constants(&mut qp);
            units.scale_constraints(&mut qp);
            units.scale_cost(&mut qp, 0.0);
            units.convert(&mut at.multipliers, false);
        }
        let residual = KktResidual::new(&qp, &at, &mut vec![0.0; qp.gradient.len()]);
        (qp, at.multipliers, residual)
    }

    /// Returns the model of a stage and the controller's parameters.
    pub fn model(&mut self, stage: usize) -> (&mut dyn Model, &[f64]) {
        let Nmpc { horizon, parameters, .. } = &mut *self.0;
        (horizon.at(stage), parameters)
    }

    /// Returns the units of the optimization, as multiples of the plant's own: those of the bounds on z,
    /// of the increments and of all rows, and that of the cost.
    #[must_use]
    pub fn units(&self) -> (Vec<f64>, f64) {
        self.0.sqp.transcription.units.of_limits()
    }

    /// Linearizes the models of all stages, each at its own point.
    pub fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.0.horizon.linearize(0..usize::MAX, at, out, &mut || false);
    }

    /// Writes the gradients of w'F(x, u, p) of the models of all stages, each at its own point: see
    /// [`LinearizationBuffer::gradients`].
    pub fn gradients(
        &mut self,
        at: Stages<'_>,
        weights: &[f64],
        out: Gradients<'_>,
        room: &mut LinearizationBuffer,
    ) {
        self.0.horizon.gradients(at, weights, out, room);
    }

    /// Linearizes the outputs of the model of a stage.
    pub fn linearize_output(&mut self, stage: usize, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.0.horizon.at(stage).linearize_output(at, out);
    }

    /// Writes h and g at a point and their Jacobians in x and u; returns whether there are any.
    pub fn linearize_constraints(
        &self,
        at: [&[f64]; 2],
        values: &mut [f64],
        jacobians: [&mut [f64]; 2],
    ) -> bool {
        let Some(constraints) = &self.0.problem.constraints else { return false };
        let mut work = ConstraintWork::new(self.0.horizon.dims(), values.len());
        constraints.linearize(at, values, jacobians, &mut work);
        true
    }

    /// Adds the stage cost at a point to `block`; returns whether there is one.
    pub fn add_stage_cost(
        &mut self,
        stage: usize,
        [x, u, p]: [&[f64]; 3],
        block: &mut QuadBlock,
    ) -> bool {
        let Some(terms) = &mut self.0.sqp.transcription.terms else { return false };
        let time_s = terms.time_s(stage);
        let Some(cost) = &mut terms.cost else { return false };
        cost.quadratize(StagePoint { stage, time_s, x, u, p }, block);
        true
    }

    /// Returns whether there is a stage cost.
    #[must_use]
    pub fn has_stage_cost(&self) -> bool {
        self.0.sqp.transcription.terms.as_ref().is_some_and(|terms| terms.cost.is_some())
    }

    /// Returns an output at the end of the interval that leads to stage `j`, from 1 on, where the
    /// problem was evaluated last; `None` if the problem uses no outputs.
    #[must_use]
    pub fn output(&self, j: usize, output: usize) -> Option<OutputPoint<'_>> {
        let points = self.0.sqp.transcription.outputs.as_ref()?.ends();
        let [by_x, by_u] = points.rows(j, output);
        Some(OutputPoint { y: points.y(j)[output], by_x, by_u })
    }

    /// Returns whether outputs are tracked or bounded.
    #[must_use]
    pub fn uses_outputs(&self) -> bool {
        self.0.problem.uses_outputs()
    }

    /// Returns the output of each row for outputs of a stage, and at which end of an interval the
    /// row is, if that matters.
    pub fn output_rows(&self) -> impl Iterator<Item = (usize, Option<IntervalEnd>)> {
        self.0.sqp.transcription.output_rows.iter()
    }

    /// Returns 2 Q of stage `j`, from 1 on, `[outputs, outputs]`.
    #[must_use]
    pub fn tracking_weight(&self, j: usize) -> &[f64] {
        self.0.sqp.transcription.cost.tracking_weight(j)
    }

    /// Returns the bounds on z and on all increments.
    #[must_use]
    pub fn bounds(&self) -> [&Bounds; 2] {
        let transcription = &self.0.sqp.transcription;
        [&transcription.bounds, &transcription.increments]
    }

    /// Returns the constraint that a row of the program is.
    #[must_use]
    pub fn name(&self, row: Row) -> Constraint {
        self.0.sqp.transcription.name(row)
    }
}
