//! The stages of RODAS on one kind of number.

use super::lu::{self, Pivot};
use crate::outlined::Outlined;
use crate::{Dims, Plant};
use pinc_ad::simd::{Simd, Work};
use pinc_ad::{Dual, Scalar};

pub(crate) const GAMMA: f64 = 0.25;

/// `a_ij` of stages 2 to 6. The last stage starts from the solution of an embedded method of order
/// 3.
pub(crate) const A: [[f64; 5]; 5] = [
    [1.544, 0.0, 0.0, 0.0, 0.0],
    [0.946_678_528_081_582_6, 0.255_701_169_898_328_4, 0.0, 0.0, 0.0],
    [3.314_825_187_068_521, 2.896_124_015_972_201, 0.998_641_913_997_781_7, 0.0, 0.0],
    [
        1.221_224_509_226_641,
        6.019_134_481_288_629,
        12.537_083_329_320_87,
        -0.687_886_036_105_895,
        0.0,
    ],
    [
        1.221_224_509_226_641,
        6.019_134_481_288_629,
        12.537_083_329_320_87,
        -0.687_886_036_105_895,
        1.0,
    ],
];

/// `c_ij` of stages 2 to 6.
pub(crate) const C: [[f64; 5]; 5] = [
    [-5.6688, 0.0, 0.0, 0.0, 0.0],
    [-2.430_093_356_833_875, -0.206_359_915_709_191_5, 0.0, 0.0, 0.0],
    [-0.107_352_905_815_137_5, -9.594_562_251_023_355, -20.470_286_148_096_16, 0.0, 0.0],
    [
        7.496_443_313_967_647,
        -10.246_804_314_643_52,
        -33.999_903_528_199_05,
        11.708_908_932_061_6,
        0.0,
    ],
    [
        8.083_246_795_921_522,
        -7.981_132_988_064_893,
        -31.521_594_328_743_71,
        16.319_305_431_231_36,
        -6.058_818_238_834_054,
    ],
];

/// Columns of J that are computed together.
const COLUMNS: usize = 4;

/// A number with derivatives by some columns of x.
type Columns<S> = Dual<S, COLUMNS>;

/// The right-hand side of a plant with its type erased: the method is compiled once for all plants,
/// and only their equations are compiled for each.
pub(super) trait Rates<S> {
    /// f(x, u, p)
    fn rates(&self, x: &[S], u: &[S], p: &[S], to: &mut [S]);

    /// The same with derivatives.
    fn columns(&self, x: &[Columns<S>], u: &[Columns<S>], p: &[Columns<S>], to: &mut [Columns<S>]);
}

/// A plant, evaluated in the instruction set of a vector.
pub(super) struct RatesIn<'a, P, V> {
    pub(super) plant: &'a P,
    pub(super) vector: V,
}

impl<S: Pivot, P: Plant, V: Simd> Rates<S> for RatesIn<'_, P, V> {
    fn rates(&self, x: &[S], u: &[S], p: &[S], to: &mut [S]) {
        self.vector.vectorize(Evaluation { plant: self.plant, x, u, p, to });
    }

    fn columns(&self, x: &[Columns<S>], u: &[Columns<S>], p: &[Columns<S>], to: &mut [Columns<S>]) {
        self.vector.vectorize(Evaluation { plant: self.plant, x, u, p, to });
    }
}

/// Where there are no vectors.
impl<S: Pivot, P: Plant> Rates<S> for Outlined<P> {
    fn rates(&self, x: &[S], u: &[S], p: &[S], to: &mut [S]) {
        self.rhs(x, u, p, to);
    }

    fn columns(&self, x: &[Columns<S>], u: &[Columns<S>], p: &[Columns<S>], to: &mut [Columns<S>]) {
        self.rhs(x, u, p, to);
    }
}

struct Evaluation<'a, P, S> {
    plant: &'a P,
    x: &'a [S],
    u: &'a [S],
    p: &'a [S],
    to: &'a mut [S],
}

impl<P: Plant, S: Scalar> Work for Evaluation<'_, P, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.plant.rhs(self.x, self.u, self.p, self.to);
    }
}

/// State, stages and matrix of the method.
#[derive(Clone, Debug)]
pub(super) struct Workspace<S> {
    pub(super) x: Vec<S>,
    pub(super) u: Vec<S>,
    pub(super) p: Vec<S>,
    /// `y_i`
    point: Vec<S>,
    k: [Vec<S>; 6],
    /// I / (h gamma) - J, then its factors.
    matrix: Vec<S>,
    order: Vec<usize>,
    /// x, u, p and f(x, u, p) with some columns of their derivatives by x.
    lifted_x: Vec<Columns<S>>,
    lifted_u: Vec<Columns<S>>,
    lifted_p: Vec<Columns<S>>,
    slopes: Vec<Columns<S>>,
}

impl<S: Pivot> Workspace<S> {
    pub(super) fn new(Dims { nx: n, nu: m, np, .. }: Dims, zero: S) -> Self {
        let (x, u, p) = (vec![zero; n], vec![zero; m], vec![zero; np]);
        let lifted = vec![Dual::lift(zero); n];
        Self {
            point: x.clone(),
            k: std::array::from_fn(|_| x.clone()),
            matrix: vec![zero; n * n],
            order: vec![0; n],
            lifted_x: lifted.clone(),
            lifted_u: vec![Dual::lift(zero); m],
            lifted_p: vec![Dual::lift(zero); np],
            slopes: lifted,
            x,
            u,
            p,
        }
    }

    /// Advances `self.x` by `h` seconds.
    #[inline(always)]
    pub(super) fn step(&mut self, rhs: &dyn Rates<S>, h: f64) {
        self.prepare_matrix(rhs, h);
        self.k[0].iter_mut().zip(&self.slopes).for_each(|(k, slope)| *k = slope.re);
        lu::solve(&self.matrix, &self.order, &mut self.k[0]);
        for stage in 1..6 {
            let (a, c) = (&A[stage - 1], &C[stage - 1]);
            let (known, [k, ..]) = self.k.split_at_mut(stage) else { return };
            self.point.copy_from_slice(&self.x);
            combine(&mut self.point, 1.0, a, known);
            rhs.rates(&self.point, &self.u, &self.p, k);
            combine(k, 1.0 / h, c, known);
            lu::solve(&self.matrix, &self.order, k);
        }
        for ((x, &y), &k) in self.x.iter_mut().zip(&self.point).zip(&self.k[5]) {
            *x = y + k;
        }
    }

    /// Evaluates J and f at x, and factorizes I / (h gamma) - J.
    #[inline(always)]
    fn prepare_matrix(&mut self, rhs: &dyn Rates<S>, h: f64) {
        let n = self.x.len();
        for (to, &u) in self.lifted_u.iter_mut().zip(&self.u) {
            *to = Dual::lift(u);
        }
        for (to, &p) in self.lifted_p.iter_mut().zip(&self.p) {
            *to = Dual::lift(p);
        }
        for first in (0..n).step_by(COLUMNS) {
            for (j, (to, &x)) in self.lifted_x.iter_mut().zip(&self.x).enumerate() {
                *to = Dual::variable(x, j.checked_sub(first).unwrap_or(COLUMNS));
            }
            rhs.columns(&self.lifted_x, &self.lifted_u, &self.lifted_p, &mut self.slopes);
            for (i, slope) in self.slopes.iter().enumerate() {
                for (j, &derivative) in (first..n).zip(&slope.eps) {
                    self.matrix[i * n + j] = -derivative;
                }
            }
        }
        for i in 0..n {
            self.matrix[i * n + i] = self.matrix[i * n + i] + 1.0 / (h * GAMMA);
        }
        lu::factorize(&mut self.matrix, &mut self.order);
    }
}

/// `to += scale (factors_1 k_1 + factors_2 k_2 + ..)`
#[inline(always)]
fn combine<S: Pivot>(to: &mut [S], scale: f64, factors: &[f64; 5], k: &[Vec<S>]) {
    for (factor, k) in factors.iter().zip(k) {
        for (to, &k) in to.iter_mut().zip(k) {
            *to = *to + k * (scale * factor);
        }
    }
}
