//! The plant linearized: x' = A x + B u, y = C x.

use crate::{OperatingPoint, zeros};
use faer::Mat;
use faer::linalg::solvers::Solve;
use pinc_ode::DynRhs;

/// A matrix whose singular values are this far apart, after its rows are scaled, counts as
/// singular.
const SINGULAR: f64 = 1e-11;

/// The error bound of an eigenvalue: so many times the distance that rounding of the matrix moves it, plus
/// this part of the largest eigenvalue.
const MARGIN: f64 = 30.0;
const ROUNDING: f64 = 1e-14;

/// A state that takes part in a direction by less, squared, does not.
const PART: f64 = 1e-4;

/// An input that moves a mode, held against its growth, by less than this part of a width does not act on it.
const REACH: f64 = 1e-6;

/// Singular values of a gain this far below the largest count as 0.
const RANK: f64 = 1e-6;

/// A complex number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Complex {
    /// The real part.
    pub re: f64,
    /// The imaginary part.
    pub im: f64,
}

impl Complex {
    /// The absolute value.
    #[must_use]
    pub fn abs(self) -> f64 {
        self.re.hypot(self.im)
    }

    /// The product with a real number.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }
}

fn eigenvalues(a: &Mat<f64>) -> Vec<Complex> {
    let values = a.eigenvalues().unwrap_or_default();
    values.iter().map(|v| Complex { re: v.re, im: v.im }).collect()
}

/// A linear plant x' = A x + B u, y = C x.
///
/// ```
/// use pinc_analysis::{StateSpace, TransmissionZeros};
///
/// // (s - 1) / ((s + 1) (s + 2)): nonminimum phase, static gain -1/2.
/// let plant = StateSpace::new(&[-3.0, -2.0, 1.0, 0.0], &[1.0, 0.0], &[1.0, -1.0], 2);
/// assert!((plant.static_gain().unwrap().singular_values[0] - 0.5).abs() < 1e-12);
/// let TransmissionZeros::Finite(zeros) = plant.transmission_zeros() else { panic!() };
/// assert!((zeros[0].re - 1.0).abs() < 1e-12);
/// ```
#[derive(Clone, Debug)]
pub struct StateSpace {
    pub(crate) a: Mat<f64>,
    pub(crate) b: Mat<f64>,
    pub(crate) c: Mat<f64>,
}

/// A static gain -C A^-1 B.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticGain {
    /// The matrix, shape `[ny, nu]`, row by row.
    pub matrix: Vec<f64>,
    /// Its singular values, the largest first.
    pub singular_values: Vec<f64>,
    /// How many of them are not 0, to a millionth of the largest.
    pub rank: usize,
    /// Rows of the matrix.
    outputs: usize,
}

/// The transmission zeros from the inputs to the outputs.
#[derive(Clone, Debug, PartialEq)]
pub enum TransmissionZeros {
    /// These, in 1/s; none if the list is empty.
    Finite(Vec<Complex>),
    /// The transfer matrix has this rank at almost every s, less than it has rows and columns.
    Degenerate {
        /// The normal rank.
        rank: usize,
    },
}

impl StaticGain {
    /// Whether a controller that integrates errors with `model` as its gain drives the outputs away
    /// on the plant with this gain: `G_plant G_model^+` has an eigenvalue with a negative real part.
    /// For one output that is a gain of the other sign. `false` where a gain has no full rank.
    ///
    /// Reference: Grosdidier, Morari and Holt, "Closed-loop properties from steady-state gain
    /// information", Industrial & Engineering Chemistry Fundamentals 24 (1985).
    ///
    /// # Panics
    ///
    /// If the gains are not of the same shape.
    ///
    /// ```
    /// use pinc_analysis::StateSpace;
    ///
    /// let gain = |b: f64| StateSpace::new(&[-1.0], &[b], &[1.0], 1).static_gain().unwrap();
    /// assert!(gain(-2.0).reverses(&gain(1.0)) && !gain(2.0).reverses(&gain(1.0)));
    /// ```
    #[must_use]
    pub fn reverses(&self, model: &Self) -> bool {
        let outputs = self.outputs;
        assert_eq!((outputs, self.matrix.len()), (model.outputs, model.matrix.len()), "one shape");
        if self.rank < outputs || model.rank < outputs {
            return false;
        }
        let inputs = self.matrix.len() / outputs;
        let of = |gain: &Self| Mat::from_fn(outputs, inputs, |i, k| gain.matrix[i * inputs + k]);
        let (plant, model) = (of(self), of(model));
        // G_plant G_model^T (G_model G_model^T)^-1, by its transpose.
        let square = &model * model.transpose();
        let product = square.partial_piv_lu().solve(&(&model * plant.transpose()));
        product.eigenvalues().unwrap_or_default().iter().any(|value| value.re < 0.0)
    }
}

impl StateSpace {
    /// A plant of `states` states with these matrices, row by row.
    ///
    /// # Shapes
    ///
    /// `a`: `[nx, nx]` in 1/s; `b`: `[nx, nu]`; `c`: `[ny, nx]`.
    ///
    /// # Panics
    ///
    /// If a matrix has not whole rows, or `states` is 0.
    #[must_use]
    pub fn new(a: &[f64], b: &[f64], c: &[f64], states: usize) -> Self {
        assert!(states > 0 && a.len() == states * states, "A is square");
        assert!(b.len().is_multiple_of(states) && c.len().is_multiple_of(states), "whole rows");
        let (inputs, outputs) = (b.len() / states, c.len() / states);
        Self {
            a: Mat::from_fn(states, states, |i, k| a[i * states + k]),
            b: Mat::from_fn(states, inputs, |i, k| b[i * inputs + k]),
            c: Mat::from_fn(outputs, states, |i, k| c[i * states + k]),
        }
    }

    /// The plant about a point, with the states at the places `outputs` as outputs. `None` where a
    /// derivative is not finite.
    #[must_use]
    pub fn tangent(plant: &dyn DynRhs, point: &OperatingPoint, outputs: &[usize]) -> Option<Self> {
        let jacobian = jacobian(plant, point);
        let (n, m) = (point.x.len(), point.u.len());
        let finite = jacobian.col_iter().all(|column| column.iter().all(|v| v.is_finite()));
        finite.then(|| Self {
            a: jacobian.subcols(0, n).to_owned(),
            b: jacobian.subcols(n, m).to_owned(),
            c: Mat::from_fn(outputs.len(), n, |i, k| f64::from(u8::from(outputs[i] == k))),
        })
    }

    /// The same plant with states, inputs and outputs in other units: divided by these widths.
    /// Ranks are best decided where all variables have a like size.
    ///
    /// # Shapes
    ///
    /// `widths`: `nx + nu`, states first. Outputs are scaled as the states that they consist of.
    ///
    /// # Panics
    ///
    /// If a width is missing.
    #[must_use]
    pub fn scaled(&self, widths: &[f64]) -> Self {
        let (n, m) = (self.a.nrows(), self.b.ncols());
        assert_eq!(widths.len(), n + m, "one width per state and input");
        let output = |i: usize| {
            (0..n).map(|k| self.c[(i, k)].abs() * widths[k]).fold(f64::MIN_POSITIVE, f64::max)
        };
        Self {
            a: Mat::from_fn(n, n, |i, k| self.a[(i, k)] * widths[k] / widths[i]),
            b: Mat::from_fn(n, m, |i, k| self.b[(i, k)] * widths[n + k] / widths[i]),
            c: Mat::from_fn(self.c.nrows(), n, |i, k| self.c[(i, k)] * widths[k] / output(i)),
        }
    }

    /// The same plant with its states in these units, `nx`: its eigenvalues and gains stay. They are best
    /// computed where the states have a like size; entries of A in other units hide what rounding leaves.
    ///
    /// # Panics
    ///
    /// If there are fewer units than states.
    #[must_use]
    pub fn in_units(&self, units: &[f64]) -> Self {
        let n = self.a.nrows();
        Self {
            a: Mat::from_fn(n, n, |i, k| self.a[(i, k)] * units[k] / units[i]),
            b: Mat::from_fn(n, self.b.ncols(), |i, k| self.b[(i, k)] / units[i]),
            c: Mat::from_fn(self.c.nrows(), n, |i, k| self.c[(i, k)] * units[k]),
        }
    }

    /// Returns the eigenvalues of A in 1/s, or none if they cannot be computed. An eigenvalue that rounding
    /// cannot tell from 0 is 0, and so is such a real part. How far rounding moves each eigenvalue is
    /// estimated from a matrix with rounded entries, since integrators in series have eigenvalues that are off
    /// by a root of the rounding.
    #[must_use]
    pub fn eigenvalues(&self) -> Vec<Complex> {
        let n = self.a.nrows();
        let off = |i: usize, j: usize| {
            if (i + 2 * j).is_multiple_of(3) { f64::EPSILON } else { -f64::EPSILON }
        };
        let rounded = eigenvalues(&Mat::from_fn(n, n, |i, j| self.a[(i, j)] * (1.0 + off(i, j))));
        let values = eigenvalues(&self.a);
        let fastest = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let known = |value: &Complex| {
            let moved = rounded.iter().map(|v| (v.re - value.re).hypot(v.im - value.im));
            let margin = MARGIN * moved.fold(f64::INFINITY, f64::min) + ROUNDING * fastest;
            let im = if value.abs() <= margin { 0.0 } else { value.im };
            Complex { re: if value.re.abs() <= margin { 0.0 } else { value.re }, im }
        };
        values.iter().map(known).collect()
    }

    /// The eigenvalues of growing modes that no input acts on, so that no controller can stop their
    /// growth: those whose left eigenvector w has w'B = 0 (test of Popov, Belevitch and Hautus). Of
    /// eigenvalues that are equal, the one that is reached may hide the other.
    ///
    /// Call it of a plant whose variables have a like size ([`StateSpace::scaled`]).
    ///
    /// ```
    /// use pinc_analysis::StateSpace;
    ///
    /// // x' = u - x, y' = 0.2 y
    /// let plant = |b: f64| StateSpace::new(&[-1.0, 0.0, 0.0, 0.2], &[1.0, b], &[], 2);
    /// assert_eq!(plant(0.0).unreached_growth()[0].re, 0.2);
    /// assert!(plant(1e-3).unreached_growth().is_empty());
    /// ```
    #[must_use]
    pub fn unreached_growth(&self) -> Vec<Complex> {
        let Ok(left) = self.a.transpose().eigen() else { return Vec::new() };
        let n = self.a.nrows();
        let values: Vec<_> = left.S().column_vector().iter().copied().collect();
        let is_unreached = |mode: &Complex| {
            let distance = |k: usize| (values[k].re - mode.re).hypot(values[k].im - mode.im);
            let nearest = (0..n).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            let Some(w) = nearest.map(|k| left.U().col(k)) else { return false };
            let length = (0..n).map(|i| w[i].re.powi(2) + w[i].im.powi(2)).sum::<f64>().sqrt();
            let reach = |j: usize| {
                let part =
                    |of: &dyn Fn(usize) -> f64| (0..n).map(|i| of(i) * self.b[(i, j)]).sum::<f64>();
                part(&|i| w[i].re).hypot(part(&|i| w[i].im)) / length
            };
            (0..self.b.ncols()).all(|j| reach(j) <= REACH * mode.abs())
        };
        self.eigenvalues().into_iter().filter(|mode| mode.re > 0.0 && is_unreached(mode)).collect()
    }

    /// The static gain -C A^-1 B from the inputs to the outputs; `None` if A is singular: the plant
    /// integrates.
    #[must_use]
    pub fn static_gain(&self) -> Option<StaticGain> {
        if is_singular(&self.a) {
            return None;
        }
        let gain = -(&self.c * self.a.partial_piv_lu().solve(&self.b));
        let singular_values = gain.singular_values().unwrap_or_default();
        let largest = singular_values.first().copied().unwrap_or(0.0);
        let rank = singular_values.iter().filter(|v| **v > RANK * largest).count();
        let matrix = gain.row_iter().flat_map(|row| row.iter().copied().collect::<Vec<_>>());
        let outputs = gain.nrows();
        Some(StaticGain { matrix: matrix.collect(), singular_values, rank, outputs })
    }

    /// The states that may be at rest at any value, others and the input given: those that take
    /// part in the null space of A. None if A is regular.
    ///
    /// Call it of a plant whose variables have a like size ([`StateSpace::scaled`]).
    ///
    /// ```
    /// use pinc_analysis::StateSpace;
    ///
    /// // x' = v, v' = u - v: the position is free, the velocity is not.
    /// let plant = StateSpace::new(&[0.0, 1.0, 0.0, -1.0], &[0.0, 1.0], &[], 2);
    /// assert_eq!(plant.free_states(), [0]);
    /// ```
    #[must_use]
    pub fn free_states(&self) -> Vec<usize> {
        let n = self.a.nrows();
        let size = |i: usize| self.a.row(i).iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let rows: Vec<f64> = (0..n).map(size).collect();
        let scaled = |i: usize, k: usize| match rows[i] > 0.0 {
            true => self.a[(i, k)] / rows[i],
            false => 0.0,
        };
        let Ok(svd) = Mat::from_fn(n, n, scaled).svd() else { return Vec::new() };
        let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        let largest = values.first().copied().unwrap_or(0.0);
        let null: Vec<usize> = (0..n).filter(|&k| values[k] <= SINGULAR * largest).collect();
        let part = |i: usize| null.iter().map(|&k| svd.V()[(i, k)].powi(2)).sum::<f64>();
        (0..n).filter(|&i| part(i) > PART).collect()
    }

    /// The transmission zeros: the s at which the transfer matrix C (s - A)^-1 B loses rank.
    ///
    /// Call it of a plant whose variables have a like size ([`StateSpace::scaled`]).
    #[must_use]
    pub fn transmission_zeros(&self) -> TransmissionZeros {
        zeros::transmission_zeros(self)
    }
}

/// df/d(x, u), shape `[nx, nx + nu]`.
pub(crate) fn jacobian(plant: &dyn DynRhs, point: &OperatingPoint) -> Mat<f64> {
    let columns = point.x.len() + point.u.len();
    let jacobian = plant.jacobian(&point.x, &point.u, &[]);
    Mat::from_fn(point.x.len(), columns, |row, column| jacobian[row * columns + column])
}

/// f(x, u).
pub(crate) fn rhs(plant: &dyn DynRhs, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut dx = vec![0.0; x.len()];
    plant.rhs(x, u, &[], &mut dx);
    dx
}

/// Whether a square matrix is singular, its rows scaled to a like size first.
fn is_singular(matrix: &Mat<f64>) -> bool {
    let row = |i: usize| matrix.row(i).iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let rows: Vec<f64> = (0..matrix.nrows()).map(row).collect();
    if rows.contains(&0.0) {
        return true;
    }
    let scaled = Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, k| matrix[(i, k)] / rows[i]);
    let values = scaled.singular_values().unwrap_or_default();
    match (values.first(), values.last()) {
        (Some(largest), Some(smallest)) => smallest <= &(SINGULAR * largest),
        _ => true,
    }
}
