#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`shrink`] makes a [`Policy`], a net in place of a controller, and judges its closed loops;
//! - [`Checked`] checks its plans by the model, one rollout each, in a controller's place;
//! - [`policy_to_c`] writes both as C99 without a quadratic program, beside an exported model.

#![forbid(unsafe_code)]

mod c;
mod check;
mod judge;
mod net;
mod policy;
mod samples;
mod selftest;
mod train;

pub use c::policy_to_c;
pub use check::{Checked, Rater, Rating};
pub use judge::{Judgement, Outcome};
pub use policy::{Policy, PolicyNet};

use net::Net;
use pinc_batch::NmpcBatch;
use pinc_mpc::{Bounds, MpcError, Nmpc};
use pinc_net::{NetError, Workers};
use pinc_ode::Simulator;
use policy::{Limits, Scale};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use samples::Drawn;
use std::ops::{ControlFlow, Range};
use thiserror::Error;
use train::Training;

/// An error of this crate.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ShrinkError {
    /// Something of the controller that a net does not replace.
    #[error("a net cannot replace a controller with {feature}; use {instead}")]
    Feature {
        /// What the controller has.
        feature: &'static str,
        /// What to use instead.
        instead: &'static str,
    },
    /// Too few plans to train on.
    #[error("only {found} of {drawn} plans are optimal, too few to train on; check the bounds")]
    Labels {
        /// How many are optimal.
        found: usize,
        /// How many situations were drawn.
        drawn: usize,
    },
    /// A net for a controller of other sizes, or a damaged one.
    #[error("a net from {inputs} to {outputs} finite numbers expected, as the controller has")]
    Sizes {
        /// States, values to follow, and inputs.
        inputs: usize,
        /// Planned inputs.
        outputs: usize,
    },
    /// A net of plans with another model.
    #[error(
        "the net's plans were made with another model: the equation, a parameter, the substeps or the \
         model's net differ; train it anew"
    )]
    Model,
    /// The caller broke off.
    #[error("stopped")]
    Stopped,
    /// An error of the controller.
    #[error(transparent)]
    Mpc(#[from] MpcError),
    /// An error of the training.
    #[error(transparent)]
    Net(#[from] NetError),
}

/// How often the net is trained. After each time but the last, plans are made along its own loops and
/// added to those that it is trained on, since it goes where its controller does not.
///
/// Source: Ross, Gordon and Bagnell, "A Reduction of Imitation Learning and Structured Prediction to
/// No-Regret Online Learning" (2011).
const ROUNDS: usize = 3;

/// Where the net is to control.
#[derive(Clone, Debug)]
pub struct Region {
    /// The states in which loops begin.
    pub states: Bounds,
    /// The values to follow.
    pub references: Bounds,
    /// The input applied before a loop.
    pub u_before: Vec<f64>,
}

/// How a controller becomes a net.
#[derive(Clone, Debug)]
pub struct ShrinkConfig {
    /// Neurons in each of the two hidden layers.
    pub neurons: usize,
    /// How many plans are made to train the net on; those that are not optimal are left out.
    pub samples: usize,
    /// The most iterations of the training.
    pub iterations: usize,
    /// Loops to judge by.
    pub loops: usize,
    /// For how many control steps a loop follows a value.
    pub hold: usize,
    /// The seed of all random numbers.
    pub seed: u64,
    /// Threads of the training (0: one per core); they change no result.
    pub threads: usize,
}

impl Default for ShrinkConfig {
    /// The recommended values.
    fn default() -> Self {
        Self {
            neurons: 30,
            samples: 16_000,
            iterations: 2000,
            loops: 200,
            hold: 30,
            seed: 1,
            threads: 0,
        }
    }
}

/// Told what is done, it says whether to go on.
pub type See<'a> = dyn FnMut(Stage) -> ControlFlow<()> + 'a;

/// What is done.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Stage {
    /// Plans are made in so many situations.
    Labelling(usize),
    /// The net is trained: iterations done, loss.
    Training(usize, f64),
    /// So many loops are judged.
    Judging(usize),
    /// Part of this is done.
    Working,
}

/// A net in place of a controller.
#[derive(Clone, Debug)]
pub struct Shrunk {
    /// The net.
    pub policy: Policy,
    /// How many plans it was trained on.
    pub labels: usize,
    /// The loss of the training: squared errors in units in which plans go from -1 to 1.
    pub loss: f64,
    /// Its closed loops beside the controller's.
    pub judgement: Judgement,
}

/// Trains a net on plans of a controller, made along closed loops with `plant` and around them, and
/// on their derivatives; and judges it on other loops. The controller sees no later values of its
/// references. Results are the same on any number of threads. `see` is asked several times a second.
///
/// # Errors
///
/// [`ShrinkError`] if `see` breaks off, the controller has something that a net does not replace, or has too few
/// optimal plans.
pub fn shrink(
    batch: &mut NmpcBatch,
    plant: &Simulator,
    region: &Region,
    config: &ShrinkConfig,
    see: &mut See<'_>,
) -> Result<Shrunk, ShrinkError> {
    check_batch(batch)?;
    let workers = Workers::new(config.threads)?;
    let stream = |purpose: u64| {
        let mut random = ChaCha8Rng::seed_from_u64(config.seed);
        random.set_stream(purpose);
        random
    };
    let mut random = stream(1);
    let problem = batch.nmpc().problem().clone();
    let dims = batch.nmpc().model().dims();
    let limits = Limits::new(&problem, dims);
    // As many plans of the controller's loops as later, each time, of the net's own.
    let quota = config.samples / ROUNDS;
    let loops = (quota.div_ceil(Drawn::per_loop(config.hold.max(2))).max(2), config.hold);
    let drawn = Drawn::new(batch, region, loops, (&mut random, see))?;
    let traces = drawn.run(batch, plant, &region.u_before, see)?;
    let mut situations = drawn.situations(&traces, region, &problem.input_bounds, &mut random);
    situations.truncate(quota);
    go_on(see(Stage::Labelling(situations.len())))?;
    let inputs = Scale::of(situations.iter().map(Vec::as_slice));
    let mut labels = samples::label(batch, &situations, (&inputs, &limits), (&mut random, see))?;
    if labels.len() < situations.len() / 4 || labels.is_empty() {
        return Err(ShrinkError::Labels { found: labels.len(), drawn: situations.len() });
    }
    let steps = batch.each(1, |nmpc, _| policy::model_steps(nmpc, &inputs)).concat();
    let outputs = Scale::of(labels.iter().map(|label| &label.plan[..]));
    let hidden = config.neurons.max(1);
    let widths = vec![inputs.half.len(), hidden, hidden, outputs.half.len()];
    let mut net = Net::new(widths, &mut stream(2));
    let policy = |net: &Net| {
        let (layers, inputs, outputs) = (net.clone(), inputs.clone(), outputs.clone());
        Policy::of(PolicyNet { layers, inputs, outputs, steps: steps.clone() }, limits.clone())
    };
    let mut training = Training::new(net.weights.len());
    let (mut done, mut loss) = (0, f64::INFINITY);
    for round in 1..=ROUNDS {
        let iterations = config.iterations * round / ROUNDS - done;
        let mut told = |iteration, loss| see(Stage::Training(done + iteration, loss));
        let how = (iterations, &workers);
        loss = training.run((&mut net, dims.nu), &labels, [&inputs, &outputs], how, &mut told)?;
        done += iterations;
        if round < ROUNDS {
            let policy = policy(&net);
            let drawn = Drawn::new(batch, region, loops, (&mut random, see))?;
            let traces = judge::loops(batch, (plant, region), &policy, &drawn, see)?;
            let mut situations =
                drawn.situations(&traces, region, &problem.input_bounds, &mut random);
            situations.truncate(quota);
            go_on(see(Stage::Labelling(situations.len())))?;
            let with = (&mut random, &mut *see);
            labels.extend(samples::label(batch, &situations, (&inputs, &limits), with)?);
        }
    }
    let policy = policy(&net);
    go_on(see(Stage::Judging(config.loops)))?;
    let loops = (config.loops, config.hold);
    let fresh = Drawn::new(batch, region, loops, (&mut stream(3), see))?;
    let judgement = judge::judge(batch, (plant, region), &policy, &fresh, see)?;
    Ok(Shrunk { policy, labels: labels.len(), loss, judgement })
}

/// Checks that a net can replace the controllers of a batch, as [`shrink`] does first.
///
/// # Errors
///
/// What they have that a net does not replace.
pub fn check_batch(batch: &mut NmpcBatch) -> Result<(), ShrinkError> {
    batch.each(1, |nmpc, _| check_controller(nmpc)).into_iter().collect()
}

/// Whether to go on.
fn go_on(flow: ControlFlow<()>) -> Result<(), ShrinkError> {
    if flow.is_break() { Err(ShrinkError::Stopped) } else { Ok(()) }
}

/// Does so many things, `size` at a time, and asks in between whether to go on.
fn in_parts<T, E>(
    (count, size): (usize, usize),
    see: &mut See<'_>,
    mut part: impl FnMut(Range<usize>) -> Result<Vec<T>, E>,
) -> Result<Vec<T>, ShrinkError>
where
    ShrinkError: From<E>,
{
    let mut all = Vec::with_capacity(count);
    for first in (0..count).step_by(size) {
        go_on(see(Stage::Working))?;
        all.extend(part(first..count.min(first + size))?);
    }
    Ok(all)
}

/// Refuses what a net does not replace.
pub(crate) fn check_controller(nmpc: &mut Nmpc) -> Result<(), ShrinkError> {
    let costed = nmpc.program().has_stage_cost();
    let problem = nmpc.problem();
    let times = nmpc.stage_times_s();
    let equal = times.windows(2).all(|pair| {
        (pair[1] - pair[0] - nmpc.model().sample_time_s()).abs() <= 1e-9 * pair[1].abs()
    });
    let differ = problem.state_bounds.low.len() > nmpc.model().dims().nx;
    let refused = [
        (costed || problem.tracked.is_empty(), "a stage cost", "references"),
        (problem.constraints.is_some(), "constraints h and g", "bounds"),
        (problem.delay > 0, "a delay", "a state that holds the input under way"),
        (problem.scenarios.is_some(), "scenarios", "nominal parameters"),
        (!problem.periodic.is_empty(), "a periodic plan", "references by time"),
        (problem.weights.input_sequence.is_some(), "a weight of all inputs", "r"),
        (!equal, "stages of different lengths", "stages of one length"),
        (nmpc.is_searched(), "whole inputs or a policy", "bounds and the model itself"),
        (nmpc.tightened().is_some(), "a tube", "tighter bounds"),
        (
            differ,
            "bounds that differ between stages",
            "the same bounds at all stages, no end_state",
        ),
        (nmpc.config().real_time, "real-time iterations", "plans that converge"),
    ];
    for (there, feature, instead) in refused {
        if there {
            return Err(ShrinkError::Feature { feature, instead });
        }
    }
    Ok(())
}
