//! Batches against steps, loops and models one by one.

use pinc_batch::{Loops, ModelBatch, NmpcBatch, Situations};
use pinc_mpc::{
    Bounds, ClosedLoop, Given, MpcError, Nmpc, NmpcProblem, Reference, Softness, SqpConfig,
    SqpStatus, Tracked, Weights,
};
use pinc_ode::{AccurateIntegrator, Model, Rk4, Simulator};
use pinc_plants::{FourTanks, VanDerPol};

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
fn gradients_are_those_of_the_controller() {
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
        let mut one = nmpc.sensitivity(&reference, &[2.0, 2.5], None).unwrap();
        assert_eq!(one.regularity(), found.regularities[k], "{k}");
        let gradient = one.adjoint(&[], &[1.0, -0.5]).unwrap();
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(gradient.values()), bits(found.gradients[k].values()), "{k}");
        assert_eq!(gradient.get(Given::State).len(), 4);
    }
}

#[test]
fn loops_are_those_of_one_controller() {
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
        assert_eq!(run.tracking_at_steps().iae_sum(), trace.iae, "{k}");
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
    assert_eq!(next, found[12..16]);
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
    let nan = [f64::NAN, 1.0];
    assert!(batch.steps(Situations { u_before: &nan, ..at }).is_err());
    let none = Situations { x: &[], ..at };
    assert!(batch.steps(none).unwrap().u.is_empty());
}
