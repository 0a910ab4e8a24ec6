//! Bounds that a plant breaks in closed loop: by how much, where, and of which quantity.

use crate::problems::four_tanks;
use crate::support::Lag;
use pinc_loop::{ClosedLoop, Violation};
use pinc_mpc::{
    BoundSchedule, Bounded, Bounds, Nmpc, NmpcProblem, Reference, Side, Softness, SqpConfig,
    Timetable, Weights,
};
use pinc_ode::{Dims, Dopri5, Model, Rk4};
use pinc_plants::FourTanks;

const FREE: f64 = f64::INFINITY;

/// x' = (u - x) / 10 with the outputs -x and x + u.
const LAG: Lag = Lag { rate: 0.1, outputs: &[(-1.0, false), (1.0, true)] };

/// What the lag breaks in one step from 1.5 under an input of 1 that is under way.
fn broken_by_the_lag(state_softness: Softness, output_softness: Softness) -> Vec<Violation> {
    broken_from(1.5, 1.0, [state_softness, output_softness])
}

/// What the lag breaks in one step from `x` under the input `u` that is under way.
fn broken_from(x: f64, u: f64, [state_softness, output_softness]: [Softness; 2]) -> Vec<Violation> {
    let problem = NmpcProblem {
        delay: 1,
        input_bounds: Bounds::new(vec![-5.0], vec![5.0]),
        state_bounds: Bounds::new(vec![-FREE], vec![1.2]),
        output_bounds: Some(Bounds::new(vec![-1.1, -FREE], vec![FREE, 2.0])),
        state_softness,
        output_softness,
        ..NmpcProblem::new(Dims::new(1, 1), 3, Weights::uniform(vec![1.0], vec![1.0]))
    };
    let model = Box::new(Rk4::new(LAG, 1.0, 2));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let reference = Reference::new(vec![0.0], 1).unwrap();
    let run = ClosedLoop::new(&mut nmpc, Dopri5::new(LAG, 1e-12), reference, &[x]).unwrap();
    let mut run = run.with_initial_input(&[u]).unwrap();
    run.run().unwrap();
    run.violations().copied().collect()
}

/// At rest on its bound, but for the last digit.
#[test]
fn a_bound_is_not_broken_by_rounding() {
    for (x, is_broken) in [(1.2_f64.next_up(), false), (1.2 + 1e-13, true)] {
        let broken = broken_from(x, 1.2, [Softness::Hard, Softness::Hard]);
        assert_eq!(broken.iter().any(|of| of.of == Bounded::State(0)), is_broken, "{broken:?}");
    }
}

/// An output that jumps with the input is over its bound at the beginning of the step and less so
/// afterwards: that is a step's end as any other.
#[test]
fn the_beginning_of_a_step_counts_as_between_steps() {
    let broken = broken_by_the_lag(Softness::Hard, Softness::Hard);
    let output = broken.iter().find(|of| of.of == Bounded::Output(1)).unwrap();
    assert!((output.amount - 0.5).abs() < 1e-12 && output.time_s.abs() < 1e-15, "{output:?}");
    assert!((output.at_steps - 0.5).abs() < 1e-12, "{output:?}");
    assert!((output.size - 2.5).abs() < 1e-12, "{output:?}");
}

/// The size of what is negative is its absolute value.
#[test]
fn a_size_has_no_sign() {
    let broken = broken_by_the_lag(Softness::Hard, Softness::Hard);
    let output = broken.iter().find(|of| of.of == Bounded::Output(0)).unwrap();
    // The first sample after the beginning, which is given.
    let x = 1.0 + 0.5 * (-1.0_f64 / 90.0).exp();
    assert!((output.size - x).abs() < 1e-9, "{output:?}");
    assert!((output.amount - (x - 1.1)).abs() < 1e-9, "{output:?}");
    let end = 1.0 + 0.5 * (-0.1_f64).exp();
    assert!((output.at_steps - (end - 1.1)).abs() < 1e-9, "{output:?}");
    assert_eq!((output.side, output.bound.to_bits()), (Side::Low, (-1.1_f64).to_bits()));
}

/// A quantity that stays far below its lower bound is small beside it.
#[test]
fn a_share_is_of_the_larger_of_size_and_bound() {
    let broken = broken_by_the_lag(Softness::Hard, Softness::Hard);
    let largest = broken.iter().find(|of| of.of == Bounded::Output(1)).unwrap();
    assert!((largest.share() - 0.5 / 2.5).abs() < 1e-12, "{largest:?}");
    let mut small = *largest;
    (small.bound, small.size, small.amount) = (-4.0, 1.0, 3.0);
    assert!((small.share() - 0.75).abs() < 1e-15, "{small:?}");
}

/// States and outputs have their own softness.
#[test]
fn softness_belongs_to_the_quantity() {
    for (states, outputs) in [(true, false), (false, true)] {
        let softness = |hard| if hard { Softness::Hard } else { Softness::Exact };
        let broken = broken_by_the_lag(softness(states), softness(outputs));
        let hard: Vec<_> = broken.iter().map(|of| (of.of, of.hard)).collect();
        let expected = [
            (Bounded::State(0), states),
            (Bounded::Output(0), outputs),
            (Bounded::Output(1), outputs),
        ];
        assert_eq!(hard, expected);
    }
}

/// From a step on, its mark included, the upper bound is another one, and the lower one stays.
#[test]
fn a_bound_is_the_one_of_its_step() {
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![0.0], vec![0.1]),
        state_bounds: Bounds::new(vec![-3.0], vec![2.0]),
        state_softness: Softness::Exact,
        ..NmpcProblem::new(Dims::new(1, 1), 3, Weights::uniform(vec![1.0], vec![1.0]))
    };
    let dims = Dims::new(1, 1);
    let first = BoundSchedule::row(&problem, dims);
    let mut later = first.clone();
    // The lower bounds of x and u come first.
    later[2] = 1.0;
    let rows = Timetable::new(first.len(), [(0, first), (1, later)]).unwrap();
    let schedule = BoundSchedule::new(rows, &problem, dims).unwrap();
    let model = Box::new(Rk4::new(LAG, 1.0, 2));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let reference = Reference::new(vec![0.0; 2], 1).unwrap();
    let run = ClosedLoop::new(&mut nmpc, Dopri5::new(LAG, 1e-12), reference, &[1.5]).unwrap();
    let mut run = run.with_bounds(schedule);
    run.control().unwrap().unwrap().advance().unwrap();
    assert_eq!(run.violations().count(), 0);
    run.control().unwrap().unwrap().advance().unwrap();
    let broken: Vec<_> = run.violations().collect();
    assert_eq!(broken.len(), 1, "{broken:?}");
    assert_eq!((broken[0].of, broken[0].side), (Bounded::State(0), Side::High));
    // 1.5 falls to 1.5 exp(-0.1) in the first step, with little input.
    let x = 1.5 * (-0.1_f64).exp();
    assert!((broken[0].bound - 1.0).abs() < 1e-12, "{broken:?}");
    assert!((broken[0].amount - (x - 1.0)).abs() < 1e-3, "{broken:?}");
    assert!((broken[0].at_steps - broken[0].amount).abs() < 1e-12, "{broken:?}");
    assert!((broken[0].time_s - 1.0).abs() < 1e-12, "{broken:?}");
}

/// Each input has its own bounds.
#[test]
fn an_input_beyond_its_bounds_is_the_one_that_is() {
    for (i, initial) in [[6.5, 3.0], [3.0, 6.5]].into_iter().enumerate() {
        let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
        let problem = NmpcProblem { delay: 1, ..four_tanks() };
        let most = problem.input_bounds.high[i];
        assert!(initial[1 - i] < problem.input_bounds.high[1 - i] && initial[i] > most);
        assert_eq!(model.dims().nu, 2);
        let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
        let reference = Reference::new(vec![12.0, 12.0], 2).unwrap();
        let plant = Dopri5::new(FourTanks::antonelo(), 1e-10);
        let run = ClosedLoop::new(&mut nmpc, plant, reference, &[12.0, 12.0, 2.0, 2.0]).unwrap();
        let mut run = run.with_initial_input(&initial).unwrap();
        run.run().unwrap();
        let inputs = run.violations().filter(|of| matches!(of.of, Bounded::Input(_)));
        let inputs: Vec<_> = inputs.collect();
        assert_eq!(inputs.len(), 1, "{inputs:?}");
        assert_eq!((inputs[0].of, inputs[0].side), (Bounded::Input(i), Side::High));
        let numbers = [inputs[0].amount, inputs[0].at_steps, inputs[0].size];
        for (found, expected) in numbers.into_iter().zip([6.5 - most, 6.5 - most, 6.5]) {
            assert!((found - expected).abs() < 1e-12, "{inputs:?}");
        }
    }
}
