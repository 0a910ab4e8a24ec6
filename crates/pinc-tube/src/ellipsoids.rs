//! Deviations from a plan, stage by stage.

use crate::gains::Gains;
use crate::matrix::{congruence, dot, multiply, quadratic};
use crate::sources::length;
use crate::{
    AlongPlan, BackOffs, Feedback, Interval, Sources, Tube, TubeError, TubeModel, normal_quantile,
};
use pinc_ode::{Dims, LinearizationBuffer, OutputLinearization, Stages};

/// A model's error that is no number, or larger, counts as so many units of its state.
const MOST: f64 = 1e3;

/// How many programs of a step without a plan before it have bounds of their own, at least.
const FIRST_PROGRAMS: usize = 10;

/// The tube of a linearized plan.
///
/// With A and B along the plan, a feedback K on deviations and M = A + B K, there are three kinds of
/// deviations of a predicted state:
///
/// ```text
/// random    P <- L P L' + W         covariance, from the estimator's and process_sd
/// bounded   E <- M E M' (+) boxes   an ellipsoid around all sums, from boxes and the model's error
/// constant  g <- M g + dF           one direction per parameter, dF = F(.., end) - F(.., p)
/// ```
///
/// and a bound on h'x moves inwards by z sqrt(h'P h) + sqrt(h'E h) + the sum of |h'g|, z being the
/// normal distribution's quantile. Where parameters p of the controller's model are estimated, P is
/// that of (x, p), of which p is constant: L = (M, dF/dp; 0, I). K is 0 at the first stage. (+) is the
/// ellipsoid of least trace around the sum, where state i counts in units of how far it may be,
/// `sqrt((M E M')_ii) + box_i`: so it does not depend on units. What is quadratic in deviations is
/// neglected.
///
/// Reference: A. Zanelli, J. Frey, F. Messerer, M. Diehl, "Zero-order robust nonlinear model
/// predictive control with ellipsoidal uncertainty sets", IFAC-PapersOnLine 54-6 (2021).
#[derive(Debug)]
pub struct EllipsoidTube {
    dims: Dims,
    stages: usize,
    sources: Sources,
    model: Option<TubeModel>,
    gains: Gains,
    /// The sizes of deviations of the states that count the same.
    units: Vec<f64>,
    /// Whether bounds of inputs move.
    tightens_inputs: bool,
    /// See [`Tube::programs`].
    programs: usize,
    /// z
    quantile: f64,
    /// How many parameters are estimated.
    estimated: usize,
    /// P at `x_0` .. `x_N`, `[N + 1, n + np, n + np]`, with the `np` estimated parameters.
    p: Vec<f64>,
    /// E, `[n, n]`.
    e: Vec<f64>,
    /// One direction per parameter, `[parameters, n]`.
    g: Vec<f64>,
    work: Work,
}

/// An end of the interval in which an input acts.
#[derive(Clone, Copy, Debug)]
enum IntervalEnd {
    Start,
    End,
}

/// Numbers of one stage.
#[derive(Debug, Default)]
struct Work {
    /// M, `[n, n]`.
    m: Vec<f64>,
    /// L, `[n + np, n + np]`.
    l: Vec<f64>,
    /// The model at the stage; empty where no parameter is estimated.
    by_p: Option<LinearizationBuffer>,
    /// L P, and M E M'.
    products: [Vec<f64>; 2],
    /// The largest error in the stage.
    boxes: Vec<f64>,
    next: Vec<f64>,
    ends: [Vec<f64>; 2],
    /// All parameters of the model.
    p: Vec<f64>,
    x: Vec<f64>,
    /// y, C, D and dh/dp.
    outputs: [Vec<f64>; 4],
    /// D K, `[n]`.
    through: Vec<f64>,
}

impl EllipsoidTube {
    /// The tube of plans with `stages` stages of a controller's model of dimensions `dims`. The
    /// `model` is needed for intervals and for bounds on outputs. `units`, `[n]`, are the sizes of
    /// deviations of the states that count the same.
    ///
    /// # Errors
    ///
    /// [`TubeError`] if a list is of the wrong length or a number out of its range, and where a
    /// probability or the model is missing.
    pub fn new(
        (dims, stages): (Dims, usize),
        sources: Sources,
        model: Option<TubeModel>,
        feedback: Feedback,
        units: Vec<f64>,
    ) -> Result<Self, TubeError> {
        sources.validate(dims, model.as_ref())?;
        length("the units of states", units.len(), dims.nx)?;
        if let Feedback::Given(gain) = &feedback {
            length("feedback", gain.len(), dims.nu * dims.nx)?;
        }
        let (n, count) = (dims.nx, sources.parameters.len());
        let estimated = if sources.estimate { dims.np } else { 0 };
        let size = n + estimated;
        let zeros = |size: usize| vec![0.0; size];
        let of_model = model.as_ref().map_or(dims, |of| of.model.dims());
        let ny = of_model.ny;
        Ok(Self {
            dims,
            stages,
            gains: Gains::new(feedback, dims, stages),
            quantile: sources.probability.map_or(0.0, normal_quantile),
            estimated,
            p: zeros((stages + 1) * size * size),
            e: zeros(n * n),
            g: zeros(count * n),
            work: Work {
                m: zeros(n * n),
                l: zeros(size * size),
                by_p: (estimated > 0).then(|| LinearizationBuffer::new(of_model, 1)),
                products: [zeros(size * size), zeros(n * n)],
                boxes: zeros(n),
                next: zeros(n),
                ends: [zeros(n), zeros(n)],
                p: zeros(of_model.np),
                x: zeros(n),
                outputs: [ny, ny * n, ny * dims.nu, ny * of_model.np].map(zeros),
                through: zeros(n),
            },
            sources,
            model,
            units,
            tightens_inputs: true,
            programs: 1,
        })
    }

    /// Whether the bounds of inputs move by what the feedback may ask for, as they do otherwise.
    /// Where they do not, the feedback may ask for more than the bounds allow.
    #[must_use]
    pub fn tightening_inputs(self, tightens_inputs: bool) -> Self {
        Self { tightens_inputs, ..self }
    }

    /// How many programs of a step have bounds of their own: see [`Tube::programs`].
    #[must_use]
    pub fn tightening_programs(self, programs: usize) -> Self {
        Self { programs, ..self }
    }

    /// The covariances of the states `x_0` .. `x_N` of the last plan, each with the `np` parameters
    /// of the controller's model if the estimator's covariance counts: `[N + 1, n + np, n + np]`.
    #[must_use]
    pub fn covariances(&self) -> &[f64] {
        &self.p
    }

    /// K at each stage of the last plan, `[N, m, n]`.
    #[must_use]
    pub fn gains(&self) -> &[f64] {
        &self.gains.k
    }

    /// How far h'x + k'p can be from the plan at `x_j`, of which the bounded and constant deviations are
    /// the present ones; without k if it is empty.
    fn width(&self, [by_x, by_p]: [&[f64]; 2], j: usize) -> f64 {
        let (n, size) = (self.dims.nx, self.dims.nx + self.estimated);
        let covariance = self.p[j * size * size..(j + 1) * size * size].chunks_exact(size);
        let by = |row: &[f64]| dot(by_x, &row[..n]) + dot(by_p, &row[n..]);
        let random: f64 = by_x.iter().chain(by_p).zip(covariance).map(|(h, row)| h * by(row)).sum();
        let random = random.max(0.0).sqrt();
        let bounded = quadratic(by_x, &self.e).max(0.0).sqrt();
        let constant: f64 = self.g.chunks_exact(n).map(|g| dot(by_x, g).abs()).sum();
        self.quantile * random + bounded + constant
    }

    /// [`EllipsoidTube::width`] of a state.
    fn width_of_state(&self, i: usize, j: usize) -> f64 {
        let (n, size) = (self.dims.nx, self.dims.nx + self.estimated);
        let random = self.p[j * size * size + i * (size + 1)].max(0.0).sqrt();
        let constant: f64 = self.g.iter().skip(i).step_by(n).map(|g| g.abs()).sum();
        self.quantile * random + self.e[i * (n + 1)].max(0.0).sqrt() + constant
    }

    /// Deviations at the end of stage `j` from those at its beginning.
    fn propagate(&mut self, j: usize, at: Stages<'_>, [a, b]: [&[f64]; 2]) {
        let Dims { nx: n, nu, .. } = self.dims;
        let m = &mut self.work.m;
        m.copy_from_slice(a);
        let k = self.gains.stage(j);
        for (m, b) in m.chunks_exact_mut(n).zip(b.chunks_exact(nu)) {
            for (b, k) in b.iter().zip(k.chunks_exact(n)) {
                m.iter_mut().zip(k).for_each(|(m, k)| *m += b * k);
            }
        }
        self.write_l(at);
        let size = n + self.estimated;
        let Work { m, l, products: [lp, mem], .. } = &mut self.work;
        let (before, after) = self.p.split_at_mut((j + 1) * size * size);
        let after = &mut after[..size * size];
        congruence(l, &before[j * size * size..], size, lp, after);
        for (i, sd) in self.sources.process_sd.iter().enumerate() {
            after[i * (size + 1)] += sd * sd;
        }
        if !self.sources.boxes.is_empty() || self.sources.error.is_some() {
            congruence(m, &self.e, n, &mut lp[..n * n], mem);
            self.add_boxes(at);
        }
        if !self.sources.parameters.is_empty() {
            self.add_parameters(at);
        }
    }

    /// Writes L = (M, dF/dp; 0, I), of which p are the estimated parameters.
    fn write_l(&mut self, at: Stages<'_>) {
        let (n, size) = (self.dims.nx, self.dims.nx + self.estimated);
        let Work { m, l, by_p, p, .. } = &mut self.work;
        for (l, m) in l.chunks_exact_mut(size).zip(m.chunks_exact(n)) {
            l[..n].copy_from_slice(m);
        }
        let (Some(by_p), Some(TubeModel { model, more })) = (by_p, &mut self.model) else { return };
        write_parameters(at.p, more, p);
        model.linearize(Stages { p, ..at }, by_p.as_mut());
        for (l, e) in l.chunks_exact_mut(size).zip(by_p.e.chunks_exact(p.len())) {
            l[n..].copy_from_slice(&e[..size - n]);
        }
        l[n * size..].iter_mut().skip(n).step_by(size + 1).for_each(|diagonal| *diagonal = 1.0);
    }

    /// The sum of M E M' and the segments of the boxes: (sum of s) (sum of Q/s) with s the roots of
    /// the traces of all Q, in units of the deviations.
    fn add_boxes(&mut self, at: Stages<'_>) {
        let n = self.dims.nx;
        let Work { boxes, next, products: [_, mem], .. } = &mut self.work;
        boxes.fill(0.0);
        self.sources.boxes.iter().zip(&mut *boxes).for_each(|(given, to)| *to += given);
        if let Some(error) = &mut self.sources.error {
            error.write(at.x, at.u, at.p, next);
            for ((to, error), unit) in boxes.iter_mut().zip(next).zip(&self.units) {
                let size = error.abs();
                *to += if size < MOST * unit { size } else { MOST * unit };
            }
        }
        // In units of sqrt(Q_ii) + box_i, the diagonal of Q has part^2 and a box 1 - part.
        let far = |i: usize| mem[i * (n + 1)].max(0.0).sqrt();
        let part = |i: usize| if far(i) > 0.0 { far(i) / (far(i) + boxes[i]) } else { 0.0 };
        let root = (0..n).map(|i| part(i) * part(i)).sum::<f64>().sqrt();
        let of_boxes = |i: usize| if boxes[i] > 0.0 { 1.0 - part(i) } else { 0.0 };
        let sum = root + (0..n).map(of_boxes).sum::<f64>();
        let factor = if root > 0.0 { sum / root } else { 0.0 };
        self.e.iter_mut().zip(&*mem).for_each(|(e, mem)| *e = factor * *mem);
        for (i, size) in boxes.iter().enumerate() {
            self.e[i * (n + 1)] += sum * size * (far(i) + size);
        }
    }

    /// g <- M g + dF for the end of each interval at which dF is larger.
    fn add_parameters(&mut self, at: Stages<'_>) {
        let n = self.dims.nx;
        let Some(TubeModel { model, more }) = &mut self.model else { return };
        let Work { m, next, ends: [low, high], p, x, .. } = &mut self.work;
        write_parameters(at.p, more, p);
        model.step(at.x, at.u, p, next);
        let units = &self.units;
        for (g, of) in self.g.chunks_exact_mut(n).zip(&self.sources.parameters) {
            let nominal = p[of.place];
            for (end, value) in [(&mut *low, of.low), (&mut *high, of.high)] {
                p[of.place] = value;
                model.step(at.x, at.u, p, end);
                end.iter_mut().zip(&*next).for_each(|(end, next)| *end -= next);
            }
            p[of.place] = nominal;
            let size =
                |end: &[f64]| end.iter().zip(units).map(|(d, unit)| (d / unit).powi(2)).sum();
            let (down, up): (f64, f64) = (size(low), size(high));
            // Where the model has no value at an end, neither has the deviation.
            let farther = up >= down || up.is_nan();
            multiply(m, g, n, 1, x);
            // Both ends along one direction, so that the stages add up.
            for (i, g) in g.iter_mut().enumerate() {
                *g = x[i] + if farther { high[i] } else { -low[i] };
            }
        }
    }

    /// Linearizes the outputs at a state under the input of stage `j`.
    fn linearize_outputs(&mut self, j: usize, along: AlongPlan<'_>, end: IntervalEnd) {
        let (at, _) = along.stage(j);
        let Some(TubeModel { model, more }) = &mut self.model else { return };
        let Work { p, x, outputs: [y, c, d, e], .. } = &mut self.work;
        write_parameters(at.p, more, p);
        match end {
            IntervalEnd::Start => x.copy_from_slice(at.x),
            IntervalEnd::End if j + 1 < along.stages() => {
                x.copy_from_slice(along.stage(j + 1).0.x);
            }
            IntervalEnd::End => model.step(at.x, at.u, p, x),
        }
        model.linearize_output(Stages { x, u: at.u, p }, OutputLinearization { y, c, d, e });
    }

    /// By how much output `i` may deviate since the parameters do, directly.
    fn direct(&self, i: usize) -> f64 {
        let Work { p, outputs: [_, _, _, e], .. } = &self.work;
        let by_p = &e[i * p.len()..(i + 1) * p.len()];
        let farthest = |of: &Interval| (of.high - p[of.place]).max(p[of.place] - of.low);
        let parameters = self.sources.parameters.iter();
        parameters.map(|of| by_p[of.place].abs() * farthest(of)).sum()
    }

    /// Linearizes the outputs at an end of stage `j`, and writes how far they may be from the plan for
    /// what is known at its start: there (C + D K, E) times the deviation of (x, p), at its end D K
    /// times that of x; and what comes from the intervals of parameters directly.
    fn begin_outputs(&mut self, j: usize, along: AlongPlan<'_>, end: IntervalEnd, to: &mut [f64]) {
        let Dims { nx: n, nu, .. } = self.dims;
        self.linearize_outputs(j, along, end);
        let mut row = std::mem::take(&mut self.work.through);
        for (i, to) in to.iter_mut().enumerate() {
            let [_, c, d, _] = &self.work.outputs;
            multiply(&d[i * nu..(i + 1) * nu], self.gains.stage(j), nu, n, &mut row);
            let by_p = match end {
                IntervalEnd::Start => {
                    row.iter_mut().zip(&c[i * n..(i + 1) * n]).for_each(|(row, c)| *row += c);
                    self.output_by_p(i)
                }
                IntervalEnd::End => &[],
            };
            *to = self.width([&row, by_p], j) + self.direct(i);
        }
        self.work.through = row;
    }

    /// Adds what comes through the state at the end of stage `j` and the estimated parameters.
    fn end_outputs(&self, j: usize, to: &mut [f64]) {
        let c = self.work.outputs[1].chunks_exact(self.dims.nx);
        for (i, (to, c)) in to.iter_mut().zip(c).enumerate() {
            *to += self.width([c, self.output_by_p(i)], j + 1);
        }
    }

    /// The derivatives of output `i` by the estimated parameters.
    fn output_by_p(&self, i: usize) -> &[f64] {
        let Work { p, outputs: [_, _, _, e], .. } = &self.work;
        &e[i * p.len()..][..self.estimated]
    }
}

fn write_parameters(of_controller: &[f64], more: &[f64], p: &mut [f64]) {
    let (first, rest) = p.split_at_mut(of_controller.len());
    first.copy_from_slice(of_controller);
    rest.copy_from_slice(more);
}

impl Tube for EllipsoidTube {
    fn write(&mut self, along: AlongPlan<'_>, back_offs: &mut BackOffs) {
        let Dims { nx: n, nu: m, .. } = self.dims;
        self.gains.follow(along);
        self.e.fill(0.0);
        self.g.fill(0.0);
        back_offs.inputs.fill(0.0);
        let last = back_offs.inputs.len() / m - 1;
        let ny = back_offs.outputs.len() / self.stages;
        for j in 0..self.stages {
            for i in (0..m).filter(|_| self.tightens_inputs) {
                // The last free input acts in all stages that are left.
                let width = self.width([&self.gains.stage(j)[i * n..(i + 1) * n], &[]], j);
                let to = &mut back_offs.inputs[j.min(last) * m + i];
                *to = to.max(width);
            }
            let (at, jacobians) = along.stage(j);
            if let Some(starts) = back_offs.starts.get_mut(j * ny..(j + 1) * ny) {
                self.begin_outputs(j, along, IntervalEnd::Start, starts);
            }
            let outputs = &mut back_offs.outputs[j * ny..(j + 1) * ny];
            if ny > 0 {
                self.begin_outputs(j, along, IntervalEnd::End, outputs);
            }
            self.propagate(j, at, jacobians);
            for i in 0..n {
                back_offs.states[j * n + i] = self.width_of_state(i, j + 1);
            }
            self.end_outputs(j, outputs);
        }
    }

    fn set_covariance(&mut self, covariance: &[f64]) {
        if self.sources.estimate {
            self.p[..covariance.len()].copy_from_slice(covariance);
        }
    }

    fn programs(&self, is_first: bool) -> usize {
        let Sources { parameters, error, .. } = &self.sources;
        // What moves with the plan may be small along a guess.
        let moves = !parameters.is_empty() || error.is_some() || self.estimated > 0;
        if is_first && moves { self.programs.max(FIRST_PROGRAMS) } else { self.programs }
    }
}
