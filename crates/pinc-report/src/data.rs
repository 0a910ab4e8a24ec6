//! A run directory's files, read as far as the report needs them.

use crate::error::ReportError;
use crate::traces::{Steps, Traces};
use crate::trials::Trials;
use pinc_chart::{Axis, Kind, Panel};
use pinc_config::{Experiment, ModelKind, TimeUnit};
use pinc_record::metric::{Metric, Unit};
use pinc_record::{
    ControlReader, DomainErrorTable, EstimateTable, FixedReader, IdentificationMetrics, Metrics,
    Pair, PredictionTable, Provenance, RecordError, ResidualTable, StatePairs, TrainingRow, file,
    read_fixed_table, read_text,
};
use std::io::ErrorKind;
use std::path::Path;

/// A run directory. What is missing is empty.
#[derive(Debug)]
pub(crate) struct Run {
    /// The text of `config.toml`, and what it says.
    pub(crate) config_text: String,
    pub(crate) experiment: Experiment,
    pub(crate) metrics: Option<Metrics>,
    /// What waits to be resumed.
    pub(crate) unfinished: Option<&'static str>,
    pub(crate) provenance: Option<Provenance>,
    pub(crate) training: Option<Vec<TrainingRow>>,
    /// The errors of the net over its domain.
    pub(crate) domain_error: Option<DomainErrorTable>,
    /// The errors of the net along the closed loop; times are in the report's unit.
    pub(crate) model_error: Option<StatePairs>,
    /// Times are in the report's unit.
    pub(crate) prediction: Option<PredictionTable>,
    pub(crate) control: Traces,
    /// Where plans of the closed loops expected the states; times are in the report's unit.
    pub(crate) plans: Vec<OfModel<StatePairs>>,
    pub(crate) steps: Vec<OfModel<Steps>>,
    pub(crate) estimates: Vec<OfModel<EstimateTable>>,
    /// What was identified, and the data beside the fit.
    pub(crate) identification: Option<IdentificationMetrics>,
    pub(crate) residuals: Option<ResidualTable>,
    /// The trials of a sweep.
    pub(crate) trials: Option<Trials>,
}

/// A table that belongs to one model in the controller.
#[derive(Debug)]
pub(crate) struct OfModel<T> {
    /// The model; `None` if a run ended before it said which its only one is.
    pub(crate) model: Option<ModelKind>,
    /// The name of the table's file, for captions.
    pub(crate) file: String,
    pub(crate) table: T,
}

impl Run {
    /// Reads the directory.
    pub(crate) fn read(dir: &Path) -> Result<Self, ReportError> {
        if !dir.is_dir() {
            return Err(RecordError::NotADirectory { path: dir.to_owned() }.into());
        }
        let path = dir.join(file::CONFIG);
        let missing = || RecordError::unreadable(&path)(ErrorKind::NotFound.into());
        let config_text = read_text(&path)?.ok_or_else(missing)?;
        let experiment = Experiment::read_back(&path, &config_text)?;
        let metrics = Metrics::read(dir)?;
        if !metrics.as_ref().is_some_and(Metrics::has_results) {
            of_another_command(dir)?;
        }
        let only = metrics.iter().flat_map(|metrics| &metrics.control).map(|of| of.model).next();
        // Times are shown in the config's unit.
        let second = 1.0 / experiment.time_unit.unwrap_or(TimeUnit::S).seconds();
        let control = match &experiment.control {
            None => Traces::default(),
            Some(spec) => {
                let sizes = [spec.initial_state.len(), spec.input_low.len()];
                let open = |path: &Path| ControlReader::open(path, sizes, &spec.controlled);
                let readers = read_models(dir, file::control, only, open)?;
                Traces::read(readers, spec, step_s(&experiment), second)?
            }
        };
        let mut prediction = PredictionTable::read(&dir.join(file::PREDICTION))?;
        let rows = prediction.iter_mut().flat_map(|table| &mut table.rows);
        rows.for_each(|row| row.t *= second);
        let mut model_error = StatePairs::read(&dir.join(file::MODEL_ERROR), Pair::Errors)?;
        let rows = model_error.iter_mut().flat_map(|table| &mut table.rows);
        rows.for_each(|row| row.t *= second);
        let read = |path: &Path| StatePairs::read(path, Pair::Range);
        let mut plans = read_models(dir, file::plans, only, read)?;
        let rows = plans.iter_mut().flat_map(|of: &mut OfModel<StatePairs>| &mut of.table.rows);
        rows.for_each(|row| row.t *= second);
        let mut estimates = read_models(dir, file::estimates, only, EstimateTable::read)?;
        let rows =
            estimates.iter_mut().flat_map(|of: &mut OfModel<EstimateTable>| &mut of.table.rows);
        rows.for_each(|row| row.t *= second);
        let mut residuals = ResidualTable::read(&dir.join(file::RESIDUALS))?;
        let rows = residuals.iter_mut().flat_map(|table| &mut table.rows);
        rows.for_each(|row| row.t *= second);
        let provenance = Provenance::read(dir)?;
        // A run that ended before its first checkpoint.
        let trains = ["train", "run"].map(Some).contains(&command(provenance.as_ref()));
        let never_trained = trains
            && experiment.training.is_some()
            && experiment.sweep.is_none()
            && !metrics.as_ref().is_some_and(Metrics::has_results)
            && !dir.join(file::MODEL).exists();
        let looped = metrics.iter().flat_map(|metrics| &metrics.control).count();
        let in_loop = looped < control.loops.len();
        let in_training = dir.join(file::CHECKPOINT).exists() || never_trained;
        let of_loop = in_loop.then_some("closed loop");
        Ok(Self {
            identification: IdentificationMetrics::read(dir)?,
            residuals,
            unfinished: if in_training { Some("training") } else { of_loop },
            provenance,
            training: read_fixed_table(&dir.join(file::TRAINING))?,
            domain_error: DomainErrorTable::read(&dir.join(file::DOMAIN_ERROR))?,
            model_error,
            prediction,
            control,
            plans,
            steps: read_models(dir, file::steps, only, |path| {
                FixedReader::open(path)?.map(Steps::read).transpose()
            })?,
            estimates,
            trials: Trials::read(dir, &experiment)?,
            config_text,
            experiment,
            metrics,
        })
    }

    /// The length T of a step, in the report's unit.
    pub(crate) fn step(&self) -> Option<f64> {
        step_s(&self.experiment).map(|step_s| step_s / self.time_unit().seconds())
    }

    /// The unit of the plant's times in the report.
    pub(crate) fn time_unit(&self) -> TimeUnit {
        self.experiment.time_unit.unwrap_or(TimeUnit::S)
    }

    /// The axis of the plant's times, from one end to the other.
    pub(crate) fn time_axis(&self, ends: (f64, f64)) -> Axis {
        Axis::ranged(&format!("t ({})", self.time_unit().name()), Kind::Linear, ends)
    }

    /// A model's name as the report writes it.
    pub(crate) fn model_name(&self, model: Option<ModelKind>) -> &'static str {
        let Some(model) = model else { return "controller" };
        self.metrics.as_ref().map_or(model.title(), |metrics| metrics.title_of(model))
    }

    /// A metric's title with its unit if that is the states'.
    pub(crate) fn label_of(&self, metric: &Metric) -> String {
        match metric.unit {
            Unit::States(power) if metric.is_of_models() => {
                self.label_in_states_unit(metric.title, power)
            }
            Unit::States(power) => self.label_in_all_states_unit(metric.title, power),
            Unit::Errors(_) | Unit::Clock(..) | Unit::Count | Unit::One | Unit::Name => {
                metric.title.to_owned()
            }
        }
    }

    /// A quantity with the unit of the controlled states, or of all states if none is controlled,
    /// to a power written as "²" or nothing.
    pub(crate) fn label_in_states_unit(&self, quantity: &str, power: &str) -> String {
        let controlled = self.experiment.control.iter().flat_map(|control| &control.controlled);
        let controlled: Vec<&String> = controlled.collect();
        match controlled.is_empty() {
            true => self.label_in_all_states_unit(quantity, power),
            false => self.label_in_common_unit(quantity, &controlled, power),
        }
    }

    /// The same of a quantity of all states, as the error of a net.
    pub(crate) fn label_in_all_states_unit(&self, quantity: &str, power: &str) -> String {
        let states = self.metrics.as_ref().map_or(&[][..], |metrics| &metrics.states);
        self.label_in_common_unit(quantity, states, power)
    }

    fn label_in_common_unit(
        &self,
        quantity: &str,
        variables: &[impl AsRef<str>],
        power: &str,
    ) -> String {
        match self.common_unit(variables) {
            None => quantity.to_owned(),
            Some("") => format!("{quantity} (–)"),
            Some(unit) => format!("{quantity} ({unit}{power})"),
        }
    }

    /// Variables with their units, as an axis says it: "h1, h2 (cm)", "x (m), v (m/s)"; "(–)" after
    /// a number without dimension.
    pub(crate) fn axis_label(&self, variables: &[impl AsRef<str>]) -> String {
        let names: Vec<&str> = variables.iter().map(AsRef::as_ref).collect();
        if self.common_unit(&names).is_some() {
            return self.label_in_unit_of(&names.join(", "), &names);
        }
        names.iter().map(|name| self.label_in_unit_of(name, &[name])).collect::<Vec<_>>().join(", ")
    }

    /// An empty panel with these variables along its axis.
    pub(crate) fn panel(&self, title: &str, variables: &[impl AsRef<str>], height: f64) -> Panel {
        Panel::new(title, Axis::new(&self.axis_label(variables), Kind::Linear), height)
    }

    /// `quantity` with the unit that `variables` have in common, if they have one.
    pub(crate) fn label_in_unit_of(&self, quantity: &str, variables: &[impl AsRef<str>]) -> String {
        self.label_in_common_unit(quantity, variables, "")
    }

    /// The unit of a variable, empty for a number without dimension; `None` if nothing is known.
    pub(crate) fn unit(&self, variable: &str) -> Option<&str> {
        self.metrics.as_ref()?.variables.get(variable).map(String::as_str)
    }

    /// The unit of all these variables, empty for numbers without dimension; `None` if they differ
    /// or nothing is known.
    fn common_unit(&self, variables: &[impl AsRef<str>]) -> Option<&str> {
        let first = self.unit(variables.first()?.as_ref())?;
        variables.iter().all(|v| self.unit(v.as_ref()) == Some(first)).then_some(first)
    }
}

/// What commands leave that make no runs, and the report or table that shows their results.
const OTHERS: [(&str, &str, &str); 4] = [
    ("tune.csv", "pinc tune", "held-out/report.html"),
    ("recommended.toml", "pinc choose", "tried/report.html"),
    ("shrink.csv", "pinc shrink", "shrink.csv"),
    (file::CERTIFY, "pinc certify", file::CERTIFY),
];

/// An error if the files in `dir` are of such a command, finished or not.
fn of_another_command(dir: &Path) -> Result<(), ReportError> {
    let owned = || dir.to_owned();
    if let Some((_, command, place)) = OTHERS.into_iter().find(|(of, ..)| dir.join(of).exists()) {
        return Err(ReportError::NotOfARun { dir: owned(), command, place: dir.join(place) });
    }
    let provenance = Provenance::read(dir)?;
    let begun = command(provenance.as_ref());
    match OTHERS.into_iter().find(|(_, command, _)| command.strip_prefix("pinc ") == begun) {
        Some((_, command, _)) => Err(ReportError::Unfinished { dir: owned(), command }),
        None => Ok(()),
    }
}

/// The name of the command that began a run.
fn command(provenance: Option<&Provenance>) -> Option<&str> {
    provenance?.begun.command.get(1).map(String::as_str)
}

fn step_s(experiment: &Experiment) -> Option<f64> {
    experiment.sample_time_s().filter(|t| *t > 0.0)
}

/// The tables of all models, or the table of a run with one model, which may be known to be `only`.
fn read_models<T>(
    dir: &Path,
    name: fn(ModelKind, usize) -> String,
    only: Option<ModelKind>,
    read: impl Fn(&Path) -> Result<Option<T>, RecordError>,
) -> Result<Vec<OfModel<T>>, RecordError> {
    let mut found = Vec::new();
    for model in ModelKind::ALL {
        let file = name(model, ModelKind::ALL.len());
        if let Some(table) = read(&dir.join(&file))? {
            found.push(OfModel { model: Some(model), file, table });
        }
    }
    let file = name(only.unwrap_or(ModelKind::Pinc), 1);
    if found.is_empty()
        && let Some(table) = read(&dir.join(&file))?
    {
        found.push(OfModel { model: only, file, table });
    }
    Ok(found)
}
