//! The weights of the cost.

use crate::MpcError;
use crate::error::{check_length, check_numbers};
use serde::{Deserialize, Serialize};

/// The weights of the cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Q, for the controlled states.
    pub q: Weight,
    /// R, for the inputs' increments.
    pub r: Weight,
    /// The weight of the last predicted state, x\[k+N2\], in place of `w_N2` Q.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terminal: Option<Weight>,
    /// How the weights go along the horizon.
    #[serde(default)]
    pub profile: Profile,
}

impl Weights {
    /// The same weights, Q and R, at every stage.
    #[must_use]
    pub fn uniform(q: impl Into<Weight>, r: impl Into<Weight>) -> Self {
        Self { q: q.into(), r: r.into(), terminal: None, profile: Profile::Uniform }
    }
}

/// A symmetric, positive semidefinite matrix. In a file: a list of numbers, the diagonal, or a list of
/// rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a list of numbers (a diagonal) or a list of rows")]
pub enum Weight {
    /// The diagonal of a diagonal matrix; not negative.
    Diagonal(Vec<f64>),
    /// All of the matrix, row by row.
    Full(Vec<Vec<f64>>),
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

    /// Entry (i, k).
    pub(crate) fn entry(&self, i: usize, k: usize) -> f64 {
        match self {
            Self::Diagonal(diagonal) => {
                if i == k {
                    diagonal[i]
                } else {
                    0.0
                }
            }
            Self::Full(rows) => rows[i][k],
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
    if rows.len() != expected {
        return Err(MpcError::Length { field, expected, found: rows.len() });
    }
    for row in rows {
        check_length(field, row, expected)?;
        check_numbers(field, row, "finite", f64::is_finite)?;
    }
    for (i, row) in rows.iter().enumerate() {
        for (k, entry) in row.iter().enumerate().take(i) {
            if entry.total_cmp(&rows[k][i]).is_ne() {
                return Err(MpcError::NotSymmetric { field, row: i, column: k });
            }
        }
    }
    if is_semidefinite(rows) { Ok(()) } else { Err(MpcError::NotSemidefinite { field }) }
}

/// Whether the symmetric matrix has no negative eigenvalue, but for rounding: by elimination with the
/// largest pivot first.
fn is_semidefinite(rows: &[Vec<f64>]) -> bool {
    let mut rest = rows.to_vec();
    let largest = rest.iter().flatten().fold(0.0_f64, |largest, w| largest.max(w.abs()));
    let negligible = 1e-12 * largest;
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

/// How the weights go along the horizon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// The cost as printed: all `w_j = v_i = 1`.
    #[default]
    Uniform,
    /// The cost behind the paper's Table 1. Its authors' program adds up the stage costs
    ///
    /// ```text
    /// l_i = |y[k+i+1] - yref[k+i+1]|_Q^2 + |du[k+i]|_R^2        i = 0..N2-1
    /// ```
    ///
    /// in a variable that is never set back to 0 within the horizon, and adds that variable times T
    /// to the cost at every stage. Stage i is thus counted in its own stage and in every later one,
    /// its tracking part and its du part alike: `w_{i+1} = v_i = (N2 - i) T`. (The four tanks tell the
    /// readings apart: dense IAE 544.41, but 530.9 if only the tracking part were counted so and du
    /// once, 532.2 if it were counted once times T.)
    Cumulative,
}

impl Profile {
    /// The weight of stage `i` of `stages` stages of `sample_time_s` seconds.
    pub(crate) fn weight(self, i: usize, stages: usize, sample_time_s: f64) -> f64 {
        match self {
            Self::Uniform => 1.0,
            #[expect(clippy::cast_precision_loss, reason = "no horizon has 2^53 stages")]
            Self::Cumulative => (stages - i) as f64 * sample_time_s,
        }
    }
}
