//! The optimality conditions, differentiated in the numbers that the problem is given.

use crate::data::{Given, Layout};
use crate::limits::Limit;
use crate::sensitivity::Plan;
use crate::system::Places;
use pinc_mpc::{IntervalEnd, NmpcProblem, Program, Tracked};
use pinc_ode::{Dims, OutputLinearization, Stages};
use pinc_qp::{OcpDims, Qp};

/// The derivative of minus the optimality conditions, without what is of second order in p and the
/// model's first derivatives in p, as a list of entries: row of the conditions, number given, value. A right-hand side is these entries
/// times a change; a gradient is their transpose times a solution.
#[derive(Debug, Default)]
pub(crate) struct Entries(Vec<(usize, usize, f64)>);

/// What the entries are made from.
pub(crate) struct Conditions<'a> {
    pub(crate) problem: &'a NmpcProblem,
    pub(crate) program: &'a Program<'a>,
    pub(crate) layout: &'a Layout,
    pub(crate) plan: &'a Plan<'a>,
    pub(crate) qp: &'a Qp,
    pub(crate) limits: &'a [Limit],
    pub(crate) by_start: &'a [f64],
    pub(crate) by_parameters: &'a ByParameters,
}

impl Entries {
    /// Adds the entries times `change` to `right`.
    pub(crate) fn apply(&self, change: &[f64], right: &mut [f64]) {
        for &(row, given, value) in &self.0 {
            right[row] += value * change[given];
        }
    }

    /// Adds the transposed entries times `w` to `gradient`.
    pub(crate) fn apply_transposed(&self, w: &[f64], gradient: &mut [f64]) {
        for &(row, given, value) in &self.0 {
            gradient[given] += value * w[row];
        }
    }

    pub(crate) fn new(of: &Conditions<'_>) -> Self {
        let mut entries = Self::default();
        entries.add_state(of);
        entries.add_tracking(of);
        entries.add_increments(of);
        entries.add_input_sequence(of);
        entries.add_limits(of);
        entries.add_rows(of);
        entries.add_penalties(of);
        entries
    }

    fn push(&mut self, row: usize, given: usize, value: f64) {
        if value != 0.0 {
            self.0.push((row, given, value));
        }
    }

    /// Derivatives of a symmetric form v'Q v in entry (i, k) of Q and its mirror image.
    fn push_weight(
        &mut self,
        row: usize,
        place: impl Fn(usize, usize) -> Option<usize>,
        (i, k): (usize, usize),
        value: f64,
    ) {
        for place in [place(i, k), place(k, i)].into_iter().flatten() {
            self.push(row, place, value);
        }
    }

    fn add_state(&mut self, of: &Conditions<'_>) {
        let dims = of.qp.dims;
        let (n, at) = (dims.nx, Places::new(dims));
        let state = |k: usize| of.layout.place(Given::State, k);
        for (i, value) in of.qp.a(0).iter().enumerate() {
            self.push(at.dynamics + i / n, state(i % n), -value);
        }
        for (i, value) in of.by_start.iter().enumerate() {
            self.push(dims.input(0).start + i / n, state(i % n), -value);
        }
        if dims.n1 == 1 {
            let rows = dims.rows_at_start(1).rows;
            let [by_x, _] = of.qp.row_jacobians(rows.clone());
            for (i, value) in by_x.iter().enumerate() {
                self.push(at.rows + rows.start + i / n, state(i % n), -value);
            }
        }
    }

    /// e'Q e, with e = y - yref.
    fn add_tracking(&mut self, of: &Conditions<'_>) {
        let dims = of.qp.dims;
        let tracked = &of.problem.tracked;
        let count = tracked.len();
        for j in dims.constrained() {
            let q = of.program.tracking_weight(j);
            let errors = of.plan.errors(of.program, j);
            let place = |i, k| of.layout.q(j, j == dims.horizon, i, k);
            for (i, &quantity) in tracked.iter().enumerate() {
                for (row, slope) in slopes(of, j, quantity) {
                    for k in 0..count {
                        let reference = of.layout.place(Given::Reference, (j - 1) * count + k);
                        self.push(row, reference, slope * q[i * count + k]);
                        self.push_weight(row, place, (i, k), -slope * errors[k]);
                    }
                    for (k, &other) in tracked.iter().enumerate() {
                        let Tracked::Output(output) = other else { continue };
                        for (p, by_p) in of.by_parameters.ends(j, output).iter().enumerate() {
                            let given = of.layout.place(Given::Parameters, p);
                            self.push(row, given, -slope * q[i * count + k] * by_p);
                        }
                    }
                }
            }
        }
    }

    /// du'R du.
    fn add_increments(&mut self, of: &Conditions<'_>) {
        let (dims, m) = (of.qp.dims, of.qp.dims.nu);
        for i in 0..dims.n_controls {
            let now = dims.input(i).start;
            let increment = |k: usize| of.plan.input(dims, i + 1, k) - of.plan.input(dims, i, k);
            for row in 0..m {
                for k in 0..m {
                    let place = |row, k| of.layout.r(i, row, k);
                    self.push_weight(now + row, place, (row, k), -increment(k));
                    if i > 0 {
                        self.push_weight(now - m + row, place, (row, k), increment(k));
                    } else {
                        let applied = of.layout.place(Given::AppliedInput, k);
                        self.push(now + row, applied, of.qp.r(0)[row * m + k]);
                    }
                }
            }
        }
    }

    /// v'W v, with v = (u[k-1], u[k], ..).
    fn add_input_sequence(&mut self, of: &Conditions<'_>) {
        let (dims, m) = (of.qp.dims, of.qp.dims.nu);
        let Some(weight) = &of.problem.weights.input_sequence else { return };
        let width = weight.size();
        let first = dims.all_states();
        for row in m..width {
            for k in 0..width {
                let place = |row, k| of.layout.input_sequence(row, k);
                let value = of.plan.input(dims, k / m, k % m);
                self.push_weight(first + row - m, place, (row, k), -value);
                if k < m {
                    let applied = of.layout.place(Given::AppliedInput, k);
                    self.push(first + row - m, applied, -2.0 * weight.entry(row, k));
                }
            }
        }
    }

    /// Bounds and increments. The first input may go as far as to its nearest bound.
    fn add_limits(&mut self, of: &Conditions<'_>) {
        let dims = of.qp.dims;
        let at = Places::new(dims);
        let states = dims.all_states();
        for v in 0..dims.unknowns() {
            let limit = of.limits[v];
            let [low, high] = match v.checked_sub(states) {
                None => [Given::StateLow, Given::StateHigh].map(|side| of.layout.place(side, v)),
                Some(v) => [Given::InputLow, Given::InputHigh].map(|side| of.layout.place(side, v)),
            };
            self.push(at.bounds + v, low, limit.low);
            self.push(at.bounds + v, high, limit.high);
        }
        let [bounds, increments] = of.program.bounds();
        for v in 0..dims.all_inputs() {
            let (limit, row) = (of.limits[dims.unknowns() + v], at.increments + v);
            let first = v < dims.nu;
            let before = of.plan.input(dims, v / dims.nu, v % dims.nu);
            let reaches = [
                first && bounds.high[states + v] - before < increments.low[v],
                first && bounds.low[states + v] - before > increments.high[v],
            ];
            let sides = [
                (limit.low, Given::IncrementLow, Given::InputHigh),
                (limit.high, Given::IncrementHigh, Given::InputLow),
            ];
            for ((share, increment, bound), reaches) in sides.into_iter().zip(reaches) {
                if reaches {
                    self.push(row, of.layout.place(bound, v), share);
                    continue;
                }
                if share != 0.0 {
                    self.push(row, of.layout.place(increment, v), share);
                }
                if first {
                    self.push(row, of.layout.place(Given::AppliedInput, v), share);
                }
            }
        }
    }

    /// Bounded outputs; h and g have nothing to be differentiated in.
    fn add_rows(&mut self, of: &Conditions<'_>) {
        let dims = of.qp.dims;
        let at = Places::new(dims);
        let stages = if dims.outputs + dims.feedthrough > 0 { dims.constrained() } else { 0..0 };
        let first = dims.unknowns() + dims.all_inputs();
        for j in stages {
            let rows = dims.stage_rows(j).skip(dims.general());
            for (row, (output, end)) in rows.zip(of.program.output_rows()) {
                let limit = of.limits[first + row];
                if limit.compliance.is_infinite() {
                    continue;
                }
                let bound = (j - dims.n1) * (dims.outputs + dims.feedthrough) + output;
                self.push(at.rows + row, of.layout.place(Given::OutputLow, bound), limit.low);
                self.push(at.rows + row, of.layout.place(Given::OutputHigh, bound), limit.high);
                let by_p = match end {
                    Some(IntervalEnd::Start) => of.by_parameters.starts(j, output),
                    Some(IntervalEnd::End) | None => of.by_parameters.ends(j, output),
                };
                for (p, value) in by_p.iter().enumerate() {
                    self.push(at.rows + row, of.layout.place(Given::Parameters, p), -value);
                }
            }
        }
    }

    /// The weights of violations: where a multiplier is its weight, it moves with it.
    fn add_penalties(&mut self, of: &Conditions<'_>) {
        let (dims, at) = (of.qp.dims, Places::new(of.qp.dims));
        for v in 0..dims.all_states() {
            let Some(given) = of.layout.penalty(Given::StatePenalty, v % dims.nx) else { break };
            let limit = of.limits[v];
            self.push(at.bounds + v, given, limit.penalty);
            self.push(v, given, -limit.saturated);
        }
        let first = dims.unknowns() + dims.all_inputs();
        let stages = if dims.rows() > 0 { dims.constrained() } else { 0..0 };
        for j in stages {
            let rows = dims.stage_rows(j).start;
            let outputs = of.program.output_rows();
            let general = (0..dims.general()).map(|i| (Given::ConstraintPenalty, i));
            let all = general.chain(outputs.map(|(output, _)| (Given::OutputPenalty, output)));
            for (row, (given, i)) in all.enumerate().map(|(row, of)| (rows + row, of)) {
                let Some(given) = of.layout.penalty(given, i) else { continue };
                let limit = of.limits[first + row];
                self.push(at.rows + row, given, limit.penalty);
                if limit.saturated != 0.0 {
                    for (place, slope) in row_slopes(of.qp, row) {
                        self.push(place, given, -limit.saturated * slope);
                    }
                }
            }
        }
    }
}

/// The derivatives of a tracked quantity at stage `j` in the unknowns.
fn slopes(of: &Conditions<'_>, j: usize, tracked: Tracked) -> Vec<(usize, f64)> {
    let dims = of.qp.dims;
    let state = dims.next_state(j - 1).start;
    let input = dims.input(dims.acting(j - 1));
    match tracked {
        Tracked::State(index) => vec![(state + index, 1.0)],
        Tracked::Input(index) => vec![(input.start + index, 1.0)],
        Tracked::Output(output) => {
            let Some(point) = of.program.output(j, output) else { return Vec::new() };
            let (by_x, by_u) = (point.by_x.iter().copied(), point.by_u.iter().copied());
            (state..).zip(by_x).chain(input.zip(by_u)).collect()
        }
    }
}

/// The derivatives of a row in the unknowns.
pub(crate) fn row_slopes(qp: &Qp, row: usize) -> Vec<(usize, f64)> {
    let dims = qp.dims;
    let (state, input) = dims.row_place(row);
    let [by_x, by_u] = qp.row_jacobians(row..row + 1);
    let x = dims.state(state).into_iter().flatten().zip(by_x.iter().copied());
    x.chain(dims.input(input).zip(by_u.iter().copied())).collect()
}

/// First derivatives of the outputs in p along a plan.
#[derive(Debug)]
pub(crate) struct ByParameters {
    model: Dims,
    /// At the ends and at the starts of the intervals, `[N, ny, np]`.
    outputs: [Vec<f64>; 2],
}

impl ByParameters {
    pub(crate) fn new(
        program: &mut Program<'_>,
        dims: OcpDims,
        (plan, p): (&Plan<'_>, &[f64]),
    ) -> Self {
        let model @ Dims { nx, nu, np, ny, .. } = program.nmpc().model().dims();
        let points = if program.uses_outputs() { dims.horizon * ny * np } else { 0 };
        let mut outputs = [vec![0.0; points], vec![0.0; points]];
        let (mut y, mut c, mut d) = (vec![0.0; ny], vec![0.0; ny * nx], vec![0.0; ny * nu]);
        for (outputs, later) in outputs.iter_mut().zip([1, 0]) {
            for (j, e) in outputs.chunks_exact_mut((ny * np).max(1)).enumerate() {
                let u = &plan.z[dims.input(dims.acting(j))];
                let at = Stages { x: plan.state(dims, j + later), u, p };
                let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e };
                program.linearize_output(j, at, out);
            }
        }
        Self { model, outputs }
    }

    /// The derivatives of an output at the end of the interval that leads to stage `j`.
    fn ends(&self, j: usize, output: usize) -> &[f64] {
        self.output(0, j, output)
    }

    fn starts(&self, j: usize, output: usize) -> &[f64] {
        self.output(1, j, output)
    }

    fn output(&self, end: usize, j: usize, output: usize) -> &[f64] {
        let Dims { np, ny, .. } = self.model;
        let first = ((j - 1) * ny + output) * np;
        self.outputs[end].get(first..first + np).unwrap_or(&[])
    }
}

impl Plan<'_> {
    /// `x_j`
    pub(crate) fn state(&self, dims: OcpDims, j: usize) -> &[f64] {
        dims.state(j).map_or(self.x0, |state| &self.z[state])
    }

    /// Input `k` of (u[k-1], u[k], ..) at place `i`.
    fn input(&self, dims: OcpDims, i: usize, k: usize) -> f64 {
        match i.checked_sub(1) {
            None => self.u_before[k],
            Some(i) => self.z[dims.input(i)][k],
        }
    }

    /// e = y - yref at stage `j`.
    fn errors(&self, program: &Program<'_>, j: usize) -> Vec<f64> {
        let dims = program.constants().dims;
        let reference = self.reference[(j - 1) * self.tracked.len()..].iter();
        let value = |tracked: &Tracked| match *tracked {
            Tracked::State(state) => self.state(dims, j)[state],
            Tracked::Input(input) => self.z[dims.input(dims.acting(j - 1))][input],
            Tracked::Output(output) => program.output(j, output).map_or(0.0, |point| point.y),
        };
        self.tracked.iter().map(value).zip(reference).map(|(y, reference)| y - reference).collect()
    }

    /// Calls `see` with each tracked quantity at stage `j` and 2 Q e there.
    pub(crate) fn tracking(
        &self,
        program: &Program<'_>,
        j: usize,
        mut see: impl FnMut(Tracked, f64),
    ) {
        let errors = self.errors(program, j);
        let q = program.tracking_weight(j);
        for (tracked, q) in self.tracked.iter().zip(q.chunks_exact(errors.len().max(1))) {
            see(*tracked, q.iter().zip(&errors).map(|(q, e)| q * e).sum());
        }
    }
}
