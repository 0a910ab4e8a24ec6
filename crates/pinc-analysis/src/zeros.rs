//! Transmission zeros by reduction of the system matrix.
//!
//! ```text
//! P(s) = [A - s I   B]
//!        [   C      D]
//! ```
//!
//! The zeros are the finite generalized eigenvalues of this pencil. If D is singular, the pencil also
//! has infinite eigenvalues, in chains that rounding would turn into large finite numbers.
//! Orthogonal transformations therefore remove them first, from the rows and then from the columns,
//! until D is square and invertible. Source: Emami-Naeini and Van Dooren, "Computation of zeros of
//! linear multivariable systems", Automatica 18 (1982).

use crate::{Complex, StateSpace, TransmissionZeros};
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Singular values below this share of the system matrix count as 0. Rounding in orthogonal
/// transformations leaves values near 1e-15; a coupling of variables in like units that is weaker
/// has no effect.
const RANK: f64 = 1e-12;

/// The eliminated matrix may be larger than A by this factor: its rounding is then as far below its
/// eigenvalues as the rounding of the linearization.
const GROWTH: f64 = 1e3;

/// Where the inverse is taken, in units of the fastest rate: numbers at which no plant has a zero
/// but by chance.
const SHIFTS: [f64; 2] = [0.754_877_666_2, -0.569_840_291];

/// The matrices of a plant with a direct path D.
struct System {
    a: Mat<f64>,
    b: Mat<f64>,
    c: Mat<f64>,
    d: Mat<f64>,
}

pub(crate) fn transmission_zeros(plant: &StateSpace) -> TransmissionZeros {
    let (inputs, outputs) = (plant.b.ncols(), plant.c.nrows());
    // Time in units of the fastest rate, inputs in such that A and B have a like size.
    let rate = largest(&plant.a).max(f64::MIN_POSITIVE);
    let reach = largest(&plant.b).max(f64::MIN_POSITIVE);
    let scaled = |m: &Mat<f64>, by: f64| Mat::from_fn(m.nrows(), m.ncols(), |i, k| m[(i, k)] / by);
    let system = System {
        a: scaled(&plant.a, rate),
        b: scaled(&plant.b, reach),
        c: scaled(&plant.c, largest(&plant.c).max(f64::MIN_POSITIVE)),
        d: Mat::zeros(outputs, inputs),
    };
    let system = system.reduced().transposed().reduced();
    let rank = system.d.nrows().min(system.d.ncols());
    if rank < inputs.min(outputs) {
        return TransmissionZeros::Degenerate { rank };
    }
    let zeros = system.eigenvalues();
    TransmissionZeros::Finite(zeros.into_iter().map(|zero| zero.times(rate)).collect())
}

fn largest(matrix: &Mat<f64>) -> f64 {
    matrix.col_iter().flat_map(|c| c.iter().copied()).fold(0.0, |m, v| m.max(v.abs()))
}

impl System {
    fn transposed(self) -> Self {
        let of = |m: &Mat<f64>| m.transpose().to_owned();
        Self { a: of(&self.a), b: of(&self.c), c: of(&self.b), d: of(&self.d) }
    }

    /// A system with the same zeros whose D has full row rank; rows that are 0 are dropped.
    fn reduced(mut self) -> Self {
        loop {
            let (n, p) = (self.a.nrows(), self.d.nrows());
            // Rows of D that are independent come first.
            let (u, rank) = range(&self.d);
            let (c, d) = (u.transpose() * &self.c, u.transpose() * &self.d);
            let (upper_c, upper_d) = (c.subrows(0, rank).to_owned(), d.subrows(0, rank).to_owned());
            let lower = c.subrows(rank, p - rank).to_owned();
            // The states that the other rows see come last.
            let (v, seen) = range(&lower.transpose().to_owned());
            if seen == 0 {
                return Self { c: upper_c, d: upper_d, ..self };
            }
            let kept = n - seen;
            let order = |k: usize| if k < kept { seen + k } else { k - kept };
            let v = Mat::from_fn(n, n, |i, k| v[(i, order(k))]);
            let (a, b, c) = (v.transpose() * &self.a * &v, v.transpose() * &self.b, upper_c * &v);
            self = Self {
                a: a.submatrix(0, 0, kept, kept).to_owned(),
                b: b.subrows(0, kept).to_owned(),
                c: stacked(
                    &a.submatrix(kept, 0, seen, kept).to_owned(),
                    &c.subcols(0, kept).to_owned(),
                ),
                d: stacked(&b.subrows(kept, seen).to_owned(), &upper_d),
            };
        }
    }

    /// The finite generalized eigenvalues, as many as there are states: D is square and invertible.
    /// Where D is so small that far eigenvalues would hide the near ones, the eigenvalues of the
    /// inverse at a shift are used.
    fn eigenvalues(&self) -> Vec<Complex> {
        if self.a.nrows() == 0 {
            return Vec::new();
        }
        if let Some(zeros) = self.standard_eigenvalues() {
            return zeros;
        }
        // The smaller inverse belongs to the shift that is farther from all zeros.
        let inverses = SHIFTS.into_iter().map(|shift| (shift, self.inverse_at(shift)));
        let smallest = inverses.min_by(|(_, a), (_, b)| largest(a).total_cmp(&largest(b)));
        let Some((shift, inverse)) = smallest else { return Vec::new() };
        let zero = |v: &faer::c64| {
            let square = v.re * v.re + v.im * v.im;
            Complex { re: shift + v.re / square, im: -v.im / square }
        };
        inverse.eigenvalues().unwrap_or_default().iter().map(zero).collect()
    }

    /// (A - B D^-1 C - s I)^-1 at a shift s, without D^-1: of the inverse of P(s), the part of the
    /// states.
    fn inverse_at(&self, shift: f64) -> Mat<f64> {
        let (n, p) = (self.a.nrows(), self.d.nrows());
        let matrix = Mat::from_fn(n + p, n + p, |i, k| match (i < n, k < n) {
            (true, true) => self.a[(i, k)] - if i == k { shift } else { 0.0 },
            (true, false) => self.b[(i, k - n)],
            (false, true) => self.c[(i - n, k)],
            (false, false) => self.d[(i - n, k - n)],
        });
        let unit = Mat::from_fn(n + p, n, |i, k| f64::from(u8::from(i == k)));
        matrix.partial_piv_lu().solve(&unit).subrows(0, n).to_owned()
    }
}

impl System {
    /// The eigenvalues as eigenvalues of A - B D^-1 C, in a tenth of the time; `None` if this
    /// matrix is so much larger than A that its rounding would show.
    fn standard_eigenvalues(&self) -> Option<Vec<Complex>> {
        let matrix = &self.a - &self.b * self.d.partial_piv_lu().solve(&self.c);
        let size = largest(&matrix);
        if !size.is_finite() || size > GROWTH * largest(&self.a) {
            return None;
        }
        let values = matrix.eigenvalues().ok()?;
        Some(values.iter().map(|v| Complex { re: v.re, im: v.im }).collect())
    }
}

/// An orthogonal basis whose first vectors span the columns of a matrix, and their number.
fn range(matrix: &Mat<f64>) -> (Mat<f64>, usize) {
    let rows = matrix.nrows();
    let identity = || Mat::from_fn(rows, rows, |i, k| f64::from(u8::from(i == k)));
    if rows == 0 || matrix.ncols() == 0 {
        return (identity(), 0);
    }
    let Ok(svd) = matrix.svd() else { return (identity(), 0) };
    let rank = svd.S().column_vector().iter().filter(|v| **v > RANK).count();
    (svd.U().to_owned(), rank)
}

fn stacked(upper: &Mat<f64>, lower: &Mat<f64>) -> Mat<f64> {
    let rows = upper.nrows();
    Mat::from_fn(rows + lower.nrows(), upper.ncols(), |i, k| {
        if i < rows { upper[(i, k)] } else { lower[(i - rows, k)] }
    })
}
