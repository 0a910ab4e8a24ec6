//! The points that are judged: drawn at random, or rows of a file.

use crate::RunError;
use pinc_record::columns::{finite, place, rows};
use pinc_record::read_file;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::path::Path;

/// The errors of one step from one point, for each state.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Judged {
    /// The error; none where there is no solution.
    pub(super) error: Vec<Option<f64>>,
    /// A proven bound of its absolute value, if there is one.
    pub(super) bound: Vec<Option<f64>>,
}

impl Judged {
    /// What is known to be at least the absolute error of a state: the bound, or else the error.
    pub(super) fn largest(&self, state: usize) -> f64 {
        let error = self.error[state].map(f64::abs);
        self.bound[state].or(error).unwrap_or(f64::INFINITY)
    }
}

/// `count` points of a box, drawn independently.
pub(super) fn random(domain: &[[f64; 2]], count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut point = || -> Vec<f64> {
        domain.iter().map(|[low, high]| rng.random_range(*low..=*high)).collect()
    };
    (0..count).map(|_| point()).collect()
}

/// The rows of a CSV file with a column for each of `variables`; other columns are ignored.
pub(super) fn read_points(path: &Path, variables: &[String]) -> Result<Vec<Vec<f64>>, RunError> {
    let text = read_file(path)?;
    let at = |(line, problem)| RunError::Csv { path: path.to_owned(), line, problem };
    let (header, rows) = rows(&text).map_err(at)?;
    let places = variables.iter().map(|name| place(&header, name, variables));
    let places: Vec<usize> =
        places.collect::<Result<_, _>>().map_err(|problem| at((1, problem)))?;
    let mut points = Vec::new();
    for row in rows {
        let (line, cells) = row.map_err(at)?;
        let number = |(place, name): (&usize, &String)| finite(&cells[*place], name);
        let point = places.iter().zip(variables).map(number).collect::<Result<_, _>>();
        points.push(point.map_err(|problem| at((line, problem)))?);
    }
    let none = || at((1, "a header without rows, expected a row for each point".to_owned()));
    (!points.is_empty()).then_some(points).ok_or_else(none)
}
