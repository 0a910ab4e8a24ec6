//! One recording, linearized: its residuals and their derivatives as a triangle, by single or
//! multiple shooting.

use crate::problem::{Problem, Recording};
use crate::trajectory::{Evaluation, Trajectory};
use crate::triangle::Triangle;
use faer::Mat;
use pinc_estimate::Measured;
use pinc_ode::{Dims, LinearizationBuffer, OutputLinearizationBuffer, Stages};

/// How many points are linearized at a time.
const BLOCK: usize = 64;

/// The begins of segments and the states there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Nodes {
    /// The first row of each segment; 0 is the first.
    pub(crate) starts: Vec<usize>,
    /// The state there, `[segments, nx]`.
    pub(crate) x: Vec<f64>,
}

impl Nodes {
    /// One segment.
    pub(crate) fn first(x: &[f64]) -> Self {
        Self { starts: vec![0], x: x.to_vec() }
    }

    /// Segments of `length` rows.
    pub(crate) fn every(length: usize, states: &[Vec<f64>]) -> Self {
        let starts: Vec<usize> = (0..states.len()).step_by(length).collect();
        Self { x: starts.iter().flat_map(|&k| states[k].clone()).collect(), starts }
    }
}

/// A recording with its linearization.
///
/// Small changes of the states are linear functions of unknowns (q, p, 1). Changes of the first state
/// are its scale times q, where that is free. From segment to segment q is chosen anew, so that no
/// state depends on it by more than its scale: directions that grow are scaled down, and the change
/// of a state at the end of a segment takes the place of that at its begin. What the sensitivities
/// of unstable plants would lose to rounding is kept so.
#[derive(Debug)]
pub(crate) struct Shooting<'a> {
    pub(crate) recording: Recording<'a>,
    pub(crate) nodes: Nodes,
    pub(crate) trajectory: Trajectory,
    /// The size of each state.
    pub(crate) scale: Vec<f64>,
    /// Of (q, p, 1): the residuals, whose squares are twice the cost.
    pub(crate) triangle: Triangle,
    /// The number of q.
    pub(crate) nq: usize,
    links: Vec<Link>,
    /// How much the state depends on the first one, at most.
    pub(crate) growth: f64,
    /// The change of the last state by (q, p, 1), `[nx, width]`.
    last: Vec<f64>,
}

/// What a choice of new q does: q = W (q', p, 1), and the change of the state there by (q', p, 1).
#[derive(Clone, Debug)]
struct Link {
    /// `[nq, width]`
    back: Vec<f64>,
    /// `[nx, width]`
    node: Vec<f64>,
}

/// Memory for the linearization of a block of points.
#[derive(Debug)]
pub(crate) struct Block {
    model: LinearizationBuffer,
    /// p at each point.
    p: Vec<f64>,
    /// The input that each point is read under.
    read: Vec<f64>,
    outputs: OutputLinearizationBuffer,
    /// The derivatives of a measured quantity.
    row: Vec<f64>,
    /// What a correction changes in the derivatives of the state.
    change: Vec<f64>,
}

impl Block {
    pub(crate) fn new(dims: Dims) -> Self {
        Self {
            model: LinearizationBuffer::new(dims, BLOCK),
            p: vec![0.0; BLOCK * dims.np],
            read: vec![0.0; BLOCK * dims.nu],
            outputs: OutputLinearizationBuffer::new(dims, BLOCK),
            row: Vec::new(),
            change: Vec::new(),
        }
    }
}

impl<'a> Shooting<'a> {
    pub(crate) fn new(
        problem: &Problem,
        recording: Recording<'a>,
        nodes: Nodes,
        scale: Vec<f64>,
    ) -> Self {
        let nx = scale.len();
        let nq = if problem.initial_state.is_free() { nx } else { 0 };
        let rows = recording.rows(problem.channels.len());
        Self {
            trajectory: Trajectory::new(nx, rows, nodes.starts.len()),
            triangle: Triangle::new(nq + problem.unknown.len() + 1),
            recording,
            nodes,
            scale,
            nq,
            links: Vec::new(),
            growth: 1.0,
            last: Vec::new(),
        }
    }

    /// Writes the model's trajectory from the nodes.
    pub(crate) fn simulate(&mut self, problem: &Problem, p: &[f64], with: &mut Evaluation<'_>) {
        let nodes = (&self.nodes.starts[..], &self.nodes.x[..], p);
        with.simulate(problem, self.recording, nodes, &mut self.trajectory);
    }

    /// Linearizes along the trajectory, into the triangle.
    pub(crate) fn linearize(
        &mut self,
        problem: &Problem,
        p: &[f64],
        with: &mut Evaluation<'_>,
        block: &mut Block,
    ) {
        let (nx, width) = (self.scale.len(), self.triangle.width());
        let rows = self.trajectory.x.len() / nx;
        let mut s = vec![0.0; nx * width];
        for (i, scale) in self.scale.iter().enumerate().take(self.nq) {
            s[i * width + i] = *scale;
        }
        let mut moved = s.clone();
        self.triangle.clear();
        self.links.clear();
        self.growth = 1.0;
        let (p, gains) = p.split_at(with.dims.np);
        block.p.chunks_exact_mut(p.len().max(1)).for_each(|to| to.copy_from_slice(p));
        for first in (0..rows).step_by(BLOCK) {
            let points = BLOCK.min(rows - first);
            self.linearize_block(problem, (first, points), with, block);
            for k in first..first + points {
                if k + 1 == rows {
                    self.last.clone_from(&s);
                }
                self.push_row(problem, (k, gains), &mut s, (k - first, &mut *block));
                if k + 1 == rows {
                    break;
                }
                propagate(problem, with.dims, (k - first, &*block), &s, &mut moved);
                std::mem::swap(&mut s, &mut moved);
                if self.nodes.starts.get(self.links.len() + 1) == Some(&(k + 1)) {
                    self.link(&mut s);
                } else {
                    self.growth = self.growth.max(self.size(&s));
                }
            }
        }
    }

    fn linearize_block(
        &self,
        problem: &Problem,
        (first, points): (usize, usize),
        with: &mut Evaluation<'_>,
        block: &mut Block,
    ) {
        let Dims { nx, nu, np, .. } = with.dims;
        let part = |width: usize| first * width..(first + points) * width;
        let at = Stages {
            x: &self.trajectory.corrected[part(nx)],
            u: &self.recording.u[part(nu)],
            p: &block.p[..points * np],
        };
        with.model.linearize(at, block.model.as_mut().points(0..points, with.dims));
        with.work.linearized += points;
        if problem.has_outputs() {
            for (k, u) in block.read.chunks_exact_mut(nu.max(1)).take(points).enumerate() {
                u.copy_from_slice(self.recording.input_read(first + k, nu));
            }
            let (x, u) = (&self.trajectory.x[part(nx)], &block.read[..points * nu]);
            let at = Stages { x, u, ..at };
            let mut out = block.outputs.as_mut();
            with.model.linearize_output(at, out.points(0..points, with.dims));
        }
    }

    /// Pushes the residuals of row `k`, where the change of the state is `s`, which becomes that of
    /// the corrected state.
    fn push_row(
        &mut self,
        problem: &Problem,
        (k, gains): (usize, &[f64]),
        s: &mut [f64],
        (point, block): (usize, &mut Block),
    ) {
        let (nx, width, nq) = (self.scale.len(), self.triangle.width(), self.nq);
        let np = problem.parameters.len() - gains.len();
        let known = nq + problem.of_the_model().len();
        let ny = block.outputs.y.len() / BLOCK;
        let channels = problem.channels.len();
        block.change.clear();
        block.change.resize(if gains.is_empty() { 0 } else { nx * width }, 0.0);
        block.row.resize(width, 0.0);
        let row = &mut block.row;
        for (i, channel) in problem.channels.iter().enumerate() {
            let y = self.recording.y[k * channels + i];
            if y.is_nan() {
                continue;
            }
            let predicted = match channel.measured {
                Measured::State(state) => {
                    row.copy_from_slice(&s[state * width..(state + 1) * width]);
                    self.trajectory.x[k * nx + state]
                }
                Measured::Output(output) => {
                    let place = point * ny + output;
                    row.fill(0.0);
                    for (c, s) in
                        block.outputs.c[place * nx..][..nx].iter().zip(s.chunks_exact(width))
                    {
                        row.iter_mut().zip(s).for_each(|(to, s)| *to += c * s);
                    }
                    for (to, unknown) in row[nq..].iter_mut().zip(problem.of_the_model()) {
                        *to += block.outputs.e[place * np + unknown.place];
                    }
                    block.outputs.y[place]
                }
                _ => continue,
            };
            let weight = 1.0 / problem.sd(i);
            let pushed = self.triangle.push();
            pushed.iter_mut().zip(&*row).for_each(|(to, by)| *to = weight * by);
            pushed[width - 1] += weight * (predicted - y);
            let gains = gains.iter().skip(i).step_by(channels);
            for (state, (change, gain)) in
                block.change.chunks_exact_mut(width).zip(gains).enumerate()
            {
                change.iter_mut().zip(&*row).for_each(|(to, by)| *to -= gain * by);
                if let Some(change) = change[known..width - 1].get_mut(state * channels + i) {
                    *change += y - predicted;
                }
            }
        }
        s.iter_mut().zip(&block.change).for_each(|(s, change)| *s += change);
    }

    /// How much of its scale the state changes with q.
    fn size(&self, s: &[f64]) -> f64 {
        let rows = s.chunks_exact(self.triangle.width()).zip(&self.scale);
        let squares =
            rows.map(|(s, scale)| s[..self.nq].iter().map(|s| (s / scale).powi(2)).sum::<f64>());
        squares.sum::<f64>().sqrt()
    }

    /// Begins a segment: chooses new q, of which the change `s` of the state is made.
    fn link(&mut self, s: &mut [f64]) {
        let (nx, nq, width) = (self.scale.len(), self.nq, self.triangle.width());
        let defect = &self.trajectory.defects[self.links.len() * nx..][..nx];
        for (s, defect) in s.chunks_exact_mut(width).zip(defect) {
            s[width - 1] += defect;
        }
        let mut back = vec![0.0; nq * width];
        if let Some((u, sigma, v)) = self.directions(s) {
            let (scale, columns) = (&self.scale, width - nq);
            let u = |i: usize, k: usize| u[i * nq + k] * scale[i];
            // What the growing directions have of p and 1 becomes part of q'.
            let mut share = vec![0.0; nq * columns];
            for k in (0..nq).filter(|&k| sigma[k] > 1.0) {
                for c in 0..columns {
                    let of = |i: usize| u(i, k) / scale[i].powi(2) * s[i * width + nq + c];
                    share[k * columns + c] = (0..nx).map(of).sum();
                }
            }
            for i in 0..nx {
                let s = &mut s[i * width..(i + 1) * width];
                for k in 0..nq {
                    s[k] = u(i, k) * sigma[k].min(1.0);
                    for (to, share) in s[nq..].iter_mut().zip(&share[k * columns..]) {
                        *to -= u(i, k) * share;
                    }
                }
            }
            for (i, back) in back.chunks_exact_mut(width).enumerate() {
                for k in 0..nq {
                    back[k] = v[i * nq + k] / sigma[k].max(1.0);
                    let w = back[k];
                    for (to, share) in back[nq..].iter_mut().zip(&share[k * columns..]) {
                        *to -= w * share;
                    }
                }
            }
            substitute(&mut self.triangle, nq, &back);
        }
        self.links.push(Link { back, node: s.to_vec() });
    }

    /// How much of its scale the last state changes where the first one changes by its scale, in the
    /// worst of directions; 0 where the first state is known.
    pub(crate) fn growth_to_end(&self) -> f64 {
        let (nx, nq, width) = (self.scale.len(), self.nq, self.triangle.width());
        // Of the first state by q, which for the last segment is another q than for the first.
        let Some((_, sigma, v)) = self.directions(&self.first_state()) else { return 0.0 };
        let last = |i: usize, k: usize| -> f64 {
            let row = &self.last[i * width..i * width + nq];
            row.iter().zip(v.iter().skip(k).step_by(nq)).map(|(s, v)| s * v).sum()
        };
        let change = Mat::from_fn(nx, nq, |i, k| last(i, k) / (sigma[k] * self.scale[i]));
        change.norm_l2()
    }

    /// The singular value decomposition U, sigma, V of the change of the state by q, in scales of
    /// the states; none where there is no q.
    fn directions(&self, s: &[f64]) -> Option<(Vec<f64>, Vec<f64>, Vec<f64>)> {
        let (nx, nq, width) = (self.scale.len(), self.nq, self.triangle.width());
        let matrix = Mat::from_fn(nx, nq, |i, k| s[i * width + k] / self.scale[i]);
        let svd = if nq > 0 { matrix.svd().ok()? } else { return None };
        let dense = |of: faer::MatRef<'_, f64>| -> Vec<f64> {
            (0..nq * nq).map(|at| of[(at / nq, at % nq)]).collect()
        };
        let sigma = svd.S().column_vector().iter().copied().collect();
        Some((dense(svd.U()), sigma, dense(svd.V())))
    }

    /// Adds `alpha` times the change to the nodes that (q, dp, 1) of the last segment makes.
    pub(crate) fn advance(&self, (q, dp): (&[f64], &[f64]), alpha: f64, nodes: &mut [f64]) {
        let (nx, nq) = (self.scale.len(), self.nq);
        let mut z = [q, dp, &[1.0]].concat();
        let product = |rows: &[f64], z: &[f64]| -> Vec<f64> {
            let rows = rows.chunks_exact(z.len());
            rows.map(|row| row.iter().zip(z).map(|(a, b)| a * b).sum()).collect()
        };
        for (segment, link) in self.links.iter().enumerate().rev() {
            let change = product(&link.node, &z);
            let node = &mut nodes[(segment + 1) * nx..(segment + 2) * nx];
            node.iter_mut().zip(&change).for_each(|(x, change)| *x += alpha * change);
            let before = product(&link.back, &z);
            z[..nq].copy_from_slice(&before);
        }
        for ((x, scale), q) in nodes.iter_mut().zip(&self.scale).zip(&z[..nq]) {
            *x += alpha * scale * q;
        }
    }

    /// The change of the first state by (q, p, 1), `[nx, width]`.
    pub(crate) fn first_state(&self) -> Vec<f64> {
        let (nx, nq, width) = (self.scale.len(), self.nq, self.triangle.width());
        let mut all = vec![0.0; nx * width];
        for (column, z) in (0..width).map(|c| (c, unit(width, c))) {
            let mut nodes = vec![0.0; nx * self.nodes.starts.len()];
            // Without the constant, which is none of the unknowns.
            let mut zero = nodes.clone();
            self.advance((&z[..nq], &z[nq..width - 1]), 1.0, &mut nodes);
            self.advance((&vec![0.0; nq], &vec![0.0; width - 1 - nq]), 1.0, &mut zero);
            for i in 0..nx {
                all[i * width + column] = nodes[i] - zero[i];
            }
        }
        all
    }

    /// The sum of the gaps between segments, in scales of the states.
    pub(crate) fn gaps(&self) -> f64 {
        let gaps = self.trajectory.defects.chunks_exact(self.scale.len());
        gaps.flatten().zip(self.scale.iter().cycle()).map(|(d, scale)| (d / scale).abs()).sum()
    }
}

fn unit(width: usize, at: usize) -> Vec<f64> {
    let mut unit = vec![0.0; width];
    unit[at] = 1.0;
    unit
}

/// Writes the change of the next state, `[A s + E]`, into `next`.
fn propagate(
    problem: &Problem,
    dims: Dims,
    (point, block): (usize, &Block),
    s: &[f64],
    next: &mut [f64],
) {
    let Dims { nx, np, .. } = dims;
    let width = s.len() / nx;
    let a = &block.model.a[point * nx * nx..(point + 1) * nx * nx];
    next.fill(0.0);
    for (i, next) in next.chunks_exact_mut(width).enumerate() {
        for (a, s) in a[i * nx..(i + 1) * nx].iter().zip(s.chunks_exact(width)) {
            next.iter_mut().zip(s).for_each(|(next, s)| *next += a * s);
        }
        let e = &block.model.e[(point * nx + i) * np..(point * nx + i + 1) * np];
        let by_p = &mut next[width - 1 - problem.unknown.len()..];
        for (to, unknown) in by_p.iter_mut().zip(problem.of_the_model()) {
            *to += e[unknown.place];
        }
    }
}

/// Puts q = W (q', p, 1) into the triangle.
fn substitute(triangle: &mut Triangle, nq: usize, back: &[f64]) {
    let width = triangle.width();
    let mut of_q = vec![0.0; nq];
    for row in triangle.factor_mut().chunks_exact_mut(width) {
        of_q.copy_from_slice(&row[..nq]);
        row[..nq].fill(0.0);
        for (r, back) in of_q.iter().zip(back.chunks_exact(width)) {
            row.iter_mut().zip(back).for_each(|(to, back)| *to += r * back);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{Channel, Criterion, InitialState, Unknown};
    use pinc_expr::{Equations, OutputExpression};
    use pinc_ode::{DynPlant, Integrator, Variable};

    fn plant() -> Box<dyn DynPlant> {
        let equation = |(name, text): (&str, &str)| (name.to_owned(), text.to_owned());
        let y = OutputExpression { expression: "w*sin(x) + u".to_owned(), unit: String::new() };
        let equations = Equations {
            states: ["x", "v"].map(|name| Variable::new(name, "")).to_vec(),
            inputs: vec![Variable::new("u", "")],
            parameters: [("a".to_owned(), 1.0), ("w".to_owned(), 1.0)].into(),
            derivatives: [("x", "v"), ("v", "u - a*sin(x) - 0.3*v")].map(equation).into(),
            outputs: [("y".to_owned(), y)].into(),
            ..Equations::default()
        };
        equations.compile_with(&["a", "w"]).unwrap().into_dyn()
    }

    /// The derivatives of the cost by the initial state, the parameters and K are those that
    /// differences have.
    #[test]
    fn derivatives_of_predictions_are_exact() {
        let mut model = plant().model(Integrator::Rk4, 0.2, 1).unwrap();
        let mut with = Evaluation::new(&mut *model);
        let unknown = |(place, name): (usize, &str)| Unknown {
            name: name.to_owned(),
            place,
            initial: 1.2,
            low: 0.0,
            high: 9.0,
            prior: None,
        };
        let channel = |measured, sd| Channel {
            name: "y".to_owned(),
            measured,
            sd: Some(sd),
            is_estimated: false,
        };
        let problem = Problem {
            channels: vec![channel(Measured::Output(0), 0.4), channel(Measured::State(1), 0.7)],
            parameters: vec![1.0; 2],
            unknown: [unknown((0, "a")), unknown((1, "w"))].to_vec(),
            initial_state: InitialState::Free(vec![1.0, -0.5]),
            states: vec!["x".to_owned(), "v".to_owned()],
            inputs: vec!["u".to_owned()],
            criterion: Criterion::PredictionError,
        };
        let problem = problem.with_gains(&[0.2, 0.1, -0.2, 0.3]);
        let u: Vec<f64> = (0..90).map(|k| (0.3 * f64::from(k)).sin()).collect();
        let mut y: Vec<f64> = (0..180).map(|k| (0.17 * f64::from(k)).cos()).collect();
        (y[6], y[7], y[21]) = (f64::NAN, f64::NAN, f64::NAN);
        let recording = Recording { name: "", before: None, u: &u, y: &y };
        let scale = vec![0.5, 2.0];
        let mut cost = |x: &[f64], p: &[f64]| {
            let mut of = Shooting::new(&problem, recording, Nodes::first(x), scale.clone());
            of.simulate(&problem, p, &mut with);
            let mut block = Block::new(with.dims);
            of.linearize(&problem, p, &mut with, &mut block);
            let width = of.triangle.width();
            let rows: Vec<_> = of.triangle.factor().chunks(width).map(<[f64]>::to_vec).collect();
            let slope = |i: usize| rows.iter().map(|row| row[i] * row[width - 1]).sum::<f64>();
            (of.trajectory.cost, (0..width - 1).map(slope).collect::<Vec<_>>())
        };
        let (x, p) = ([1.0, -0.5], problem.start());
        let (_, slope) = cost(&x, &p);
        assert_eq!(slope.len(), 8);
        for (i, slope) in slope.iter().enumerate() {
            let moved = |by: f64| {
                let (mut x, mut p) = (x, p.clone());
                if i < 2 {
                    x[i] += by * scale[i]
                } else {
                    p[i - 2] += by
                }
                (x, p)
            };
            let [up, down] = [1e-5, -1e-5].map(moved).map(|(x, p)| cost(&x, &p).0);
            let difference = (up - down) / 2e-5;
            assert!(
                (difference - slope).abs() < 1e-6 * (1.0 + slope.abs()),
                "{i}: {difference} {slope}"
            );
        }
    }
}
