//! The diagnosis of data and fit, in words.

use crate::analysis::Analysis;
use crate::fit::{Fit, FitStatus};
use crate::influence::acting_elsewhere;
use crate::problem::{Criterion, Problem};
use crate::result::{ChannelFit, Identified, outputs};
use crate::shooting::Shooting;
use crate::trajectory::{Evaluation, Trajectory};
use crate::whiteness;
use std::fmt;

/// The half width, as a share of the value, from which on an estimate says little.
const WEAK: f64 = 0.5;
/// The correlation from which on two parameters can hardly be told apart.
const PAIR: f64 = 0.999;
/// How many times the expected noise the residuals may be.
const NOISE: f64 = 2.0;
/// How many times the noise the residuals may be if the noise is estimated from the data.
const ROUGH_NOISE: f64 = 4.0;
/// The ratio from which on units are suspected.
const UNITS: f64 = 100.0;
/// How much more the end of a recording may depend on the initial state than this itself, where
/// measurements correct predictions.
const FORGOTTEN: f64 = 10.0;
/// The share of the largest entry that a parameter must have in a direction to be named.
const NAMED: f64 = 0.05;

/// The end of a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// The lower one.
    Low,
    /// The upper one.
    High,
}

/// Something that a user of the estimates should know.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Diagnosis {
    /// The iteration did not converge.
    NotConverged {
        /// How it ended.
        status: FitStatus,
    },
    /// Predictions that do not forget the initial state: with K the predictor is unstable.
    UnstablePredictor {
        /// How much of its scale the last state changes where the initial one changes by its scale.
        growth: f64,
    },
    /// An unknown that nothing measured depends on.
    NoInfluence {
        /// The unknown.
        name: String,
    },
    /// A parameter that changes nothing measured where the fit ended, but does elsewhere within
    /// its bounds.
    Inactive {
        /// The parameter.
        name: String,
        /// Values of it, and of the others that are inactive, with which it acts.
        acts_at: Vec<(String, f64)>,
    },
    /// A combination of unknowns that the data do not determine.
    Undetermined {
        /// The unknowns with their relative changes that together change nothing measured.
        direction: Vec<(String, f64)>,
    },
    /// An estimate whose interval is wide.
    Weak {
        /// The parameter.
        name: String,
        /// Half the width of its interval, as a share of its value.
        share: f64,
    },
    /// Two parameters that can hardly be told apart.
    Correlated {
        /// The parameters.
        names: [String; 2],
        /// The correlation of their estimates.
        correlation: f64,
    },
    /// A parameter at its bound.
    AtBound {
        /// The parameter.
        name: String,
        /// Which bound.
        side: Side,
        /// The bound.
        value: f64,
    },
    /// A parameter that is far from where it started, as after a mistake in units.
    Far {
        /// The parameter.
        name: String,
        /// Its value, over that at the start.
        factor: f64,
    },
    /// A channel without any value.
    NeverMeasured {
        /// The channel.
        name: String,
    },
    /// Residuals that are larger than the noise.
    Misfit {
        /// The channel.
        name: String,
        /// The root mean square of its residuals.
        rms: f64,
        /// The standard deviation of its noise.
        noise: f64,
        /// Whether that was given; if not, it was estimated from the data.
        given: bool,
    },
    /// A channel of unknown noise, weighed by its residuals.
    Weighed {
        /// The channel.
        name: String,
        /// The standard deviation by which its residuals are divided.
        sd: f64,
    },
    /// Residuals that are not white.
    NotWhite {
        /// The channel.
        name: String,
        /// The correlation of neighbouring ones.
        correlation: f64,
    },
    /// Residuals that depend on an input of some steps before.
    InputDependent {
        /// The channel.
        name: String,
        /// The input.
        input: String,
        /// Their correlation.
        correlation: f64,
        /// How many steps before.
        lag: usize,
    },
    /// A channel whose values are of another size than the model's at the start.
    Units {
        /// The channel.
        name: String,
        /// How many times larger the measurements are.
        factor: f64,
    },
    /// An input with which the data fit far better if it is taken times a factor.
    InputUnits {
        /// The input.
        name: String,
        /// The factor.
        factor: f64,
    },
}

impl fmt::Display for Diagnosis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConverged { status } => {
                write!(f, "the fit did not converge ({status}): start nearer, or set bounds")
            }
            Self::UnstablePredictor { growth } => write!(
                f,
                "the predictor with this K is unstable: the last prediction depends on the initial \
                 state {growth:.1e}-fold, which fits noise, so that neither K nor the intervals mean \
                 anything; take more rows, or criterion = \"simulation\" if nothing disturbs the plant"
            ),
            Self::NoInfluence { name } => {
                write!(f, "{name} cannot be identified: nothing measured depends on it")
            }
            Self::Inactive { name, acts_at } => {
                let at: Vec<_> =
                    acts_at.iter().map(|(name, value)| format!("{name} = {value:.4}")).collect();
                write!(
                    f,
                    "{name} does not act along the fitted trajectory, so that its value is where \
                     it started; it acts elsewhere within its bounds, as with {}: start there, or \
                     from more points",
                    at.join(", ")
                )
            }
            Self::Undetermined { direction } => {
                let names: Vec<_> = direction.iter().map(|(name, _)| name.as_str()).collect();
                let (together, them) = match names.len() {
                    1 => ("", "it"),
                    _ => (" together", "one of them"),
                };
                write!(f, "{} cannot be identified{together}: ", names.join(", "))?;
                for (i, (name, change)) in direction.iter().enumerate() {
                    let comma = if i == 0 { "" } else { ", " };
                    write!(f, "{comma}{name} by {change:+.2} %")?;
                }
                write!(f, " changes nothing measured; fix {them}, or vary the inputs more")
            }
            Self::Weak { name, share } => write!(
                f,
                "{name} is hardly determined: its interval is +-{:.0} % of its value",
                100.0 * share
            ),
            Self::Correlated { names: [a, b], correlation } => write!(
                f,
                "{a} and {b} can hardly be told apart: the correlation of their estimates is \
                 {correlation:.4}"
            ),
            Self::AtBound { name, side, value } => write!(
                f,
                "{name} is at its {} bound, {value}: the data ask for more than it allows, and it \
                 has no interval",
                if *side == Side::Low { "lower" } else { "upper" }
            ),
            Self::Far { name, factor } => write!(
                f,
                "{name} ended at {factor:.3e} times its start: are the units of the data the \
                 plant's?"
            ),
            Self::NeverMeasured { name } => write!(f, "{name} has no measured value at all"),
            Self::Misfit { name, rms, noise, given } => write!(
                f,
                "{name}: the residuals, {rms:.3e} rms, are {:.1} times the noise {} ({noise:.3e}): \
                 these may be data of another plant, or the equations lack something",
                rms / noise,
                if *given { "expected" } else { "that the data seem to have" }
            ),
            Self::Weighed { name, sd } => {
                write!(
                    f,
                    "{name}: its noise is not known, and counts as large as its residuals, {sd:.3e}"
                )
            }
            Self::NotWhite { name, correlation } => write!(
                f,
                "{name}: the residuals are not white (correlation of neighbours \
                 {correlation:.2}), so that the equations lack something, and the intervals are \
                 too narrow"
            ),
            Self::InputDependent { name, input, correlation, lag } => write!(
                f,
                "{name}: the residuals are correlated with {input} of {lag} steps before \
                 ({correlation:.2}): the equations lack something that the inputs excite, which a \
                 net inside them can learn"
            ),
            Self::Units { name, factor } => write!(
                f,
                "{name}: the measurements are about 1e{:.0} times what the model gives: are \
                 its units the plant's?",
                factor.log10()
            ),
            Self::InputUnits { name, factor } => write!(
                f,
                "{name}: the data would fit far better with {factor:e} times its values: \
                 are its units the plant's?"
            ),
        }
    }
}

/// The residuals of a channel by recordings, NaN where a value is missing.
fn residuals<'a>(
    problem: &Problem,
    fit: &'a Fit<'_>,
    fitted: &'a [Vec<f64>],
    channel: usize,
) -> Vec<Vec<f64>> {
    let channels = problem.channels.len();
    let parts = fit.recordings.iter().zip(fitted);
    let residuals = parts.map(|(of, fitted)| {
        let y = of.recording.y.iter().skip(channel).step_by(channels);
        let model = fitted.iter().skip(channel).step_by(channels);
        y.zip(model).map(|(y, model)| y - model).collect()
    });
    residuals.collect()
}

/// What is left of each channel.
pub(crate) fn channels(problem: &Problem, fit: &Fit<'_>, fitted: &[Vec<f64>]) -> Vec<ChannelFit> {
    let recordings: Vec<_> = fit.recordings.iter().map(|of| of.recording).collect();
    let channel = |i: usize| {
        let all = residuals(problem, fit, fitted, i);
        let given: Vec<f64> = all.iter().flatten().copied().filter(|r| !r.is_nan()).collect();
        let squares: f64 = given.iter().map(|r| r * r).sum();
        ChannelFit {
            name: problem.channels[i].name.clone(),
            measurements: given.len(),
            rms: (squares / given.len().max(1) as f64).sqrt(),
            inputs: whiteness::with_inputs(&recordings, &all, problem.inputs.len()),
            correlation: whiteness::of_neighbours(all),
        }
    };
    (0..problem.channels.len()).map(channel).collect()
}

/// All that there is to say.
pub(crate) fn findings(
    problem: &Problem,
    fit: &Fit<'_>,
    found: &Identified,
    analysis: &Analysis,
    start: &[Trajectory],
    with: &mut Evaluation<'_>,
) -> Vec<Diagnosis> {
    let mut all = Vec::new();
    let growth = fit.recordings.iter().map(Shooting::growth_to_end).fold(0.0, f64::max);
    if problem.criterion == Criterion::PredictionError && growth > FORGOTTEN {
        all.push(Diagnosis::UnstablePredictor { growth });
    } else if found.status != FitStatus::Converged {
        all.push(Diagnosis::NotConverged { status: found.status });
    }
    let names: Vec<String> = found.estimates().map(|of| of.name.clone()).collect();
    all.extend(without_influence(problem, fit, &names, analysis, with));
    all.extend(of_the_unknowns(problem, found, &names, analysis));
    let before = all.len();
    for (i, channel) in found.channels.iter().enumerate() {
        all.extend(of_a_channel(problem, fit, i, channel));
        all.extend(input_dependent(problem, channel));
    }
    let doubtful = |finding: &Diagnosis| {
        !matches!(
            finding,
            Diagnosis::NoInfluence { .. }
                | Diagnosis::Inactive { .. }
                | Diagnosis::Undetermined { .. }
        )
    };
    if all.len() > before || all.iter().any(doubtful) {
        all.extend(of_units(problem, fit, start, with));
    }
    all
}

/// The unknowns on which nothing measured depends where the fit ended.
fn without_influence(
    problem: &Problem,
    fit: &Fit<'_>,
    names: &[String],
    analysis: &Analysis,
    with: &mut Evaluation<'_>,
) -> Vec<Diagnosis> {
    let (parameters, unknown) = (problem.of_the_model().len(), problem.unknown.len());
    let (silent, others): (Vec<usize>, Vec<usize>) =
        analysis.without_influence.iter().partition(|i| **i < parameters);
    let states = others.iter().filter(|i| **i >= unknown);
    let found = acting_elsewhere(problem, fit, &silent, with);
    let of_parameters = silent.iter().zip(found).map(|(&i, acts_at)| match acts_at {
        None => Diagnosis::NoInfluence { name: names[i].clone() },
        Some(values) => Diagnosis::Inactive {
            name: names[i].clone(),
            acts_at: silent.iter().map(|&i| names[i].clone()).zip(values).collect(),
        },
    });
    let of_states = states.map(|&i| Diagnosis::NoInfluence { name: names[i].clone() });
    of_parameters.chain(of_states).collect()
}

fn of_the_unknowns(
    problem: &Problem,
    found: &Identified,
    names: &[String],
    analysis: &Analysis,
) -> Vec<Diagnosis> {
    let mut all = Vec::new();
    // Nobody asks for the gains: directions of these alone are left out.
    let gains = found.parameters.len()..found.parameters.len() + found.gains.len();
    for direction in &analysis.directions {
        let largest = direction.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        let sign = direction.iter().find(|v| v.abs() > NAMED * largest).map_or(1.0, |v| v.signum());
        let named = |i: &usize| direction[*i].abs() > NAMED * largest;
        if (0..names.len()).filter(named).all(|i| gains.contains(&i)) {
            continue;
        }
        let entries = names.iter().cloned().zip(direction);
        let named = entries.filter(|(_, v)| v.abs() > NAMED * largest);
        let direction = named.map(|(name, v)| (name, sign * v / largest)).collect();
        all.push(Diagnosis::Undetermined { direction });
    }
    for ((estimate, unknown), sd) in found.parameters.iter().zip(&problem.unknown).zip(&analysis.sd)
    {
        let name = || estimate.name.clone();
        if let Some(side) = estimate.at_bound.filter(|_| sd.is_nan()) {
            all.push(Diagnosis::AtBound { name: name(), side, value: estimate.value });
        }
        // A prior stands in for what the data do not say.
        if unknown.prior.is_some() {
            continue;
        }
        let share = estimate.half_width.map_or(0.0, |width| width / estimate.value.abs());
        if share > WEAK {
            all.push(Diagnosis::Weak { name: name(), share });
        }
        let factor = estimate.value / unknown.initial;
        let far = factor.is_finite() && (factor.abs() >= UNITS || factor.abs() <= 1.0 / UNITS);
        if far && estimate.half_width.is_some() && share <= WEAK {
            all.push(Diagnosis::Far { name: name(), factor });
        }
    }
    for i in 0..found.parameters.len() {
        for j in 0..i {
            let correlation = analysis.correlation[i * names.len() + j];
            let priors = [i, j].iter().any(|&i| problem.unknown[i].prior.is_some());
            if correlation.abs() > PAIR && !priors {
                let names = [names[j].clone(), names[i].clone()];
                all.push(Diagnosis::Correlated { names, correlation });
            }
        }
    }
    all
}

fn of_a_channel(
    problem: &Problem,
    fit: &Fit<'_>,
    i: usize,
    channel: &ChannelFit,
) -> Vec<Diagnosis> {
    let name = || channel.name.clone();
    if channel.measurements == 0 {
        return vec![Diagnosis::NeverMeasured { name: name() }];
    }
    let mut all = Vec::new();
    let estimated = problem.channels[i].sd.filter(|_| problem.channels[i].is_estimated);
    all.extend(estimated.map(|sd| Diagnosis::Weighed { name: name(), sd }));
    let given = problem.channels[i].sd.filter(|_| !problem.channels[i].is_estimated);
    // Predictions are off by the disturbances of the plant as well.
    let (noise, limit) = match given {
        _ if problem.criterion == Criterion::PredictionError => (0.0, 0.0),
        Some(sd) => (sd, NOISE),
        None => (roughness(problem, fit, i), ROUGH_NOISE),
    };
    let size = fit
        .recordings
        .iter()
        .flat_map(|of| of.recording.y.iter().skip(i).step_by(problem.channels.len()));
    let size = size.filter(|y| !y.is_nan()).fold(0.0, |most: f64, y| most.max(y.abs()));
    // Residuals of pure rounding are as large as any noise of exact data.
    if channel.rms <= 1e-9 * size {
        return all;
    }
    if noise > 0.0 && channel.rms > limit * noise {
        let (rms, given) = (channel.rms, given.is_some());
        all.push(Diagnosis::Misfit { name: name(), rms, noise, given });
    }
    // White residuals stay within this at all but one in ten thousand.
    let most = 4.0 / (channel.measurements as f64).sqrt();
    if channel.measurements >= 20 && channel.correlation > most.max(0.15) {
        all.push(Diagnosis::NotWhite { name: name(), correlation: channel.correlation });
    }
    all
}

/// The input that the residuals of a channel depend on most, if it is more than chance.
fn input_dependent(problem: &Problem, of: &ChannelFit) -> Option<Diagnosis> {
    let cross = of.inputs.iter().zip(&problem.inputs);
    let (cross, input) = cross.max_by(|(a, _), (b, _)| a.size().total_cmp(&b.size()))?;
    cross.is_significant().then(|| Diagnosis::InputDependent {
        name: of.name.clone(),
        input: input.clone(),
        correlation: cross.correlation,
        lag: cross.lag,
    })
}

/// The noise of a channel as far as each value is off the line between its neighbours, which says it
/// if the signal is smooth.
fn roughness(problem: &Problem, fit: &Fit<'_>, i: usize) -> f64 {
    let (mut squares, mut count) = (0.0, 0);
    for of in &fit.recordings {
        let y = of.recording.y.iter().skip(i).step_by(problem.channels.len());
        let given = y.enumerate().filter(|(_, y)| !y.is_nan());
        let given: Vec<(f64, f64)> = given.map(|(row, y)| (row as f64, *y)).collect();
        for w in given.windows(3) {
            let [(before, first), (row, y), (after, last)] = [w[0], w[1], w[2]];
            let part = (row - before) / (after - before);
            let off = y - (1.0 - part) * first - part * last;
            // The variance of that, in variances of the noise.
            squares += off * off / (1.0 + (1.0 - part).powi(2) + part.powi(2));
            count += 1;
        }
    }
    (squares / f64::from(count.max(1))).sqrt()
}

/// Mistakes in units: channels by their size at the start, inputs by the cost at the start.
fn of_units(
    problem: &Problem,
    fit: &Fit<'_>,
    start: &[Trajectory],
    with: &mut Evaluation<'_>,
) -> Vec<Diagnosis> {
    let mut all = Vec::new();
    let channels = problem.channels.len();
    let p = problem.start();
    for (i, channel) in problem.channels.iter().enumerate() {
        let (mut measured, mut model) = (0.0, 0.0);
        for (of, start) in fit.recordings.iter().zip(start) {
            let fitted = outputs(problem, of.recording, (start, &p), with);
            let pairs = of.recording.y.iter().zip(&fitted).skip(i).step_by(channels);
            for (y, fitted) in pairs.filter(|(y, fitted)| !y.is_nan() && fitted.is_finite()) {
                measured += y.abs();
                model += fitted.abs();
            }
        }
        let factor = measured / model;
        if factor.is_finite() && (factor >= UNITS || (factor > 0.0 && factor <= 1.0 / UNITS)) {
            all.push(Diagnosis::Units { name: channel.name.clone(), factor });
        }
    }
    let cost: f64 = start.iter().map(|of| of.cost).sum();
    for input in 0..with.dims.nu {
        for factor in [1e-3, 1e3] {
            let other = cost_with(problem, fit, (&p, input, factor), with);
            if other < 0.01 * cost || (other.is_finite() && !cost.is_finite()) {
                all.push(Diagnosis::InputUnits { name: problem.inputs[input].clone(), factor });
            }
        }
    }
    all
}

/// The cost at the start, if an input is taken times `factor`.
fn cost_with(
    problem: &Problem,
    fit: &Fit<'_>,
    (p, input, factor): (&[f64], usize, f64),
    with: &mut Evaluation<'_>,
) -> f64 {
    let (nx, nu) = (with.dims.nx, with.dims.nu);
    let mut cost = 0.0;
    for of in &fit.recordings {
        let mut u = of.recording.u.to_vec();
        u.iter_mut().skip(input).step_by(nu).for_each(|u| *u *= factor);
        let mut to = Trajectory::new(nx, of.trajectory.x.len() / nx, 1);
        let recording = crate::Recording { u: &u, ..of.recording };
        with.simulate(problem, recording, (&[0], problem.initial_state.values(), p), &mut to);
        cost += if to.is_finite() { to.cost } else { f64::INFINITY };
    }
    cost
}
