//! The parts of the cost whose Hessian depends on the plan.

use crate::cost::{Cost, Targets};
use crate::linearization_cache::LinearizationCache;
use crate::outputs::Outputs;
use crate::scenarios::Nodes;
use crate::stage_cost::{QuadBlock, StageCost, StagePoint};
use crate::{NmpcProblem, Tracked};
use pinc_qp::{OcpDims, Qp};

/// A stage cost is told so many points ahead: the lanes of a model's vectors.
const AHEAD: usize = 8;

/// Tracked outputs, after Gauss and Newton, and the stage cost:
///
/// ```text
/// e = y(x, u) - yref,  e'Q e  ->  gradient 2 (C D)'Q e,  Hessian 2 (C D)'Q (C D)
/// ```
///
/// Outputs are tracked with the input of the interval that leads to x, the stage cost uses the
/// input that acts there.
#[derive(Debug)]
pub(crate) struct StageTerms {
    dims: OcpDims,
    nodes: Nodes,
    /// What is tracked, if these are not all states.
    tracked: Vec<Tracked>,
    /// Their places in (x, u), if none is an output.
    variables: Vec<usize>,
    pub(crate) cost: Option<Box<dyn StageCost>>,
    /// Seconds from the first stage to each.
    times: Vec<f64>,
    /// The time of the first stage in s.
    now_s: f64,
    block: QuadBlock,
    /// The Hessian of what is constant.
    q: Vec<f64>,
    /// Rows of (C D), `[tracked, n + m]`.
    jacobian: Vec<f64>,
    /// 2 Q (C D), of the same shape.
    weighted: Vec<f64>,
    error: Vec<f64>,
}

impl StageTerms {
    /// The terms of `problem`, if it has any.
    pub(crate) fn new(
        problem: &NmpcProblem,
        (dims, nodes): (OcpDims, &Nodes),
        constant: Vec<f64>,
        cost: Option<Box<dyn StageCost>>,
        times: &[f64],
    ) -> Option<Self> {
        let states = problem.tracks_states_only();
        if states && cost.is_none() {
            return None;
        }
        let tracked = if states { Vec::new() } else { problem.tracked.clone() };
        let place = |of: &Tracked| match *of {
            Tracked::State(state) => Some(state),
            Tracked::Input(input) => Some(dims.nx + input),
            Tracked::Output(_) => None,
        };
        let width = tracked.len() * (dims.nx + dims.nu);
        Some(Self {
            dims,
            nodes: nodes.clone(),
            cost,
            times: times.to_vec(),
            now_s: 0.0,
            block: QuadBlock::new(dims.nx, dims.nu),
            q: constant,
            jacobian: vec![0.0; width],
            weighted: vec![0.0; width],
            error: vec![0.0; tracked.len()],
            variables: tracked.iter().map(place).collect::<Option<_>>().unwrap_or_default(),
            tracked,
        })
    }

    /// Whether the cost says no Hessian.
    pub(crate) fn leaves_out_hessian(&self) -> bool {
        self.cost.as_ref().is_some_and(|cost| cost.leaves_out_hessian())
    }

    /// Sets the time of the first stage.
    pub(crate) fn set_time(&mut self, now_s: f64) {
        self.now_s = now_s;
    }

    /// The time of a stage in s.
    pub(crate) fn time_s(&self, stage: usize) -> f64 {
        self.now_s + self.times[stage]
    }

    /// Writes Q, S, E and T, adds to the gradient, and gives the value.
    #[inline(never)]
    pub(crate) fn add(
        &mut self,
        cost: &Cost,
        outputs: Option<&Outputs>,
        ([x0, z], cache): ([&[f64]; 2], &LinearizationCache),
        targets: Targets<'_>,
        qp: &mut Qp,
    ) -> f64 {
        qp.q.copy_from_slice(&self.q);
        qp.s.fill(0.0);
        qp.s_before.fill(0.0);
        qp.t.fill(0.0);
        let mut value = 0.0;
        if let Some(mut own) = self.cost.take() {
            value += self.add_own(own.as_mut(), [x0, z], cache, qp);
            self.cost = Some(own);
        }
        if !self.tracked.is_empty() {
            for node in self.dims.n1..=self.dims.horizon {
                let x = self.dims.state(node).map_or(x0, |state| &z[state]);
                let u = &z[self.dims.input(self.dims.input_of(node - 1))];
                self.block.clear();
                self.track(cost.tracking_weight(node), outputs, node, [x, u], targets);
                value += self.block.value;
                self.add_block(node, self.dims.input_of(node - 1), 1.0, qp);
                // Without feedthrough there are no products with inputs.
                if !qp.s_before.is_empty() {
                    self.add_cross(node, 1.0, &mut qp.s_before);
                }
            }
        }
        value
    }

    /// Adds the stage cost at all nodes, once for each branch that follows, with its parameters; at
    /// the end of a path with the parameters that led there.
    fn add_own(
        &mut self,
        own: &mut dyn StageCost,
        [x0, z]: [&[f64]; 2],
        cache: &LinearizationCache,
        qp: &mut Qp,
    ) -> f64 {
        let (dims, mut value) = (self.dims, 0.0);
        let is_end = |node: &usize| dims.stages_from(*node).is_empty();
        let branches = (0..dims.horizon).map(|branch| (dims.origin(branch), branch));
        let ends = (1..=dims.horizon).filter(is_end).map(|node| (node, node - 1));
        let mut all = branches.chain(ends).peekable();
        while all.peek().is_some() {
            let places: [Option<(usize, usize)>; AHEAD] = std::array::from_fn(|_| all.next());
            let point = |place: Option<(usize, usize)>| {
                let (node, branch) = place.unwrap_or_default();
                let stage = self.nodes.depths[node];
                let x = dims.state(node).map_or(x0, |state| &z[state]);
                let (u, p) = (&z[dims.input(dims.acting(node))], cache.parameters(branch));
                StagePoint { stage, time_s: self.time_s(stage), x, u, p }
            };
            let points = places.map(point);
            own.look_ahead(&points[..places.iter().flatten().count()]);
            for (&point, &(node, branch)) in points.iter().zip(places.iter().flatten()) {
                self.block.clear();
                own.quadratize(point, &mut self.block);
                let part = self.nodes.weights[branch + 1];
                value += part * self.block.value;
                self.add_block(node, dims.acting(node), part, qp);
                self.add_cross(node, part, &mut qp.s);
            }
        }
        value
    }

    /// Hands 2 Q e of each tracked output of a node to `take`, with the output's place; x, u and y are
    /// the values there. Whether there are any that are not 0.
    pub(crate) fn force(
        &self,
        q: &[f64],
        node: usize,
        [x, u, y]: [&[f64]; 3],
        targets: Targets<'_>,
        mut take: impl FnMut(usize, f64),
    ) -> bool {
        let count = self.tracked.len();
        let reference = &targets.reference[(node - 1) * count..node * count];
        let value = |tracked: Tracked| match tracked {
            Tracked::State(state) => x[state],
            Tracked::Input(input) => u[input],
            Tracked::Output(output) => y[output],
        };
        let mut any = false;
        for (tracked, q) in self.tracked.iter().zip(q.chunks_exact(count.max(1))) {
            if let Tracked::Output(output) = *tracked {
                let errors = self.tracked.iter().zip(reference).map(|(of, r)| value(*of) - r);
                let force: f64 = q.iter().zip(errors).map(|(q, e)| q * e).sum();
                any |= force != 0.0;
                take(output, force);
            }
        }
        any
    }

    /// Adds the tracking of a stage, weighted by 2 Q, to the block.
    fn track(
        &mut self,
        q: &[f64],
        outputs: Option<&Outputs>,
        j: usize,
        [x, u]: [&[f64]; 2],
        targets: Targets<'_>,
    ) {
        let OcpDims { nx, nu, .. } = self.dims;
        let (width, count) = (nx + nu, self.tracked.len());
        let reference = &targets.reference[(j - 1) * count..j * count];
        let Some(outputs) = outputs.filter(|_| self.variables.is_empty()) else {
            return self.track_variables(q, [x, u], reference);
        };
        for (i, (tracked, row)) in
            self.tracked.iter().zip(self.jacobian.chunks_exact_mut(width)).enumerate()
        {
            row.fill(0.0);
            let y = match *tracked {
                Tracked::State(state) => {
                    row[state] = 1.0;
                    x[state]
                }
                Tracked::Input(input) => {
                    row[nx + input] = 1.0;
                    u[input]
                }
                Tracked::Output(output) => {
                    let points = outputs.ends();
                    let [c, d] = points.rows(j, output);
                    row[..nx].copy_from_slice(c);
                    row[nx..].copy_from_slice(d);
                    points.y(j)[output]
                }
            };
            self.error[i] = y - reference[i];
        }
        self.weighted.fill(0.0);
        for (row, q) in self.weighted.chunks_exact_mut(width).zip(q.chunks_exact(count)) {
            let rows = self.jacobian.chunks_exact(width).zip(q);
            for (jacobian, &q) in rows.filter(|(_, q)| **q != 0.0) {
                row.iter_mut().zip(jacobian).for_each(|(sum, entry)| *sum += q * entry);
            }
        }
        for (i, q) in q.chunks_exact(count).enumerate() {
            let force: f64 = q.iter().zip(&self.error).map(|(q, e)| q * e).sum();
            self.block.value += 0.5 * force * self.error[i];
        }
        self.add_products(nx, nu);
    }

    /// The same where only states and inputs are tracked: a row of (C D) has a single 1.
    fn track_variables(&mut self, q: &[f64], [x, u]: [&[f64]; 2], reference: &[f64]) {
        let OcpDims { nx, nu, .. } = self.dims;
        let Self { variables, error, block, .. } = self;
        for ((error, &place), reference) in error.iter_mut().zip(&*variables).zip(reference) {
            *error = place.checked_sub(nx).map_or_else(|| x[place], |input| u[input]) - reference;
        }
        for (i, (&row, q)) in variables.iter().zip(q.chunks_exact(variables.len())).enumerate() {
            let force: f64 = q.iter().zip(&*error).map(|(q, e)| q * e).sum();
            block.value += 0.5 * force * error[i];
            let input = row.checked_sub(nx);
            *input.map_or_else(|| &mut block.by_x[row], |input| &mut block.by_u[input]) += force;
            for (&column, q) in variables.iter().zip(q) {
                match (input, column.checked_sub(nx)) {
                    (None, None) => block.q[row * nx + column] += q,
                    (Some(input), None) => block.s[input * nx + column] += q,
                    (Some(input), Some(other)) => block.r[input * nu + other] += q,
                    (None, Some(_)) => {}
                }
            }
        }
    }

    /// Adds (C D)'(2 Q)(C D) and (C D)'(2 Q) e.
    fn add_products(&mut self, nx: usize, nu: usize) {
        let width = nx + nu;
        let rows = self.jacobian.chunks_exact(width).zip(self.weighted.chunks_exact(width));
        for ((jacobian, weighted), &error) in rows.zip(&self.error) {
            let block = &mut self.block;
            let gradient = block.by_x.iter_mut().chain(&mut block.by_u);
            gradient.zip(weighted).for_each(|(sum, entry)| *sum += entry * error);
            let (weighted_x, weighted_u) = weighted.split_at(nx);
            // A tracked state or input has one factor that is not 0.
            for (r, &factor) in jacobian.iter().enumerate().filter(|(_, factor)| **factor != 0.0) {
                let add = |to: &mut [f64], from: &[f64]| {
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
                };
                match r.checked_sub(nx) {
                    None => add(&mut block.q[r * nx..(r + 1) * nx], weighted_x),
                    Some(k) => {
                        add(&mut block.s[k * nx..(k + 1) * nx], weighted_x);
                        add(&mut block.r[k * nu..(k + 1) * nu], weighted_u);
                    }
                }
            }
        }
    }

    /// Adds this part of the block of a node and an input, without products of the two, to the program; the
    /// measured state does not move.
    fn add_block(&self, node: usize, input: usize, part: f64, qp: &mut Qp) {
        let (dims, block) = (self.dims, &self.block);
        let OcpDims { nx, nu, .. } = dims;
        add(&mut qp.gradient[dims.input(input)], part, &block.by_u);
        add(&mut qp.t[input * nu * nu..], part, &block.r);
        if let Some(state) = dims.state(node) {
            add(&mut qp.gradient[state], part, &block.by_x);
            add(&mut qp.q[(node - 1) * nx * nx..], part, &block.q);
        }
    }

    /// Adds this part of the products of a node's state and the input.
    fn add_cross(&self, node: usize, part: f64, s: &mut [f64]) {
        if let Some(before) = node.checked_sub(1) {
            add(&mut s[before * self.block.s.len()..], part, &self.block.s);
        }
    }
}

fn add(to: &mut [f64], factor: f64, from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
}
