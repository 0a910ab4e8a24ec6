//! Moving horizon estimation.

mod barzilai_borwein;
mod program;
mod smoother;
mod window;

use self::barzilai_borwein::BarzilaiBorwein;
use self::program::{Constants, Point, Program};
use self::window::Window;
use crate::estimator::variances;
use crate::extended::Extended;
use crate::{Correction, EstimateError, Estimator, EstimatorStatus, Tuning};
use pinc_ode::{Dims, Memory, Model};
use pinc_qp::{Multipliers, QpStatus};

/// The residual of the optimality conditions at which the iteration ends.
const TOLERANCE: f64 = 1e-8;
/// The most quadratic programs that are solved in one correction.
const ITERATIONS: usize = 50;
/// A step is taken whole if it brings the residual below this part of the least seen.
const CONTRACTION: f64 = 0.9;
/// The part of the promised decrease of the merit function that a step must bring.
const SUFFICIENT: f64 = 1e-4;
/// How often a step is halved.
const HALVINGS: usize = 20;
/// A step of this length is rounding.
const NO_STEP: f64 = 1e-13;

/// The moving horizon estimator: the states of the last N steps that explain the measurements best,
/// within bounds,
///
/// ```text
/// min  |x_0 - prior|^2_(P^-1) + sum_j |x_(j+1) - F(x_j, u_j)|^2_(Q^-1)
///      + sum_j |y_j - h(x_j)|^2_(R^-1)
/// s.t. low <= x_j <= high
/// ```
///
/// over a window that grows to N steps. What came before the window is in the arrival cost, the
/// first term: the prior is the model's step from the estimate made then (the filtering update),
/// and its covariance P is propagated as by the extended Kalman filter. On a linear model without
/// bounds this is the Kalman filter, for any N.
///
/// It is solved by Gauss-Newton sequential quadratic programming on the stages of the window
/// (multiple shooting), begun at the shifted last solution. The covariance of the estimate comes
/// from the filter, which knows no bounds.
///
/// Reference: Rao, Rawlings and Mayne, "Constrained state estimation for nonlinear discrete-time
/// systems", IEEE Trans. Autom. Control 48 (2003).
///
/// ```
/// use pinc_estimate::{Augmentation, Augmented, Estimator, EstimatorStatus, Measured, Mhe, Tuning};
/// use pinc_ode::Rk4;
/// use pinc_plants::VanDerPol;
///
/// let oscillator = Rk4::new(VanDerPol::default(), 0.5, 4);
/// let position = Augmentation::measured(Measured::states([0]));
/// let model = Augmented::new(Box::new(oscillator), position)?;
/// let tuning = Tuning {
///     initial_estimate: vec![0.0; 2],
///     initial_sd: vec![1.0; 2],
///     process_sd: vec![0.02; 2],
///     measurement_sd: vec![0.1],
///     low: vec![-3.0; 2],
///     high: vec![3.0; 2],
///     ..Tuning::default()
/// };
/// let mut estimator = Mhe::new(Box::new(model), tuning, 10)?;
/// assert_eq!(estimator.correct(&[0.93]).status, EstimatorStatus::Updated);
/// estimator.predict(&[-0.25]);
/// assert!(estimator.estimate()[1] < 0.0);
/// # Ok::<(), pinc_estimate::EstimateError>(())
/// ```
#[derive(Debug)]
pub struct Mhe {
    /// The filter whose covariances are the arrival costs.
    filter: Extended,
    tuning: Tuning,
    constants: Constants,
    window: Window,
    /// Where a step begins.
    base: Kept,
    /// The best of several solutions.
    best: Kept,
    /// Whether the window has left the first state behind.
    moved_on: bool,
    /// By the number of steps in the window.
    programs: Vec<Program>,
    step_lengths: Vec<BarzilaiBorwein>,
}

/// States and noises of a window, and the multipliers there, by the number of steps.
#[derive(Clone, Debug)]
struct Kept {
    x: Vec<f64>,
    v: Vec<f64>,
    multipliers: Vec<Multipliers>,
}

impl Kept {
    fn keep(&mut self, window: &Window, programs: &[Program]) {
        self.x.copy_from_slice(&window.x);
        self.v.copy_from_slice(&window.v);
        self.multipliers[window.steps].copy_from(&programs[window.steps].multipliers);
    }

    fn restore(&self, window: &mut Window, programs: &mut [Program]) {
        window.x.copy_from_slice(&self.x);
        window.v.copy_from_slice(&self.v);
        programs[window.steps].multipliers.copy_from(&self.multipliers[window.steps]);
    }
}

impl Mhe {
    /// The longest window in steps: memory is allocated for every length up to it.
    pub const LONGEST: usize = 200;

    /// An estimator over a window of `steps` steps, with the outputs of `model` as what is
    /// measured. Until the first prediction the input is taken to be 0, or the one given to
    /// [`Estimator::reset_input`].
    ///
    /// # Errors
    ///
    /// [`EstimateError`] if the tuning does not suit the model, or the window is not from 1 to
    /// [`Mhe::LONGEST`] steps long.
    pub fn new(model: Box<dyn Model>, tuning: Tuning, steps: usize) -> Result<Self, EstimateError> {
        let dims = model.dims();
        let filter = Extended::new(model, &tuning)?;
        if !(1..=Self::LONGEST).contains(&steps) {
            return Err(EstimateError::Window { found: steps, most: Self::LONGEST });
        }
        let constants = constants(&tuning);
        let program = |steps| Program::new(dims, steps, &constants);
        let programs: Vec<_> = (0..=steps).map(program).collect::<Result<_, _>>()?;
        let window = Window::new(dims, steps);
        let multipliers = programs.iter().map(|p| p.multipliers.clone()).collect();
        let kept = Kept { x: window.x.clone(), v: window.v.clone(), multipliers };
        let mut estimator = Self {
            filter,
            tuning,
            base: kept.clone(),
            best: kept,
            moved_on: false,
            window,
            step_lengths: programs.iter().map(|p| BarzilaiBorwein::new(p.unknowns())).collect(),
            programs,
            constants,
        };
        estimator.reset();
        Ok(estimator)
    }

    /// The size in which each entry of z is counted, `nx`: what it may be off by at first, or else
    /// in a step.
    #[must_use]
    pub fn units(tuning: &Tuning) -> Vec<f64> {
        let sizes = tuning.initial_sd.iter().zip(&tuning.process_sd);
        let unit = |(first, later): (&f64, &f64)| match (*first > 0.0, *later > 0.0) {
            (true, _) => *first,
            (false, true) => *later,
            (false, false) => 1.0,
        };
        sizes.map(unit).collect()
    }

    /// The number of steps in the window now, which grows to the full number.
    #[must_use]
    pub fn window(&self) -> usize {
        self.window.steps
    }

    /// The states of the window as they are seen now, the oldest first, `[window + 1, nx]`.
    #[must_use]
    pub fn trajectory(&self) -> &[f64] {
        &self.window.x[..(self.window.steps + 1) * self.dims().nx]
    }

    /// Drops the window except for its last state, which is less certain than the window says.
    fn begin_anew(&mut self) {
        self.window.restart(self.filter.kalman.prior());
        self.programs.iter_mut().for_each(|program| program.multipliers.clear());
        // The initial estimate is no guess of this state.
        self.moved_on = true;
    }

    fn linearize(&mut self) -> Point {
        let Self { filter, window, programs, constants, .. } = self;
        programs[window.steps].linearize(filter.model.as_mut(), window, constants)
    }

    /// Solves the problem of the window. Gives the status, the number of programs solved, and the
    /// residual at the end.
    fn optimize(&mut self, expired: &mut dyn FnMut() -> bool) -> (EstimatorStatus, usize, f64) {
        let steps = self.window.steps;
        if !self.programs[steps].begin(&self.window, &self.constants) {
            return (EstimatorStatus::IndefiniteCovariance, 0, f64::INFINITY);
        }
        self.step_lengths[steps].reset();
        let mut point = self.linearize();
        let mut least = f64::INFINITY;
        for iteration in 0..ITERATIONS {
            if point.kkt <= TOLERANCE {
                return (EstimatorStatus::Updated, iteration, point.kkt);
            }
            if !point.kkt.is_finite() {
                return (EstimatorStatus::NotFinite, iteration, point.kkt);
            }
            if expired() {
                return (EstimatorStatus::Deadline, iteration, point.kkt);
            }
            match self.programs[steps].solve(&self.window, &self.constants, expired) {
                QpStatus::Solved => {}
                QpStatus::Expired => return (EstimatorStatus::Deadline, iteration, point.kkt),
                _ => return (EstimatorStatus::QpFailed, iteration, point.kkt),
            }
            least = least.min(point.kkt);
            self.base.keep(&self.window, &self.programs);
            if self.programs[steps].length() <= NO_STEP {
                // There is no better point nearby; take the multipliers of the solution.
                let there = self.go(1.0);
                return (solved(there), iteration + 1, there.kkt);
            }
            match self.search(point, least) {
                Some(next) => point = next,
                None => return (EstimatorStatus::IterationLimit, iteration + 1, point.kkt),
            }
        }
        (solved(point), ITERATIONS, point.kkt)
    }

    /// Solves the problem of the window from its states, and, while the window grows and the
    /// solution is at a bound, from others: states at a bound are easily a local solution where
    /// little is known yet. The best one is kept.
    fn explore(&mut self, expired: &mut dyn FnMut() -> bool) -> (EstimatorStatus, usize, f64) {
        let first = self.optimize(expired);
        let steps = self.window.steps;
        let is_good = |status| status == EstimatorStatus::Updated;
        if self.moved_on || !is_good(first.0) || !self.programs[steps].is_at_bound() {
            return first;
        }
        let n = self.dims().nx;
        let (mut best, mut iterations) = (first, first.1);
        let mut least = self.programs[steps].cost();
        self.best.keep(&self.window, &self.programs);
        for i in 0..2 * n {
            let offset = if i < n { 1.0 } else { -1.0 } * self.tuning.initial_sd[i % n];
            self.roll_out(i % n, offset);
            let found = self.optimize(expired);
            iterations += found.1;
            if is_good(found.0) && self.programs[steps].cost() < least {
                least = self.programs[steps].cost();
                best = found;
                self.best.keep(&self.window, &self.programs);
            }
        }
        self.best.restore(&mut self.window, &mut self.programs);
        (best.0, iterations, best.2)
    }

    /// Fills the window with the model's states without noise, from the initial estimate with
    /// `offset` added to state `i` on.
    fn roll_out(&mut self, i: usize, offset: f64) {
        let Dims { nx: n, nu, np, .. } = self.dims();
        let Window { x, v, u, p, steps, .. } = &mut self.window;
        let u = &u[nu..];
        v.fill(0.0);
        x[..n].copy_from_slice(&self.tuning.initial_estimate);
        x[i] += offset;
        for j in 0..*steps {
            let (before, after) = x.split_at_mut((j + 1) * n);
            let before = &mut before[j * n..];
            self.tuning.clip(before);
            let (u, p) = (&u[j * nu..(j + 1) * nu], &p[j * np..(j + 1) * np]);
            self.filter.model.step(before, u, p, &mut after[..n]);
        }
        self.tuning.clip(&mut x[*steps * n..(*steps + 1) * n]);
        self.programs[*steps].multipliers.clear();
    }

    /// Goes along the solution of the program: the whole way if that is clearly the best point so
    /// far, or else as far as the merit function decreases. `None` if it does not; the window is
    /// then where it was.
    fn search(&mut self, from: Point, least: f64) -> Option<Point> {
        let steps = self.window.steps;
        let weight = self.programs[steps].penalty();
        let slope = self.programs[steps].slope(from, weight).min(0.0);
        if let Some(part) = self.step_lengths[steps].length(self.programs[steps].direction()) {
            let there = self.go(part);
            if there.kkt < CONTRACTION * least {
                return Some(self.accept(part, there));
            }
        }
        // What rounding makes of a sum of this size.
        let noise = 1e-14 * from.merit(weight).abs();
        let mut part = 1.0;
        for _ in 0..HALVINGS {
            let there = self.go(part);
            let enough = from.merit(weight) + SUFFICIENT * part * slope + noise;
            if there.kkt < CONTRACTION * least || there.merit(weight) <= enough {
                return Some(self.accept(part, there));
            }
            part *= 0.5;
        }
        self.base.restore(&mut self.window, &mut self.programs);
        None
    }
}

impl Mhe {
    /// Goes a part of the way of the program's solution.
    fn go(&mut self, part: f64) -> Point {
        let steps = self.window.steps;
        let program = &mut self.programs[steps];
        let Kept { x, v, multipliers } = &self.base;
        program.go(part, [x, v], &mut self.window, &self.constants.unit);
        program.blend(part, &multipliers[steps]);
        self.linearize()
    }

    /// Takes note of the part of the way that was gone.
    fn accept(&mut self, part: f64, there: Point) -> Point {
        let steps = self.window.steps;
        self.step_lengths[steps].remember(self.programs[steps].direction(), part);
        there
    }
}

/// How an iteration that ends at this point has ended.
fn solved(point: Point) -> EstimatorStatus {
    if point.kkt <= TOLERANCE { EstimatorStatus::Updated } else { EstimatorStatus::IterationLimit }
}

/// The numbers of the estimation problem, from the tuning.
fn constants(tuning: &Tuning) -> Constants {
    let n = tuning.process_sd.len();
    let or = |bounds: &[f64], none: f64| {
        if bounds.is_empty() { vec![none; n] } else { bounds.to_vec() }
    };
    let unit = Mhe::units(tuning);
    Constants {
        process_sd: tuning.process_sd.clone(),
        measurement_variance: variances(&tuning.measurement_sd),
        low: or(&tuning.low, f64::NEG_INFINITY),
        high: or(&tuning.high, f64::INFINITY),
        per_unit: unit.iter().map(|unit| 1.0 / unit).collect(),
        ratios: unit.iter().flat_map(|i| unit.iter().map(move |j| j / i)).collect(),
        unit,
    }
}

impl Estimator for Mhe {
    fn dims(&self) -> Dims {
        self.filter.model.dims()
    }

    fn reset(&mut self) {
        self.filter.reset(&self.tuning);
        let Tuning { initial_estimate, parameters, .. } = &self.tuning;
        self.window.reset(initial_estimate, self.filter.kalman.covariance(), parameters);
        self.programs.iter_mut().for_each(|program| program.multipliers.clear());
        self.moved_on = false;
    }

    fn reset_input(&mut self, u: &[f64]) {
        self.reset();
        self.filter.u.copy_from_slice(u);
        self.window.begin_under(u);
    }

    fn set_parameters(&mut self, p: &[f64]) {
        self.filter.p.copy_from_slice(p);
        self.window.know(p);
    }

    fn correct_within(&mut self, y: &[f64], expired: &mut dyn FnMut() -> bool) -> Correction {
        let before = self.filter.correct(self.window.last(), y);
        self.window.measure(y);
        let prior = before.status;
        if prior == EstimatorStatus::Reacquired {
            self.begin_anew();
        }
        if before.rejected > 0 {
            self.window.reject(&self.filter.innovation);
        }
        if prior.is_corrected() {
            let change = &self.filter.change;
            self.window.last_mut().iter_mut().zip(change).for_each(|(z, d)| *z += d);
        }
        let (status, iterations, kkt) = match prior {
            prior if prior.has_succeeded() => self.explore(expired),
            failed => (failed, 0, f64::INFINITY),
        };
        self.tuning.clip(self.window.last_mut());
        let status = if status == EstimatorStatus::Updated { prior } else { status };
        Correction { status, iterations, kkt, ..before }
    }

    fn predict(&mut self, u: &[f64]) -> EstimatorStatus {
        let Some(status) = self.filter.predict(self.window.last(), u) else {
            return EstimatorStatus::NotFinite;
        };
        if self.window.push(u, self.filter.next(), self.filter.kalman.covariance()) {
            self.programs[self.window.steps].shift();
            self.moved_on = true;
        }
        status
    }

    fn estimate(&self) -> &[f64] {
        self.window.last()
    }

    fn covariance(&self) -> &[f64] {
        self.filter.kalman.covariance()
    }

    fn innovation(&self) -> &[f64] {
        &self.filter.innovation
    }

    fn remember(&mut self, memory: &mut Memory<'_>) {
        self.filter.kalman.remember(memory);
        self.window.remember(memory);
        memory.numbers(&mut self.filter.u);
        memory.numbers(&mut self.filter.p);
        memory.flag(&mut self.moved_on);
        let multipliers = &mut self.programs[self.window.steps].multipliers;
        multipliers.parts_mut().into_iter().for_each(|part| memory.numbers(part));
    }
}
