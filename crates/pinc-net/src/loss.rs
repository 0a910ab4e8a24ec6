//! The PINC loss, Eqs. (`mse_y_pinc`) and (`mse_F_pinc`), in its readable form.

use crate::error::{check_length, check_positive};
use crate::mlp::to_f64;
use crate::net::PincNet;
use crate::sampling::Points;
use crate::{Ansatz, Measurements, NetError};
use pinc_ad::{Dual, Scalar};
use pinc_ode::{Dims, Plant};
use serde::{Deserialize, Serialize};

/// The units in which the residual F = y' - f(y, u) of each state is squared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ResidualScale {
    /// The state's own unit per second: the paper's text.
    Physical,
    /// Standard deviations of the state in the domain per T, so that states of different units and
    /// sizes weigh the same.
    Normalized,
    /// The state's typical displacement in one step, per T: the standard deviation of T f(y0, u)
    /// over the domain, or of the state itself if it is smaller. States that change little
    /// are then learnt as accurately, relative to their displacement, as states that change much.
    /// Without the hard initial condition it is the same as `normalized`.
    Displacement,
    /// The state's own unit per second times this factor, one per state; the authors' code takes
    /// the cross-sections `A_i` of the tanks.
    Custom(Vec<f64>),
}

/// The units in which errors of the initial condition and of measured states are squared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InitialScale {
    /// The state's own unit: the paper's text.
    Physical,
    /// Standard deviations of the state in the domain: the authors' code.
    Normalized,
    /// The state's typical displacement in one step, as in `residual_scale`.
    Displacement,
}

/// Weights of the loss: `MSE_y` + lambda `MSE_F` + weight `MSE_D`, where each state's errors are
/// multiplied by a factor of its own. `MSE_D` is the mean of squared errors over measured values,
/// plus `derivatives` times squared errors of known derivatives along a direction.
#[derive(Clone, Debug, PartialEq)]
pub struct LossWeights {
    /// The weight lambda of `MSE_F`.
    pub lambda: f64,
    /// Factor of each state's residual.
    pub residual_scale: Vec<f64>,
    /// Factor of each state's initial error, and of its error against measurements.
    pub initial_scale: Vec<f64>,
    /// Weight of the squared errors of derivatives relative to squared errors of measured states.
    pub derivatives: f64,
}

impl LossWeights {
    /// The weights for `net`; derivatives have the weight 1.
    ///
    /// # Errors
    ///
    /// [`NetError`] if lambda or a factor is not positive, or there is not one factor per state.
    pub fn new(
        net: &PincNet,
        lambda: f64,
        residual: &ResidualScale,
        initial: InitialScale,
    ) -> Result<Self, NetError> {
        let states = net.dims().nx;
        let ends = net.domain.ends().take(states);
        let deviation: Vec<f64> = ends.map(|(low, high)| (high - low) / 12.0_f64.sqrt()).collect();
        // A net with the hard initial condition is scaled by the displacements.
        let smaller = |(d, moved): (&f64, &f64)| if moved < d { *moved } else { *d };
        let displacement = match net.ansatz {
            Ansatz::HardLinear => deviation.iter().zip(&net.output.std).map(smaller).collect(),
            Ansatz::Direct => deviation.clone(),
        };
        let residual_scale = match residual {
            ResidualScale::Physical => vec![1.0; states],
            ResidualScale::Normalized => deviation.iter().map(|d| net.sample_time_s / d).collect(),
            ResidualScale::Displacement => {
                displacement.iter().map(|d| net.sample_time_s / d).collect()
            }
            ResidualScale::Custom(factors) => factors.clone(),
        };
        let initial_scale = match initial {
            InitialScale::Physical => vec![1.0; states],
            InitialScale::Normalized => deviation.iter().map(|d| 1.0 / d).collect(),
            InitialScale::Displacement => displacement.iter().map(|d| 1.0 / d).collect(),
        };
        check_length("residual_scale", residual_scale.len(), states, "state")?;
        check_positive("lambda", lambda)?;
        for factor in &residual_scale {
            check_positive("residual_scale", *factor)?;
        }
        Ok(Self { lambda, residual_scale, initial_scale, derivatives: 1.0 })
    }
}

/// The terms of the loss.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LossTerms {
    /// `MSE_y`, with its factors.
    pub data: f64,
    /// lambda `MSE_F`, with its factors.
    pub physics: f64,
    /// weight `MSE_D`, with its factors.
    pub measured: f64,
}

impl LossTerms {
    /// The loss.
    #[must_use]
    pub fn total(self) -> f64 {
        self.data + self.physics + self.measured
    }
}

/// The loss over any scalar, written as in the paper: the specification that the batched kernel is
/// tested against. Returns `MSE_y` and lambda `MSE_F`; [`reference_measured`] is the third term.
///
/// `context` is any number of type `S` (for a [`pinc_ad::Var`], on the tape of `parameters`).
///
/// # Panics
///
/// If a length does not fit.
pub fn reference_loss<S: Scalar, P: Plant>(
    plant: &P,
    net: &PincNet,
    weights: &LossWeights,
    parameters: &[S],
    points: (&Points, &Points),
    context: S,
) -> [S; 2] {
    reference_residuals(plant, net, weights, parameters, points, context).map(|residuals| {
        residuals.iter().fold(context.constant(0.0), |sum, &residual| sum + residual * residual)
    })
}

/// The residuals whose squares add up to the loss, weights included: the errors of the initial
/// conditions and the residuals of the equation, each of length points times states, point by
/// point.
///
/// `points` are the collocation points and the initial points; `context` is any number of
/// type `S` (for a [`pinc_ad::Var`], on the tape of `parameters`).
///
/// # Panics
///
/// If a length does not fit.
pub fn reference_residuals<S: Scalar, P: Plant>(
    plant: &P,
    net: &PincNet,
    weights: &LossWeights,
    parameters: &[S],
    (collocation, initial): (&Points, &Points),
    context: S,
) -> [Vec<S>; 2] {
    let Dims { nx, .. } = net.dims();
    let share = |points: usize, weight: f64| (weight / to_f64((points * nx).max(1))).sqrt();
    let lifted: Vec<Dual<S>> = parameters.iter().map(|&w| Dual::lift(w)).collect();
    let mut physics = Vec::new();
    for k in 0..collocation.len() {
        let [y0, u, p] = collocation.lifted(k, |v| Dual::lift(context.constant(v)));
        let t = Dual::variable(context.constant(collocation.time(k)), 0);
        let y = net.state(&lifted, t, &y0, &u, &p);
        let mut f = vec![Dual::lift(context.constant(0.0)); nx];
        plant.rhs(&y, &u, &p, &mut f);
        let share = share(collocation.len(), weights.lambda);
        physics
            .extend((0..nx).map(|i| (y[i].eps[0] - f[i].re) * weights.residual_scale[i] * share));
    }
    let mut data = Vec::new();
    for j in 0..initial.len() {
        let [y0, u, p] = initial.lifted(j, |v| context.constant(v));
        let y = net.state(parameters, context.constant(initial.time(j)), &y0, &u, &p);
        let share = share(initial.len(), 1.0);
        data.extend((0..nx).map(|i| (y[i] - y0[i]) * weights.initial_scale[i] * share));
    }
    [data, physics]
}

/// The residuals of the term of the measurements, their `weight` included: one per measured value,
/// point by point, and one for its derivative where that is known. Their squares add up to weight
/// `MSE_D`.
///
/// # Panics
///
/// If a length does not fit.
pub fn reference_measured<S: Scalar>(
    net: &PincNet,
    weights: &LossWeights,
    parameters: &[S],
    (measurements, weight): (&Measurements, f64),
    context: S,
) -> Vec<S> {
    let share = (weight / to_f64(measurements.values().max(1))).sqrt();
    let lifted: Vec<Dual<S>> = parameters.iter().map(|&w| Dual::lift(w)).collect();
    let points = measurements.points();
    let mut residuals = Vec::new();
    for k in 0..points.len() {
        let [y0, u, p] = points.lifted(k, |v| context.constant(v));
        let t = context.constant(points.time(k));
        let y = net.state(parameters, t, &y0, &u, &p);
        for (i, measured) in measurements.state(k).iter().enumerate() {
            if let Some(measured) = *measured {
                let error = y[i] - context.constant(measured);
                residuals.push(error * weights.initial_scale[i] * share);
            }
        }
        let Some((direction, slopes)) = measurements.slope(k) else { continue };
        let mut directions = direction.iter();
        let mut along = |at: Vec<S>| -> Vec<Dual<S>> {
            let seed = |(at, v): (S, &f64)| Dual { re: at, eps: [context.constant(*v)] };
            at.into_iter().zip(directions.by_ref()).map(seed).collect()
        };
        let (y0, u, p) = (along(y0), along(u), along(p));
        let y = net.state(&lifted, Dual::lift(t), &y0, &u, &p);
        let share = share * weights.derivatives.sqrt();
        for (i, measured) in measurements.state(k).iter().enumerate() {
            if measured.is_some() {
                let error = y[i].eps[0] - context.constant(slopes[i]);
                residuals.push(error * weights.initial_scale[i] * share);
            }
        }
    }
    residuals
}
