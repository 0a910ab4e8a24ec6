//! Costs that leave their Hessian to the optimization.

use pinc_ad::Scalar;
use pinc_mpc::{
    Bounds, IntegratedCost, MpcError, Nmpc, NmpcProblem, QpMethod, QuadBlock, SqpConfig, SqpStatus,
    StageCost, StagePoint, Tracked, Weights,
};
use pinc_ode::{Dims, Linearization, Model, Plant, Rk4, Stages, Variable};

const METHODS: [QpMethod; 3] = [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Auto];

/// x\[k+1\] = x + u
#[derive(Debug)]
struct Sum;

impl Model for Sum {
    fn dims(&self) -> Dims {
        Dims::new(1, 1)
    }

    fn sample_time_s(&self) -> f64 {
        0.5
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        next[0] = x[0] + u[0];
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        for (k, (x, u)) in at.x.iter().zip(at.u).enumerate() {
            (out.next[k], out.a[k], out.b[k]) = (x + u, 1.0, 1.0);
        }
    }
}

/// Two wells, at -1 and 1, with a hill between them, on ground that rises to the right:
/// (x^2 - 1)^2 + slope x + u^2 / 2.
#[derive(Debug)]
struct Wells {
    slope: f64,
}

impl StageCost for Wells {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        let (x, u) = (at.x[0], at.u[0]);
        out.value = (x * x - 1.0).powi(2) + self.slope * x + 0.5 * u * u;
        (out.by_x[0], out.by_u[0]) = (4.0 * x * (x * x - 1.0) + self.slope, u);
    }

    fn leaves_out_hessian(&self) -> bool {
        true
    }
}

/// A cost that has derivatives and no value.
#[derive(Debug)]
struct Valueless(f64);

impl StageCost for Valueless {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        out.value = self.0;
        (out.by_x[0], out.by_u[0]) = (at.x[0], at.u[0]);
        (out.q[0], out.r[0]) = (1.0, 1.0);
    }
}

#[test]
fn a_cost_without_a_value_is_no_success() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let weights = Weights::uniform(Vec::<f64>::new(), vec![0.0]);
        let problem =
            NmpcProblem { tracked: Vec::new(), ..NmpcProblem::new(Dims::new(1, 1), 3, weights) };
        let builder = Nmpc::builder(problem).model(Box::new(Sum));
        let mut nmpc = builder.stage_cost(Box::new(Valueless(value))).build().unwrap();
        assert_eq!(nmpc.step(&[1.0], &[]).unwrap().status, SqpStatus::NumericalTrouble, "{value}");
    }
}

fn wells(horizon: usize, qp: QpMethod) -> Nmpc {
    sloping_wells(horizon, 0.0, SqpConfig { qp, ..SqpConfig::default() }).unwrap()
}

fn sloping_wells(horizon: usize, slope: f64, config: SqpConfig) -> Result<Nmpc, MpcError> {
    let weights = Weights::uniform(Vec::<f64>::new(), vec![0.0]);
    let problem = NmpcProblem {
        tracked: Vec::new(),
        input_bounds: Bounds::new(vec![-2.0], vec![2.0]),
        ..NmpcProblem::new(Dims::new(1, 1), horizon, weights)
    };
    let builder = Nmpc::builder(problem).model(Box::new(Sum)).config(config);
    builder.stage_cost(Box::new(Wells { slope })).build()
}

/// The plan meets its conditions, lies in the well that is nearer, and takes few iterations, as
/// Newton's method does.
#[test]
fn the_nearer_well_is_found_from_either_side() {
    for qp in METHODS {
        for start in [0.05, -0.05, 0.6, -1.4] {
            let mut nmpc = wells(6, qp);
            let step = nmpc.step(&[start], &[]).unwrap();
            let (status, iterations) = (step.status, step.sqp_iterations);
            assert_eq!((status, step.curvature_dropped), (SqpStatus::Converged, false), "{start}");
            assert!(iterations <= 12, "{qp} {start}: {iterations}");
            let last = nmpc.plan().states()[5];
            assert!((last - start.signum()).abs() < 1e-3, "{qp} {start}: {last}");
        }
    }
}

/// On top of the hill no direction is better by the first derivatives. The plan leaves it; where
/// there is no time for that, the report says that it is not known to be a minimum.
#[test]
fn the_top_of_a_hill_is_left_or_named() {
    let mut nmpc = wells(6, QpMethod::Auto);
    let step = nmpc.step(&[0.0], &[]).unwrap();
    assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false));
    let cost = step.cost;
    assert!((nmpc.plan().states()[5].abs() - 1.0).abs() < 0.1);

    let calls = std::cell::Cell::new(0);
    for most in 0.. {
        calls.set(0);
        nmpc.reset();
        let step = nmpc.step_within(&[0.0], &[], &mut || {
            calls.set(calls.get() + 1);
            calls.get() > most
        });
        let step = step.unwrap();
        if step.status == SqpStatus::Converged {
            assert!(step.curvature_dropped && step.cost > cost + 1.0, "{}", step.cost);
            break;
        }
    }
}

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

fn integrated(count: usize) -> Nmpc {
    let (long, short) = (count / 2, count - count / 2);
    let weights = Weights::uniform(vec![0.3], vec![0.1]);
    let problem = NmpcProblem {
        tracked: vec![Tracked::Input(0)],
        input_bounds: Bounds::new(vec![-1.0], vec![1.5]),
        ..NmpcProblem::new(Dims::new(1, 1), count, weights)
    };
    let model = |length| -> Box<dyn Model> { Box::new(Rk4::new(plant(), length, 3)) };
    let cost = |length| -> Box<dyn Model> { Box::new(Rk4::new(Costed::new(), length, 3)) };
    Nmpc::builder(problem)
        .stages(model(0.2), short)
        .stages(model(0.4), long)
        .stage_cost(Box::new(IntegratedCost::new(vec![(cost(0.2), short), (cost(0.4), long)])))
        .build()
        .unwrap()
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
    let mut nmpc = integrated(8);
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

#[test]
fn a_real_time_iteration_is_refused() {
    let weights = Weights::uniform(vec![0.0], vec![0.0]);
    let builder = Nmpc::builder(NmpcProblem::new(Dims::new(1, 1), 3, weights)).model(Box::new(Sum));
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    let built = builder.config(config).stage_cost(Box::new(Wells { slope: 0.0 })).build();
    assert_eq!(built.unwrap_err(), MpcError::CurvedInRealTime);
}

/// [`Wells`] in another unit of money.
#[derive(Debug)]
struct Priced(f64);

impl StageCost for Priced {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        Wells { slope: 0.0 }.quadratize(at, out);
        out.value *= self.0;
        out.by_x[0] *= self.0;
        out.by_u[0] *= self.0;
    }

    fn leaves_out_hessian(&self) -> bool {
        true
    }
}

/// The tolerance means the same in any unit of the cost.
#[test]
fn the_unit_of_the_cost_does_not_matter() {
    let plan = |price: f64| {
        let weights = Weights::uniform(Vec::<f64>::new(), vec![0.0]);
        let problem = NmpcProblem {
            tracked: Vec::new(),
            input_bounds: Bounds::new(vec![-2.0], vec![2.0]),
            ..NmpcProblem::new(Dims::new(1, 1), 6, weights)
        };
        let builder = Nmpc::builder(problem).model(Box::new(Sum));
        let mut nmpc = builder.stage_cost(Box::new(Priced(price))).build().unwrap();
        let step = nmpc.step(&[0.3], &[]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{price}");
        nmpc.plan().inputs().to_vec()
    };
    let expected = plan(1.0);
    for price in [1e-9, 1e9] {
        for (found, expected) in plan(price).iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-7, "{price}: {found} {expected}");
        }
    }
}

/// From the top of the hill a first plan leads to the well on its side.
#[test]
fn a_first_plan_chooses_the_well() {
    for side in [-1.0, 1.0] {
        let mut nmpc = wells(6, QpMethod::Auto);
        nmpc.set_first_plan(&[0.1 * side; 6]).unwrap();
        let step = nmpc.step(&[0.0], &[]).unwrap();
        assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false));
        let last = nmpc.plan().states()[5];
        assert!((last - side).abs() < 1e-3, "{side}: {last}");
    }
    assert!(wells(6, QpMethod::Auto).set_first_plan(&[0.1; 5]).is_err());
}

/// The nearer well is the one that is less deep. Several starts find the deeper one in the first step,
/// which later steps stay in, if there is time; without time the plan is the one of a single start.
#[test]
fn several_starts_find_the_deeper_well() {
    let build =
        |starts| sloping_wells(6, 0.3, SqpConfig { starts, ..SqpConfig::default() }).unwrap();
    let mut one = build(1);
    let step = one.step(&[0.6], &[]).unwrap();
    assert_eq!((step.status, step.start), (SqpStatus::Converged, None));
    let (near, programs) = (step.cost, step.sqp_iterations);
    assert!(one.plan().states()[5] > 0.9);

    let mut several = build(8);
    let step = several.step(&[0.6], &[]).unwrap();
    assert_eq!((step.status, step.curvature_dropped), (SqpStatus::Converged, false));
    let (start, cost) = (step.start.unwrap(), step.cost);
    assert!((1..8).contains(&start) && cost < near - 0.1, "{start}: {cost} {near}");
    assert!(step.sqp_iterations > 2 * programs, "{programs}");
    assert!(several.plan().states()[5] < -0.9);
    // A plan given on that side leads there too.
    let plan = several.plan().clone();
    one.reset();
    one.set_first_plan(&[-0.3; 6]).unwrap();
    let given = one.step(&[0.6], &[]).unwrap();
    assert!((given.cost - cost).abs() < 1e-9 * cost.abs(), "{} {cost}", given.cost);
    // The next step has a plan to start from.
    let next = several.step(&[plan.states()[0]], &[]).unwrap();
    assert_eq!((next.status, next.start), (SqpStatus::Converged, None));
    assert!(several.plan().states()[5] < -0.9);

    // There is time for the first start only.
    let mut hurried = build(8);
    let calls = std::cell::Cell::new(0);
    let mut count = || {
        calls.set(calls.get() + 1);
        false
    };
    build(1).step_within(&[0.6], &[], &mut count).unwrap();
    let all = calls.replace(0);
    let step = hurried.step_within(&[0.6], &[], &mut || {
        calls.set(calls.get() + 1);
        calls.get() > all
    });
    let step = step.unwrap();
    assert_eq!((step.status, step.start), (SqpStatus::Converged, Some(0)));
    assert_eq!((step.cost.to_bits(), step.sqp_iterations), (near.to_bits(), programs));

    let real_time = SqpConfig { starts: 2, real_time: true, ..SqpConfig::default() };
    assert!(real_time.validate().unwrap_err().to_string().contains("starts"));
    assert!(SqpConfig { starts: 0, ..SqpConfig::default() }.validate().is_err());
}
