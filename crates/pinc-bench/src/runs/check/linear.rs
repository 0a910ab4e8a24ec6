//! The plant linearised: x' = A x + B u, y = C x.

use super::Subject;
use super::steady::Point;
use faer::Mat;
use faer::linalg::solvers::Solve;

/// A matrix whose singular values are this far apart counts as singular.
const SINGULAR: f64 = 1e-8;

/// A complex number, as (real, imaginary).
pub(super) type Complex = (f64, f64);

/// The plant about a point, with the controlled states as outputs.
pub(super) struct Linear {
    a: Mat<f64>,
    b: Mat<f64>,
    outputs: Vec<usize>,
}

impl Linear {
    /// None where the derivatives are not finite.
    pub(super) fn at(subject: &Subject<'_>, point: &Point) -> Option<Self> {
        let j = subject.jacobian(&point.x, &point.u);
        let (n, m) = (point.x.len(), point.u.len());
        let finite = j.col_iter().all(|column| column.iter().all(|v| v.is_finite()));
        finite.then(|| Self {
            a: j.subcols(0, n).to_owned(),
            b: j.subcols(n, m).to_owned(),
            outputs: subject.controlled(),
        })
    }

    /// The eigenvalues of A.
    pub(super) fn eigenvalues(&self) -> Vec<Complex> {
        eigenvalues(&self.a)
    }

    /// The static gain -C A^-1 B from the inputs to the outputs; none if A is singular.
    pub(super) fn static_gain(&self) -> Option<Mat<f64>> {
        if is_singular(&self.a) {
            return None;
        }
        let gain = self.a.partial_piv_lu().solve(&self.b);
        let (rows, columns) = (self.outputs.len(), gain.ncols());
        Some(Mat::from_fn(rows, columns, |i, k| -gain[(self.outputs[i], k)]))
    }

    /// The transmission zeros from the inputs to as many outputs: the s at which
    ///
    /// ```text
    /// M - s N = [A - s I   B]
    ///           [   C      0]
    /// ```
    ///
    /// is singular. With a shift c, 1 / (s - c) are the eigenvalues of the upper left block of
    /// (M - c N)^-1. Zeros at infinity are eigenvalues 0, which rounding turns into large s that
    /// change with the shift; so only those are kept that two shifts agree on. None if M - s N is singular
    /// for every s.
    pub(super) fn zeros(&self) -> Option<Vec<Complex>> {
        let rate = self.rate();
        let first = self.shifted_zeros(0.7431 * rate)?;
        let second = self.shifted_zeros(-1.3317 * rate)?;
        let near = |a: &Complex, b: &Complex| {
            (a.0 - b.0).hypot(a.1 - b.1) <= 1e-4 * (rate + a.0.hypot(a.1))
        };
        Some(first.into_iter().filter(|a| second.iter().any(|b| near(a, b))).collect())
    }

    /// The size of the fastest rate, or 1 for a plant without one.
    pub(super) fn rate(&self) -> f64 {
        let rate = self.eigenvalues().iter().map(|v| v.0.hypot(v.1)).fold(0.0, f64::max);
        if rate > 0.0 { rate } else { 1.0 }
    }

    fn shifted_zeros(&self, shift: f64) -> Option<Vec<Complex>> {
        let (n, m) = (self.a.nrows(), self.b.ncols());
        let matrix = Mat::from_fn(n + m, n + m, |i, k| match (i < n, k < n) {
            (true, true) => self.a[(i, k)] - if i == k { shift } else { 0.0 },
            (true, false) => self.b[(i, k - n)],
            (false, true) if self.outputs[i - n] == k => 1.0,
            (false, _) => 0.0,
        });
        if is_singular(&matrix) {
            return None;
        }
        let unit = Mat::from_fn(n + m, n, |i, k| if i == k { 1.0 } else { 0.0 });
        let inverse = matrix.partial_piv_lu().solve(&unit);
        let block = inverse.subrows(0, n).to_owned();
        let finite =
            eigenvalues(&block).into_iter().filter(|v| v.0.hypot(v.1) * self.rate() > 1e-4);
        Some(
            finite
                .map(|(re, im)| {
                    let size = re * re + im * im;
                    (shift + re / size, -im / size)
                })
                .collect(),
        )
    }
}

/// Eigenvalues; none if they cannot be computed.
fn eigenvalues(matrix: &Mat<f64>) -> Vec<Complex> {
    let values = matrix.eigenvalues().unwrap_or_default();
    values.iter().map(|v| (v.re, v.im)).collect()
}

/// The singular values, the largest first; none if they cannot be computed.
pub(super) fn singular_values(matrix: &Mat<f64>) -> Vec<f64> {
    matrix.singular_values().unwrap_or_default()
}

/// Whether a square matrix is singular, its rows and columns scaled to a like size first.
fn is_singular(matrix: &Mat<f64>) -> bool {
    let row = |i: usize| matrix.row(i).iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let rows: Vec<f64> = (0..matrix.nrows()).map(row).collect();
    if rows.contains(&0.0) {
        return true;
    }
    let scaled = Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, k| matrix[(i, k)] / rows[i]);
    let values = singular_values(&scaled);
    match (values.first(), values.last()) {
        (Some(largest), Some(smallest)) => smallest <= &(SINGULAR * largest),
        _ => true,
    }
}
