//! The errors of a net against an accurate integration.

use crate::error::{check, check_count};
use crate::mlp::to_f64;
use crate::sampling::{Purpose, Sampler, rng};
use crate::{Domain, Measurements, NetError, PincNet, Scenario, TrainingTarget};
use pinc_ode::metrics::mean_squared_error;
use pinc_ode::{Dims, DynRhs, Simulator};
use rand::RngExt;
use serde::{Deserialize, Serialize};

/// The scenarios that nets are validated on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidationConfig {
    /// Number of scenarios, each from a random initial state with inputs redrawn every T.
    pub scenarios: usize,
    /// Length of a scenario in s, a whole number of T.
    pub duration_s: f64,
    /// Number of parts of a step: the error is also evaluated at the times between them.
    pub subintervals: usize,
    /// Box of the initial states, inputs and parameters.
    pub domain: Domain,
    /// Local error tolerance of the integration that is the truth.
    pub tolerance: f64,
    /// Number of points of the box for the error of one step, and as many of the training domain.
    pub one_step_points: usize,
}

/// The errors of a net.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Eq. (`mse_gen`) of the paper: self-loop, at the steps t = kT, k >= 1, in the states' units
    /// squared.
    pub mse_gen: f64,
    /// `mse_gen` with each state in standard deviations of the box.
    pub mse_gen_normalized: f64,
    /// The authors' code: self-loop, at all rows (inner times and initial rows included), each
    /// state in standard deviations of the box. The inner times are left out for a distilled net.
    pub mse_all_normalized: f64,
    /// The mean squared error of one step from random points of the box, in squared state units.
    pub one_step_mse: f64,
    /// Against held-out measurements, if there are any: the mean over measured values, each state
    /// in standard deviations of the box.
    pub measured_mse: Option<f64>,
}

impl Validation {
    /// The criterion for the best net: the error against held-out measurements of the plant itself
    /// if there are any, otherwise `mse_gen_normalized`.
    #[must_use]
    pub fn score(&self) -> f64 {
        self.measured_mse.unwrap_or(self.mse_gen_normalized)
    }
}

/// Scenarios with their true trajectories.
#[derive(Clone, Debug, PartialEq)]
pub struct ValidationSet {
    states: usize,
    steps: usize,
    subintervals: usize,
    sample_time_s: f64,
    /// Standard deviation of each state in the box.
    scale: Vec<f64>,
    scenarios: Vec<TrueTrajectory>,
    one_step: Vec<TrueTrajectory>,
    held_out: Option<Measurements>,
}

/// An initial state, an input for each step, the plant's parameters, and the accurately integrated
/// states after each part of a step.
#[derive(Clone, Debug, PartialEq)]
struct TrueTrajectory {
    initial: Vec<f64>,
    inputs: Vec<Vec<f64>>,
    parameters: Vec<f64>,
    truth: Vec<f64>,
}

impl ValidationConfig {
    /// The recommended validation: ten scenarios of this length in s (whole steps of T), from
    /// states and inputs in `domain`.
    #[must_use]
    pub fn new(duration_s: f64, domain: Domain) -> Self {
        let (scenarios, subintervals, one_step_points) = (10, 9, 4096);
        Self { scenarios, duration_s, subintervals, domain, tolerance: 1e-12, one_step_points }
    }

    /// Standard deviation of each state in the box.
    fn scale(&self, states: usize) -> Vec<f64> {
        let ends = self.domain.ends().take(states);
        ends.map(|(low, high)| (high - low) / 12.0_f64.sqrt()).collect()
    }

    fn validate(&self, dims: Dims, sample_time_s: f64) -> Result<usize, NetError> {
        self.domain.validate(dims)?;
        for (key, value) in [
            ("scenarios", self.scenarios),
            ("subintervals", self.subintervals),
            ("one_step_points", self.one_step_points),
        ] {
            check_count(key, value)?;
        }
        let tolerance = self.tolerance;
        let is_good = tolerance > 0.0 && tolerance < 1.0;
        check(is_good, "tolerance", tolerance, "a number between 0 and 1")?;
        let steps = (self.duration_s / sample_time_s).round();
        let is_whole = (1.0..1e9).contains(&steps)
            && (steps * sample_time_s - self.duration_s).abs() <= 1e-9 * self.duration_s;
        check(is_whole, "duration_s", self.duration_s, "whole steps of horizon_s")?;
        #[expect(clippy::cast_possible_truncation, reason = "a whole number in range, see above")]
        Ok(steps as usize)
    }
}

impl ValidationSet {
    /// Draws the scenarios from `seed` and integrates them.
    ///
    /// # Errors
    ///
    /// [`NetError`] if a setting makes no sense or the plant cannot be integrated.
    pub fn generate(
        plant: &dyn DynRhs,
        sample_time_s: f64,
        config: &ValidationConfig,
        seed: u64,
    ) -> Result<Self, NetError> {
        let purposes = [Purpose::Validation, Purpose::OneStep];
        Self::draw(plant, sample_time_s, config, seed, purposes)
    }

    /// Other scenarios of the same kind, independent of [`ValidationSet::generate`]: errors on the
    /// scenarios that chose a net are too small.
    ///
    /// # Errors
    ///
    /// As [`ValidationSet::generate`].
    pub fn generate_test(
        plant: &dyn DynRhs,
        sample_time_s: f64,
        config: &ValidationConfig,
        seed: u64,
    ) -> Result<Self, NetError> {
        let purposes = [Purpose::Test, Purpose::TestOneStep];
        Self::draw(plant, sample_time_s, config, seed, purposes)
    }

    fn draw(
        plant: &dyn DynRhs,
        sample_time_s: f64,
        config: &ValidationConfig,
        seed: u64,
        [scenarios_from, one_step_from]: [Purpose; 2],
    ) -> Result<Self, NetError> {
        let domain = config.domain.in_order_of(plant)?;
        let config = &ValidationConfig { domain, ..config.clone() };
        let steps = config.validate(plant.dims(), sample_time_s)?;
        let mut integrator = Simulator::new(plant, config.tolerance);
        let Dims { nx: states, nu, .. } = integrator.dims();
        let ends: Vec<_> = config.domain.ends().collect();
        let mut random = rng(seed, scenarios_from);
        let mut uniform = |(low, high): (f64, f64)| low + (high - low) * random.random::<f64>();
        let mut scenarios = Vec::with_capacity(config.scenarios);
        for _ in 0..config.scenarios {
            let initial: Vec<f64> = ends[..states].iter().map(|&e| uniform(e)).collect();
            let mut draw = |ends: &[(f64, f64)]| ends.iter().map(|&e| uniform(e)).collect();
            let inputs = (0..steps).map(|_| draw(&ends[states..states + nu])).collect();
            let parameters = draw(&ends[states + nu..]);
            let held = Held { inputs, parameters };
            let parts = config.subintervals;
            scenarios.push(integrate(&mut integrator, initial, held, sample_time_s, parts)?);
        }
        let count = config.one_step_points;
        let points =
            Sampler::Sobol.sample(count, sample_time_s, &config.domain, 1, seed, one_step_from);
        let one_step = (0..count)
            .map(|i| {
                let inputs = vec![points.input(i).to_vec()];
                let held = Held { inputs, parameters: points.parameters(i).to_vec() };
                integrate(&mut integrator, points.state(i).to_vec(), held, sample_time_s, 1)
            })
            .collect::<Result<_, _>>()?;
        Ok(Self::of(config, (sample_time_s, steps), states, [scenarios, one_step]))
    }

    /// The one scenario of a conventional PINN, over one T.
    ///
    /// # Errors
    ///
    /// [`NetError`] if a setting makes no sense or the plant cannot be integrated.
    pub fn of_scenario(
        plant: &dyn DynRhs,
        sample_time_s: f64,
        config: &ValidationConfig,
        scenario: &Scenario,
    ) -> Result<Self, NetError> {
        config.validate(plant.dims(), sample_time_s)?;
        let states = plant.dims().nx;
        let mut integrator = Simulator::new(plant, config.tolerance);
        let mut trial = |parts| {
            let held = Held { inputs: vec![scenario.input.clone()], parameters: Vec::new() };
            let initial = scenario.initial_state.clone();
            integrate(&mut integrator, initial, held, sample_time_s, parts)
        };
        let trials = [vec![trial(config.subintervals)?], vec![trial(1)?]];
        Ok(Self::of(config, (sample_time_s, 1), states, trials))
    }

    fn of(
        config: &ValidationConfig,
        (sample_time_s, steps): (f64, usize),
        states: usize,
        [scenarios, one_step]: [Vec<TrueTrajectory>; 2],
    ) -> Self {
        let (subintervals, scale) = (config.subintervals, config.scale(states));
        let held_out = None;
        Self { states, steps, subintervals, sample_time_s, scale, scenarios, one_step, held_out }
    }

    /// Adds held-out measurements.
    #[must_use]
    pub fn with_measurements(self, held_out: Measurements) -> Self {
        Self { held_out: Some(held_out), ..self }
    }

    /// The errors of `net`.
    #[must_use]
    pub fn evaluate(&self, net: &PincNet) -> Validation {
        let states = self.states;
        let mut rows = Comparison::default();
        let mut marks = Comparison::default();
        for scenario in &self.scenarios {
            let mut start = scenario.initial.clone();
            // Row 0 is the net's own y(0).
            let p = &scenario.parameters;
            let first = net.evaluate(0.0, &start, &scenario.inputs[0], p);
            rows.push(&first, &start);
            for (k, input) in scenario.inputs.iter().enumerate() {
                // A distilled net is meaningful at the end of a step only.
                let first =
                    if net.source() == TrainingTarget::Integrator { self.subintervals } else { 1 };
                for part in first..=self.subintervals {
                    let t = self.sample_time_s * to_f64(part) / to_f64(self.subintervals);
                    let y = net.evaluate(t, &start, input, p);
                    let row = k * self.subintervals + part - 1;
                    let truth = &scenario.truth[row * states..(row + 1) * states];
                    rows.push(&y, truth);
                    if part == self.subintervals {
                        marks.push(&y, truth);
                        start = y;
                    }
                }
            }
        }
        let mut single = Comparison::default();
        for trial in &self.one_step {
            let TrueTrajectory { initial, inputs, parameters, .. } = trial;
            let y = net.evaluate(self.sample_time_s, initial, &inputs[0], parameters);
            single.push(&y, &trial.truth);
        }
        let units = vec![1.0; states];
        Validation {
            mse_gen: marks.error(&units),
            mse_gen_normalized: marks.error(&self.scale),
            mse_all_normalized: rows.error(&self.scale),
            one_step_mse: single.error(&units),
            measured_mse: self.held_out.as_ref().map(|held_out| self.measured_error(net, held_out)),
        }
    }

    fn measured_error(&self, net: &PincNet, held_out: &Measurements) -> f64 {
        let points = held_out.points();
        let (mut predicted, mut truth) = (Vec::new(), Vec::new());
        for k in 0..points.len() {
            let (x, u, p) = (points.state(k), points.input(k), points.parameters(k));
            let y = net.evaluate(points.time(k), x, u, p);
            for (i, measured) in held_out.state(k).iter().enumerate() {
                if let Some(measured) = measured {
                    predicted.push(y[i] / self.scale[i]);
                    truth.push(measured / self.scale[i]);
                }
            }
        }
        mean_squared_error(&predicted, &truth, &[1.0])
    }

    /// Number of rows compared over all scenarios: for each, steps times subintervals and the
    /// initial state.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.scenarios.len() * (self.steps * self.subintervals + 1)
    }
}

/// Predicted states beside the true ones, row by row.
#[derive(Default)]
struct Comparison {
    predicted: Vec<f64>,
    truth: Vec<f64>,
}

impl Comparison {
    fn push(&mut self, predicted: &[f64], truth: &[f64]) {
        self.predicted.extend_from_slice(predicted);
        self.truth.extend_from_slice(truth);
    }

    fn error(&self, scale: &[f64]) -> f64 {
        mean_squared_error(&self.predicted, &self.truth, scale)
    }
}

/// What acts on a plant in a scenario.
struct Held {
    /// One input per step.
    inputs: Vec<Vec<f64>>,
    parameters: Vec<f64>,
}

fn integrate(
    integrator: &mut Simulator,
    initial: Vec<f64>,
    Held { inputs, parameters }: Held,
    sample_time_s: f64,
    subintervals: usize,
) -> Result<TrueTrajectory, NetError> {
    integrator.set_parameters(&parameters);
    let mut x = initial.clone();
    let mut truth = Vec::with_capacity(inputs.len() * subintervals * x.len());
    for input in &inputs {
        for _ in 0..subintervals {
            integrator.integrate(&mut x, input, sample_time_s / to_f64(subintervals))?;
            truth.extend_from_slice(&x);
        }
    }
    Ok(TrueTrajectory { initial, inputs, parameters, truth })
}
