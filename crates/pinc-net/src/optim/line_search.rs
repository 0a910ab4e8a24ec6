//! Step lengths along a descent direction.

use super::{Iterate, Objective, dot};
use serde::{Deserialize, Serialize};

/// How a step length is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LineSearch {
    /// Bisection to the weak Wolfe conditions with c1 = 1e-4, c2 = 0.9: Lewis and Overton,
    /// "Nonsmooth optimization via quasi-Newton methods", Math. Programming 141 (2013), Algorithm
    /// 2.6. Cheap: mostly one evaluation.
    WeakWolfe,
    /// To the (approximate) Wolfe conditions with delta = 0.1, sigma = 0.9: Hager and Zhang, "A new
    /// conjugate gradient method with guaranteed descent and an efficient line search", SIAM J.
    /// Optim. 16 (2005). What the authors' code uses; more exact, about three evaluations.
    HagerZhang,
}

/// Maximum number of evaluations of a search.
const MAX_EVALUATIONS: usize = 60;

/// A point on the line: step length, value, slope.
#[derive(Clone, Copy, Debug)]
struct LinePoint {
    step: f64,
    value: f64,
    slope: f64,
}

/// The function along the line from `start` in `direction`; the point evaluated last is kept.
struct Line<'a, O> {
    objective: &'a mut O,
    start: &'a Iterate,
    direction: &'a [f64],
    origin: LinePoint,
    last: &'a mut Iterate,
    evaluations: usize,
}

impl LineSearch {
    /// A step length from `start` along `direction`, tried first with `first_step`; on success the
    /// new point, which is the one evaluated last, is in `next`. It gives up after 60 evaluations.
    pub fn search<O: Objective>(
        self,
        objective: &mut O,
        start: &Iterate,
        direction: &[f64],
        first_step: f64,
        next: &mut Iterate,
    ) -> Option<f64> {
        let slope = dot(&start.gradient, direction);
        if slope >= 0.0 || !slope.is_finite() {
            return None;
        }
        let origin = LinePoint { step: 0.0, value: start.value, slope };
        let mut line = Line { objective, start, direction, origin, last: next, evaluations: 0 };
        match self {
            Self::WeakWolfe => line.weak_wolfe(first_step),
            Self::HagerZhang => line.hager_zhang(first_step),
        }
    }
}

impl<O: Objective> Line<'_, O> {
    /// The function at `step`; where it is not finite, the value is infinite and the slope unknown
    /// (negative, so that the search takes the point for one beyond a rise).
    fn at(&mut self, step: f64) -> LinePoint {
        self.evaluations += 1;
        let points = self.last.x.iter_mut().zip(&self.start.x).zip(self.direction);
        for ((x, &from), &d) in points {
            *x = from + step * d;
        }
        self.last.reevaluate(self.objective);
        let slope = dot(&self.last.gradient, self.direction);
        if self.last.value.is_finite() && slope.is_finite() {
            LinePoint { step, value: self.last.value, slope }
        } else {
            LinePoint { step, value: f64::INFINITY, slope: -1.0 }
        }
    }

    fn weak_wolfe(&mut self, first_step: f64) -> Option<f64> {
        const C1: f64 = 1e-4;
        const C2: f64 = 0.9;
        let LinePoint { value, slope, .. } = self.origin;
        let (mut low, mut high) = (0.0, f64::INFINITY);
        let mut step = first_step;
        while self.evaluations < MAX_EVALUATIONS {
            let trial = self.at(step);
            if trial.value > value + C1 * step * slope {
                high = step;
            } else if trial.slope < C2 * slope {
                low = step;
            } else {
                return Some(step);
            }
            step = if high.is_finite() { f64::midpoint(low, high) } else { 2.0 * low };
            if step <= low || step >= high {
                return None;
            }
        }
        None
    }

    fn hager_zhang(&mut self, first_step: f64) -> Option<f64> {
        const SHRINK: f64 = 0.66;
        let (mut a, mut b) = match self.bracket(first_step) {
            Search::Found(step) => return Some(step),
            Search::Bracket(a, b) => (a, b),
            Search::Failed => return None,
        };
        while self.evaluations < MAX_EVALUATIONS {
            let width = b.step - a.step;
            let mut next = self.secant_squared(a, b);
            if let Search::Bracket(a, b) = next
                && b.step - a.step > SHRINK * width
            {
                next = self.update(a, b, f64::midpoint(a.step, b.step));
            }
            match next {
                Search::Found(step) => return Some(step),
                Search::Bracket(left, right) if right.step > left.step => (a, b) = (left, right),
                Search::Bracket(..) | Search::Failed => return None,
            }
        }
        None
    }

    /// The Wolfe conditions, or those that replace them where rounding hides the decrease.
    fn accepts(&self, trial: LinePoint) -> bool {
        const DELTA: f64 = 0.1;
        const SIGMA: f64 = 0.9;
        let LinePoint { value, slope, .. } = self.origin;
        let curved = trial.slope >= SIGMA * slope;
        let wolfe = trial.value - value <= DELTA * trial.step * slope;
        let approximate = (2.0 * DELTA - 1.0) * slope >= trial.slope && self.is_low(trial);
        trial.value.is_finite() && curved && (wolfe || approximate)
    }

    /// Whether the value is at most the origin's, up to an error.
    fn is_low(&self, trial: LinePoint) -> bool {
        trial.value <= self.origin.value + 1e-6 * self.origin.value.abs()
    }

    /// Step B0-B3: an interval whose left end is low and falling, and whose right end rises.
    fn bracket(&mut self, first_step: f64) -> Search {
        const EXPAND: f64 = 5.0;
        let mut left = self.origin;
        let mut step = first_step;
        while self.evaluations < MAX_EVALUATIONS {
            let trial = self.at(step);
            if self.accepts(trial) {
                return Search::Found(trial.step);
            }
            if trial.slope >= 0.0 {
                return Search::Bracket(left, trial);
            }
            if !self.is_low(trial) {
                return self.bisect(self.origin, trial);
            }
            left = trial;
            step *= EXPAND;
        }
        Search::Failed
    }

    /// Step U3: the left end is low and falling; the right end falls but is high.
    fn bisect(&mut self, mut left: LinePoint, mut right: LinePoint) -> Search {
        while self.evaluations < MAX_EVALUATIONS {
            let trial = self.at(f64::midpoint(left.step, right.step));
            if self.accepts(trial) {
                return Search::Found(trial.step);
            }
            if trial.slope >= 0.0 {
                return Search::Bracket(left, trial);
            }
            if self.is_low(trial) {
                left = trial;
            } else {
                right = trial;
            }
        }
        Search::Failed
    }

    /// Steps U0-U3: a smaller interval, with the help of `step`.
    fn update(&mut self, left: LinePoint, right: LinePoint, step: f64) -> Search {
        let inside = step > left.step && step < right.step;
        if !inside {
            return Search::Bracket(left, right);
        }
        let trial = self.at(step);
        if self.accepts(trial) {
            Search::Found(trial.step)
        } else if trial.slope >= 0.0 {
            Search::Bracket(left, trial)
        } else if self.is_low(trial) {
            Search::Bracket(trial, right)
        } else {
            self.bisect(left, trial)
        }
    }

    /// Steps S1-S4: one or two secant steps.
    fn secant_squared(&mut self, left: LinePoint, right: LinePoint) -> Search {
        let step = secant(left, right);
        match self.update(left, right, step) {
            Search::Bracket(a, b) if same(b.step, step) && b.step < right.step => {
                self.update(a, b, secant(right, b))
            }
            Search::Bracket(a, b) if same(a.step, step) && a.step > left.step => {
                self.update(a, b, secant(left, a))
            }
            other => other,
        }
    }
}

/// What a part of the search came to.
#[derive(Clone, Copy, Debug)]
enum Search {
    Found(f64),
    Bracket(LinePoint, LinePoint),
    Failed,
}

/// Where the slope would be 0 if it were linear.
fn secant(a: LinePoint, b: LinePoint) -> f64 {
    (a.step * b.slope - b.step * a.slope) / (b.slope - a.slope)
}

/// Whether two steps are one number: the one was set to the other.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits()
}
