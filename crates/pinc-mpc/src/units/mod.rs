//! The units in which the optimization computes.

#[cfg(test)]
mod tests;

use crate::constraints::ConstraintWork;
use crate::cost::Targets;
use crate::curvature::LEAST_SIZE;
use crate::outputs::OutputRows;
use crate::{NmpcProblem, Tracked};
use pinc_ode::{Dims, Memory};
use pinc_qp::{Multipliers, OcpDims, Qp};

/// Quantities between these sizes keep their unit.
const ORDINARY: [f64; 2] = [0.0625, 1024.0];

/// The cost keeps its unit if the geometric mean of its largest and least weight is between these; on a tree,
/// whose programs go to the Riccati method alone, which loses digits by large weights, the others.
const ORDINARY_WEIGHT: [f64; 2] = [1e-3, 1e6];
const ORDINARY_ON_TREE: [f64; 2] = [1e-3, 100.0];

/// The largest weight in the unit of the cost: rounding errors in the gradient by a larger one would be
/// above the tolerance.
const LARGEST_WEIGHT: f64 = 1e7;

/// The unit of the cost is at most so many times the least weight: in a larger one, the gradient by that
/// weight would always be within the tolerance. Wide bounds make the weight of an input look large.
const MOST_COST: f64 = 1e5;

/// Bounds of an input that are wider than so many of its moves do not tell its size.
const WIDE: f64 = 1e4;

/// A unit that follows the state is made smaller again when the state is below this part of it, ..
const SMALL: f64 = 0.25;
/// .. and smaller than 1 when the state and its reference are below this one.
const VERY_SMALL: f64 = 1.0 / 4096.0;

/// Units for states, inputs and rows such that these are numbers of ordinary size, and one for the
/// cost: tolerances are absolute, and mean the same whatever the units of the plant.
///
/// All units are powers of 2, so that no digit changes. A quantity of ordinary size keeps its unit. How large a
/// quantity is, its bounds say, or the problem; without these, a state counts as large when it is seen to be.
#[derive(Clone, Debug)]
pub(crate) struct Units {
    dims: OcpDims,
    pub(crate) x: Vec<f64>,
    u: Vec<f64>,
    /// The units of the rows of a stage.
    rows: Vec<f64>,
    cost: f64,
    /// The largest weight of an output that is tracked.
    of_outputs: f64,
    /// The largest slope of a cost without weights, by states and inputs in their units, once known.
    slope: Option<f64>,
    /// Whether those of states, inputs and rows are 1, and whether that of the cost is 1 too.
    plain: bool,
    identity: bool,
    /// Which states are tracked, by their place in the reference.
    tracked: Vec<Option<usize>>,
    outputs: usize,
    /// States and inputs whose size only their values show.
    unknown: [Vec<bool>; 2],
}

/// Units of the plant's quantities, as multiples of the plant's own: powers of 2, and 1 for
/// quantities of ordinary size.
#[derive(Clone, Debug, PartialEq)]
pub struct ProblemUnits {
    /// The units of the states.
    pub states: Vec<f64>,
    /// The units of the inputs.
    pub inputs: Vec<f64>,
    /// The units of the bounded outputs; empty if there are none.
    pub outputs: Vec<f64>,
    /// The unit of the cost.
    pub cost: f64,
}

impl Units {
    pub(crate) fn new(problem: &NmpcProblem, dims: OcpDims, outputs: &OutputRows) -> Self {
        let states = match &problem.state_sizes {
            Some(sizes) => sizes.clone(),
            None => problem.state_bounds.sizes(dims.nx),
        };
        let inputs = input_sizes(problem, dims.nu);
        let place = |state| problem.tracked.iter().position(|t| *t == Tracked::State(state));
        let units = |sizes: &[f64]| -> Vec<f64> {
            sizes.iter().map(|&size| unit(size, ORDINARY)).collect()
        };
        let (x, u) = (units(&states), units(&inputs));
        let mut rows = units(&row_sizes(problem, [&states, &inputs]));
        if let Some(bounds) = &problem.output_bounds {
            let of_outputs = units(&bounds.sizes(outputs.here() + outputs.through()));
            rows.extend(outputs.iter().map(|(output, _)| of_outputs[output]));
        }
        Self {
            dims,
            rows,
            cost: 1.0,
            of_outputs: largest_output_weight(problem),
            slope: None,
            plain: false,
            identity: false,
            tracked: (0..dims.nx).map(place).collect(),
            outputs: problem.tracked.len(),
            unknown: [&states, &inputs]
                .map(|sizes| sizes.iter().map(|size| *size <= 0.0).collect()),
            x,
            u,
        }
    }

    /// The units of a problem whose outputs have one row each.
    pub(crate) fn of_problem(&self) -> ProblemUnits {
        ProblemUnits {
            states: self.x.clone(),
            inputs: self.u.clone(),
            outputs: self.rows[self.dims.general()..].to_vec(),
            cost: self.cost,
        }
    }

    /// Whether the units of states, inputs and rows are 1.
    pub(crate) fn are_plain(&self) -> bool {
        self.plain
    }

    /// The units of bounds, increments and rows, and that of the cost.
    pub(crate) fn of_limits(&self) -> (Vec<f64>, f64) {
        let (dims, inputs) = (self.dims, self.dims.all_inputs());
        let bounds = (0..dims.unknowns()).map(|v| self.unknown(v));
        let increments = self.u.iter().cycle().take(inputs).copied();
        let rows = self.rows.iter().cycle().take(dims.all_rows()).copied();
        (bounds.chain(increments).chain(rows).collect(), self.cost)
    }

    /// Whether all units are 1.
    pub(crate) fn is_identity(&self) -> bool {
        self.identity
    }

    /// Chooses the unit of the cost by its weights, Q of states and R, in the plant's units.
    #[inline(never)]
    pub(crate) fn choose_cost(&mut self, q: &[f64], r: &[f64]) {
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        for (blocks, units) in [(q, &self.x), (r, &self.u)] {
            let size = units.len();
            for (i, weight) in blocks.chunks_exact(size).enumerate() {
                let weight = weight[i % size] * units[i % size].powi(2);
                if weight > 0.0 {
                    (least, most) = (least.min(weight), most.max(weight));
                }
            }
        }
        let size = if most > 0.0 { (least * most).sqrt() } else { self.slope.unwrap_or(1.0) };
        let by_largest = (most.max(self.of_outputs) / LARGEST_WEIGHT).log2().ceil().exp2();
        let by_least = (MOST_COST * least).log2().floor().exp2().max(1.0);
        let ordinary = if self.dims.tree.is_chain() { ORDINARY_WEIGHT } else { ORDINARY_ON_TREE };
        self.cost = unit(size, ordinary).max(by_largest).min(by_least);
        let is_one = |unit: &f64| unit.to_bits() == 1.0_f64.to_bits();
        self.plain = self.x.iter().chain(&self.u).chain(&self.rows).all(is_one);
        self.identity = self.plain && is_one(&self.cost);
    }

    /// Whether the slope of the cost is still to be measured.
    pub(crate) fn wants_slope(&self) -> bool {
        self.slope.is_none()
    }

    /// Sets the slope of the cost by a gradient in these units.
    pub(crate) fn set_slope(&mut self, gradient: &[f64]) {
        let slope = gradient.iter().fold(0.0_f64, |most, g| most.max(g.abs()));
        self.slope = Some(if slope.is_finite() { self.cost * slope } else { 0.0 });
    }

    /// Forgets the slope of the cost.
    pub(crate) fn forget_slope(&mut self) {
        self.slope = None;
    }

    /// Forgets the sizes that only values have shown; whether that changes the units.
    pub(crate) fn forget(&mut self) -> bool {
        let mut changed = false;
        for (units, unknown) in [&mut self.x, &mut self.u].into_iter().zip(&self.unknown) {
            for (unit, _) in units.iter_mut().zip(unknown).filter(|(_, unknown)| **unknown) {
                changed |= unit.to_bits() != 1.0_f64.to_bits();
                *unit = 1.0;
            }
        }
        changed
    }

    /// Saves or restores the sizes that only values have shown.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        for (units, unknown) in [&mut self.x, &mut self.u].into_iter().zip(&self.unknown) {
            for (unit, _) in units.iter_mut().zip(unknown).filter(|(_, unknown)| **unknown) {
                memory.numbers(std::slice::from_mut(unit));
                if !(unit.is_normal() && *unit > 0.0) {
                    *unit = 1.0;
                    memory.refuse();
                }
            }
        }
        let mut slope = [self.slope.unwrap_or(f64::NAN)];
        memory.numbers(&mut slope);
        self.slope = Some(slope[0]).filter(|slope| slope.is_finite());
    }

    /// Makes the units fit a state and what it is to follow; whether they changed.
    pub(crate) fn follow(&mut self, x0: &[f64], targets: Option<Targets<'_>>) -> bool {
        let mut changed = false;
        for (i, unit) in self.x.iter_mut().enumerate().filter(|(i, _)| self.unknown[0][*i]) {
            let mut reference = 0.0;
            if let (Some(targets), Some(place)) = (targets, self.tracked[i]) {
                let values = targets.reference.iter().skip(place).step_by(self.outputs);
                reference = values.fold(0.0_f64, |size, value| size.max(value.abs()));
            }
            changed |= fit(unit, reference.max(x0[i].abs()), reference > 0.0);
        }
        if let Some(targets) = targets {
            for (i, unit) in self.u.iter_mut().enumerate().filter(|(i, _)| self.unknown[1][*i]) {
                changed |= fit(unit, targets.previous[i].abs(), false);
            }
        }
        changed
    }

    /// The unit of a row of constraints.
    pub(crate) fn row(&self, row: usize) -> f64 {
        self.rows[row % self.rows.len()]
    }

    /// The unit of the unknown number `v` of z.
    pub(crate) fn unknown(&self, v: usize) -> f64 {
        match v.checked_sub(self.dims.all_states()) {
            None => self.x[v % self.x.len()],
            Some(v) => self.u[v % self.u.len()],
        }
    }

    /// The unit of a number of a stage's (x, u).
    pub(crate) fn of_stage(&self, i: usize) -> f64 {
        match i.checked_sub(self.x.len()) {
            None => self.x[i],
            Some(input) => self.u[input],
        }
    }

    /// Whether only the values of a number of a stage's (x, u) show its size.
    pub(crate) fn has_unknown_size(&self, i: usize) -> bool {
        let [states, inputs] = &self.unknown;
        i.checked_sub(states.len()).map_or_else(|| states[i], |input| inputs[input])
    }

    /// What a second derivative of the cost by two numbers of a stage's (x, u) is multiplied by.
    pub(crate) fn second_derivative(&self, i: usize, k: usize) -> f64 {
        self.of_stage(i) * self.of_stage(k) / self.cost
    }

    /// A cost in the plant's units.
    pub(crate) fn plain_cost(&self, cost: f64) -> f64 {
        cost * self.cost
    }

    /// A multiplier of the dynamics of state `i` in the plant's units.
    pub(crate) fn plain_multiplier(&self, i: usize, multiplier: f64) -> f64 {
        multiplier * (self.cost / self.x[i])
    }

    /// A multiplier of a row of h, g or outputs in the plant's units.
    pub(crate) fn plain_row_multiplier(&self, row: usize, multiplier: f64) -> f64 {
        multiplier * (self.cost / self.rows[row % self.rows.len()])
    }

    /// Scales the model's linearization and the rows in `qp`.
    #[inline(never)]
    pub(crate) fn scale_constraints(&self, qp: &mut Qp) {
        scale_matrices(&mut qp.a, &self.x, &self.x);
        scale_matrices(&mut qp.b, &self.x, &self.u);
        divide_blocks(&mut qp.c, &self.x);
        if !self.rows.is_empty() {
            scale_matrices(&mut qp.rows_x, &self.rows, &self.x);
            scale_matrices(&mut qp.rows_u, &self.rows, &self.u);
            divide_blocks(&mut qp.rows.low, &self.rows);
            divide_blocks(&mut qp.rows.high, &self.rows);
        }
    }

    /// Scales limits, gradient and what changes of the Hessian in `qp`; gives the cost.
    #[inline(never)]
    pub(crate) fn scale_cost(&self, qp: &mut Qp, cost: f64) -> f64 {
        let per_cost = 1.0 / self.cost;
        qp.gradient.iter_mut().for_each(|g| *g *= per_cost);
        if !self.plain {
            self.scale_limits(qp);
            let (by_x, by_u) = qp.gradient.split_at_mut(self.dims.all_states());
            for (gradient, units) in [(by_x, &self.x), (by_u, &self.u)] {
                for block in gradient.chunks_exact_mut(units.len()) {
                    block.iter_mut().zip(units).for_each(|(g, unit)| *g *= unit);
                }
            }
        }
        if qp.has_stage_cost() {
            self.scale_weights(&mut qp.q, &self.x, &self.x);
            self.scale_weights(&mut qp.s, &self.u, &self.x);
            self.scale_weights(&mut qp.s_before, &self.u, &self.x);
            self.scale_weights(&mut qp.t, &self.u, &self.u);
        }
        cost / self.cost
    }

    /// Scales the limits of unknowns and increments in `qp`.
    fn scale_limits(&self, qp: &mut Qp) {
        for side in [&mut qp.bounds.low, &mut qp.bounds.high] {
            let (x, u) = side.split_at_mut(self.dims.all_states());
            divide_blocks(x, &self.x);
            divide_blocks(u, &self.u);
        }
        for side in [&mut qp.increments.low, &mut qp.increments.high] {
            divide_blocks(side, &self.u);
        }
    }

    /// Scales the constant parts: the Hessian and the penalties.
    #[inline(never)]
    pub(crate) fn scale_constants(&self, qp: &mut Qp) {
        let (n, m) = (self.x.len(), self.u.len());
        self.scale_weights(&mut qp.q, &self.x, &self.x);
        self.scale_weights(&mut qp.r, &self.u, &self.u);
        let width = self.dims.all_inputs();
        for (at, w) in qp.w.iter_mut().enumerate() {
            *w *= self.u[at / width % m] * self.u[at % width % m] / self.cost;
        }
        let states = self.dims.all_states();
        for (v, penalty) in qp.bounds.penalty[..states].iter_mut().enumerate() {
            *penalty *= self.x[v % n] / self.cost;
        }
        for (v, penalty) in qp.rows.penalty.iter_mut().enumerate() {
            *penalty *= self.rows[v % self.rows.len()] / self.cost;
        }
    }

    fn scale_weights(&self, blocks: &mut [f64], rows: &[f64], columns: &[f64]) {
        // All of them are powers of 2: nothing is rounded.
        let per_cost = 1.0 / self.cost;
        for (row, of_row) in blocks.chunks_exact_mut(columns.len()).zip(rows.iter().cycle()) {
            for (entry, of_column) in row.iter_mut().zip(columns) {
                *entry *= of_row * of_column * per_cost;
            }
        }
    }

    /// Brings multipliers to these units, or back to the plant's.
    #[inline(never)]
    pub(crate) fn convert(&self, multipliers: &mut Multipliers, back: bool) {
        let scale = |value: &mut f64, unit: f64| {
            let factor = unit / self.cost;
            *value *= if back { 1.0 / factor } else { factor };
        };
        let Multipliers { dynamics, bounds, increments, rows } = multipliers;
        let (n, m) = (self.x.len(), self.u.len());
        dynamics.iter_mut().enumerate().for_each(|(i, v)| scale(v, self.x[i % n]));
        bounds.iter_mut().enumerate().for_each(|(i, v)| scale(v, self.unknown(i)));
        increments.iter_mut().enumerate().for_each(|(i, v)| scale(v, self.u[i % m]));
        rows.iter_mut().enumerate().for_each(|(i, v)| scale(v, self.rows[i % self.rows.len()]));
    }
}

/// The largest weight of 2 Q of an output, whose size is not known: a large weight is taken for that of a
/// small one.
fn largest_output_weight(problem: &NmpcProblem) -> f64 {
    const LARGEST: f64 = 20.0;
    let outputs = problem.tracked.iter().enumerate();
    let outputs = outputs.filter(|(_, tracked)| matches!(tracked, Tracked::Output(_)));
    let weights = || problem.weights.q.all().iter().chain(&problem.weights.terminal);
    let entries = outputs.flat_map(|(i, _)| weights().map(move |q| 2.0 * q.entry(i, i)));
    entries.fold(0.0, f64::max).min(LARGEST)
}

/// The sizes of inputs by their bounds, 0 where these are infinite. In the unit of bounds that are far
/// wider than its moves, all that an input can move in a step would be within the tolerance.
fn input_sizes(problem: &NmpcProblem, inputs: usize) -> Vec<f64> {
    let moves = problem.increment_bounds.sizes(inputs);
    let sizes = problem.input_bounds.sizes(inputs).into_iter().zip(moves);
    sizes.map(|(size, moved)| if moved > 0.0 { size.min(WIDE * moved) } else { size }).collect()
}

/// By how much the rows of the constraints vary with states and inputs of these sizes, 0 where that is not
/// known: by their slopes at both ends of the bounds and in the middle, for they may be flat at one point.
fn row_sizes(problem: &NmpcProblem, sizes: [&[f64]; 2]) -> Vec<f64> {
    let Some(constraints) = &problem.constraints else { return Vec::new() };
    let [n, m] = sizes.map(<[f64]>::len);
    let count = constraints.inequalities() + constraints.equalities();
    let mut work = ConstraintWork::new(Dims::new(n, m), count);
    let (mut values, mut by_x, mut by_u) =
        (vec![0.0; count], vec![0.0; count * n], vec![0.0; count * m]);
    let mut rows = vec![0.0_f64; count];
    for part in [0.0, 0.5, 1.0] {
        let x = problem.state_bounds.between(part, n);
        let u = problem.input_bounds.between(part, m);
        constraints.linearize([&x, &u], &mut values, [&mut by_x, &mut by_u], &mut work);
        for (slopes, sizes) in [(&by_x, sizes[0]), (&by_u, sizes[1])] {
            for (row, slopes) in rows.iter_mut().zip(slopes.chunks_exact(sizes.len())) {
                let ranges = slopes.iter().zip(sizes).map(|(slope, size)| slope.abs() * size);
                *row = ranges.filter(|range| range.is_finite()).fold(*row, f64::max);
            }
        }
    }
    rows
}

/// Blocks of matrices M become `rows^-1 M columns`.
fn scale_matrices(blocks: &mut [f64], rows: &[f64], columns: &[f64]) {
    for (row, unit) in blocks.chunks_exact_mut(columns.len()).zip(rows.iter().cycle()) {
        row.iter_mut().zip(columns).for_each(|(entry, column)| *entry *= column / unit);
    }
}

/// Blocks of numbers in the plant's units become numbers in these units.
fn divide_blocks(blocks: &mut [f64], units: &[f64]) {
    for block in blocks.chunks_exact_mut(units.len()) {
        block.iter_mut().zip(units).for_each(|(value, unit)| *value /= unit);
    }
}

/// Makes a unit fit a quantity of this size; whether it changed. The quantity may be near 0 at times, and
/// so is small only if a reference says so.
fn fit(current: &mut f64, size: f64, referred: bool) -> bool {
    let small =
        *current > 1.0 && size < SMALL * *current || referred && size < VERY_SMALL * *current;
    if !size.is_finite() || !small && size <= ORDINARY[1] * *current {
        return false;
    }
    let before = *current;
    *current = unit(size.max(if referred { LEAST_SIZE } else { 1.0 }), ORDINARY);
    before.to_bits() != current.to_bits()
}

/// The unit of a quantity of this size: 1 if that is ordinary or unknown, otherwise a power of 2 of
/// which it is 8 to 16.
fn unit(size: f64, [least, most]: [f64; 2]) -> f64 {
    if size > 0.0 && size.is_finite() && !(least..=most).contains(&size) {
        (size.log2().floor() - 3.0).clamp(-300.0, 300.0).exp2()
    } else {
        1.0
    }
}
