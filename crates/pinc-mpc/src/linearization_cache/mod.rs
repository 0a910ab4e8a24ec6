//! The model along a plan.

#[cfg(test)]
mod tests;

use crate::horizon::Horizon;
use crate::{NmpcProblem, Scenarios};
use pinc_ode::{Dims, Linearization, Memory, Model, Stages};
use pinc_qp::{OcpDims, all_finite};
use pinc_tube::AlongPlan;
use std::ops::Range;

/// The model, linearized at all stages of a plan.
///
/// A controller begins each step with the plan of the step before, shifted by one stage. The model
/// was linearized at all of its stages except the first and the last when that plan was judged;
/// these are not evaluated again. A tree begins with the plan in its place.
#[derive(Debug)]
pub(crate) struct LinearizationCache {
    dims: OcpDims,
    stages: StageBlocks,
    /// Where it is to be linearized next.
    input: Points,
    /// The first and the last stage.
    ends: StageBlocks,
    /// p at each stage, `[stages, np]`.
    parameters: Vec<f64>,
    /// p from the end of the last stage on, `np`.
    after: Vec<f64>,
    scenarios: Option<Scenarios>,
    /// The numbers of stages and of parameters.
    counts: [usize; 2],
    /// Whether p is the same at all stages.
    one_p: bool,
    /// Whether there are numbers in `stages`.
    known: bool,
    /// Whether there are numbers in `stages`, be they of other parameters.
    filled: bool,
    /// At how many stages the model has been asked.
    pub(crate) evaluated: usize,
}

/// States and the inputs that act in them, `[stages, n]` and `[stages, m]`.
#[derive(Debug)]
struct Points {
    x: Vec<f64>,
    u: Vec<f64>,
}

/// Points with f(x, u) and its Jacobians, as in [`Model::linearize`].
#[derive(Debug)]
struct StageBlocks {
    points: Points,
    next: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
}

impl LinearizationCache {
    pub(crate) fn new(dims: OcpDims, problem: &NmpcProblem) -> Self {
        let (stages, p) = (dims.horizon.max(2), &problem.parameters);
        let mut cache = Self {
            dims,
            parameters: p.repeat(stages),
            after: p.clone(),
            scenarios: problem.scenarios.clone(),
            counts: [stages, p.len()],
            stages: StageBlocks::new(dims, dims.horizon),
            input: Points::new(dims, dims.horizon),
            ends: StageBlocks::new(dims, 2),
            one_p: true,
            known: false,
            filled: false,
            evaluated: 0,
        };
        cache.set_parameters(p);
        cache
    }

    /// f(x, u), `[N, n]`, A, `[N, n, n]`, and B, `[N, n, m]`, of the last plan.
    pub(crate) fn parts(&self) -> [&[f64]; 3] {
        let StageBlocks { next, a, b, .. } = &self.stages;
        [next, a, b]
    }

    /// p at each stage.
    fn stage_parameters(&self) -> &[f64] {
        &self.parameters[..self.dims.horizon * self.counts[1]]
    }

    /// Sets p at each stage; whether it changed, by which what is known is no longer so.
    pub(crate) fn set_stage_parameters<'p>(&mut self, of: impl Fn(usize) -> &'p [f64]) -> bool {
        let (mut changed, last, width) = (false, self.dims.horizon - 1, self.counts[1]);
        let rows = self.parameters.chunks_exact_mut(width.max(1));
        for (stage, row) in rows.enumerate() {
            let p = of(stage.min(last));
            let row = &mut row[width - p.len()..];
            changed |= row.iter().zip(p).any(|(old, new)| old.to_bits() != new.to_bits());
            row.copy_from_slice(p);
        }
        self.known &= !changed;
        let p = of(last + 1);
        let after = &mut self.after[width - p.len()..];
        changed |= *after != *p;
        after.copy_from_slice(p);
        self.one_p = self.parameters[width..] == self.parameters[..self.parameters.len() - width];
        changed
    }

    /// p of a stage.
    pub(crate) fn parameters(&self, stage: usize) -> &[f64] {
        let np = self.counts[1];
        &self.parameters[stage * np..(stage + 1) * np]
    }

    /// p from the end of a stage on: of what is read there. A branch of a tree keeps its own.
    pub(crate) fn parameters_after(&self, stage: usize) -> &[f64] {
        match stage + 1 {
            _ if !self.dims.tree.is_chain() => self.parameters(stage),
            next if next < self.dims.horizon => self.parameters(next),
            _ => &self.after,
        }
    }

    /// Sets p, by which what is known is no longer so.
    pub(crate) fn set_parameters(&mut self, p: &[f64]) {
        self.after.copy_from_slice(p);
        for parameters in self.parameters.chunks_exact_mut(self.counts[1].max(1)) {
            parameters.copy_from_slice(p);
        }
        self.one_p = true;
        if let Some(scenarios) = &self.scenarios {
            scenarios.apply(self.dims.tree, &mut self.parameters, self.counts[1]);
        }
        self.known = false;
    }

    /// Forgets what is known.
    pub(crate) fn forget(&mut self) {
        (self.known, self.filled) = (false, false);
    }

    /// Saves or restores where the models were linearized last, and linearizes them there again.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>, horizon: &mut Horizon) {
        memory.flag(&mut self.filled);
        let Points { x, u } = &mut self.stages.points;
        let parts = [x, u, &mut self.parameters, &mut self.after];
        parts.into_iter().for_each(|part| memory.numbers(part));
        if self.filled && memory.restores() {
            let (all, p) = (0..self.dims.horizon, self.counts[1] * self.dims.horizon);
            self.filled = self.stages.linearize(&self.parameters[..p], |at, out| {
                horizon.linearize(all, at, out, &mut || false)
            });
        }
    }

    /// Linearizes along the plan `z` from `x0`; whether it came to the end before `expired` said
    /// that the time is up.
    pub(crate) fn follow(
        &mut self,
        horizon: &mut Horizon,
        [x0, z]: [&[f64]; 2],
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        let dims = self.dims;
        let Points { x, u } = &mut self.input;
        if dims.tree.is_chain() {
            x[..dims.nx].copy_from_slice(x0);
            x[dims.nx..].copy_from_slice(&z[..dims.all_states() - dims.nx]);
        } else {
            for (j, x) in x.chunks_exact_mut(dims.nx).enumerate() {
                x.copy_from_slice(dims.state(dims.origin(j)).map_or(x0, |state| &z[state]));
            }
        }
        for (j, u) in u.chunks_exact_mut(dims.nu).enumerate() {
            u.copy_from_slice(&z[dims.input(dims.input_of(j))]);
        }
        // What a model had no value for is computed again.
        let one = horizon.has_one_model() && self.one_p && dims.tree.is_chain();
        let moved_on = one && self.known && self.is_moved_on() && self.stages.is_finite();
        let known = self.known && !dims.tree.is_chain() && self.stages.is_finite();
        std::mem::swap(&mut self.input, &mut self.stages.points);
        self.known = true;
        if moved_on {
            self.evaluated += 2;
            self.renew_ends(horizon.first_mut());
        } else {
            let renewed = if known { self.changed() } else { 0..dims.horizon };
            self.evaluated += renewed.len();
            let p = self.counts[1] * self.dims.horizon;
            let by = |at: Stages<'_>, out: Linearization<'_>| {
                horizon.linearize(renewed, at, out, expired)
            };
            self.known = self.stages.linearize(&self.parameters[..p], by);
        }
        self.filled = self.known;
        self.known
    }

    /// Whether the model was linearized along a plan, of whichever parameters.
    pub(crate) fn is_filled(&self) -> bool {
        self.filled
    }

    /// The model along the last plan, moved on by `shift` stages; `None` where it has no value.
    pub(crate) fn ahead(&self, shift: usize) -> Option<AlongPlan<'_>> {
        if !self.filled || !self.stages.is_finite() {
            return None;
        }
        let StageBlocks { points: Points { x, u }, a, b, .. } = &self.stages;
        let OcpDims { nx, nu, .. } = self.dims;
        let dims = Dims::new(nx, nu).with_parameters(self.counts[1]);
        let stages = Stages { x, u, p: self.stage_parameters() };
        Some(AlongPlan::new(stages, [a, b], dims, shift))
    }

    /// Whether the stages between the first and the last are those that came one later before.
    fn is_moved_on(&self) -> bool {
        let OcpDims { nx: n, nu: m, horizon, .. } = self.dims;
        let same = |input: &[f64], known: &[f64], width: usize| {
            let input = input[width..(horizon - 1) * width].iter().map(|v| v.to_bits());
            input.eq(known[2 * width..].iter().map(|v| v.to_bits()))
        };
        let Points { x, u } = &self.stages.points;
        horizon > 2 && same(&self.input.x, x, n) && same(&self.input.u, u, m)
    }

    /// The stages from the first to the last whose point is another one than before: where a tree
    /// stays in place, those that leave its root.
    fn changed(&self) -> Range<usize> {
        let OcpDims { nx: n, nu: m, horizon, .. } = self.dims;
        let (new, old) = (&self.stages.points, &self.input);
        let differs = |&j: &usize| {
            let same = |a: &[f64], b: &[f64], width: usize| {
                let [a, b] = [a, b].map(|of| of[j * width..(j + 1) * width].iter());
                a.map(|v| v.to_bits()).eq(b.map(|v| v.to_bits()))
            };
            !(same(&new.x, &old.x, n) && same(&new.u, &old.u, m))
        };
        let first = (0..horizon).find(differs).unwrap_or(horizon);
        first..(first..horizon).rev().find(differs).map_or(first, |last| last + 1)
    }

    /// Moves the stages on, and linearizes at the first and the last.
    fn renew_ends(&mut self, model: &mut dyn Model) {
        let OcpDims { nx: n, nu: m, horizon: count, .. } = self.dims;
        let Self { stages, ends, parameters, counts, .. } = self;
        let last = count - 1;
        for (from, to, width) in
            [(&stages.points.x, &mut ends.points.x, n), (&stages.points.u, &mut ends.points.u, m)]
        {
            to[..width].copy_from_slice(&from[..width]);
            to[width..].copy_from_slice(&from[last * width..]);
        }
        let p = parameters.len() / counts[0] * 2;
        ends.linearize(&parameters[..p], |at, out| model.linearize(at, out));
        for (to, from, width) in [
            (&mut stages.next, &ends.next, n),
            (&mut stages.a, &ends.a, n * n),
            (&mut stages.b, &ends.b, n * m),
        ] {
            to.copy_within(2 * width.., width);
            to[..width].copy_from_slice(&from[..width]);
            to[last * width..].copy_from_slice(&from[width..]);
        }
    }
}

impl Points {
    fn new(dims: OcpDims, stages: usize) -> Self {
        Self { x: vec![0.0; stages * dims.nx], u: vec![0.0; stages * dims.nu] }
    }
}

impl StageBlocks {
    fn new(dims: OcpDims, stages: usize) -> Self {
        let OcpDims { nx: n, nu: m, .. } = dims;
        Self {
            points: Points::new(dims, stages),
            next: vec![0.0; stages * n],
            a: vec![0.0; stages * n * n],
            b: vec![0.0; stages * n * m],
        }
    }

    fn linearize<T>(
        &mut self,
        p: &[f64],
        by: impl FnOnce(Stages<'_>, Linearization<'_>) -> T,
    ) -> T {
        let Self { points: Points { x, u }, next, a, b } = self;
        by(Stages { x, u, p }, Linearization { next, a, b, e: &mut [] })
    }

    fn is_finite(&self) -> bool {
        all_finite(&self.next) && all_finite(&self.a) && all_finite(&self.b)
    }
}
