//! The exact Hessian of the Lagrangian, in place of the Gauss-Newton Hessian.

use crate::IntervalEnd;
use crate::cost::Targets;
use crate::horizon::Horizon;
use crate::scenarios::Nodes;
use crate::solution::Solution;
use crate::stage_cost::{QuadBlock, StagePoint};
use crate::transcription::Transcription;
use crate::units::Units;
use pinc_ode::{Gradients, LinearizationBuffer, OutputLinearization, Recent, Stages};
use pinc_qp::{Convexifier, Convexity, OcpDims, Qp, all_finite, symmetrize};

/// A difference quotient is taken over this part of a variable's size: the cube root of the precision.
const STEP: f64 = 6e-6;

/// Second derivatives count again where nothing that they depend on has moved by more than this part of
/// its size: programs are then as many as with those of their own place, which they are not with 1e-3.
const NEAR: f64 = 1e-4;

/// A variable whose size only the plan shows is at least this large.
pub const LEAST_SIZE: f64 = 1e-9;

/// The second derivatives of the Lagrangian, stage by stage and node by node, of what depends on one
/// state and one input:
///
/// ```text
/// part l(x, u) + lambda' f(x, u) + eta' y(x, u)      at x_j and the input that acts there
/// eta' (h(x, u), g(x, u))                            likewise
/// (2 Q e + eta)' y(x, u)                             at x_j and the input that led there
/// ```
///
/// by differences of its gradient, which is exact. At a kink, where the difference quotients of the
/// two sides disagree, the smaller one counts. Those of cost and model count again near the place where
/// they were computed: most of a plan hardly moves from one program, or control step, to the next.
#[derive(Debug)]
pub(crate) struct Curvature {
    dims: OcpDims,
    nodes: Nodes,
    /// The point, and for each of (x, u) a point ahead and one behind: `[points, n]`, `[points, m]`.
    x: Vec<f64>,
    u: Vec<f64>,
    /// p at each, `[points, np]`.
    p: Vec<f64>,
    /// The sizes of (x, u).
    sizes: Vec<f64>,
    /// How far the points are apart.
    steps: Vec<f64>,
    /// The gradients at the points, `[points, n]` and `[points, m]`.
    by_x: Vec<f64>,
    by_u: Vec<f64>,
    /// Those of lambda'f: by x, by u, and the lambda of each point.
    of_model: [Vec<f64>; 3],
    model: LinearizationBuffer,
    /// The outputs with their Jacobians at the points.
    y: Vec<f64>,
    c: Vec<f64>,
    d: Vec<f64>,
    /// The weights of the outputs, or of h and g.
    weights: Vec<f64>,
    /// h and g at a point, with their Jacobians.
    general: [Vec<f64>; 3],
    block: QuadBlock,
    /// `[n + m, n + m]`
    hessian: Vec<f64>,
    /// Those of cost and model where they were computed last.
    pub(crate) recent: Recent,
    convexifier: Convexifier,
    /// At how many points the model has been linearized.
    pub(crate) evaluated: usize,
}

/// Where second derivatives are taken.
#[derive(Clone, Copy)]
pub(crate) struct At<'a> {
    pub(crate) x0: &'a [f64],
    pub(crate) plan: &'a Solution,
    pub(crate) targets: Targets<'a>,
    /// Whether recent ones do not count.
    pub(crate) anew: bool,
}

/// What the exact Hessian is for.
#[derive(Clone, Copy)]
pub(crate) enum Purpose {
    /// A program, whose active rows are likely the plan's if they are `settled`.
    Step { settled: bool, convexity: Convexity },
    /// A step of the barrier method, which makes the program convex itself.
    Barrier,
    /// To see whether the plan is a minimum.
    Judgement,
}

/// The state and the input of some terms.
#[derive(Clone, Copy)]
struct Place {
    /// j of `x_j`.
    node: usize,
    /// i of `u_i`.
    input: usize,
    /// The stage whose model and p count.
    stage: usize,
    /// Whether the input led to the state.
    before: bool,
}

impl Curvature {
    pub(crate) fn new(dims: OcpDims, nodes: Nodes, horizon: &Horizon) -> Self {
        let (s, model) = (dims.nx + dims.nu, horizon.dims());
        let points = 2 * s + 1;
        let zeros = |width: usize| vec![0.0; points * width];
        let rows = dims.general();
        Self {
            dims,
            nodes,
            x: zeros(dims.nx),
            u: zeros(dims.nu),
            p: zeros(model.np),
            sizes: vec![0.0; s],
            steps: vec![0.0; s],
            by_x: zeros(dims.nx),
            by_u: zeros(dims.nu),
            of_model: [zeros(dims.nx), zeros(dims.nu), zeros(dims.nx)],
            model: LinearizationBuffer::new(model.with_parameters(0), points),
            y: zeros(model.ny),
            c: zeros(model.ny * dims.nx),
            d: zeros(model.ny * dims.nu),
            weights: vec![0.0; model.ny.max(rows)],
            general: [1, dims.nx, dims.nu].map(|width| vec![0.0; rows * width]),
            block: QuadBlock::new(dims.nx, dims.nu),
            hessian: vec![0.0; s * s],
            recent: Recent::new(dims.horizon, s + dims.nx + model.np + 1, s * s),
            convexifier: Convexifier::new(dims),
            evaluated: 0,
        }
    }

    /// Whether the last program is right for the active rows that it was given only.
    pub(crate) fn holds(&self) -> bool {
        self.convexifier.holds()
    }

    /// Adds the second derivatives that `qp` leaves out. Whether negative curvature was dropped to make
    /// it convex, or found; `None` if `expired` said that the time is up.
    pub(crate) fn add(
        &mut self,
        horizon: &mut Horizon,
        of: &mut Transcription,
        at: At<'_>,
        qp: &mut Qp,
        purpose: Purpose,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        let dims = self.dims;
        self.measure(&of.units, at);
        qp.weigh_shifts(|i| {
            let [low, high] = dims.range([at.x0, &at.plan.z], i);
            (high - low) / of.units.of_stage(i)
        });
        for stage in 0..dims.horizon {
            if expired() {
                return None;
            }
            let (node, input) = (dims.origin(stage), dims.input_of(stage));
            let here = Place { node, input, stage, before: false };
            self.find_hessian(horizon, of, at, here);
            self.add_hessian(here, &of.units, qp);
            if dims.feedthrough > 0 && self.weigh_rows(of, at, stage + 1, true) {
                self.spread(of, at, here);
                self.linearize_outputs(horizon, stage);
                self.add_outputs();
                self.add_block(here, &of.units, qp);
            }

            let next = stage + 1;
            let end = Place { node: next, input: dims.acting(next), ..here };
            if dims.stages_from(next).is_empty() && of.leaves_out_hessian() {
                self.spread(of, at, end);
                self.add_cost(of, end);
                self.add_block(end, &of.units, qp);
            }
            if next >= dims.n1 {
                self.add_rows(horizon, of, at, end, qp);
            }
        }
        let multipliers = &at.plan.multipliers;
        Some(match purpose {
            Purpose::Step { settled, convexity } => {
                self.convexifier.apply(qp, settled.then_some(multipliers), convexity)
            }
            Purpose::Barrier => false,
            Purpose::Judgement => self.convexifier.finds_descent(qp, multipliers),
        })
    }

    /// Finds the Hessian of the cost and the model of a stage.
    fn find_hessian(
        &mut self,
        horizon: &mut Horizon,
        of: &mut Transcription,
        at: At<'_>,
        here: Place,
    ) {
        let stage = here.stage;
        self.set_place(horizon, of, at, here);
        if !at.anew {
            let weight = |stage: usize| self.nodes.weights[stage + 1].to_bits();
            let is_alike = |after: &usize| {
                horizon.has_one_model_for([stage, *after]) && weight(stage) == weight(*after)
            };
            let after = self.dims.stages_from(stage + 1).next().filter(is_alike);
            if let Some(hessian) = self.recent.find(stage, after) {
                self.hessian.copy_from_slice(hessian);
                return;
            }
        }
        self.spread(of, at, here);
        self.weigh_model(of, at, stage);
        let integrates = self.add_cost(of, here);
        if !integrates {
            self.add_model(horizon, stage);
        }
        self.combine();
        self.recent.keep(stage, &self.hessian, integrates || !of.leaves_out_hessian());
    }

    /// Writes what the Hessian of a stage depends on: (x, u), the multipliers of its dynamics, p, and
    /// the time where a cost knows it.
    fn set_place(&mut self, horizon: &Horizon, of: &Transcription, at: At<'_>, here: Place) {
        let (dims, z, sizes) = (self.dims, &at.plan.z, &self.sizes);
        let (x, u) = (dims.state(here.node).map_or(at.x0, |x| &z[x]), &z[dims.input(here.input)]);
        let lambda = &at.plan.multipliers.dynamics[dims.next_state(here.stage)];
        let lambda = || (0..dims.nx).map(|i| of.units.plain_multiplier(i, lambda[i]));
        let largest =
            lambda().zip(sizes).fold(0.0_f64, |most, (l, size)| most.max((l * size).abs()));
        let (times, depth) = (horizon.times(), self.nodes.depths[here.node]);
        let terms = of.terms.as_ref().filter(|terms| terms.leaves_out_hessian());
        let time = terms.map_or(0.0, |terms| terms.time_s(depth));
        let p = of.parameters(here.stage, false).iter().map(|p| (*p, p.abs()));
        let point = x.iter().chain(u).copied().zip(sizes.iter().copied());
        let lambda = lambda().zip(sizes).map(|(l, size)| (l, largest / size));
        let all = point.chain(lambda).chain(p).chain([(time, times[depth + 1] - times[depth])]);
        self.recent.set_place(all.map(|(number, size)| (number, NEAR * size)));
    }

    /// Adds what tracked and bounded outputs, h and g contribute at a node.
    fn add_rows(
        &mut self,
        horizon: &mut Horizon,
        of: &mut Transcription,
        at: At<'_>,
        end: Place,
        qp: &mut Qp,
    ) {
        if of.outputs.is_some() {
            let led = Place { input: self.dims.input_of(end.stage), before: true, ..end };
            self.spread(of, at, led);
            self.linearize_outputs(horizon, end.stage);
            let bounded = self.weigh_rows(of, at, end.node, false);
            if self.weigh_tracking(of, at, led) || bounded {
                self.add_outputs();
                self.add_block(led, &of.units, qp);
            }
        }
        if self.dims.general() > 0 {
            self.spread(of, at, end);
            self.add_general(of, at, end.node);
            self.add_block(end, &of.units, qp);
        }
    }

    /// Writes the sizes of (x, u).
    fn measure(&mut self, units: &Units, at: At<'_>) {
        let (dims, z) = (self.dims, &at.plan.z);
        for (i, size) in self.sizes.iter_mut().enumerate() {
            *size = units.of_stage(i);
            if units.has_unknown_size(i) {
                // A unit may be below the least size.
                *size = dims.largest([at.x0, z], i).max(LEAST_SIZE).min(*size);
            }
        }
    }

    /// Writes the points of a place, and 0 for their gradients.
    fn spread(&mut self, of: &Transcription, at: At<'_>, place: Place) {
        let (dims, s) = (self.dims, self.steps.len());
        let (n, m) = (dims.nx, dims.nu);
        let x = dims.state(place.node).map_or(at.x0, |state| &at.plan.z[state]);
        let u = &at.plan.z[dims.input(place.input)];
        let p = of.parameters(place.stage, place.before);
        self.p.chunks_exact_mut(p.len().max(1)).for_each(|point| point.copy_from_slice(p));
        self.x.chunks_exact_mut(n).for_each(|point| point.copy_from_slice(x));
        self.u.chunks_exact_mut(m).for_each(|point| point.copy_from_slice(u));
        for i in 0..s {
            let here = if i < n { x[i] } else { u[i - n] };
            let step = STEP * here.abs().max(self.sizes[i]);
            self.steps[i] = step;
            for (point, moved) in [(2 * i + 1, here + step), (2 * i + 2, here - step)] {
                match i.checked_sub(n) {
                    None => self.x[point * n + i] = moved,
                    Some(k) => self.u[point * m + k] = moved,
                }
            }
        }
        self.by_x.fill(0.0);
        self.by_u.fill(0.0);
    }

    /// Writes the lambda of a stage for each point.
    fn weigh_model(&mut self, of: &Transcription, at: At<'_>, stage: usize) {
        self.evaluated += 2 * self.steps.len() + 1;
        let lambda = &at.plan.multipliers.dynamics[self.dims.next_state(stage)];
        for point in self.of_model[2].chunks_exact_mut(self.dims.nx) {
            for (i, (to, lambda)) in point.iter_mut().zip(lambda).enumerate() {
                *to = of.units.plain_multiplier(i, *lambda);
            }
        }
    }

    /// Writes the gradients of a stage cost that leaves out its Hessian, with the node's weight.
    /// Whether those of lambda'f are added.
    fn add_cost(&mut self, of: &mut Transcription, place: Place) -> bool {
        let Some(terms) = of.terms.as_mut().filter(|terms| terms.leaves_out_hessian()) else {
            return false;
        };
        let Self { x, u, by_x, by_u, block, of_model: [_, _, lambda], .. } = self;
        let stage = self.nodes.depths[place.node];
        let (p, time_s) = (of.cache.parameters(place.stage), terms.time_s(stage));
        let weights = (self.nodes.weights[place.stage + 1], &lambda[..self.dims.nx]);
        let (at, cost) = (StagePoint { stage, time_s, x, u, p }, terms.cost.as_mut());
        cost.is_some_and(|cost| cost.gradients(at, weights, block, [by_x, by_u]))
    }

    /// Adds the gradients of lambda'f.
    fn add_model(&mut self, horizon: &mut Horizon, stage: usize) {
        let Self { x, u, p, by_x, by_u, model, of_model: [of_x, of_u, weights], .. } = self;
        let out = Gradients { x: &mut *of_x, u: &mut *of_u, p: &mut [] };
        model.gradients(horizon.at(stage), Stages { x, u, p }, weights, out);
        for (to, of_model) in [(by_x, of_x), (by_u, of_u)] {
            to.iter_mut().zip(of_model).for_each(|(to, slope)| *to += *slope);
        }
    }

    /// Linearizes the outputs at the points.
    fn linearize_outputs(&mut self, horizon: &mut Horizon, stage: usize) {
        let Self { x, u, p, y, c, d, .. } = self;
        horizon
            .at(stage)
            .linearize_output(Stages { x, u, p }, OutputLinearization { y, c, d, e: &mut [] });
    }

    /// Writes the multipliers of the outputs bounded at the start or at the end of the interval that
    /// leads to node `j`; whether there are any.
    fn weigh_rows(&mut self, of: &Transcription, at: At<'_>, j: usize, at_start: bool) -> bool {
        self.weights.fill(0.0);
        if j < self.dims.n1 {
            return false;
        }
        let rows = self.dims.stage_rows(j).skip(self.dims.general());
        for (row, (output, end)) in rows.zip(of.output_rows.iter()) {
            if (end == Some(IntervalEnd::Start)) == at_start {
                let eta = at.plan.multipliers.rows[row];
                self.weights[output] += of.units.plain_row_multiplier(row, eta);
            }
        }
        self.weights.iter().any(|weight| *weight != 0.0)
    }

    /// Adds 2 Q e of the tracked outputs to the weights; whether there are any.
    fn weigh_tracking(&mut self, of: &Transcription, at: At<'_>, place: Place) -> bool {
        let (Some(terms), [x, u]) = (&of.terms, [&self.x, &self.u]) else { return false };
        let point = [&x[..self.dims.nx], &u[..self.dims.nu], &self.y[..]];
        terms.force(
            of.cost.tracking_weight(place.node),
            place.node,
            point,
            at.targets,
            |i, force| {
                self.weights[i] += force;
            },
        )
    }

    /// Adds the gradients of the outputs with their weights.
    fn add_outputs(&mut self) {
        let (n, m) = (self.dims.nx, self.dims.nu);
        let ny = self.y.len() * n / self.x.len();
        let Self { by_x, by_u, c, d, weights, .. } = self;
        for (to, jacobian, width) in [(by_x, c, n), (by_u, d, m)] {
            let points = to.chunks_exact_mut(width).zip(jacobian.chunks_exact(ny * width));
            points.for_each(|(to, rows)| add_weighted(to, rows, weights));
        }
    }

    /// Adds the gradients of eta'(h, g) of a node.
    fn add_general(&mut self, of: &mut Transcription, at: At<'_>, j: usize) {
        let (n, m) = (self.dims.nx, self.dims.nu);
        let count = self.dims.general();
        for (weight, row) in self.weights.iter_mut().zip(self.dims.stage_rows(j)).take(count) {
            *weight = of.units.plain_row_multiplier(row, at.plan.multipliers.rows[row]);
        }
        let Self { x, u, by_x, by_u, general: [values, rows_x, rows_u], weights, .. } = self;
        let points = x.chunks_exact(n).zip(u.chunks_exact(m));
        let gradients = by_x.chunks_exact_mut(n).zip(by_u.chunks_exact_mut(m));
        for ((x, u), (by_x, by_u)) in points.zip(gradients) {
            of.linearize_general([x, u], values, [rows_x, rows_u]);
            add_weighted(by_x, rows_x, weights);
            add_weighted(by_u, rows_u, weights);
        }
    }

    /// Makes the Hessian of the gradients.
    fn combine(&mut self) {
        let (n, m, s) = (self.dims.nx, self.dims.nu, self.steps.len());
        for (i, step) in self.steps.iter().enumerate() {
            for k in 0..s {
                let slope = |point: usize| match k.checked_sub(n) {
                    None => self.by_x[point * n + k],
                    Some(input) => self.by_u[point * m + input],
                };
                let [ahead, behind] = [slope(2 * i + 1), slope(2 * i + 2)];
                let middle = slope(0);
                self.hessian[i * s + k] = agreed([ahead - middle, middle - behind]) / step;
            }
        }
        symmetrize(&mut self.hessian, s, s);
    }

    /// Adds the second derivatives by the gradients to the program.
    fn add_block(&mut self, place: Place, units: &Units, qp: &mut Qp) {
        self.combine();
        self.add_hessian(place, units, qp);
    }

    /// Adds the second derivatives at a place to the program, in the units of the optimization; the
    /// measured state does not move.
    fn add_hessian(&self, place: Place, units: &Units, qp: &mut Qp) {
        if !all_finite(&self.hessian) {
            return;
        }
        let OcpDims { nx: n, nu: m, .. } = self.dims;
        let s = n + m;
        let entry = |i: usize, k: usize| self.hessian[i * s + k] * units.second_derivative(i, k);
        let t = place.input * m * m;
        for i in 0..m {
            for k in 0..m {
                qp.t[t + i * m + k] += entry(n + i, n + k);
            }
        }
        let Some(state) = place.node.checked_sub(1) else { return };
        for i in 0..n {
            for k in 0..n {
                qp.q[(state * n + i) * n + k] += entry(i, k);
            }
        }
        let cross = if place.before { &mut qp.s_before } else { &mut qp.s };
        // Without feedthrough there are no products with the input that led there.
        if let Some(cross) = cross.get_mut(state * m * n..(state + 1) * m * n) {
            for i in 0..m {
                for k in 0..n {
                    cross[i * n + k] += entry(n + i, k);
                }
            }
        }
    }
}

/// Adds the rows of a Jacobian with their weights.
fn add_weighted(to: &mut [f64], rows: &[f64], weights: &[f64]) {
    // A row without weight may have no derivative.
    let rows = rows.chunks_exact(to.len()).zip(weights).filter(|(_, weight)| **weight != 0.0);
    for (row, weight) in rows {
        to.iter_mut().zip(row).for_each(|(to, entry)| *to += weight * entry);
    }
}

/// The mean of two numbers that agree, or the smaller one.
fn agreed([a, b]: [f64; 2]) -> f64 {
    let [least, most] = if a.abs() <= b.abs() { [a, b] } else { [b, a] };
    if a.signum() == b.signum() && most.abs() <= 2.0 * least.abs() { 0.5 * (a + b) } else { least }
}
