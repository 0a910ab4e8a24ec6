//! `pinc serve`: the controller as a process, one JSON object a line.

use super::chosen::Chosen;
use super::guard::Guard;
use crate::BenchError;
use pinc_config::{ControlSpec, Experiment, ModelKind};
use pinc_mpc::{Nmpc, Reference, StepReport};
use pinc_record::OutsideDomain;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// A line from the plant.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    /// What was measured: all states.
    y: Vec<f64>,
    /// What is to be followed, in place of the config's references.
    reference: Option<Window>,
    /// The input that the plant was really given since the last line.
    u_applied: Option<Vec<f64>>,
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
    step_us: f64,
}

/// The answer to a line that cannot be used; nothing has happened then.
#[derive(Serialize)]
struct Refusal {
    error: String,
}

/// Serves the controller of `experiment` with the model of the file `model`, or `only` one of the
/// config's: reads a line of `input`, writes one to `output`, until the input ends or nobody reads
/// the output. A line that cannot be used is answered with `{"error": ".."}` and changes nothing.
///
/// Without a reference the config's are followed, from the first step on. Returns how often the net
/// was used outside its training domain.
///
/// # Errors
///
/// [`BenchError`] if the controller cannot be made.
pub fn serve(
    experiment: &Experiment,
    model: Option<&Path>,
    only: Option<ModelKind>,
    input: impl BufRead,
    mut output: impl Write,
) -> Result<OutsideDomain, BenchError> {
    let chosen = Chosen::of(experiment, model, only, "pinc serve")?;
    let mut server = Server::new(&chosen)?;
    for line in input.split(b'\n') {
        let Ok(line) = line else { break };
        let answer = server.answer(&line).unwrap_or_else(|error| text(&Refusal { error }));
        if writeln!(output, "{answer}").and_then(|()| output.flush()).is_err() {
            break;
        }
    }
    Ok(server.guard.map_or_else(OutsideDomain::default, Guard::found))
}

struct Server<'c> {
    nmpc: Nmpc,
    spec: &'c ControlSpec,
    guard: Option<Guard<'c>>,
    /// What is followed if a line does not say it.
    reference: Reference,
    window: Vec<f64>,
    /// Steps done.
    done: usize,
}

impl<'c> Server<'c> {
    fn new(chosen: &'c Chosen<'_>) -> Result<Self, BenchError> {
        let (setup, spec) = (chosen.setup(), chosen.spec);
        let nmpc = setup.controller(chosen.kind, &*chosen.plant)?;
        let guard = chosen.net().map(|net| Guard::new(net, spec.outside_domain));
        Ok(Self {
            reference: setup.reference()?,
            window: vec![0.0; spec.n2 * spec.controlled.len()],
            nmpc,
            spec,
            guard,
            done: 0,
        })
    }

    /// The answer to a line, or what is wrong with it.
    fn answer(&mut self, line: &[u8]) -> Result<String, String> {
        let request: Request = serde_json::from_slice(line).map_err(|error| {
            format!("{error}; expected {{\"y\": [..], \"reference\": [..], \"u_applied\": [..]}}")
        })?;
        self.check(&request)?;
        self.write_window(request.reference.as_ref());
        let x = request.y;
        if self.done == 0
            && let Some(u) = &self.spec.initial_input
        {
            self.nmpc.reset_to(&x, u).map_err(|error| error.to_string())?;
        }
        if let Some(u) = &request.u_applied {
            self.nmpc.set_applied_input(u).map_err(|error| error.to_string())?;
        }
        let budget = self.spec.budget_us.map(|us| Duration::from_secs_f64(1e-6 * us));
        let clock = Instant::now();
        let mut expired = || budget.is_some_and(|budget| clock.elapsed() >= budget);
        let step = self.nmpc.step_within(&x, &self.window, &mut expired);
        let StepReport { u, status, .. } = step.map_err(|error| error.to_string())?;
        let step_us = 1e6 * clock.elapsed().as_secs_f64();
        self.done += 1;
        if let Some(guard) = &mut self.guard {
            guard.look(&x, u, &[]).map_err(|error| error.to_string())?;
        }
        let answer = text(&Answer { u, status: status.to_string(), x: &x, step_us });
        // What can be done of the next step before its line comes.
        self.nmpc.prepare();
        Ok(answer)
    }

    /// Checks the lengths, so that a line that is refused has changed nothing.
    fn check(&self, request: &Request) -> Result<(), String> {
        let dims = self.nmpc.model().dims();
        let outputs = self.spec.controlled.len();
        let length = |what: &str, found: usize, expected: usize, each: &str| match found {
            found if found == expected => Ok(()),
            _ => Err(format!("{what}: {found} numbers given, expected {expected}, one per {each}")),
        };
        length("y", request.y.len(), dims.nx, "state")?;
        if let Some(u) = &request.u_applied {
            length("u_applied", u.len(), dims.nu, "input")?;
        }
        match &request.reference {
            None => {}
            Some(Window::Held(row)) => {
                length("reference", row.len(), outputs, "controlled quantity")?;
            }
            Some(Window::Stages(rows)) => {
                if rows.len() != self.spec.n2 {
                    let (found, expected) = (rows.len(), self.spec.n2);
                    return Err(format!(
                        "reference: {found} rows given, expected {expected}, one per step of the \
                         horizon"
                    ));
                }
                for row in rows {
                    length("a row of reference", row.len(), outputs, "controlled quantity")?;
                }
            }
        }
        Ok(())
    }

    /// Writes what is followed by the input of this step.
    fn write_window(&mut self, reference: Option<&Window>) {
        let width = self.spec.controlled.len();
        match reference {
            Some(Window::Held(row)) => {
                self.window.chunks_exact_mut(width).for_each(|to| to.copy_from_slice(row));
            }
            Some(Window::Stages(rows)) => {
                let stages = self.window.chunks_exact_mut(width).zip(rows);
                stages.for_each(|(to, row)| to.copy_from_slice(row));
            }
            None if self.spec.preview => {
                let first = self.done + self.spec.delay_steps;
                let ends = &self.nmpc.stage_times_s()[1..];
                self.reference.preview_at(first, ends, &mut self.window);
            }
            None => {
                let now = self.reference.at(self.done);
                self.window.chunks_exact_mut(width).for_each(|to| to.copy_from_slice(now));
            }
        }
    }
}

fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("finite numbers and texts")
}
