//! Analysis of the linearization at the end of a fit: intervals, correlations, and unknowns that the
//! data do not determine.

use crate::fit::Fit;
use crate::problem::Problem;
use faer::Mat;

/// Singular values below this share of the largest are none: that is what rounding leaves of 0.
const NOTHING: f64 = 1e-9;
/// Columns below this share of the largest are none.
const NO_COLUMN: f64 = 1e-12;
/// The share of an unknown in directions that are not determined from which on it is not either.
const SHARE: f64 = 1e-3;

/// The unknowns, in this order: the parameters, then the initial state of each recording.
#[derive(Debug)]
pub(crate) struct Analysis {
    /// The standard deviation of each, for residuals of standard deviation 1; infinite for one that
    /// is not determined, NaN for one that is held at a bound.
    pub(crate) sd: Vec<f64>,
    /// The correlation of each pair, row by row; NaN where there is none.
    pub(crate) correlation: Vec<f64>,
    /// The singular values of the residuals' derivatives by all unknowns, each in its scale, from
    /// the largest.
    pub(crate) singular_values: Vec<f64>,
    /// How many directions of the unknowns the residuals determine.
    pub(crate) rank: usize,
    /// The unknowns on which no residual depends.
    pub(crate) without_influence: Vec<usize>,
    /// Directions along which no residual changes: the relative change of each unknown.
    pub(crate) directions: Vec<Vec<f64>>,
}

impl Analysis {
    /// The analysis of a fit that was linearized at its end.
    pub(crate) fn of(problem: &Problem, fit: &Fit<'_>) -> Self {
        let columns = Columns::of(problem, fit);
        let unknowns = columns.unknowns.len();
        let matrix = columns.matrix(problem, fit);
        let empty = Self {
            sd: vec![f64::INFINITY; unknowns],
            correlation: vec![f64::NAN; unknowns * unknowns],
            singular_values: Vec::new(),
            rank: 0,
            without_influence: columns.without_influence(problem, fit),
            directions: Vec::new(),
        };
        let Some(svd) = (matrix.ncols() > 0).then(|| matrix.svd().ok()).flatten() else {
            return columns.marked(empty);
        };
        let sigma: Vec<f64> = svd.S().column_vector().iter().copied().collect();
        let least = NOTHING * sigma.first().copied().unwrap_or(0.0);
        let rank = sigma.iter().filter(|s| **s > least && **s > 0.0).count();
        // The parts of each unknown along the right singular vectors.
        let along = |unknown: &[f64]| -> Vec<f64> {
            let part = |k: usize| -> f64 {
                unknown.iter().enumerate().map(|(c, w)| w * svd.V()[(c, k)]).sum()
            };
            (0..matrix.ncols()).map(part).collect()
        };
        let parts: Vec<Vec<f64>> = columns.unknowns.iter().map(|w| along(w)).collect();
        let squares = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
        let roots: Vec<Vec<f64>> = parts
            .iter()
            .map(|of| of[..rank].iter().zip(&sigma).map(|(a, s)| a / s).collect())
            .collect();
        let determined = |i: usize| {
            let all = squares(&parts[i]);
            all > 0.0 && squares(&parts[i][rank..]) <= SHARE * SHARE * all
        };
        let sd: Vec<f64> = (0..unknowns)
            .map(|i| if determined(i) { squares(&roots[i]).sqrt() } else { f64::INFINITY })
            .collect();
        let mut correlation = vec![f64::NAN; unknowns * unknowns];
        for i in 0..unknowns {
            for j in (0..unknowns).filter(|&j| sd[i].is_finite() && sd[j].is_finite()) {
                let product: f64 = roots[i].iter().zip(&roots[j]).map(|(a, b)| a * b).sum();
                let one = i == j;
                correlation[i * unknowns + j] = if one { 1.0 } else { product / (sd[i] * sd[j]) };
            }
        }
        let direction = |k: usize| -> Vec<f64> {
            parts.iter().zip(&columns.scale).map(|(of, scale)| of[k] / scale).collect()
        };
        // A column of zeros is a direction of its own, which has been named.
        let alone = |direction: &Vec<f64>| {
            let named: f64 = empty.without_influence.iter().map(|&i| direction[i].powi(2)).sum();
            named < 0.5 * squares(direction)
        };
        let directions = (rank..matrix.ncols()).map(direction).filter(alone).collect();
        columns.marked(Self { sd, correlation, singular_values: sigma, rank, directions, ..empty })
    }
}

/// The columns of the residuals' derivatives: the parameters that are free, in their scales, then
/// the q of each recording.
struct Columns {
    /// The parameters that are free, by their places among the unknown ones.
    free: Vec<usize>,
    /// Each unknown as a sum of columns.
    unknowns: Vec<Vec<f64>>,
    /// The size of each unknown.
    scale: Vec<f64>,
    /// How many unknowns are parameters.
    parameters: usize,
    count: usize,
}

impl Columns {
    fn of(problem: &Problem, fit: &Fit<'_>) -> Self {
        let parameters = problem.unknown.len();
        let mut scale: Vec<f64> = (0..parameters).map(|i| size(problem, &fit.p, i)).collect();
        let held = |&i: &usize| !fit.linear.held(problem, &fit.p, i);
        let free: Vec<usize> = (0..parameters).filter(held).collect();
        let count = free.len() + fit.recordings.iter().map(|of| of.nq).sum::<usize>();
        let mut unknowns = vec![vec![0.0; count]; parameters];
        for (column, &i) in free.iter().enumerate() {
            unknowns[i][column] = scale[i];
        }
        let mut first = free.len();
        for of in fit.recordings.iter().filter(|of| of.nq > 0) {
            let width = of.triangle.width();
            for (row, size) in of.first_state().chunks_exact(width).zip(&of.scale) {
                let mut unknown = vec![0.0; count];
                unknown[first..first + of.nq].copy_from_slice(&row[..of.nq]);
                for (column, &i) in free.iter().enumerate() {
                    unknown[column] = row[of.nq + i] * scale[i];
                }
                unknowns.push(unknown);
                scale.push(*size);
            }
            first += of.nq;
        }
        Self { free, unknowns, scale, parameters, count }
    }

    fn matrix(&self, problem: &Problem, fit: &Fit<'_>) -> Mat<f64> {
        let mut rows: Vec<Vec<f64>> = Vec::new();
        let mut first = self.free.len();
        for (of, factor) in fit.recordings.iter().zip(fit.linear.factors()) {
            let width = of.triangle.width();
            for row in factor.chunks_exact(width).take(width - 1) {
                let mut to = vec![0.0; self.count];
                to[first..first + of.nq].copy_from_slice(&row[..of.nq]);
                for (column, &i) in self.free.iter().enumerate() {
                    to[column] = row[of.nq + i] * self.scale[i];
                }
                rows.push(to);
            }
            first += of.nq;
        }
        for (column, &i) in self.free.iter().enumerate() {
            if let Some(prior) = problem.unknown[i].prior {
                let mut to = vec![0.0; self.count];
                to[column] = self.scale[i] / prior.sd;
                rows.push(to);
            }
        }
        // At least as many rows as columns, for all right singular vectors.
        let count = rows.len().max(self.count);
        Mat::from_fn(count, self.count, |i, j| rows.get(i).map_or(0.0, |row| row[j]))
    }

    /// Parameters, and initial states of single shooting, whose columns are 0.
    fn without_influence(&self, problem: &Problem, fit: &Fit<'_>) -> Vec<usize> {
        let lengths = fit.linear.lengths();
        let lengths: Vec<f64> = lengths.iter().zip(&self.scale).map(|(l, s)| l * s).collect();
        let mut states = Vec::new();
        for (of, factor) in fit.recordings.iter().zip(fit.linear.factors()) {
            for i in 0..of.nq {
                let column = factor.iter().skip(i).step_by(of.triangle.width());
                states.push(column.map(|r| r * r).sum::<f64>().sqrt());
            }
        }
        let largest = lengths.iter().chain(&states).copied().fold(0.0, f64::max);
        let states = if fit.is_multiple() { Vec::new() } else { states };
        let all = lengths.into_iter().chain(states).enumerate();
        let none = all.filter(|(_, length)| *length <= NO_COLUMN * largest);
        let held = |i: usize| i < problem.unknown.len() && !self.free.contains(&i);
        none.map(|(i, _)| i).filter(|&i| !held(i)).collect()
    }

    /// With the parameters that are held at a bound marked.
    fn marked(&self, mut analysis: Analysis) -> Analysis {
        for i in (0..self.parameters).filter(|i| !self.free.contains(i)) {
            analysis.sd[i] = f64::NAN;
        }
        analysis
    }
}

/// The size of a parameter.
fn size(problem: &Problem, p: &[f64], i: usize) -> f64 {
    let unknown = &problem.unknown[i];
    let size = p[unknown.place].abs().max(1e-3 * unknown.initial.abs());
    if size > 0.0 { size } else { 1.0 }
}
