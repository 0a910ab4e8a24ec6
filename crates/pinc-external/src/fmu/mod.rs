//! A plant as an FMU of FMI 2.0 or 3.0.

mod archive;
mod derivatives;
mod description;
mod equation;
mod library;
mod simulation;
mod unpacked;
mod worker;

pub use description::FmuKind;

use crate::pool::{Failure, Pool, broken};
use pinc_ode::{Flow, Linearization, OdeError, Stages};
use simulation::Simulation;
use std::fmt;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use unpacked::Unpacked;
use worker::{Job, Wanted, Worker};

/// How an FMU is a plant: which of its variables are what.
#[derive(Clone, Debug, PartialEq)]
pub struct FmuPlant {
    /// The interface; model exchange, if there is one, where nothing is said.
    pub kind: Option<FmuKind>,
    /// The variables that are the states: their values after a step.
    pub states: Vec<String>,
    /// The variables by which the states are set at the start, which may be the same.
    pub starts: Vec<String>,
    /// The variables that are the inputs. They may be parameters, since each step begins anew.
    pub inputs: Vec<String>,
    /// The variables that are the outputs: their values in a state under an input.
    pub outputs: Vec<String>,
    /// Other variables, with the values that they start with.
    pub parameters: Vec<(String, f64)>,
    /// The time at which each step begins, in s.
    pub start_s: f64,
    /// Whether its directional derivatives are used, where it has them.
    pub directional_derivatives: bool,
    /// How long a step may take; the first includes the loading of the binary.
    pub time_limit: Duration,
}

/// What is wrong with a file, or does not go with how it is to be a plant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FmuError {
    /// What was asked for: `file`, `inputs`, `variables`, `start_variables` or `parameters.NAME`.
    pub key: String,
    /// What is wrong, in words.
    pub problem: String,
}

impl FmuError {
    fn at(key: impl Into<String>) -> impl FnOnce(String) -> Self {
        let key = key.into();
        |problem| Self { key, problem }
    }
}

impl From<String> for FmuError {
    fn from(problem: String) -> Self {
        Self { key: "file".to_owned(), problem }
    }
}

impl fmt::Display for FmuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.problem)
    }
}

/// An FMU as a plant. Each step begins at the start time in the state that is asked for: the FMU's
/// memory is its states, and it does not depend on time.
///
/// By model exchange its derivatives are integrated with [`Dopri5`](pinc_ode::Dopri5), and where it has directional
/// derivatives its variational equation too; events are not looked for. By co-simulation it takes a
/// communication step of the whole duration.
///
/// Its functions run in threads of their own. A step that takes longer than the time limit is an
/// error, and so are all steps after it: nothing can end a function of a library, so that its thread
/// goes on until the program ends.
#[derive(Debug)]
pub struct Fmu {
    // The instances end before their files are removed.
    copies: Pool<Worker>,
    simulation: Arc<Simulation>,
    time_limit: Duration,
    _unpacked: Unpacked,
}

impl Fmu {
    /// Unpacks the FMU at `path` and looks at its description. Nothing of it is run before it is
    /// first asked for a state.
    ///
    /// # Errors
    ///
    /// [`FmuError`] says what is wrong with the file or does not go with `plant`.
    pub fn open(path: &Path, plant: &FmuPlant) -> Result<Self, FmuError> {
        let bytes = fs::read(path).map_err(|error| format!("it cannot be read: {error}"))?;
        let unpacked = Unpacked::new()?;
        archive::unpack(&bytes, unpacked.path())?;
        Ok(Self {
            copies: Pool::new(),
            simulation: Arc::new(Simulation::new(unpacked.path(), plant)?),
            time_limit: plant.time_limit,
            _unpacked: unpacked,
        })
    }

    /// Lets an instance do `job`.
    fn ask(&self, job: Job) -> Result<Vec<f64>, OdeError> {
        let start = || Ok(Worker::start(&self.simulation));
        self.copies.with(start, |worker| match worker.ask(job, self.time_limit) {
            Some(result) => result.map_err(Failure::Unanswerable),
            None => {
                let limit = self.time_limit.as_secs_f64();
                Err(broken(format!("the FMU did not end a step within {limit} s (time_limit_s)")))
            }
        })
    }

    /// Moves the states on by a duration in s, so many times in one run.
    fn move_on(&self, x: &mut [f64], u: &[f64], (t, times): (f64, u32)) -> Result<(), OdeError> {
        let job = Job { x: x.to_vec(), u: u.to_vec(), wanted: Wanted::States(t, times) };
        self.ask(job).map(|next| x.copy_from_slice(&next))
    }
}

impl Flow for Fmu {
    fn linearize(
        &self,
        at: Stages<'_>,
        duration_s: f64,
        out: Linearization<'_>,
    ) -> Option<Result<(), OdeError>> {
        self.simulation.derivatives.as_ref()?;
        let job = Job { x: at.x.to_vec(), u: at.u.to_vec(), wanted: Wanted::Jacobians(duration_s) };
        Some(self.ask(job).map(|found| {
            let (next, jacobians) = found.split_at(out.next.len());
            let (a, b) = jacobians.split_at(out.a.len());
            out.next.copy_from_slice(next);
            out.a.copy_from_slice(a);
            out.b.copy_from_slice(b);
        }))
    }

    fn advance(&self, x: &mut [f64], u: &[f64], duration_s: f64) -> Result<(), OdeError> {
        self.move_on(x, u, (duration_s, 1))
    }

    fn advance_in_one_run(
        &self,
        x: &mut [f64],
        u: &[f64],
        duration_s: f64,
        times: u32,
    ) -> Option<Result<(), OdeError>> {
        Some(self.move_on(x, u, (duration_s, times)))
    }

    fn outputs(&self, x: &[f64], u: &[f64], y: &mut [f64]) -> Result<(), OdeError> {
        let job = Job { x: x.to_vec(), u: u.to_vec(), wanted: Wanted::Outputs };
        self.ask(job).map(|found| y.copy_from_slice(&found))
    }
}
