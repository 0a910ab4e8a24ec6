//! Poles, jumps and kinks of an equation, found on lines through a box along each variable.

use crate::state_space::{jacobian, rhs};
use crate::{OperatingPoint, Region};
use pinc_ode::DynRhs;

/// Intervals of a line.
const INTERVALS: u32 = 48;

/// Lines, shared out among the variables, and the least number of each.
const LINES: usize = 200;
const LEAST_LINES: usize = 4;

/// Points from which the usual size of a rate is taken.
const POINTS: usize = 200;

/// A rate this many times its median size is a pole's.
const HUGE: f64 = 1e3;

/// Steps of the search for a peak, each to 0.618 of the interval before.
const PEAK_STEPS: usize = 60;

/// Halvings of an interval about a jump. What is smooth changes by a 65536th of what it did before.
const HALVINGS: usize = 16;

/// A jump, or a kink over the width of the box, of this share of the rate's median size matters.
const MATTERS: f64 = 0.1;

/// This close to an end of the box, in widths, a kink belongs to a guard.
const AT_THE_END: f64 = 0.01;

/// The kind of irregularity of an equation at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IrregularityKind {
    /// A rate grows to a thousand times its usual size or more, on one side at least.
    Pole,
    /// A rate is not finite beyond.
    Undefined,
    /// A rate jumps.
    Jump,
    /// The derivative of a rate jumps.
    Kink,
}

/// A place where an equation is not smooth.
#[derive(Clone, Debug, PartialEq)]
pub struct Irregularity {
    /// The kind.
    pub kind: IrregularityKind,
    /// The state whose rate it is.
    pub state: usize,
    /// Along which variable it was found, states first.
    pub variable: usize,
    /// The places just before and just behind it, which differ in that variable.
    pub sides: [OperatingPoint; 2],
    /// Whether it is in the box, and not only a little beyond it.
    pub is_inside: bool,
}

/// A look at an equation along lines through a box.
///
/// ```
/// use pinc_analysis::{IrregularityKind, Region, Survey};
/// use pinc_expr::Equations;
/// use pinc_ode::Dims;
///
/// let plant: Equations = serde_json::from_str(
///     r#"{"states": [{"name": "x"}], "inputs": [{"name": "u"}],
///         "derivatives": {"x": "abs(x) + u"}}"#,
/// )?;
/// let plant = plant.compile()?;
/// let region = Region::new(Dims::new(1, 1), vec![-1.0, -1.0], vec![2.0, 1.0]);
/// let found = Survey::run(&plant, &region, 0.15, 1).irregularities;
/// assert_eq!((found.len(), found[0].kind), (1, IrregularityKind::Kink));
/// assert!(found[0].sides[0].x[0].abs() < 1e-5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Survey {
    /// The irregularities: one at most for each kind, rate and variable, inside the box where there
    /// is one.
    pub irregularities: Vec<Irregularity>,
    /// The median size of each rate at random points of the box.
    pub usual_rates: Vec<f64>,
    /// The largest size of each rate there.
    pub largest_rates: Vec<f64>,
}

impl Survey {
    /// Looks at `plant` in `region` and `margin` of its widths beyond.
    #[must_use]
    pub fn run(plant: &dyn DynRhs, region: &Region, margin: f64, seed: u64) -> Self {
        let (usual_rates, largest_rates) = rates(plant, region, seed);
        let mut survey = Self { irregularities: Vec::new(), usual_rates, largest_rates };
        let variables = region.low.len();
        let lines = (LINES / variables).max(LEAST_LINES);
        let wide = region.enlarged(margin);
        let mut points = region.points(seed);
        for variable in 0..variables {
            let through = std::iter::once(region.centre()).chain(points.by_ref());
            for through in through.take(lines) {
                let line = Line { plant, region, wide: &wide, through: through.joined(), variable };
                survey.look_along(&line);
            }
        }
        survey
    }

    fn look_along(&mut self, line: &Line<'_>) {
        let places: Vec<f64> = (0..=INTERVALS).map(|k| line.place(k)).collect();
        let values: Vec<Vec<f64>> = places.iter().map(|&s| line.rates(s)).collect();
        let slopes: Vec<Vec<f64>> = places.iter().map(|&s| line.slopes(s)).collect();
        let width = line.region.width(line.variable);
        for state in 0..line.region.dims.nx {
            let usual = self.usual_rates[state];
            let of = |rows: &[Vec<f64>]| rows.iter().map(|row| row[state]).collect::<Vec<_>>();
            let (value, slope) = (of(&values), of(&slopes));
            if let Some([a, b]) = line.undefined(state, &places, &value) {
                self.add(line, IrregularityKind::Undefined, state, [a, b]);
                continue;
            }
            if usual <= 0.0 {
                continue;
            }
            if let Some(peak) = line.pole(state, &places, &value, HUGE * usual) {
                let step = f64::EPSILON * peak.abs().max(width);
                self.add(line, IrregularityKind::Pole, state, [peak - step, peak + step]);
                continue;
            }
            let rate = |s: f64| line.rates(s)[state];
            if let Some(sides) = jump(rate, &places, &value, MATTERS * usual) {
                let size = rate(sides[0]).abs().max(rate(sides[1]).abs());
                let is_pole = size > HUGE * usual;
                let kind = if is_pole { IrregularityKind::Pole } else { IrregularityKind::Jump };
                self.add(line, kind, state, sides);
                continue;
            }
            let rate = |s: f64| line.slopes(s)[state];
            if let Some(sides) = jump(rate, &places, &slope, MATTERS * usual / width) {
                self.add(line, IrregularityKind::Kink, state, sides);
            }
        }
    }

    fn add(&mut self, line: &Line<'_>, kind: IrregularityKind, state: usize, sides: [f64; 2]) {
        let i = line.variable;
        let is_inside = match kind {
            IrregularityKind::Jump | IrregularityKind::Kink => {
                let slack = AT_THE_END * line.region.width(i);
                let inside =
                    sides[0] > line.region.low[i] + slack && sides[1] < line.region.high[i] - slack;
                if !inside {
                    return;
                }
                inside
            }
            _ => sides[1] >= line.region.low[i] && sides[0] <= line.region.high[i],
        };
        let sides = sides.map(|s| line.point(s));
        let new = Irregularity { kind, state, variable: i, sides, is_inside };
        let alike = |old: &&mut Irregularity| {
            (old.kind, old.state, old.variable) == (kind, state, new.variable)
        };
        match self.irregularities.iter_mut().find(alike) {
            Some(old) if is_inside && !old.is_inside => *old = new,
            Some(_) => {}
            None => self.irregularities.push(new),
        }
    }
}

/// The median and the largest size of each rate.
fn rates(plant: &dyn DynRhs, region: &Region, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let points = region.points(seed).take(POINTS);
    let rates: Vec<Vec<f64>> = points.map(|p| rhs(plant, &p.x, &p.u)).collect();
    let of = |i: usize| {
        let sizes = rates.iter().map(|rate| rate[i].abs()).filter(|size| size.is_finite());
        let mut sizes: Vec<f64> = sizes.collect();
        sizes.sort_by(f64::total_cmp);
        let usual = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
        (usual, sizes.last().copied().unwrap_or(0.0))
    };
    (0..region.dims.nx).map(of).unzip()
}

/// A line through the box, along one variable and a little beyond.
struct Line<'a> {
    plant: &'a dyn DynRhs,
    region: &'a Region,
    wide: &'a Region,
    through: Vec<f64>,
    variable: usize,
}

impl Line<'_> {
    fn place(&self, k: u32) -> f64 {
        let (low, high) = (self.wide.low[self.variable], self.wide.high[self.variable]);
        low + (high - low) * f64::from(k) / f64::from(INTERVALS)
    }

    fn point(&self, s: f64) -> OperatingPoint {
        let mut values = self.through.clone();
        values[self.variable] = s;
        self.region.split(values)
    }

    fn rates(&self, s: f64) -> Vec<f64> {
        let point = self.point(s);
        rhs(self.plant, &point.x, &point.u)
    }

    /// The derivatives of the rates along the line.
    fn slopes(&self, s: f64) -> Vec<f64> {
        let jacobian = jacobian(self.plant, &self.point(s));
        jacobian.col(self.variable).iter().copied().collect()
    }

    /// Where a rate ceases to be finite.
    fn undefined(&self, state: usize, places: &[f64], value: &[f64]) -> Option<[f64; 2]> {
        let is_edge = |pair: &[f64]| pair[0].is_finite() != pair[1].is_finite();
        let k = value.windows(2).position(is_edge)?;
        let (mut a, mut b) = (places[k], places[k + 1]);
        for _ in 0..2 * HALVINGS {
            let middle = f64::midpoint(a, b);
            if self.rates(middle)[state].is_finite() == value[k].is_finite() {
                a = middle;
            } else {
                b = middle;
            }
        }
        Some([a, b])
    }

    /// Where a rate is larger than `huge`: it must be larger than what is two places away on either
    /// side, so that a peak can be between.
    fn pole(&self, state: usize, places: &[f64], value: &[f64], huge: f64) -> Option<f64> {
        let size = |s: f64| self.rates(s)[state].abs();
        (2..places.len() - 2).find_map(|k| {
            let beside = value[k - 2].abs().max(value[k + 2].abs());
            if value[k].abs() <= 1.5 * beside {
                return None;
            }
            let peak = highest(&size, places[k - 1], places[k + 1]);
            (size(peak) > huge || !size(peak).is_finite()).then_some(peak)
        })
    }
}

/// A local maximum of a function between `a` and `b`, by golden sections.
fn highest(f: &impl Fn(f64) -> f64, mut a: f64, mut b: f64) -> f64 {
    let ratio = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut left, mut right) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut at_left, mut at_right) = (f(left), f(right));
    for _ in 0..PEAK_STEPS {
        if !at_left.is_finite() {
            return left;
        }
        if at_left > at_right {
            (b, right, at_right) = (right, left, at_left);
            left = b - ratio * (b - a);
            at_left = f(left);
        } else {
            (a, left, at_left) = (left, right, at_right);
            right = a + ratio * (b - a);
            at_right = f(right);
        }
    }
    left
}

/// The sides of a jump of more than `matters`, if the largest change between neighbouring places
/// stays however close they are.
fn jump(f: impl Fn(f64) -> f64, places: &[f64], values: &[f64], matters: f64) -> Option<[f64; 2]> {
    let changes = values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
    let (k, change) = changes.enumerate().max_by(|one, other| one.1.total_cmp(&other.1))?;
    if change <= matters || !change.is_finite() {
        return None;
    }
    let (mut a, mut b) = (places[k], places[k + 1]);
    let (mut at_a, mut at_b) = (values[k], values[k + 1]);
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(a, b);
        let at_middle = f(middle);
        if (at_middle - at_a).abs() > (at_b - at_middle).abs() {
            (b, at_b) = (middle, at_middle);
        } else {
            (a, at_a) = (middle, at_middle);
        }
    }
    let left = (at_b - at_a).abs();
    (left > matters && left > 0.3 * change).then_some([a, b])
}
