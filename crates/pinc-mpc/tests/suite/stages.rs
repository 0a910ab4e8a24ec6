//! Data that differ from stage to stage: bounds, parameters, models.

use crate::optimality::{StepInput, residuals, scale};
use crate::problems::{four_tanks, four_tanks_loop};
use crate::support::{Linear, scalar_problem};
use crate::together::Together;
use pinc_loop::ClosedLoop;
use pinc_mpc::{
    Bounds, Constraints, MpcError, Nmpc, NmpcProblem, QpMethod, Reference, SqpConfig, SqpStatus,
    Weight, Weights,
};
use pinc_ode::{Dims, Dopri5, Linearization, Model, Rk4, Stages};
use pinc_plants::FourTanks;

/// x\[k+1\] = p1 x\[k\] + p2 u\[k\]
#[derive(Clone, Debug)]
struct Parametric;

impl Model for Parametric {
    fn dims(&self) -> Dims {
        Dims::new(1, 1).with_parameters(2)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        next[0] = p[0] * x[0] + p[1] * u[0];
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        for k in 0..at.count(self.dims()) {
            let (at, out) = (at.point(k, self.dims()), out.point(k, self.dims()));
            self.step(at.x, at.u, at.p, out.next);
            out.a[0] = at.p[0];
            out.b[0] = at.p[1];
        }
    }
}

/// min q (a x + b u - y)^2 + r (u - before)^2
fn one_step([a, b]: [f64; 2], x: f64, y: f64, before: f64) -> f64 {
    (2.0 * b * (y - a * x) + 3.0 * before) / (2.0 * b * b + 3.0)
}

#[test]
fn parameters_are_those_set_last() {
    for real_time in [false, true] {
        let config = SqpConfig { real_time, ..SqpConfig::default() };
        let problem = NmpcProblem { parameters: vec![1.3, 0.7], ..scalar_problem(1, 1) };
        let mut nmpc = Nmpc::new(problem, Box::new(Parametric), config).unwrap();
        let u = nmpc.step(&[2.0], &[-1.5]).unwrap().u[0];
        assert!((u - one_step([1.3, 0.7], 2.0, -1.5, 0.0)).abs() < 1e-9, "{u}");
        // Also where the linearization is ready.
        nmpc.prepare();
        nmpc.set_parameters(&[0.5, -0.4]).unwrap();
        assert_eq!(nmpc.parameters(), [0.5, -0.4]);
        let next = nmpc.step(&[0.6], &[0.2]).unwrap().u[0];
        assert!((next - one_step([0.5, -0.4], 0.6, 0.2, u)).abs() < 1e-9, "{next}");
        assert!(nmpc.set_parameters(&[1.0]).is_err());
        assert!(nmpc.set_parameters(&[1.0, f64::NAN]).is_err());
    }
    let refused = Nmpc::new(scalar_problem(1, 1), Box::new(Parametric), SqpConfig::default());
    assert_eq!(refused.unwrap_err().to_string(), "parameters: 0 numbers, but 2 are expected");
}

/// With a delay the parameters count for what is under way, too.
#[test]
fn parameters_count_for_the_delay() {
    let parameters = vec![1.3, 0.7];
    let problem = NmpcProblem { parameters, delay: 1, ..scalar_problem(1, 1) };
    let mut nmpc = Nmpc::new(problem, Box::new(Parametric), SqpConfig::default()).unwrap();
    nmpc.set_parameters(&[0.5, 2.0]).unwrap();
    nmpc.reset_to(&[1.0], &[0.25]).unwrap();
    let u = nmpc.step(&[1.0], &[0.1]).unwrap().u[0];
    assert!((u - one_step([0.5, 2.0], 1.0, 0.1, 0.25)).abs() < 1e-9, "{u}");
}

/// x\[k+1\] = x\[k\] + u\[k\] towards 10, with bounds that open.
#[test]
fn bounds_may_differ_by_stage() {
    let high = vec![0.5, 1.5, 2.0];
    let problem = NmpcProblem {
        state_bounds: Bounds::new(vec![-9.0; 3], high),
        input_bounds: Bounds::new(vec![-1.0; 3], vec![2.0, 2.0, 0.25]),
        parameters: vec![1.0, 1.0],
        weights: Weights::uniform(vec![1.0], vec![0.0]),
        ..scalar_problem(3, 3)
    };
    for qp in [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel] {
        let config = SqpConfig { qp, ..SqpConfig::default() };
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(Parametric), config).unwrap();
        let step = nmpc.step(&[0.0], &[10.0; 3]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        for (x, expected) in nmpc.plan().states().iter().zip([0.5, 1.5, 1.75]) {
            assert!((x - expected).abs() < 1e-6, "{qp}: {x} {expected}");
        }
    }
}

#[test]
fn a_weight_of_all_inputs_is_refused_stage_by_stage() {
    // Second differences of u[k-1], u[k], u[k+1].
    let row = [1.0, -2.0, 1.0];
    let w = Weight::Full(row.map(|a| row.map(|b| a * b).to_vec()).to_vec());
    let weights = Weights::uniform(vec![2.0], vec![0.5]).with_input_sequence(w);
    let parameters = vec![1.3, 0.7];
    let problem = NmpcProblem { weights, parameters, ..scalar_problem(2, 2) };
    let config = |qp| SqpConfig { qp, ..SqpConfig::default() };
    let refused = Nmpc::new(problem.clone(), Box::new(Parametric), config(QpMethod::Riccati));
    assert!(matches!(refused, Err(MpcError::Qp(_))));
    let mut found = [0.0; 3];
    for (found, qp) in
        found.iter_mut().zip([QpMethod::Auto, QpMethod::Condensed, QpMethod::Clarabel])
    {
        let mut nmpc = Nmpc::new(problem.clone(), Box::new(Parametric), config(qp)).unwrap();
        nmpc.reset_to(&[1.0], &[0.3]).unwrap();
        let step = nmpc.step(&[1.0], &[0.0, 0.0]).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 1));
        *found = step.u[0];
        // dJ/du1 = 0 by hand: u1 is in x2, in the last increment and in the second difference.
        let u = nmpc.plan().inputs();
        let (x1, second) = (1.3 + 0.7 * u[0], 0.3 - 2.0 * u[0] + u[1]);
        let x2 = 1.3 * x1 + 0.7 * u[1];
        let slope = 4.0 * 0.7 * x2 + (u[1] - u[0]) + 2.0 * second;
        assert!(slope.abs() < 1e-7, "{qp}: {slope}");
    }
    assert!(found.iter().all(|u| (u - found[0]).abs() < 1e-7), "{found:?}");
}

fn tanks(sample_time_s: f64) -> Box<dyn Model> {
    Box::new(Rk4::new(FourTanks::antonelo(), sample_time_s, 4))
}

/// A horizon of two like models is a horizon of one.
#[test]
fn like_models_are_one() {
    let mut one = Nmpc::new(four_tanks(), tanks(10.0), SqpConfig::default()).unwrap();
    let two = Nmpc::builder(four_tanks()).stages(tanks(10.0), 2).stages(tanks(10.0), 3);
    let mut two = two.build().unwrap();
    let mut run = four_tanks_loop();
    run.run(|k, x, reference| {
        let expected = one.step(x, reference).unwrap();
        let step = two.step(x, reference).unwrap();
        assert_eq!(step.sqp_iterations, expected.sqp_iterations, "step {k}");
        for (u, expected) in step.u.iter().zip(expected.u) {
            assert!((u - expected).abs() < 1e-9, "step {k}: {u} {expected}");
        }
        expected.u.to_vec()
    });
}

/// A stage of a shifted plan keeps no linearization of another model: with linear models one
/// quadratic program is always enough.
#[test]
fn stages_are_linearized_by_their_own_models() {
    let builder = Nmpc::builder(scalar_problem(5, 5));
    let builder = builder.stages(Box::new(Linear::scalar(0.9, 1.0)), 2);
    let mut nmpc = builder.stages(Box::new(Linear::scalar(0.5, -0.3)), 3).build().unwrap();
    let mut x = 1.0;
    for k in 0..5 {
        let step = nmpc.step(&[x], &[0.5; 5]).unwrap();
        assert_eq!((step.status, step.sqp_iterations), (SqpStatus::Converged, 1), "step {k}");
        x = nmpc.plan().states()[0];
    }
}

/// Two stages of 10 s, then three of 40 s: true to the models, optimal, and the shifted plan is a
/// good start.
#[test]
fn stages_may_differ_in_length() {
    let problem = NmpcProblem { control_horizon: 4, ..four_tanks() };
    let build = || {
        let builder = Nmpc::builder(problem.clone());
        builder.stages(tanks(10.0), 2).stages(tanks(40.0), 3).build().unwrap()
    };
    let mut nmpc = build();
    assert_eq!(nmpc.stage_times_s(), [0.0, 10.0, 20.0, 60.0, 100.0, 140.0]);
    let mut run = four_tanks_loop();
    let (mut warm, mut cold) = (0, 0);
    run.run(|k, x, _| {
        let reference = [9.16, 14.21].repeat(5);
        let step = nmpc.step(x, &reference).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "step {k}");
        let u = step.u.to_vec();
        warm += step.sqp_iterations;
        if k % 10 == 0 {
            cold += 10 * build().step(x, &reference).unwrap().sqp_iterations;
        }
        let plan = nmpc.plan();
        let mut before = x.to_vec();
        for (j, next) in plan.states().chunks_exact(4).enumerate() {
            let input = &plan.inputs()[2 * j.min(3)..][..2];
            let mut model = tanks(if j < 2 { 10.0 } else { 40.0 });
            let mut found = [0.0; 4];
            model.step(&before, input, &[], &mut found);
            let off = found.iter().zip(next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-7, "step {k}, stage {j}: {off:e}");
            before = next.to_vec();
        }
        u
    });
    assert!(warm * 3 < cold * 2, "{warm} {cold}");
}

/// Constraints count from stage N1 on; their multipliers are shifted with the plan.
#[test]
fn stages_of_different_lengths_have_constraints() {
    let constraints = Some(Constraints::new(Together { x: 1.0, row: 1.0 }));
    let problem = NmpcProblem { control_horizon: 4, n1: 2, constraints, ..four_tanks() };
    let builder = Nmpc::builder(problem).stages(tanks(10.0), 2).stages(tanks(40.0), 3);
    let (mut nmpc, mut active) = (builder.build().unwrap(), 0);
    four_tanks_loop().run(|k, x, _| {
        let step = nmpc.step(x, &[9.16, 14.21].repeat(5)).unwrap();
        assert_eq!(step.status, SqpStatus::Converged, "step {k}");
        let u = step.u.to_vec();
        let together = |x: &[f64]| x[0] + x[1];
        let most = nmpc.plan().states().chunks_exact(4).skip(1).map(together).fold(0.0, f64::max);
        assert!(most < 20.0 + 1e-6, "step {k}: {most}");
        active += usize::from(most > 20.0 - 1e-6);
        u
    });
    assert!(active > 100, "{active}");
}

/// The loop shows the controller the references at the ends of its stages.
#[test]
fn a_loop_previews_at_the_stages() {
    let problem = NmpcProblem { control_horizon: 4, ..four_tanks() };
    let builder = Nmpc::builder(problem).stages(tanks(10.0), 2).stages(tanks(40.0), 3);
    let mut nmpc = builder.build().unwrap();
    // It changes after step 9: from the stage that ends 100 s on.
    let values = [[9.0, 13.96].repeat(9), [10.0, 15.5].repeat(11)].concat();
    let start = [9.0, 13.96, 2.0, 2.5];
    let window = [[9.0, 13.96].repeat(3), [10.0, 15.5].repeat(2)].concat();
    let expected = nmpc.step(&start, &window).unwrap().u.to_vec();
    let later = nmpc_without_preview(&start);
    let reference = Reference::new(values, 2).unwrap();
    let plant = Dopri5::new(FourTanks::antonelo(), 1e-10);
    let mut run = ClosedLoop::new(&mut nmpc, plant.clone(), reference.clone(), &start).unwrap();
    assert_eq!(run.control().unwrap().unwrap().u(), expected);
    let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &start).unwrap().without_preview();
    assert_eq!(run.control().unwrap().unwrap().u(), later);
}

/// The first input where the reference stays as it is.
fn nmpc_without_preview(start: &[f64]) -> Vec<f64> {
    let problem = NmpcProblem { control_horizon: 4, ..four_tanks() };
    let builder = Nmpc::builder(problem).stages(tanks(10.0), 2).stages(tanks(40.0), 3);
    builder.build().unwrap().step(start, &[9.0, 13.96].repeat(5)).unwrap().u.to_vec()
}

#[test]
fn models_must_make_up_the_horizon() {
    let refusal = |models: &[usize]| {
        let builder = Nmpc::builder(four_tanks());
        let builder = models.iter().fold(builder, |b, &count| b.stages(tanks(10.0), count));
        builder.build().unwrap_err().to_string()
    };
    assert_eq!(
        refusal(&[2, 2]),
        "the models of the horizon is given for 4 stages, but there are 5"
    );
    assert_eq!(
        refusal(&[]),
        "the models of the horizon is 0, but must be from 1 to 18446744073709551615"
    );
    let builder =
        Nmpc::builder(four_tanks()).stages(tanks(10.0), 2).stages(Box::new(Parametric), 3);
    assert_eq!(builder.build().unwrap_err(), MpcError::DifferentModels);
    let shorter = Nmpc::builder(four_tanks()).stages(tanks(10.0), 2).stages(tanks(5.0), 3);
    assert_eq!(
        shorter.build().unwrap_err().to_string(),
        "a later sample time is 5, but must be not less than the first"
    );
}

/// The conditions hold for the whole horizon of one model with parameters.
#[test]
fn plans_with_parameters_are_optimal() {
    let problem = NmpcProblem { parameters: vec![1.1, 0.5], ..scalar_problem(4, 3) };
    let mut nmpc = Nmpc::new(problem, Box::new(Parametric), SqpConfig::default()).unwrap();
    nmpc.step(&[1.0], &[0.0; 4]).unwrap();
    let input = StepInput { x: &[1.0], previous: &[0.0], reference: &[0.0; 4] };
    let found = residuals(&nmpc, &mut Parametric, &input);
    assert!(found.iter().all(|&r| r <= 1e-8 * scale(&nmpc)), "{found:?}");
}
