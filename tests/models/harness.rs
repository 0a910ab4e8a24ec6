//! Points and results of models, and random points to run a check on.

use crate::candidates::Candidate;
use pinc_ode::{Dims, LinearizationBuffer, Model, OutputLinearization, Stages};
use proptest::prelude::*;
use proptest::test_runner::{FileFailurePersistence, TestCaseError, TestRunner};
use std::cell::RefCell;

/// A point to evaluate a model at, or several, one after the other.
#[derive(Clone, Debug)]
pub(crate) struct Point {
    pub(crate) x: Vec<f64>,
    pub(crate) u: Vec<f64>,
    pub(crate) p: Vec<f64>,
}

impl Point {
    /// The point with these variables: x, u and p, one after the other.
    pub(crate) fn new(variables: &[f64], dims: Dims) -> Self {
        let (x, rest) = variables.split_at(dims.nx);
        let (u, p) = rest.split_at(dims.nu);
        Self { x: x.to_vec(), u: u.to_vec(), p: p.to_vec() }
    }

    pub(crate) fn variables(&self) -> Vec<f64> {
        [&self.x[..], &self.u, &self.p].concat()
    }

    pub(crate) fn stages(&self) -> Stages<'_> {
        Stages { x: &self.x, u: &self.u, p: &self.p }
    }

    /// Several points as one set of stages.
    pub(crate) fn join(points: &[Self]) -> Self {
        Self {
            x: points.iter().flat_map(|point| point.x.clone()).collect(),
            u: points.iter().flat_map(|point| point.u.clone()).collect(),
            p: points.iter().flat_map(|point| point.p.clone()).collect(),
        }
    }
}

/// What `linearize_output` gives.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Outputs {
    pub(crate) y: Vec<f64>,
    pub(crate) c: Vec<f64>,
    pub(crate) d: Vec<f64>,
    pub(crate) e: Vec<f64>,
}

impl Outputs {
    pub(crate) fn as_mut(&mut self) -> OutputLinearization<'_> {
        let Self { y, c, d, e } = self;
        OutputLinearization { y, c, d, e }
    }
}

/// A number that no model gives: an entry that is left out shows.
const UNWRITTEN: f64 = 1e300;

pub(crate) fn step(model: &mut dyn Model, at: &Point) -> Vec<f64> {
    let mut next = vec![UNWRITTEN; at.x.len()];
    model.step(&at.x, &at.u, &at.p, &mut next);
    next
}

pub(crate) fn output(model: &mut dyn Model, at: &Point) -> Vec<f64> {
    let mut y = vec![UNWRITTEN; model.dims().ny];
    model.output(&at.x, &at.u, &at.p, &mut y);
    y
}

/// What `linearize` gives at one or several points.
pub(crate) fn linearize(model: &mut dyn Model, at: &Point) -> LinearizationBuffer {
    let dims = model.dims();
    let mut out = LinearizationBuffer::new(dims, at.stages().count(dims));
    for values in [&mut out.next, &mut out.a, &mut out.b, &mut out.e] {
        values.fill(UNWRITTEN);
    }
    model.linearize(at.stages(), out.as_mut());
    out
}

/// What `linearize_output` gives at one or several points.
pub(crate) fn linearize_output(model: &mut dyn Model, at: &Point) -> Outputs {
    let dims = model.dims();
    let filled = |width: usize| vec![UNWRITTEN; at.stages().count(dims) * dims.ny * width];
    let mut out =
        Outputs { y: filled(1), c: filled(dims.nx), d: filled(dims.nu), e: filled(dims.np) };
    model.linearize_output(at.stages(), out.as_mut());
    out
}

pub(crate) fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// All that a model gives at a point, bit for bit.
pub(crate) fn fingerprint(model: &mut dyn Model, at: &Point) -> Vec<Vec<u64>> {
    let LinearizationBuffer { next, a, b, e } = linearize(model, at);
    let outputs = linearize_output(model, at);
    let stepped = [step(model, at), output(model, at)];
    let all = stepped.into_iter().chain([next, a, b, e]).chain([outputs.y, outputs.c, outputs.d]);
    all.chain([outputs.e]).map(|values| bits(&values)).collect()
}

impl Candidate {
    /// The middle of the box.
    pub(crate) fn middle(&self) -> Point {
        let middle: Vec<_> = self.ranges().iter().map(|[low, high]| (low + high) / 2.0).collect();
        Point::new(&middle, self.build().dims())
    }

    /// Runs `check` on random points of the box.
    pub(crate) fn on_points(
        &self,
        check: impl Fn(&mut dyn Model, &Point) -> Result<(), TestCaseError>,
    ) {
        let model = RefCell::new(self.build());
        let dims = model.borrow().dims();
        let ranges: Vec<_> = self.ranges().iter().map(|&[low, high]| low..high).collect();
        let config = ProptestConfig {
            failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("regressions"))),
            ..ProptestConfig::with_cases(60)
        };
        let outcome = TestRunner::new(config).run(&ranges, |variables| {
            check(&mut **model.borrow_mut(), &Point::new(&variables, dims))
        });
        if let Err(failure) = outcome {
            panic!("{}: {failure}", self.name);
        }
    }
}
