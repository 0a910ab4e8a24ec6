//! Situations along closed loops and around them, and the plans made there.

use crate::check::{TOLERANCE, size};
use crate::judge::Trace;
use crate::policy::{Limits, Scale};
use crate::{Rater, Region, See, ShrinkError, in_parts};
use pinc_batch::{Loops, NmpcBatch};
use pinc_mpc::{
    BoundSchedule, Bounds, MpcError, Nmpc, NmpcProblem, Reference, SqpStatus, Timetable,
};
use pinc_ode::{Dims, Simulator};
use pinc_sensitivity::{Given, Regularity, Sensitivity};
use rand::RngExt;
use rand::rngs::ChaCha8Rng;

/// How far from a loop its neighbours are drawn, as a part of the region's width.
const AROUND: f64 = 0.15;

/// By how much the bounds on states are tightened for the plans that a net is trained on, as a part of
/// their size: the net's errors may use the rest.
const BACK_OFF: f64 = 0.01;

/// A loop is left where a state is this far outside the region, as a part of the region's width: no
/// plan there says how to control within it.
const LEFT: f64 = 0.5;

/// One situation of so many steps of a loop is taken.
const EVERY: usize = 4;

/// So many situations after each jump of the reference are taken, as transients are short.
const AFTER_JUMP: usize = 3;

/// An input counts as bounded if it is nearer to its bound than this part of the bounds' width.
const AT_BOUND: f64 = 1e-6;

/// So many plans are made, and so many loops run, before the caller is asked whether to go on.
const PLANS: usize = 64;
pub(crate) const LOOPS: usize = 8;

/// So many times as many loops are drawn as are needed, at most.
const TRIES: usize = 20;

/// Loops to be run: their first states, their references, and the controller's plans at their
/// beginning.
#[derive(Clone, Debug)]
pub(crate) struct Drawn {
    pub(crate) x: Vec<f64>,
    pub(crate) references: Vec<Reference>,
    pub(crate) plans: Vec<Vec<f64>>,
}

/// A situation: state, values to follow and the input applied last, one behind the other.
pub(crate) type Situation = Vec<f64>;

/// A plan in a situation, and its derivative along one direction.
#[derive(Clone, Debug)]
pub(crate) struct Label {
    pub(crate) at: Situation,
    pub(crate) plan: Vec<f64>,
    pub(crate) direction: Vec<f64>,
    /// `None` where the plan has no derivative.
    pub(crate) slope: Option<Vec<f64>>,
    /// Per input: -1 at its lower bound, 1 at its upper bound, 0 elsewhere.
    pub(crate) sides: Vec<i8>,
}

fn uniform(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    if high > low { random.random_range(low..high) } else { low }
}

fn point(random: &mut ChaCha8Rng, within: &Bounds) -> Vec<f64> {
    within.low.iter().zip(&within.high).map(|(low, high)| uniform(random, *low, *high)).collect()
}

impl Drawn {
    /// So many loops with first states and references drawn from `region`, where the controller has
    /// an optimal plan within the bounds; each follows two values, one after the other, for `hold`
    /// steps each.
    pub(crate) fn new(
        batch: &mut NmpcBatch,
        region: &Region,
        (loops, hold): (usize, usize),
        (random, see): (&mut ChaCha8Rng, &mut See<'_>),
    ) -> Result<Self, ShrinkError> {
        let mut drawn = Self { x: Vec::new(), references: Vec::new(), plans: Vec::new() };
        for _ in 0..TRIES {
            let more: Vec<_> = (drawn.plans.len()..loops)
                .map(|_| {
                    [&region.states, &region.references, &region.references]
                        .map(|of| point(random, of))
                })
                .collect();
            let one = |nmpc: &mut Nmpc, k: usize| {
                let [x, r, _] = &more[k];
                let Some(plan) = plan(nmpc, [x, r, &region.u_before])? else { return Ok(None) };
                let at = [&x[..], r, &region.u_before];
                let rating = Rater::new(nmpc).rate(&mut nmpc.program(), at, &plan);
                Ok((rating.violation < TOLERANCE).then_some(plan))
            };
            let plans = in_parts((more.len(), PLANS), see, |part| -> Result<Vec<_>, MpcError> {
                batch.each(part.len(), |nmpc, k| one(nmpc, part.start + k)).into_iter().collect()
            })?;
            for ([x, first, then], plan) in more.into_iter().zip(plans) {
                let Some(plan) = plan else { continue };
                drawn.x.extend(x);
                let rows = [first.repeat(hold), then.repeat(hold)].concat();
                drawn.references.push(Reference::new(rows, region.references.low.len())?);
                drawn.plans.push(plan);
            }
        }
        match drawn.plans.len() {
            found if found < loops => Err(ShrinkError::Labels { found, drawn: loops * TRIES }),
            _ => Ok(drawn),
        }
    }

    /// Reference, first state and input before of a loop.
    pub(crate) fn at<'a>(
        &'a self,
        k: usize,
        region: &'a Region,
    ) -> (&'a Reference, &'a [f64], &'a [f64]) {
        let n = region.states.low.len();
        (&self.references[k], &self.x[k * n..(k + 1) * n], &region.u_before)
    }

    /// The loops under the controller; `None` for one that does not reach its end.
    pub(crate) fn run(
        &self,
        batch: &mut NmpcBatch,
        plant: &Simulator,
        u_before: &[f64],
        see: &mut See<'_>,
    ) -> Result<Vec<Option<Trace>>, ShrinkError> {
        let n = self.x.len() / self.references.len();
        let traces = in_parts((self.references.len(), LOOPS), see, |part| {
            batch.loops(Loops {
                x: &self.x[part.start * n..part.end * n],
                references: &self.references[part],
                plants: std::slice::from_ref(plant),
                u_before,
                preview: false,
            })
        })?;
        let whole = traces.into_iter().map(|trace| {
            let optimized = trace.statuses.len();
            let whole = trace.error.is_none();
            let (states, inputs) = (trace.states, trace.inputs);
            whole.then_some(Trace { states, inputs, kept: 0, optimized })
        });
        Ok(whole.collect())
    }

    /// How many situations at least there are of a loop that follows each value for `hold` steps and
    /// does not leave the region.
    pub(crate) fn per_loop(hold: usize) -> usize {
        2 * (2 * hold / EVERY + 2 * (AFTER_JUMP.min(hold) - 1))
    }

    /// Situations of the loops, as long as these stay about where they are to: one of each few steps
    /// and those after jumps, and beside each one drawn around it.
    pub(crate) fn situations(
        &self,
        traces: &[Option<Trace>],
        region: &Region,
        inputs: &Bounds,
        random: &mut ChaCha8Rng,
    ) -> Vec<Situation> {
        let (n, m) = (region.states.low.len(), region.u_before.len());
        let ends = || region.states.low.iter().zip(&region.states.high);
        let is_near = |x: &[f64]| {
            let parts = x.iter().zip(ends());
            parts.into_iter().all(|(value, (low, high))| {
                let margin = LEFT * (high - low);
                (low - margin..=high + margin).contains(value)
            })
        };
        let mut all = Vec::new();
        for (trace, reference) in traces.iter().zip(&self.references) {
            let Some(trace) = trace else { continue };
            let (first, steps) = (random.random_range(0..EVERY), trace.inputs.len() / m);
            let states = trace.states.chunks_exact(n).take(steps);
            let inside = states.take_while(|x| is_near(x)).count();
            let jumps = |k: &usize| k % (steps / 2).max(1) < AFTER_JUMP || k % EVERY == first;
            for k in (0..inside).filter(jumps) {
                let x = &trace.states[k * n..(k + 1) * n];
                let before = match k.checked_sub(1) {
                    None => &region.u_before[..],
                    Some(k) => &trace.inputs[k * m..(k + 1) * m],
                };
                all.push([x, reference.at(k), before].concat());
                let mut near = |values: &[f64], within: &Bounds| -> Vec<f64> {
                    let ends = within.low.iter().zip(&within.high);
                    let moved = values.iter().zip(ends).map(|(value, (low, high))| {
                        let width = if (high - low).is_finite() { high - low } else { 1.0 };
                        let step = AROUND * width;
                        let moved = value + uniform(random, -step, step);
                        moved.max(low.min(*value)).min(high.max(*value))
                    });
                    moved.collect()
                };
                let around = [
                    near(x, &region.states),
                    near(reference.at(k), &region.references),
                    near(before, inputs),
                ];
                all.push(around.concat());
            }
        }
        all
    }
}

/// Plans with their derivatives, along one random direction each; situations without an optimal
/// plan are left out.
pub(crate) fn label(
    batch: &mut NmpcBatch,
    situations: &[Situation],
    (scale, limits): (&Scale, &Limits),
    (random, see): (&mut ChaCha8Rng, &mut See<'_>),
) -> Result<Vec<Label>, ShrinkError> {
    let dims = batch.nmpc().model().dims();
    let [tight, own] = [BACK_OFF, 0.0].map(|part| tightened(batch.nmpc().problem(), dims, part));
    let bounds = [tight?, own?];
    let directions: Vec<Vec<f64>> = situations
        .iter()
        .map(|at| {
            let drawn: Vec<f64> = at.iter().map(|_| random.random_range(-1.0..1.0)).collect();
            let norm = drawn.iter().map(|d| d * d).sum::<f64>().sqrt().max(1e-9);
            drawn.into_iter().zip(&scale.half).map(|(d, half)| half * d / norm).collect()
        })
        .collect();
    let label = |nmpc: &mut Nmpc, k: usize| {
        let mut plan = |bounds| {
            nmpc.set_bounds_at(bounds, 0, false);
            one(nmpc, &situations[k], &directions[k], limits)
        };
        let [tight, own] = &bounds;
        // A state may be between both.
        let label = match plan(tight) {
            Ok(None) => plan(own),
            found => found,
        };
        nmpc.set_bounds_at(own, 0, false);
        label
    };
    let labels = in_parts((situations.len(), PLANS), see, |part| -> Result<Vec<_>, _> {
        batch.each(part.len(), |nmpc, k| label(nmpc, part.start + k)).into_iter().collect()
    })?;
    Ok(labels.into_iter().flatten().collect())
}

/// The bounds of a problem, with those on states and outputs moved inwards by a part of their size.
fn tightened(problem: &NmpcProblem, dims: Dims, part: f64) -> Result<BoundSchedule, MpcError> {
    let mut row = BoundSchedule::row(problem, dims);
    let width = row.len() / 2;
    let (lows, highs) = row.split_at_mut(width);
    for (i, (low, high)) in lows.iter_mut().zip(highs).enumerate() {
        if !(dims.nx..dims.nx + dims.nu).contains(&i) {
            let step = part * size(*low, *high);
            (*low, *high) = (*low + step, *high - step);
        }
    }
    BoundSchedule::new(Timetable::new(row.len(), [(0, row)])?, problem, dims)
}

/// State, values to follow and input of a situation.
pub(crate) fn parts(nmpc: &Nmpc, at: &[f64]) -> [Vec<f64>; 3] {
    let (n, outputs) = (nmpc.model().dims().nx, nmpc.problem().tracked.len());
    [at[..n].to_vec(), at[n..n + outputs].to_vec(), at[n + outputs..].to_vec()]
}

/// The plan of a controller that knows nothing of a step before; `None` if it is not optimal.
fn plan(nmpc: &mut Nmpc, [x, r, u_before]: [&[f64]; 3]) -> Result<Option<Vec<f64>>, MpcError> {
    nmpc.reset_input(u_before)?;
    let status = nmpc.step(x, &r.repeat(nmpc.problem().horizon))?.status;
    Ok((status == SqpStatus::Converged).then(|| nmpc.plan().inputs().to_vec()))
}

fn one(
    nmpc: &mut Nmpc,
    at: &[f64],
    direction: &[f64],
    limits: &Limits,
) -> Result<Option<Label>, MpcError> {
    let [x, r, u_before] = parts(nmpc, at);
    let Some(plan) = plan(nmpc, [&x, &r, &u_before])? else { return Ok(None) };
    let reference = r.repeat(nmpc.problem().horizon);
    let bounds = plan.iter().zip(limits.bounds.low.iter().zip(&limits.bounds.high));
    let side = |(u, (low, high)): (&f64, (&f64, &f64))| {
        let near = AT_BOUND * if (high - low).is_finite() { high - low } else { 1.0 };
        if u - low < near { -1 } else { i8::from(high - u < near) }
    };
    let sides = bounds.map(side).collect();
    let [dx, dr, du] = parts(nmpc, direction);
    let dr = dr.repeat(nmpc.problem().horizon);
    let mut sensitivity = Sensitivity::new(nmpc, &reference, &u_before, None)?;
    let mut change = sensitivity.no_change();
    for (given, values) in [(Given::State, dx), (Given::Reference, dr), (Given::AppliedInput, du)] {
        change.get_mut(given).copy_from_slice(&values);
    }
    let slope = match sensitivity.regularity() {
        Regularity::Regular => Some(sensitivity.forward(&change)?.inputs().to_vec()),
        _ => None,
    };
    let slope = slope.filter(|slope| slope.iter().all(|value| value.is_finite()));
    Ok(Some(Label { at: at.to_vec(), plan, direction: direction.to_vec(), slope, sides }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_mpc::{Bounded, Tracked, Weights};

    const INFINITE: f64 = f64::INFINITY;

    /// Bounds of states and outputs move inwards: by a part of half their width, or of 1 and the bound
    /// where there is one alone. Bounds of inputs stay.
    #[test]
    fn plans_keep_a_distance_from_bounds_of_states_and_outputs() {
        let dims = Dims::new(2, 1).with_outputs(1);
        let problem = NmpcProblem {
            tracked: Tracked::states([0]),
            state_bounds: Bounds::new(vec![-2.0, 4.0], vec![3.0, INFINITE]),
            input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
            output_bounds: Some(Bounds::new(vec![-INFINITE], vec![-4.0])),
            ..NmpcProblem::new(dims, 3, Weights::uniform(vec![1.0], vec![1.0]))
        };
        let bounds = tightened(&problem, dims, 0.01).unwrap();
        for (of, expected) in [
            (Bounded::State(0), [-1.975, 2.975]),
            (Bounded::State(1), [4.05, INFINITE]),
            (Bounded::Input(0), [-1.0, 1.0]),
            (Bounded::Output(0), [-INFINITE, -4.05]),
        ] {
            for (found, expected) in bounds.at(0, of).into_iter().zip(expected) {
                let near = found.total_cmp(&expected).is_eq() || (found - expected).abs() < 1e-12;
                assert!(near, "{of:?}: {found} {expected}");
            }
        }
        let own = tightened(&problem, dims, 0.0).unwrap();
        assert_eq!(own.at(0, Bounded::State(0)).to_vec(), [-2.0, 3.0]);
    }

    /// A loop that follows two values for ten steps each has five situations of every fourth step and,
    /// after each of two jumps, two more that are not among these; beside each is one drawn around it.
    #[test]
    fn situations_of_a_loop_are_counted() {
        assert_eq!(Drawn::per_loop(10), 2 * (5 + 2 * 2));
        assert_eq!(Drawn::per_loop(1), 0);
        assert_eq!(Drawn::per_loop(2), 2 * (1 + 2));
    }
}
