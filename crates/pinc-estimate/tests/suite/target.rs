//! Steady-state targets against the steady states of the Van der Pol oscillator, x = (a, 0), u = a.

use pinc_ad::Scalar;
use pinc_estimate::{Augmentation, Compensated, Disturbance, Measured, SteadyTarget};
use pinc_mpc::{Bounds, NmpcProblem, SqpStatus, Tracked, Weights};
use pinc_ode::{Model, Plant, Rk4, Variable};
use pinc_plants::VanDerPol;

/// The target of a problem for the oscillator that tracks the first state, the input and `more`, with
/// an input of 1 at most.
fn target(more: &[Tracked]) -> SteadyTarget {
    target_of(VanDerPol::default(), [&[Tracked::State(0), Tracked::Input(0)][..], more].concat())
}

/// The target of a problem that tracks these with an input of 1 at most, which is disturbed.
fn target_of(plant: impl Plant, tracked: Vec<Tracked>) -> SteadyTarget {
    let load = Augmentation {
        disturbance: Disturbance::Input,
        ..Augmentation::measured(Measured::states([0]))
    };
    let model = Compensated::new(Box::new(Rk4::new(plant, 0.5, 4)), load).unwrap();
    let weights = Weights::uniform(vec![10.0; tracked.len()], vec![1.0]);
    let problem = NmpcProblem {
        tracked,
        input_bounds: Bounds::new(vec![-1.0], vec![1.0]),
        parameters: vec![0.0],
        ..model.problem(5, weights)
    };
    let start = vec![0.0; model.dims().nx];
    SteadyTarget::new(&problem, Box::new(model), &start, &[0.0]).unwrap()
}

/// The row that takes the place of `row` with an input disturbance d.
#[track_caller]
fn held(target: &mut SteadyTarget, d: f64, row: &[f64]) -> Vec<f64> {
    let mut reference = [row, row].concat();
    assert!(target.aim(&[d], &mut reference));
    assert_eq!(target.status(), Some(SqpStatus::Converged));
    let (first, second) = reference.split_at(row.len());
    assert_eq!(first, second);
    first.to_vec()
}

#[track_caller]
fn assert_near(found: &[f64], expected: &[f64]) {
    let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-5;
    assert!(found.iter().zip(expected).all(near), "{found:?} {expected:?}");
}

/// a = u + d, whatever the input's own reference.
#[test]
fn an_input_whose_reference_conflicts_gives_way() {
    let mut target = target(&[]);
    assert_near(&held(&mut target, 0.0, &[0.5, 0.0]), &[0.5, 0.5]);
    assert_near(&held(&mut target, 0.2, &[0.5, 0.0]), &[0.5, 0.3]);
    assert_near(&held(&mut target, -0.4, &[0.5, 3.0]), &[0.5, 0.9]);
    assert_eq!(target.last()[0], [0.5, 3.0]);
}

/// A search begins where the last one ended, and after a reset where the first one did.
#[test]
fn a_target_that_is_reset_begins_as_at_first() {
    let mut target = target(&[]);
    let first = held(&mut target, 0.1, &[0.4, 1.0]);
    held(&mut target, -0.4, &[0.9, 3.0]);
    target.reset();
    assert_eq!((target.status(), target.not_found()), (None, 0));
    assert_eq!(held(&mut target, 0.1, &[0.4, 1.0]), first);
}

/// x' = x^2 + u + d
#[derive(Clone, Debug)]
struct Rising;

impl Plant for Rising {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = x[0] * x[0] + u[0];
    }
}

/// With d = 2 and u of -1 at least there is no steady state: the row stays, and is counted.
#[test]
fn a_target_that_is_not_found_is_counted() {
    let mut target = target_of(Rising, vec![Tracked::State(0)]);
    assert_near(&held(&mut target, 0.0, &[-0.5]), &[-0.5]);
    assert_eq!(target.not_found(), 0);
    let mut reference = [-0.5, -0.5];
    assert!(!target.aim(&[2.0], &mut reference));
    assert_eq!((reference, target.not_found()), ([-0.5; 2], 1));
    assert_near(&held(&mut target, 0.0, &[-0.25]), &[-0.25]);
    assert_eq!(target.not_found(), 1);
}

#[test]
fn what_is_beyond_the_bounds_is_held_as_near_as_it_can_be() {
    let mut target = target(&[]);
    assert_near(&held(&mut target, -0.25, &[2.0, 0.0]), &[0.75, 1.0]);
    assert_near(&held(&mut target, 0.25, &[2.0, 0.0]), &[1.25, 1.0]);
}

/// The second state is 0 at rest: a reference of 0.6 is missed by all of it.
#[test]
fn more_quantities_than_inputs_are_held_by_their_weights() {
    let mut target = target(&[Tracked::State(1)]);
    assert_near(&held(&mut target, 0.1, &[0.5, 0.0, 0.6]), &[0.5, 0.4, 0.0]);
}

/// A lag with a gauge that reads twice the state and once the input: 3 (u + d) at rest.
#[derive(Clone, Debug)]
struct Gauge;

impl Plant for Gauge {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 1] = [Variable::new("x", "")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }
    fn outputs(&self) -> &[Variable] {
        static OUTPUTS: [Variable; 1] = [Variable::new("gauge", "")];
        &OUTPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = u[0] - x[0];
    }
    fn output<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[0] * 2.0 + u[0];
    }
}

/// A buffer of a size that depends on its unit, and a lag behind it: c = p / unit = u at rest.
#[derive(Clone, Debug)]
struct Buffered {
    unit: f64,
}

impl Plant for Buffered {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("p", ""), Variable::new("c", "")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        Gauge.inputs()
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = u[0] * self.unit - x[0];
        dx[1] = x[0] * (1.0 / self.unit) - x[1];
    }
}

/// A pressure in Pa beside a fraction, or the other way round.
#[test]
fn targets_do_not_depend_on_the_units_of_states() {
    for unit in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
        let mut target = target_of(Buffered { unit }, vec![Tracked::State(1)]);
        assert_near(&held(&mut target, 0.0, &[0.5]), &[0.5]);
        assert_near(&held(&mut target, -0.25, &[2.0]), &[0.75]);
    }
}

#[test]
fn an_output_is_held_whatever_the_reference_of_the_input() {
    let mut target = target_of(Gauge, vec![Tracked::Output(0), Tracked::Input(0)]);
    assert_near(&held(&mut target, 0.0, &[1.5, 0.0]), &[1.5, 0.5]);
    assert_near(&held(&mut target, 0.2, &[1.5, -1.0]), &[1.5, 0.3]);
}
