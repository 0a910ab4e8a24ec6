//! One controller, many closed loops.

use crate::NmpcBatch;
use crate::rows::{Rows, applied_before, count};
use crate::share::share;
use pinc_loop::ClosedLoop;
use pinc_mpc::{MpcError, Nmpc, Reference, SqpStatus};
use pinc_ode::{ArgumentError, Simulator};

/// What a batch of closed loops is given.
#[derive(Clone, Copy, Debug)]
pub struct Loops<'a> {
    /// The states in which the loops begin, `[loops, n]`.
    pub x: &'a [f64],
    /// What they follow: one reference per loop, or one for all.
    pub references: &'a [Reference],
    /// The plants: one per loop, or one for all.
    pub plants: &'a [Simulator],
    /// The inputs applied before: `[loops, m]` or `[m]`.
    pub u_before: &'a [f64],
    /// Whether the controller sees later values of the reference.
    pub preview: bool,
}

/// A closed loop at its control steps.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoopTrace {
    /// The states at the steps, the first one included, `[K + 1, n]`; fewer if the plant could not
    /// be integrated.
    pub states: Vec<f64>,
    /// The inputs chosen, `[K, m]`.
    pub inputs: Vec<f64>,
    /// How the optimizations ended.
    pub statuses: Vec<SqpStatus>,
    /// The sum of the absolute errors of the tracked quantities at the ends of the steps, as
    /// [`Tracking::iae_sum`](pinc_ode::metrics::Tracking::iae_sum).
    pub iae: f64,
    /// By how much the plant was outside its bounds, at most.
    pub max_violation: f64,
    /// Why the loop ended early, if it did.
    pub error: Option<MpcError>,
}

impl NmpcBatch {
    /// Runs closed loops, each with a controller and a plant that start afresh.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a list is of the wrong length, or states, references, inputs before and plants
    /// do not suit the controller. A plant that cannot be integrated ends its own loop only.
    pub fn loops(&mut self, given: Loops<'_>) -> Result<Vec<LoopTrace>, MpcError> {
        let dims = self.nmpc().model().dims();
        let loops = count("x", given.x, dims.nx)?;
        let x = Rows::new("x", given.x, dims.nx, loops)?;
        let u_before = applied_before(self.nmpc(), given.u_before, dims.nu, loops)?;
        for (field, found) in
            [("references", given.references.len()), ("plants", given.plants.len())]
        {
            if found != 1 && found != loops {
                return Err(ArgumentError::Length { field, expected: loops, found }.into());
            }
        }
        let traces = share(&mut self.workers, loops, self.interrupted, |nmpc, k| {
            let plant = &given.plants[k % given.plants.len()];
            let reference = &given.references[k % given.references.len()];
            run(nmpc, (plant, reference), [x.at(k), u_before.at(k)], given.preview)
        });
        traces.into_iter().collect()
    }
}

fn run(
    nmpc: &mut Nmpc,
    (plant, reference): (&Simulator, &Reference),
    [x, u_before]: [&[f64]; 2],
    preview: bool,
) -> Result<LoopTrace, MpcError> {
    let run = ClosedLoop::new(nmpc, plant.clone(), reference.clone(), x)?;
    let mut run = run.with_initial_input(u_before)?;
    if !preview {
        run = run.without_preview();
    }
    let (mut states, mut inputs, mut statuses) = (x.to_vec(), Vec::new(), Vec::new());
    let error = loop {
        let control = match run.control() {
            Ok(Some(control)) => control,
            Ok(None) => break None,
            Err(error) => break Some(error),
        };
        inputs.extend_from_slice(control.u());
        statuses.push(control.record().status);
        if let Err(error) = control.advance() {
            break Some(error);
        }
        states.extend_from_slice(run.state());
    };
    let iae = run.tracking_at_steps().iae_sum();
    Ok(LoopTrace { states, inputs, statuses, iae, max_violation: run.max_violation(), error })
}
