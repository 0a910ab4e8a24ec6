//! Requests and answers.

use pinc_mpc::{Bounds, Trust};
use pinc_ode::Variable;
use pinc_runs::{Follow, LiveController, LiveState};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A line from the plant.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    /// What is to be done instead of a step.
    command: Option<Command>,
    /// The state of a controller that this one is to go on from.
    state: Option<LiveState>,
    /// The measured values: all states, or the estimator's measurements; null or NaN is missing.
    y: Option<Vec<Option<f64>>>,
    /// What is to be followed, in place of the config's references.
    reference: Option<Window>,
    /// The input that the plant was really given since the last line.
    u_applied: Option<Vec<f64>>,
    /// What the parameters of `control.measured_parameters` are; as before if absent.
    parameters: Option<Vec<f64>>,
    /// The time that the step may take, in us, in place of the config's.
    budget_us: Option<f64>,
}

/// What is done instead of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Command {
    /// Say what is served: names, units, bounds, times.
    Describe,
    /// Forget everything: the next step is again the first.
    Reset,
    /// Give the state of the controller.
    Save,
    /// Go on from a state that was saved.
    Restore,
}

/// What is served.
#[derive(Serialize)]
struct Description<'a> {
    version: &'static str,
    model: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    model_sha256: Option<&'a str>,
    sample_time_s: f64,
    /// The rows of a reference for the whole horizon.
    horizon: usize,
    delay_steps: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    budget_us: Option<f64>,
    states: Vec<Quantity<'a>>,
    inputs: Vec<Quantity<'a>>,
    /// The order of `y`.
    measured: Vec<String>,
    /// The columns of a reference.
    controlled: &'a [String],
    /// The order of `unknowns` in answers.
    unknowns: &'a [String],
    /// The order of `parameters`.
    parameters: &'a [String],
}

/// A state or an input; bounds that are not there are left out.
#[derive(Serialize)]
struct Quantity<'a> {
    name: &'a str,
    unit: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    low: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    high: Option<f64>,
}

/// The answer to `reset` and `restore`.
#[derive(Serialize)]
struct Done {
    done: &'static str,
}

/// The answer to `save`.
#[derive(Serialize)]
struct Saved {
    state: LiveState,
}

/// A reference: for the whole horizon, or a row per stage.
#[derive(Deserialize)]
#[serde(untagged, expecting = "`reference`: expected numbers, or a row of numbers per stage")]
enum Window {
    Held(Vec<f64>),
    Stages(Vec<Vec<f64>>),
}

/// The answer.
#[derive(Serialize)]
struct Answer<'a> {
    u: &'a [f64],
    status: String,
    /// The state that the controller took the plant to be in.
    x: &'a [f64],
    /// The estimated disturbances and parameters, and how the estimator's step ended.
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    unknowns: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    estimator: Option<String>,
    /// With `control.cost`: the plan's cost, and whether negative curvature was dropped.
    #[serde(skip_serializing_if = "Option::is_none")]
    cost: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    curvature_dropped: Option<bool>,
    /// In a step that tried several starts: from which the plan was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    start: Option<usize>,
    /// With `control.target`: whether a steady state was found for each row of the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    target_found: Option<bool>,
    /// With a tube: whether the plan keeps the tightened bounds.
    #[serde(skip_serializing_if = "Option::is_none")]
    in_tube: Option<bool>,
    step_us: f64,
    /// With `control.error_tolerance`: whether the net was trusted in the plan's first step, and its
    /// estimated error there.
    #[serde(skip_serializing_if = "Option::is_none")]
    trust: Option<String>,
    #[serde(skip_serializing_if = "<[f64]>::is_empty")]
    model_error: &'a [f64],
}

/// The answer to a line that cannot be used; nothing has happened then.
#[derive(Serialize)]
struct Refusal<'a> {
    error: &'a str,
}

/// The answer that says what is wrong with a line.
pub(super) fn refusal(error: &str) -> String {
    text(&Refusal { error })
}

/// The answer to a line, or what is wrong with it.
pub(super) fn answer(controller: &mut LiveController, line: &[u8]) -> Result<String, String> {
    // Fields are known by their names alone.
    let is_object = line.trim_ascii_start().first() == Some(&b'{');
    let request = match is_object {
        true => serde_json::from_slice(&with_nulls(line)).map_err(|error| error.to_string()),
        false => Err("not an object".to_owned()),
    };
    let request: Request = request.map_err(|error| {
        format!(
            "{error}; expected {{\"y\": [..], \"reference\": [..], \"u_applied\": [..], \
             \"parameters\": [..], \"budget_us\": ..}} or {{\"command\": \"describe\"}} \
             (also reset, save, and restore with \"state\": {{..}})"
        )
    })?;
    match request.command {
        Some(command) => done(controller, command, &request),
        None => step(controller, &request),
    }
}

/// Carries out a command that is no step.
fn done(
    controller: &mut LiveController,
    command: Command,
    request: &Request,
) -> Result<String, String> {
    let is_step = request.y.is_some()
        || request.reference.is_some()
        || request.u_applied.is_some()
        || request.parameters.is_some()
        || request.budget_us.is_some();
    if is_step {
        return Err("a line is a command or a step, not both".to_owned());
    }
    match (command, &request.state) {
        (Command::Describe, None) => Ok(text(&Description::of(controller))),
        (Command::Reset, None) => {
            controller.reset().map_err(|error| error.to_string())?;
            Ok(text(&Done { done: "reset" }))
        }
        (Command::Save, None) => Ok(text(&Saved { state: controller.state() })),
        (Command::Restore, Some(state)) => {
            controller.set_state(state).map_err(|error| error.to_string())?;
            Ok(text(&Done { done: "restore" }))
        }
        (Command::Restore, None) => Err("restore: expected \"state\": {..} beside it".to_owned()),
        (Command::Describe | Command::Reset | Command::Save, Some(_)) => {
            Err("\"state\" goes with the command restore only".to_owned())
        }
    }
}

impl<'a> Description<'a> {
    fn of(controller: &'a LiveController) -> Self {
        let (spec, variables) = (controller.spec(), controller.variables());
        let problem = controller.nmpc().problem();
        Self {
            version: pinc_runs::VERSION,
            model: controller.kind().name(),
            model_sha256: controller.model_sha256(),
            sample_time_s: controller.nmpc().model().sample_time_s(),
            horizon: spec.n2,
            delay_steps: spec.delay_steps,
            budget_us: spec.budget_us,
            states: quantities(&variables.states, &problem.state_bounds),
            inputs: quantities(&variables.inputs, &problem.input_bounds),
            measured: controller.measured(),
            controlled: &spec.controlled,
            unknowns: controller.unknowns(),
            parameters: &spec.measured_parameters,
        }
    }
}

/// Variables with their bounds, where these are finite.
fn quantities<'a>(variables: &'a [Variable], bounds: &Bounds) -> Vec<Quantity<'a>> {
    let bound = |bounds: &[f64], i: usize| bounds.get(i).copied().filter(|b| b.is_finite());
    let quantity = |(i, variable): (usize, &'a Variable)| Quantity {
        name: &variable.name,
        unit: &variable.unit,
        low: bound(&bounds.low, i),
        high: bound(&bounds.high, i),
    };
    variables.iter().enumerate().map(quantity).collect()
}

fn step(controller: &mut LiveController, request: &Request) -> Result<String, String> {
    if request.state.is_some() {
        return Err("\"state\" goes with the command restore only".to_owned());
    }
    let y = request.y.as_deref().ok_or("missing field `y`; expected {\"y\": [..]}")?;
    // What is missing is NaN.
    let y: Vec<f64> = y.iter().map(|y| y.unwrap_or(f64::NAN)).collect();
    let follow = match &request.reference {
        None => Follow::Config,
        Some(Window::Held(row)) => Follow::Held(row),
        Some(Window::Stages(rows)) => Follow::Stages(rows),
    };
    let told = request.parameters.as_deref().map(|p| controller.set_measured_parameters(p));
    let before = told.transpose().map_err(|error| error.to_string())?;
    let budget_us = request.budget_us.or(controller.spec().budget_us);
    let applied = request.u_applied.as_deref();
    let step = match controller.step_within(&y, follow, applied, budget_us) {
        Ok(step) => step,
        Err(error) => {
            let error = error.to_string();
            if let Some(before) = before {
                controller.set_measured_parameters(&before).map_err(|error| error.to_string())?;
            }
            return Err(error);
        }
    };
    Ok(text(&Answer {
        u: step.u,
        status: step.status.to_string(),
        x: step.x,
        unknowns: step.unknowns,
        estimator: step.estimator.map(|status| status.to_string()),
        cost: step.cost,
        curvature_dropped: step.cost.map(|_| step.curvature_dropped),
        start: step.start,
        target_found: step.target_found,
        in_tube: step.in_tube,
        step_us: step.step_us,
        trust: (step.trust != Trust::NotJudged).then(|| step.trust.to_string()),
        model_error: step.model_error,
    }))
}

/// The line with `null` for what Python writes for numbers that are not finite, which JSON does not
/// know.
fn with_nulls(line: &[u8]) -> Cow<'_, [u8]> {
    const WORDS: [&[u8]; 3] = [b"NaN", b"-Infinity", b"Infinity"];
    if !line.windows(2).any(|pair| pair == b"Na" || pair == b"In") {
        return Cow::Borrowed(line);
    }
    let (mut changed, mut rest, mut quoted) = (Vec::with_capacity(line.len() + 8), line, false);
    while let Some((&byte, after)) = rest.split_first() {
        let word = WORDS.iter().find(|word| !quoted && rest.starts_with(word));
        if let Some(word) = word {
            changed.extend_from_slice(b"null");
            rest = &rest[word.len()..];
            continue;
        }
        changed.push(byte);
        rest = after;
        match (byte, after.split_first()) {
            (b'\\', Some((&escaped, later))) if quoted => {
                changed.push(escaped);
                rest = later;
            }
            (b'"', _) => quoted = !quoted,
            _ => {}
        }
    }
    Cow::Owned(changed)
}

fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("numbers and texts")
}
