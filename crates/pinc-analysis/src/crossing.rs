//! Where terms of an equation become 0 in and around a box.

use crate::{OperatingPoint, Region};

/// Random points of the box, and as many of the wider one.
const POINTS: usize = 1000;

/// Ways from the middle on which a change of sign is located.
const WAYS: usize = 64;

/// Halvings of such a way.
const HALVINGS: usize = 60;

/// Points from which a term without a change of sign is made smaller, and rounds of that.
const DESCENTS: usize = 4;
const ROUNDS: usize = 200;

/// A size that counts as 0, of that in the middle.
const ZERO: f64 = 1e-9;

/// A place where a term becomes 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Crossing {
    /// The last place before, seen from the middle of the box.
    pub before: OperatingPoint,
    /// The first place at or behind it.
    pub behind: OperatingPoint,
    /// Whether it is in the box, and not only a little beyond it.
    pub is_inside: bool,
}

/// For each of some terms a place where it becomes 0, in `region` or `margin` of its widths beyond;
/// near the box or inside if there is a choice. Random points are looked at, and the neighbourhood
/// of those where a term is small, so that a place in a small corner can be missed.
///
/// # Shapes
///
/// `terms` gives the same number of values at each point `[x, u]`.
///
/// ```
/// use pinc_analysis::{Region, crossings};
/// use pinc_ode::Dims;
///
/// let region = Region::new(Dims::new(1, 1), vec![0.0, 0.0], vec![3.0, 1.0]);
/// let found = crossings(&|at| vec![at[0] + 0.1, at[0] + 2.0], &region, 0.15, 1);
/// let crossing = found[0].as_ref().unwrap();
/// assert!((crossing.before.x[0] + 0.1).abs() < 1e-9 && !crossing.is_inside);
/// assert_eq!(found[1], None);
/// ```
#[must_use]
pub fn crossings(
    terms: &dyn Fn(&[f64]) -> Vec<f64>,
    region: &Region,
    margin: f64,
    seed: u64,
) -> Vec<Option<Crossing>> {
    let wide = region.enlarged(margin);
    let centre = region.centre().joined();
    let mut points = vec![centre];
    points.extend(wide.special_points().iter().map(OperatingPoint::joined));
    points.extend(region.points(seed).take(POINTS).map(|point| point.joined()));
    points.extend(wide.points(seed).take(POINTS).map(|point| point.joined()));
    let values: Vec<Vec<f64>> = points.iter().map(|point| terms(point)).collect();
    let search = Search { region, wide: &wide, points: &points };
    let crossing = |i: usize| {
        let of_term: Vec<f64> = values.iter().map(|values| values[i]).collect();
        search.crossing(&|at| terms(at)[i], &of_term)
    };
    (0..values[0].len()).map(crossing).collect()
}

struct Search<'a> {
    region: &'a Region,
    wide: &'a Region,
    points: &'a [Vec<f64>],
}

impl Search<'_> {
    fn crossing(&self, term: &dyn Fn(&[f64]) -> f64, values: &[f64]) -> Option<Crossing> {
        // From the middle, unless it is 0 itself.
        let base = values.iter().position(|v| v.is_finite() && *v != 0.0)?;
        let (from, sign) = (&self.points[base], values[base].signum());
        let mut beyond: Vec<&Vec<f64>> = self
            .points
            .iter()
            .zip(values)
            .filter(|(_, v)| **v * sign <= 0.0)
            .map(|(point, _)| point)
            .collect();
        beyond.sort_by(|a, b| self.overhang(a).total_cmp(&self.overhang(b)));
        let ways = beyond.iter().take(WAYS).map(|to| bisect(term, from, to, sign));
        let least = ways.min_by(|a, b| self.overhang(&a.0).total_cmp(&self.overhang(&b.0)));
        let (before, behind) = least.or_else(|| {
            let mut small: Vec<usize> =
                (0..values.len()).filter(|&k| values[k].is_finite()).collect();
            small.sort_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs()));
            let lows = small.into_iter().take(DESCENTS);
            let mut lows = lows.map(|k| self.descend(term, self.points[k].clone()));
            let touches = |v: &f64| v.abs() <= ZERO * values[base].abs() || v * sign <= 0.0;
            lows.find(|low| touches(&term(low))).map(|low| (low.clone(), low))
        })?;
        let (before, behind) = self.simplified(term, sign, before, behind);
        let is_inside = self.overhang(&before) <= 0.0;
        let point = |v: Vec<f64>| self.region.split(v);
        Some(Crossing { before: point(before), behind: point(behind), is_inside })
    }

    /// How far a point is outside the box, in widths.
    fn overhang(&self, point: &[f64]) -> f64 {
        let outside = point.iter().enumerate().map(|(i, v)| {
            (self.region.low[i] - v).max(v - self.region.high[i]) / self.region.width(i)
        });
        outside.fold(0.0, f64::max)
    }

    /// The same crossing with the variables that do not matter in the middle, or else inside the
    /// box.
    fn simplified(
        &self,
        term: &dyn Fn(&[f64]) -> f64,
        sign: f64,
        mut before: Vec<f64>,
        mut behind: Vec<f64>,
    ) -> (Vec<f64>, Vec<f64>) {
        let crosses = |before: &[f64], behind: &[f64]| {
            term(before) * sign > 0.0 && term(behind) * sign <= 0.0
        };
        for k in 0..before.len() {
            let (low, high) = (self.region.low[k], self.region.high[k]);
            for to in [f64::midpoint(low, high), before[k].clamp(low, high)] {
                let kept = (before[k], behind[k]);
                (before[k], behind[k]) = (to, to);
                if crosses(&before, &behind) {
                    break;
                }
                (before[k], behind[k]) = kept;
            }
        }
        (before, behind)
    }

    /// Makes a term small by moving one variable at a time.
    fn descend(&self, term: &dyn Fn(&[f64]) -> f64, mut at: Vec<f64>) -> Vec<f64> {
        let mut steps = self.wide.widths();
        steps.iter_mut().for_each(|step| *step *= 0.1);
        let mut least = term(&at).abs();
        for _ in 0..ROUNDS {
            for i in 0..at.len() {
                let here = at[i];
                let mut better = false;
                for to in [here - steps[i], here + steps[i]] {
                    at[i] = to.clamp(self.wide.low[i], self.wide.high[i]);
                    let size = term(&at).abs();
                    if size < least {
                        (least, better) = (size, true);
                        break;
                    }
                    at[i] = here;
                }
                steps[i] *= if better { 1.5 } else { 0.5 };
            }
        }
        at
    }
}

/// The last point with the sign, and the first without it, on the way from one to the other.
fn bisect(
    term: &dyn Fn(&[f64]) -> f64,
    from: &[f64],
    to: &[f64],
    sign: f64,
) -> (Vec<f64>, Vec<f64>) {
    let (mut before, mut behind) = (from.to_vec(), to.to_vec());
    for _ in 0..HALVINGS {
        let ends = before.iter().zip(&behind);
        let middle: Vec<f64> = ends.map(|(a, b)| f64::midpoint(*a, *b)).collect();
        if term(&middle) * sign > 0.0 { before = middle } else { behind = middle }
    }
    (before, behind)
}
