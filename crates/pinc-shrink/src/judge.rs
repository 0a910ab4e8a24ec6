//! Closed loops of the net beside the controller's.

use crate::check::size;
use crate::samples::Drawn;
use crate::{Checked, Policy, Region};
use pinc_batch::NmpcBatch;
use pinc_mpc::{MpcError, Nmpc, Reference, Tracked};
use pinc_ode::Simulator;

/// A loop breaks its bounds if a state is outside by more than this part of the bounds' size.
const BROKEN: f64 = 1e-3;

/// Who chooses the inputs of a loop.
#[derive(Clone, Debug)]
enum Driver {
    Net(Policy),
    Checked(Checked),
}

/// Closed loops of one driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Outcome {
    /// The absolute errors of what is tracked, summed over all control steps and loops.
    pub iae: f64,
    /// Loops with a state outside its bounds at a control step, by more than 0.1 % of the bounds'
    /// size.
    pub broken: usize,
    /// The same among the loops in which the controller keeps all bounds.
    pub newly_broken: usize,
    /// The part of the decisions in which the net's plan was kept.
    pub kept: f64,
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
}

/// The trace of a loop, which begins with the first state.
#[derive(Clone, Debug)]
pub(crate) struct Trace {
    pub(crate) states: Vec<f64>,
    pub(crate) inputs: Vec<f64>,
    /// In how many steps a net's plan was kept.
    pub(crate) kept: usize,
}

/// The loops under a net alone; `None` where the plant cannot be integrated.
pub(crate) fn loops_of_net(
    batch: &mut NmpcBatch,
    (plant, region): (&Simulator, &Region),
    policy: &Policy,
    drawn: &Drawn,
) -> Vec<Option<Trace>> {
    loops(batch, (plant, region), &Driver::Net(policy.clone()), drawn)
}

fn loops(
    batch: &mut NmpcBatch,
    (plant, region): (&Simulator, &Region),
    driver: &Driver,
    drawn: &Drawn,
) -> Vec<Option<Trace>> {
    batch.each(drawn.references.len(), |nmpc, k| {
        let n = nmpc.model().dims().nx;
        let x = &drawn.x[k * n..(k + 1) * n];
        run(nmpc, plant.clone(), (&drawn.references[k], x, &region.u_before), driver.clone())
    })
}

pub(crate) fn judge(
    batch: &mut NmpcBatch,
    (plant, region): (&Simulator, &Region),
    policy: &Policy,
    drawn: &Drawn,
) -> Result<Judgement, MpcError> {
    let own = drawn.run(batch, plant, &region.u_before)?;
    let mut judgement = Judgement::default();
    let mut steps = 0;
    let drivers = [Driver::Net(policy.clone()), Driver::Checked(Checked::new(policy.clone()))];
    let [net, checked] = drivers.map(|driver| loops(batch, (plant, region), &driver, drawn));
    for (k, reference) in drawn.references.iter().enumerate() {
        let Some(own) = &own[k] else { continue };
        judgement.loops += 1;
        steps += reference.steps();
        let broken = breaks(batch.nmpc(), &own.states);
        for (outcome, trace) in [
            (&mut judgement.nmpc, Some(own)),
            (&mut judgement.net, net[k].as_ref()),
            (&mut judgement.checked, checked[k].as_ref()),
        ] {
            let Some(trace) = trace else {
                // The plant could not be integrated.
                outcome.iae = f64::INFINITY;
                outcome.broken += 1;
                outcome.newly_broken += usize::from(!broken);
                continue;
            };
            let breaks = breaks(batch.nmpc(), &trace.states);
            outcome.iae += iae(batch.nmpc(), reference, trace);
            outcome.broken += usize::from(breaks);
            outcome.newly_broken += usize::from(breaks && !broken);
            #[expect(clippy::cast_precision_loss, reason = "far below 2^53 steps")]
            let kept = trace.kept as f64;
            outcome.kept += kept;
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "far below 2^53 steps")]
    let steps = steps.max(1) as f64;
    for outcome in [&mut judgement.nmpc, &mut judgement.net, &mut judgement.checked] {
        outcome.kept /= steps;
    }
    Ok(judgement)
}

fn run(
    nmpc: &mut Nmpc,
    mut plant: Simulator,
    (reference, x, u_before): (&Reference, &[f64], &[f64]),
    mut driver: Driver,
) -> Option<Trace> {
    let sample_time_s = nmpc.model().sample_time_s();
    let (mut x, mut u) = (x.to_vec(), u_before.to_vec());
    let count = nmpc.problem().control_horizon * u.len();
    let (mut states, mut inputs, mut kept) = (x.clone(), Vec::new(), 0);
    let mut plan = vec![0.0; count];
    for k in 0..reference.steps() {
        match &mut driver {
            Driver::Net(policy) => {
                policy.plan(&x, reference.at(k), &u, &mut plan);
                kept += 1;
            }
            Driver::Checked(checked) => {
                kept += usize::from(checked.decide(nmpc, &x, reference.at(k), &u) >= 1.0);
                plan.copy_from_slice(checked.plan());
            }
        }
        let first = u.len();
        u.copy_from_slice(&plan[..first]);
        plant.integrate(&mut x, &u, sample_time_s).ok()?;
        states.extend_from_slice(&x);
        inputs.extend_from_slice(&u);
    }
    Some(Trace { states, inputs, kept })
}

/// Whether a state is outside its bounds after the first step.
fn breaks(nmpc: &Nmpc, states: &[f64]) -> bool {
    let n = nmpc.model().dims().nx;
    let bounds = &nmpc.problem().state_bounds;
    states.chunks_exact(n).skip(1).any(|x| {
        let ends = bounds.low.iter().zip(&bounds.high);
        x.iter().zip(ends).any(|(value, (low, high))| {
            (low - value).max(value - high) > BROKEN * size(*low, *high)
        })
    })
}

/// The errors at the ends of the steps.
fn iae(nmpc: &Nmpc, reference: &Reference, trace: &Trace) -> f64 {
    let dims = nmpc.model().dims();
    let tracked = &nmpc.problem().tracked;
    (0..reference.steps())
        .map(|k| {
            let x = &trace.states[(k + 1) * dims.nx..(k + 2) * dims.nx];
            let u = &trace.inputs[k * dims.nu..(k + 1) * dims.nu];
            let errors = tracked.iter().zip(reference.at(k)).map(|(tracked, r)| match *tracked {
                Tracked::State(state) => (x[state] - r).abs(),
                Tracked::Input(input) => (u[input] - r).abs(),
                // Refused by `shrink`.
                Tracked::Output(_) => f64::NAN,
            });
            errors.sum::<f64>()
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_mpc::{Bounds, NmpcProblem, SqpConfig, Weights};
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
        Trace { states, inputs: vec![0.5, -0.5], kept: 2 }
    }

    #[test]
    fn errors_are_summed_at_the_ends_of_the_steps() {
        let reference = Reference::new(vec![0.5, 0.0, 1.0, -2.0], 2).unwrap();
        let steps = [(2.0 - 0.5) + 0.5, (1.0 + 1.0) + (2.0 - 0.5)];
        let found = iae(&controller(4.0), &reference, &trace());
        assert!((found - steps.iter().sum::<f64>()).abs() < 1e-12, "{found}");
    }

    #[test]
    fn a_loop_breaks_a_bound_by_more_than_a_thousandth_of_its_size() {
        // It begins outside; later 3 is the largest.
        for (bound, is_broken) in [(4.0, false), (2.9985, false), (2.9965, true), (2.0, true)] {
            assert_eq!(breaks(&controller(bound), &trace().states), is_broken, "{bound}");
        }
    }
}
