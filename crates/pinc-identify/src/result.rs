//! The identified parameters, and how far they can be trusted.

use crate::analysis::Analysis;
use crate::diagnosis::{self, Diagnosis, Side};
use crate::fit::{Fit, FitStatus};
use crate::method::Method;
use crate::problem::{Problem, Recording};
use crate::starts::Start;
use crate::student::quantile_95;
use crate::trajectory::{Evaluation, Trajectory, Work};
use pinc_ode::Dims;

/// A fit.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Identified {
    /// The unknown parameters, in the order of the problem.
    pub parameters: Vec<Estimate>,
    /// K of [`Criterion::PredictionError`](crate::Criterion::PredictionError), `[nx, channels]` row
    /// by row; none for other criteria.
    pub gains: Vec<Estimate>,
    /// The states at the first row of each recording, where they are unknown.
    pub initial_states: Vec<Vec<Estimate>>,
    /// p, all parameters of the model.
    pub p: Vec<f64>,
    /// Half the sum of the squares of all residuals, each divided by the standard deviation of its
    /// channel.
    pub cost: f64,
    /// The number of measured values.
    pub measurements: usize,
    /// These and the priors, less what they determine of the unknowns.
    pub degrees_of_freedom: usize,
    /// The correlations of all estimates, `[unknowns, unknowns]` row by row: first the parameters,
    /// then K, then the initial state of each recording. NaN where one is not determined.
    pub correlation: Vec<f64>,
    /// The singular values of the derivatives of all residuals by all unknowns, each in its own
    /// size, from the largest: those that are 0 belong to directions that the data do not
    /// determine.
    pub singular_values: Vec<f64>,
    /// The model's outputs for each recording, `[rows, channels]`.
    pub fitted: Vec<Vec<f64>>,
    /// The states from which the model steps, for each recording, `[rows, nx]`.
    pub states: Vec<Vec<f64>>,
    /// The channels, one by one.
    pub channels: Vec<ChannelFit>,
    /// Single or multiple shooting.
    pub method: Method,
    /// How the iteration ended.
    pub status: FitStatus,
    /// Where the fits from all starts ended, the one that is returned first, then from the lowest
    /// cost.
    pub starts: Vec<Start>,
    /// Findings about the data and the fit.
    pub findings: Vec<Diagnosis>,
    /// The work done.
    pub work: Work,
}

/// An estimate with its interval.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Half the width of its interval of 95 %, t sqrt(diag(s^2 (J'J)^-1)) with s^2 the sum of
    /// squares over the degrees of freedom; none where the data do not determine it, or where it is
    /// at a bound.
    pub half_width: Option<f64>,
    /// The bound that it is at.
    pub at_bound: Option<Side>,
}

/// The residuals of a channel.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ChannelFit {
    /// Its name.
    pub name: String,
    /// The number of measured values.
    pub measurements: usize,
    /// The root mean square of its residuals, in its unit.
    pub rms: f64,
    /// The correlation of neighbouring residuals.
    pub correlation: f64,
    /// The correlation with each input.
    pub inputs: Vec<InputCorrelation>,
}

/// The correlation of the residuals with an input of `lag` steps before, the largest of these.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct InputCorrelation {
    /// The correlation, from -1 to 1; NaN where the input is constant or the rows are too few.
    pub correlation: f64,
    /// How many steps before.
    pub lag: usize,
    /// The correlation beyond which it is no chance: four standard deviations of the correlation
    /// with white residuals, or with residuals as coloured as these.
    pub chance: f64,
}

impl Identified {
    pub(crate) fn of(
        problem: &Problem,
        (fit, method): (Fit<'_>, Method),
        starts: Vec<Start>,
        start: &[Trajectory],
        with: &mut Evaluation<'_>,
    ) -> Self {
        let analysis = Analysis::of(problem, &fit);
        let given = |y: &&f64| !y.is_nan();
        let measurements: usize =
            fit.recordings.iter().map(|of| of.recording.y.iter().filter(given).count()).sum();
        // What no residual depends on, or a bound holds, is not fitted.
        let degrees_of_freedom = measurements + problem.priors() - analysis.rank;
        let cost = fit.cost();
        let s = (2.0 * cost / degrees_of_freedom as f64).sqrt();
        let factor = s * quantile_95(degrees_of_freedom);
        let mut half_widths =
            analysis.sd.iter().map(|sd| Some(factor * sd).filter(|width| width.is_finite()));
        let parameters = problem.unknown.iter().map(|unknown| {
            let value = fit.p[unknown.place];
            let at_low = (value <= unknown.low).then_some(Side::Low);
            let at_bound = at_low.or((value >= unknown.high).then_some(Side::High));
            let half_width = half_widths.next().flatten();
            Estimate { name: unknown.name.clone(), value, half_width, at_bound }
        });
        let mut parameters: Vec<_> = parameters.collect();
        let gains = parameters.split_off(problem.of_the_model().len());
        let several = fit.recordings.len() > 1;
        let initial_states = fit.recordings.iter().filter(|of| of.nq > 0).map(|of| {
            let states = problem.states.iter().zip(&of.nodes.x);
            let estimate = |(state, value): (&String, &f64)| Estimate {
                name: match several {
                    true => format!("{state}(0) of {}", of.recording.name),
                    false => format!("{state}(0)"),
                },
                value: *value,
                half_width: half_widths.next().flatten(),
                at_bound: None,
            };
            states.map(estimate).collect()
        });
        let initial_states = initial_states.collect();
        let fitted: Vec<_> = fit
            .recordings
            .iter()
            .map(|of| outputs(problem, of.recording, (&of.trajectory, &fit.p), with))
            .collect();
        let mut found = Self {
            parameters,
            gains,
            initial_states,
            cost,
            measurements,
            degrees_of_freedom,
            correlation: analysis.correlation.clone(),
            singular_values: analysis.singular_values.clone(),
            channels: diagnosis::channels(problem, &fit, &fitted),
            fitted,
            states: fit.recordings.iter().map(|of| of.trajectory.corrected.clone()).collect(),
            method,
            status: fit.status,
            starts,
            findings: Vec::new(),
            work: Work::default(),
            p: Vec::new(),
        };
        found.findings = diagnosis::findings(problem, &fit, &found, &analysis, start, with);
        Self { p: fit.p[..with.dims.np].to_vec(), work: with.work, ..found }
    }

    /// All estimates: the parameters, then K, then the initial state of each recording.
    pub fn estimates(&self) -> impl Iterator<Item = &Estimate> {
        self.parameters.iter().chain(&self.gains).chain(self.initial_states.iter().flatten())
    }
}

/// The measured quantities along a trajectory, `[rows, channels]`.
pub(crate) fn outputs(
    problem: &Problem,
    recording: Recording<'_>,
    (trajectory, p): (&Trajectory, &[f64]),
    with: &mut Evaluation<'_>,
) -> Vec<f64> {
    let Dims { nx, nu, .. } = with.dims;
    let channels = problem.channels.len();
    let mut all = vec![0.0; trajectory.x.len() / nx * channels];
    for (k, measured) in all.chunks_exact_mut(channels).enumerate() {
        let x = &trajectory.x[k * nx..(k + 1) * nx];
        with.measured(problem, (x, recording.input_read(k, nu), p), measured);
    }
    all
}
