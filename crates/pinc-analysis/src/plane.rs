//! The plane that contains a set of points.

use faer::Mat;

/// Variation across a plane, in widths squared, that counts as none.
const FLAT: f64 = 1e-12;

/// The points y with `normal` y = `offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// A unit vector, one number per variable.
    pub normal: Vec<f64>,
    /// The distance from the origin.
    pub offset: f64,
}

/// A plane that all samples lie on, if there is one: the direction in which they do not vary.
///
/// # Shapes
///
/// `samples`: points of `widths.len()` variables; `widths`: the sizes of these.
///
/// ```
/// let samples = [[0.0, 1.0], [1.0, 3.0], [2.0, 5.0]].map(Vec::from);
/// let plane = pinc_analysis::common_plane(&samples, &[1.0, 1.0]).unwrap();
/// // y2 = 1 + 2 y1
/// assert!((plane.offset / plane.normal[1] - 1.0).abs() < 1e-9);
/// assert!((plane.normal[0] / plane.normal[1] + 2.0).abs() < 1e-9);
/// ```
#[must_use]
pub fn common_plane(samples: &[Vec<f64>], widths: &[f64]) -> Option<Plane> {
    let p = widths.len();
    let count = samples.len() as f64;
    let mean: Vec<f64> =
        (0..p).map(|i| samples.iter().map(|y| y[i]).sum::<f64>() / count).collect();
    let covariance = Mat::from_fn(p, p, |i, k| {
        let product = |y: &Vec<f64>| (y[i] - mean[i]) * (y[k] - mean[k]) / (widths[i] * widths[k]);
        samples.iter().map(product).sum::<f64>() / count
    });
    // Singular values in decreasing order: squares of lengths, in widths.
    let svd = covariance.svd().ok()?;
    if svd.S().column_vector().iter().last().is_none_or(|least| *least > FLAT) {
        return None;
    }
    let direction: Vec<f64> = (0..p).map(|i| svd.V()[(i, p - 1)] / widths[i]).collect();
    let length = direction.iter().map(|a| a * a).sum::<f64>().sqrt();
    let normal: Vec<f64> = direction.iter().map(|a| a / length).collect();
    let offset = normal.iter().zip(&mean).map(|(a, y)| a * y).sum();
    Some(Plane { normal, offset })
}

/// The ratio y2 / y1 that all samples of two variables have, to a millionth.
///
/// ```
/// let samples = [vec![1.0, 1.5], vec![4.0, 6.0]];
/// assert_eq!(pinc_analysis::common_ratio(&samples), Some(1.5));
/// ```
#[must_use]
pub fn common_ratio(samples: &[Vec<f64>]) -> Option<f64> {
    let ratios = samples.iter().map(|y| match y[..] {
        [one, two] => two / one,
        _ => f64::NAN,
    });
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for ratio in ratios {
        if !ratio.is_finite() {
            return None;
        }
        (low, high) = (low.min(ratio), high.max(ratio));
    }
    (high - low <= 1e-6 * high.abs().max(low.abs())).then(|| f64::midpoint(low, high))
}
