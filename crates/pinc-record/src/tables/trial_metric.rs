//! The metrics of a trial that the tables of a sweep have a column for.

use crate::metric::{Metric, Of, Unit, Value};
use crate::metrics::Metrics;
use pinc_config::{Experiment, ModelKind, sweep_models};

/// A metric of a trial, with the model that it is of if there is one for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrialMetric {
    metric: &'static Metric,
    model: Option<ModelKind>,
}

/// A metric that a config asks for and that its trials do not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{name}\" given, expected one of {}", known.join(", "))]
pub struct UnknownMetric {
    /// The key that names the metric.
    pub key: &'static str,
    name: String,
    known: Vec<String>,
}

impl Metric {
    /// The metric of a trial's net.
    #[must_use]
    pub const fn of_net(&'static self) -> TrialMetric {
        TrialMetric { metric: self, model: None }
    }

    /// The metric of a trial's loop, or step, with a model.
    #[must_use]
    pub const fn with(&'static self, model: ModelKind) -> TrialMetric {
        TrialMetric { metric: self, model: Some(model) }
    }
}

impl TrialMetric {
    /// The metrics of the stages that an experiment has, times left out.
    #[must_use]
    pub fn results(experiment: &Experiment) -> Vec<Self> {
        Self::results_with(experiment, &sweep_models(experiment, &[]))
    }

    /// The metrics of these stages, with loops of these models.
    pub(super) fn results_with(experiment: &Experiment, models: &[ModelKind]) -> Vec<Self> {
        Self::all(experiment, models, |unit| unit.seconds().is_none())
    }

    /// The times of the stages that an experiment has, with loops of these models.
    pub(super) fn times_with(experiment: &Experiment, models: &[ModelKind]) -> Vec<Self> {
        Self::all(experiment, models, |unit| unit.seconds().is_some())
    }

    fn all(experiment: &Experiment, models: &[ModelKind], of: fn(Unit) -> bool) -> Vec<Self> {
        let is_trained = experiment.training.is_some();
        let has = |stage| match stage {
            Of::Name(_) | Of::Training(_) | Of::Validation(_) | Of::Domain(_) => is_trained,
            Of::FreeRun(_) => is_trained && experiment.prediction.is_some(),
            Of::Loop(_) => true,
            Of::OneStep(_) => experiment.one_step.is_some(),
        };
        let is_there = |m: &&Metric| !m.column.is_empty() && of(m.unit) && has(m.of);
        let (of_models, of_net): (Vec<&Metric>, Vec<&Metric>) =
            Metric::all().filter(is_there).partition(|metric| metric.is_of_models());
        let with = |&model| of_models.iter().map(move |metric| metric.with(model));
        of_net.into_iter().map(Metric::of_net).chain(models.iter().flat_map(with)).collect()
    }

    /// Those of [`results`](Self::results) that are numbers.
    fn numbers(experiment: &Experiment) -> impl Iterator<Item = Self> {
        Self::results(experiment).into_iter().filter(|metric| metric.is_number())
    }

    /// The number that the search of an experiment minimizes; `None` without a search.
    ///
    /// # Errors
    ///
    /// [`UnknownMetric`] if its trials have no such number.
    pub fn searched(experiment: &Experiment) -> Result<Option<Self>, UnknownMetric> {
        let search = experiment.sweep.as_ref().and_then(|sweep| sweep.search.as_ref());
        let Some(name) = search.map(|search| &search.minimize) else { return Ok(None) };
        let found = Self::numbers(experiment).find(|metric| metric.name() == *name);
        found.map(Some).ok_or_else(|| UnknownMetric {
            key: "sweep.search.minimize",
            name: name.clone(),
            known: Self::numbers(experiment).map(Self::name).collect(),
        })
    }

    /// The numbers that a tuning minimizes the sum of, those of the first model's loop, with their
    /// names without the model's and their weights; none without `[tune]`.
    ///
    /// # Errors
    ///
    /// [`UnknownMetric`] if a loop has no such number.
    pub fn tuned(experiment: &Experiment) -> Result<Vec<(Self, String, f64)>, UnknownMetric> {
        let Some(tune) = &experiment.tune else { return Ok(Vec::new()) };
        let model = experiment.control.iter().flat_map(|control| &control.models).next();
        let prefix = model.map_or_else(String::new, |model| format!("{model}_"));
        let own = |metric: Self| Some((metric.name().strip_prefix(&prefix)?.to_owned(), metric));
        let known: Vec<(String, Self)> = Self::numbers(experiment).filter_map(own).collect();
        let weighted = |(name, weight): (&str, f64)| match known.iter().find(|(n, _)| n == name) {
            Some((_, metric)) => Ok((*metric, name.to_owned(), weight)),
            None => Err(UnknownMetric {
                key: "tune.cost",
                name: name.to_owned(),
                known: known.iter().map(|(name, _)| name.clone()).collect(),
            }),
        };
        tune.weights().into_iter().map(weighted).collect()
    }

    /// Whether it is of the trial's net, and not of a loop.
    #[must_use]
    pub fn is_of_net(self) -> bool {
        self.model.is_none()
    }

    /// Whether it is a number rather than a name.
    #[must_use]
    pub fn is_number(self) -> bool {
        self.metric.unit != Unit::Name
    }

    /// The name of its column.
    #[must_use]
    pub fn name(self) -> String {
        let column = self.metric.column;
        self.model.map_or_else(|| column.to_owned(), |model| format!("{model}_{column}"))
    }

    /// Whether it is a measure of something in a unit, or a count.
    #[must_use]
    pub fn has_unit(self) -> bool {
        self.metric.unit != Unit::One
    }

    /// Returns the number of a trial with these metrics, if it got so far and it is one.
    #[must_use]
    pub fn number(self, metrics: &Metrics) -> Option<f64> {
        match self.metric.value(metrics, self.model)? {
            Value::Number(value) => Some(value),
            Value::Name(_) => None,
        }
    }

    /// Returns the column's cell for a trial with these metrics, if it got so far.
    #[must_use]
    pub fn cell(self, metrics: &Metrics) -> Option<String> {
        Some(self.metric.cell(self.metric.value(metrics, self.model)?))
    }
}
