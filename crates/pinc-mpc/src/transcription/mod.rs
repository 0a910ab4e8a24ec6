//! From the control problem to quadratic programs: direct multiple shooting.

mod tube;

use crate::constraint::Constraint;
use crate::constraints::ConstraintWork;
use crate::cost::{Cost, Targets};
use crate::curvature::{At, Curvature, Purpose};
use crate::horizon::Horizon;
use crate::linearization_cache::LinearizationCache;
use crate::outputs::{IntervalEnd, OutputRows, Outputs};
use crate::scenarios::Nodes;
use crate::solution::Solution;
use crate::stage_cost::StageCost;
use crate::stage_terms::StageTerms;
use crate::timetable::Part;
use crate::units::Units;
use crate::{BoundSchedule, Bounds, Constraints, NmpcProblem};
use pinc_ode::Memory;
use pinc_qp::{Multipliers, OcpDims, Qp, Row, all_finite};
use pinc_tube::Tightening;
use std::ops::Range;

/// The control problem in the unknowns z, and its linearization.
#[derive(Debug)]
pub(crate) struct Transcription {
    dims: OcpDims,
    pub(crate) cost: Cost,
    pub(crate) terms: Option<StageTerms>,
    /// What the Gauss-Newton Hessian leaves out; away while it is computed.
    curvature: Option<Box<Curvature>>,
    /// Bounds on z.
    pub(crate) bounds: Bounds,
    /// Bounds on all increments.
    pub(crate) increments: Bounds,
    /// What tightens bounds on z and on outputs.
    tightening: Option<Tightening>,
    following: tube::Following,
    /// Whether there are bounds on increments.
    limits_increments: bool,
    /// Bounds on the outputs at all constrained stages, at the ends of the intervals and at their starts.
    output_bounds: [Bounds; 2],
    pub(crate) constraints: Option<Constraints>,
    work: ConstraintWork,
    pub(crate) cache: LinearizationCache,
    pub(crate) outputs: Option<Outputs>,
    pub(crate) output_rows: OutputRows,
    pub(crate) units: Units,
    /// The places in z of the states that end where they begin, and their places in the state.
    orbit: Vec<[usize; 2]>,
    /// The program's constant numbers, in the plant's units.
    plain: Qp,
}

impl Transcription {
    pub(crate) fn new(
        problem: &NmpcProblem,
        horizon: &Horizon,
        stage_cost: Option<Box<dyn StageCost>>,
    ) -> Self {
        let (model, feedthrough) = (horizon.dims(), horizon.feedthrough());
        let output_rows = OutputRows::new(problem, model, feedthrough);
        let dims = problem.ocp_dims(model, &output_rows);
        let nodes = Nodes::new(problem, dims);
        let depths = |nodes: Range<usize>, first: usize| {
            let each = nodes.map(|node| dims.tree.depth(node));
            each.map(move |depth| depth - first)
        };
        let states = problem.state_bounds.expand(dims.nx, depths(1..dims.horizon + 1, 1));
        let inputs = problem.input_bounds.expand(dims.nu, depths(0..dims.n_controls, 0));
        let increments = problem.increment_bounds.expand(dims.nu, depths(0..dims.n_controls, 0));
        let cost = Cost::new(problem, dims, &nodes);
        let outputs = |b: &Bounds| b.expand(model.ny, depths(dims.constrained(), problem.n1));
        let output_bounds = problem.output_bounds.as_ref().map_or(Bounds::none(0), outputs);
        let constant = cost.state_hessians();
        let terms = StageTerms::new(problem, (dims, &nodes), constant, stage_cost, horizon.times());
        let mut transcription = Self {
            dims,
            curvature: Some(Box::new(Curvature::new(dims, nodes.clone(), horizon))),
            terms,
            plain: Qp::new(dims, cost.state_hessians(), cost.increment_hessians()),
            cost,
            bounds: states.chain(inputs),
            orbit: problem.periodic.iter().map(|&i| [dims.all_states() - dims.nx + i, i]).collect(),
            limits_increments: increments.low.iter().chain(&increments.high).any(|b| b.is_finite()),
            increments,
            tightening: None,
            following: tube::Following::default(),
            output_bounds: [output_bounds.clone(), output_bounds],
            constraints: problem.constraints.clone(),
            work: ConstraintWork::new(model, dims.general()),
            cache: LinearizationCache::new(dims, problem),
            outputs: problem.uses_outputs().then(|| Outputs::new(dims, model)),
            units: Units::new(problem, dims, &output_rows),
            output_rows,
        };
        transcription.close_orbit(&vec![0.0; dims.nx]);
        transcription.set_constants(problem, feedthrough, &nodes);
        transcription
    }

    /// Writes the numbers that stay: Hessian, penalties, and limits that are finite where they are.
    fn set_constants(&mut self, problem: &NmpcProblem, feedthrough: &[bool], nodes: &Nodes) {
        let (dims, qp) = (self.dims, &mut self.plain);
        qp.w = self.cost.input_hessian();
        if problem.tracks_feedthrough(feedthrough) {
            *qp = qp.clone().with_end_cost();
        } else if self.terms.is_some() {
            *qp = qp.clone().with_stage_cost();
        }
        qp.bounds.low.copy_from_slice(&self.bounds.low);
        qp.bounds.high.copy_from_slice(&self.bounds.high);
        for (v, penalty) in qp.bounds.penalty[..dims.all_states()].iter_mut().enumerate() {
            let (node, i) = (v / dims.nx + 1, v % dims.nx);
            let at_end = dims.tree.depth(node) == problem.horizon;
            *penalty = nodes.weights[node] * problem.state_penalty(i, at_end);
        }
        qp.increments.low.copy_from_slice(&self.increments.low);
        qp.increments.high.copy_from_slice(&self.increments.high);
        for j in dims.constrained() {
            let ((general, outputs), part) = (split_rows(dims, j), nodes.weights[j]);
            for (i, row) in general.enumerate() {
                qp.rows.penalty[row] = part * problem.constraint_softness.penalty(i);
                qp.rows.high[row] = 0.0;
                qp.rows.low[row] = if i < dims.inequalities { f64::NEG_INFINITY } else { 0.0 };
            }
            for (row, of) in outputs.zip(self.output_rows.iter()) {
                qp.rows.penalty[row] = part * problem.output_softness.penalty(of.0);
                [qp.rows.low[row], qp.rows.high[row]] =
                    output_limits(&self.output_bounds, dims, j, of);
            }
        }
        self.units.choose_cost(&self.plain.q, &self.plain.r);
    }

    /// A program that has room for the exact Hessian: of products of states with the inputs that led
    /// there as well, where outputs depend on them.
    pub(crate) fn curved_qp(&self) -> Qp {
        let qp = self.qp();
        match qp.s_before.is_empty() && self.dims.feedthrough == 0 {
            true if qp.has_stage_cost() => qp,
            true => qp.with_stage_cost(),
            false => qp.with_end_cost(),
        }
    }

    /// The program with its constant numbers, in the units that there are.
    pub(crate) fn qp(&self) -> Qp {
        let mut qp = self.plain.clone();
        if !self.units.is_identity() {
            self.units.scale_constants(&mut qp);
        }
        qp
    }

    /// Chooses the units for a plant that is at `x0`; whether they changed.
    pub(crate) fn choose_units(&mut self, x0: &[f64], targets: Option<Targets<'_>>) -> bool {
        let changed = self.units.follow(x0, targets);
        if changed {
            self.units.choose_cost(&self.plain.q, &self.plain.r);
        }
        changed
    }

    /// Sets the parameters.
    pub(crate) fn set_parameters(&mut self, p: &[f64]) {
        self.cache.set_parameters(p);
    }

    /// Sets the parameters of each stage, or the last of them; whether they changed.
    pub(crate) fn set_stage_parameters<'p>(&mut self, of: impl Fn(usize) -> &'p [f64]) -> bool {
        self.cache.set_stage_parameters(of)
    }

    /// Sets the bounds of all stages, each of which covers some steps of `schedule`. At the end of a
    /// stage the bounds of the step that begins there hold too, where they are known.
    pub(crate) fn set_bounds(
        &mut self,
        schedule: &BoundSchedule,
        covered: impl Fn(usize) -> Range<usize>,
        preview: bool,
    ) {
        let dims = self.dims;
        let width = dims.outputs + dims.feedthrough;
        let [ends, starts] = &mut self.output_bounds;
        let own = [&mut self.bounds, ends, starts];
        let [[low, high], [y_low, y_high], at_starts] = match &mut self.tightening {
            Some(tightening) => tightening.given.each_mut().map(|sides| sides.each_mut()),
            None => own.map(|of| [&mut of.low, &mut of.high]),
        };
        for stage in 0..dims.horizon {
            let Range { start, end } = covered(stage);
            let state = dims.next_state(stage);
            let until = end + usize::from(preview);
            let sides = (&mut low[state.clone()], &mut high[state]);
            schedule.write(start..until, Part::State, |_| true, sides);
            if stage < dims.n_controls {
                let input = dims.input(stage);
                let sides = (&mut low[input.clone()], &mut high[input]);
                schedule.write(start..end, Part::Input, |_| true, sides);
            }
            if let Some(row) = (stage + 1).checked_sub(dims.n1).filter(|_| width > 0) {
                let output = row * width..(row + 1) * width;
                let (low, high) = (&mut y_low[output.clone()], &mut y_high[output]);
                let jumps = |output| self.output_rows.has_both_ends(output);
                schedule.write(start..end, Part::Output, jumps, (low, high));
                // As a state's, its one value at a mark is bounded by both steps.
                schedule.write(start..until, Part::Output, |output| !jumps(output), (low, high));
            }
        }
        for (to, from) in at_starts.into_iter().zip([y_low, y_high]) {
            self.output_rows.copy_starts(from, to);
        }
    }

    /// Makes the plan from `x0` end there, in the states that are periodic.
    pub(crate) fn close_orbit(&mut self, x0: &[f64]) {
        for &[at, state] in &self.orbit {
            (self.bounds.low[at], self.bounds.high[at]) = (x0[state], x0[state]);
        }
    }

    /// At how many stages the model has been linearized since this was last asked.
    pub(crate) fn take_linearized(&mut self) -> usize {
        let of_curvature = self.curvature.as_mut().map(|of| std::mem::take(&mut of.evaluated));
        std::mem::take(&mut self.cache.evaluated) + of_curvature.unwrap_or(0)
    }

    /// Sets the time of the first stage in s.
    pub(crate) fn set_time(&mut self, now_s: f64) {
        if let Some(terms) = &mut self.terms {
            terms.set_time(now_s);
        }
    }

    /// Whether a stage cost leaves its Hessian to the optimization.
    pub(crate) fn leaves_out_hessian(&self) -> bool {
        self.terms.as_ref().is_some_and(StageTerms::leaves_out_hessian)
    }

    /// Writes `plain`, which was measured at the plan, with the exact Hessian of the Lagrangian to
    /// `qp`: see [`Curvature::add`].
    #[inline(never)]
    pub(crate) fn curve(
        &mut self,
        horizon: &mut Horizon,
        at: At<'_>,
        (plain, qp): (&Qp, &mut Qp),
        purpose: Purpose,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        qp.copy_from(plain);
        let mut curvature = self.curvature.take()?;
        let found = curvature.add(horizon, self, at, qp, purpose, expired);
        self.curvature = Some(curvature);
        found
    }

    /// Whether the last program with the exact Hessian is right for the given active rows only.
    pub(crate) fn holds(&self) -> bool {
        self.curvature.as_ref().is_some_and(|of| of.holds())
    }

    /// The parameters of a stage, or from its end on.
    pub(crate) fn parameters(&self, stage: usize, after: bool) -> &[f64] {
        if after { self.cache.parameters_after(stage) } else { self.cache.parameters(stage) }
    }

    /// Linearizes h and g at a point.
    pub(crate) fn linearize_general(
        &mut self,
        point: [&[f64]; 2],
        values: &mut [f64],
        jacobians: [&mut [f64]; 2],
    ) {
        if let Some(constraints) = &self.constraints {
            constraints.linearize(point, values, jacobians, &mut self.work);
        }
    }

    /// Moves the plan's inputs into their bounds and into the bounds of their increments. An input that
    /// is not finite becomes the one before it.
    pub(crate) fn project(&self, plan: &mut Solution, previous: &[f64]) {
        let (first, m) = (self.dims.all_states(), self.dims.nu);
        let inputs = &mut plan.z[first..];
        let bounds = self.bounds.low[first..].iter().zip(&self.bounds.high[first..]);
        if !self.limits_increments && all_finite(inputs) {
            for (u, (&least, &most)) in inputs.iter_mut().zip(bounds) {
                *u = u.max(least).min(most);
            }
            return;
        }
        for v in 0..inputs.len() {
            let before = self.dims.entry_before(v).map_or(previous[v % m], |at| inputs[at]);
            let wanted = if inputs[v].is_finite() { inputs[v] } else { before };
            let [least, most] = self.reach(v, before);
            inputs[v] = wanted.max(least).min(most);
        }
    }

    /// The least and the most that input `v` of all may be after the input `before`. From outside its
    /// bounds an input may go as far as to the nearest.
    pub(crate) fn reach(&self, v: usize, before: f64) -> [f64; 2] {
        let at = self.dims.all_states() + v;
        let (least, most) = (self.bounds.low[at], self.bounds.high[at]);
        let low = (before + self.increments.low[v]).min(most);
        let high = (before + self.increments.high[v]).max(least);
        // With a finite input before, low <= high.
        [low.max(least), high.min(most)]
    }

    /// Clears the multipliers of limits that are infinite, as after a shift from limited stages.
    pub(crate) fn clear_unlimited(&self, of: &mut Multipliers) {
        let Multipliers { bounds, increments, .. } = of;
        for (limits, mu) in [(&self.bounds, bounds), (&self.increments, increments)] {
            for (mu, (low, high)) in mu.iter_mut().zip(limits.low.iter().zip(&limits.high)) {
                if (if *mu > 0.0 { high } else { low }).is_infinite() {
                    *mu = 0.0;
                }
            }
        }
    }

    /// The input before input `v` of all.
    fn before(&self, v: usize, z: &[f64], previous: &[f64]) -> f64 {
        match self.dims.entry_before(v) {
            None => previous[v],
            Some(before) => z[self.dims.all_states() + before],
        }
    }

    /// Linearizes the model, its outputs and h and g at `z`, for a plant measured to be at `x0`;
    /// whether it came to the end before `expired` said that the time is up.
    pub(crate) fn linearize(
        &mut self,
        horizon: &mut Horizon,
        [x0, z]: [&[f64]; 2],
        qp: &mut Qp,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        if !self.linearize_plain(horizon, [x0, z], qp, expired) {
            return false;
        }
        if !self.units.are_plain() {
            self.units.scale_constraints(qp);
        }
        true
    }

    /// [`Transcription::linearize`] in the plant's units.
    #[inline(never)]
    fn linearize_plain(
        &mut self,
        horizon: &mut Horizon,
        [x0, z]: [&[f64]; 2],
        qp: &mut Qp,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        if !self.cache.follow(horizon, [x0, z], expired) {
            return false;
        }
        if self.following.is_anew {
            self.tighten_along(0);
        }
        let [next, a, b] = self.cache.parts();
        qp.a.copy_from_slice(a);
        qp.b.copy_from_slice(b);
        for ((c, next), z) in qp.c.iter_mut().zip(next).zip(z) {
            *c = next - z;
        }
        self.linearize_constraints(z, qp);
        if let Some(outputs) = &mut self.outputs {
            outputs.follow(horizon, self.dims, [x0, z], &self.cache);
            self.limit_outputs(qp);
        }
        true
    }

    /// Chooses the unit of a cost that has no weights by its slope at the first plan `z`, which `qp`
    /// is measured at; whether it changed.
    #[inline(never)]
    pub(crate) fn choose_cost(
        &mut self,
        [x0, z]: [&[f64]; 2],
        targets: Targets<'_>,
        qp: &mut Qp,
    ) -> bool {
        if !self.leaves_out_hessian() || !self.units.wants_slope() {
            return false;
        }
        self.measure(x0, z, targets, qp);
        self.units.set_slope(&qp.gradient);
        let before = self.units.plain_cost(1.0).to_bits();
        self.units.choose_cost(&self.plain.q, &self.plain.r);
        before != self.units.plain_cost(1.0).to_bits()
    }

    /// Forgets where the model was linearized, the units chosen there, and the bounds tightened along it;
    /// whether units change.
    pub(crate) fn forget(&mut self) -> bool {
        self.release_bounds();
        self.cache.forget();
        self.curvature.iter_mut().for_each(|of| of.recent.forget());
        self.units.forget_slope();
        let changed = self.units.forget();
        if changed {
            self.units.choose_cost(&self.plain.q, &self.plain.r);
        }
        changed
    }

    /// Saves or restores the units, second derivatives, and what a tube follows: where the models were linearized last.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>, horizon: &mut Horizon) {
        self.units.remember(memory);
        self.curvature.iter_mut().for_each(|of| of.recent.remember(memory));
        if memory.restores() {
            self.units.choose_cost(&self.plain.q, &self.plain.r);
        }
        if self.is_tightened() {
            self.remember_bounds(memory);
            self.cache.remember(memory, horizon);
        }
    }

    /// Writes the cost's derivatives at `z` and the distances to the bounds into `qp`, and returns
    /// the cost J. Outputs come from the last linearization.
    pub(crate) fn measure(
        &mut self,
        x0: &[f64],
        z: &[f64],
        targets: Targets<'_>,
        qp: &mut Qp,
    ) -> f64 {
        let cost = self.measure_plain(x0, z, targets, qp);
        if self.units.is_identity() { cost } else { self.units.scale_cost(qp, cost) }
    }

    /// [`Transcription::measure`] in the plant's units.
    #[inline(never)]
    fn measure_plain(&mut self, x0: &[f64], z: &[f64], targets: Targets<'_>, qp: &mut Qp) -> f64 {
        self.limit(z, targets.previous, qp);
        let mut cost = self.cost.gradient(z, targets, &mut qp.gradient);
        if let Some(terms) = &mut self.terms {
            let at = ([x0, z], &self.cache);
            cost += terms.add(&self.cost, self.outputs.as_ref(), at, targets, qp);
        }
        cost
    }

    /// The program's constant numbers, in the plant's units.
    pub(crate) fn plain(&self) -> &Qp {
        &self.plain
    }

    /// Writes the problem at `z` into `qp`, made from [`Transcription::plain`], in the plant's units.
    pub(crate) fn evaluate_plain(
        &mut self,
        horizon: &mut Horizon,
        [x0, z]: [&[f64]; 2],
        targets: Targets<'_>,
        qp: &mut Qp,
    ) {
        self.linearize_plain(horizon, [x0, z], qp, &mut || false);
        self.measure_plain(x0, z, targets, qp);
    }

    /// h and g: their values go, with the sign changed, to the limits.
    #[inline(never)]
    fn linearize_constraints(&mut self, z: &[f64], qp: &mut Qp) {
        let Some(constraints) = &self.constraints else { return };
        let dims = self.dims;
        let (n, m) = (dims.nx, dims.nu);
        for j in dims.constrained() {
            let ((rows, _), x) = (split_rows(dims, j), dims.next_state(j - 1));
            let u = dims.input(dims.acting(j));
            let by_x = &mut qp.rows_x[rows.start * n..rows.end * n];
            let by_u = &mut qp.rows_u[rows.start * m..rows.end * m];
            let values = &mut qp.rows.high[rows.clone()];
            constraints.linearize([&z[x], &z[u]], values, [by_x, by_u], &mut self.work);
            values.iter_mut().for_each(|value| *value = -*value);
            let equalities = rows.skip(dims.inequalities);
            equalities.for_each(|row| qp.rows.low[row] = qp.rows.high[row]);
        }
    }

    /// The rows of bounded outputs.
    #[inline(never)]
    fn limit_outputs(&self, qp: &mut Qp) {
        let (dims, Some(outputs)) = (self.dims, &self.outputs) else { return };
        let (n, m) = (dims.nx, dims.nu);
        for j in dims.constrained() {
            let (_, rows) = split_rows(dims, j);
            for (row, of @ (output, end)) in rows.zip(self.output_rows.iter()) {
                let points = outputs.at(end);
                let ([c, d], y) = (points.rows(j, output), points.y(j)[output]);
                qp.rows_x[row * n..(row + 1) * n].copy_from_slice(c);
                qp.rows_u[row * m..(row + 1) * m].copy_from_slice(d);
                let limits = output_limits(&self.output_bounds, dims, j, of);
                [qp.rows.low[row], qp.rows.high[row]] = limits.map(|limit| limit - y);
            }
        }
        admit_given(qp);
    }

    /// Moves the measured state of a program that is linearized for a plant at `prepared` to `x0`.
    pub(crate) fn move_measured(&self, [x0, prepared]: [&[f64]; 2], qp: &mut Qp) {
        let (n, units) = (self.dims.nx, &self.units.x);
        let moved = |row: &[f64]| -> f64 {
            let moved = row.iter().zip(x0.iter().zip(prepared)).zip(units);
            moved.map(|((a, (x, prepared)), unit)| a * ((x - prepared) / unit)).sum()
        };
        let first = n * self.dims.stages_from(0).len();
        for (c, row) in qp.c.iter_mut().zip(qp.a.chunks_exact(n)).take(first) {
            *c += moved(row);
        }
        for row in rows_at_measured(self.dims) {
            let change = moved(&qp.rows_x[row * n..(row + 1) * n]);
            qp.rows.low[row] -= change;
            qp.rows.high[row] -= change;
        }
        admit_given(qp);
    }

    /// The constraint that a row of the program is.
    pub(crate) fn name(&self, row: Row) -> Constraint {
        Constraint::new(self.dims, (&self.bounds, &self.output_rows), row)
    }

    /// The limits of bounds and increments: what is left of them at z.
    fn limit(&self, z: &[f64], previous: &[f64], qp: &mut Qp) {
        let sides =
            [(&mut qp.bounds.low, &self.bounds.low), (&mut qp.bounds.high, &self.bounds.high)];
        for (left, bounds) in sides {
            let bounds = bounds.iter().zip(z);
            left.iter_mut().zip(bounds).for_each(|(left, (bound, z))| *left = bound - z);
        }
        if !self.limits_increments {
            // They are infinite, and stay so.
            return;
        }
        let (first, m) = (self.dims.all_states(), self.dims.nu);
        for v in 0..self.dims.all_inputs() {
            let before = self.before(v, z, previous);
            let increment = z[first + v] - before;
            // The first input may always go as far as to its nearest bound.
            let reach = |bound: f64| if v < m { bound - before } else { 0.0 };
            let low = self.increments.low[v].min(reach(self.bounds.high[first + v]));
            let high = self.increments.high[v].max(reach(self.bounds.low[first + v]));
            qp.increments.low[v] = low - increment;
            qp.increments.high[v] = high - increment;
        }
    }
}

/// The rows of h, g and outputs at stage `j`.
fn split_rows(dims: OcpDims, j: usize) -> (Range<usize>, Range<usize>) {
    let Range { start, end } = dims.stage_rows(j);
    (start..start + dims.general(), start + dims.general()..end)
}

/// The bounds of a row for an output at stage `j`.
fn output_limits(
    [ends, starts]: &[Bounds; 2],
    dims: OcpDims,
    j: usize,
    (output, end): (usize, Option<IntervalEnd>),
) -> [f64; 2] {
    let at = (j - dims.n1) * (dims.outputs + dims.feedthrough) + output;
    let bounds = match end {
        Some(IntervalEnd::Start) => starts,
        Some(IntervalEnd::End) | None => ends,
    };
    [bounds.low[at], bounds.high[at]]
}

/// The rows of outputs at the measured state.
fn rows_at_measured(dims: OcpDims) -> impl Iterator<Item = usize> {
    let stages = if dims.n1 == 1 { dims.stages_from(0) } else { 0..0 };
    stages.flat_map(move |stage| dims.rows_at_start(stage + 1).rows)
}

/// Where an output at the measured state does not change with the input after all, hard bounds admit its
/// value. What soft ones cost stays: the derivative may vanish at one input only.
pub(crate) fn admit_given(qp: &mut Qp) {
    let m = qp.dims.nu;
    for row in rows_at_measured(qp.dims) {
        let is_given = qp.rows_u[row * m..(row + 1) * m].iter().all(|d| d.abs() <= 0.0);
        if is_given && qp.rows.penalty[row].is_infinite() {
            qp.rows.low[row] = qp.rows.low[row].min(0.0);
            qp.rows.high[row] = qp.rows.high[row].max(0.0);
        }
    }
}
