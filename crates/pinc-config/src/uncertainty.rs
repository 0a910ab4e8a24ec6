//! The `[control.uncertainty]` section.

use crate::registry::Variables;
use pinc_mpc::NmpcProblem;
use pinc_ode::{Dims, Variable};
use pinc_tube::{EllipsoidTube, Feedback, Interval, Sources, StageError, TubeError, TubeModel};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What is uncertain of model and state. The bounds of states, outputs and later inputs move inwards
/// by how far the plant may be from the plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UncertaintySpec {
    /// Probability with which each bound is to hold at each predicted step, from 0.5 to less than 1;
    /// or `"worst-case"`, which needs sources with limits.
    pub probability: ProbabilitySpec,
    /// Standard deviation of the model's error in each step, one per state, in its unit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub process_sd: Vec<f64>,
    /// Largest error of the model in each step, by state, in its unit: what `pinc certify` proves
    /// of a net, for instance.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub boxes: BTreeMap<String, f64>,
    /// Intervals of parameters, `[low, high]`, in which they stay; or the path of an
    /// `identify.json`, whose intervals of 95 % are taken.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, [f64; 2]>,
    /// Whether the covariance of what the estimator estimates counts.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub estimate: bool,
    /// Whether the error of the net counts: `true` takes its estimate as the limit in each stage,
    /// `"proven"` the bound in the certificate of the model file.
    #[serde(default, skip_serializing_if = "is_default")]
    pub net_error: NetErrorSpec,
    /// Feedback that is taken to act on deviations from the plan: `"riccati"`, the linear-quadratic
    /// regulator along the plan; `"none"`; or a matrix with one row per input.
    #[serde(default, skip_serializing_if = "is_default")]
    pub feedback: FeedbackSpec,
    /// Whether the bounds of inputs move by what the feedback may ask for.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub tighten_inputs: bool,
    /// How many of the first quadratic programs of a step have bounds that are tightened anew: the first
    /// one's along the plan of the step before, later ones' along their own plan. Several may not settle.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub tightenings: usize,
}

fn yes() -> bool {
    true
}

fn one() -> usize {
    1
}

fn is_one(count: &usize) -> bool {
    *count == 1
}

/// A probability, or the worst case.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a probability, or \"worst-case\"")]
pub enum ProbabilitySpec {
    /// The probability.
    Chance(f64),
    /// No plant within the limits breaks a bound.
    Word(WorstCase),
}

/// The worst case in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WorstCase {
    /// The worst case.
    WorstCase,
}

/// What counts of a net's error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected true, false or \"proven\"")]
pub enum NetErrorSpec {
    /// Its estimate in each stage, or nothing.
    Estimated(bool),
    /// Its proven bound, which holds in the domain of the net.
    Word(NetErrorWord),
}

/// A net's error in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetErrorWord {
    /// The bound in the certificate of the model file.
    Proven,
}

impl NetErrorSpec {
    /// Nothing.
    pub const NONE: Self = Self::Estimated(false);
    /// The proven bound.
    pub const PROVEN: Self = Self::Word(NetErrorWord::Proven);
}

impl Default for NetErrorSpec {
    fn default() -> Self {
        Self::NONE
    }
}

/// The feedback of a tube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected \"riccati\", \"none\" or a matrix, one row per input")]
pub enum FeedbackSpec {
    /// One that needs no numbers.
    Word(FeedbackWord),
    /// K.
    Matrix(Vec<Vec<f64>>),
}

/// A feedback in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FeedbackWord {
    /// The linear-quadratic regulator along the plan.
    Riccati,
    /// None.
    None,
}

impl Default for FeedbackSpec {
    fn default() -> Self {
        Self::Word(FeedbackWord::Riccati)
    }
}

pub(crate) fn is_default<T: Default + PartialEq>(of: &T) -> bool {
    *of == T::default()
}

/// What a tube is made from beside the config.
#[derive(Debug)]
pub struct TubeParts<'a> {
    /// The dimensions of the controller's model, and its problem.
    pub sizes: (Dims, &'a NmpcProblem),
    /// The plant's variables.
    pub variables: &'a Variables,
    /// The model with the parameters that are uncertain.
    pub model: TubeModel,
    /// Their places, in the order of their names.
    pub places: &'a [usize],
    /// The proven error of a step of the net by state, if that is the model and counts.
    pub proven: Option<&'a [f64]>,
    /// The estimated error of the net, if that is the model and counts.
    pub error: Option<Box<dyn StageError>>,
}

impl UncertaintySpec {
    /// The probability; none in the worst case.
    #[must_use]
    pub fn chance(&self) -> Option<f64> {
        match self.probability {
            ProbabilitySpec::Chance(probability) => Some(probability),
            ProbabilitySpec::Word(WorstCase::WorstCase) => None,
        }
    }

    /// The places of the uncertain parameters among `all`, in the order of their names.
    pub fn places(&self, all: &[Variable]) -> impl Iterator<Item = usize> {
        self.parameters.keys().filter_map(|name| all.iter().position(|known| known.name == *name))
    }

    /// The same for models that are no nets; `None` if nothing is left.
    #[must_use]
    pub fn without_net_error(self) -> Option<Self> {
        Some(Self { net_error: NetErrorSpec::NONE, ..self }).filter(|of| !of.is_nothing())
    }

    /// Whether there is no source of uncertainty.
    pub(crate) fn is_nothing(&self) -> bool {
        let of_steps = self.process_sd.is_empty() && self.boxes.is_empty();
        let of_model = self.parameters.is_empty() && self.net_error == NetErrorSpec::NONE;
        of_steps && of_model && !self.estimate
    }

    /// The feedback on deviations.
    #[must_use]
    pub fn feedback(&self) -> Feedback {
        match &self.feedback {
            FeedbackSpec::Word(FeedbackWord::Riccati) => Feedback::Riccati,
            FeedbackSpec::Word(FeedbackWord::None) => Feedback::None,
            FeedbackSpec::Matrix(rows) => Feedback::Given(rows.concat()),
        }
    }

    /// The tube.
    ///
    /// # Errors
    ///
    /// [`TubeError`] if the parts do not fit together.
    pub fn tube(&self, parts: TubeParts<'_>) -> Result<EllipsoidTube, TubeError> {
        let proven = |i: usize| parts.proven.and_then(|proven| proven.get(i)).copied();
        let limit = |(i, name): (usize, &String)| {
            self.boxes.get(name).copied().unwrap_or(0.0) + proven(i).unwrap_or(0.0)
        };
        let (dims, problem) = parts.sizes;
        let intervals = self.parameters.values().zip(parts.places);
        let intervals = intervals.map(|(&[low, high], &place)| Interval { place, low, high });
        let units = problem.units(dims, None).states;
        let states = parts.variables.state_names();
        let is_limited = !self.boxes.is_empty() || parts.proven.is_some();
        let sources = Sources {
            probability: self.chance(),
            process_sd: self.process_sd.clone(),
            boxes: if is_limited {
                states.iter().enumerate().map(limit).collect()
            } else {
                Vec::new()
            },
            parameters: intervals.collect(),
            estimate: self.estimate,
            error: parts.error,
        };
        let sizes = (dims, problem.horizon);
        EllipsoidTube::new(sizes, sources, Some(parts.model), self.feedback(), units).map(|tube| {
            tube.tightening_inputs(self.tighten_inputs).tightening_programs(self.tightenings)
        })
    }
}
