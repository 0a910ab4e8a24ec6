//! Costs that leave their Hessian to the optimization.

use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, QpMethod, QuadBlock, SqpConfig, SqpStatus, StageCost,
    StagePoint, Weights,
};
use pinc_ode::{Dims, Linearization, Model, Stages};

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
