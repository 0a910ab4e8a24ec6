//! The model's outputs along a plan.

use crate::NmpcProblem;
use crate::horizon::Horizon;
use crate::linearization_cache::LinearizationCache;
use pinc_ode::{Dims, OutputLinearization, Stages};
use pinc_qp::OcpDims;

/// One of the two ends of an interval between control steps, over which an input is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum IntervalEnd {
    /// Just after the input has changed: h(x\[k+j\], u\[k+j\]).
    Start,
    /// Just before the input changes: h(x\[k+j+1\], u\[k+j\]).
    End,
}

/// Which rows there are for bounded outputs, at each constrained stage: outputs without
/// feedthrough, the others at the end of the interval that leads to the stage, and the same at its
/// start. (Without feedthrough the end of an interval and the start of the next are one row.)
#[derive(Clone, Debug, Default)]
pub(crate) struct OutputRows {
    /// The outputs without feedthrough, or without a bound.
    here: Vec<usize>,
    /// The outputs whose bounds need rows at both ends.
    through: Vec<usize>,
}

impl OutputRows {
    /// The rows of `problem`; `feedthrough` says which of the model's outputs depend on the input.
    pub(crate) fn new(problem: &NmpcProblem, model: Dims, feedthrough: &[bool]) -> Self {
        let Some(bounds) = &problem.output_bounds else { return Self::default() };
        let limited = |output: usize| {
            let finite = |side: &[f64]| {
                side.iter().skip(output).step_by(model.ny).any(|bound| bound.is_finite())
            };
            finite(&bounds.low) || finite(&bounds.high)
        };
        let is_through = |&output: &usize| feedthrough[output] && limited(output);
        let (through, here) = (0..model.ny).partition(is_through);
        Self { here, through }
    }

    /// How many rows are of outputs without feedthrough.
    pub(crate) fn here(&self) -> usize {
        self.here.len()
    }

    /// How many outputs have rows at both ends.
    pub(crate) fn through(&self) -> usize {
        self.through.len()
    }

    /// Whether an output has rows at both ends of intervals.
    pub(crate) fn has_both_ends(&self, output: usize) -> bool {
        self.through.contains(&output)
    }

    /// Copies the bounds that have rows at the starts of intervals, `[.., ny]`.
    pub(crate) fn copy_starts(&self, from: &[f64], to: &mut [f64]) {
        let width = (self.here.len() + self.through.len()).max(1);
        for (from, to) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)) {
            self.through.iter().for_each(|&output| to[output] = from[output]);
        }
    }

    /// The output of each row, and at which end of the interval it is, if that matters.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, Option<IntervalEnd>)> {
        let here = self.here.iter().map(|&output| (output, None));
        let at = |end| self.through.iter().map(move |&output| (output, Some(end)));
        here.chain(at(IntervalEnd::End)).chain(at(IntervalEnd::Start))
    }
}

/// y = h(x, u, p), linearized at the ends of the intervals, `x_1` .. `x_N` with the inputs that lead there;
/// and, if a bound asks for it, at their starts, `x_0` .. `x_{N-1}` with the same inputs.
#[derive(Debug)]
pub(crate) struct Outputs {
    ends: OutputPoints,
    starts: Option<OutputPoints>,
}

/// The outputs at one point of each interval.
#[derive(Debug)]
pub(crate) struct OutputPoints {
    model: Dims,
    /// `[N, ny]`
    y: Vec<f64>,
    /// C, `[N, ny, n]`.
    c: Vec<f64>,
    /// D, `[N, ny, m]`.
    d: Vec<f64>,
}

impl Outputs {
    pub(crate) fn new(dims: OcpDims, model: Dims) -> Self {
        let points = || OutputPoints::new(dims, model);
        Self { ends: points(), starts: (dims.feedthrough > 0).then(points) }
    }

    /// Linearizes along the plan `z` from `x0`. At the end of an interval outputs have the parameters of
    /// the next one: they are read there.
    #[inline(never)]
    pub(crate) fn follow(
        &mut self,
        horizon: &mut Horizon,
        dims: OcpDims,
        [x0, z]: [&[f64]; 2],
        cache: &LinearizationCache,
    ) {
        for j in 1..=dims.horizon {
            let p = cache.parameters(j - 1);
            let u = &z[dims.input(dims.input_of(j - 1))];
            let x = &z[dims.next_state(j - 1)];
            let read = cache.parameters_after(j - 1);
            self.ends.linearize(horizon, j, Stages { x, u, p: read });
            if let Some(starts) = &mut self.starts {
                let x = dims.state(dims.origin(j - 1)).map_or(x0, |state| &z[state]);
                starts.linearize(horizon, j, Stages { x, u, p });
            }
        }
    }

    /// At the ends of the intervals.
    pub(crate) fn ends(&self) -> &OutputPoints {
        &self.ends
    }

    /// The values at the ends of all intervals and, where a bound asks for them, at their starts.
    pub(crate) fn values(&self) -> [&[f64]; 2] {
        [&self.ends.y, self.starts.as_ref().map_or(&[], |starts| &starts.y)]
    }

    /// At the end of the intervals that a row is of.
    pub(crate) fn at(&self, end: Option<IntervalEnd>) -> &OutputPoints {
        match (end, &self.starts) {
            (Some(IntervalEnd::Start), Some(starts)) => starts,
            (Some(IntervalEnd::Start | IntervalEnd::End) | None, _) => &self.ends,
        }
    }
}

impl OutputPoints {
    fn new(dims: OcpDims, model: Dims) -> Self {
        let zeros = |width: usize| vec![0.0; dims.horizon * model.ny * width];
        Self { model, y: zeros(1), c: zeros(model.nx), d: zeros(model.nu) }
    }

    /// Linearizes at a point of the interval that leads to stage `j`, from 1 on.
    fn linearize(&mut self, horizon: &mut Horizon, j: usize, at: Stages<'_>) {
        let Dims { nx, nu, ny, .. } = self.model;
        let part = |width: usize| (j - 1) * ny * width..j * ny * width;
        let out = OutputLinearization {
            y: &mut self.y[part(1)],
            c: &mut self.c[part(nx)],
            d: &mut self.d[part(nu)],
            e: &mut [],
        };
        horizon.at(j - 1).linearize_output(at, out);
    }

    /// The outputs in the interval that leads to stage `j`, from 1 on.
    pub(crate) fn y(&self, j: usize) -> &[f64] {
        &self.y[(j - 1) * self.model.ny..j * self.model.ny]
    }

    /// Row `i` of C and of D there.
    pub(crate) fn rows(&self, j: usize, i: usize) -> [&[f64]; 2] {
        let Dims { nx, nu, ny, .. } = self.model;
        let row = (j - 1) * ny + i;
        [&self.c[row * nx..(row + 1) * nx], &self.d[row * nu..(row + 1) * nu]]
    }
}
