//! Closed loops of the net beside the controller's.

use crate::samples::{Drawn, LOOPS};
use crate::{Checked, Policy, Rater, Region, See, ShrinkError, in_parts};
use pinc_batch::NmpcBatch;
use pinc_mpc::{Nmpc, Reference, SqpStatus};
use pinc_ode::Simulator;

/// A loop breaks its bounds if a state is outside by more than this part of the bounds' size.
const BROKEN: f64 = 1e-3;

/// Closed loops of one driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Outcome {
    /// The absolute errors of what is tracked, summed over all control steps and loops.
    pub iae: f64,
    /// Loops with a state or an output outside its bounds at a control step, by more than 0.1 % of the bounds'
    /// size.
    pub broken: usize,
    /// The same among the loops in which the controller keeps all bounds.
    pub newly_broken: usize,
    /// The part of the decisions in which the net's plan was taken.
    pub kept: f64,
    /// The part in which the controller optimized.
    pub optimized: f64,
}

/// Loops on states and references that the net was not trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Judgement {
    /// How many loops are compared: those that the controller brings to their end.
    pub loops: usize,
    /// The controller.
    pub nmpc: Outcome,
    /// The net alone.
    pub net: Outcome,
    /// The net with the check of its plans.
    pub checked: Outcome,
    /// The same with the controller where no plan stays within the bounds.
    pub backed: Outcome,
}

/// The trace of a loop, which begins with the first state.
#[derive(Clone, Debug)]
pub(crate) struct Trace {
    pub(crate) states: Vec<f64>,
    pub(crate) inputs: Vec<f64>,
    /// In how many steps a net's plan was kept, and in how many the controller optimized.
    pub(crate) kept: usize,
    pub(crate) optimized: usize,
}

/// The loops under a net whose plans are not checked; `None` where the plant cannot be integrated.
pub(crate) fn loops(
    batch: &mut NmpcBatch,
    (plant, region): (&Simulator, &Region),
    policy: &Policy,
    drawn: &Drawn,
    see: &mut See<'_>,
) -> Result<Vec<Option<Trace>>, ShrinkError> {
    let one = |nmpc: &mut Nmpc, k: usize| {
        let mut net = policy.clone();
        let count = nmpc.problem().control_horizon * region.u_before.len();
        let mut plan = vec![0.0; count];
        run(nmpc, plant.clone(), drawn.at(k, region), |_, x, r, u| {
            net.plan(x, r, u, &mut plan);
            let first = u.len();
            u.copy_from_slice(&plan[..first]);
            Some(SqpStatus::Kept)
        })
    };
    in_parts((drawn.references.len(), LOOPS), see, |part| {
        Ok::<_, ShrinkError>(batch.each(part.len(), |nmpc, k| one(nmpc, part.start + k)))
    })
}

/// The loops under a net whose plans are checked, alone or with the controller as the last resort.
fn checked_loops(
    batch: &mut NmpcBatch,
    (plant, region): (&Simulator, &Region),
    (policy, is_alone): (&Policy, bool),
    drawn: &Drawn,
    see: &mut See<'_>,
) -> Result<Vec<Option<Trace>>, ShrinkError> {
    let one = |nmpc: &mut Nmpc, k: usize| {
        nmpc.reset_input(&region.u_before)?;
        nmpc.set_first_plan(&drawn.plans[k])?;
        let checked = Checked::new(policy.clone(), nmpc)?;
        let checked = if is_alone { checked.alone() } else { checked };
        nmpc.set_planner(Some(Box::new(checked)));
        let trace = run(nmpc, plant.clone(), drawn.at(k, region), |nmpc, x, r, u| {
            let step = nmpc.step(x, &r.repeat(nmpc.problem().horizon)).ok()?;
            u.copy_from_slice(step.u);
            Some(step.status)
        });
        nmpc.set_planner(None);
        Ok(trace)
    };
    in_parts((drawn.references.len(), LOOPS), see, |part| -> Result<Vec<_>, ShrinkError> {
        batch.each(part.len(), |nmpc, k| one(nmpc, part.start + k)).into_iter().collect()
    })
}

pub(crate) fn judge(
    batch: &mut NmpcBatch,
    (plant, region): (&Simulator, &Region),
    policy: &Policy,
    drawn: &Drawn,
    see: &mut See<'_>,
) -> Result<Judgement, ShrinkError> {
    let own = drawn.run(batch, plant, &region.u_before, see)?;
    let mut judgement = Judgement::default();
    let mut steps = 0;
    let net = loops(batch, (plant, region), policy, drawn, see)?;
    let checked = checked_loops(batch, (plant, region), (policy, true), drawn, see)?;
    let backed = checked_loops(batch, (plant, region), (policy, false), drawn, see)?;
    let mut scores = |traces: &[Option<Trace>]| {
        let score = |nmpc: &mut Nmpc, k: usize| {
            // One that ends early: the plant cannot be integrated.
            let missing = (f64::INFINITY, true);
            traces[k].as_ref().map_or(missing, |of| score(nmpc, &drawn.references[k], of))
        };
        batch.each(traces.len(), score)
    };
    let by_own = scores(&own);
    let by_others = [scores(&net), scores(&checked), scores(&backed)];
    for (k, reference) in drawn.references.iter().enumerate() {
        if own[k].is_none() {
            continue;
        }
        judgement.loops += 1;
        steps += reference.steps();
        for (outcome, trace, (iae, breaks)) in [
            (&mut judgement.nmpc, &own[k], by_own[k]),
            (&mut judgement.net, &net[k], by_others[0][k]),
            (&mut judgement.checked, &checked[k], by_others[1][k]),
            (&mut judgement.backed, &backed[k], by_others[2][k]),
        ] {
            outcome.iae += iae;
            outcome.broken += usize::from(breaks);
            outcome.newly_broken += usize::from(breaks && !by_own[k].1);
            let counts = trace.as_ref().map_or([0; 2], |trace| [trace.kept, trace.optimized]);
            let [kept, optimized] = counts.map(|count| count as f64);
            outcome.kept += kept;
            outcome.optimized += optimized;
        }
    }
    let steps = steps.max(1) as f64;
    let Judgement { nmpc, net, checked, backed, .. } = &mut judgement;
    for outcome in [nmpc, net, checked, backed] {
        outcome.kept /= steps;
        outcome.optimized /= steps;
    }
    Ok(judgement)
}

/// Runs a loop whose inputs `decide` changes to the next ones; it returns how they were planned.
fn run(
    nmpc: &mut Nmpc,
    mut plant: Simulator,
    (reference, x, u_before): (&Reference, &[f64], &[f64]),
    mut decide: impl FnMut(&mut Nmpc, &[f64], &[f64], &mut [f64]) -> Option<SqpStatus>,
) -> Option<Trace> {
    let sample_time_s = nmpc.model().sample_time_s();
    let (mut x, mut u) = (x.to_vec(), u_before.to_vec());
    let (mut states, mut inputs, mut kept, mut optimized) = (x.clone(), Vec::new(), 0, 0);
    for k in 0..reference.steps() {
        let status = decide(nmpc, &x, reference.at(k), &mut u)?;
        kept += usize::from(status == SqpStatus::Kept);
        optimized += usize::from(![SqpStatus::Kept, SqpStatus::Replaced].contains(&status));
        plant.integrate(&mut x, &u, sample_time_s).ok()?;
        states.extend_from_slice(&x);
        inputs.extend_from_slice(&u);
    }
    Some(Trace { states, inputs, kept, optimized })
}

/// The absolute errors at the ends of the steps, summed, and whether a bound is broken after the
/// first state.
fn score(nmpc: &mut Nmpc, reference: &Reference, trace: &Trace) -> (f64, bool) {
    let (dims, rater) = (nmpc.model().dims(), Rater::new(nmpc));
    let mut program = nmpc.program();
    let (mut iae, mut breaks) = (0.0, false);
    for (k, u) in trace.inputs.chunks_exact(dims.nu).enumerate() {
        let state = |k: usize| &trace.states[k * dims.nx..(k + 1) * dims.nx];
        let [begin, end] = [k, k + 1].map(|k| rater.point(&mut program, state(k), u));
        let errors = rater.tracked.iter().zip(reference.at(k));
        iae += errors.map(|(place, r)| (end[*place] - r).abs()).sum::<f64>();
        breaks |= rater.outside_now([&begin, &end]) > BROKEN;
    }
    (iae, breaks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_mpc::{Bounds, NmpcProblem, SqpConfig, Tracked, Weights};
    use pinc_ode::{Dims, Rk4};
    use pinc_plants::VanDerPol;

    /// A controller that follows x2 and then u, with the states within +-`bound`.
    fn controller(bound: f64) -> Nmpc {
        let weights = Weights::uniform(vec![1.0; 2], vec![1.0]);
        let problem = NmpcProblem {
            tracked: vec![Tracked::State(1), Tracked::Input(0)],
            state_bounds: Bounds::new(vec![-bound; 2], vec![bound; 2]),
            ..NmpcProblem::new(Dims::new(2, 1), 3, weights)
        };
        let model = Rk4::new(VanDerPol::default(), 0.5, 1);
        Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap()
    }

    /// Two steps from (5, 5).
    fn trace() -> Trace {
        let states = vec![5.0, 5.0, 1.0, 2.0, 3.0, -1.0];
        Trace { states, inputs: vec![0.5, -0.5], kept: 2, optimized: 0 }
    }

    #[test]
    fn errors_are_summed_at_the_ends_of_the_steps() {
        let reference = Reference::new(vec![0.5, 0.0, 1.0, -2.0], 2).unwrap();
        let steps = [(2.0 - 0.5) + 0.5, (1.0 + 1.0) + (2.0 - 0.5)];
        let found = score(&mut controller(4.0), &reference, &trace()).0;
        assert!((found - steps.iter().sum::<f64>()).abs() < 1e-12, "{found}");
    }

    #[test]
    fn a_loop_breaks_a_bound_by_more_than_a_thousandth_of_its_size() {
        let reference = Reference::new(vec![0.0; 4], 2).unwrap();
        // It begins outside; later 3 is the largest.
        for (bound, is_broken) in [(4.0, false), (2.9985, false), (2.9965, true), (2.0, true)] {
            let found = score(&mut controller(bound), &reference, &trace()).1;
            assert_eq!(found, is_broken, "{bound}");
        }
    }
}
