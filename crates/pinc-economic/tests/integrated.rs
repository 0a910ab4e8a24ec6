//! A cost that an integrator takes along as a state.

use pinc_ad::Scalar;
use pinc_economic::IntegratedCost;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpStatus, Tracked, Weights};
use pinc_ode::{Dims, Memory, Model, Plant, Rk4, Variable};

/// x' = u - x^3 / 3, t' = 1, J' = rate.
#[derive(Clone, Debug)]
struct Costed {
    states: Vec<Variable>,
    inputs: Vec<Variable>,
    outputs: Vec<Variable>,
}

impl Costed {
    fn new() -> Self {
        let named =
            |names: &[&'static str]| names.iter().map(|name| Variable::new(name, "")).collect();
        let outputs = named(&["x", "rate", "end"]);
        Self { states: named(&["x", "t", "J"]), inputs: named(&["u"]), outputs }
    }
}

impl Plant for Costed {
    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }

    fn outputs(&self) -> &[Variable] {
        &self.outputs
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let third = x[0].constant(1.0 / 3.0);
        dx[0] = u[0] - x[0] * x[0] * x[0] * third;
        dx[1] = x[0].constant(1.0);
        dx[2] = self.rate(x, u);
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], y: &mut [S]) {
        (y[0], y[1]) = (x[0], self.rate(x, u));
        y[2] = x[0].constant(0.0) - x[0] * u[0];
    }
}

impl Costed {
    /// Energy at a price that rises with time, less a product that saturates.
    fn rate<S: Scalar>(&self, x: &[S], u: &[S]) -> S {
        let price = x[1] * x[0].constant(0.5) + x[0].constant(1.0);
        price * u[0] * u[0] - x[0].tanh()
    }
}

/// x' = u - x^3 / 3
#[derive(Clone, Debug)]
struct Alone(Costed, Vec<Variable>);

impl Plant for Alone {
    fn states(&self) -> &[Variable] {
        &self.1
    }

    fn inputs(&self) -> &[Variable] {
        &self.0.inputs
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let third = x[0].constant(1.0 / 3.0);
        dx[0] = u[0] - x[0] * x[0] * x[0] * third;
    }
}

fn plant() -> Alone {
    Alone(Costed::new(), vec![Variable::new("x", "")])
}

/// A controller with stages of 0.2 s and then `long` ones of 0.4 s.
fn integrated(count: usize, long: usize) -> Nmpc {
    let short = count - long;
    let weights = Weights::uniform(vec![0.3], vec![0.1]);
    let problem = NmpcProblem {
        tracked: vec![Tracked::Input(0)],
        input_bounds: Bounds::new(vec![-1.0], vec![1.5]),
        ..NmpcProblem::new(Dims::new(1, 1), count, weights)
    };
    let (mut builder, mut costs) = (Nmpc::builder(problem), Vec::new());
    for (length, count) in [(0.2, short), (0.4, long)].into_iter().filter(|(_, count)| *count > 0) {
        builder = builder.stages(Box::new(Rk4::new(plant(), length, 3)), count);
        let cost: Box<dyn Model> = Box::new(Rk4::new(Costed::new(), length, 3));
        costs.push((cost, count));
    }
    builder.stage_cost(Box::new(IntegratedCost::new(costs))).build().unwrap()
}

/// The cost of inputs, by rolling out the model with the cost as a state from the time `now`.
fn rolled_out(inputs: &[f64], x0: f64, now: f64, reference: f64, previous: f64) -> f64 {
    let short = inputs.len() - inputs.len() / 2;
    let (mut x, mut next) = ([x0, now, 0.0], [0.0; 3]);
    let (mut sum, mut before) = (0.0, previous);
    for (j, &u) in inputs.iter().enumerate() {
        let length = if j < short { 0.2 } else { 0.4 };
        Rk4::new(Costed::new(), length, 3).step(&x, &[u], &[], &mut next);
        x = next;
        sum += 0.3 * (u - reference).powi(2) + 0.1 * (u - before).powi(2);
        before = u;
    }
    sum + x[2] - x[0] * before
}

/// The plan's cost is the rolled-out model's, and differences say that no input improves it; in the
/// next step the price has risen.
#[test]
fn an_integrated_cost_is_minimal_at_each_time() {
    let mut nmpc = integrated(8, 4);
    let (mut x, mut previous) = (0.3, 0.0);
    let mut first = Vec::new();
    for k in 0..3 {
        let step = nmpc.step(&[x], &[0.4; 8]).unwrap();
        let (cost, u) = (step.cost, step.u[0]);
        assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false), "{k}");
        assert!(step.sqp_iterations <= 8, "{k}: {}", step.sqp_iterations);
        let inputs = nmpc.plan().inputs().to_vec();
        let now = 0.2 * f64::from(k);
        let value = |inputs: &[f64]| rolled_out(inputs, x, now, 0.4, previous);
        assert!((value(&inputs) - cost).abs() < 1e-7, "{k}: {cost} {}", value(&inputs));
        for i in 0..8 {
            let slope = |by: f64| {
                let mut moved = inputs.clone();
                moved[i] += by;
                value(&moved)
            };
            let derivative = (slope(1e-5) - slope(-1e-5)) / 2e-5;
            let free = inputs[i] > -1.0 + 1e-6 && inputs[i] < 1.5 - 1e-6;
            assert!(!free || derivative.abs() < 1e-7, "{k} {i}: {derivative}");
            assert!(free || derivative * inputs[i].signum() < 0.0, "{k} {i}: {derivative}");
            assert!(slope(1e-2) + slope(-1e-2) > 2.0 * slope(0.0), "{k} {i}");
        }
        first.push(u);
        let mut next = [0.0];
        Rk4::new(plant(), 0.2, 3).step(&[x], &[u], &[], &mut next);
        (x, previous) = (next[0], u);
    }
    assert!(first[0] > first[2], "{first:?}");
}

/// The state after a step of the plant, which is disturbed by so much.
fn after(x: f64, u: f64, disturbance: f64) -> f64 {
    let mut next = [0.0];
    Rk4::new(plant(), 0.2, 3).step(&[x], &[u], &[], &mut next);
    next[0] + disturbance
}

/// In a loop that goes as planned most second derivatives are those of the step before.
#[test]
fn second_derivatives_near_a_known_place_are_not_computed_again() {
    let (count, reference) = (60, [0.4; 60]);
    // The stage itself and two points for each of x and u.
    let hessian = 5 * count;
    let mut nmpc = integrated(count, 0);
    let mut step = |x: f64| {
        let step = nmpc.step(&[x], &reference).unwrap();
        assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false));
        (step.u[0], step.work.linearized)
    };
    let (u, first) = step(0.3);
    assert!(first > 3 * hessian, "{first}");
    let mut x = after(0.3, u, 0.0);
    for k in 0..4 {
        let (u, work) = step(x);
        // Two programs and a judgement take three Hessians.
        assert!(work < 2 * hessian, "{k}: {work}");
        x = after(x, u, 0.0);
    }
    let (_, disturbed) = step(x + 0.3);
    assert!(disturbed > 2 * hessian, "{disturbed}");
}

/// A controller that was saved and restored goes on to the same bits.
#[test]
fn second_derivatives_are_saved_and_restored() {
    let (mut whole, mut x) = (integrated(20, 0), 0.3);
    for k in 0..4 {
        let mut numbers = Vec::new();
        whole.remember(&mut Memory::save(&mut numbers));
        let mut restored = integrated(20, 0);
        let mut memory = Memory::restore(&numbers);
        restored.remember(&mut memory);
        assert!(memory.is_complete(), "{k}");
        let [u, again] = [&mut whole, &mut restored].map(|nmpc| {
            let step = nmpc.step(&[x], &[0.4; 20]).unwrap();
            (step.u[0], step.sqp_iterations)
        });
        assert_eq!((u.0.to_bits(), u.1), (again.0.to_bits(), again.1), "{k}");
        x = after(x, u.0, 0.02);
    }
}
