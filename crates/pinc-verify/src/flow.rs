//! The flow of an equation over boxes: a polynomial, and a proven bound of its error.

use crate::basis::Basis;
use crate::equation::Equation;
use crate::growth::Growth;
use crate::interval::Interval;
use crate::kernel::{LANES, Lanes, lanes, memory, norm};
use crate::rounding::{UNIT, to_f64, up};
use crate::taylor::{Arithmetic, Taylor};
use pinc_ad::simd::Isa;
use std::cell::LazyCell;

/// The flow of an equation over `sample_time_s`.
///
/// In each of some steps p(t) is a polynomial of the time with coefficients that are polynomials of
/// the variables, found by as many Picard iterations as there are powers of the time. Nothing in
/// this has to be exact. Then f(p) is enclosed, and with it the defect p' - f(p). As long as the
/// true solution stays in a tube around p, |z - p| grows at most as [`Growth`] says of the Jacobians
/// in the tube and the integral of the defect; if that stays strictly inside the tube, the solution
/// never leaves it, so that the bound holds to the end of the step.
#[derive(Clone, Debug)]
pub(crate) struct Flow {
    pub(crate) equation: Equation,
    pub(crate) sample_time_s: f64,
}

/// The arithmetic of a flow: in space alone, with the powers of the time up to 0, 1, .., and with all
/// of them.
#[derive(Clone, Debug)]
pub(crate) struct FlowArithmetic {
    pub(crate) space: Arithmetic,
    sweeps: Vec<Arithmetic>,
    full: Arithmetic,
    isa: Isa,
}

/// How many tubes are tried, each four times as wide as what the one before led to.
const TUBES: usize = 4;

impl FlowArithmetic {
    /// In the variables of `space`, with powers of the time up to `order`.
    ///
    /// All powers use the same fits of functions, because the coefficients of a lower fit differ from
    /// Taylor's series.
    pub(crate) fn new(space: Basis, order: usize, isa: Isa) -> Self {
        let (full, degree) = (space.with_time(order), space.degree());
        let fit = if degree == 0 { order } else { degree.max(order.min(degree + 3)) };
        let sweep = |k| Arithmetic::new(full.up_to_order(k), fit, isa).without_remainders();
        let sweeps = (0..order).map(sweep).collect();
        let full = Arithmetic::new(full, fit, isa);
        Self { sweeps, full, space: Arithmetic::new(space, degree, isa), isa }
    }
}

/// A step's polynomials, and the integral of their defects.
struct Step {
    path: Vec<Taylor>,
    defect: Vec<Lanes>,
}

impl Flow {
    /// The states at the end from those at the beginning, in `steps` steps, a power of 2; inputs and
    /// parameters are `held`.
    pub(crate) fn run(
        &self,
        over: &FlowArithmetic,
        start: &[Taylor],
        held: &[Taylor],
        steps: usize,
    ) -> Vec<Taylor> {
        // A power of 2 divides exactly.
        let h = self.sample_time_s / to_f64(steps);
        let mut states = start.to_vec();
        let mut errors: Vec<Lanes> = start.iter().map(|x| x.remainder).collect();
        for _ in 0..steps {
            let step = self.step(over, &states, held, h);
            let grown = self.propagate(&over.full, &step, held, h, &errors);
            for (i, path) in step.path.iter().enumerate() {
                let (end, rounding) = at_the_end(over, path);
                // Both have room for the rounding of their sum.
                errors[i] = lanes(|lane| grown[i][lane] + rounding[lane]);
                states[i].coefficients = end;
            }
        }
        for (state, error) in states.iter_mut().zip(errors) {
            state.remainder = error.map(crate::taylor::unless_nan);
        }
        states
    }

    /// A polynomial near the flow over `h` seconds from `start`, in the time divided by h.
    fn step(&self, over: &FlowArithmetic, start: &[Taylor], held: &[Taylor], h: f64) -> Step {
        let (n, full) = (start.len(), &over.full);
        let polynomial = |of: &Taylor| full.resize(of).with_remainder([0.0; LANES]);
        let mut path: Vec<Taylor> = start.iter().map(polynomial).collect();
        let basis = &full.basis;
        for k in 1..basis.orders() {
            let rates = self.rates(&over.sweeps[k - 1], &path, held);
            for (path, rate) in path.iter_mut().zip(&rates) {
                let from = &rate.coefficients[basis.of_order(k - 1)];
                for (to, from) in path.coefficients[basis.of_order(k)].iter_mut().zip(from) {
                    *to = from.map(|rate| rate * h / to_f64(k));
                }
            }
        }
        let rates = self.rates(full, &path, held);
        let defect = (0..n).map(|i| defect(full, &path[i], &rates[i], h)).collect();
        Step { path, defect }
    }

    /// f along polynomials, with the powers of the time of `over`.
    fn rates(&self, over: &Arithmetic, path: &[Taylor], held: &[Taylor]) -> Vec<Taylor> {
        let variables: Vec<Taylor> =
            path.iter().chain(held).map(|variable| over.resize(variable)).collect();
        self.equation.evaluate(over, &variables)
    }

    /// Bounds of the errors at the end of a step with these bounds at its beginning.
    fn propagate(
        &self,
        over: &Arithmetic,
        step: &Step,
        held: &[Taylor],
        h: f64,
        errors: &[Lanes],
    ) -> Vec<Lanes> {
        let n = step.path.len();
        let states: Vec<Vec<Interval>> = step.path.iter().map(Taylor::ranges).collect();
        let narrow = LazyCell::new(|| -> Vec<Vec<Interval>> {
            step.path.iter().map(|path| over.ranges_in_time(path)).collect()
        });
        let held: Vec<Vec<Interval>> = held.iter().map(Taylor::ranges).collect();
        let mut grown = vec![[f64::INFINITY; LANES]; n];
        for lane in 0..LANES {
            let of = |all: &[Lanes]| -> Vec<f64> { all.iter().map(|one| one[lane]).collect() };
            let at = |all: &[Vec<Interval>]| -> Vec<Interval> {
                all.iter().map(|one| one[lane]).collect()
            };
            let tube = |states: &[Vec<Interval>]| {
                self.in_a_tube(&[at(states), at(&held)], h, &of(errors), &of(&step.defect))
            };
            // Near a kink a narrower range may be on one side of it.
            let ends = tube(&states).or_else(|| tube(&narrow));
            for (grown, end) in grown.iter_mut().zip(ends.into_iter().flatten()) {
                grown[lane] = end;
            }
        }
        grown
    }

    /// Bounds of the errors at the end of a step in one box, from ranges of the states' polynomials
    /// and of what is held; none if the solution is not known to stay near.
    pub(crate) fn in_a_tube(
        &self,
        [states, held]: &[Vec<Interval>; 2],
        h: f64,
        errors: &[f64],
        defect: &[f64],
    ) -> Option<Vec<f64>> {
        if !errors.iter().chain(defect).all(|bound| bound.is_finite()) {
            return None;
        }
        let least = |i: usize| 1e-14 * (states[i].magnitude() + f64::MIN_POSITIVE);
        let mut radii: Vec<f64> =
            (0..states.len()).map(|i| 2.0 * (errors[i] + defect[i]) + least(i)).collect();
        for _ in 0..TUBES {
            let tube = states.iter().zip(&radii).map(|(state, radius)| {
                let tube = *state + Interval { low: -radius, high: *radius };
                if tube.low.is_finite() && tube.high.is_finite() { tube } else { Interval::ENTIRE }
            });
            let variables: Vec<Interval> = tube.chain(held.iter().copied()).collect();
            let jacobian = self.equation.jacobian(&variables);
            let growth = Growth::new(&jacobian, states.len(), h)?;
            let [end, before] = growth.propagate(errors, defect);
            if before.iter().zip(&radii).all(|(before, radius)| before < radius) {
                return Some(end);
            }
            radii = before.iter().enumerate().map(|(i, before)| 4.0 * before + least(i)).collect();
        }
        None
    }
}

/// A bound of the integral of |h f(p) - p'| over a step, for one state.
pub(crate) fn defect(over: &Arithmetic, path: &Taylor, rate: &Taylor, h: f64) -> Lanes {
    let (basis, orders) = (&over.basis, over.basis.orders());
    let mut sum = [0.0; LANES];
    for k in 0..orders {
        let rates = &rate.coefficients[basis.of_order(k)];
        let next: &[Lanes] =
            if k + 1 < orders { &path.coefficients[basis.of_order(k + 1)] } else { &[] };
        let mut here = [0.0; LANES];
        for (place, rate) in rates.iter().enumerate() {
            let slope = next.get(place).copied().unwrap_or([0.0; LANES]);
            for lane in 0..LANES {
                let (wanted, found) = (h * rate[lane], to_f64(k + 1) * slope[lane]);
                // The products are rounded, each by u of about `found`; for what is in proportion to
                // the difference `up` has room.
                let rounding = 4.0 * UNIT * found.abs();
                here[lane] += (wanted - found).abs() + rounding;
            }
        }
        // The integral of t^k.
        sum = lanes(|lane| sum[lane] + here[lane] / to_f64(k + 1));
    }
    lanes(|lane| up(sum[lane] + h * rate.remainder[lane]))
}

/// The polynomial at the end of a step, and a bound of what rounding changes it by.
pub(crate) fn at_the_end(over: &FlowArithmetic, path: &Taylor) -> (Vec<Lanes>, Lanes) {
    let basis = &over.full.basis;
    let mut end = memory(basis.monomials());
    for k in 0..basis.orders() {
        for (end, coefficient) in end.iter_mut().zip(&path.coefficients[basis.of_order(k)]) {
            *end = lanes(|lane| end[lane] + coefficient[lane]);
        }
    }
    // Twice what the sums need has room for the rounding of the norm.
    let units = 2.0 * to_f64(basis.orders()) * UNIT;
    (end, norm(over.isa, &path.coefficients).map(|norm| units * norm))
}
