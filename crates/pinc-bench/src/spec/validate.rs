//! Checks of a config that its types cannot make.

use super::{
    ControlSpec, DataSpec, Experiment, ModelKind, PlantSpec, PredictionSpec, Problem, TrainingSpec,
    nearest,
};
use crate::registry::Variables;
use pinc_mpc::{MpcError, Weight};
use pinc_net::{NetError, ResidualScale, Scenario, ValidationConfig};
use pinc_ode::Dims;

/// The key and what is wrong with its value.
type Finding = Result<(), (String, Problem)>;

impl Experiment {
    /// Checks that the values make sense by themselves and together.
    pub(super) fn validate(&self) -> Finding {
        directory_name(&self.name)?;
        plant("plant", &self.plant)?;
        let variables = self.plant.variables();
        let dims = Dims { states: variables.states.len(), inputs: variables.inputs.len() };
        self.sections(dims)?;
        if let Some(validation) = &self.validation {
            validation_scenarios(validation, dims, self.horizon_s())?;
        }
        if let Some(prediction) = &self.prediction {
            free_run(prediction, &variables, self.horizon_s())?;
        }
        if let Some(control) = &self.control {
            closed_loop(control, &variables, self.horizon_s())?;
        }
        if let Some(sweep) = &self.sweep {
            sweep.validate()?;
            crate::sweep::trials(self)?;
        }
        Ok(())
    }

    fn sections(&self, dims: Dims) -> Finding {
        if let Some(model) = &self.model {
            model.validate(dims).map_err(|error| net_finding("model", &error))?;
            let loops = self.control.as_ref().map_or(&[][..], |control| &control.models);
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
            let needed = "training needs it";
            present("model", self.model.is_some(), needed)?;
            present("domain", self.domain.is_some(), needed)?;
            present("validation", self.validation.is_some(), needed)?;
        }
        if let Some(data) = &self.data {
            present("training", self.training.is_some(), "[data] is for a training")?;
            measurements(data)?;
            if self.model.as_ref().is_some_and(|model| model.time_only.is_some()) {
                let expected = "no such key with [data], whose scenarios differ";
                return value("model.time_only", "a single scenario", expected);
            }
        }
        if let (Some(model), Some(step_s)) =
            (&self.model, self.control.as_ref().and_then(|c| c.step_s))
            && model.horizon_s.total_cmp(&step_s).is_ne()
        {
            let expected = format!("model.horizon_s, {}, or no such key", model.horizon_s);
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
            let problem = Problem::Length { found: *found, expected: *expected, per };
            (format!("{section}.{key}"), problem)
        }
        other => (section.to_owned(), Problem::Type(other.to_string())),
    }
}

pub(super) fn directory_name(name: &str) -> Finding {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.starts_with(|c: char| c.is_ascii_alphanumeric()) && name.chars().all(allowed) {
        return Ok(());
    }
    let expected = "a name for a directory: letters, digits, -, _ and ., a letter or digit first";
    value("name", format!("{name:?}"), expected)
}

fn plant(key: &str, plant: &PlantSpec) -> Finding {
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
            for (i, &pump) in spec.pump.iter().flatten().enumerate() {
                positive(&format!("{key}.pump[{i}]"), pump)?;
            }
            Ok(())
        }
        PlantSpec::Expression(equations) => match equations.compile() {
            Ok(_) => Ok(()),
            Err(error) => {
                let misspelt = error.problem.misspelt();
                let nearest = misspelt.and_then(|(found, known)| nearest(found, known));
                let key = format!("plant.expression.{}", error.key);
                Err((key, Problem::Expression { error: Box::new(error), nearest }))
            }
        },
        _ => Ok(()),
    }
}

/// The plant in the loop: it has the states and inputs of the one that the models are of.
fn plant_in_the_loop(spec: &ControlSpec, variables: &Variables) -> Finding {
    let Some(real) = &spec.plant else { return Ok(()) };
    plant("control.plant", real)?;
    let found = real.variables();
    for (what, found, expected) in [
        ("states", found.state_names(), variables.state_names()),
        ("inputs", found.input_names(), variables.input_names()),
    ] {
        if found != expected {
            let expected = format!("one with the {what} {}", expected.join(", "));
            let found = format!("a plant with the {what} {}", found.join(", "));
            return value("control.plant", found, &expected);
        }
    }
    Ok(())
}

/// A finding from an error of pinc-mpc about the control problem.
fn mpc_finding(error: &MpcError) -> (String, Problem) {
    let (field, found, expected) = match error {
        MpcError::Number { field, value, expected, .. } => {
            (*field, value.to_string(), (*expected).to_owned())
        }
        MpcError::Length { field, found, expected } => {
            (*field, format!("{found} numbers"), format!("{expected}"))
        }
        MpcError::Range { field, found, low, high } => {
            (*field, found.to_string(), format!("from {low} to {high}"))
        }
        MpcError::NotSymmetric { field, .. } => {
            (*field, "rows".into(), "a symmetric matrix".into())
        }
        MpcError::NotSemidefinite { field } => {
            (*field, "rows".into(), "a positive semidefinite matrix".into())
        }
        other => ("", "values".into(), other.to_string()),
    };
    let key = match field {
        "weights.q" => "control.q",
        "weights.r" => "control.r",
        "weights.terminal" => "control.q_terminal",
        "state_softness" => "control.state_softness.penalty",
        "increment_bounds" => "control.increment_low, control.increment_high",
        "delay" => "control.delay_steps",
        "last (N2)" => "control.n2",
        _ => "control",
    };
    (key.to_owned(), Problem::Value { found, expected })
}

fn training_choices(spec: &TrainingSpec, dims: Dims) -> Finding {
    if let Some(limit) = spec.effort.time_limit_s {
        positive("training.time_limit_s", limit)?;
    }
    positive("training.checkpoint_every_s", spec.effort.checkpoint_every_s)?;
    let config = &spec.config;
    positive("training.lambda", config.lambda)?;
    if let ResidualScale::Custom(factors) = &config.residual_scale {
        let key = "training.residual_scale.custom";
        length(key, factors, dims.states, "state")?;
        for (i, &factor) in factors.iter().enumerate() {
            positive(&format!("{key}[{i}]"), factor)?;
        }
    }
    for (i, phase) in config.phases.iter().enumerate() {
        let key = format!("training.phases[{i}].optimizer");
        phase.optimizer.validate().map_err(|error| net_finding(&key, &error))?;
    }
    config.validate().map_err(|error| net_finding("training", &error))
}

fn measurements(spec: &DataSpec) -> Finding {
    if spec.files.is_empty() {
        return value("data.files", "[]", "at least one CSV file");
    }
    positive("data.weight", spec.weight)
}

fn validation_scenarios(spec: &ValidationConfig, dims: Dims, horizon_s: Option<f64>) -> Finding {
    whole_steps("validation.duration_s", spec.duration_s, horizon_s)?;
    at_least_one("validation.scenarios", spec.scenarios)?;
    at_least_one("validation.subintervals", spec.subintervals)?;
    at_least_one("validation.one_step_points", spec.one_step_points)?;
    tolerance("validation.tolerance", spec.tolerance)?;
    spec.domain.validate(dims).map_err(|error| net_finding("validation.domain", &error))
}

fn free_run(spec: &PredictionSpec, variables: &Variables, horizon_s: Option<f64>) -> Finding {
    whole_steps("prediction.duration_s", spec.duration_s, horizon_s)?;
    at_least_one("prediction.subintervals", spec.subintervals)?;
    tolerance("prediction.tolerance", spec.tolerance)?;
    let states = variables.states.len();
    length("prediction.initial_state", &spec.initial_state, states, "state")?;
    let inputs = variables.inputs.len();
    bounds("prediction.input", &spec.input_low, &spec.input_high, inputs, "input")
}

/// A conventional PINN knows one scenario, so that it can run freely in that one only.
fn free_run_of_scenario(spec: &PredictionSpec, scenario: &Scenario) -> Finding {
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

fn closed_loop(spec: &ControlSpec, variables: &Variables, horizon_s: Option<f64>) -> Finding {
    let (states, inputs) = (variables.states.len(), variables.inputs.len());
    models(spec)?;
    plant_in_the_loop(spec, variables)?;
    whole_steps("control.duration_s", spec.duration_s, horizon_s)?;
    if let Some(step_s) = spec.step_s {
        positive("control.step_s", step_s)?;
    }
    length("control.initial_state", &spec.initial_state, states, "state")?;
    controlled(spec, variables)?;
    horizons(spec)?;
    weights("control.q", &spec.q, spec.controlled.len(), "controlled state")?;
    weights("control.r", &spec.r, inputs, "input")?;
    let terminal = spec.q_terminal.as_ref();
    terminal.map_or(Ok(()), |q| {
        weights("control.q_terminal", q, spec.controlled.len(), "controlled state")
    })?;
    bounds("control.input", &spec.input_low, &spec.input_high, inputs, "input")?;
    for (key, side) in [("state_low", &spec.state_low), ("state_high", &spec.state_high)] {
        if let Some(side) = side {
            length(&format!("control.{key}"), side, states, "state")?;
        }
    }
    if let (Some(low), Some(high)) = (&spec.state_low, &spec.state_high) {
        bounds("control.state", low, high, states, "state")?;
    }
    close_ups(spec)?;
    at_least_one("control.rk4_substeps", spec.rk4_substeps)?;
    at_least_one("control.rosenbrock_substeps", spec.rosenbrock_substeps)?;
    at_least_one("control.repetitions", spec.repetitions)?;
    tolerance("control.plant_tolerance", spec.plant_tolerance)?;
    positive("control.sqp.tolerance", spec.sqp.tolerance)?;
    at_least_one("control.sqp.max_iterations", spec.sqp.max_iterations)?;
    if let Some(budget_us) = spec.budget_us {
        positive("control.budget_us", budget_us)?;
    }
    references(spec)?;
    let names: Vec<&str> = variables.states.iter().map(|state| &*state.name).collect();
    let problem = spec.problem(&names, inputs);
    problem.validate(Dims { states, inputs }).map_err(|error| mpc_finding(&error))
}

fn models(spec: &ControlSpec) -> Finding {
    let twice = |kind: ModelKind| spec.models.iter().filter(|&&m| m == kind).count() > 1;
    if spec.models.is_empty() || spec.models.iter().any(|&kind| twice(kind)) {
        let names: Vec<_> = spec.models.iter().map(|m| m.name()).collect();
        let expected = "one or more of \"pinc\", \"rk4\", \"rosenbrock\", each once";
        return value("control.models", format!("{names:?}"), expected);
    }
    Ok(())
}

fn close_ups(spec: &ControlSpec) -> Finding {
    for (i, window) in spec.close_ups_s.iter().enumerate() {
        let [from, to] = *window;
        if !(0.0 <= from && from < to && from < spec.duration_s) {
            let expected =
                format!("[from, to], from 0 to {} s, the first one less", spec.duration_s);
            return value(&format!("control.close_ups_s[{i}]"), format!("{window:?}"), &expected);
        }
    }
    Ok(())
}

fn controlled(spec: &ControlSpec, variables: &Variables) -> Finding {
    let known = variables.state_names();
    if spec.controlled.is_empty() {
        let expected = format!("one or more of the states {}", known.join(", "));
        return value("control.controlled", "[]", &expected);
    }
    for (i, name) in spec.controlled.iter().enumerate() {
        let key = format!("control.controlled[{i}]");
        if !known.contains(name) {
            let nearest = nearest(name, &known);
            return Err((key, Problem::Word { found: name.clone(), known, nearest }));
        }
        if spec.controlled[..i].contains(name) {
            return value(&key, format!("{name:?}"), "each state once");
        }
    }
    Ok(())
}

fn horizons(spec: &ControlSpec) -> Finding {
    at_least_one("control.n2", spec.n2)?;
    for (key, steps) in [("control.n1", spec.n1), ("control.nu", spec.nu)] {
        if !(1..=spec.n2).contains(&steps) {
            return value(key, steps, &format!("from 1 to n2 = {}", spec.n2));
        }
    }
    Ok(())
}

fn references(spec: &ControlSpec) -> Finding {
    if spec.references.is_empty() {
        return value("control.references", "[]", "at least one { start_s, value }");
    }
    let mut previous = None;
    for (i, step) in spec.references.iter().enumerate() {
        let key = format!("control.references[{i}]");
        let start = format!("{key}.start_s");
        match previous {
            None if step.start_s != 0.0 => {
                return value(&start, step.start_s, "0, since the first reference begins the run");
            }
            Some(before) if step.start_s <= before => {
                return value(&start, step.start_s, &format!("more than {before}, the one before"));
            }
            _ => previous = Some(step.start_s),
        }
        let value = format!("{key}.value");
        length(&value, &step.value, spec.controlled.len(), "controlled state")?;
    }
    Ok(())
}

fn value(key: &str, found: impl ToString, expected: &str) -> Finding {
    let problem = Problem::Value { found: found.to_string(), expected: expected.to_owned() };
    Err((key.to_owned(), problem))
}

fn present(section: &'static str, is: bool, needed: &'static str) -> Finding {
    if is { Ok(()) } else { Err((section.to_owned(), Problem::Section(needed))) }
}

fn positive(key: &str, number: f64) -> Finding {
    if number > 0.0 { Ok(()) } else { value(key, number, "a positive number") }
}

fn tolerance(key: &str, number: f64) -> Finding {
    if number > 0.0 && number < 1.0 {
        Ok(())
    } else {
        value(key, number, "a number between 0 and 1")
    }
}

fn at_least_one(key: &str, number: usize) -> Finding {
    if number > 0 { Ok(()) } else { value(key, number, "1 or more") }
}

fn length(key: &str, values: &[f64], expected: usize, per: &'static str) -> Finding {
    let found = values.len();
    if found == expected {
        Ok(())
    } else {
        Err((key.to_owned(), Problem::Length { found, expected, per }))
    }
}

fn weights(key: &str, weight: &Weight, expected: usize, per: &'static str) -> Finding {
    let diagonal = match weight {
        Weight::Diagonal(diagonal) => diagonal,
        Weight::Full(rows) => {
            let problem = Problem::Length { found: rows.len(), expected, per };
            let lengths = rows.iter().map(Vec::len).chain([rows.len()]);
            return if lengths.into_iter().all(|found| found == expected) {
                Ok(())
            } else {
                Err((key.to_owned(), problem))
            };
        }
    };
    length(key, diagonal, expected, per)?;
    match diagonal.iter().position(|&w| w < 0.0) {
        Some(i) => value(&format!("{key}[{i}]"), diagonal[i], "0 or a positive number"),
        None => Ok(()),
    }
}

/// The lists `<key>_low` and `<key>_high`.
fn bounds(key: &str, low: &[f64], high: &[f64], expected: usize, per: &'static str) -> Finding {
    length(&format!("{key}_low"), low, expected, per)?;
    length(&format!("{key}_high"), high, expected, per)?;
    for (i, (low, high)) in low.iter().zip(high).enumerate() {
        if low > high {
            let expected = format!("at most the upper end, {high}");
            return value(&format!("{key}_low[{i}]"), low, &expected);
        }
    }
    Ok(())
}

/// Whether a duration is a positive whole number of T, to a relative 1e-9.
fn whole_steps(key: &str, duration_s: f64, horizon_s: Option<f64>) -> Finding {
    positive(key, duration_s)?;
    if let Some(horizon_s) = horizon_s {
        let steps = duration_s / horizon_s;
        if steps.round() < 1.0 || (steps - steps.round()).abs() > 1e-9 * steps {
            let expected = format!("a whole number of steps of T = {horizon_s} s");
            return value(key, duration_s, &expected);
        }
    }
    Ok(())
}
