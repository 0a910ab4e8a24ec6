//! Derivatives of plans against central differences of the solver at random points.
//!
//! `PINC_RANDOM_POINTS=10000` in the environment of a test differentiates at so many points.

use crate::problems::{four_tanks, van_der_pol};
use crate::stream::Stream;
use pinc_ad::Scalar;
use pinc_mpc::{
    Bounds, Constraints, Nmpc, NmpcProblem, PerStage, QuadBlock, Softness, Solution, SqpConfig,
    SqpStatus, StageConstraints, StageCost, StagePoint, Tracked, Weight, Weights,
};
use pinc_ode::{Dims, Model, Plant, Rk4, Variable};
use pinc_plants::{FourTanks, TwoLinkArm, VanDerPol};
use pinc_sensitivity::{Given, ProblemDerivative, Regularity, Sensitivity};

/// Points per case, unless the environment says otherwise.
const POINTS: usize = 40;

/// The step of the central differences, as a part of the change that is drawn.
const STEP: f64 = 5e-5;

/// A problem with what is drawn for it.
struct Case {
    problem: NmpcProblem,
    model: fn() -> Box<dyn Model>,
    cost: Option<fn() -> Box<dyn StageCost>>,
    states: Vec<[f64; 2]>,
    references: Vec<[f64; 2]>,
}

/// What a plan is made for.
#[derive(Clone, Debug)]
struct Point {
    problem: NmpcProblem,
    x: Vec<f64>,
    reference: Vec<f64>,
    before: Vec<f64>,
}

impl Case {
    fn draw(&self, stream: &mut Stream) -> Point {
        let x = self.states.iter().map(|&range| stream.within(range)).collect();
        let target: Vec<f64> = self.references.iter().map(|&range| stream.within(range)).collect();
        let inputs = self.problem.input_bounds.low.iter().zip(&self.problem.input_bounds.high);
        let before = inputs.map(|(&low, &high)| stream.within([low, high])).collect();
        let problem = self.problem.clone();
        Point { reference: target.repeat(problem.horizon), problem, x, before }
    }

    fn solve(&self, point: &Point) -> (Nmpc, SqpStatus) {
        let config = SqpConfig { tolerance: 1e-10, max_iterations: 500, ..SqpConfig::default() };
        let mut builder = Nmpc::builder(point.problem.clone()).model((self.model)()).config(config);
        if let Some(cost) = self.cost {
            builder = builder.stage_cost(cost());
        }
        let mut nmpc = builder.build().unwrap();
        nmpc.reset_to(&point.x, &point.before).unwrap();
        let status = nmpc.step(&point.x, &point.reference).unwrap().status;
        (nmpc, status)
    }

    /// A change of one kind of number, or of all.
    fn direction(
        &self,
        point: &Point,
        mut change: ProblemDerivative,
        only: Option<Given>,
        stream: &mut Stream,
    ) -> ProblemDerivative {
        let mut numbers = change.clone();
        read(point, &mut numbers);
        for given in Given::ALL {
            if only.is_some_and(|only| only != given) {
                continue;
            }
            let to = change.get_mut(given);
            for (i, (to, value)) in to.iter_mut().zip(numbers.get(given)).enumerate() {
                let width = |ranges: &[[f64; 2]]| {
                    let [low, high] = ranges[i % ranges.len()];
                    0.2 * (high - low)
                };
                let size = match given {
                    Given::State => width(&self.states),
                    Given::Reference => width(&self.references),
                    _ if value.is_finite() => 0.3 * value.abs(),
                    _ => 0.0,
                };
                *to = size * stream.within([-1.0, 1.0]);
            }
        }
        let symmetric = |weight: &Weight, part: &mut [f64]| {
            let n = weight.size();
            if let Weight::Full(_) = weight {
                for (i, k) in (0..n).flat_map(|i| (0..i).map(move |k| (i, k))) {
                    part[k * n + i] = part[i * n + k];
                }
            }
        };
        let weights = &self.problem.weights;
        let stages = match &weights.q {
            PerStage::Same(q) => std::slice::from_ref(q),
            PerStage::Each { stages } => stages,
        };
        let parts = change.get_mut(Given::Q);
        let each = parts.len() / stages.len();
        stages.iter().zip(parts.chunks_mut(each)).for_each(|(q, part)| symmetric(q, part));
        if let Some(w) = &weights.input_sequence {
            symmetric(w, change.get_mut(Given::InputSequence));
        }
        change
    }
}

/// Every number of a point, by its kind.
fn numbers(point: &mut Point, given: Given) -> Vec<&mut f64> {
    let problem = &mut point.problem;
    fn of_weight(weight: &mut Weight) -> Vec<&mut f64> {
        match weight {
            Weight::Diagonal(diagonal) => diagonal.iter_mut().collect(),
            Weight::Full(rows) => rows.iter_mut().flatten().collect(),
        }
    }
    fn of_stages(weights: &mut PerStage<Weight>) -> Vec<&mut f64> {
        match weights {
            PerStage::Same(weight) => of_weight(weight),
            PerStage::Each { stages } => stages.iter_mut().flat_map(of_weight).collect(),
        }
    }
    fn of_softness(softness: &mut Softness) -> Vec<&mut f64> {
        match softness {
            Softness::Penalty(weights) => weights.iter_mut().collect(),
            Softness::Hard | Softness::Exact => Vec::new(),
        }
    }
    let outputs = problem.output_bounds.as_mut();
    match given {
        Given::State => point.x.iter_mut().collect(),
        Given::Reference => point.reference.iter_mut().collect(),
        Given::AppliedInput => point.before.iter_mut().collect(),
        Given::Parameters => problem.parameters.iter_mut().collect(),
        Given::Q => of_stages(&mut problem.weights.q),
        Given::R => of_stages(&mut problem.weights.r),
        Given::Terminal => problem.weights.terminal.as_mut().map_or(Vec::new(), of_weight),
        Given::InputSequence => {
            problem.weights.input_sequence.as_mut().map_or(Vec::new(), of_weight)
        }
        Given::StateLow => problem.state_bounds.low.iter_mut().collect(),
        Given::StateHigh => problem.state_bounds.high.iter_mut().collect(),
        Given::InputLow => problem.input_bounds.low.iter_mut().collect(),
        Given::InputHigh => problem.input_bounds.high.iter_mut().collect(),
        Given::IncrementLow => problem.increment_bounds.low.iter_mut().collect(),
        Given::IncrementHigh => problem.increment_bounds.high.iter_mut().collect(),
        Given::OutputLow => outputs.map_or(Vec::new(), |b| b.low.iter_mut().collect()),
        Given::OutputHigh => outputs.map_or(Vec::new(), |b| b.high.iter_mut().collect()),
        Given::StatePenalty => of_softness(&mut problem.state_softness),
        Given::ConstraintPenalty => of_softness(&mut problem.constraint_softness),
        Given::OutputPenalty => of_softness(&mut problem.output_softness),
        _ => unreachable!("a new kind of number: say where it is"),
    }
}

fn read(point: &Point, to: &mut ProblemDerivative) {
    let mut point = point.clone();
    for given in Given::ALL {
        let values = numbers(&mut point, given);
        assert_eq!(values.len(), to.get(given).len(), "{}", given.name());
        to.get_mut(given).iter_mut().zip(values).for_each(|(to, value)| *to = *value);
    }
}

fn moved(point: &Point, change: &ProblemDerivative, length: f64) -> Point {
    let mut point = point.clone();
    for given in Given::ALL {
        let values = numbers(&mut point, given);
        values.into_iter().zip(change.get(given)).for_each(|(v, change)| *v += length * change);
    }
    point
}

/// Which multipliers are not 0, and which are at their weight.
fn active(plan: &Solution) -> Vec<bool> {
    let parts = [
        plan.state_multipliers(),
        plan.input_multipliers(),
        plan.increment_multipliers(),
        plan.constraint_multipliers(),
    ];
    parts.into_iter().flatten().map(|mu| mu.abs() > 1e-9).collect()
}

fn unknowns(plan: &Solution) -> Vec<f64> {
    [plan.states(), plan.inputs()].concat()
}

/// The central difference of fourth order of `f`, unless it says that there is none.
fn difference(mut f: impl FnMut(f64) -> Option<Vec<f64>>) -> Option<Vec<f64>> {
    let mut sum: Vec<f64> = Vec::new();
    for (multiple, weight) in [(1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)] {
        let values = f(multiple * STEP)?;
        sum.resize(values.len(), 0.0);
        sum.iter_mut().zip(values).for_each(|(sum, v)| *sum += weight / (12.0 * STEP) * v);
    }
    Some(sum)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, v| most.max(v.abs()))
}

/// Compares all derivatives at random points with central differences of the solver, and products
/// forward with products adjoint: for each kind of number in turn, and for all together.
fn compare(name: &str, case: &Case, smoothing: Option<f64>) {
    let points = std::env::var("PINC_RANDOM_POINTS").map_or(POINTS, |n| n.parse().unwrap());
    let mut stream = Stream::new(5);
    let (mut compared, mut kinked, mut worst) = (0, 0, 0.0_f64);
    for k in 0..points {
        let point = case.draw(&mut stream);
        let (mut nmpc, status) = case.solve(&point);
        let pattern = active(nmpc.plan());
        let mut sensitivity =
            Sensitivity::new(&mut nmpc, &point.reference, &point.before, smoothing).unwrap();
        if status != SqpStatus::Converged {
            // A step without a solution is not differentiated.
            let regular = sensitivity.regularity() == Regularity::Regular;
            assert!(status != SqpStatus::InfeasibleQp || !regular, "{name} {k}");
            continue;
        }
        if sensitivity.regularity() != Regularity::Regular {
            kinked += 1;
            continue;
        }
        let kinds: Vec<Given> = Given::ALL
            .into_iter()
            .filter(|&given| !sensitivity.no_change().get(given).is_empty())
            .collect();
        let only = kinds.get(k % (kinds.len() + 1)).copied();
        let change = case.direction(&point, sensitivity.no_change(), only, &mut stream);
        let found = sensitivity.forward(&change).unwrap();
        let found = unknowns(&found);
        check_adjoint(&mut sensitivity, &change, &found, &mut stream);
        let at = unknowns(sensitivity.plan());
        let expected = difference(|length| {
            let moved = moved(&point, &change, length);
            let (mut nmpc, status) = case.solve(&moved);
            let same = smoothing.is_some() || active(nmpc.plan()) == pattern;
            if status != SqpStatus::Converged || !same {
                return None;
            }
            let plan = match smoothing {
                None => unknowns(nmpc.plan()),
                Some(_) => {
                    let there =
                        Sensitivity::new(&mut nmpc, &moved.reference, &moved.before, smoothing);
                    let there = there.unwrap();
                    if there.regularity() != Regularity::Regular {
                        return None;
                    }
                    unknowns(there.plan())
                }
            };
            // Another minimum is no neighbour.
            let far = plan.iter().zip(&at).any(|(a, b)| (a - b).abs() > 0.1 * (1.0 + b.abs()));
            (!far).then_some(plan)
        });
        let Some(expected) = expected else {
            kinked += 1;
            continue;
        };
        let size = largest(&expected).max(1e-3 * largest(&at));
        for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let error = (found - expected).abs() / size;
            worst = worst.max(error);
            assert!(
                error <= 1e-6,
                "{name}, point {k}, {}, unknown {i}: {found} is not {expected}",
                only.map_or("all", Given::name)
            );
        }
        compared += 1;
    }
    #[expect(clippy::print_stderr, reason = "the figures of a long run")]
    let report = || {
        eprintln!("{name}: {compared} of {points} compared, {kinked} at kinks, worst {worst:.1e}")
    };
    report();
    assert!(compared * 2 > points, "{name}: {compared} of {points}, {kinked} at kinks");
}

/// seed' (dz dchange) = (seed' dz)' dchange
fn check_adjoint(
    sensitivity: &mut Sensitivity<'_>,
    change: &ProblemDerivative,
    moved: &[f64],
    stream: &mut Stream,
) {
    let seed: Vec<f64> = moved.iter().map(|_| stream.within([-1.0, 1.0])).collect();
    let states = sensitivity.plan().states().len();
    let gradient = sensitivity.adjoint(&seed[..states], &seed[states..]).unwrap();
    let product = |a: &[f64], b: &[f64]| -> [f64; 2] {
        let products = a.iter().zip(b).map(|(a, b)| a * b);
        [products.clone().sum(), products.map(f64::abs).sum()]
    };
    let [forward, one] = product(&seed, moved);
    let [adjoint, other] = product(gradient.values(), change.values());
    let error = (forward - adjoint).abs();
    assert!(error <= 1e-9 * (one + other + 1e-3), "{forward} {adjoint}");
}

#[test]
fn of_the_oscillator_with_bounds_on_states() {
    let case = Case {
        problem: NmpcProblem {
            weights: Weights::uniform(vec![10.0, 1.0], vec![0.2]).with_terminal(vec![20.0, 1.0]),
            ..van_der_pol()
        },
        model: || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)),
        cost: None,
        states: vec![[-0.9, 0.9], [-0.5, 0.5]],
        references: vec![[-2.0, 2.0], [-0.3, 0.3]],
    };
    compare("oscillator", &case, None);
    compare("oscillator, smoothed", &case, Some(1e-3));
}

/// States from which the bounds cannot be met at first, and are violated as little as possible.
#[test]
fn of_the_oscillator_beyond_its_bounds() {
    let case = Case {
        problem: NmpcProblem {
            state_softness: Softness::Exact,
            weights: Weights::uniform(vec![10.0, 1.0], vec![0.2]),
            ..van_der_pol()
        },
        model: || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)),
        cost: None,
        states: vec![[-1.1, 1.1], [-0.4, 0.4]],
        references: vec![[-1.0, 1.0], [-0.3, 0.3]],
    };
    compare("violated", &case, None);
    compare("violated, smoothed", &case, Some(1e-3));
}

/// Inputs held from the third stage on, weights and bounds stage by stage, a softened level.
#[test]
fn of_the_tanks_with_increments_and_soft_levels() {
    let factors = [60.0, 50.0, 40.0, 30.0, 20.0, 10.0];
    let case = Case {
        problem: NmpcProblem {
            n1: 2,
            horizon: 6,
            control_horizon: 3,
            weights: Weights::scaled(
                vec![vec![3.0, 0.5], vec![0.5, 2.0]],
                vec![1.0, 0.2],
                &factors,
                &factors[..3],
            ),
            increment_bounds: Bounds::new(vec![-0.8, -1.2], vec![0.9, 0.7]),
            state_bounds: Bounds::new(vec![2.0, 2.0, 0.6, 0.6], vec![14.0, 14.0, 2.0, 2.0]),
            state_softness: Softness::Penalty(vec![90.0, 80.0, 300.0, 500.0]),
            input_bounds: Bounds::new(vec![0.0; 2], vec![5.0, 4.0]),
            ..four_tanks()
        },
        model: || Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4)),
        cost: None,
        states: vec![[6.0, 15.0], [6.0, 15.0], [1.0, 2.4], [1.0, 2.4]],
        references: vec![[8.0, 15.0]; 2],
    };
    compare("tanks", &case, None);
    compare("tanks, smoothed", &case, Some(1e-2));
}

#[test]
fn of_an_arm_with_a_weight_of_all_inputs() {
    let weight: Vec<Vec<f64>> = (0..10)
        .map(|i| {
            (0..10)
                .map(|k: usize| {
                    if i == k {
                        0.02
                    } else if i + 2 == k || k + 2 == i {
                        -0.005
                    } else {
                        0.0
                    }
                })
                .collect()
        })
        .collect();
    let weights = Weights::uniform(vec![30.0, 30.0, 1.0, 1.0], vec![0.05, 0.1]);
    let dims = Dims::new(4, 2);
    let case = Case {
        problem: NmpcProblem {
            control_horizon: 4,
            input_bounds: Bounds::new(vec![-8.0; 2], vec![8.0; 2]),
            weights: weights.with_input_sequence(weight),
            ..NmpcProblem::new(dims, 5, Weights::uniform(vec![1.0; 4], vec![1.0; 2]))
        },
        model: || Box::new(Rk4::new(TwoLinkArm::default(), 0.05, 4)),
        cost: None,
        states: vec![[-1.0, 1.0]; 4],
        references: vec![[-1.0, 1.0]; 4],
    };
    compare("arm", &case, None);
}

/// x1' = x2, x2' = p1 (1 - x1^2) x2 - x1 + u, with an output of state and p and one with
/// feedthrough.
#[derive(Clone, Debug)]
struct Driven;

impl Plant for Driven {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }

    fn outputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("y1", ""), Variable::new("y2", "")];
        &VARIABLES
    }

    fn parameters(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("p1", ""), Variable::new("p2", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = x[1];
        dx[1] = p[0] * (-(x[0] * x[0]) + 1.0) * x[1] - x[0] + u[0];
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], y: &mut [S]) {
        y[0] = x[0] + p[1] * x[1] * x[0];
        y[1] = x[1] + p[1] * u[0] * (x[0] + 2.0);
    }
}

fn driven() -> Box<dyn Model> {
    Box::new(Rk4::new(Driven, 0.3, 4))
}

fn driven_problem() -> NmpcProblem {
    let weights = Weights::uniform(vec![vec![6.0, 1.0], vec![1.0, 3.0]], vec![0.5]);
    NmpcProblem {
        control_horizon: 4,
        tracked: Tracked::outputs([0, 1]),
        input_bounds: Bounds::new(vec![-1.5], vec![1.5]),
        parameters: vec![0.8, 0.3],
        ..NmpcProblem::new(Dims::new(2, 1).with_parameters(2), 6, weights)
    }
}

#[test]
fn of_outputs_that_are_tracked_and_bounded() {
    let case = Case {
        problem: NmpcProblem {
            output_bounds: Some(Bounds::new(vec![-0.4, -0.5], vec![0.4, 0.6])),
            output_softness: Softness::Penalty(vec![4.0, 6.0]),
            ..driven_problem()
        },
        model: driven,
        cost: None,
        states: vec![[-0.6, 0.6], [-0.5, 0.5]],
        references: vec![[-2.0, 2.0], [-1.5, 1.5]],
    };
    compare("outputs", &case, None);
    compare("outputs, smoothed", &case, Some(1e-3));
    // Where the input is held, the second output is the same before and after a control step.
    let mut held = case;
    held.problem.control_horizon = 2;
    held.problem.output_bounds = Some(Bounds::new(vec![-9.0, -0.5], vec![9.0, 0.3]));
    held.references = vec![[-1.0, 1.0], [0.5, 1.5]];
    for softness in [Softness::Hard, Softness::Penalty(vec![4.0, 6.0])] {
        held.problem.output_softness = softness;
        compare("held outputs", &held, None);
    }
}

/// x1^2 + x2^2 + u^2 <= 1 and a cost of its own, whose Hessian is not the exact one.
#[derive(Debug)]
struct Ball;

impl StageConstraints for Ball {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = x[0] * x[0] + x[1] * x[1] + u[0] * u[0] * 0.5 - 0.3;
    }
}

/// l = p1 u^4 / 4 + (x1 u)^2 / 2
#[derive(Debug)]
struct Effort;

impl StageCost for Effort {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        let (x, u, p) = (at.x[0], at.u[0], at.p[0]);
        out.value = p * u.powi(4) / 4.0 + (x * u).powi(2) / 2.0;
        out.by_u[0] = p * u.powi(3) + x * x * u;
        out.by_x[0] = x * u * u;
        out.r[0] = 3.0 * p * u * u + x * x;
    }
}

#[test]
fn of_constraints_and_a_stage_cost() {
    let case = Case {
        problem: NmpcProblem {
            tracked: vec![Tracked::State(0), Tracked::Output(1)],
            constraints: Some(Constraints::new(Ball)),
            constraint_softness: Softness::Penalty(vec![3.0]),
            ..driven_problem()
        },
        model: driven,
        cost: Some(|| Box::new(Effort)),
        states: vec![[-0.7, 0.7], [-0.5, 0.5]],
        references: vec![[-2.0, 2.0], [-1.5, 1.5]],
    };
    compare("constraints", &case, None);
    compare("constraints, smoothed", &case, Some(1e-3));
}

/// A reactor, cooled: concentration and temperature, scaled, with an exponential rate.
#[derive(Clone, Debug)]
struct Reactor;

impl Plant for Reactor {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("c", ""), Variable::new("T", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("cooling", "")];
        &VARIABLES
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let rate = x[0] * (x[1] * 25.0 / (x[1] + 1.0)).exp() * 0.002;
        dx[0] = (-x[0] + 1.0) * 0.05 - rate;
        dx[1] = -x[1] * 0.05 + rate * 0.4 - u[0] * 0.03;
    }
}

#[test]
fn of_a_reactor_with_long_horizon() {
    let weights = Weights::uniform(vec![50.0, 20.0], vec![2.0]);
    let case = Case {
        problem: NmpcProblem {
            control_horizon: 15,
            input_bounds: Bounds::new(vec![0.0], vec![1.0]),
            increment_bounds: Bounds::new(vec![-0.2], vec![0.2]),
            state_sizes: Some(vec![1.0, 0.3]),
            ..NmpcProblem::new(Dims::new(2, 1), 20, weights)
        },
        model: || Box::new(Rk4::new(Reactor, 1.0, 4)),
        cost: None,
        states: vec![[0.3, 0.9], [0.02, 0.25]],
        references: vec![[0.3, 0.9], [0.05, 0.2]],
    };
    compare("reactor", &case, None);
}
