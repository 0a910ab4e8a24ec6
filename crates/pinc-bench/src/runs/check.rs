//! `pinc check`: looks at the plant and the config before anything is trained.

use crate::registry::PlantTask;
use crate::spec::{ControlSpec, Experiment};
use faer::Mat;
use pinc_ode::{Adaptive, Dims, Plant, Predictor, Rk4};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::fmt;

/// Random points of the domain at which the plant is asked.
const POINTS: usize = 1000;

/// Of these, how many the integrators are compared at.
const COMPARED: usize = 100;

/// Local error tolerance of the truth that RK4 is compared with.
const TOLERANCE: f64 = 1e-12;

/// How serious a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// A fact.
    Fact,
    /// Probably not what is wanted.
    Warning,
    /// A run cannot succeed.
    Error,
}

/// One thing found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// How serious it is.
    pub severity: Severity,
    /// What it is.
    pub text: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Fact => "      ",
            Severity::Warning => "warn  ",
            Severity::Error => "ERROR ",
        };
        write!(f, "{severity}{}", self.text)
    }
}

/// Examines the plant of a config (which is itself valid, or it would not have loaded) on the
/// training domain, or else within the controller's bounds.
#[must_use]
pub fn check(experiment: &Experiment) -> Vec<Finding> {
    experiment.plant.with(Check { experiment })
}

struct Check<'a> {
    experiment: &'a Experiment,
}

impl PlantTask for Check<'_> {
    type Output = Vec<Finding>;

    fn run<P: Plant + 'static>(self, plant: P) -> Vec<Finding> {
        let mut findings = Findings::default();
        match Region::of(self.experiment, plant.dims()) {
            None => findings.warn("no [domain] and no [control]: nothing to look at".to_owned()),
            Some(region) => {
                derivatives(&plant, &region, self.experiment.seed, &mut findings);
                if let Some(horizon_s) = self.experiment.horizon_s() {
                    linearisation(&plant, &region, horizon_s, &mut findings);
                    substeps(&plant, &region, horizon_s, self.experiment.seed, &mut findings);
                }
            }
        }
        if let Some(control) = &self.experiment.control {
            closed_loop(self.experiment, control, &plant, &mut findings);
        }
        findings.0
    }
}

#[derive(Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn add(&mut self, severity: Severity, text: String) {
        self.0.push(Finding { severity, text });
    }

    fn fact(&mut self, text: String) {
        self.add(Severity::Fact, text);
    }

    fn warn(&mut self, text: String) {
        self.add(Severity::Warning, text);
    }
}

/// The box of states and inputs that is examined.
struct Region {
    name: &'static str,
    dims: Dims,
    /// States, then inputs.
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Region {
    fn of(experiment: &Experiment, dims: Dims) -> Option<Self> {
        let join = |a: &[f64], b: &[f64]| [a, b].concat();
        if let Some(domain) = &experiment.domain {
            let low = join(&domain.state_low, &domain.input_low);
            let high = join(&domain.state_high, &domain.input_high);
            return Some(Self { name: "the training domain", dims, low, high });
        }
        let control = experiment.control.as_ref()?;
        let state_low = control.state_low.as_ref().unwrap_or(&control.initial_state);
        let state_high = control.state_high.as_ref().unwrap_or(&control.initial_state);
        let low = join(state_low, &control.input_low);
        let high = join(state_high, &control.input_high);
        Some(Self { name: "the controller's bounds", dims, low, high })
    }

    /// The state and the input in the middle.
    fn centre(&self) -> (Vec<f64>, Vec<f64>) {
        let middle = self.low.iter().zip(&self.high).map(|(a, b)| f64::midpoint(*a, *b));
        let mut x: Vec<_> = middle.collect();
        let u = x.split_off(self.dims.states);
        (x, u)
    }

    /// Random points.
    fn points(&self, seed: u64) -> impl Iterator<Item = (Vec<f64>, Vec<f64>)> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        std::iter::repeat_with(move || {
            let ends = self.low.iter().zip(&self.high);
            let mut x: Vec<f64> =
                ends.map(|(low, high)| low + (high - low) * rng.random::<f64>()).collect();
            let u = x.split_off(self.dims.states);
            (x, u)
        })
    }
}

fn derivatives<P: Plant>(plant: &P, region: &Region, seed: u64, findings: &mut Findings) {
    let mut dx = vec![0.0; plant.dims().states];
    let mut fastest = vec![0.0f64; plant.dims().states];
    for (x, u) in region.points(seed).take(POINTS) {
        plant.rhs(&x, &u, &mut dx);
        if let Some(i) = dx.iter().position(|v| !v.is_finite()) {
            let state = &plant.states()[i].name;
            let text = format!("the derivative of {state} is {} at x = {x:?}, u = {u:?}", dx[i]);
            return findings.add(Severity::Error, text);
        }
        for (fastest, v) in fastest.iter_mut().zip(&dx) {
            *fastest = fastest.max(v.abs());
        }
    }
    let names = plant.states().iter().zip(&fastest);
    let rates: Vec<_> = names.map(|(v, f)| format!("|{}'| <= {f:.3}", v.name)).collect();
    findings.fact(format!(
        "derivatives are finite at {POINTS} random points of {}; there {}",
        region.name,
        rates.join(", ")
    ));
}

/// The Jacobian df/dx, as a matrix.
fn jacobian<P: Plant>(plant: &P, x: &[f64], u: &[f64]) -> Mat<f64> {
    let n = x.len();
    let j = pinc_ad::jacobian(
        |x, dx| {
            let u: Vec<_> = u.iter().map(|&v| pinc_ad::Dual::lift(v)).collect();
            plant.rhs(x, &u, dx);
        },
        x,
        n,
    );
    Mat::from_fn(n, n, |row, column| j[row * n + column])
}

/// A steady state for the input `u`, by Newton's method from `x`, if that leads to one in the region.
fn steady_state<P: Plant>(plant: &P, region: &Region, x: &[f64], u: &[f64]) -> Option<Vec<f64>> {
    use faer::linalg::solvers::Solve;
    let n = x.len();
    let mut x = x.to_vec();
    let mut dx = vec![0.0; n];
    for _ in 0..50 {
        plant.rhs(&x, u, &mut dx);
        let step = jacobian(plant, &x, u).partial_piv_lu().solve(Mat::from_fn(n, 1, |i, _| dx[i]));
        let mut largest = 0.0f64;
        for (i, x) in x.iter_mut().enumerate() {
            // Half a step at most of the region's width, so as not to leave where f is defined.
            let width = region.high[i] - region.low[i];
            let step = step[(i, 0)].clamp(-width / 2.0, width / 2.0);
            *x = (*x - step).clamp(region.low[i], region.high[i]);
            largest = largest.max((step / width).abs());
        }
        if largest < 1e-10 {
            plant.rhs(&x, u, &mut dx);
            let at_rest = dx.iter().zip(&x).all(|(v, x)| v.abs() < 1e-8 * (1.0 + x.abs()));
            return at_rest.then_some(x);
        }
    }
    None
}

fn linearisation<P: Plant>(plant: &P, region: &Region, horizon_s: f64, findings: &mut Findings) {
    let (centre, u) = region.centre();
    let (place, x) = match steady_state(plant, region, &centre, &u) {
        Some(x) => ("the steady state", x),
        None => ("the centre", centre),
    };
    let Ok(eigenvalues) = jacobian(plant, &x, &u).eigenvalues() else {
        return findings.warn(format!("no eigenvalues at {place} x = {}", list(&x)));
    };
    let mut modes = Vec::new();
    for value in &eigenvalues {
        let frequency =
            if value.im.abs() > 0.0 { format!(" {:+.4}i", value.im) } else { String::new() };
        let kind = if value.re < 0.0 { "time constant" } else { "doubles in" };
        let time = if value.re < 0.0 { -1.0 / value.re } else { std::f64::consts::LN_2 / value.re };
        modes.push(format!("{:.4}{frequency} 1/s ({kind} {time:.3} s)", value.re));
    }
    let (x, u) = (list(&x), list(&u));
    findings.fact(format!("linearised at {place} x = {x}, u = {u}: {}", modes.join("; ")));

    let fastest = eigenvalues.iter().map(|v| v.re.hypot(v.im)).fold(0.0, f64::max);
    let text = format!(
        "T = {horizon_s} s against the fastest mode there: |lambda| T = {:.3}",
        fastest * horizon_s
    );
    // An explicit Runge-Kutta method of order 4 is stable up to about 2.8 per substep.
    if fastest * horizon_s > 10.0 {
        findings.warn(format!("{text}: stiff for a step of this length"))
    } else {
        findings.fact(text)
    }
}

fn substeps<P: Plant>(
    plant: &P,
    region: &Region,
    horizon_s: f64,
    seed: u64,
    findings: &mut Findings,
) {
    let mut truth = Adaptive::new(plant.clone(), TOLERANCE);
    let mut samples = Vec::new();
    for (x, u) in region.points(seed).take(COMPARED) {
        let mut end = x.clone();
        if truth.integrate(&mut end, &u, horizon_s).is_ok() {
            samples.push((x, u, end));
        }
    }
    if samples.len() < COMPARED {
        let missing = COMPARED - samples.len();
        findings.warn(format!(
            "the plant breaks off within T from {missing} of {COMPARED} random points"
        ));
    }
    let mut next = vec![0.0; plant.dims().states];
    let mut errors = Vec::new();
    for substeps in [1, 2, 4, 8, 16] {
        let mut model = Rk4::new(plant.clone(), horizon_s, substeps);
        let mut predicted = Vec::new();
        for (x, u, _) in &samples {
            model.predict(x, u, &mut next);
            predicted.extend_from_slice(&next);
        }
        let truth: Vec<f64> = samples.iter().flat_map(|(_, _, end)| end).copied().collect();
        let one = vec![1.0; next.len()];
        let rms = pinc_ode::metrics::mean_squared_error(&predicted, &truth, &one).sqrt();
        errors.push(format!("{substeps}: {rms:.1e}"));
    }
    findings.fact(format!("rms error of one step of RK4 by substeps: {}", errors.join(", ")));
}

/// Whether start, references and bounds fit together and lie in the training domain.
fn closed_loop<P: Plant>(
    experiment: &Experiment,
    control: &ControlSpec,
    plant: &P,
    findings: &mut Findings,
) {
    let before = findings.0.len();
    let names: Vec<_> = plant.states().iter().map(|v| v.name.as_ref()).collect();
    let bound = |side: &Option<Vec<f64>>, i: usize, none: f64| side.as_ref().map_or(none, |s| s[i]);
    let ends = |i: usize| {
        let low = bound(&control.state_low, i, f64::NEG_INFINITY);
        (low, bound(&control.state_high, i, f64::INFINITY))
    };
    for (i, value) in control.initial_state.iter().enumerate() {
        if outside(*value, ends(i)) {
            findings.warn(format!(
                "control.initial_state: {} = {value} is outside its bounds",
                names[i]
            ));
        }
    }
    for (k, reference) in control.references.iter().enumerate() {
        for (name, value) in control.controlled.iter().zip(&reference.value) {
            let place = names.iter().position(|n| n == name);
            if place.is_some_and(|i| outside(*value, ends(i))) {
                findings.warn(format!(
                    "control.references[{k}]: {name} = {value} is outside its bounds"
                ));
            }
        }
    }
    if let Some(domain) = &experiment.domain {
        for (i, name) in names.iter().enumerate() {
            let (low, high) = ends(i);
            if low < domain.state_low[i] || high > domain.state_high[i] {
                findings.warn(format!(
                    "the bounds of {name} reach outside the training domain, where a net is wrong"
                ));
            }
        }
        for (i, input) in plant.inputs().iter().enumerate() {
            let (low, high) = (domain.input_low[i], domain.input_high[i]);
            if control.input_low[i] < low || control.input_high[i] > high {
                findings.warn(format!(
                    "the bounds of {} reach outside the training domain, where a net is wrong",
                    input.name
                ));
            }
        }
    }
    if findings.0.len() == before {
        findings.fact(
            "start and references are within the bounds, and these within the domain".to_owned(),
        );
    }
}

fn outside(value: f64, (low, high): (f64, f64)) -> bool {
    value < low || value > high
}

/// Numbers as a reader needs them.
fn list(values: &[f64]) -> String {
    let values: Vec<_> = values.iter().map(|v| format!("{v:.4}")).collect();
    format!("({})", values.join(", "))
}
