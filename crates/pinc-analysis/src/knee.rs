//! Points at which a linearization says little of what is around them.

use crate::{OperatingPoint, Region, StateSpace, TimeScales};
use pinc_ode::DynRhs;

/// How far around a point is looked, in widths of the region.
const AROUND: f64 = 0.05;

/// How many times slower the plant must be there.
const SLOWER: f64 = 5.0;

/// A Jacobian whose entries all change by less than this share of themselves has no knee between.
const CHANGED: f64 = 0.1;

/// If the plant is much faster at `point` than a twentieth of the region to either side of it in a
/// state, as in the middle of a friction law tanh(v/0.01), that state's place and a point beside.
///
/// A linearization inside such a knee holds only within it; a controller meets the plant beside it.
///
/// ```
/// use pinc_analysis::{OperatingPoint, Region, beyond_knee};
/// use pinc_expr::Equations;
/// use pinc_ode::Dims;
///
/// let plant: Equations = serde_json::from_str(
///     r#"{"states": [{"name": "v"}], "inputs": [{"name": "u"}],
///         "derivatives": {"v": "u - v - tanh(v/0.01)"}}"#,
/// )?;
/// let region = Region::new(Dims::new(1, 1), vec![-5.0, -9.0], vec![5.0, 9.0]);
/// let rest = OperatingPoint { x: vec![0.0], u: vec![0.0] };
/// let (state, beside) = beyond_knee(&plant.compile()?, &rest, &region).unwrap();
/// assert_eq!((state, beside.x[0]), (0, 0.5));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn beyond_knee(
    plant: &dyn DynRhs,
    point: &OperatingPoint,
    region: &Region,
) -> Option<(usize, OperatingPoint)> {
    let at_point = StateSpace::tangent(plant, point, &[])?;
    let widths = region.widths();
    let fastest_of =
        |tangent: &StateSpace| TimeScales::of(&tangent.in_units(&widths).eigenvalues()).fastest;
    let here = fastest_of(&at_point);
    // In a large plant a state changes few entries, and eigenvalues take long.
    let fastest = |point: &OperatingPoint| {
        let tangent = StateSpace::tangent(plant, point, &[])?;
        if !changes(&at_point, &tangent) {
            return Some(here);
        }
        Some(fastest_of(&tangent))
    };
    let beside = |i: usize| {
        let moved = |by: f64| {
            let mut moved = point.clone();
            moved.x[i] += by * region.width(i);
            moved
        };
        let (up, down) = (moved(AROUND), moved(-AROUND));
        let faster = fastest(&up)?.max(fastest(&down)?);
        (here > SLOWER * faster && faster > 0.0).then_some((faster, i, up))
    };
    let found = (0..point.x.len()).filter_map(beside);
    let slowest = found.min_by(|one, other| one.0.total_cmp(&other.0));
    slowest.map(|(_, i, point)| (i, point))
}

/// Whether an entry of A is another one there.
fn changes(here: &StateSpace, there: &StateSpace) -> bool {
    let entries = |plant: &StateSpace| -> Vec<f64> {
        plant.a.col_iter().flat_map(|column| column.iter().copied().collect::<Vec<_>>()).collect()
    };
    let mut pairs = entries(here).into_iter().zip(entries(there));
    pairs.any(|(a, b)| (a - b).abs() > CHANGED * a.abs().max(b.abs()))
}
