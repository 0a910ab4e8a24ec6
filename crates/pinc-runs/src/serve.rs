//! `pinc serve`: the controller as a process, one JSON object a line.

use super::chosen::ModelFile;
use super::live::{Follow, LiveController};
use crate::{RunError, console};
use pinc_config::{Experiment, ModelKind};
use pinc_mpc::Trust;
use pinc_record::OutsideDomain;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::io::{BufRead, Read, Write};
use std::path::Path;

/// The length of a line, in bytes: so much, and more for each number that a request may hold.
const LINE: usize = 65_536;
const NUMBER: usize = 64;

/// A line from the plant.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    /// The measured values: all states, or the estimator's measurements; null or NaN is missing.
    y: Vec<Option<f64>>,
    /// What is to be followed, in place of the config's references.
    reference: Option<Window>,
    /// The input that the plant was really given since the last line.
    u_applied: Option<Vec<f64>>,
    /// What the parameters of `control.measured_parameters` are; as before if absent.
    parameters: Option<Vec<f64>>,
}

/// A reference: for the whole horizon, or a row per stage.
#[derive(Deserialize)]
#[serde(untagged)]
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
struct Refusal {
    error: String,
}

/// Serves the controller of `experiment`, with its estimator if it has one, and with the model of
/// the file `model`, or `only` one of the config's: reads a line of `input`, writes one to
/// `output`, until the input ends or nobody reads the output. A line that cannot be used is
/// answered with `{"error": ".."}` and changes nothing; so is one that is longer than any request,
/// of which no more than that is kept in memory.
///
/// Without a reference the config's are followed, from the first step on. Returns how often the net
/// was used outside its training domain.
///
/// # Errors
///
/// [`RunError`] if the controller cannot be made, or `output` fails with readers left.
pub fn serve(
    experiment: &Experiment,
    model: Option<&Path>,
    only: Option<ModelKind>,
    mut input: impl BufRead,
    mut output: impl Write,
) -> Result<OutsideDomain, RunError> {
    let mut controller =
        LiveController::new(experiment, model.map(ModelFile::At), only, "pinc serve")?;
    let longest = LINE + NUMBER * controller.request_numbers();
    let mut line = Vec::new();
    while let Ok(Some(end)) = read_line(&mut input, longest, &mut line) {
        let answer = match end {
            LineEnd::Reached => answer(&mut controller, &line),
            LineEnd::Beyond => Err(format!("a line of more than {longest} bytes given")),
        };
        let refused = |error: String| text(&Refusal { error: console::shortened(&error).into() });
        let answer = answer.unwrap_or_else(refused);
        let written = writeln!(output, "{answer}").and_then(|()| output.flush());
        let is_read = written.is_ok();
        console::written(written)?;
        if !is_read {
            break;
        }
        controller.prepare();
    }
    Ok(controller.outside_domain())
}

/// Whether a line was read to its end.
enum LineEnd {
    Reached,
    /// The line is longer than allowed; the rest was skipped.
    Beyond,
}

/// Reads a line of at most `longest` bytes into `line`; `None` at the end of the input.
fn read_line(
    input: &mut impl BufRead,
    longest: usize,
    line: &mut Vec<u8>,
) -> std::io::Result<Option<LineEnd>> {
    line.clear();
    if input.by_ref().take(longest as u64 + 1).read_until(b'\n', line)? == 0 {
        return Ok(None);
    }
    if line.pop_if(|byte| *byte == b'\n').is_some() || line.len() <= longest {
        return Ok(Some(LineEnd::Reached));
    }
    input.skip_until(b'\n')?;
    Ok(Some(LineEnd::Beyond))
}

/// The answer to a line, or what is wrong with it.
fn answer(controller: &mut LiveController, line: &[u8]) -> Result<String, String> {
    let request: Request = serde_json::from_slice(&with_nulls(line)).map_err(|error| {
        format!(
            "{error}; expected {{\"y\": [..], \"reference\": [..], \"u_applied\": [..], \
             \"parameters\": [..]}}"
        )
    })?;
    // What is missing is NaN.
    let y: Vec<f64> = request.y.iter().map(|y| y.unwrap_or(f64::NAN)).collect();
    let follow = match &request.reference {
        None => Follow::Config,
        Some(Window::Held(row)) => Follow::Held(row),
        Some(Window::Stages(rows)) => Follow::Stages(rows),
    };
    let told = request.parameters.as_deref().map(|p| controller.set_measured_parameters(p));
    let before = told.transpose().map_err(|error| error.to_string())?;
    let step = match controller.step(&y, follow, request.u_applied.as_deref()) {
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
