//! Zeros of an equation's terms in and around a box.

use crate::{OperatingPoint, Region};
use std::cell::Cell;
use std::fmt;

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

/// The operations of terms after which no further ones are looked at.
const MOST_OPERATIONS: u64 = 1_000_000_000;

/// Terms whose zeros are looked for. A function that gives all of them at a point is one; others
/// can say how to compute one alone.
pub trait Terms {
    /// All of them at a point `[x, u]`, as many at every point.
    fn values(&self, at: &[f64]) -> Vec<f64>;

    /// One of them.
    fn alone(&self, i: usize) -> Term<'_>;
}

/// A function of a point `[x, u]`.
pub type Value<'a> = Box<dyn Fn(&[f64]) -> f64 + 'a>;

/// One of several [`Terms`].
pub struct Term<'a> {
    /// Its value at a point `[x, u]`.
    pub value: Value<'a>,
    /// The variables that it depends on, states first; all if it is not known.
    pub variables: Option<Vec<usize>>,
    /// About how many operations a value takes.
    pub operations: usize,
}

impl fmt::Debug for Term<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { variables, operations, .. } = self;
        let mut shown = f.debug_struct("Term");
        shown.field("variables", variables).field("operations", operations).finish_non_exhaustive()
    }
}

impl<F: Fn(&[f64]) -> Vec<f64>> Terms for F {
    fn values(&self, at: &[f64]) -> Vec<f64> {
        self(at)
    }

    fn alone(&self, i: usize) -> Term<'_> {
        Term { value: Box::new(move |at| self(at)[i]), variables: None, operations: 1 }
    }
}

/// Where terms become 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Crossings {
    /// For each term a place, if one was found.
    pub found: Vec<Option<Crossing>>,
    /// How many terms at the end were not looked at, since those before took so long.
    pub left_out: usize,
}

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
/// let terms = |at: &[f64]| vec![at[0] + 0.1, at[0] + 2.0];
/// let found = crossings(&terms, &region, 0.15, 1).found;
/// let crossing = found[0].as_ref().unwrap();
/// assert!((crossing.before.x[0] + 0.1).abs() < 1e-9 && !crossing.is_inside);
/// assert_eq!(found[1], None);
/// ```
#[must_use]
pub fn crossings(terms: &dyn Terms, region: &Region, margin: f64, seed: u64) -> Crossings {
    let wide = region.enlarged(margin);
    let centre = region.centre().joined();
    let mut points = vec![centre];
    points.extend(wide.special_points().iter().map(OperatingPoint::joined));
    points.extend(region.points(seed).take(POINTS).map(|point| point.joined()));
    points.extend(wide.points(seed).take(POINTS).map(|point| point.joined()));
    let values: Vec<Vec<f64>> = points.iter().map(|point| terms.values(point)).collect();
    let overhangs = points.iter().map(|point| overhang(region, point)).collect();
    let search = Search { region, wide: &wide, points: &points, overhangs };
    let done = Cell::new(0_u64);
    let crossing = |i: usize| {
        let of_term: Vec<f64> = values.iter().map(|values| values[i]).collect();
        let Term { value, variables, operations } = terms.alone(i);
        let counted = |at: &[f64]| {
            done.set(done.get().saturating_add(1 + operations as u64));
            value(at)
        };
        let variables = variables.unwrap_or_else(|| (0..points[0].len()).collect());
        search.crossing(&counted, &variables, &of_term)
    };
    let count = values[0].len();
    let looked_at = (0..count).map_while(|i| (done.get() < MOST_OPERATIONS).then(|| crossing(i)));
    let mut found: Vec<_> = looked_at.collect();
    let left_out = count - found.len();
    found.resize(count, None);
    Crossings { found, left_out }
}

struct Search<'a> {
    region: &'a Region,
    wide: &'a Region,
    points: &'a [Vec<f64>],
    /// How far each point is outside the box.
    overhangs: Vec<f64>,
}

impl Search<'_> {
    fn crossing(
        &self,
        term: &dyn Fn(&[f64]) -> f64,
        variables: &[usize],
        values: &[f64],
    ) -> Option<Crossing> {
        // From the middle, unless it is 0 itself.
        let base = values.iter().position(|v| v.is_finite() && *v != 0.0)?;
        let (from, sign) = (&self.points[base], values[base].signum());
        let mut beyond: Vec<usize> =
            (0..values.len()).filter(|&k| values[k] * sign <= 0.0).collect();
        beyond.sort_by(|&a, &b| self.overhangs[a].total_cmp(&self.overhangs[b]));
        let nearest = beyond.iter().take(WAYS).map(|&k| &self.points[k]);
        let ways = nearest.map(|to| bisect(term, from, to, sign));
        let least = ways.min_by(|a, b| self.overhang(&a.0).total_cmp(&self.overhang(&b.0)));
        let (before, behind) = least.or_else(|| {
            let mut small: Vec<usize> =
                (0..values.len()).filter(|&k| values[k].is_finite()).collect();
            small.sort_by(|&a, &b| values[a].abs().total_cmp(&values[b].abs()));
            let lows = small.into_iter().take(DESCENTS);
            let mut lows = lows.map(|k| self.descend(term, variables, self.points[k].clone()));
            let touches = |v: &f64| v.abs() <= ZERO * values[base].abs() || v * sign <= 0.0;
            lows.find(|low| touches(&term(low))).map(|low| (low.clone(), low))
        })?;
        let (before, behind) = self.simplified(term, variables, sign, (before, behind));
        let is_inside = self.overhang(&before) <= 0.0;
        let point = |v: Vec<f64>| self.region.split(v);
        Some(Crossing { before: point(before), behind: point(behind), is_inside })
    }

    /// How far a point is outside the box, in widths.
    fn overhang(&self, point: &[f64]) -> f64 {
        overhang(self.region, point)
    }

    /// The crossing with irrelevant variables moved to the middle, or else inside the box.
    fn simplified(
        &self,
        term: &dyn Fn(&[f64]) -> f64,
        variables: &[usize],
        sign: f64,
        (mut before, mut behind): (Vec<f64>, Vec<f64>),
    ) -> (Vec<f64>, Vec<f64>) {
        let crosses = |before: &[f64], behind: &[f64]| {
            term(before) * sign > 0.0 && term(behind) * sign <= 0.0
        };
        if !crosses(&before, &behind) {
            return (before, behind);
        }
        for k in 0..before.len() {
            let (low, high) = (self.region.low[k], self.region.high[k]);
            if variables.binary_search(&k).is_err() {
                (before[k], behind[k]) = (f64::midpoint(low, high), f64::midpoint(low, high));
                continue;
            }
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
    fn descend(
        &self,
        term: &dyn Fn(&[f64]) -> f64,
        variables: &[usize],
        mut at: Vec<f64>,
    ) -> Vec<f64> {
        let mut steps = self.wide.widths();
        steps.iter_mut().for_each(|step| *step *= 0.1);
        let mut least = term(&at).abs();
        for _ in 0..ROUNDS {
            for &i in variables {
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

/// How far a point is outside a box, in widths.
fn overhang(region: &Region, point: &[f64]) -> f64 {
    let ends = region.low.iter().zip(&region.high).enumerate();
    let outside =
        ends.zip(point).map(|((i, (low, high)), v)| (low - v).max(v - high) / region.width(i));
    outside.fold(0.0, f64::max)
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
