//! Derivatives of a plan in the numbers that its problem is given.

use crate::curvature::Curvature;
use crate::data::{Given, Layout, ProblemDerivative};
use crate::entries::{self, ByParameters, Conditions, Entries};
use crate::limits::{Limit, Smoothed, rows};
use crate::system::{KktSystem, Places};
use pinc_mpc::{Constraint, MpcError, Nmpc, Program, Solution, Tracked, check_finite};
use pinc_qp::{Kind, Multipliers, OcpDims, Qp, Row, all_finite};
use std::fmt;

/// A row is about to become active or inactive if its room and its multiplier are both below this
/// many tolerances of the controller.
const MARGIN: f64 = 100.0;

/// The most steps to a smoothed plan, and the halvings of each.
const SMOOTHING_STEPS: usize = 60;
const HALVINGS: usize = 12;

/// Whether a plan is a differentiable function of the numbers that its problem is given.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Regularity {
    /// It is.
    Regular,
    /// This constraint is about to become active or inactive: the plan has a kink, and the
    /// derivatives belong to the side on which the constraint is inactive. A smoothed plan has
    /// derivatives everywhere.
    Kink(Constraint),
    /// The conditions have no unique solution near the plan, because its active constraints depend on
    /// each other or the cost does not determine it; or the model has no derivatives there.
    Singular,
    /// The plan is no solution: its step did not converge, or it was given other numbers than are
    /// said here; or there is no smoothed plan near it.
    NotOptimal,
}

/// The name, as `regular`.
impl fmt::Display for Regularity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Regular => "regular",
            Self::Kink(_) => "kink",
            Self::Singular => "singular",
            Self::NotOptimal => "not-optimal",
        })
    }
}

/// The derivatives of a plan, by the implicit function theorem: the optimality conditions hold
/// whatever the problem is given, so that
///
/// ```text
/// K (dz, dlambda, dmu) = - dF/dgiven dgiven
/// ```
///
/// with the conditions F and their Jacobian K: the exact Hessian of the Lagrangian (see
/// [`Solution`]), the dynamics, and the limits that are active. One factorization of K, a band of
/// the horizon's length, serves any number of products forward and adjoint. Second derivatives of
/// model, outputs, h, g and stage cost are central differences of the exact first ones.
///
/// Where a limit becomes active or inactive, the plan has a kink. A *smoothed* plan solves the
/// problem with the limits' complementarity relaxed to multiplier times distance = tau, as in an
/// interior-point method; it is differentiable everywhere, stays away from its limits, and for
/// tau -> 0 becomes the plan.
///
/// References: Fiacco, *Introduction to Sensitivity and Stability Analysis in Nonlinear Programming*
/// (1983); Frey et al., "Differentiable nonlinear model predictive control" (2025), for the
/// smoothing.
///
/// ```
/// use pinc_mpc::{Nmpc, NmpcProblem, SqpConfig, Weights};
/// use pinc_ode::{Model, Rk4};
/// use pinc_plants::VanDerPol;
/// use pinc_sensitivity::{Given, Regularity, Sensitivity};
///
/// let model = Rk4::new(VanDerPol::default(), 0.5, 4);
/// let problem = NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]));
/// let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
/// nmpc.step(&[0.3, 0.1], &[0.0; 10])?;
/// let mut sensitivity = Sensitivity::new(&mut nmpc, &[0.0; 10], &[0.0], None)?;
/// assert_eq!(sensitivity.regularity(), Regularity::Regular);
/// // The gradient of the first input.
/// let gradient = sensitivity.adjoint(&[], &[1.0])?;
/// assert_eq!(gradient.get(Given::State).len(), 2);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
pub struct Sensitivity<'a> {
    program: Program<'a>,
    layout: Layout,
    plan: Solution,
    qp: Qp,
    system: KktSystem,
    curvature: Curvature,
    limits: Vec<Limit>,
    entries: Entries,
    regularity: Regularity,
    /// Whether there are derivatives.
    solved: bool,
}

/// A plan and what it was made for.
pub(crate) struct Plan<'a> {
    pub(crate) x0: &'a [f64],
    pub(crate) z: &'a [f64],
    pub(crate) multipliers: &'a Multipliers,
    pub(crate) reference: &'a [f64],
    pub(crate) u_before: &'a [f64],
    pub(crate) tracked: &'a [Tracked],
}

/// What a plan was made for: its reference, and the input applied last.
#[derive(Clone, Copy, Debug)]
struct Targets<'a> {
    reference: &'a [f64],
    u_before: &'a [f64],
}

impl<'a> Sensitivity<'a> {
    /// Differentiates the plan of the controller's last step, which was given `reference` and found
    /// `u_before` applied last; `smoothing` is tau of a smoothed plan, in units of the cost.
    ///
    /// # Shapes
    ///
    /// `reference`: `[N2, outputs]`; `u_before`: `m`.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if an argument is of the wrong length or not finite, or `smoothing` not
    /// positive; or if the plan is one for scenarios, in a tube or with whole inputs.
    pub fn new(
        nmpc: &'a mut Nmpc,
        reference: &[f64],
        u_before: &[f64],
        smoothing: Option<f64>,
    ) -> Result<Self, MpcError> {
        let program = nmpc.program();
        let dims = program.constants().dims;
        if !dims.tree.is_chain() {
            return Err(MpcError::ScenarioDerivatives);
        }
        if program.nmpc().is_searched() {
            return Err(MpcError::SearchedDerivatives);
        }
        if !program.nmpc().problem().periodic.is_empty() {
            return Err(MpcError::WithOrbit("derivatives of a plan"));
        }
        if program.nmpc().tightened().is_some() {
            return Err(MpcError::WithTube("derivatives of a plan"));
        }
        let outputs = program.nmpc().problem().tracked.len();
        check_finite("reference", reference, dims.horizon * outputs)?;
        check_finite("u_before", u_before, dims.nu)?;
        if let Some(value) = smoothing.filter(|tau| !(*tau > 0.0 && tau.is_finite())) {
            let expected = "positive and finite";
            return Err(MpcError::Setting { field: "smoothing", expected, value });
        }
        let targets = Targets { reference, u_before };
        let mut sensitivity = Self::of(program);
        sensitivity.evaluate(targets);
        sensitivity.find_limits();
        match smoothing {
            None => sensitivity.differentiate(targets, None),
            Some(tau) => sensitivity.smooth(targets, tau),
        }
        Ok(sensitivity)
    }

    fn of(program: Program<'a>) -> Self {
        let (nmpc, constants) = (program.nmpc(), program.constants());
        let (problem, dims) = (nmpc.problem(), constants.dims);
        // Second derivatives couple states with both inputs beside them.
        let mut qp = match constants.s_before.is_empty() {
            true => constants.clone().with_end_cost(),
            false => constants.clone(),
        };
        program.soften(&mut qp);
        Self {
            layout: Layout::new(problem, nmpc.model().dims()),
            plan: nmpc.plan().clone(),
            qp,
            system: KktSystem::default(),
            curvature: Curvature::new(problem, dims, nmpc.model().dims()),
            limits: Vec::new(),
            entries: Entries::default(),
            regularity: Regularity::Regular,
            solved: true,
            program,
        }
    }

    /// Returns whether the plan is differentiable where it is.
    #[must_use]
    pub fn regularity(&self) -> Regularity {
        self.regularity
    }

    /// Returns the plan that is differentiated: the last step's, or the smoothed one.
    #[must_use]
    pub fn plan(&self) -> &Solution {
        &self.plan
    }

    /// Returns a change of 0 of all numbers that the problem is given.
    #[must_use]
    pub fn no_change(&self) -> ProblemDerivative {
        ProblemDerivative::new(self.layout.clone())
    }

    /// Returns by how much the plan and its multipliers change with the numbers that the problem is
    /// given, made from [`Sensitivity::no_change`]. Of a symmetric matrix only the symmetric part
    /// counts. NaN where the conditions have no unique solution.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a number of `change` is not finite.
    pub fn forward(&mut self, change: &ProblemDerivative) -> Result<Solution, MpcError> {
        let expected = self.no_change().values().len();
        check_finite("change", change.values(), expected)?;
        let dims = self.dims();
        let mut moved = Solution::new(dims);
        if !self.solved {
            moved.z.fill(f64::NAN);
            moved.multipliers.parts_mut().into_iter().for_each(|part| part.fill(f64::NAN));
            return Ok(moved);
        }
        let mut vector = vec![0.0; Places::new(dims).length];
        self.entries.apply(change.values(), &mut vector);
        self.curvature.subtract_along_parameters(
            &mut self.program,
            change.get(Given::Parameters),
            &mut vector,
        );
        self.system.solve(&mut vector);
        moved.z.copy_from_slice(&vector[..dims.unknowns()]);
        let (dynamics, limits) =
            vector[dims.unknowns()..].split_at(moved.multipliers.dynamics.len());
        moved.multipliers.dynamics.copy_from_slice(dynamics);
        set_limits(&mut moved.multipliers, limits);
        Ok(moved)
    }

    /// Returns the gradient of a function of the plan in all numbers that the problem is given,
    /// from its gradient in the planned states and inputs. Missing last numbers of the two count as
    /// 0. NaN where the conditions have no unique solution, or a number given is not finite.
    ///
    /// # Shapes
    ///
    /// `by_states`: up to `[N2, n]`; `by_inputs`: up to `[Nu, m]`: with the first m numbers, the
    /// gradient of the input to apply.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if one of them is too long.
    pub fn adjoint(
        &mut self,
        by_states: &[f64],
        by_inputs: &[f64],
    ) -> Result<ProblemDerivative, MpcError> {
        let dims = self.dims();
        check_most("by_states", by_states, dims.all_states())?;
        check_most("by_inputs", by_inputs, dims.all_inputs())?;
        let mut gradient = self.no_change();
        if !(self.solved && all_finite(by_states) && all_finite(by_inputs)) {
            gradient.values_mut().fill(f64::NAN);
            return Ok(gradient);
        }
        let mut w = vec![0.0; Places::new(dims).length];
        w[..by_states.len()].copy_from_slice(by_states);
        w[dims.all_states()..][..by_inputs.len()].copy_from_slice(by_inputs);
        self.system.solve(&mut w);
        self.entries.apply_transposed(&w, gradient.values_mut());
        self.curvature.subtract_adjoint(&mut self.program, &w, gradient.get_mut(Given::Parameters));
        Ok(gradient)
    }

    fn dims(&self) -> OcpDims {
        self.qp.dims
    }

    /// Writes the problem at the plan into `qp`.
    fn evaluate(&mut self, targets: Targets<'_>) {
        self.qp.q.copy_from_slice(&self.program.constants().q);
        [&mut self.qp.s, &mut self.qp.s_before, &mut self.qp.t]
            .into_iter()
            .for_each(|block| block.fill(0.0));
        let Targets { reference, u_before } = targets;
        self.program.evaluate(&self.plan.z, reference, u_before, &mut self.qp);
    }

    /// Finds which limits are active, in the units of the optimization, and whether the plan is
    /// optimal.
    fn find_limits(&mut self) {
        let (qp, multipliers, residual) = self.program.judge(&self.qp, &self.plan);
        let tolerance = self.program.nmpc().config().tolerance;
        let margin = MARGIN * tolerance;
        let mut judged: Vec<_> = rows(&qp).zip(limit_multipliers(&multipliers)).collect();
        let twins = join_twins(qp.dims, &mut judged, margin);
        let mut kink = None;
        self.limits.clear();
        for (i, &(row, mu)) in judged.iter().enumerate() {
            let (mut limit, side) = Limit::of(row, mu, margin);
            let place = place(qp.dims, i);
            if place.0 == Kind::Row && !has_unknowns(&qp, place.1) {
                limit = Limit::INACTIVE;
            } else if let Some(upper) = side {
                let (kind, index) = place;
                kink = kink.or(Some(self.program.name(Row { kind, index, upper })));
            }
            self.limits.push(limit);
        }
        for (row, twin) in twins {
            // Both are violated, at a weight each.
            if self.limits[twin].saturated != 0.0 {
                self.limits[row] = self.limits[twin];
            }
        }
        self.regularity = if residual.max() > 10.0 * tolerance {
            Regularity::NotOptimal
        } else {
            kink.map_or(Regularity::Regular, Regularity::Kink)
        };
    }

    /// Factors the conditions' Jacobian at the plan, and collects their derivatives in what is
    /// given.
    fn differentiate(&mut self, targets: Targets<'_>, smoothed: Option<&Smoothed>) {
        if let Some(smoothed) = smoothed {
            let multipliers = limit_multipliers(&self.plan.multipliers);
            self.limits = smoothed.linearize(&self.qp, &multipliers).0;
        }
        self.solved = self.factor(targets);
        if !self.solved {
            if self.regularity != Regularity::NotOptimal {
                self.regularity = Regularity::Singular;
            }
            return;
        }
        let dims = self.dims();
        let nmpc = self.program.nmpc();
        let (problem, p) = (nmpc.problem().clone(), nmpc.parameters().to_vec());
        let x0 = self.program.start().to_vec();
        let plan = targets.plan(&x0, &self.plan, &problem.tracked);
        let by_parameters = ByParameters::new(&mut self.program, dims, (&plan, &p));
        self.entries = Entries::new(&Conditions {
            problem: &problem,
            program: &self.program,
            layout: &self.layout,
            plan: &plan,
            qp: &self.qp,
            limits: &self.limits,
            by_start: &self.curvature.by_start,
            by_parameters: &by_parameters,
        });
    }

    /// Adds the curvature to the problem at the plan, and factors.
    fn factor(&mut self, targets: Targets<'_>) -> bool {
        let nmpc = self.program.nmpc();
        let (tracked, p) = (nmpc.problem().tracked.clone(), nmpc.parameters().to_vec());
        let x0 = self.program.start().to_vec();
        let plan = targets.plan(&x0, &self.plan, &tracked);
        self.curvature.add(&mut self.program, (&plan, &p), &mut self.qp);
        let Qp { q, s, s_before, t, a, b, .. } = &self.qp;
        let finite = [q, s, s_before, t, a, b].into_iter().all(|part| all_finite(part));
        let compliance: Vec<f64> = self.limits.iter().map(|limit| limit.compliance).collect();
        finite && self.system.factor(&self.qp, &compliance)
    }

    /// Moves the plan to the smoothed one by damped Newton steps.
    fn smooth(&mut self, targets: Targets<'_>, tau: f64) {
        if self.regularity == Regularity::NotOptimal {
            return self.differentiate(targets, None);
        }
        self.regularity = Regularity::Regular;
        let multipliers = limit_multipliers(&self.plan.multipliers);
        let mut smoothed = Smoothed::new(&self.qp, &multipliers, tau, self.program.units());
        smoothed.write_to(&self.qp, &mut self.plan.multipliers);
        for _ in 0..SMOOTHING_STEPS {
            match self.smoothing_step(targets, &smoothed) {
                Some((next, true)) => return self.differentiate(targets, Some(&next)),
                Some((next, false)) => smoothed = next,
                None => break,
            }
        }
        self.differentiate(targets, Some(&smoothed));
        self.regularity = Regularity::NotOptimal;
    }

    /// One step towards the smoothed plan, and whether it is there; `None` if no step is good.
    fn smoothing_step(
        &mut self,
        targets: Targets<'_>,
        smoothed: &Smoothed,
    ) -> Option<(Smoothed, bool)> {
        let dims = self.dims();
        let at = Places::new(dims);
        let before = self.residual(smoothed);
        let multipliers = limit_multipliers(&self.plan.multipliers);
        let (limits, right) = smoothed.linearize(&self.qp, &multipliers);
        self.limits = limits;
        let mut vector = vec![0.0; at.length];
        self.qp.lagrangian_gradient(&self.plan.multipliers, &mut vector[..dims.unknowns()]);
        vector[at.dynamics..at.bounds].copy_from_slice(&self.qp.c);
        vector[..at.bounds].iter_mut().for_each(|value| *value = -*value);
        vector[at.bounds..].copy_from_slice(&right);
        if !self.factor(targets) {
            return None;
        }
        self.system.solve(&mut vector);
        let moves = self.row_moves(&vector);
        let step = smoothed.step(&self.qp, &moves);
        let base = self.plan.clone();
        let mut length = 1.0;
        for halving in 0..HALVINGS {
            let next = smoothed.moved(&step, length);
            self.move_plan(&base, &vector, length);
            self.evaluate(targets);
            next.write_to(&self.qp, &mut self.plan.multipliers);
            let after = self.residual(&next);
            let arrived = halving == 0 && after.is_finite() && smoothed.is_small(&base.z, &vector);
            if after <= before || arrived {
                return Some((next, arrived));
            }
            length *= 0.5;
        }
        None
    }

    /// The squared residuals of the smoothed conditions.
    fn residual(&self, smoothed: &Smoothed) -> f64 {
        let mut gradient = vec![0.0; self.dims().unknowns()];
        self.qp.lagrangian_gradient(&self.plan.multipliers, &mut gradient);
        let scaled = smoothed.in_units(&gradient, &self.qp.c);
        scaled.map(|value| value * value).sum::<f64>() + smoothed.residual(&self.qp)
    }

    /// By how much the values of bounds, increments and rows change.
    fn row_moves(&self, vector: &[f64]) -> Vec<f64> {
        let (qp, dims) = (&self.qp, self.dims());
        let mut moves = vector[..dims.unknowns()].to_vec();
        for v in dims.all_states()..dims.unknowns() {
            let before = if v < dims.all_states() + dims.nu { 0.0 } else { vector[v - dims.nu] };
            moves.push(vector[v] - before);
        }
        for row in 0..dims.all_rows() {
            let slopes = entries::row_slopes(qp, row);
            moves.push(slopes.into_iter().map(|(v, slope)| slope * vector[v]).sum());
        }
        moves
    }

    /// Moves states, inputs and all multipliers along a step from `base`.
    fn move_plan(&mut self, base: &Solution, step: &[f64], length: f64) {
        for ((to, from), step) in self.plan.z.iter_mut().zip(&base.z).zip(step) {
            *to = from + length * step;
        }
        let from = base.multipliers.parts().into_iter().flatten();
        let to = self.plan.multipliers.parts_mut().into_iter().flatten();
        for ((to, from), step) in to.zip(from).zip(&step[base.z.len()..]) {
            *to = from + length * step;
        }
    }
}

impl<'a> Targets<'a> {
    fn plan(self, x0: &'a [f64], solution: &'a Solution, tracked: &'a [Tracked]) -> Plan<'a> {
        let Self { reference, u_before } = self;
        let Solution { z, multipliers, .. } = solution;
        Plan { x0, z, multipliers, reference, u_before, tracked }
    }
}

impl Smoothed {
    /// Writes its multipliers to a plan's.
    fn write_to(&self, qp: &Qp, multipliers: &mut Multipliers) {
        let mut limits = limit_multipliers(multipliers);
        self.write(qp, &mut limits);
        set_limits(multipliers, &limits);
    }
}

/// The multipliers of bounds, increments and rows.
fn limit_multipliers(multipliers: &Multipliers) -> Vec<f64> {
    let [_, bounds, increments, rows] = multipliers.parts();
    [bounds, increments, rows].concat()
}

fn set_limits(multipliers: &mut Multipliers, from: &[f64]) {
    let [_, bounds, increments, rows] = multipliers.parts_mut();
    let all = bounds.iter_mut().chain(increments).chain(rows);
    all.zip(from).for_each(|(to, from)| *to = *from);
}

/// The kind of limit `i` of all, and its place among its kind.
fn place(dims: OcpDims, i: usize) -> (Kind, usize) {
    match i.checked_sub(dims.unknowns()) {
        None => (Kind::Bound, i),
        Some(i) => match i.checked_sub(dims.all_inputs()) {
            None => (Kind::Increment, i),
            Some(row) => (Kind::Row, row),
        },
    }
}

/// Where an input is held, an output that depends on it is the same before and after a control step:
/// of two such rows with the same limits the first gets the multipliers and penalties of both, and the
/// second, whose places are returned, no limits.
fn join_twins(dims: OcpDims, judged: &mut [([f64; 3], f64)], margin: f64) -> Vec<(usize, usize)> {
    let same = |a: f64, b: f64| a.total_cmp(&b).is_eq() || (a - b).abs() <= margin;
    let first = dims.unknowns() + dims.all_inputs();
    let mut twins = Vec::new();
    for j in dims.stages_with_rows().skip(1) {
        let (end, start) = (dims.rows_at_end(j - 1), dims.rows_at_start(j));
        if end.input != start.input {
            continue;
        }
        for (twin, row) in end.rows.zip(start.rows).map(|(twin, row)| (first + twin, first + row)) {
            let ([low, high, penalty], mu) = judged[row];
            if same(low, judged[twin].0[0]) && same(high, judged[twin].0[1]) {
                judged[twin].0[2] += penalty;
                judged[twin].1 += mu;
                judged[row] = ([f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY], 0.0);
                twins.push((row, twin));
            }
        }
    }
    twins
}

/// Whether a row depends on the unknowns: outputs at the measured state may not.
fn has_unknowns(qp: &Qp, row: usize) -> bool {
    entries::row_slopes(qp, row).iter().any(|(_, slope)| *slope != 0.0)
}

/// Whether a gradient has no more numbers than `most`.
fn check_most(field: &'static str, values: &[f64], most: usize) -> Result<(), MpcError> {
    let found = values.len();
    let fits = found <= most;
    if fits { Ok(()) } else { Err(MpcError::Range { field, low: 0, high: most, found }) }
}
