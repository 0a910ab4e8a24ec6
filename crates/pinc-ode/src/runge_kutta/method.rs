//! The methods, by their tableaus.

use super::SMALL;
use crate::{Dims, Plant};
use pinc_ad::Scalar;
use std::fmt::Debug;

/// Slopes that a method keeps, at most.
pub(super) const MOST_STAGES: usize = 6;

/// An explicit Runge-Kutta method.
pub trait Method: Clone + Debug + Send {
    /// Evaluations of the right-hand side per substep.
    const STAGES: usize;

    /// Advances `work.x` by `h` seconds.
    fn step<P: Plant, S: Scalar>(plant: &P, h: f64, work: &mut Workspace<'_, S>);
}

/// The numbers of a small plant's workspace, on the stack.
#[derive(Clone, Copy, Debug)]
pub(super) struct StackWorkspace<S> {
    x: [S; SMALL],
    u: [S; SMALL],
    p: [S; SMALL],
    stage: [S; SMALL],
    k: [[S; SMALL]; MOST_STAGES],
}

impl<S: Scalar> StackWorkspace<S> {
    #[inline(always)]
    pub(super) fn new(zero: S) -> Self {
        let x = [zero; SMALL];
        Self { x, u: x, p: x, stage: x, k: [x; MOST_STAGES] }
    }

    /// The workspace of a plant of these dimensions, [`SMALL`] at most.
    #[inline(always)]
    pub(super) fn workspace(&mut self, Dims { nx: n, nu: m, np, .. }: Dims) -> Workspace<'_, S> {
        let [k1, k2, k3, k4, k5, k6] = &mut self.k;
        let k =
            [&mut k1[..n], &mut k2[..n], &mut k3[..n], &mut k4[..n], &mut k5[..n], &mut k6[..n]];
        let (x, u, p) = (&mut self.x[..n], &mut self.u[..m], &mut self.p[..np]);
        Workspace { x, u, p, stage: &mut self.stage[..n], k }
    }
}

/// State, input, parameters, stage and slopes of a method on one kind of number.
#[derive(Debug)]
pub struct Workspace<'a, S> {
    pub(super) x: &'a mut [S],
    pub(super) u: &'a mut [S],
    pub(super) p: &'a mut [S],
    stage: &'a mut [S],
    k: [&'a mut [S]; MOST_STAGES],
}

impl<S: Scalar> Workspace<'_, S> {
    /// Advances x in `substeps` steps of `h` seconds.
    #[inline(always)]
    pub(super) fn run<P: Plant, M: Method>(&mut self, plant: &P, h: f64, substeps: usize) {
        for _ in 0..substeps {
            M::step(plant, h, self);
        }
    }
}

impl Workspace<'_, f64> {
    /// Writes the state after `substeps` steps of `h` seconds from (x, u, p) into `next`.
    #[inline(always)]
    pub(super) fn predict<P: Plant, M: Method>(
        &mut self,
        plant: &P,
        h: f64,
        substeps: usize,
        (x, u, p): (&[f64], &[f64], &[f64]),
        next: &mut [f64],
    ) {
        self.x.copy_from_slice(x);
        self.u.copy_from_slice(u);
        self.p.copy_from_slice(p);
        self.run::<P, M>(plant, h, substeps);
        next.copy_from_slice(self.x);
    }
}

/// The classical Runge-Kutta method, of order 4:
///
/// ```text
/// 0   |
/// 1/2 | 1/2
/// 1/2 | 0    1/2
/// 1   | 0    0    1
/// ----+--------------------
///     | 1/6  1/3  1/3  1/6
/// ```
///
/// Reference: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I*, table II.1.2.
#[derive(Clone, Copy, Debug)]
pub struct Classical;

/// Of each stage's slope: how far the next stage goes along it, and its weight in the result, in
/// steps.
const CLASSICAL: [[f64; 2]; 4] =
    [[1.0 / 2.0, 1.0 / 6.0], [1.0 / 2.0, 1.0 / 3.0], [1.0, 1.0 / 3.0], [0.0, 1.0 / 6.0]];

impl Method for Classical {
    const STAGES: usize = 4;

    /// A slope is used for the stage after it and for the result, so that only one is kept. The
    /// stages are a loop: a long equation stands in the code once, and is faster so.
    #[inline(always)]
    fn step<P: Plant, S: Scalar>(plant: &P, h: f64, work: &mut Workspace<'_, S>) {
        let Workspace { x, u, p, stage, k: [k, next, ..] } = work;
        for (i, &x) in x.iter().enumerate() {
            (stage[i], next[i]) = (x, x);
        }
        for [a, b] in CLASSICAL {
            plant.rhs(stage, u, p, k);
            for (i, &x) in x.iter().enumerate() {
                stage[i] = k[i].mul_add(x.constant(h * a), x);
                next[i] = k[i].mul_add(x.constant(h * b), next[i]);
            }
        }
        for (x, &next) in x.iter_mut().zip(&**next) {
            *x = next;
        }
    }
}

/// The solution of order 5 of the method of Dormand and Prince, with six stages:
///
/// ```text
/// 0    |
/// 1/5  | 1/5
/// 3/10 | 3/40        9/40
/// 4/5  | 44/45       -56/15       32/9
/// 8/9  | 19372/6561  -25360/2187  64448/6561  -212/729
/// 1    | 9017/3168   -355/33      46732/5247  49/176    -5103/18656
/// -----+-----------------------------------------------------------------
///      | 35/384      0            500/1113    125/192   -2187/6784   11/84
/// ```
///
/// Reference: Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comput. Appl.
/// Math. 6 (1980).
#[derive(Clone, Copy, Debug)]
pub struct DormandPrince;

impl Method for DormandPrince {
    const STAGES: usize = 6;

    /// The stages of a long equation are a loop, as in [`Classical`]; a short one is
    /// unrolled.
    #[inline(always)]
    fn step<P: Plant, S: Scalar>(plant: &P, h: f64, work: &mut Workspace<'_, S>) {
        let Workspace { x, u, p, stage, k } = work;
        let stages = if P::LONG { std::hint::black_box(Self::STAGES) } else { Self::STAGES };
        for s in 0..stages {
            for (i, stage) in stage.iter_mut().enumerate() {
                *stage = combine(x[i], h, s, k, i);
            }
            plant.rhs(stage, u, p, k[s]);
        }
        for (i, x) in x.iter_mut().enumerate() {
            *x = combine(*x, h, Self::STAGES, k, i);
        }
    }
}

/// Component `i` of `x + h (a_s1 k_1 + a_s2 k_2 + ..)`, with row `s` of the tableau. The newest
/// slope is added last: nothing else waits for it.
#[inline(always)]
fn combine<S: Scalar>(x: S, h: f64, s: usize, k: &[&mut [S]; MOST_STAGES], i: usize) -> S {
    // A closure of a fold would be a function without the instructions of the vectors.
    let mut sum = x;
    for (k, a) in k.iter().zip(crate::dopri5::A[s]) {
        sum = k[i].mul_add(x.constant(h * a), sum);
    }
    sum
}
