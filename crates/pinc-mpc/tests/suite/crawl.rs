//! Problems on which Gauss-Newton crawls: their multipliers times the curvature of model, outputs or
//! constraints are large.

use pinc_ad::Scalar;
use pinc_mpc::{
    Bounds, Constraints, Nmpc, NmpcProblem, Softness, SqpConfig, SqpHessian, SqpStatus,
    StageConstraints, Tracked, Weights,
};
use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Plant, Rk4, Stages, Variable};

fn adaptive() -> SqpConfig {
    SqpConfig { hessian: SqpHessian::Adaptive, ..SqpConfig::default() }
}

/// Variables without names.
static NONE: [Variable; 4] = [const { Variable::new("", "") }; 4];

/// Two tanks with A -> B -> C and 2 A -> D in a row, of which the second has a feed of its own.
#[derive(Clone, Debug)]
struct Reactors;

impl Plant for Reactors {
    fn states(&self) -> &[Variable] {
        &NONE
    }

    fn inputs(&self) -> &[Variable] {
        &NONE[..2]
    }

    fn outputs(&self) -> &[Variable] {
        &NONE[..1]
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let (a, c) = (x[0], x[2]);
        let both = u[0] + u[1];
        dx[0] = u[0] * (1.0 / 1.2) * (-a + 5.1) - a * 0.014 - a * a * 0.0021;
        dx[1] = a * 0.014 - u[0] * (1.0 / 1.2) * x[1] - x[1] * 0.009;
        dx[2] = (u[0] * a + u[1] * 5.1 - both * c) * (1.0 / 0.8) - c * 0.014 - c * c * 0.0021;
        dx[3] = (u[0] * x[1] - both * x[3]) * (1.0 / 0.8) + c * 0.014 - x[3] * 0.009;
    }

    /// The share of B in what leaves.
    fn output<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[3] / (x[2] + x[3] + 0.1);
    }
}

/// The first inputs that IPOPT (CasADi, RK4 with two substeps, multiple shooting, slacks of the soft
/// bounds, tolerance 1e-11) finds in the first steps of the loop below.
const IPOPT: [[f64; 2]; 3] = [
    [0.01619378481881195, 0.00956400160981],
    [0.008851969867750786, 0.012024836231625771],
    [0.0020000000000307944, 0.013942833510558384],
];

/// With Gauss-Newton alone most of these steps take more than 50 QPs. By default the exact Hessian comes
/// late.
#[test]
fn soft_bounds_of_a_curved_model_take_few_programs() {
    follow_the_reactors(adaptive(), 16);
    follow_the_reactors(SqpConfig::default(), 40);
}

/// Without the exact Hessian, which generated C has not, the default is Gauss-Newton.
#[test]
fn the_exact_hessian_can_be_left_out() {
    let only = SqpConfig { hessian: SqpHessian::GaussNewton, ..SqpConfig::default() };
    let (mut default, mut only) = (reactors(SqpConfig::default()), reactors(only));
    default.leave_out_exact_hessian();
    let reference = [0.7599491152946728, 0.41021233972075666].repeat(9);
    let (mut found, mut slow) = (Vec::new(), 0);
    for nmpc in [&mut default, &mut only] {
        let mut x = REACTORS.to_vec();
        for _ in 0..4 {
            let step = nmpc.step(&x, &reference).unwrap();
            slow += usize::from(step.status == SqpStatus::IterationLimit);
            found.push((step.status, step.sqp_iterations, step.u.to_vec()));
            x = nmpc.plan().states()[..4].to_vec();
        }
    }
    assert!(slow > 0);
    assert_eq!(found[..4], found[4..]);
}

/// Where the reactors begin.
const REACTORS: [f64; 4] =
    [1.4745443038321122, 0.8280424584647441, 0.8807752117187858, 1.207398173591761];

/// The controller of the reactors.
fn reactors(config: SqpConfig) -> Nmpc {
    let plant = Rk4::new(Reactors, 12.0, 2);
    let penalty = vec![15.39791914491194, 66.48495461426836, 76.20021677828072, 31.768582086702537];
    let q = vec![4.4621445807819535, 1.56465720387678];
    let r = vec![85.416_244_334_033, 3_534.698_612_089_666_6];
    let problem = NmpcProblem {
        tracked: vec![Tracked::State(3), Tracked::Output(0)],
        control_horizon: 5,
        state_bounds: Bounds::new(vec![0.5, 0.2, 0.5, 0.2], vec![2.4, 1.25, 2.4, 1.25]),
        state_softness: Softness::Penalty(penalty),
        input_bounds: Bounds::new(vec![0.002, 0.0], vec![0.06, 0.03]),
        increment_bounds: Bounds::new(
            vec![-0.007341814951096403; 2],
            vec![0.0074524267608868855; 2],
        ),
        ..NmpcProblem::new(plant.dims(), 9, Weights::uniform(q, r))
    };
    let mut nmpc = Nmpc::new(problem, Box::new(plant), config).unwrap();
    nmpc.reset_to(&REACTORS, &[0.023535599769885084, 0.006729475913295518]).unwrap();
    nmpc
}

/// Each of the first steps converges with `most` programs.
fn follow_the_reactors(config: SqpConfig, most: usize) {
    let (mut nmpc, mut plant) = (reactors(config), Rk4::new(Reactors, 12.0, 2));
    let mut x = REACTORS.to_vec();
    let reference = [0.7599491152946728, 0.41021233972075666].repeat(9);
    for k in 0..12 {
        let step = nmpc.step(&x, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "{k}");
        assert!(step.sqp_iterations <= most, "{k}: {}", step.sqp_iterations);
        for (found, expected) in step.u.iter().zip(IPOPT.get(k).into_iter().flatten()) {
            assert!((found - expected).abs() < 1e-8, "{k}: {found} {expected}");
        }
        let (u, mut next) = (step.u.to_vec(), vec![0.0; 4]);
        plant.step(&x, &u, &[], &mut next);
        x = next;
    }
}

/// Two tanks in a row, with an output of the states and one that depends on the input.
#[derive(Clone, Debug)]
struct Tanks;

impl Plant for Tanks {
    fn states(&self) -> &[Variable] {
        &NONE[..2]
    }

    fn inputs(&self) -> &[Variable] {
        &NONE[..1]
    }

    fn outputs(&self) -> &[Variable] {
        &NONE[..2]
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let flow = |level: S| level * 0.4 / (level * 0.3 + 1.0);
        dx[0] = u[0] - flow(x[0]);
        dx[1] = flow(x[0]) - flow(x[1]);
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[0] * x[0] + x[1];
        y[1] = x[0] * x[1] + u[0];
    }
}

/// How many of 30 steps of the tanks from `start` do not converge.
fn failures(
    (start, r): ([f64; 2], f64),
    config: SqpConfig,
    bound: impl Fn(&mut NmpcProblem),
) -> usize {
    let mut plant = Rk4::new(Tanks, 0.5, 10);
    let mut problem = NmpcProblem {
        tracked: vec![Tracked::State(1)],
        input_bounds: Bounds::new(vec![0.0], vec![3.0]),
        ..NmpcProblem::new(plant.dims(), 15, Weights::uniform(vec![1.0], vec![r]))
    };
    bound(&mut problem);
    let mut nmpc = Nmpc::new(problem, Box::new(plant.clone()), config).unwrap();
    let mut x = start.to_vec();
    let mut failures = 0;
    for k in 0..30 {
        let step = nmpc.step(&x, &[if k < 10 { 2.0 } else { 4.0 }; 15]).unwrap();
        failures += usize::from(step.status != SqpStatus::Converged);
        let (u, mut next) = (step.u.to_vec(), vec![0.0; 2]);
        plant.step(&x, &u, &[], &mut next);
        x = next;
    }
    failures
}

/// Multipliers are up to 8e5 where outputs are violated: what rounding leaves of a distance to a bound
/// would be above the tolerance. From two of the starts a step also needs the curvature of the outputs.
#[test]
fn violated_outputs_converge() {
    let plain = SqpConfig::default();
    for (start, high, r, config) in [
        ([11.61, 10.51], [21.16, 34.62], 0.01744, plain),
        ([10.41, 7.25], [57.44, 35.72], 0.003478, plain),
        ([3.06, 10.1], [41.69, 5.16], 0.001166, plain),
        ([11.27, 8.93], [27.31, 11.59], 0.001081, plain),
        ([3.06, 10.1], [41.69, 5.16], 0.001166, plain),
        ([11.27, 8.93], [27.31, 11.59], 0.001081, plain),
    ] {
        let bounds = Bounds::new(vec![f64::NEG_INFINITY, 1.0], high.to_vec());
        let failures = failures((start, r), config, |problem| {
            problem.output_bounds = Some(bounds.clone());
            problem.output_softness = Softness::Exact;
        });
        assert_eq!(failures, 0, "{start:?}");
    }
}

/// A state is outside its bound by 1e-13, which rounding leaves: times 1e5 it would be above the
/// tolerance for good.
#[test]
fn heavy_penalties_of_states_converge() {
    for (start, high, r) in [
        ([1.61, 10.17], [6.58, 3.02], 0.09588),
        ([0.31, 6.5], [7.63, 3.52], 0.007352),
        ([5.07, 0.35], [3.33, 3.75], 0.09622),
    ] {
        let failures = failures((start, r), SqpConfig::default(), |problem| {
            problem.state_bounds = Bounds::new(vec![0.0, 1.0], high.to_vec());
            problem.state_softness = Softness::Penalty(vec![1e5; 2]);
        });
        assert_eq!(failures, 0, "{start:?}");
    }
}

/// x\[k+1\] = u with the output x1^2 + x2^2.
#[derive(Clone, Debug)]
struct Placed;

impl Model for Placed {
    fn dims(&self) -> Dims {
        Dims::new(2, 2).with_outputs(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, _x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        next.copy_from_slice(u);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        out.next.copy_from_slice(at.u);
        out.a.fill(0.0);
        out.b.chunks_exact_mut(4).for_each(|b| b.copy_from_slice(&[1.0, 0.0, 0.0, 1.0]));
    }

    fn output(&mut self, x: &[f64], _u: &[f64], _p: &[f64], y: &mut [f64]) {
        y[0] = x[0] * x[0] + x[1] * x[1];
    }

    fn feedthrough(&self) -> Vec<bool> {
        vec![false]
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let points = at.x.chunks_exact(2).zip(out.y).zip(out.c.chunks_exact_mut(2));
        for ((x, y), c) in points {
            *y = x[0] * x[0] + x[1] * x[1];
            c.copy_from_slice(&[2.0 * x[0], 2.0 * x[1]]);
        }
        out.d.fill(0.0);
    }
}

/// x1^2 + x2^2 <= 1
#[derive(Debug)]
struct Disc;

impl StageConstraints for Disc {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = x[0] * x[0] + x[1] * x[1] - 1.0;
    }
}

/// Each state is the point of the disc that is nearest to its reference, whether the disc is a
/// constraint or the bound of an output.
#[test]
fn the_nearest_points_of_a_disc_are_found() {
    let reference = [9.0, 4.0, -3.0, 4.0, 1.0, -2.5, 6.0, -0.5];
    for by_output in [false, true] {
        let weights = Weights::uniform(vec![1.0; 2], vec![0.0; 2]);
        let mut problem = NmpcProblem::new(Placed.dims(), 4, weights);
        match by_output {
            true => {
                problem.output_bounds = Some(Bounds::new(vec![f64::NEG_INFINITY], vec![1.0]));
                problem.output_softness = Softness::Hard;
            }
            false => problem.constraints = Some(Constraints::new(Disc)),
        }
        let mut nmpc = Nmpc::new(problem, Box::new(Placed), adaptive()).unwrap();
        nmpc.reset_to(&[0.1, -0.7], &[0.1, -0.7]).unwrap();
        let step = nmpc.step(&[0.1, -0.7], &reference).unwrap();
        let iterations = step.sqp_iterations;
        assert_eq!(step.status, SqpStatus::Converged, "{by_output}: {:?}", step.kkt);
        assert!(iterations <= 30, "{by_output}: {iterations}");
        for (x, r) in nmpc.plan().states().chunks_exact(2).zip(reference.chunks_exact(2)) {
            let length = r[0].hypot(r[1]);
            let off = (x[0] - r[0] / length).hypot(x[1] - r[1] / length);
            assert!(off < 1e-7, "{by_output}: {x:?} {r:?}");
        }
    }
}

/// What two inputs waste, least at (0.3, -0.2).
#[derive(Clone, Debug)]
struct Waste;

impl Plant for Waste {
    fn states(&self) -> &[Variable] {
        &NONE[..1]
    }

    fn inputs(&self) -> &[Variable] {
        &NONE[..2]
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let (a, b) = (u[0] - 0.3, u[1] + 0.2);
        dx[0] = a * a + b * b * 0.3 + a * b * 0.4 - x[0];
    }
}

/// One state and two inputs whose changes cost nothing: many plans are as good to first order, and
/// Gauss-Newton jumps among them. The reference, 0.5 below 0, cannot be reached.
#[test]
fn inputs_that_the_cost_leaves_free_take_the_exact_hessian() {
    let plant = Rk4::new(Waste, 0.5, 2);
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0; 2], vec![1.0; 2]),
        ..NmpcProblem::new(plant.dims(), 4, Weights::uniform(vec![1.0], vec![0.0, 0.0]))
    };
    assert!(problem.leaves_inputs_free());
    let weighted = Weights::uniform(vec![1.0], vec![1e-3, 1e-3]);
    assert!(!NmpcProblem { weights: weighted, ..problem.clone() }.leaves_inputs_free());
    let first = |hessian: SqpHessian| {
        let config = SqpConfig { hessian, ..SqpConfig::default() };
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(plant.clone()), config).unwrap();
        let step = nmpc.step(&[0.4], &[-0.5; 4]).unwrap();
        (step.status, step.u.to_vec())
    };
    let (status, u) = first(SqpHessian::Auto);
    assert_eq!(status, SqpStatus::Converged);
    assert!((u[0] - 0.3).abs() < 1e-6 && (u[1] + 0.2).abs() < 1e-6, "{u:?}");
    assert_eq!(first(SqpHessian::GaussNewton).0, SqpStatus::IterationLimit);
}
