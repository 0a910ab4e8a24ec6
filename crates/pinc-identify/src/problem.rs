//! A problem of identification: unknowns, measurements and data.

use crate::IdentifyError;
use crate::error::rows;
use pinc_estimate::Measured;
use pinc_ode::{ArgumentError, Dims};

/// A problem of identification: measured quantities, unknowns, and where the fit starts.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// The measured quantities, in the order of the measurements.
    pub channels: Vec<Channel>,
    /// p, the parameters of the model, `np`: those that are not identified keep these values.
    pub parameters: Vec<f64>,
    /// The parameters that are identified.
    pub unknown: Vec<Unknown>,
    /// The state at the first row of each recording.
    pub initial_state: InitialState,
    /// The names of the states, for what is said of them, `nx`.
    pub states: Vec<String>,
    /// The names of the inputs, `nu`.
    pub inputs: Vec<String>,
    /// The error whose squares are summed.
    pub criterion: Criterion,
}

/// A measured quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Its name, for what is said of it.
    pub name: String,
    /// The measured quantity.
    pub measured: Measured,
    /// The standard deviation of its noise, by which its residuals are divided; 1 where it is not
    /// known.
    pub sd: Option<f64>,
    /// Whether that standard deviation is unknown and estimated from the residuals.
    pub is_estimated: bool,
}

/// A parameter that is identified.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// Its name, for what is said of it.
    pub name: String,
    /// Its place among the parameters of the model.
    pub place: usize,
    /// Where its estimate starts.
    pub initial: f64,
    /// The least that it can be; minus infinity for no bound.
    pub low: f64,
    /// The most that it can be; infinity for no bound.
    pub high: f64,
    /// What is known of it before the data.
    pub prior: Option<Prior>,
}

/// A normal distribution of a parameter, which counts as one more measurement: (p - mean)/sd is a
/// residual like others. Around 0 it is a penalty on the squares of a net's weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// The mean.
    pub mean: f64,
    /// The standard deviation.
    pub sd: f64,
}

impl Prior {
    /// The residual of the value `p`.
    pub(crate) fn residual(self, p: f64) -> f64 {
        (p - self.mean) / self.sd
    }
}

/// The error whose squares are summed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Criterion {
    /// The error of a simulation from the initial state, by single or multiple shooting, whichever
    /// is needed.
    #[default]
    Chosen,
    /// The error of a simulation from the initial state, by single shooting.
    Simulation,
    /// The same error by multiple shooting: segments are fitted first, then joined.
    MultipleShooting,
    /// The error of predictions from one row to the next, by single or multiple shooting: each
    /// measurement corrects the state, x\[k\] + K (y\[k\] - h(x\[k\])), before the next step. K is
    /// constant and is found with the parameters (Ljung, "System Identification" (1999), section
    /// 4.3). What disturbs the plant is then forgotten as far as the measurements show it.
    PredictionError,
}

/// The state at the first row of each recording, `nx`.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum InitialState {
    /// It is unknown, each recording has its own, and their estimates start here.
    Free(Vec<f64>),
    /// It is known to be this.
    Fixed(Vec<f64>),
}

/// A recording, row by row, one step of the model apart.
///
/// # Shapes
///
/// `u`: `[rows, nu]`, held from a row to the next; `y`: `[rows, channels]`, read just before the
/// input changes, NaN where a value is missing; `before`: `[nu]`.
#[derive(Clone, Copy, Debug)]
pub struct Recording<'a> {
    /// Its name, for what is said of it.
    pub name: &'a str,
    /// The input before the first row, under which this row is read; where it is not known, the row
    /// is read under its own.
    pub before: Option<&'a [f64]>,
    /// The inputs.
    pub u: &'a [f64],
    /// The measurements.
    pub y: &'a [f64],
}

impl InitialState {
    /// Where the estimate starts, or what the state is known to be.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        match self {
            Self::Free(values) | Self::Fixed(values) => values,
        }
    }

    /// Whether it is unknown.
    #[must_use]
    pub fn is_free(&self) -> bool {
        matches!(self, Self::Free(_))
    }
}

impl Problem {
    /// Checks it against a model of dimensions `dims`.
    ///
    /// # Errors
    ///
    /// [`IdentifyError`], with the reason.
    pub fn validate(&self, dims: Dims) -> Result<(), IdentifyError> {
        let states = |c: &Channel| match c.measured {
            Measured::State(place) => Some(place),
            _ => None,
        };
        let outputs = |c: &Channel| match c.measured {
            Measured::Output(place) => Some(place),
            _ => None,
        };
        let of = |place: &dyn Fn(&Channel) -> Option<usize>| -> Vec<usize> {
            self.channels.iter().filter_map(place).collect()
        };
        ArgumentError::check_places("measured states", &of(&states), dims.nx)?;
        ArgumentError::check_places("measured outputs", &of(&outputs), dims.ny)?;
        let sd: Vec<f64> = self.channels.iter().filter_map(|c| c.sd).collect();
        ArgumentError::check_numbers("measurement sd", &sd, "positive", |sd| {
            sd > 0.0 && sd.is_finite()
        })?;
        ArgumentError::check_length("parameters", self.parameters.len(), dims.np)?;
        ArgumentError::check_numbers("parameters", &self.parameters, "finite", f64::is_finite)?;
        let unknown: Vec<usize> = self.unknown.iter().map(|unknown| unknown.place).collect();
        ArgumentError::check_places("unknown parameters", &unknown, dims.np)?;
        let priors: Vec<f64> =
            self.unknown.iter().filter_map(|of| of.prior).flat_map(|of| [of.sd, of.mean]).collect();
        ArgumentError::check_numbers("priors", &priors, "finite", f64::is_finite)?;
        let sd: Vec<f64> = priors.iter().step_by(2).copied().collect();
        ArgumentError::check_numbers("sd of priors", &sd, "positive", |sd| sd > 0.0)?;
        for Unknown { name, initial, low, high, .. } in &self.unknown {
            let (name, initial, low, high) = (name.clone(), *initial, *low, *high);
            if !(initial.is_finite() && low <= initial && initial <= high && low < high) {
                return Err(IdentifyError::OutsideBounds { name, initial, low, high });
            }
        }
        ArgumentError::check_length("initial state", self.initial_state.values().len(), dims.nx)?;
        ArgumentError::check_numbers(
            "initial state",
            self.initial_state.values(),
            "finite",
            f64::is_finite,
        )?;
        ArgumentError::check_length("names of states", self.states.len(), dims.nx)?;
        ArgumentError::check_length("names of inputs", self.inputs.len(), dims.nu)?;
        if self.channels.is_empty() {
            let (field, expected, found) = ("channels", 1, 0);
            return Err(ArgumentError::Length { field, expected, found }.into());
        }
        if self.unknown.is_empty() && !self.initial_state.is_free() {
            return Err(IdentifyError::NothingUnknown);
        }
        Ok(())
    }

    /// Checks recordings, and that they have more values than there are unknowns.
    pub(crate) fn validate_data(
        &self,
        dims: Dims,
        recordings: &[Recording<'_>],
    ) -> Result<(), IdentifyError> {
        if recordings.is_empty() {
            return Err(IdentifyError::TooShort { recording: 0, rows: 0 });
        }
        for (i, recording) in recordings.iter().enumerate() {
            if let Some(before) = recording.before {
                ArgumentError::check_length("before", before.len(), dims.nu)?;
                ArgumentError::check_numbers("before", before, "finite", f64::is_finite)?;
            }
            rows(i, dims, (recording.u, recording.y, self.channels.len()))?;
        }
        let given = |recording: &Recording<'_>| recording.y.iter().filter(|y| !y.is_nan()).count();
        let measurements = recordings.iter().map(given).sum();
        let unknowns = self.unknowns(dims, recordings.len());
        if measurements + self.priors() <= unknowns {
            return Err(IdentifyError::TooFewMeasurements { measurements, unknowns });
        }
        Ok(())
    }

    /// The problem with K as further parameters, from the values `start`, `[nx, channels]`.
    pub(crate) fn with_gains(&self, start: &[f64]) -> Self {
        let mut with = self.clone();
        let names = self.states.iter().flat_map(|state| {
            self.channels.iter().map(move |channel| format!("K[{state}, {}]", channel.name))
        });
        for (name, &initial) in names.zip(start) {
            let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
            let place = with.parameters.len();
            with.unknown.push(Unknown { name, place, initial, low, high, prior: None });
            with.parameters.push(initial);
        }
        with
    }

    /// The unknowns that are parameters of the model, of which K is none.
    pub(crate) fn of_the_model(&self) -> &[Unknown] {
        let gains = match self.criterion {
            Criterion::PredictionError => self.states.len() * self.channels.len(),
            _ => 0,
        };
        let first = self.parameters.len() - gains;
        let count = self.unknown.iter().take_while(|unknown| unknown.place < first).count();
        &self.unknown[..count]
    }

    /// The number of unknowns: parameters and, where they are free, the initial states.
    pub(crate) fn unknowns(&self, dims: Dims, recordings: usize) -> usize {
        let states = if self.initial_state.is_free() { dims.nx } else { 0 };
        self.unknown.len() + recordings * states
    }

    /// The number of priors.
    pub(crate) fn priors(&self) -> usize {
        self.unknown.iter().filter(|unknown| unknown.prior.is_some()).count()
    }

    /// What the priors add to the cost.
    pub(crate) fn prior_cost(&self, p: &[f64]) -> f64 {
        let residuals = self.unknown.iter().filter_map(|of| Some(of.prior?.residual(p[of.place])));
        residuals.map(|residual| 0.5 * residual * residual).sum()
    }

    /// p where the fit starts, `np`.
    pub(crate) fn start(&self) -> Vec<f64> {
        let mut p = self.parameters.clone();
        for unknown in &self.unknown {
            p[unknown.place] = unknown.initial;
        }
        p
    }

    /// By what residuals are divided.
    pub(crate) fn sd(&self, channel: usize) -> f64 {
        self.channels[channel].sd.unwrap_or(1.0)
    }
}

impl Recording<'_> {
    /// The input, of `nu` numbers, that row `k` is read under: the one that led there. Where it is
    /// not known for the first row, it is taken for the row's own.
    pub(crate) fn input_read(&self, k: usize, nu: usize) -> &[f64] {
        match (k, self.before) {
            (0, Some(before)) => before,
            _ => &self.u[k.saturating_sub(1) * nu..][..nu],
        }
    }

    /// The number of rows of a recording of that many channels.
    pub(crate) fn rows(&self, channels: usize) -> usize {
        self.y.len() / channels
    }
}
