//! Batches against steps, loops and models one by one.

use pinc_batch::{GradientLoops, LoopCost, Loops, ModelBatch, NmpcBatch, Situations};
use pinc_loop::ClosedLoop;
use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, Reference, Softness, SqpConfig, SqpStatus, Tracked,
    Weights,
};
use pinc_ode::{
    AccurateIntegrator, Dims, Linearization, Model, OutputLinearization, Rk4, Simulator, Stages,
};
use pinc_plants::{FourTanks, VanDerPol};
use pinc_sensitivity::{Given, Regularity, Sensitivity};

fn tanks() -> Rk4<FourTanks> {
    Rk4::new(FourTanks::antonelo(), 10.0, 4)
}

fn nmpc() -> Result<Nmpc, MpcError> {
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0; 2]);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds::new(vec![2.0, 2.0, 0.6, 0.6], vec![20.0, 20.0, 5.5, 5.5]),
        state_softness: Softness::Exact,
        input_bounds: Bounds::new(vec![0.0; 2], vec![5.0; 2]),
        ..NmpcProblem::new(tanks().dims(), 5, weights)
    };
    Nmpc::new(problem, Box::new(tanks()), SqpConfig::default())
}

/// A controller whose units follow the states: without bounds, these tell how large they are.
fn oscillator() -> Result<Nmpc, MpcError> {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0]);
    Nmpc::new(NmpcProblem::new(model.dims(), 5, weights), Box::new(model), SqpConfig::default())
}

/// Numbers that are spread over [0, 1).
fn spread(k: usize) -> f64 {
    (k as f64 * 0.618_033_988_749_895).fract()
}

fn states(count: usize) -> Vec<f64> {
    (0..count * 4)
        .map(|i| match i % 4 {
            0 | 1 => 2.0 + 18.0 * spread(i),
            _ => 0.6 + 4.9 * spread(i),
        })
        .collect()
}

/// Asked to stop before the first items, every thread ends there, and the next batch is whole.
#[test]
fn a_batch_that_is_asked_to_stop_leaves_out_the_last_items() {
    let x = states(200);
    let at = Situations { x: &x, reference: &[9.0; 10], u_before: &[1.0; 2], parameters: &[] };
    let mut batch = NmpcBatch::new(1, nmpc).unwrap();
    batch.ask_to_stop(|| true);
    assert!(batch.steps(at).unwrap().statuses.is_empty());
    assert!(batch.each(200, |_, k| k).is_empty());
    batch.ask_to_stop(|| false);
    assert_eq!(batch.steps(at).unwrap().statuses.len(), 200);
}

#[test]
fn steps_are_the_same_alone_and_on_any_number_of_threads() {
    let count = 200;
    let x = states(count);
    let reference: Vec<f64> =
        (0..count).flat_map(|k| [5.0 + 10.0 * spread(3 * k), 12.0].repeat(5)).collect();
    let u_before: Vec<f64> = (0..count * 2).map(|i| 5.0 * spread(i + 7)).collect();
    let at = Situations { x: &x, reference: &reference, u_before: &u_before, parameters: &[] };
    let alone = NmpcBatch::new(1, nmpc).unwrap().steps(at).unwrap();
    for threads in [2, 5] {
        let mut batch = NmpcBatch::new(threads, nmpc).unwrap();
        assert_eq!(batch.steps(at).unwrap(), alone, "{threads}");
        assert_eq!(batch.steps(at).unwrap(), alone, "{threads}, again");
    }
    for k in (0..count).step_by(17) {
        let mut nmpc = nmpc().unwrap();
        nmpc.reset_to(&x[4 * k..][..4], &u_before[2 * k..][..2]).unwrap();
        let step = nmpc.step(&x[4 * k..][..4], &reference[10 * k..][..10]).unwrap();
        assert_eq!(step.u, &alone.u[2 * k..][..2], "{k}");
        assert_eq!(step.status, alone.statuses[k], "{k}");
        assert_eq!(step.sqp_iterations, alone.sqp_iterations[k], "{k}");
        assert_eq!(nmpc.plan().inputs(), &alone.inputs[10 * k..][..10], "{k}");
    }
    let converged = alone.statuses.iter().filter(|status| **status == SqpStatus::Converged);
    assert!(converged.count() > count / 2);
}

#[test]
fn a_large_state_leaves_no_trace_in_the_steps_after_it() {
    let x: Vec<f64> =
        (0..40).flat_map(|k| if k % 3 == 0 { [3e4, 0.0] } else { [spread(k), 0.1] }).collect();
    let at = Situations { x: &x, reference: &[0.0; 10], u_before: &[0.0], parameters: &[] };
    let together = NmpcBatch::new(1, oscillator).unwrap().steps(at).unwrap();
    for k in 0..40 {
        let at = Situations { x: &x[2 * k..][..2], ..at };
        let alone = NmpcBatch::new(1, oscillator).unwrap().steps(at).unwrap();
        assert_eq!(alone.u[0].to_bits(), together.u[k].to_bits(), "{k}");
        assert_eq!(alone.sqp_iterations[0], together.sqp_iterations[k], "{k}");
    }
}

#[test]
fn gradients_match_the_controller() {
    let x = states(30);
    let reference = [12.0, 11.0].repeat(5);
    let at = Situations { x: &x, reference: &reference, u_before: &[2.0, 2.5], parameters: &[] };
    let mut batch = NmpcBatch::new(2, nmpc).unwrap();
    let found = batch.gradients(at, &[1.0, -0.5], None).unwrap();
    assert_eq!(found.steps, batch.steps(at).unwrap());
    for k in 0..30 {
        let mut nmpc = nmpc().unwrap();
        nmpc.reset_to(&x[4 * k..][..4], &[2.0, 2.5]).unwrap();
        nmpc.step(&x[4 * k..][..4], &reference).unwrap();
        let mut one = Sensitivity::new(&mut nmpc, &reference, &[2.0, 2.5], None).unwrap();
        assert_eq!(one.regularity(), found.regularities[k], "{k}");
        let gradient = one.adjoint(&[], &[1.0, -0.5]).unwrap();
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(gradient.values()), bits(found.gradients[k].values()), "{k}");
        assert_eq!(gradient.get(Given::State).len(), 4);
    }
    // A state that is no number has no plan, whatever the controller planned before.
    let x = [&x[..80], &[f64::NAN], &x[81..]].concat();
    let found = batch.gradients(Situations { x: &x, ..at }, &[1.0, -0.5], None).unwrap();
    let is_nan = |k: usize| found.gradients[k].values().iter().all(|v| v.is_nan());
    assert_eq!([19, 20, 21].map(is_nan), [false, true, false]);
    assert!(found.by_under_way[40..42].iter().all(|v| v.is_nan()));
    assert_eq!(found.regularities[20], Regularity::NotOptimal);
}

/// A controller of [`Scaled`] whose inputs act after two steps.
fn delayed(tolerance: f64) -> Result<Nmpc, MpcError> {
    delayed_with([2.0, 0.5], tolerance)
}

/// The same with these weights of errors and of increments.
fn delayed_with([q, r]: [f64; 2], tolerance: f64) -> Result<Nmpc, MpcError> {
    let problem = NmpcProblem {
        delay: 2,
        parameters: vec![0.8],
        ..NmpcProblem::new(Scaled.dims(), 4, Weights::uniform(vec![q], vec![r]))
    };
    let config = SqpConfig { tolerance, ..SqpConfig::default() };
    Nmpc::new(problem, Box::new(Scaled), config)
}

/// With a delay the gradients are those in what the steps are given, not in the predicted state.
#[test]
fn gradients_go_through_a_delay() {
    let make = || delayed(1e-11);
    let mut batch = NmpcBatch::new(1, make).unwrap();
    let mut at = |[x, u, p]: &[[f64; 1]; 3]| {
        let at = Situations { x, reference: &[0.3; 4], u_before: u, parameters: p };
        let found = batch.gradients(at, &[1.0], None).unwrap();
        assert_eq!(found.steps.statuses, [SqpStatus::Converged]);
        (found.steps.u[0], found.gradients.into_iter().next().unwrap())
    };
    let middle = [[0.7], [0.2], [0.8]];
    let gradient = at(&middle).1;
    for (i, given) in [Given::State, Given::AppliedInput, Given::Parameters].into_iter().enumerate()
    {
        let mut moved = |step: f64| {
            let mut numbers = middle;
            numbers[i][0] += step;
            at(&numbers).0
        };
        let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        let found = gradient.get(given)[0];
        assert!((found - difference).abs() < 1e-8, "{given:?}: {found}, {difference}");
    }
}

/// A controller that goes on by itself knows its inputs under way; steps are given them.
#[test]
fn steps_take_all_inputs_under_way() {
    let make = || delayed(1e-12);
    let (mut batch, mut one) = (NmpcBatch::new(1, make).unwrap(), make().unwrap());
    let (mut x, mut under_way) = ([0.7], vec![0.0; 2]);
    for _ in 0..5 {
        let at = Situations { x: &x, reference: &[0.3; 4], u_before: &under_way, parameters: &[] };
        let u = one.step(&x, &[0.3; 4]).unwrap().u[0];
        let found = batch.gradients(at, &[1.0], None).unwrap();
        assert!((found.steps.u[0] - u).abs() < 1e-9, "{} {u}", found.steps.u[0]);
        for j in 0..2 {
            let mut moved = |by: f64| {
                let mut u_before = under_way.clone();
                u_before[j] += by;
                batch.steps(Situations { u_before: &u_before, ..at }).unwrap().u[0]
            };
            let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((found.by_under_way[j] - difference).abs() < 1e-8, "{j}: {difference}");
        }
        let sum: f64 = found.by_under_way.iter().sum();
        assert!((sum - found.gradients[0].get(Given::AppliedInput)[0]).abs() < 1e-14);
        let acts = under_way.remove(0);
        under_way.push(u);
        let before = x;
        Scaled.step(&before, &[acts], &[0.8], &mut x);
    }
    let three = Situations { x: &x, reference: &[0.3; 4], u_before: &[0.0; 3], parameters: &[] };
    assert!(batch.steps(three).is_err());
}

/// The first increment that is weighted is from the input that is applied last of those under way.
#[test]
fn gradients_in_weights_go_through_a_delay() {
    let at =
        Situations { x: &[0.7], reference: &[0.3; 4], u_before: &[0.9, -0.4], parameters: &[] };
    let found = |weights: [f64; 2]| {
        let mut batch = NmpcBatch::new(1, || delayed_with(weights, 1e-11)).unwrap();
        let found = batch.gradients(at, &[1.0], None).unwrap();
        (found.steps.u[0], found.gradients.into_iter().next().unwrap())
    };
    let gradient = found([2.0, 0.5]).1;
    for (i, given) in [Given::Q, Given::R].into_iter().enumerate() {
        let moved = |by: f64| {
            let mut weights = [2.0, 0.5];
            weights[i] += by;
            found(weights).0
        };
        let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        let found = gradient.get(given)[0];
        assert!(difference.abs() > 1e-3, "{given:?}: {difference}");
        assert!((found - difference).abs() < 1e-7, "{given:?}: {found}, {difference}");
    }
}

#[test]
fn loops_match_one_controller() {
    let reference = |k: usize| Reference::new([5.0 + 9.0 * spread(k), 10.0].repeat(12), 2).unwrap();
    let references: Vec<_> = (0..9).map(reference).collect();
    let plant: Simulator = AccurateIntegrator::new(FourTanks::antonelo(), 1e-9).into();
    let plants = [plant];
    let x = states(9);
    let given = Loops {
        x: &x,
        references: &references,
        plants: &plants,
        u_before: &[1.0, 2.0],
        preview: false,
    };
    let found = NmpcBatch::new(2, nmpc).unwrap().loops(given).unwrap();
    assert_eq!(NmpcBatch::new(1, nmpc).unwrap().loops(given).unwrap(), found);
    for (k, trace) in found.iter().enumerate() {
        let mut nmpc = nmpc().unwrap();
        let plant = plants[0].clone();
        let run = ClosedLoop::new(&mut nmpc, plant, references[k].clone(), &x[4 * k..][..4]);
        let run = run.unwrap().with_initial_input(&[1.0, 2.0]).unwrap();
        let mut run = run.without_preview();
        run.run().unwrap();
        assert_eq!(run.state(), &trace.states[12 * 4..], "{k}");
        assert_eq!(run.tracking_at_steps().iae_sum().to_bits(), trace.iae.to_bits(), "{k}");
        assert_eq!((trace.inputs.len(), trace.statuses.len()), (24, 12));
        assert_eq!(trace.error, None);
    }
}

#[test]
fn a_rollout_is_one_step_after_another() {
    let x = states(50);
    let u = [1.0, 2.0, 3.0, 2.0, 0.5, 4.0];
    let mut batch = ModelBatch::new(3, || Box::new(tanks()));
    let found = batch.rollouts(&x, &u, &[]).unwrap();
    let mut at = x.clone();
    for step in 0..3 {
        at = batch.steps(&at, &u[2 * step..][..2], &[]).unwrap();
        for k in 0..50 {
            assert_eq!(found[(3 * k + step) * 4..][..4], at[4 * k..][..4], "{k}");
        }
    }
    let mut next = [0.0; 4];
    tanks().step(&x[4..8], &u[..2], &[], &mut next);
    assert_eq!(next.map(f64::to_bits), [0, 1, 2, 3].map(|i| found[12 + i].to_bits()));
}

/// x+ = p x + u
#[derive(Debug)]
struct Scaled;

impl Model for Scaled {
    fn dims(&self) -> Dims {
        Dims::new(1, 1).with_parameters(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        next[0] = p[0] * x[0] + u[0];
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        for (k, p) in at.p.iter().enumerate() {
            out.next[k] = p * at.x[k] + at.u[k];
            (out.a[k], out.b[k]) = (*p, 1.0);
            out.e.get_mut(k).into_iter().for_each(|by_p| *by_p = at.x[k]);
        }
    }
}

#[test]
fn each_rollout_has_its_own_parameters() {
    for threads in [1, 2] {
        let mut batch = ModelBatch::new(threads, || Box::new(Scaled));
        let found = batch.rollouts(&[1.0, 1.0, 3.0], &[0.5, -1.0], &[2.0, 0.0, -1.0]).unwrap();
        assert_eq!(found, [2.5, 4.0, 0.5, -1.0, -2.5, 1.5], "{threads}");
        let found = batch.steps(&[1.0, 1.0, 3.0], &[0.5], &[2.0]).unwrap();
        assert_eq!(found, [2.5, 2.5, 6.5], "one for all");
    }
}

#[test]
fn lists_of_the_wrong_length_are_named() {
    let mut batch = NmpcBatch::new(1, nmpc).unwrap();
    let (x, reference) = (states(3), [12.0, 11.0].repeat(5));
    let at = Situations { x: &x, reference: &reference, u_before: &[0.0; 2], parameters: &[] };
    for (at, message) in [
        (Situations { x: &x[..11], ..at }, "x: 11 numbers, but 8 are expected"),
        (
            Situations { reference: &reference[..9], ..at },
            "reference: 9 numbers, but 30 are expected",
        ),
        (Situations { u_before: &[0.0; 3], ..at }, "u_before: 3 numbers, but 6 are expected"),
    ] {
        assert_eq!(batch.steps(at).unwrap_err().to_string(), message);
    }
    let none = Situations { x: &[], ..at };
    assert!(batch.steps(none).unwrap().u.is_empty());
}

/// So are weights of a loop's cost, and a controller or plant that such a loop cannot have.
#[test]
fn parts_of_loops_of_the_wrong_size_are_named() {
    let references = [Reference::new(vec![0.3; 8], 2).unwrap()];
    let weights = |count: usize| vec![1.0; count];
    let refused = |counts: [usize; 3], references: &[Reference], delay: usize| {
        let [errors, increments, violations] = counts.map(weights);
        let cost = LoopCost { errors: &errors, increments: &increments, violations: &violations };
        let given = GradientLoops {
            x: &[0.7; 6],
            references,
            u_before: &[0.0],
            parameters: &[],
            cost,
            smoothing: None,
            preview: true,
        };
        let plant = || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)) as Box<dyn Model>;
        let mut batch = NmpcBatch::new(1, || moving(delay)).unwrap();
        batch.loop_gradients(given, plant).map_err(|error| error.to_string()).err()
    };
    let said = |what: &str| Some(what.to_owned());
    assert_eq!(refused([2, 1, 2], &references, 0), None);
    let (all, two) = ([2, 1, 2], [references.clone(), references.clone()].concat());
    for (found, expected) in [
        (refused([3, 1, 2], &references, 0), "cost.errors: 3 numbers, but 2 are expected"),
        (refused([2, 2, 2], &references, 0), "cost.increments: 2 numbers, but 1 are expected"),
        (refused([2, 1, 1], &references, 0), "cost.violations: 1 numbers, but 2 are expected"),
        (refused(all, &two, 0), "references: 2 numbers, but 3 are expected"),
        (refused(all, &references, 1), "the problem's delay: 1 numbers, but 0 are expected"),
    ] {
        assert_eq!(found, said(expected));
    }
}

/// A controller of the oscillator whose inputs are from 0 to 4, moves from -2 to 1, and act after
/// `delay` steps.
fn moving(delay: usize) -> Result<Nmpc, MpcError> {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let problem = NmpcProblem {
        delay,
        input_bounds: Bounds::new(vec![0.0], vec![4.0]),
        increment_bounds: Bounds::new(vec![-2.0], vec![1.0]),
        ..NmpcProblem::new(model.dims(), 4, Weights::uniform(vec![2.0; 2], vec![0.5]))
    };
    Nmpc::new(problem, Box::new(model), SqpConfig::default())
}

/// An allowed move leads from what was applied to the inputs' bounds, up to rounding.
#[test]
fn inputs_before_lead_to_their_bounds() {
    fn at(u_before: &[f64]) -> Situations<'_> {
        Situations { x: &[0.7; 6], reference: &[0.3; 8], u_before, parameters: &[] }
    }
    let mut batch = NmpcBatch::new(1, || moving(0)).unwrap();
    let model = || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)) as Box<dyn Model>;
    let references = [Reference::new(vec![0.3; 8], 2).unwrap()];
    let plants = [AccurateIntegrator::new(VanDerPol::default(), 1e-9).into()];
    let mut refusals = |u_before: &[f64]| {
        let references = &references;
        let loops = Loops { x: &[0.7; 6], references, plants: &plants, u_before, preview: true };
        let differentiated = GradientLoops {
            x: &[0.7; 6],
            references,
            u_before,
            parameters: &[],
            cost: LoopCost { errors: &[1.0; 2], increments: &[1.0], violations: &[1.0; 2] },
            smoothing: None,
            preview: true,
        };
        [
            batch.steps(at(u_before)).err(),
            batch.gradients(at(u_before), &[1.0], None).err(),
            batch.loops(loops).err(),
            batch.loop_gradients(differentiated, model).err(),
        ]
        .map(|error| error.map(|error| error.to_string()))
    };
    let expected = "must be where a move within its bounds leads to those of the input";
    for (u_before, message) in [
        (&[9.0][..], format!("u_before[0] is 9, but {expected}")),
        (&[0.0, 6.1, 2.0], format!("u_before[1] is 6.1, but {expected}")),
        (&[0.0, 2.0, -1.1], format!("u_before[2] is -1.1, but {expected}")),
        (&[f64::NAN], "u_before[0] is NaN, but must be finite".to_owned()),
    ] {
        assert_eq!(refusals(u_before), [(); 4].map(|()| Some(message.clone())));
    }
    for reached in [&[6.0_f64][..], &[-1.0], &[6.0 + 1e-7, 2.0, -1.0]] {
        assert_eq!(refusals(reached), [const { None }; 4], "{reached:?}");
    }
    // With a delay it is the last one under way from which the next one moves.
    let mut delayed = NmpcBatch::new(1, || moving(2)).unwrap();
    assert!(delayed.steps(Situations { x: &[0.7; 2], ..at(&[9.0, 2.0]) }).is_ok());
    let error = delayed.steps(Situations { x: &[0.7; 2], ..at(&[2.0, 9.0]) }).unwrap_err();
    assert_eq!(error.to_string(), format!("u_before[1] is 9, but {expected}"));
}

/// A controller of the oscillator with these weights, a softened bound, and a terminal weight.
fn tuned(q: [f64; 2], r: f64, terminal: f64, penalty: f64) -> Result<Nmpc, MpcError> {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let weights = Weights::uniform(q.to_vec(), vec![r]).with_terminal(vec![terminal, 1.0]);
    let problem = NmpcProblem {
        control_horizon: 3,
        state_bounds: Bounds::new(vec![-0.25, -2.0], vec![0.6, 2.0]),
        state_softness: Softness::Penalty(vec![penalty, 50.0]),
        input_bounds: Bounds::new(vec![-0.7], vec![0.7]),
        ..NmpcProblem::new(model.dims(), 5, weights)
    };
    let config = SqpConfig { tolerance: 1e-11, max_iterations: 200, ..SqpConfig::default() };
    Nmpc::new(problem, Box::new(model), config)
}

/// The plant differs from the model, so that the loop does not follow the plans.
#[test]
fn gradients_of_loops_match_differences() {
    let plant = || -> Box<dyn Model> { Box::new(Rk4::new(VanDerPol { mu: 1.3 }, 0.5, 8)) };
    let values: Vec<f64> = (0..14).flat_map(|k| [if k < 7 { 0.5 } else { -0.3 }, 0.0]).collect();
    let reference = [Reference::new(values, 2).unwrap()];
    let cost = LoopCost { errors: &[3.0, 0.5], increments: &[0.2], violations: &[40.0, 1.0] };
    let run = |numbers: [f64; 8], threads: usize| {
        let [q1, q2, r, terminal, penalty, x1, x2, before] = numbers;
        let mut batch = NmpcBatch::new(threads, || tuned([q1, q2], r, terminal, penalty)).unwrap();
        let given = GradientLoops {
            x: &[x1, x2],
            references: &reference,
            u_before: &[before],
            parameters: &[],
            cost,
            smoothing: None,
            preview: true,
        };
        batch.loop_gradients(given, plant).unwrap().remove(0)
    };
    let at = [8.0, 1.0, 0.4, 12.0, 3.0, 0.1, -0.35, 0.1];
    let found = run(at, 1);
    assert_eq!(found, run(at, 2));
    let of = |given: Given, i: usize| found.gradient.get(given)[i];
    let gradient = [
        of(Given::Q, 0),
        of(Given::Q, 1),
        of(Given::R, 0),
        of(Given::Terminal, 0),
        of(Given::StatePenalty, 0),
        of(Given::State, 0),
        of(Given::State, 1),
        of(Given::AppliedInput, 0),
    ];
    assert_eq!(found.irregular, 0);
    let largest = gradient.iter().fold(0.0_f64, |most, g| most.max(g.abs()));
    for (i, gradient) in gradient.into_iter().enumerate() {
        let step = 1e-5 * at[i].abs();
        let moved = |length: f64| {
            let mut numbers = at;
            numbers[i] += length;
            run(numbers, 1).cost
        };
        let expected = (moved(step) - moved(-step)) / (2.0 * step);
        let error = (gradient - expected).abs();
        assert!(error < 1e-6 * largest + 1e-6 * expected.abs(), "{i}: {gradient} {expected}");
    }

    // The cost is what its definition says.
    let mut nmpc = tuned([8.0, 1.0], 0.4, 12.0, 3.0).unwrap();
    nmpc.reset_input(&[0.1]).unwrap();
    let (mut x, mut before, mut sum, mut outside) = (vec![0.1, -0.35], 0.1, 0.0, 0.0);
    for k in 0..14 {
        let mut window = [0.0; 10];
        reference[0].preview(k, &mut window);
        let u = nmpc.step(&x, &window).unwrap().u[0];
        let mut next = [0.0; 2];
        plant().step(&x, &[u], &[], &mut next);
        x = next.to_vec();
        let beyond = (x[0] - 0.6).max(0.0) + (-0.25 - x[0]).max(0.0);
        outside += beyond;
        sum += 3.0 * (x[0] - window[0]).powi(2) + 0.5 * x[1].powi(2) + 40.0 * beyond.powi(2);
        sum += 0.2 * (u - before).powi(2);
        before = u;
    }
    assert!((found.cost - sum).abs() < 1e-9 * sum, "{} {sum}", found.cost);
    assert!(outside > 0.01, "a loop that violates no bound says nothing of their weights");
}

/// x+ = 0.8 x + 0.3 u with the output y = x + 0.4 u, which jumps with the input.
#[derive(Debug)]
struct Jumping;

impl Model for Jumping {
    fn dims(&self) -> Dims {
        Dims::new(1, 1).with_outputs(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        next[0] = 0.8 * x[0] + 0.3 * u[0];
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (at, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.step(at.x, at.u, at.p, out.next);
            (out.a[0], out.b[0]) = (0.8, 0.3);
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        y[0] = x[0] + 0.4 * u[0];
    }

    fn feedthrough(&self) -> Vec<bool> {
        vec![true]
    }

    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (at, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.output(at.x, at.u, at.p, out.y);
            (out.c[0], out.d[0]) = (1.0, 0.4);
        }
    }
}

/// The cost of an output that depends on the input depends on the input without the plant's step.
#[test]
fn gradients_of_loops_see_outputs_that_jump() {
    let references = [Reference::new(vec![0.7; 6], 1).unwrap()];
    let run = |[q, r, x, before]: [f64; 4]| {
        let make = || {
            let weights = Weights::uniform(vec![q], vec![r]);
            let tracked = vec![Tracked::Output(0)];
            let problem = NmpcProblem { tracked, ..NmpcProblem::new(Jumping.dims(), 4, weights) };
            let config = SqpConfig { tolerance: 1e-11, ..SqpConfig::default() };
            Nmpc::new(problem, Box::new(Jumping), config)
        };
        let mut batch = NmpcBatch::new(1, make).unwrap();
        let given = GradientLoops {
            x: &[x],
            references: &references,
            u_before: &[before],
            parameters: &[],
            cost: LoopCost { errors: &[3.0], increments: &[0.2], violations: &[0.0] },
            smoothing: None,
            preview: true,
        };
        batch.loop_gradients(given, || Box::new(Jumping) as Box<dyn Model>).unwrap().remove(0)
    };
    let at = [8.0, 0.4, 0.1, 0.2];
    let found = run(at).gradient;
    for (i, given) in
        [Given::Q, Given::R, Given::State, Given::AppliedInput].into_iter().enumerate()
    {
        let moved = |length: f64| {
            let mut numbers = at;
            numbers[i] += length;
            run(numbers).cost
        };
        let expected = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        let gradient = found.get(given)[0];
        assert!((gradient - expected).abs() < 1e-6 * (1.0 + expected.abs()), "{given:?}");
    }
}
