//! The models of the stages.

use crate::MpcError;
use crate::error::{check_range, check_setting};
use pinc_ode::{Dims, Gradients, Linearization, LinearizationBuffer, Model, Stages};
use pinc_qp::Tree;
use std::ops::Range;

/// How many stages of a small plant, and of one of more states and inputs than that, are linearized
/// between two looks at the clock; multiples of the points that the models take at once.
const UNASKED: [usize; 2] = [32, 8];

/// How many states and inputs a small plant has at most.
const SMALL: usize = 8;

/// The models along the prediction horizon, one or more stages each, and the times of the stages.
#[derive(Debug)]
pub(crate) struct Horizon {
    blocks: Vec<Block>,
    dims: Dims,
    /// Which outputs may depend on the input, `ny`.
    feedthrough: Vec<bool>,
    /// Seconds from the measured state to `x_0` .. `x_N`.
    times: Vec<f64>,
    uniform: bool,
}

/// A model and its stages.
#[derive(Debug)]
struct Block {
    model: Box<dyn Model>,
    stages: Range<usize>,
}

impl Horizon {
    /// The horizon of `expected` stages that these models and their numbers of stages make, along
    /// all paths of `tree`.
    pub(crate) fn new(
        models: Vec<(Box<dyn Model>, usize)>,
        expected: usize,
        tree: Tree,
    ) -> Result<Self, MpcError> {
        let field = "the models of the horizon";
        check_range(field, models.len(), 1, usize::MAX)?;
        let dims = models[0].0.dims();
        let (mut blocks, mut times) = (Vec::new(), vec![0.0]);
        for (model, count) in models {
            check_range("the stages of a model", count, 1, expected)?;
            if model.dims() != dims {
                return Err(MpcError::DifferentModels);
            }
            let (first, length) = (times.len() - 1, model.sample_time_s());
            let is_less = times.get(1).is_some_and(|least| length < *least);
            check_setting("a later sample time", length, "not less than the first", !is_less)?;
            (0..count).for_each(|_| times.push(times[times.len() - 1] + length));
            let stages = tree.first_node(first + 1) - 1..tree.first_node(first + count + 1) - 1;
            blocks.push(Block { model, stages });
        }
        let found = times.len() - 1;
        if found != expected {
            return Err(MpcError::Stages { field, expected, found });
        }
        let length = |block: &Block| block.model.sample_time_s().to_bits();
        let uniform = blocks.iter().all(|block| length(block) == length(&blocks[0]));
        let each: Vec<_> = blocks.iter().map(|block| block.model.feedthrough()).collect();
        let feedthrough = (0..dims.ny).map(|output| each.iter().any(|of| of[output])).collect();
        Ok(Self { blocks, dims, feedthrough, times, uniform })
    }

    /// The sizes of all models.
    pub(crate) fn dims(&self) -> Dims {
        self.dims
    }

    /// Which outputs may depend on the input, `ny`.
    pub(crate) fn feedthrough(&self) -> &[bool] {
        &self.feedthrough
    }

    /// Whether all stages are of the same model.
    pub(crate) fn has_one_model(&self) -> bool {
        self.blocks.len() == 1
    }

    /// Whether two stages are of one model.
    pub(crate) fn has_one_model_for(&self, stages: [usize; 2]) -> bool {
        self.blocks.iter().any(|block| stages.iter().all(|stage| block.stages.contains(stage)))
    }

    /// Whether all stages are of the same length.
    pub(crate) fn is_uniform(&self) -> bool {
        self.uniform
    }

    /// Seconds from the measured state to `x_0` .. `x_N`.
    pub(crate) fn times(&self) -> &[f64] {
        &self.times
    }

    /// The model of the first stage.
    pub(crate) fn first(&self) -> &dyn Model {
        self.blocks[0].model.as_ref()
    }

    /// The model of the first stage.
    pub(crate) fn first_mut(&mut self) -> &mut dyn Model {
        self.blocks[0].model.as_mut()
    }

    /// The model of stage `j`; at the end of the horizon, the last stage's.
    pub(crate) fn at(&mut self, j: usize) -> &mut dyn Model {
        let place = self.blocks.iter().position(|block| block.stages.contains(&j));
        let last = self.blocks.len() - 1;
        self.blocks[place.unwrap_or(last)].model.as_mut()
    }

    /// Linearizes at the points of the stages `renewed` of all, each by its model; whether it came
    /// to the end before `expired` said that the time is up.
    #[inline(always)]
    pub(crate) fn linearize(
        &mut self,
        renewed: Range<usize>,
        at: Stages<'_>,
        out: Linearization<'_>,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        let Dims { nx, nu, np, .. } = self.dims;
        let unasked = UNASKED[usize::from(nx + nu > SMALL)];
        let Linearization { next, a, b, e } = out;
        for Block { model, stages } in &mut self.blocks {
            let last = stages.end.min(renewed.end);
            for start in (stages.start.max(renewed.start)..last).step_by(unasked) {
                if start > 0 && expired() {
                    return false;
                }
                let end = last.min(start + unasked);
                let part = |width: usize| start * width..end * width;
                let by_p = if e.is_empty() { 0..0 } else { part(nx * np) };
                let points = Stages { x: &at.x[part(nx)], u: &at.u[part(nu)], p: &at.p[part(np)] };
                model.linearize(
                    points,
                    Linearization {
                        next: &mut next[part(nx)],
                        a: &mut a[part(nx * nx)],
                        b: &mut b[part(nx * nu)],
                        e: &mut e[by_p],
                    },
                );
            }
        }
        true
    }

    /// Writes the gradients of w'F(x, u, p) at the points of all stages, each by its model.
    pub(crate) fn gradients(
        &mut self,
        at: Stages<'_>,
        weights: &[f64],
        out: Gradients<'_>,
        room: &mut LinearizationBuffer,
    ) {
        let (dims, mut rest) = (self.dims, (at, weights, out));
        for Block { model, stages } in &mut self.blocks {
            let (points, later_points) = rest.0.split(dims, stages.len());
            let (weights, later_weights) = rest.1.split_at(stages.len() * dims.nx);
            let (out, later) = rest.2.split(dims, stages.len());
            room.gradients(model.as_mut(), points, weights, out);
            rest = (later_points, later_weights, later);
        }
    }
}
