//! Second derivatives of what a control problem is made of: differences of exact first derivatives.

use crate::sensitivity::Plan;
use pinc_mpc::{IntervalEnd, LEAST_SIZE, NmpcProblem, Program, QuadBlock, Tracked};
use pinc_ode::{Dims, Gradients, LinearizationBuffer, OutputLinearization, Stages};
use pinc_qp::{OcpDims, Qp};

/// Steps of the differences, as a part of a quantity's size: their error, of second order, is about
/// 1e-8 of a second derivative, and rounding adds 1e-11.
const STEP: f64 = 1e-4;

/// The size of a state or an input is at least this part of its bound; of one without a bound, of 1 or of
/// the largest value on the plan, whichever is less.
const LEAST_PART: f64 = 0.1;

/// The golden section, whose multiples spread evenly over the parts of 1.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The central difference: multiples of the step and their weights.
const DIFFERENCE: [(f64, f64); 2] = [(1.0, 0.5), (-1.0, -0.5)];

/// A function of a state, an input and p that enters the Lagrangian with weights, at each of its
/// places on the horizon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Function {
    /// The model: lambda'f.
    Dynamics,
    /// Outputs at the ends of the intervals, tracked or bounded.
    Ends,
    /// Outputs at their starts.
    Starts,
    /// h and g.
    General,
    /// The stage cost.
    Cost,
}

/// The places of a function: its points, and how the values there are weighted.
#[derive(Debug)]
struct Family {
    function: Function,
    places: Vec<Place>,
    x: Vec<f64>,
    u: Vec<f64>,
    /// `[places, values]`
    weights: Vec<f64>,
}

/// Where a function is evaluated.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// The stage whose model it is.
    stage: usize,
    /// j of its state `x_j`.
    state: usize,
    /// i of its input `u_i`.
    input: usize,
    /// Whether the input is the one of the interval that leads to the state.
    before: bool,
}

/// Second derivatives of the Lagrangian at a plan.
#[derive(Debug)]
pub(crate) struct Curvature {
    dims: OcpDims,
    model: Dims,
    families: Vec<Family>,
    p: Vec<f64>,
    /// The sizes of x and u by their bounds, 0 without.
    bounds: [Vec<f64>; 2],
    /// The least sizes of x and u.
    sizes: [Vec<f64>; 2],
    /// The second derivatives of the Lagrangian in `u_0` and `x_0`, `[m, n]`.
    pub(crate) by_start: Vec<f64>,
}

/// What the functions are evaluated with.
struct Evaluator<'a, 'p> {
    program: &'a mut Program<'p>,
    dims: OcpDims,
    model: Dims,
    block: QuadBlock,
    /// p at each point, the gradients of the model by x and by u, and what they need.
    p: Vec<f64>,
    by: [Vec<f64>; 2],
    room: LinearizationBuffer,
}

impl Curvature {
    pub(crate) fn new(problem: &NmpcProblem, dims: OcpDims, model: Dims) -> Self {
        let states = || problem.state_bounds.sizes(dims.nx);
        let states = problem.state_sizes.clone().unwrap_or_else(states);
        let bounds = [states, problem.input_bounds.sizes(dims.nu)];
        Self {
            dims,
            model,
            families: Vec::new(),
            p: Vec::new(),
            sizes: bounds.clone(),
            bounds,
            by_start: vec![0.0; dims.nx * dims.nu],
        }
    }

    /// Adds to the Hessian of `qp`, which is linearized at `plan`, what Gauss and Newton leave out.
    pub(crate) fn add(
        &mut self,
        program: &mut Program<'_>,
        (plan, p): (&Plan<'_>, &[f64]),
        qp: &mut Qp,
    ) {
        self.p.clear();
        self.p.extend_from_slice(p);
        self.measure(plan);
        self.families = families(self.dims, self.model, program, plan);
        self.by_start.fill(0.0);
        let mut evaluator = Evaluator::new(program, self.dims, self.model);
        for family in &self.families {
            let blocks = self.hessians(family, &mut evaluator);
            let by_start = add_blocks(self.dims, family, &blocks, qp);
            self.by_start.iter_mut().zip(by_start).for_each(|(sum, part)| *sum += part);
        }
    }

    /// Writes the least sizes.
    fn measure(&mut self, plan: &Plan<'_>) {
        let known = self.bounds.iter().flatten();
        for (i, (size, &bound)) in self.sizes.iter_mut().flatten().zip(known).enumerate() {
            let values = || self.dims.largest([plan.x0, plan.z], i).clamp(LEAST_SIZE, 1.0);
            *size = LEAST_PART * if bound > 0.0 { bound } else { values() };
        }
    }

    /// The Hessians of a family in (x, u), `[places, n + m, n + m]`.
    fn hessians(&self, family: &Family, evaluator: &mut Evaluator<'_, '_>) -> Vec<f64> {
        let OcpDims { nx, nu, .. } = self.dims;
        let (width, count) = (nx + nu, family.places.len());
        let mut blocks = vec![0.0; count * width * width];
        let mut column = vec![0.0; count * width];
        for k in 0..width {
            let (mut dx, mut du) = (vec![0.0; count * nx], vec![0.0; count * nu]);
            let mut steps = vec![0.0; count];
            for (place, step) in steps.iter_mut().enumerate() {
                let (to, at, size) = match k.checked_sub(nx) {
                    None => (&mut dx[place * nx + k], family.x[place * nx + k], self.sizes[0][k]),
                    Some(k) => {
                        (&mut du[place * nu + k], family.u[place * nu + k], self.sizes[1][k])
                    }
                };
                *step = STEP * at.abs().max(size);
                *to = *step;
            }
            self.difference(family, evaluator, [&dx, &du, &[]], &mut column, false);
            if k == 0 && all_zero(&column) && self.is_flat(family, evaluator) {
                break;
            }
            for (place, step) in steps.iter().enumerate() {
                for i in 0..width {
                    let half = 0.5 * column[place * width + i] / step;
                    blocks[(place * width + i) * width + k] += half;
                    blocks[(place * width + k) * width + i] += half;
                }
            }
        }
        if family.function == Function::Cost {
            evaluator.subtract_own(family, &self.p, &mut blocks);
        }
        blocks
    }

    /// Whether the gradients of a family are the same numbers along a direction that moves all states and
    /// inputs by different amounts, as those of a plant that is linear in them.
    fn is_flat(&self, family: &Family, evaluator: &mut Evaluator<'_, '_>) -> bool {
        if family.function == Function::Cost {
            return false;
        }
        let mut part = 0.0;
        let mut direction = |at: &[f64], sizes: &[f64]| -> Vec<f64> {
            let sizes = at.iter().zip(sizes.iter().cycle());
            let moved = sizes.map(|(at, size)| {
                part = (part + GOLDEN) % 1.0;
                STEP * (1.0 + part) * at.abs().max(*size)
            });
            moved.collect()
        };
        let [of_x, of_u] = &self.sizes;
        let (dx, du) = (direction(&family.x, of_x), direction(&family.u, of_u));
        let mut change = vec![0.0; family.places.len() * (of_x.len() + of_u.len())];
        self.difference(family, evaluator, [&dx, &du, &[]], &mut change, false);
        all_zero(&change)
    }

    /// The difference of the gradients of a family, in (x, u) or in p, along a displacement of x,
    /// u and p (empty: none).
    fn difference(
        &self,
        family: &Family,
        evaluator: &mut Evaluator<'_, '_>,
        [dx, du, dp]: [&[f64]; 3],
        out: &mut [f64],
        in_parameters: bool,
    ) {
        out.fill(0.0);
        let mut gradient = vec![0.0; out.len()];
        for (multiple, weight) in DIFFERENCE {
            let moved = |from: &[f64], by: &[f64]| -> Vec<f64> {
                let by = by.iter().copied().chain(std::iter::repeat(0.0));
                from.iter().zip(by).map(|(from, by)| from + multiple * by).collect()
            };
            let (x, u, p) = (moved(&family.x, dx), moved(&family.u, du), moved(&self.p, dp));
            evaluator.gradient(
                family,
                Stages { x: &x, u: &u, p: &p },
                &mut gradient,
                in_parameters,
            );
            for (sum, gradient) in out.iter_mut().zip(&gradient) {
                *sum += weight * gradient;
            }
        }
    }

    /// Subtracts d2L / dz dp and df / dp times `dp` from the parts z and lambda of `right`.
    pub(crate) fn subtract_along_parameters(
        &self,
        program: &mut Program<'_>,
        dp: &[f64],
        right: &mut [f64],
    ) {
        let Some(step) = step(dp, |k| parameter_size(self.p[k])) else { return };
        self.subtract_moved_states(program, dp, &mut right[self.dims.unknowns()..]);
        let dp: Vec<f64> = dp.iter().map(|dp| step * dp).collect();
        let mut evaluator = Evaluator::new(program, self.dims, self.model);
        let (nx, width) = (self.dims.nx, self.dims.nx + self.dims.nu);
        for family in &self.families {
            let mut change = vec![0.0; family.places.len() * width];
            self.difference(family, &mut evaluator, [&[], &[], &dp], &mut change, false);
            for (place, change) in family.places.iter().zip(change.chunks_exact(width)) {
                let (by_x, by_u) = change.split_at(nx);
                let mut subtract = |first: usize, change: &[f64]| {
                    let to = right[first..].iter_mut();
                    to.zip(change).for_each(|(to, change)| *to -= change / step);
                };
                if let Some(state) = self.dims.state(place.state) {
                    subtract(state.start, by_x);
                }
                subtract(self.dims.input(place.input).start, by_u);
            }
        }
    }

    /// Subtracts df / dp times `dp`.
    fn subtract_moved_states(&self, program: &mut Program<'_>, dp: &[f64], right: &mut [f64]) {
        let dynamics = self.families.iter().find(|family| family.function == Function::Dynamics);
        let Some(Family { places, x, u, .. }) = dynamics else { return };
        let mut found = LinearizationBuffer::new(self.model, places.len());
        let p = self.p.repeat(places.len());
        program.linearize(Stages { x, u, p: &p }, found.as_mut());
        for (right, by_p) in right.iter_mut().zip(found.e.chunks_exact(dp.len())) {
            *right -= by_p.iter().zip(dp).map(|(by_p, dp)| by_p * dp).sum::<f64>();
        }
    }

    /// Subtracts w'd2L / dz dp and w'df / dp, with the parts z and lambda of `w`, from `gradient`, `np`.
    pub(crate) fn subtract_adjoint(
        &self,
        program: &mut Program<'_>,
        w: &[f64],
        gradient: &mut [f64],
    ) {
        let OcpDims { nx, nu, .. } = self.dims;
        let np = self.p.len();
        if np == 0 {
            return;
        }
        let mut evaluator = Evaluator::new(program, self.dims, self.model);
        for family in &self.families {
            let count = family.places.len();
            let (mut dx, mut du) = (vec![0.0; count * nx], vec![0.0; count * nu]);
            for (k, place) in family.places.iter().enumerate() {
                if let Some(state) = self.dims.state(place.state) {
                    dx[k * nx..(k + 1) * nx].copy_from_slice(&w[state]);
                }
                du[k * nu..(k + 1) * nu].copy_from_slice(&w[self.dims.input(place.input)]);
            }
            if family.function == Function::Cost {
                self.subtract_cost(family, &mut evaluator, [&dx, &du], gradient);
                continue;
            }
            let mut steps = vec![0.0; count];
            for (k, size) in steps.iter_mut().enumerate() {
                let (dx, du) = (&mut dx[k * nx..(k + 1) * nx], &mut du[k * nu..(k + 1) * nu]);
                let sizes = [(&dx[..], &family.x, 0, nx), (&du[..], &family.u, 1, nu)].map(
                    |(direction, at, kind, width)| {
                        let size = |i: usize| at[k * width + i].abs().max(self.sizes[kind][i]);
                        step(direction, size)
                    },
                );
                let least = sizes.into_iter().flatten().fold(f64::INFINITY, f64::min);
                *size = if least.is_finite() { least } else { 0.0 };
                dx.iter_mut().chain(du).for_each(|direction| *direction *= *size);
            }
            let mut change = vec![0.0; count * np];
            if family.function == Function::Dynamics {
                let dynamics = &w[self.dims.unknowns()..][..count * nx];
                let at = Stages { x: &family.x, u: &family.u, p: &self.p };
                evaluator.gradient_of_model(dynamics, at, &mut change, true);
                for change in change.chunks_exact(np) {
                    gradient.iter_mut().zip(change).for_each(|(gradient, by_p)| *gradient -= by_p);
                }
            }
            self.difference(family, &mut evaluator, [&dx, &du, &[]], &mut change, true);
            for (change, step) in change.chunks_exact(np).zip(&steps).filter(|(_, s)| **s > 0.0) {
                let sums = gradient.iter_mut().zip(change);
                sums.for_each(|(gradient, change)| *gradient -= change / step);
            }
        }
    }

    /// The part of a stage cost, whose derivative in p is not known.
    fn subtract_cost(
        &self,
        family: &Family,
        evaluator: &mut Evaluator<'_, '_>,
        [wx, wu]: [&[f64]; 2],
        gradient: &mut [f64],
    ) {
        let OcpDims { nx, nu, .. } = self.dims;
        let mut change = vec![0.0; family.places.len() * (nx + nu)];
        for (k, sum) in gradient.iter_mut().enumerate() {
            let step = STEP * parameter_size(self.p[k]);
            let mut dp = vec![0.0; self.p.len()];
            dp[k] = step;
            self.difference(family, evaluator, [&[], &[], &dp], &mut change, false);
            let w = wx.chunks_exact(nx).zip(wu.chunks_exact(nu));
            for (change, (wx, wu)) in change.chunks_exact(nx + nu).zip(w) {
                let product = change.iter().zip(wx.iter().chain(wu)).map(|(c, w)| c * w);
                *sum -= product.sum::<f64>() / step;
            }
        }
    }
}

fn all_zero(numbers: &[f64]) -> bool {
    numbers.iter().all(|number| number.abs() <= 0.0)
}

/// The size of a parameter, whose value says all that is known of it.
fn parameter_size(p: f64) -> f64 {
    if p == 0.0 { 1.0 } else { p.abs() }
}

/// The largest multiple of a direction that moves no quantity by more than [`STEP`] of its size;
/// `None` if nothing moves.
fn step(direction: &[f64], size: impl Fn(usize) -> f64) -> Option<f64> {
    let largest = direction.iter().enumerate().map(|(k, d)| d.abs() / size(k));
    let largest = largest.fold(0.0, f64::max);
    (largest > 0.0).then(|| STEP / largest)
}

/// Adds the Hessians of a family to `qp`; gives its second derivatives in `u_0` and `x_0`.
fn add_blocks(dims: OcpDims, family: &Family, blocks: &[f64], qp: &mut Qp) -> Vec<f64> {
    let OcpDims { nx, nu, .. } = dims;
    let width = nx + nu;
    let mut by_start = vec![0.0; nx * nu];
    for (place, block) in family.places.iter().zip(blocks.chunks_exact(width * width)) {
        let (of_x, of_u) = block.split_at(nx * width);
        let add = |to: &mut [f64], rows: &[f64], skip: usize, columns: usize| {
            for (to, row) in to.chunks_exact_mut(columns).zip(rows.chunks_exact(width)) {
                to.iter_mut().zip(&row[skip..]).for_each(|(to, value)| *to += value);
            }
        };
        add(&mut qp.t[place.input * nu * nu..(place.input + 1) * nu * nu], of_u, nx, nu);
        match place.state.checked_sub(1) {
            None => add(&mut by_start, of_u, 0, nx),
            Some(j) => {
                add(&mut qp.q[j * nx * nx..(j + 1) * nx * nx], of_x, 0, nx);
                let cross = if place.before { &mut qp.s_before } else { &mut qp.s };
                add(&mut cross[j * nx * nu..(j + 1) * nx * nu], of_u, 0, nx);
            }
        }
    }
    by_start
}

/// The functions of the problem, with their weights at `plan`.
fn families(dims: OcpDims, model: Dims, program: &Program<'_>, plan: &Plan<'_>) -> Vec<Family> {
    let mut families = Vec::new();
    let here = |stage: usize| Place {
        stage: stage.min(dims.horizon - 1),
        state: stage,
        input: dims.acting(stage),
        before: false,
    };
    let mut push = |function, places: Vec<Place>, weights: Vec<f64>| {
        let x = places.iter().flat_map(|place| plan.state(dims, place.state)).copied().collect();
        let u = places.iter().flat_map(|place| &plan.z[dims.input(place.input)]);
        let u = u.copied().collect();
        families.push(Family { function, places, x, u, weights });
    };
    let multipliers = plan.multipliers;
    let stages = (0..dims.horizon).map(here).collect();
    push(Function::Dynamics, stages, multipliers.dynamics.clone());
    if program.uses_outputs() {
        let ends = (1..=dims.horizon).map(|j| Place {
            stage: j - 1,
            state: j,
            input: dims.acting(j - 1),
            before: true,
        });
        let mut weights = vec![0.0; dims.horizon * model.ny];
        let mut at_starts = weights.clone();
        for j in dims.constrained() {
            let weights = &mut weights[(j - 1) * model.ny..j * model.ny];
            plan.tracking(program, j, |tracked, force| {
                if let Tracked::Output(output) = tracked {
                    weights[output] += force;
                }
            });
            let rows = dims.stage_rows(j).skip(dims.general());
            for (row, (output, end)) in rows.zip(program.output_rows()) {
                match end {
                    Some(IntervalEnd::Start) => {
                        at_starts[(j - 1) * model.ny + output] += multipliers.rows[row];
                    }
                    Some(IntervalEnd::End) | None => {
                        weights[output] += multipliers.rows[row];
                    }
                }
            }
        }
        push(Function::Ends, ends.collect(), weights);
        if dims.feedthrough > 0 {
            let starts = (1..=dims.horizon).map(|j| Place { stage: j - 1, ..here(j - 1) });
            push(Function::Starts, starts.collect(), at_starts);
        }
    }
    if dims.general() > 0 {
        let rows = dims.constrained().flat_map(|j| dims.stage_rows(j).take(dims.general()));
        let weights = rows.map(|row| multipliers.rows[row]).collect();
        push(Function::General, dims.constrained().map(here).collect(), weights);
    }
    if program.has_stage_cost() {
        push(Function::Cost, (0..=dims.horizon).map(here).collect(), Vec::new());
    }
    families
}

impl<'a, 'p> Evaluator<'a, 'p> {
    fn new(program: &'a mut Program<'p>, dims: OcpDims, model: Dims) -> Self {
        let block = QuadBlock::new(dims.nx, dims.nu);
        let (p, by, room) = Default::default();
        Self { program, dims, model, block, p, by, room }
    }

    /// Writes the gradients of a family at the points `at`, with the same p for all: in (x, u),
    /// `[places, n + m]`, or in p, `[places, np]`.
    fn gradient(&mut self, family: &Family, at: Stages<'_>, out: &mut [f64], in_parameters: bool) {
        let count = family.places.len();
        match family.function {
            Function::Dynamics => {
                self.gradient_of_model(&family.weights, at, out, in_parameters);
            }
            Function::Ends | Function::Starts => {
                for k in 0..count {
                    self.gradient_of_outputs(family, at, out, (k, in_parameters));
                }
            }
            Function::General if in_parameters => out.fill(0.0),
            Function::General => {
                for k in 0..count {
                    self.gradient_of_constraints(family, at, out, k);
                }
            }
            Function::Cost => {
                for k in 0..count {
                    self.quadratize(family, at, k);
                    let OcpDims { nx, nu, .. } = self.dims;
                    let (by_x, by_u) = out[k * (nx + nu)..(k + 1) * (nx + nu)].split_at_mut(nx);
                    by_x.copy_from_slice(&self.block.by_x);
                    by_u.copy_from_slice(&self.block.by_u);
                }
            }
        }
    }

    fn gradient_of_model(
        &mut self,
        weights: &[f64],
        at: Stages<'_>,
        out: &mut [f64],
        in_parameters: bool,
    ) {
        let Dims { nx, nu, .. } = self.model;
        let count = self.dims.horizon;
        let [by_x, by_u] = &mut self.by;
        by_x.resize(count * nx, 0.0);
        by_u.resize(count * nu, 0.0);
        self.p.clear();
        (0..count).for_each(|_| self.p.extend_from_slice(at.p));
        let by_p = if in_parameters { &mut *out } else { &mut [] };
        let gradients = Gradients { x: &mut *by_x, u: &mut *by_u, p: by_p };
        let at = Stages { p: &self.p, ..at };
        self.program.gradients(at, weights, gradients, &mut self.room);
        if !in_parameters {
            let both = by_x.chunks_exact(nx).zip(by_u.chunks_exact(nu));
            for (to, (by_x, by_u)) in out.chunks_exact_mut(nx + nu).zip(both) {
                to[..nx].copy_from_slice(by_x);
                to[nx..].copy_from_slice(by_u);
            }
        }
    }

    fn gradient_of_outputs(
        &mut self,
        family: &Family,
        at: Stages<'_>,
        out: &mut [f64],
        (k, in_parameters): (usize, bool),
    ) {
        let Dims { nx, nu, np, ny, .. } = self.model;
        let zeros = |width: usize| vec![0.0; ny * width];
        let (mut y, mut c, mut d) = (zeros(1), zeros(nx), zeros(nu));
        let mut e = if in_parameters { zeros(np) } else { Vec::new() };
        let point =
            Stages { x: &at.x[k * nx..(k + 1) * nx], u: &at.u[k * nu..(k + 1) * nu], p: at.p };
        let result = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut e };
        self.program.linearize_output(family.places[k].stage, point, result);
        let weights = &family.weights[k * ny..(k + 1) * ny];
        if in_parameters {
            weighted(&[(&e, np)], weights, &mut out[k * np..(k + 1) * np]);
        } else {
            let width = nx + nu;
            weighted(&[(&c, nx), (&d, nu)], weights, &mut out[k * width..(k + 1) * width]);
        }
    }

    fn gradient_of_constraints(
        &mut self,
        family: &Family,
        at: Stages<'_>,
        out: &mut [f64],
        k: usize,
    ) {
        let OcpDims { nx, nu, .. } = self.dims;
        let (rows, width) = (self.dims.general(), nx + nu);
        let (mut values, mut by_x, mut by_u) =
            (vec![0.0; rows], vec![0.0; rows * nx], vec![0.0; rows * nu]);
        let point = [&at.x[k * nx..(k + 1) * nx], &at.u[k * nu..(k + 1) * nu]];
        self.program.linearize_constraints(point, &mut values, [&mut by_x, &mut by_u]);
        let weights = &family.weights[k * rows..(k + 1) * rows];
        weighted(&[(&by_x, nx), (&by_u, nu)], weights, &mut out[k * width..(k + 1) * width]);
    }

    /// Evaluates the stage cost at place `k`.
    fn quadratize(&mut self, family: &Family, at: Stages<'_>, k: usize) {
        let OcpDims { nx, nu, .. } = self.dims;
        self.block.clear();
        let point = [&at.x[k * nx..(k + 1) * nx], &at.u[k * nu..(k + 1) * nu], at.p];
        self.program.add_stage_cost(family.places[k].state, point, &mut self.block);
    }

    /// Subtracts from the Hessians of the stage cost what it says itself.
    fn subtract_own(&mut self, family: &Family, p: &[f64], blocks: &mut [f64]) {
        let OcpDims { nx, nu, .. } = self.dims;
        let width = nx + nu;
        for (k, block) in blocks.chunks_exact_mut(width * width).enumerate() {
            self.quadratize(family, Stages { x: &family.x, u: &family.u, p }, k);
            let QuadBlock { q, s, r, .. } = &self.block;
            for (i, row) in block.chunks_exact_mut(width).enumerate() {
                for (c, entry) in row.iter_mut().enumerate() {
                    *entry -= match (i.checked_sub(nx), c.checked_sub(nx)) {
                        (None, None) => q[i * nx + c],
                        (Some(i), None) => s[i * nx + c],
                        (None, Some(c)) => s[c * nx + i],
                        (Some(i), Some(c)) => r[i * nu + c],
                    };
                }
            }
        }
    }
}

/// Writes the transposed Jacobians, side by side, times the weights.
fn weighted(jacobians: &[(&[f64], usize)], weights: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    let mut first = 0;
    for &(jacobian, width) in jacobians {
        let out = &mut out[first..first + width];
        for (row, weight) in jacobian.chunks_exact(width.max(1)).zip(weights) {
            // A row without weight may have no derivative.
            if *weight != 0.0 {
                out.iter_mut().zip(row).for_each(|(sum, entry)| *sum += weight * entry);
            }
        }
        first += width;
    }
}
