//! The integrators as textbooks have them, on dual numbers: what the compiled ones and those on the
//! graph are compared with.

use pinc_ad::{Dual, Scalar};
use pinc_ode::{Dims, Integrator, LinearizationBuffer, Plant, Scheme};

/// Directions of differentiation that go through a method together.
const DIRECTIONS: usize = 8;

/// A number with derivatives by some variables.
type One = Dual<f64, DIRECTIONS>;

/// The step of `integrator` with its Jacobians at points of (x, u, p), one after the other.
pub(crate) fn linearize<P: Plant>(
    plant: &P,
    (integrator, sample_time_s, substeps): (Integrator, f64, usize),
    points: &[f64],
) -> LinearizationBuffer {
    let dims @ Dims { nx, nu, np, .. } = plant.dims();
    let width = nx + nu + np;
    let mut out = LinearizationBuffer::new(dims, points.len() / width);
    let h = sample_time_s / substeps as f64;
    for (k, point) in points.chunks_exact(width).enumerate() {
        for first in (0..width).step_by(DIRECTIONS) {
            let direction = |j: usize| j.checked_sub(first).unwrap_or(DIRECTIONS);
            let variable = |(j, &v): (usize, &f64)| Dual::variable(v, direction(j));
            let mut at: Vec<One> = point.iter().enumerate().map(variable).collect();
            for _ in 0..substeps {
                match integrator.scheme() {
                    Scheme::Explicit(_) => explicit(plant, integrator, h, &mut at),
                    Scheme::LinearlyImplicit => rosenbrock(plant, h, &mut at),
                }
            }
            for (i, x) in at[..nx].iter().enumerate() {
                let row = k * nx + i;
                out.next[row] = x.re;
                for (column, derivative) in (first..width).zip(x.eps) {
                    match column {
                        j if j < nx => out.a[row * nx + j] = derivative,
                        j if j < nx + nu => out.b[row * nu + j - nx] = derivative,
                        j => out.e[row * np + j - nx - nu] = derivative,
                    }
                }
            }
        }
    }
    out
}

/// f(x, u, p) at (x, u, p).
fn rates<P: Plant, S: Scalar>(plant: &P, at: &[S]) -> Vec<S> {
    let Dims { nx, nu, .. } = plant.dims();
    let mut dx = at[..nx].to_vec();
    plant.rhs(&at[..nx], &at[nx..nx + nu], &at[nx + nu..], &mut dx);
    dx
}

/// A substep by the rows of the tableau.
fn explicit<P: Plant>(plant: &P, integrator: Integrator, h: f64, at: &mut [One]) {
    let tableau = integrator.tableau().expect("an explicit method");
    let (mut stage, mut slopes) = (at.to_vec(), Vec::<Vec<One>>::new());
    for row in tableau.rows() {
        for i in 0..plant.dims().nx {
            let terms = row.iter().zip(&slopes).map(|(a, k)| k[i] * (h * a));
            stage[i] = terms.fold(at[i], |sum, term| sum + term);
        }
        if slopes.len() < integrator.stages() {
            slopes.push(rates(plant, &stage));
        }
    }
    at.copy_from_slice(&stage);
}

/// `a_ij` and `c_ij` of RODAS (Hairer and Wanner II, table IV.7.2), as it is written there.
const A: [&[f64]; 5] = [
    &[1.544],
    &[0.9466785280815826, 0.2557011698983284],
    &[3.314825187068521, 2.896124015972201, 0.9986419139977817],
    &[1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895],
    &[1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1.0],
];
const C: [&[f64]; 5] = [
    &[-5.6688],
    &[-2.430093356833875, -0.2063599157091915],
    &[-0.1073529058151375, -9.594562251023355, -20.47028614809616],
    &[7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616],
    &[
        8.083246795921522,
        -7.981132988064893,
        -31.52159432874371,
        16.31930543123136,
        -6.058818238834054,
    ],
];

/// A substep of RODAS: `(4 I / h - J) k_i = f(y_i) + sum c_ij k_j / h`, `y_i = x + sum a_ij k_j`.
fn rosenbrock<P: Plant>(plant: &P, h: f64, at: &mut [One]) {
    let nx = plant.dims().nx;
    let mut matrix = vec![vec![Dual::lift(0.0); nx]; nx];
    for j in 0..nx {
        let lift = |(v, &x): (usize, &One)| Dual::<One, 1>::variable(x, usize::from(v != j));
        let along: Vec<_> = at.iter().enumerate().map(lift).collect();
        for (row, slope) in matrix.iter_mut().zip(rates(plant, &along)) {
            row[j] = -slope.eps[0];
        }
        matrix[j][j] = matrix[j][j] + 4.0 / h;
    }
    let mut known: Vec<Vec<One>> = Vec::new();
    let mut stage = at.to_vec();
    for i in 0..6 {
        let (a, c): (&[f64], &[f64]) = if i == 0 { (&[], &[]) } else { (A[i - 1], C[i - 1]) };
        let sum = |from: One, factors: &[f64], row: usize, scale: f64| {
            let terms = factors.iter().zip(&known).map(|(f, k)| k[row] * (f * scale));
            terms.fold(from, |sum, term| sum + term)
        };
        for row in 0..nx {
            stage[row] = sum(at[row], a, row, 1.0);
        }
        let slopes = rates(plant, &stage).into_iter().enumerate();
        let right = slopes.map(|(row, f)| sum(f, c, row, 1.0 / h)).collect();
        known.push(solve(matrix.clone(), right));
    }
    for row in 0..nx {
        at[row] = stage[row] + known[5][row];
    }
}

/// The solution by Gauss' elimination with the largest pivot of each column.
fn solve(mut a: Vec<Vec<One>>, mut b: Vec<One>) -> Vec<One> {
    let n = b.len();
    for k in 0..n {
        let size = |i: &usize| a[*i][k].re.abs();
        let pivot = (k..n).max_by(|i, j| size(i).total_cmp(&size(j))).expect("a row");
        a.swap(k, pivot);
        b.swap(k, pivot);
        let (above, below) = a.split_at_mut(k + 1);
        let (pivot, known) = (&above[k], b[k]);
        for (row, b) in below.iter_mut().zip(&mut b[k + 1..]) {
            let factor = row[k] / pivot[k];
            for (to, from) in row.iter_mut().zip(pivot).skip(k) {
                *to = *to - factor * *from;
            }
            *b = *b - factor * known;
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            b[k] = b[k] - a[k][j] * b[j];
        }
        b[k] = b[k] / a[k][k];
    }
    b
}
