//! The table of metrics: what stages of a run are judged by, a row each.
//!
//! Each row stands beside the type that its value is a field of. The columns of sweeps, the tables
//! of reports and of `pinc compare`, the table that a run prints, and docs/metrics.md read the rows.

use crate::csv::number;
use crate::domain_error::DomainErrorMetrics;
use crate::metrics::{
    ControlMetrics, Metrics, OneStepMetrics, PredictionMetrics, TrainingMetrics, ValidationMetrics,
};
use pinc_config::ModelKind;

#[cfg(test)]
pub(crate) mod tests;

pub use crate::metrics::{control::rows::*, net::rows::*, one_step::rows::*};

/// A number or a name that a stage of a run gives.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Its place in the stage's section of `metrics.json`; empty if it is computed from others.
    pub path: &'static str,
    /// Its column in the tables of a sweep, after the model's name if there is a value for each
    /// model; empty if it has none.
    pub column: &'static str,
    /// Its name where no heading names its stage.
    pub title: &'static str,
    /// Its name in the tables of reports, beneath the heading of its stage, if they have it.
    pub row: Option<&'static str>,
    /// Its unit.
    pub unit: Unit,
    /// The significant digits in reports; 0 of a whole number. Times are in a unit that suits them.
    pub digits: usize,
    /// Which direction is better.
    pub better: Better,
    /// The head of its column in the table that a run prints, if it has one there, and how it is
    /// written below.
    pub printed: Option<(&'static str, Show)>,
    /// Where it comes from.
    pub of: Of,
}

/// How a number is written in a column.
pub type Show = fn(f64) -> String;

/// The unit of a metric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// The states' unit to a power, which stands after it.
    States(&'static str),
    /// Another measure of errors.
    Errors(&'static str),
    /// The time of this machine in a unit of so many seconds.
    Clock(&'static str, f64),
    /// Iterations, evaluations.
    Count,
    /// A number without a unit.
    One,
    /// No number but a name.
    Name,
}

/// Which direction is better. Loops are compared in metrics that have one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// The lower the better.
    Lower,
    /// Neither: it explains other numbers, or any value below a tolerance is as good.
    Neither,
}

/// The stage that a metric comes from.
#[derive(Clone, Copy, Debug)]
pub enum Of {
    /// A name that the training gave.
    Name(fn(&TrainingMetrics) -> String),
    /// The training.
    Training(fn(&TrainingMetrics) -> f64),
    /// The validation.
    Validation(fn(&ValidationMetrics) -> f64),
    /// The error over the domain.
    Domain(fn(&DomainErrorMetrics) -> f64),
    /// The free run.
    FreeRun(fn(&PredictionMetrics) -> f64),
    /// The closed loop with a model.
    Loop(fn(&ControlMetrics) -> f64),
    /// One step of a model by itself.
    OneStep(fn(&OneStepMetrics) -> f64),
}

/// A metric's value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A name.
    Name(String),
}

/// The metrics by their stages.
const ALL: [&[Metric]; 6] = [TRAINING, VALIDATION, DOMAIN, FREE_RUN, LOOP, ONE_STEP];

impl Metric {
    /// A metric of which less is better, and that reports have beneath its title.
    pub(crate) const fn new(
        [path, column]: [&'static str; 2],
        title: &'static str,
        unit: Unit,
        digits: usize,
        of: Of,
    ) -> Self {
        let (row, better) = (Some(title), Better::Lower);
        Self { path, column, title, row, unit, digits, better, printed: None, of }
    }

    /// The metric with another name beneath the heading of its stage, or not in reports.
    pub(crate) const fn row(self, row: Option<&'static str>) -> Self {
        Self { row, ..self }
    }

    /// The metric without a better direction.
    pub(crate) const fn neutral(self) -> Self {
        Self { better: Better::Neither, ..self }
    }

    /// The metric with a column in the table that a run prints.
    pub(crate) const fn printed(self, head: &'static str, show: Show) -> Self {
        Self { printed: Some((head, show)), ..self }
    }

    /// All metrics.
    pub fn all() -> impl Iterator<Item = &'static Self> {
        ALL.into_iter().flatten()
    }

    /// Returns a stage's metrics that reports have in tables: errors first, then times, counts and
    /// what is left.
    #[must_use]
    pub fn rows(stage: &'static [Self]) -> Vec<&'static Self> {
        let mut rows: Vec<_> = stage.iter().filter(|metric| metric.row.is_some()).collect();
        rows.sort_by_key(|metric| metric.unit.rank());
        rows
    }

    /// Whether each model has a value of its own.
    #[must_use]
    pub fn is_of_models(&self) -> bool {
        matches!(self.of, Of::Loop(_) | Of::OneStep(_))
    }

    /// Its value in a run, with this model where there is one for each; `None` if the run did not
    /// get so far.
    #[must_use]
    pub fn value(&self, run: &Metrics, model: Option<ModelKind>) -> Option<Value> {
        let value = match self.of {
            Of::Name(name) => return Some(Value::Name(name(run.training.as_ref()?))),
            Of::Training(value) => value(run.training.as_ref()?),
            Of::Validation(value) => value(run.validation.as_ref()?),
            Of::Domain(value) => value(run.validation.as_ref()?.domain_error.as_ref()?),
            Of::FreeRun(value) => value(run.prediction.as_ref()?),
            Of::Loop(value) => value(run.loop_with(model?)?),
            Of::OneStep(value) => value(run.step_of(model?)?),
        };
        // As it is read back: JSON has no infinite numbers.
        Some(Value::Number(if value.is_finite() { value } else { f64::NAN }))
    }

    /// Its value in a closed loop; NaN if it is of another stage.
    #[must_use]
    pub fn of_loop(&self, of: &ControlMetrics) -> f64 {
        if let Of::Loop(value) = self.of { value(of) } else { f64::NAN }
    }

    /// A value in a table of numbers that round-trip.
    pub(crate) fn cell(&self, value: Value) -> String {
        match value {
            Value::Name(name) => name,
            Value::Number(value) if self.digits == 0 => value.to_string(),
            Value::Number(value) => number(value),
        }
    }
}

/// Metrics are told apart by their titles.
impl PartialEq for Metric {
    fn eq(&self, other: &Self) -> bool {
        self.title == other.title
    }
}

impl Eq for Metric {}

impl Unit {
    /// How many seconds it is, if it measures the time of this machine.
    #[must_use]
    pub fn seconds(self) -> Option<f64> {
        if let Self::Clock(_, seconds) = self { Some(seconds) } else { None }
    }

    /// Metrics of one rank stand together.
    fn rank(self) -> u8 {
        match self {
            Self::States(_) | Self::Errors(_) => 0,
            Self::Clock(..) => 1,
            Self::Count => 2,
            Self::One => 3,
            Self::Name => 4,
        }
    }
}
