//! `identify.json`: what was identified of a plant.

use crate::csv::decimals;
use crate::error::RecordError;
use crate::files::{file, json, read_json};
use crate::metrics::number_or_null;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// The share by which the costs of fits differ that ended in the same minimum.
const SAME: f64 = 1e-3;

/// The results of `pinc identify`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentificationMetrics {
    /// The experiment's name.
    pub experiment: String,
    /// The model that was fitted.
    pub model: String,
    /// The parameters, by their names.
    pub parameters: BTreeMap<String, ParameterMetrics>,
    /// The gain of each state by the error of prediction of each output, by their names; none
    /// unless errors of prediction were fitted.
    #[serde(default)]
    pub gains: BTreeMap<String, EstimateMetrics>,
    /// The nets inside the plant's equations whose weights are among the parameters.
    #[serde(default)]
    pub nets: Vec<String>,
    /// Half the sum of the squares of all residuals, each divided by its noise.
    pub cost: f64,
    /// The measured quantities.
    pub outputs: Vec<String>,
    /// By what the residuals of each output are divided; 1 where the noise is not known.
    pub measurement_sd: Vec<f64>,
    /// The state at the first row of each file, where it is unknown.
    pub initial_states: Vec<InitialStateMetrics>,
    /// How the fit ended.
    pub status: String,
    /// Where the fit ended from each of its starts, the one that was taken first.
    #[serde(default)]
    pub starts: Vec<StartMetrics>,
    /// At which costs the starts ended that were fitted to the end, the lowest first.
    #[serde(default)]
    pub minima: Vec<MinimumMetrics>,
    /// The files that were held out.
    #[serde(default)]
    pub held_out: Vec<HeldOutMetrics>,
    /// Single or multiple shooting.
    pub method: String,
    /// Why.
    pub reason: String,
    /// The number of measured values.
    pub measurements: usize,
    /// These without the unknowns.
    pub degrees_of_freedom: usize,
    /// The residuals of each output, by its name.
    pub residuals: BTreeMap<String, ResidualMetrics>,
    /// The correlations of the estimates.
    pub correlation: CorrelationMetrics,
    /// The singular values of the residuals' derivatives by all unknowns, each in its own size.
    pub singular_values: Vec<f64>,
    /// In words, what there is to say of data and fit.
    pub findings: Vec<String>,
    /// The work done.
    pub work: WorkMetrics,
}

/// An estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateMetrics {
    /// Its value.
    pub value: f64,
    /// Half the width of its interval of 95 %; nothing where the data do not determine it.
    pub half_width_95: Option<f64>,
}

/// The estimate of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterMetrics {
    /// The estimate.
    #[serde(flatten)]
    pub estimate: EstimateMetrics,
    /// Where it started.
    pub initial: f64,
    /// The bounds that it had.
    pub low: Option<f64>,
    /// The upper one.
    pub high: Option<f64>,
    /// Which of them it is at: `low` or `high`.
    pub at_bound: Option<String>,
}

/// One of the starts of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartMetrics {
    /// The cost where the fit from there ended; nothing if the model is not finite there.
    pub cost: Option<f64>,
    /// The parameters there, by their names.
    pub parameters: BTreeMap<String, f64>,
    /// How it ended.
    pub status: String,
}

/// The estimated initial state of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InitialStateMetrics {
    /// The file.
    pub file: String,
    /// The states, by their names.
    pub states: BTreeMap<String, EstimateMetrics>,
}

/// The residuals of an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualMetrics {
    /// The number of measured values.
    pub measurements: usize,
    /// The root mean square of the residuals, in the output's unit.
    pub rms: f64,
    /// The correlation of neighbouring residuals.
    pub correlation: f64,
    /// The correlation with each input, by its name.
    #[serde(default)]
    pub inputs: BTreeMap<String, InputCorrelationMetrics>,
}

/// The largest correlation of the residuals with an input of some steps before.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputCorrelationMetrics {
    /// The correlation; NaN where the input is constant or the rows are too few.
    #[serde(deserialize_with = "number_or_null")]
    pub correlation: f64,
    /// How many steps before.
    pub lag: usize,
    /// The correlation beyond which it is no chance; nothing where the input is constant.
    pub chance: Option<f64>,
}

/// Costs at which fits from several starts ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MinimumMetrics {
    /// The lowest cost of them.
    pub cost: f64,
    /// How many fits ended there, to a thousandth of the cost.
    pub starts: usize,
}

/// A file that the fit has not seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOutMetrics {
    /// The file.
    pub file: String,
    /// The first rows, which the initial state was fitted to.
    pub fitted_rows: usize,
    /// The root mean square error of the simulation of each output over the other rows, in its
    /// unit; without those that have no value there.
    pub rms: BTreeMap<String, f64>,
}

/// The correlations of the estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CorrelationMetrics {
    /// Their names.
    pub names: Vec<String>,
    /// Row by row; nothing where one of the two is not determined.
    pub matrix: Vec<Vec<Option<f64>>>,
}

/// The work of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorkMetrics {
    /// Iterations.
    pub iterations: usize,
    /// Steps of the model.
    pub steps: usize,
    /// Points at which it was linearized.
    pub linearized: usize,
    /// The time in s.
    pub wall_s: f64,
}

impl StartMetrics {
    /// The status of a start that had only a short fit, since others were better.
    pub const SET_ASIDE: &str = "set aside";
}

impl ResidualMetrics {
    /// The correlations with inputs in words, with the ones beyond which they are no chance.
    #[must_use]
    pub fn with_inputs(&self) -> String {
        let shown = self.inputs.iter().map(|(name, of)| match of.chance {
            Some(chance) => {
                format!("{name}: {:.2} at {} steps ({chance:.2})", of.correlation, of.lag)
            }
            None => format!("{name}: constant, or too few rows"),
        });
        shown.collect::<Vec<_>>().join(", ")
    }
}

impl MinimumMetrics {
    /// The costs in groups, without those that are not finite: these fits ended at no minimum.
    #[must_use]
    pub fn of(costs: impl IntoIterator<Item = f64>) -> Vec<Self> {
        let mut costs: Vec<f64> = costs.into_iter().filter(|cost| cost.is_finite()).collect();
        costs.sort_by(f64::total_cmp);
        let mut all: Vec<Self> = Vec::new();
        for cost in costs {
            match all.last_mut().filter(|last| cost <= (1.0 + SAME) * last.cost) {
                Some(last) => last.starts += 1,
                None => all.push(Self { cost, starts: 1 }),
            }
        }
        all
    }
}

impl HeldOutMetrics {
    /// Those of the outputs `measured` along a file, from the measurements behind its fitted rows and
    /// what is simulated there, `[steps, outputs]` both; a measurement that is missing is NaN.
    #[must_use]
    pub fn of(
        file: String,
        fitted_rows: usize,
        (measured, [y, simulated]): (&[String], [&[f64]; 2]),
    ) -> Self {
        let rms = |(output, name): (usize, &String)| {
            let pairs = y.iter().zip(simulated).skip(output).step_by(measured.len());
            let errors = pairs.map(|(y, simulated)| y - simulated).filter(|e| !e.is_nan());
            let (sum, count) = errors.fold((0.0, 0.0), |(sum, n), e| (sum + e * e, n + 1.0));
            (count > 0.0).then(|| (name.clone(), (sum / count).sqrt()))
        };
        let rms = measured.iter().enumerate().filter_map(rms).collect();
        Self { file, fitted_rows, rms }
    }
}

/// A number with six decimals, or as many as half the width of its interval needs.
fn as_precise(value: f64, half_width: Option<f64>) -> String {
    let power = |v: f64| v.abs().log10().floor();
    let wanted = half_width.filter(|of| *of > 0.0).map_or(6.0, |of| (2.0 - power(of)).max(6.0));
    let is_small = value != 0.0 && value.abs() < 1e-3;
    let wanted = if is_small { wanted + power(value) } else { wanted };
    #[expect(clippy::cast_possible_truncation, reason = "from 2 to 15")]
    let count = wanted.clamp(2.0, 15.0) as usize;
    if is_small { format!("{value:.count$e}") } else { decimals(value, count) }
}

/// The result in a few lines.
impl fmt::Display for IdentificationMetrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {}; {} iterations, {} ({}); cost {}, {} values",
            self.model,
            self.ended(),
            self.work.iterations,
            self.method,
            self.reason,
            decimals(self.cost, 6),
            self.measurements
        )?;
        let states = self.initial_states.iter().flat_map(|file| {
            let several = self.initial_states.len() > 1;
            file.states.iter().map(move |(state, of)| match several {
                true => (format!("{state}(0) of {}", file.file), of),
                false => (format!("{state}(0)"), of),
            })
        });
        let is_weight = |name: &String| self.net_of(name).is_some();
        let parameters = self.parameters.iter().filter(|(name, _)| !is_weight(name));
        let parameters = parameters.map(|(name, of)| (name.clone(), &of.estimate));
        let gains = self.gains.iter().map(|(name, of)| (name.clone(), of));
        for (name, estimate) in parameters.chain(gains).chain(states) {
            let value = as_precise(estimate.value, estimate.half_width_95);
            match estimate.half_width_95 {
                Some(width) => write!(f, "\n  {name} = {value} +- {width:.2e}")?,
                None => write!(f, "\n  {name} = {value}, without an interval")?,
            }
        }
        for net in &self.nets {
            let weights = self.parameters.iter().filter(|(name, _)| self.net_of(name) == Some(net));
            let squares: Vec<f64> = weights.map(|(_, of)| of.estimate.value.powi(2)).collect();
            let rms = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
            write!(f, "\n  {net}: {} weights of {rms:.3} rms", squares.len())?;
        }
        self.held_out_in_words().try_for_each(|of| write!(f, "\n  {of}"))?;
        self.findings.iter().try_for_each(|finding| write!(f, "\nnote: {finding}"))
    }
}

impl IdentificationMetrics {
    /// The error of each output on each file that was held out.
    pub fn held_out_in_words(&self) -> impl Iterator<Item = String> {
        self.held_out.iter().flat_map(|of| {
            let said = |(output, rms): (&String, &f64)| {
                format!("{output} of {}, held out: error {} rms", of.file, decimals(*rms, 4))
            };
            of.rms.iter().map(said)
        })
    }

    /// The net that a parameter is a weight of.
    #[must_use]
    pub fn net_of(&self, parameter: &str) -> Option<&String> {
        let (base, _) = parameter.split_once('[')?;
        self.nets.iter().find(|net| *net == base)
    }

    /// How the fit ended, and from how many of its starts there.
    #[must_use]
    pub fn ended(&self) -> String {
        if self.starts.len() < 2 {
            let other = "another start may end in a better minimum";
            return format!("{} from a single start ({other})", self.status);
        }
        let (fitted, aside): (Vec<_>, Vec<_>) =
            self.starts.iter().partition(|start| start.status != StartMetrics::SET_ASIDE);
        let minima = MinimumMetrics::of(fitted.iter().filter_map(|start| start.cost));
        let (here, others) =
            minima.split_first().map_or((0, &[][..]), |(of, rest)| (of.starts, rest));
        let others =
            others.iter().map(|of| format!(", {} at the cost {}", of.starts, decimals(of.cost, 6)));
        let alone = "; no other start ended here: more of them may find a better minimum";
        format!(
            "{} from {} starts: {here} of {} that were fitted to the end ended here{}; set \
             aside after a short fit: {}{}",
            self.status,
            self.starts.len(),
            fitted.len(),
            others.collect::<String>(),
            aside.len(),
            if here > 1 { "" } else { alone }
        )
    }

    /// Those in a run directory; `None` if there are none.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if the file cannot be read or is damaged.
    pub fn read(dir: &Path) -> Result<Option<Self>, RecordError> {
        read_json(&dir.join(file::IDENTIFY))
    }

    /// The text of the file.
    #[must_use]
    pub fn to_json(&self) -> String {
        json(self)
    }
}

#[cfg(test)]
mod tests;
