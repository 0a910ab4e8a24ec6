//! Equations solved inside others: Newton's method on plain numbers, derivatives by the implicit
//! function theorem.

use crate::{Dual, Scalar};

/// Newton steps, those included that are taken back, after which a system counts as unsolved.
const MOST_STEPS: usize = 60;

/// A step of this size is the last: what is left is its square, and the derivatives before it are
/// those after it. (Steps are counted in parts of the unknown, plus `SMALL` widths of its box.)
const LAST_STEP: f64 = 1e-12;

/// A system whose last step is larger than this is not solved.
const SOLVED: f64 = 1e-7;

/// What is small for an unknown, in widths of its box.
const SMALL: f64 = 1e-3;

/// Residuals this small (squared, relative to the residual of a step through the box) are rounding:
/// the steps become no smaller.
const ROUNDING: f64 = 1e-30;

/// Residuals this small are so near to the root that whether they grow says nothing.
const NEAR: f64 = 1e-18;

/// A system of equations 0 = g(z) as Newton's method sees it, on numbers without derivatives.
pub trait NewtonSystem<V, const N: usize> {
    /// How many of the `N` unknowns and equations there are.
    fn count(&self) -> usize {
        N
    }

    /// Writes g(z) and, row by row, its derivatives by z.
    fn linearize(&mut self, z: &[V; N], g: &mut [V; N], slopes: &mut [[V; N]; N]);
}

/// Where Newton's method ended, in each lane by itself.
#[derive(Clone, Copy, Debug)]
pub struct NewtonRoot<V, const N: usize> {
    /// The unknowns.
    pub z: [V; N],
    /// The inverse of dg/dz there.
    pub inverse: [[V; N]; N],
    /// Not positive where the system is solved.
    pub unsolved: V,
}

impl<V: Scalar, const N: usize> NewtonRoot<V, N> {
    /// The unknowns, NaN where the system is not solved.
    #[inline(always)]
    #[must_use]
    pub fn solved(&self) -> [V; N] {
        let mut z = self.z;
        for z in &mut z {
            *z = self.unsolved.where_nonpositive(*z, z.constant(f64::NAN));
        }
        z
    }
}

/// The root of `system` that Newton's method finds from `start` inside the box `limits` (low and
/// high of each unknown, finite); from the middle of the box in what is not inside it.
///
/// A step that would leave the box goes half the way to its edge; one after which the residuals
/// are larger is halved. Each lane goes its own way and stops by itself, so that its numbers do
/// not depend on those beside it. The result does not depend on earlier calls either.
#[inline(always)]
pub fn newton<V: Scalar, T: NewtonSystem<V, N>, const N: usize>(
    system: &mut T,
    start: [V; N],
    limits: &[[f64; 2]; N],
) -> NewtonRoot<V, N> {
    let n = system.count();
    let zero = start[0].constant(0.0);
    let (mut g, mut slopes) = ([zero; N], [[zero; N]; N]);
    let mut z = start;
    for i in 0..n {
        let [low, high] = limits[i];
        let middle = zero + 0.5 * (low + high);
        let start = (-start[i] + high).where_nonpositive(middle, start[i]);
        z[i] = (start - low).where_nonpositive(middle, start);
    }
    system.linearize(&z, &mut g, &mut slopes);
    let weights = row_weights(n, &slopes, limits);
    let mut size = weighted(n, &g, &weights);
    let mut inverse = invert(n, slopes);
    let mut step = product(n, &inverse, &g);
    let mut part = zero.constant(1.0);
    let mut trial = z;
    for _ in 0..MOST_STEPS {
        let unfinished = largest(n, &step, &z, limits) - LAST_STEP;
        let unfinished = (size - ROUNDING).where_nonpositive(zero, unfinished);
        if unfinished.all_nonpositive() {
            break;
        }
        for i in 0..n {
            trial[i] = inside(z[i] - step[i] * part, z[i], limits[i]);
        }
        system.linearize(&trial, &mut g, &mut slopes);
        let new = weighted(n, &g, &weights);
        let reached = (size - NEAR).where_nonpositive(size.constant(NEAR), size);
        // Positive where the trial is not taken; NaN counts as that.
        let worse = (new - reached).where_nonpositive(zero, zero.constant(1.0));
        let refused = unfinished.where_nonpositive(zero.constant(1.0), worse);
        let next = invert(n, slopes);
        let next_step = product(n, &next, &g);
        for i in 0..n {
            z[i] = refused.where_nonpositive(trial[i], z[i]);
            step[i] = refused.where_nonpositive(next_step[i], step[i]);
            for j in 0..n {
                inverse[i][j] = refused.where_nonpositive(next[i][j], inverse[i][j]);
            }
        }
        size = refused.where_nonpositive(new, size);
        part = refused.where_nonpositive(zero.constant(1.0), part * 0.5);
    }
    let unsolved = largest(n, &step, &z, limits) - SOLVED;
    for i in 0..n {
        z[i] = unsolved.where_nonpositive(z[i] - step[i], z[i]);
    }
    NewtonRoot { z, inverse, unsolved }
}

/// `to`, or half the way from `from` to the edge that it is beyond.
#[inline(always)]
fn inside<V: Scalar>(to: V, from: V, [low, high]: [f64; 2]) -> V {
    let half = |edge: f64| (from + edge) * 0.5;
    let to = (-to + high).where_nonpositive(half(high), to);
    (to - low).where_nonpositive(half(low), to)
}

/// The largest entry of `step`, in parts of the unknowns; NaN if one is.
#[inline(always)]
fn largest<V: Scalar, const N: usize>(
    n: usize,
    step: &[V; N],
    z: &[V; N],
    limits: &[[f64; 2]; N],
) -> V {
    let mut largest = step[0].constant(0.0);
    for i in 0..n {
        let [low, high] = limits[i];
        largest = largest.max(step[i].abs() / (z[i].abs() + SMALL * (high - low)));
    }
    largest
}

/// One over what each residual changes by through the box, at first order.
#[inline(always)]
fn row_weights<V: Scalar, const N: usize>(
    n: usize,
    slopes: &[[V; N]; N],
    limits: &[[f64; 2]; N],
) -> [V; N] {
    let mut weights = slopes[0];
    for i in 0..n {
        let mut change = slopes[0][0].constant(f64::MIN_POSITIVE);
        for j in 0..n {
            let [low, high] = limits[j];
            change = change + slopes[i][j].abs() * (high - low);
        }
        weights[i] = change.constant(1.0) / change;
    }
    weights
}

/// The sum of squares of the residuals.
#[inline(always)]
fn weighted<V: Scalar, const N: usize>(n: usize, g: &[V; N], weights: &[V; N]) -> V {
    let mut sum = g[0].constant(0.0);
    for i in 0..n {
        let residual = g[i] * weights[i];
        sum = residual.mul_add(residual, sum);
    }
    sum
}

/// matrix v
#[inline(always)]
fn product<V: Scalar, const N: usize>(n: usize, matrix: &[[V; N]; N], v: &[V; N]) -> [V; N] {
    let mut result = *v;
    for i in 0..n {
        let mut sum = matrix[i][0] * v[0];
        for j in 1..n {
            sum = matrix[i][j].mul_add(v[j], sum);
        }
        result[i] = sum;
    }
    result
}

/// The inverse of the first `n` rows and columns, by Gauss and Jordan's elimination. Rows are
/// exchanged in each lane by itself. A singular matrix gives numbers that are not finite.
#[inline(always)]
fn invert<V: Scalar, const N: usize>(n: usize, mut a: [[V; N]; N]) -> [[V; N]; N] {
    let (zero, one) = (a[0][0].constant(0.0), a[0][0].constant(1.0));
    let mut inverse = [[zero; N]; N];
    for (i, row) in inverse.iter_mut().enumerate() {
        row[i] = one;
    }
    for k in 0..n {
        for i in k + 1..n {
            // Not positive where row i has the larger entry.
            let keeps = a[k][k].abs() - a[i][k].abs();
            for j in 0..n {
                exchange(keeps, j, [k, i], &mut a);
                exchange(keeps, j, [k, i], &mut inverse);
            }
        }
        let pivot = one / a[k][k];
        for j in 0..n {
            a[k][j] = a[k][j] * pivot;
            inverse[k][j] = inverse[k][j] * pivot;
        }
        for i in 0..n {
            if i == k {
                continue;
            }
            let factor = -a[i][k];
            for j in 0..n {
                a[i][j] = factor.mul_add(a[k][j], a[i][j]);
                inverse[i][j] = factor.mul_add(inverse[k][j], inverse[i][j]);
            }
        }
    }
    inverse
}

/// Exchanges an entry of two rows where `keeps` is negative or 0.
#[inline(always)]
fn exchange<V: Scalar, const N: usize>(
    keeps: V,
    column: usize,
    [k, i]: [usize; 2],
    matrix: &mut [[V; N]; N],
) {
    let (upper, lower) = (matrix[k][column], matrix[i][column]);
    matrix[k][column] = keeps.where_nonpositive(lower, upper);
    matrix[i][column] = keeps.where_nonpositive(upper, lower);
}

/// `N` equations 0 = g(x, z) for as many unknowns z, among `K` known numbers x.
pub trait ImplicitEquations<const K: usize, const N: usize> {
    /// Writes g(x, z). Mark it `#[inline(always)]`, as the right-hand side of a plant.
    fn residuals<S: Scalar>(&self, x: &[S; K], z: &[S; N], g: &mut [S; N]);
}

/// z with 0 = g(x, z), for use inside another equation: see [`newton`] for how it is found from
/// `start` inside the box `limits`, and with which root of several. Where none is found, z is NaN.
///
/// Newton's method runs on plain numbers. As many last steps on the kind of number itself as this
/// has orders of derivatives then make the derivatives exact (implicit function theorem: of each
/// step the first order that was wrong before it becomes right), to about 1e-12: so near the root
/// is the Jacobian that they use.
///
/// ```
/// use pinc_ad::{ImplicitEquations, Scalar, derivative, solve_implicit};
///
/// /// The speed v at which friction c v^2 + v balances a force.
/// struct Balance {
///     c: f64,
/// }
///
/// impl ImplicitEquations<1, 1> for Balance {
///     #[inline(always)]
///     fn residuals<S: Scalar>(&self, [force]: &[S; 1], [v]: &[S; 1], g: &mut [S; 1]) {
///         g[0] = *v * *v * self.c + *v - *force;
///     }
/// }
///
/// fn speed<S: Scalar>(force: S) -> S {
///     let start = [force.plain() * 0.5];
///     solve_implicit(&Balance { c: 2.0 }, &[force], start, &[[0.0, 10.0]])[0]
/// }
/// assert_eq!(speed(10.0), 2.0);
/// assert!((derivative(speed, 10.0) - 1.0 / 9.0).abs() < 1e-12);
/// ```
#[inline(always)]
pub fn solve_implicit<S: Scalar, E: ImplicitEquations<K, N>, const K: usize, const N: usize>(
    equations: &E,
    x: &[S; K],
    start: [S::Plain; N],
    limits: &[[f64; 2]; N],
) -> [S; N] {
    if let Some(declared) = S::declare(equations, x, start, limits) {
        return declared;
    }
    let mut known = [Dual::lift(start[0]); K];
    for (known, x) in known.iter_mut().zip(x) {
        *known = Dual::lift(x.plain());
    }
    let root = newton(&mut Plain { equations, known }, start, limits);
    let plain = root.solved();
    let mut z = [x[0].constants(plain[0]); N];
    for (z, plain) in z.iter_mut().zip(plain) {
        *z = x[0].constants(plain);
    }
    let mut g = z;
    for _ in 0..S::ORDER {
        equations.residuals(x, &z, &mut g);
        correct(N, &root.inverse, &g, &mut z);
    }
    z
}

/// z - inverse g: the step of Newton's method that carries derivatives.
#[inline(always)]
pub fn correct<S: Scalar, const N: usize>(
    n: usize,
    inverse: &[[S::Plain; N]; N],
    g: &[S; N],
    z: &mut [S; N],
) {
    for i in 0..n {
        for j in 0..n {
            z[i] = z[i] - g[j] * g[j].constants(inverse[i][j]);
        }
    }
}

/// Equations among known numbers, as Newton's method sees them.
struct Plain<'a, E, V, const K: usize> {
    equations: &'a E,
    known: [Dual<V>; K],
}

impl<E, V: Scalar, const K: usize, const N: usize> NewtonSystem<V, N> for Plain<'_, E, V, K>
where
    E: ImplicitEquations<K, N>,
{
    #[inline(always)]
    fn linearize(&mut self, z: &[V; N], g: &mut [V; N], slopes: &mut [[V; N]; N]) {
        let mut lifted = [Dual::lift(z[0]); N];
        let mut residuals = lifted;
        for j in 0..N {
            for (i, (to, &z)) in lifted.iter_mut().zip(z).enumerate() {
                *to = Dual::variable(z, usize::from(i != j));
            }
            self.equations.residuals(&self.known, &lifted, &mut residuals);
            for ((g, row), residual) in g.iter_mut().zip(&mut *slopes).zip(&residuals) {
                *g = residual.re;
                row[j] = residual.eps[0];
            }
        }
    }
}
