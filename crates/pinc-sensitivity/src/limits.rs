//! The effect of limits on a plan that moves: the active set, or its smoothed form.

use pinc_qp::{Limits, Qp};

/// A smoothed plan is found when a step moves it by this part of its size.
const SMOOTH_ENOUGH: f64 = 1e-10;

/// How a row's value and its multiplier move together:
///
/// ```text
/// a'dz - compliance dmu = high dhigh + low dlow + penalty dpenalty
/// ```
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limit {
    /// 0 where the row is active, infinite where it is not.
    pub(crate) compliance: f64,
    pub(crate) high: f64,
    pub(crate) low: f64,
    pub(crate) penalty: f64,
    /// The sign of a multiplier that is the weight of a violation; 0 elsewhere.
    pub(crate) saturated: f64,
}

impl Limit {
    pub(crate) const INACTIVE: Self =
        Self { compliance: f64::INFINITY, high: 0.0, low: 0.0, penalty: 0.0, saturated: 0.0 };
    const AT_HIGH: Self = Self { compliance: 0.0, high: 1.0, ..Self::INACTIVE };
    const AT_LOW: Self = Self { compliance: 0.0, low: 1.0, ..Self::INACTIVE };

    /// How a row of a solution moves, whose value is 0 seen from its limits; and which side of it
    /// is about to become active or inactive, if both its room and what its multiplier lacks of
    /// its own limits are below `margin`.
    pub(crate) fn of([low, high, penalty]: [f64; 3], mu: f64, margin: f64) -> (Self, Option<bool>) {
        let upper = mu > 0.0 || mu == 0.0 && high < -low;
        let at = if upper { Self::AT_HIGH } else { Self::AT_LOW };
        let room = if upper { high } else { -low };
        let lacking = penalty - mu.abs();
        // A multiplier is large, a row is far from its limit, or it is beyond it.
        let (limit, clear) = if lacking < mu.abs() && -room > lacking {
            let saturated = if upper { 1.0 } else { -1.0 };
            (Self { saturated, ..Self::INACTIVE }, -room)
        } else if high <= low {
            (at, lacking)
        } else if mu.abs() > room {
            (at, mu.abs().min(lacking))
        } else {
            (Self::INACTIVE, room)
        };
        (limit, (clear < margin).then_some(upper))
    }
}

/// The smoothed rows of a plan.
#[derive(Debug)]
pub(crate) struct Smoothed {
    tau: f64,
    /// The units of the rows, in which their values are ordinary numbers, and that of the cost.
    units: Vec<f64>,
    cost: f64,
    /// The lower and the upper side of bounds, increments and rows.
    sides: Vec<[Side; 2]>,
}

/// One side of a row: s = room + violation, with
///
/// ```text
/// mu s = tau,  (penalty - mu) violation = tau,  all positive
/// ```
///
/// the second if the row is soft. Both are written with the function of Chen, Harker, Kanzow and
/// Smale, a + b - sqrt((a - b)^2 + 4 tau), which needs no start from inside.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Side {
    mu: f64,
    violation: f64,
}

/// A side, linearized, for an upper limit:
///
/// ```text
/// dmu = stiffness (a'dz - dlimit) - rest + by_penalty dpenalty
/// dviolation = slope dmu - offset
/// ```
#[derive(Clone, Copy, Debug, Default)]
struct Linear {
    stiffness: f64,
    rest: f64,
    by_penalty: f64,
    slope: f64,
    offset: f64,
}

/// In which numbers the conditions of a row are written, so that Newton's steps do not depend on its unit.
#[derive(Clone, Copy, Debug)]
struct Scale {
    tau: f64,
    unit: f64,
    cost: f64,
}

impl Scale {
    /// The condition multiplier times distance = tau, with its derivatives.
    fn complementarity(self, multiplier: f64, distance: f64) -> [f64; 3] {
        let Self { tau, unit, cost } = self;
        let per_multiplier = unit / cost;
        let [value, by_a, by_b] =
            complementarity(multiplier * per_multiplier, distance / unit, tau / cost);
        [value, by_a * per_multiplier, by_b / unit]
    }
}

/// The function of Chen, Harker, Kanzow and Smale with its derivatives.
fn complementarity(a: f64, b: f64, tau: f64) -> [f64; 3] {
    let difference = a - b;
    let root = difference.hypot(2.0 * tau.sqrt());
    // 1 - d / root without cancellation, if d is positive.
    let less = 4.0 * tau / (root * (root + difference.abs()));
    let (by_a, by_b) = if difference > 0.0 { (less, 2.0 - less) } else { (2.0 - less, less) };
    // a + b - root = (4 a b - 4 tau) / (a + b + root)
    let sum = a + b;
    let value = if sum > 0.0 { 4.0 * (a * b - tau) / (sum + root) } else { sum - root };
    [value, by_a, by_b]
}

impl Side {
    fn linearize(self, room: f64, penalty: f64, scale: Scale) -> Linear {
        if room.is_infinite() {
            return Linear::default();
        }
        let [value, by_mu, by_s] = scale.complementarity(self.mu, room + self.violation);
        if penalty.is_infinite() {
            return Linear { stiffness: by_s / by_mu, rest: value / by_mu, ..Linear::default() };
        }
        let [lack, by_lack, by_violation] =
            scale.complementarity(penalty - self.mu, self.violation);
        // dviolation = (by_lack (dmu - dpenalty) - lack) / by_violation
        let (slope, offset) = (by_lack / by_violation, lack / by_violation);
        let total = by_mu + by_s * slope;
        Linear {
            stiffness: by_s / total,
            rest: (value - by_s * offset) / total,
            by_penalty: by_s * slope / total,
            slope,
            offset,
        }
    }

    /// The residuals, squared.
    fn residual(self, room: f64, penalty: f64, scale: Scale) -> f64 {
        if room.is_infinite() {
            return 0.0;
        }
        let hard = scale.complementarity(self.mu, room + self.violation)[0].powi(2);
        match penalty.is_infinite() {
            true => hard,
            false => hard + scale.complementarity(penalty - self.mu, self.violation)[0].powi(2),
        }
    }
}

impl Smoothed {
    /// Begins at a solution with these multipliers of bounds, increments and rows, in these units.
    pub(crate) fn new(
        qp: &Qp,
        multipliers: &[f64],
        tau: f64,
        (units, cost): (Vec<f64>, f64),
    ) -> Self {
        let side = |mu: f64, room: f64, penalty: f64| Side {
            mu: mu.max(0.0),
            violation: if penalty.is_finite() { (-room).max(0.0) } else { 0.0 },
        };
        let rows = rows(qp).zip(multipliers);
        let sides = rows
            .map(|([low, high, penalty], &mu)| [side(-mu, -low, penalty), side(mu, high, penalty)]);
        Self { tau, units, cost, sides: sides.collect() }
    }

    /// How the rows move, and their right-hand sides in a step towards the smoothed solution.
    pub(crate) fn linearize(&self, qp: &Qp, multipliers: &[f64]) -> (Vec<Limit>, Vec<f64>) {
        let rows = rows(qp).zip(self.scales()).zip(&self.sides).zip(multipliers);
        rows.map(|(((row, scale), sides), &mu)| limit(row, scale, *sides, mu)).unzip()
    }

    /// The slopes of the Lagrangian by the unknowns, and the defects, in these units: unknowns have those of
    /// their bounds, which are the first rows, and defects those of the states, which are the first unknowns.
    pub(crate) fn in_units(&self, slopes: &[f64], defects: &[f64]) -> impl Iterator<Item = f64> {
        let slopes = slopes.iter().zip(&self.units).map(|(slope, unit)| slope * unit / self.cost);
        slopes.chain(defects.iter().zip(&self.units).map(|(defect, unit)| defect / unit))
    }

    /// Whether a step is small beside the plan.
    pub(crate) fn is_small(&self, z: &[f64], step: &[f64]) -> bool {
        let steps = z.iter().zip(step).zip(&self.units);
        steps.into_iter().all(|((z, step), unit)| step.abs() <= SMOOTH_ENOUGH * (unit + z.abs()))
    }

    fn scales(&self) -> impl Iterator<Item = Scale> {
        let Self { tau, cost, .. } = *self;
        self.units.iter().map(move |&unit| Scale { tau, unit, cost })
    }

    /// The step of all sides, where the rows' values change by `moves`.
    pub(crate) fn step(&self, qp: &Qp, moves: &[f64]) -> Vec<[Side; 2]> {
        let rows = rows(qp).zip(self.scales()).zip(&self.sides).zip(moves);
        let step = |(((row, scale), sides), change): ((_, &[Side; 2]), &f64)| {
            let linear = both(row, scale, *sides);
            let [lower, upper] = [(linear[0], -change), (linear[1], *change)];
            [lower, upper].map(|(linear, change)| {
                let mu = linear.stiffness * change - linear.rest;
                Side { mu, violation: linear.slope * mu - linear.offset }
            })
        };
        rows.map(step).collect()
    }

    /// These sides, moved along a step.
    pub(crate) fn moved(&self, step: &[[Side; 2]], length: f64) -> Self {
        let along = |side: Side, step: Side| Side {
            mu: side.mu + length * step.mu,
            violation: side.violation + length * step.violation,
        };
        let sides = self.sides.iter().zip(step);
        let sides = sides.map(|(at, step)| [along(at[0], step[0]), along(at[1], step[1])]);
        Self { units: self.units.clone(), sides: sides.collect(), ..*self }
    }

    /// Writes the multipliers of inequalities.
    pub(crate) fn write(&self, qp: &Qp, multipliers: &mut [f64]) {
        for (([low, high, _], [lower, upper]), mu) in rows(qp).zip(&self.sides).zip(multipliers) {
            if high > low {
                *mu = upper.mu - lower.mu;
            }
        }
    }

    /// The squared residuals of all rows.
    pub(crate) fn residual(&self, qp: &Qp) -> f64 {
        let rows = rows(qp).zip(self.scales()).zip(&self.sides);
        let of =
            |(([low, high, penalty], scale), [lower, upper]): (([f64; 3], Scale), &[Side; 2])| {
                if high <= low {
                    return (high / scale.unit).powi(2);
                }
                lower.residual(-low, penalty, scale) + upper.residual(high, penalty, scale)
            };
        rows.map(of).sum()
    }
}

fn both([low, high, penalty]: [f64; 3], scale: Scale, sides: [Side; 2]) -> [Linear; 2] {
    let [lower, upper] = sides;
    [lower.linearize(-low, penalty, scale), upper.linearize(high, penalty, scale)]
}

/// How a row moves, and its right-hand side.
fn limit(row: [f64; 3], scale: Scale, sides: [Side; 2], mu: f64) -> (Limit, f64) {
    let [low, high, _] = row;
    if high <= low {
        let at = if mu > 0.0 { Limit::AT_HIGH } else { Limit::AT_LOW };
        return (at, high);
    }
    let [lower, upper] = both(row, scale, sides);
    let stiffness = lower.stiffness + upper.stiffness;
    if stiffness <= 0.0 {
        return (Limit::INACTIVE, 0.0);
    }
    let limit = Limit {
        compliance: 1.0 / stiffness,
        high: upper.stiffness / stiffness,
        low: lower.stiffness / stiffness,
        penalty: (lower.by_penalty - upper.by_penalty) / stiffness,
        saturated: 0.0,
    };
    (limit, (upper.rest - lower.rest) / stiffness)
}

/// Low, high and penalty of bounds, increments and rows.
pub(crate) fn rows(qp: &Qp) -> impl Iterator<Item = [f64; 3]> {
    qp.limits().into_iter().flat_map(|(_, limits): (_, &Limits)| limits.iter())
}
