//! Threads that the FMU's functions run in, since a call of one cannot be given up.

use super::simulation::{Copy, Simulation};
use crate::pool::external;
use pinc_ode::{LinearizationBuffer, OdeError};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// What an instance is to do.
pub(super) struct Job {
    /// The states of some points, and the inputs.
    pub(super) x: Vec<f64>,
    pub(super) u: Vec<f64>,
    pub(super) wanted: Wanted,
}

/// What is asked for of each point.
pub(super) enum Wanted {
    /// The state after so many seconds, so many times in one run.
    States(f64, u32),
    /// The same of all points, and then the Jacobians A and B of all.
    Jacobians(f64),
    /// The outputs there.
    Outputs,
}

type Outcome = Result<Vec<f64>, OdeError>;

/// A thread with an instance, which is made for the first job.
pub(super) struct Worker {
    /// None once the thread is to end.
    jobs: Option<Sender<Job>>,
    outcomes: Receiver<Outcome>,
    /// How many points are done.
    done: Arc<AtomicU64>,
    /// None if it does not come back from a call.
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    pub(super) fn start(simulation: &Arc<Simulation>) -> Self {
        let (jobs, to_do) = channel::<Job>();
        let (sender, outcomes) = channel();
        let done = Arc::new(AtomicU64::new(0));
        let (simulation, counter) = (simulation.clone(), done.clone());
        let thread = thread::spawn(move || {
            let mut instance = None;
            for job in to_do {
                let outcome = work(&simulation, &mut instance, job, &counter);
                if sender.send(outcome).is_err() {
                    return;
                }
            }
        });
        Self { jobs: Some(jobs), outcomes, done, thread: Some(thread) }
    }

    /// What the job asks for; `None` if no point is done for longer than `limit`.
    pub(super) fn ask(&mut self, job: Job, limit: Duration) -> Option<Outcome> {
        let ended = || external("the FMU's thread has ended");
        if self.jobs.as_ref().is_none_or(|jobs| jobs.send(job).is_err()) {
            return Some(Err(ended()));
        }
        loop {
            let before = self.done.load(Ordering::Relaxed);
            match self.outcomes.recv_timeout(limit) {
                Ok(outcome) => return Some(outcome),
                Err(RecvTimeoutError::Disconnected) => return Some(Err(ended())),
                Err(RecvTimeoutError::Timeout) => {
                    if self.done.load(Ordering::Relaxed) == before {
                        self.thread = None;
                        return None;
                    }
                }
            }
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn work(
    simulation: &Simulation,
    instance: &mut Option<Copy>,
    job: Job,
    done: &AtomicU64,
) -> Outcome {
    let copy = match instance {
        Some(copy) => copy,
        None => instance.insert(simulation.start()?),
    };
    done.fetch_add(1, Ordering::Relaxed);
    let Job { mut x, u, wanted } = job;
    let (dims, points) = (simulation.dims, u.len() / simulation.dims.nu);
    let duration_s = match wanted {
        Wanted::States(duration_s, times) => {
            for (x, u) in x.chunks_exact_mut(dims.nx).zip(u.chunks_exact(dims.nu)) {
                simulation.step(copy, x, u, (duration_s, times))?;
                done.fetch_add(1, Ordering::Relaxed);
            }
            return Ok(x);
        }
        Wanted::Outputs => {
            let mut y = vec![0.0; points * dims.ny];
            let each = x.chunks_exact(dims.nx).zip(u.chunks_exact(dims.nu));
            for ((x, u), y) in each.zip(y.chunks_exact_mut(dims.ny)) {
                simulation.read(copy, (x, u), y)?;
                done.fetch_add(1, Ordering::Relaxed);
            }
            return Ok(y);
        }
        Wanted::Jacobians(duration_s) => duration_s,
    };
    let Copy::ModelExchange(integrators) = copy else {
        return Err(external("co-simulation has no derivatives"));
    };
    let mut found = LinearizationBuffer::new(dims, points);
    for (k, (x, u)) in x.chunks_exact(dims.nx).zip(u.chunks_exact(dims.nu)).enumerate() {
        let mut all = found.as_mut();
        simulation.differentiate(integrators, (x, u), duration_s, all.point(k, dims))?;
        done.fetch_add(1, Ordering::Relaxed);
    }
    Ok([found.next, found.a, found.b].concat())
}
