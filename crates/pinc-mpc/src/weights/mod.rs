//! The weights of the cost.

#[cfg(test)]
mod tests;

use crate::MpcError;
use crate::error::{check_length, check_numbers};
use pinc_ode::ArgumentError;
use serde::{Deserialize, Serialize};

/// The weights of the cost, at each stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Q, for the tracked quantities: stage i weights the quantities of x\[k+i+1\], i = 0..N2-1.
    pub q: PerStage<Weight>,
    /// R, for the inputs' increments: stage i weights du\[k+i\], i = 0..Nu-1.
    pub r: PerStage<Weight>,
    /// The weight of the last predicted state, x\[k+N2\], in place of Q's last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terminal: Option<Weight>,
    /// W, for all inputs as one vector (u\[k-1\], u\[k\], .., u\[k+Nu-1\]): (Nu + 1) m rows. It
    /// couples stages, as second differences do; [`QpMethod::Riccati`](crate::QpMethod) refuses it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input_sequence: Option<Weight>,
}

impl Weights {
    /// Equal weights Q and R at every stage.
    #[must_use]
    pub fn uniform(q: impl Into<Weight>, r: impl Into<Weight>) -> Self {
        Self::new(PerStage::Same(q.into()), PerStage::Same(r.into()))
    }

    /// The weights Q and R.
    #[must_use]
    pub fn new(q: PerStage<Weight>, r: PerStage<Weight>) -> Self {
        Self { q, r, terminal: None, input_sequence: None }
    }

    /// Q and R times a factor per stage: `w` of Q, as many as N2, and `v` of R, as many as Nu.
    #[must_use]
    pub fn scaled(q: impl Into<Weight>, r: impl Into<Weight>, w: &[f64], v: &[f64]) -> Self {
        let (q, r) = (q.into(), r.into());
        let each = |weight: &Weight, factors: &[f64]| PerStage::Each {
            stages: factors.iter().map(|&factor| weight.times(factor)).collect(),
        };
        Self::new(each(&q, w), each(&r, v))
    }

    /// Whether the error of the tracked quantity `i` costs anything.
    #[must_use]
    pub fn tracks(&self, i: usize) -> bool {
        let weighs = |weight: &Weight| i < weight.size() && weight.entry(i, i) > 0.0;
        self.q.all().iter().chain(&self.terminal).any(weighs)
    }

    /// Adds the weight `terminal` of the last predicted state.
    #[must_use]
    pub fn with_terminal(self, terminal: impl Into<Weight>) -> Self {
        Self { terminal: Some(terminal.into()), ..self }
    }

    /// Adds the weight W of all inputs.
    #[must_use]
    pub fn with_input_sequence(self, w: impl Into<Weight>) -> Self {
        Self { input_sequence: Some(w.into()), ..self }
    }
}

impl From<Vec<Vec<f64>>> for Weight {
    fn from(rows: Vec<Vec<f64>>) -> Self {
        Self::Full(rows)
    }
}

/// Something that is the same at all stages, or differs. In a file: the thing itself, or a table
/// with the list `stages`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum PerStage<T> {
    /// One for all stages.
    Same(T),
    /// One for each stage.
    Each {
        /// In the order of the stages.
        stages: Vec<T>,
    },
}

impl<T> PerStage<T> {
    /// Returns the value at stage `i`, from 0 on.
    ///
    /// # Panics
    ///
    /// If there is no such stage.
    #[must_use]
    pub fn at(&self, i: usize) -> &T {
        match self {
            Self::Same(all) => all,
            Self::Each { stages } => &stages[i],
        }
    }

    /// Returns the values of all stages, or the one that they share.
    #[must_use]
    pub fn all(&self) -> &[T] {
        match self {
            Self::Same(all) => std::slice::from_ref(all),
            Self::Each { stages } => stages,
        }
    }
}

impl PerStage<Weight> {
    /// Checks that these are matrices of `expected` rows, one or as many as `stages`.
    pub(crate) fn validate(
        &self,
        field: &'static str,
        stages: usize,
        expected: usize,
    ) -> Result<(), MpcError> {
        if let Self::Each { stages: each } = self
            && each.len() != stages
        {
            return Err(MpcError::Stages { field, expected: stages, found: each.len() });
        }
        self.all().iter().try_for_each(|weight| weight.validate(field, expected))
    }
}

impl<T: Into<Weight>> From<T> for PerStage<Weight> {
    fn from(weight: T) -> Self {
        Self::Same(weight.into())
    }
}

/// A symmetric, positive semidefinite matrix. In a file: a list of numbers, the diagonal, or a list
/// of rows. What rounding leaves between the two halves of a matrix is averaged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a list of numbers (a diagonal) or a list of rows")]
pub enum Weight {
    /// The diagonal of a diagonal matrix; not negative.
    Diagonal(Vec<f64>),
    /// All of the matrix, row by row.
    Full(Vec<Vec<f64>>),
}

/// The weight of nothing: a matrix without rows.
impl Default for Weight {
    fn default() -> Self {
        Self::Diagonal(Vec::new())
    }
}

impl From<Vec<f64>> for Weight {
    fn from(diagonal: Vec<f64>) -> Self {
        Self::Diagonal(diagonal)
    }
}

impl Weight {
    /// The number of rows.
    #[must_use]
    pub fn size(&self) -> usize {
        match self {
            Self::Diagonal(diagonal) => diagonal.len(),
            Self::Full(rows) => rows.len(),
        }
    }

    /// The matrix times a number.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        let scaled = |row: &Vec<f64>| row.iter().map(|w| factor * w).collect();
        match self {
            Self::Diagonal(diagonal) => Self::Diagonal(scaled(diagonal)),
            Self::Full(rows) => Self::Full(rows.iter().map(scaled).collect()),
        }
    }

    /// Entry (i, k).
    ///
    /// # Panics
    ///
    /// If there is no such row or column.
    #[must_use]
    pub fn entry(&self, i: usize, k: usize) -> f64 {
        match self {
            Self::Diagonal(diagonal) => {
                if i == k {
                    diagonal[i]
                } else {
                    0.0
                }
            }
            Self::Full(rows) => {
                // Equal from both sides, and exactly the entry where the halves are equal.
                let (low, high) = (i.min(k), i.max(k));
                let [a, b] = [rows[low][high], rows[high][low]];
                a + 0.5 * (b - a)
            }
        }
    }

    /// Checks that this is a symmetric, positive semidefinite matrix of `expected` rows.
    ///
    /// # Errors
    ///
    /// [`MpcError`], naming `field` and what was expected of it.
    pub fn validate(&self, field: &'static str, expected: usize) -> Result<(), MpcError> {
        match self {
            Self::Diagonal(diagonal) => {
                check_length(field, diagonal, expected)?;
                let good = |w: f64| w >= 0.0 && w.is_finite();
                check_numbers(field, diagonal, "finite and not negative", good)
            }
            Self::Full(rows) => check_full(field, rows, expected),
        }
    }
}

fn check_full(field: &'static str, rows: &[Vec<f64>], expected: usize) -> Result<(), MpcError> {
    ArgumentError::check_length(field, rows.len(), expected)?;
    for row in rows {
        check_length(field, row, expected)?;
        check_numbers(field, row, "finite", f64::is_finite)?;
    }
    for (i, row) in rows.iter().enumerate() {
        for (k, entry) in row.iter().enumerate().take(i) {
            let size = rows[i][i].sqrt() * rows[k][k].sqrt();
            if (entry - rows[k][i]).abs() > ROUNDING * size {
                return Err(MpcError::NotSymmetric { field, row: i, column: k });
            }
        }
    }
    if is_semidefinite(rows) { Ok(()) } else { Err(MpcError::NotSemidefinite { field }) }
}

/// What the two halves of a symmetric matrix may differ by, in units in which its diagonal is 1.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Whether the symmetric matrix has no negative eigenvalue, up to rounding: by elimination with the
/// largest pivot first. The answer does not depend on the units of rows and columns.
fn is_semidefinite(rows: &[Vec<f64>]) -> bool {
    let negligible = 1e-12;
    // In units in which the diagonal is 1, or 0.
    let mut rest = rows.to_vec();
    for (i, row) in rows.iter().enumerate() {
        for (k, w) in row.iter().enumerate() {
            let largest = rows[i][i].sqrt() * rows[k][k].sqrt();
            // A negative weight, whose root is NaN, or a negative minor w_ii w_kk - w_ik^2.
            if largest.is_nan() || w.abs() > largest * (1.0 + negligible) {
                return false;
            }
            rest[i][k] = if largest > 0.0 { w / largest } else { 0.0 };
        }
    }
    let mut open: Vec<usize> = (0..rest.len()).collect();
    while let Some(place) =
        (0..open.len()).max_by(|&i, &k| rest[open[i]][open[i]].total_cmp(&rest[open[k]][open[k]]))
    {
        let pivot = open[place];
        let column: Vec<f64> = rest.iter().map(|row| row[pivot]).collect();
        if column[pivot] <= negligible {
            // No positive pivot is left: the rest must be 0.
            return open.iter().all(|&i| open.iter().all(|&k| rest[i][k].abs() <= negligible));
        }
        open.swap_remove(place);
        for &i in &open {
            for &k in &open {
                rest[i][k] -= column[i] * column[k] / column[pivot];
            }
        }
    }
    true
}
