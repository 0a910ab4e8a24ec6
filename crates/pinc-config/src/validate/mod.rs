//! Checks of a config that its types cannot make.

mod black_box;
mod control;
mod cost;
mod estimator;
mod free_time;
mod identify;
mod integer;
pub(crate) mod limits;
mod names;
mod scenarios;
mod schedule;
mod stages;
mod uncertainty;
pub(crate) mod values;

pub(crate) use values::rounded;

use crate::plants::Plants;
use crate::registry::Variables;
use crate::{
    CostSpec, DataSpec, Experiment, ModelKind, OwnPlantSpec, PlantSpec, PredictionSpec, Problem,
    TrainingSpec,
};
use control::closed_loop;
use pinc_expr::ExpressionError;
use pinc_net::{Ansatz, NetError, ResidualScale, Scenario, TrainingTarget, ValidationConfig};
use pinc_ode::Dims;
use pinc_toml::nearest;
use std::path::PathBuf;
use values::{
    CONTROLLED, at_least_one, bounds, each, length, named_tolerances, positive, present, tolerance,
    value, whole_steps,
};

/// The key and what is wrong with its value.
pub(crate) type Checked = Result<(), (String, Problem)>;

impl Experiment {
    /// Checks that the values make sense by themselves and together.
    pub(crate) fn validate(&self) -> Checked {
        self.all_sections().map_err(|(key, problem)| (key, self.with_names(problem)))
    }

    /// Names what a list of the wrong length has one value for.
    fn with_names(&self, problem: Problem) -> Problem {
        let Problem::Length { found, expected, per, names } = problem else { return problem };
        let variables = self.plant.variables();
        let control = self.control.as_ref();
        let known = match per {
            "state" => variables.state_names(),
            "input" => variables.input_names(),
            "output" => variables.own_output_names(),
            CONTROLLED => control.map_or_else(Vec::new, |control| control.controlled.clone()),
            _ => Vec::new(),
        };
        let names = if known.len() == expected { known } else { names };
        Problem::Length { found, expected, per, names }
    }

    fn all_sections(&self) -> Checked {
        directory_name(&self.name)?;
        plant("plant", &self.plant, self)?;
        let variables = self.plant.variables();
        names::printable("plant", &self.plant)?;
        if let Some(own) = self.control.as_ref().and_then(|control| control.plant.as_ref()) {
            plant("control.plant", own, self)?;
            names::printable("control.plant", own)?;
        }
        names::column_names(&self.plant, &variables)?;
        names::varying_parameters(self)?;
        let dims = self.dims();
        self.sections(dims)?;
        black_box::uses(self)?;
        limits::sizes(self, dims)?;
        if let Some(validation) = &self.validation {
            validation_scenarios(validation, dims, self.net_step_s())?;
        }
        if let Some(prediction) = &self.prediction {
            free_run(prediction, &variables, self.net_step_s())?;
        }
        if let Some(control) = &self.control {
            closed_loop(control, &variables)?;
            cost::expressions(self, control, &variables)?;
            free_time::free_time(self, control, &variables)?;
            integer::whole(control, &variables)?;
            integer::target(control)?;
            schedule::times(control, self.sample_time_s())?;
            estimator::output_feedback(self, control, &variables)?;
            schedule::schedules(self, control)?;
            scenarios::scenarios(self, control)?;
            uncertainty::uncertainty(self, control, &variables)?;
        }
        if let Some(one_step) = &self.one_step {
            let needed = "[one_step] needs it";
            present("control", self.control.is_some(), needed)?;
            present("domain", self.domain.is_some(), needed)?;
            at_least_one("one_step.points", one_step.points)?;
            tolerance("one_step.tolerance", one_step.tolerance)?;
            positive("one_step.measure_s", one_step.measure_s)?;
        }
        if let Some(identify) = &self.identify {
            identify::identification(self, identify, &variables)?;
        }
        if let Some(tune) = &self.tune {
            tune.validate(self)?;
        }
        if let Some(sweep) = &self.sweep {
            sweep.validate(self.control.is_some())?;
            crate::trial::check(self)?;
        }
        Ok(())
    }

    /// Checks that the closed loop ends, and that everything in it begins and ends, with a step of
    /// `sample_time_s`: for a config that leaves the length of a step to a trained net.
    ///
    /// # Errors
    ///
    /// The key of the first time between two steps, and what it should be.
    pub fn check_step_marks(&self, sample_time_s: f64) -> Result<(), (String, Problem)> {
        let control = self.control.as_ref();
        control.map_or(Ok(()), |control| schedule::times(control, Some(sample_time_s)))
    }

    fn is_distilled(&self) -> bool {
        self.training.as_ref().is_some_and(|t| t.config.source == TrainingTarget::Integrator)
    }

    fn sections(&self, dims: Dims) -> Checked {
        if let Some(model) = &self.model {
            model.validate(dims).map_err(|error| net_finding("model", &error))?;
            let loops = self.control.as_ref().map_or(&[][..], |control| &control.models);
            if self.is_distilled()
                && (model.ansatz != Ansatz::HardLinear || model.time_only.is_some())
            {
                let expected =
                    "\"physics\" for a net of one scenario or without the ansatz \"hard-linear\"";
                return value("training.source", "\"integrator\"", expected);
            }
            if let Some(scenario) = &model.time_only {
                if loops.contains(&ModelKind::Pinc) {
                    let expected = "no such key with the model \"pinc\" in [control]";
                    return value("model.time_only", "a single scenario", expected);
                }
                if let Some(prediction) = &self.prediction {
                    free_run_of_scenario(prediction, scenario)?;
                }
            }
        }
        if let Some(domain) = &self.domain {
            domain.validate(dims).map_err(|error| net_finding("domain", &error))?;
        }
        if let Some(training) = &self.training {
            training_choices(training, dims)?;
            let (key, proven) = ("training.proven_tolerance", &training.proven_tolerance);
            named_tolerances(key, proven, &self.plant.variables())?;
            let unknown = self.data.as_ref().is_some_and(|data| !data.parameters.is_empty());
            let listed = || self.plant.equations().is_some_and(|of| of.listing(&[]).is_ok());
            if !proven.is_empty() && (unknown || !listed()) {
                let expected = "no such key with data.parameters or algebraic variables";
                return value(key, "a table", expected);
            }
            let needed = "training needs it";
            present("model", self.model.is_some(), needed)?;
            present("domain", self.domain.is_some(), needed)?;
            present("validation", self.validation.is_some(), needed)?;
        }
        if let Some(data) = &self.data {
            present("training", self.training.is_some(), "[data] needs it")?;
            if self.is_distilled() {
                let expected = "\"physics\" with [data]";
                return value("training.source", "\"integrator\"", expected);
            }
            measurements(data)?;
            names::unknown_parameters(self, data)?;
            if self.model.as_ref().is_some_and(|model| model.time_only.is_some()) {
                let expected = "no such key with [data], which has several scenarios";
                return value("model.time_only", "a single scenario", expected);
            }
        }
        if let Some(control) = &self.control {
            stages::lengths(control, self.model.as_ref(), self.is_distilled())?;
        }
        if let (Some(model), Some(step_s)) =
            (&self.model, self.control.as_ref().and_then(|c| c.step_s))
            && self.control.as_ref().is_none_or(|control| control.stages_s.is_none())
            && model.sample_time_s.total_cmp(&step_s).is_ne()
        {
            let expected = format!("model.horizon_s, {}, or no such key", model.sample_time_s);
            return value("control.step_s", step_s, &expected);
        }
        Ok(())
    }
}

/// A finding from an error of pinc-net about one of its settings in `section`.
fn net_finding(section: &str, error: &NetError) -> (String, Problem) {
    match error {
        NetError::Setting { key, found, expected } => {
            let problem = Problem::Value { found: found.clone(), expected: (*expected).to_owned() };
            (format!("{section}.{key}"), problem)
        }
        NetError::Dimension { key, found, expected, per } => {
            let (found, expected, names) = (*found, *expected, Vec::new());
            (format!("{section}.{key}"), Problem::Length { found, expected, per, names })
        }
        other => (section.to_owned(), Problem::Type(other.to_string())),
    }
}

pub(crate) fn directory_name(name: &str) -> Checked {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.starts_with(|c: char| c.is_ascii_alphanumeric()) && name.chars().all(allowed) {
        return Ok(());
    }
    let expected = "a name for a directory: letters, digits, -, _ and ., a letter or digit first";
    value("name", format!("{name:?}"), expected)
}

/// A plant under the key `key`.
fn plant(key: &str, plant: &PlantSpec, experiment: &Experiment) -> Checked {
    let (place, plants) = (key, experiment.plants());
    match plant {
        PlantSpec::VanDerPol(spec) if spec.mu < 0.0 => {
            value(&format!("{key}.van-der-pol.mu"), spec.mu, "0 or a positive number")
        }
        PlantSpec::FourTanks(spec) => {
            let key = format!("{key}.four-tanks");
            for (i, &gamma) in spec.gamma.iter().flatten().enumerate() {
                if !(0.0..=1.0).contains(&gamma) {
                    return value(&format!("{key}.gamma[{i}]"), gamma, "a share from 0 to 1");
                }
            }
            each(&format!("{key}.pump"), spec.pump.as_slice().as_flattened(), positive)?;
            constants(place, plant)
        }
        PlantSpec::Expression(equations) => {
            let costs = experiment.control.iter().filter_map(|control| control.cost.as_ref());
            let costs: Vec<_> = costs.flat_map(CostSpec::texts).collect();
            let compiled = equations.compile_beside(&costs);
            compiled.map(drop).map_err(|error| expression_finding(key, error))
        }
        PlantSpec::Process(spec) => black_box::program(key, spec, plants),
        PlantSpec::Fmu(spec) => black_box::fmu(key, spec, plants),
        PlantSpec::Own(spec) => own_plant(&format!("{key}.own"), spec, plants),
        built_in => constants(key, built_in),
    }
}

/// The constants of a built-in plant.
fn constants(key: &str, plant: &PlantSpec) -> Checked {
    let known = plant.parameter_names();
    for (name, &number) in plant.constants().into_iter().flatten() {
        let key = format!("{key}.{}.constants.{name}", plant.name());
        if !known.contains(name) {
            let expected = match nearest(name, &known) {
                Some(nearest) => format!("one of its constants: did you mean `{nearest}`?"),
                None => format!("one of {}", known.join(", ")),
            };
            return value(&key, "a constant that the plant does not have", &expected);
        }
        if !number.is_finite() {
            return value(&key, number, "a finite number");
        }
    }
    Ok(())
}

/// A finding from an error in the equations of the plant under `key`.
pub(crate) fn expression_finding(key: &str, error: ExpressionError) -> (String, Problem) {
    let misspelt = error.problem.misspelt();
    let nearest = misspelt.and_then(|(found, known)| nearest(found, known));
    let key = format!("{key}.expression.{}", error.key);
    (key, Problem::Expression { error: Box::new(error), nearest })
}

fn own_plant(key: &str, spec: &OwnPlantSpec, plants: &Plants) -> Checked {
    let Some((name, _)) = spec.parts() else {
        return value(key, "none or several plants", "one, as [plant.own.pendulum]");
    };
    let key = format!("{key}.{name}");
    match spec.build() {
        Some(Ok(_)) => Ok(()),
        Some(Err(error)) => {
            let found = format!("unusable parameters ({})", error.message());
            value(&key, found, "parameters of the plant's type")
        }
        None => {
            let expected = match &plants.names()[..] {
                [] => {
                    "a built-in plant, or a program that adds it (pinc_config::Plants)".to_owned()
                }
                known => format!("one of {}", known.join(", ")),
            };
            value(&key, "a plant that this program does not know", &expected)
        }
    }
}

fn training_choices(spec: &TrainingSpec, dims: Dims) -> Checked {
    if let Some(limit) = spec.effort.time_limit_s {
        positive("training.time_limit_s", limit)?;
    }
    positive("training.checkpoint_every_s", spec.effort.checkpoint_every_s)?;
    let config = &spec.config;
    positive("training.lambda", config.lambda)?;
    if let ResidualScale::Custom(factors) = &config.residual_scale {
        let key = "training.residual_scale.custom";
        length(key, factors, dims.nx, "state")?;
        each(key, factors, positive)?;
    }
    for (i, phase) in config.phases.iter().enumerate() {
        let key = format!("training.phases[{i}].optimizer");
        phase.optimizer.validate().map_err(|error| net_finding(&key, &error))?;
    }
    config.validate().map_err(|error| net_finding("training", &error))
}

/// The first of `files` that is among `others` or the files before it.
pub fn repeated_file(others: &[PathBuf], files: &[PathBuf]) -> Option<usize> {
    (0..files.len()).find(|&i| others.contains(&files[i]) || files[..i].contains(&files[i]))
}

fn measurements(spec: &DataSpec) -> Checked {
    if spec.files.is_empty() {
        return value("data.files", "[]", "at least one CSV file");
    }
    if let Some(i) = repeated_file(&[], &spec.files) {
        let file = spec.files[i].display().to_string();
        return value(&format!("data.files[{i}]"), file, "each file once");
    }
    if let Some(i) = repeated_file(&spec.files, &spec.held_out) {
        let file = spec.held_out[i].display().to_string();
        let expected = "a file that is not in data.files, and each once";
        return value(&format!("data.held_out[{i}]"), file, expected);
    }
    positive("data.weight", spec.weight)
}

fn validation_scenarios(
    spec: &ValidationConfig,
    dims: Dims,
    sample_time_s: Option<f64>,
) -> Checked {
    whole_steps("validation.duration_s", spec.duration_s, sample_time_s)?;
    at_least_one("validation.scenarios", spec.scenarios)?;
    at_least_one("validation.subintervals", spec.subintervals)?;
    at_least_one("validation.one_step_points", spec.one_step_points)?;
    tolerance("validation.tolerance", spec.tolerance)?;
    spec.domain.validate(dims).map_err(|error| net_finding("validation.domain", &error))
}

fn free_run(spec: &PredictionSpec, variables: &Variables, sample_time_s: Option<f64>) -> Checked {
    whole_steps("prediction.duration_s", spec.duration_s, sample_time_s)?;
    at_least_one("prediction.subintervals", spec.subintervals)?;
    tolerance("prediction.tolerance", spec.tolerance)?;
    let states = variables.states.len();
    length("prediction.initial_state", &spec.initial_state, states, "state")?;
    let inputs = variables.inputs.len();
    let sides = [&spec.input_low, &spec.input_high].map(|side| Some(&side[..]));
    bounds("prediction.input_", sides, inputs, "input")
}

/// A conventional PINN knows one scenario, so that it can run freely in that one only.
fn free_run_of_scenario(spec: &PredictionSpec, scenario: &Scenario) -> Checked {
    for (key, found, known) in [
        ("initial_state", &spec.initial_state, &scenario.initial_state),
        ("input_low", &spec.input_low, &scenario.input),
        ("input_high", &spec.input_high, &scenario.input),
    ] {
        if found != known {
            let expected = format!("{known:?}, the scenario of model.time_only");
            return value(&format!("prediction.{key}"), format!("{found:?}"), &expected);
        }
    }
    Ok(())
}
