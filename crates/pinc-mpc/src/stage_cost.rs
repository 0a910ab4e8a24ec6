//! Costs of one's own.

use std::fmt::Debug;

/// Where a stage cost is evaluated.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct StagePoint<'a> {
    /// j of x\[k+j\] and u\[k+j\], from 0, the measured state, to N2.
    pub stage: usize,
    /// The time of the stage in s, counted from the controller's first step.
    pub time_s: f64,
    /// x\[k+j\], `n`.
    pub x: &'a [f64],
    /// u\[k+min(j, Nu-1)\], `m`.
    pub u: &'a [f64],
    /// The parameters, `np`.
    pub p: &'a [f64],
}

impl<'a> StagePoint<'a> {
    /// A state, an input and the parameters at a stage and its time in s.
    #[must_use]
    pub fn new((stage, time_s): (usize, f64), x: &'a [f64], u: &'a [f64], p: &'a [f64]) -> Self {
        Self { stage, time_s, x, u, p }
    }
}

/// A quadratic model of a cost l(x, u) about a point:
///
/// ```text
/// l + l_x' dx + l_u' du + dx'Q dx / 2 + du'S dx + du'R du / 2
/// ```
///
/// The matrix (Q S'; S R) is symmetric and positive semidefinite: the Hessian of a convex cost, or
/// what stands for it. A cost that is linear has 0.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct QuadBlock {
    /// l
    pub value: f64,
    /// `l_x`, `n`.
    pub by_x: Vec<f64>,
    /// `l_u`, `m`.
    pub by_u: Vec<f64>,
    /// Q, `[n, n]`.
    pub q: Vec<f64>,
    /// S, `[m, n]`.
    pub s: Vec<f64>,
    /// R, `[m, m]`, of the inputs themselves.
    pub r: Vec<f64>,
}

impl QuadBlock {
    /// All 0, for `nx` states and `nu` inputs.
    #[must_use]
    pub fn new(nx: usize, nu: usize) -> Self {
        Self {
            value: 0.0,
            by_x: vec![0.0; nx],
            by_u: vec![0.0; nu],
            q: vec![0.0; nx * nx],
            s: vec![0.0; nu * nx],
            r: vec![0.0; nu * nu],
        }
    }

    /// Sets all to 0.
    pub fn clear(&mut self) {
        let Self { value, by_x, by_u, q, s, r } = self;
        *value = 0.0;
        [by_x, by_u, q, s, r].into_iter().for_each(|part| part.fill(0.0));
    }
}

/// A cost per stage that is added to the cost of tracking, an economic one for instance: what a
/// plant's product is worth, less what its inputs cost.
///
/// ```
/// use pinc_mpc::{QuadBlock, StageCost, StagePoint};
///
/// /// 3 per unit of the first input, and nothing at the end of the horizon.
/// #[derive(Debug)]
/// struct Energy {
///     horizon: usize,
/// }
///
/// impl StageCost for Energy {
///     fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
///         if at.stage < self.horizon {
///             out.value = 3.0 * at.u[0];
///             out.by_u[0] = 3.0;
///         }
///     }
/// }
/// ```
pub trait StageCost: Debug + Send {
    /// Writes the cost of a stage, its gradient and its Hessian or a positive semidefinite matrix
    /// in its place. `out` is all 0 on entry. Nothing may be allocated if a control step is not to.
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock);

    /// Is told some points that `quadratize` is called with next: a cost may compute them together.
    fn look_ahead(&mut self, points: &[StagePoint<'_>]) {
        let _ = points;
    }

    /// Whether `quadratize` writes value and gradient only. The optimization then takes the exact Hessian of
    /// the Lagrangian in place of the Gauss-Newton Hessian: second derivatives of the cost, the model, outputs,
    /// h and g by differences of their exact gradients. Where this Hessian is not positive definite on the
    /// dynamics and active limits, negative curvature by inputs is replaced by its absolute value, stage by
    /// stage, and [`StepReport::curvature_dropped`](crate::StepReport) says so. Real-time iterations cannot
    /// have such a cost.
    fn leaves_out_hessian(&self) -> bool {
        false
    }

    /// Writes the gradients of `part` times the cost at some points of a stage, of which the optimization takes
    /// differences: one after the other, if a cost has no faster way. A cost that integrates the model F of the
    /// stage itself may add those of lambda'F, and returns whether it did. `block` is scratch.
    ///
    /// # Shapes
    ///
    /// `at.x`, `by_x`: `[points, n]`; `at.u`, `by_u`: `[points, m]`; `lambda`: `n`.
    fn gradients(
        &mut self,
        at: StagePoint<'_>,
        (part, lambda): (f64, &[f64]),
        block: &mut QuadBlock,
        [by_x, by_u]: [&mut [f64]; 2],
    ) -> bool {
        let _ = lambda;
        self.gradients_one_by_one(at, part, block, [by_x, by_u]);
        false
    }

    /// The same, by [`StageCost::quadratize`] at one point after the other.
    fn gradients_one_by_one(
        &mut self,
        at: StagePoint<'_>,
        part: f64,
        block: &mut QuadBlock,
        [by_x, by_u]: [&mut [f64]; 2],
    ) {
        let (n, m) = (block.by_x.len(), block.by_u.len());
        let points = at.x.chunks_exact(n).zip(at.u.chunks_exact(m));
        let gradients = by_x.chunks_exact_mut(n).zip(by_u.chunks_exact_mut(m));
        for ((x, u), (by_x, by_u)) in points.zip(gradients) {
            block.clear();
            self.quadratize(StagePoint { x, u, ..at }, block);
            by_x.iter_mut().zip(&block.by_x).for_each(|(to, slope)| *to = part * slope);
            by_u.iter_mut().zip(&block.by_u).for_each(|(to, slope)| *to = part * slope);
        }
    }
}
