//! A run directory's files, read as far as the report needs them.

use super::ReportError;
use super::sweep::Trials;
use super::table::Table;
use crate::spec::ModelKind;
use serde_json::Value;
use std::io::ErrorKind;
use std::path::Path;

/// A run directory. What is missing is empty.
#[derive(Debug)]
pub(super) struct Run {
    /// The text of `config.toml`, and what it says.
    pub(super) config_text: Option<String>,
    pub(super) config: toml::Table,
    pub(super) metrics: Value,
    pub(super) provenance: Value,
    pub(super) training: Option<Table>,
    pub(super) prediction: Option<Table>,
    /// The closed loops, PINC first.
    pub(super) control: Vec<OfModel>,
    pub(super) steps: Vec<OfModel>,
    /// Of a sweep.
    pub(super) trials: Option<Trials>,
}

/// A table that belongs to one model in the controller.
#[derive(Debug)]
pub(super) struct OfModel {
    pub(super) model: String,
    pub(super) table: Table,
}

impl Run {
    /// Reads the directory.
    pub(super) fn read(dir: &Path) -> Result<Self, ReportError> {
        if !dir.is_dir() {
            let path = dir.to_owned();
            return Err(ReportError::NotADirectory { path });
        }
        let config_text = read_text(&dir.join("config.toml"))?;
        let config = match &config_text {
            Some(text) => parse_toml(&dir.join("config.toml"), text)?,
            None => toml::Table::new(),
        };
        let metrics = read_json(&dir.join("metrics.json"))?;
        let only = metrics["control"][0]["model"].as_str();
        let only = only.unwrap_or("controller").to_owned();
        Ok(Self {
            config_text,
            config,
            provenance: read_json(&dir.join("provenance.json"))?,
            training: Table::read(&dir.join("training.csv"))?,
            prediction: Table::read(&dir.join("prediction.csv"))?,
            control: read_models(dir, "control", &only)?,
            steps: read_models(dir, "steps", &only)?,
            trials: Trials::read(dir)?,
            metrics,
        })
    }

    /// What the config says at a path of keys, as `&["model", "horizon_s"]`.
    pub(super) fn setting(&self, path: &[&str]) -> Option<&toml::Value> {
        let (first, rest) = path.split_first()?;
        rest.iter().try_fold(self.config.get(*first)?, |value, key| value.get(*key))
    }

    /// A number of the config.
    pub(super) fn number(&self, path: &[&str]) -> Option<f64> {
        as_number(self.setting(path)?)
    }

    /// The i-th number of a list in the config.
    pub(super) fn number_at(&self, path: &[&str], i: usize) -> Option<f64> {
        as_number(self.setting(path)?.as_array()?.get(i)?)
    }

    /// The pairs of numbers in a list of the config.
    pub(super) fn windows(&self, path: &[&str]) -> Vec<(f64, f64)> {
        let list = self.setting(path).and_then(toml::Value::as_array);
        let pair = |pair: &toml::Value| Some((as_number(pair.get(0)?)?, as_number(pair.get(1)?)?));
        list.into_iter().flatten().filter_map(pair).collect()
    }

    /// The length T of a step in s.
    pub(super) fn step_s(&self) -> Option<f64> {
        let model = self.number(&["model", "horizon_s"]);
        let step = model.or_else(|| self.number(&["control", "step_s"]));
        step.filter(|t| *t > 0.0)
    }

    /// The top-level text `key`, from the config or else from the metrics.
    pub(super) fn title(&self, key: &str, key_in_metrics: &str) -> Option<String> {
        match self.config.get(key) {
            Some(toml::Value::String(text)) => Some(text.clone()),
            Some(value) => Some(value.to_string()),
            None => self.metrics[key_in_metrics].as_str().map(str::to_owned),
        }
    }

    /// A number of the metrics.
    pub(super) fn metric(&self, path: &[&str]) -> Option<f64> {
        find(&self.metrics, path)?.as_f64()
    }

    /// A model's name as the report writes it.
    pub(super) fn model_name(&self, model: &str) -> String {
        match self.metrics["training"]["source"].as_str() {
            Some("integrator") if model == ModelKind::Pinc.name() => DISTILLED.to_owned(),
            _ => {
                let kind = ModelKind::ALL.into_iter().find(|kind| kind.name() == model);
                kind.map_or(model, |kind| kind.title()).to_owned()
            }
        }
    }

    /// The metrics of one model's closed loop.
    pub(super) fn control_metrics(&self, model: &str) -> Option<&Value> {
        let runs = self.metrics["control"].as_array()?;
        runs.iter().find(|run| run["model"] == model)
    }

    /// A quantity with the unit of the controlled states, or of all states if none is controlled, to
    /// a power written as "²" or nothing.
    pub(super) fn label_in_states_unit(&self, quantity: &str, power: &str) -> String {
        let controlled = self.setting(&["control", "controlled"]).and_then(toml::Value::as_array);
        let controlled = controlled.into_iter().flatten().filter_map(toml::Value::as_str);
        let mut states: Vec<&str> = controlled.collect();
        if states.is_empty() {
            let all = self.metrics["states"].as_array();
            states = all.into_iter().flatten().filter_map(Value::as_str).collect();
        }
        match self.common_unit(&states) {
            None => quantity.to_owned(),
            Some("") => format!("{quantity} (–)"),
            Some(unit) => format!("{quantity} ({unit}{power})"),
        }
    }

    /// Variables with their units, as an axis says it: "h1, h2 (cm)", "x (m), v (m/s)"; "(–)" after a
    /// number without dimension.
    pub(super) fn axis_label(&self, variables: &[String]) -> String {
        let names: Vec<&str> = variables.iter().map(String::as_str).collect();
        if self.common_unit(&names).is_some() {
            return self.label_in_unit_of(&variables.join(", "), variables);
        }
        let each =
            |variable: &String| self.label_in_unit_of(variable, std::slice::from_ref(variable));
        variables.iter().map(each).collect::<Vec<_>>().join(", ")
    }

    /// `quantity` with the unit that `variables` have in common, if they have one.
    pub(super) fn label_in_unit_of(&self, quantity: &str, variables: &[String]) -> String {
        let names: Vec<&str> = variables.iter().map(String::as_str).collect();
        match self.common_unit(&names) {
            None => quantity.to_owned(),
            Some("") => format!("{quantity} (–)"),
            Some(unit) => format!("{quantity} ({unit})"),
        }
    }

    /// The unit of all these variables, empty for numbers without dimension; `None` if they differ
    /// or nothing is known.
    fn common_unit(&self, variables: &[&str]) -> Option<&str> {
        let unit = |variable: &str| self.metrics["variables"][variable].as_str();
        let first = unit(variables.first()?)?;
        variables.iter().all(|v| unit(v) == Some(first)).then_some(first)
    }
}

/// What a JSON value holds at a path of keys.
pub(super) fn find<'a>(value: &'a Value, path: &[&str]) -> Option<&'a Value> {
    path.iter().try_fold(value, |value, key| value.get(key))
}

/// What the report calls a net that was trained on an integrator's steps.
pub(super) const DISTILLED: &str = "distilled net";

fn as_number(value: &toml::Value) -> Option<f64> {
    #[expect(clippy::cast_precision_loss, reason = "settings are far below 2^53")]
    let whole = || value.as_integer().map(|i| i as f64);
    value.as_float().or_else(whole)
}

/// `<kind>-<model>.csv` of each model, or the `<kind>.csv` of a run with the `only` model.
fn read_models(dir: &Path, kind: &str, only: &str) -> Result<Vec<OfModel>, ReportError> {
    let mut found = Vec::new();
    for model in ModelKind::ALL.map(ModelKind::name) {
        if let Some(table) = Table::read(&dir.join(format!("{kind}-{model}.csv")))? {
            let model = model.to_owned();
            found.push(OfModel { model, table });
        }
    }
    if found.is_empty()
        && let Some(table) = Table::read(&dir.join(format!("{kind}.csv")))?
    {
        let model = only.to_owned();
        found.push(OfModel { model, table });
    }
    Ok(found)
}

fn read_text(path: &Path) -> Result<Option<String>, ReportError> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(source) if source.kind() == ErrorKind::NotFound => Ok(None),
        Err(source) => {
            let path = path.to_owned();
            Err(ReportError::Read { path, source })
        }
    }
}

fn read_json(path: &Path) -> Result<Value, ReportError> {
    let Some(text) = read_text(path)? else {
        return Ok(Value::Null);
    };
    serde_json::from_str(&text).map_err(|source| {
        let path = path.to_owned();
        ReportError::Json { path, source }
    })
}

fn parse_toml(path: &Path, text: &str) -> Result<toml::Table, ReportError> {
    text.parse().map_err(|source: toml::de::Error| {
        let start = source.span().map_or(0, |span| span.start);
        ReportError::Toml {
            path: path.to_owned(),
            line: text.bytes().take(start).filter(|b| *b == b'\n').count() + 1,
            source: Box::new(source),
        }
    })
}
