//! Parameters of the model that change while a loop runs.

use crate::support::scalar_problem;
use pinc_ad::Scalar;
use pinc_loop::{ClosedLoop, Observer, PlantNow};
use pinc_mpc::{Nmpc, NmpcProblem, Reference, SqpConfig};
use pinc_ode::{Dopri5, Plant, Rk4, Variable};

/// x' = gain u + drift, whose steps of 1 s RK4 makes exactly.
#[derive(Clone, Debug)]
pub(crate) struct Gain;

impl Plant for Gain {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }

    fn parameters(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("gain", ""), Variable::new("drift", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        let [gain, drift] = match p {
            [gain, drift] => [*gain, *drift],
            _ => [1.0, 0.0].map(|value| x[0].constant(value)),
        };
        dx[0] = gain * u[0] + drift;
    }
}

/// A controller that looks one step ahead, with a gain of 1 and no drift at first.
fn controller() -> Nmpc {
    let problem = NmpcProblem { parameters: vec![1.0, 0.0], ..scalar_problem(1, 1) };
    Nmpc::new(problem, Box::new(Rk4::new(Gain, 1.0, 1)), SqpConfig::default()).unwrap()
}

/// The plant, which has the same gain and drift to its end.
fn plant() -> Dopri5 {
    let mut plant = Dopri5::new(Gain, 1e-12);
    plant.set_parameters(&[1.0, 0.0]);
    plant
}

fn reference(steps: usize) -> Reference {
    Reference::new(vec![0.0; steps], 1).unwrap()
}

/// The input that minimizes 2 (x + gain u + drift)^2 + 3 (u - before)^2.
fn best(x: f64, before: f64, [gain, drift]: [f64; 2]) -> f64 {
    (3.0 * before - 2.0 * gain * (x + drift)) / (2.0 * gain * gain + 3.0)
}

#[test]
fn a_loop_without_an_observer_is_told_all_parameters() {
    let mut nmpc = controller();
    let mut run = ClosedLoop::new(&mut nmpc, plant(), reference(3), &[1.0]).unwrap();
    let (mut x, mut before) = (1.0, 0.0);
    for p in [[1.0, 0.0], [2.0, 0.0], [0.5, -0.25]] {
        run.set_model_parameters(&p).unwrap();
        let control = run.control().unwrap().unwrap();
        assert_eq!(control.parameters(), p);
        let (u, expected) = (control.u()[0], best(x, before, p));
        assert!((u - expected).abs() < 1e-6, "{p:?}: {u} {expected}");
        control.advance().unwrap();
        (x, before) = (run.state()[0], u);
    }
    let error = run.set_model_parameters(&[1.0]).unwrap_err().to_string();
    assert_eq!(error, "parameters: 1 numbers, but 2 are expected");
}

/// Estimates the gain as 2, and remembers the parameters that it finds before.
#[derive(Debug, Default)]
struct Doubled(Vec<Vec<f64>>);

impl Observer for Doubled {
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], parameters: &mut [f64]) {
        self.0.push(parameters.to_vec());
        parameters[0] = 2.0;
        x.copy_from_slice(plant.x);
    }

    fn advance(&mut self, _u: &[f64]) {}
}

/// What is told are the last of the parameters: an observer estimates those before.
#[test]
fn a_loop_with_an_observer_is_told_the_parameters_that_are_not_estimated() {
    let mut nmpc = controller();
    let mut observer = Doubled::default();
    let run = ClosedLoop::new(&mut nmpc, plant(), reference(2), &[1.0]).unwrap();
    let mut run = run.with_observer(&mut observer);
    let error = run.set_model_parameters(&[1.0; 3]).unwrap_err().to_string();
    assert_eq!(error, "parameters: 3 numbers, but 2 are expected");
    let error = run.set_model_parameters(&[f64::NAN]).unwrap_err().to_string();
    assert_eq!(error, "parameters[0] is NaN, but must be finite");
    for drift in [0.5, -0.75] {
        run.set_model_parameters(&[drift]).unwrap();
        let control = run.control().unwrap().unwrap();
        assert_eq!(control.parameters(), [2.0, drift]);
        control.advance().unwrap();
    }
    assert_eq!(observer.0, [vec![1.0, 0.5], vec![2.0, -0.75]]);
}
