//! Bounds that a plant in a closed loop has broken.

use pinc_mpc::{BoundSchedule, Bounded, Bounds, NmpcProblem, Side, Softness};
use pinc_ode::Dims;

/// A value on its bound may be beyond it by this part of it: by rounding.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A bound that the plant has broken on the dense trace of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Violation {
    /// The quantity.
    pub of: Bounded,
    /// Which of its bounds.
    pub side: Side,
    /// The bound, in the quantity's unit.
    pub bound: f64,
    /// Whether the bound is hard.
    pub hard: bool,
    /// By how much the bound was broken at most, in the quantity's unit.
    pub amount: f64,
    /// When that was, in s from the beginning of the loop.
    pub time_s: f64,
    /// By how much it was broken at most at the ends of steps; 0 if it held there.
    pub at_steps: f64,
    /// The largest absolute value of the quantity so far, in its unit.
    pub size: f64,
}

impl Violation {
    /// The amount as a share of the quantity's size, or of the bound where that is larger.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.amount / self.size.max(self.bound.abs())
    }
}

/// The worst violation of each bound so far.
#[derive(Clone, Debug)]
pub(crate) struct Violations {
    /// Both bounds of each quantity that has one.
    all: Vec<Violation>,
    /// These bounds as they are now.
    bounds: Vec<f64>,
}

impl Violations {
    /// Nothing yet of the bounds of `problem`, whose plant has the sizes `dims`.
    pub(crate) fn new(problem: &NmpcProblem, dims: Dims) -> Self {
        let (states, outputs) = (&problem.state_softness, &problem.output_softness);
        let states = of_bounds(&problem.state_bounds, states, dims.nx, Bounded::State);
        let inputs = of_bounds(&problem.input_bounds, &Softness::Hard, dims.nu, Bounded::Input);
        let bounds = problem.output_bounds.iter();
        let outputs = bounds.flat_map(|of| of_bounds(of, outputs, dims.ny, Bounded::Output));
        let all: Vec<Violation> = states.chain(inputs).chain(outputs).collect();
        Self { bounds: all.iter().map(|violation| violation.bound).collect(), all }
    }

    /// From now on the bounds of `step` hold.
    pub(crate) fn set_bounds_at(&mut self, schedule: &BoundSchedule, step: usize) {
        for (bound, violation) in self.bounds.iter_mut().zip(&self.all) {
            let [low, high] = schedule.at(step, violation.of);
            *bound = if violation.side == Side::Low { low } else { high };
        }
    }

    /// Looks at the quantities that have a value at a point of the dense trace, which is between
    /// steps or within one.
    pub(crate) fn look(
        &mut self,
        time_s: f64,
        between_steps: bool,
        value: impl Fn(Bounded) -> Option<f64>,
    ) {
        for (violation, &bound) in self.all.iter_mut().zip(&self.bounds) {
            let Some(value) = value(violation.of) else { continue };
            violation.size = violation.size.max(value.abs());
            let amount = match violation.side {
                Side::Low => bound - value,
                Side::High => value - bound,
            };
            if amount <= ROUNDING * bound.abs() {
                continue;
            }
            if amount > violation.amount {
                (violation.amount, violation.bound, violation.time_s) = (amount, bound, time_s);
            }
            if between_steps {
                violation.at_steps = violation.at_steps.max(amount);
            }
        }
    }

    /// The bounds that were broken.
    pub(crate) fn broken(&self) -> impl Iterator<Item = &Violation> {
        self.all.iter().filter(|violation| violation.amount > 0.0)
    }
}

/// Nothing yet of the bounds on `count` quantities at the first stage.
fn of_bounds<'a>(
    bounds: &'a Bounds,
    softness: &'a Softness,
    count: usize,
    of: fn(usize) -> Bounded,
) -> impl Iterator<Item = Violation> + 'a {
    let pairs = bounds.low.iter().zip(&bounds.high).take(count).enumerate();
    let sides = pairs.flat_map(|(i, (low, high))| [(i, Side::Low, *low), (i, Side::High, *high)]);
    sides.filter(|(_, _, bound)| bound.is_finite()).map(move |(i, side, bound)| Violation {
        of: of(i),
        side,
        bound,
        hard: *softness == Softness::Hard,
        amount: 0.0,
        time_s: 0.0,
        at_steps: 0.0,
        size: 0.0,
    })
}
