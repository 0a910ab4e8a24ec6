//! Augmented and compensated models.

use pinc_ad::Scalar;
use pinc_estimate::{
    Augmentation, Augmented, Compensated, Disturbance, Ekf, EstimateError, Measured, Tuning,
};
use pinc_mpc::{Nmpc, NmpcProblem, SqpConfig, SqpStatus, Weights};
use pinc_ode::{
    ArgumentError, Dims, LinearizationBuffer, Model, OutputLinearization, Plant, Rk4, Stages,
    Variable,
};
use pinc_plants::FourTanks;
use proptest::prelude::*;

/// A mass on a spring of unknown stiffness, of which the force on the ground is measured.
#[derive(Clone, Debug)]
struct Spring;

impl Plant for Spring {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("s", "m"), Variable::new("v", "m/s")];
        &STATES
    }
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("f", "N")];
        &INPUTS
    }
    fn parameters(&self) -> &[Variable] {
        static PARAMETERS: [Variable; 2] =
            [Variable::new("damping", ""), Variable::new("stiffness", "")];
        &PARAMETERS
    }
    fn outputs(&self) -> &[Variable] {
        static OUTPUTS: [Variable; 2] = [Variable::new("s", "m"), Variable::new("force", "N")];
        &OUTPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = x[1];
        dx[1] = u[0] - p[1] * x[0] - p[0] * x[1];
    }
    fn output<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], y: &mut [S]) {
        y[0] = x[0];
        y[1] = p[1] * x[0] * x[0] + u[0];
    }
}

fn spring() -> Box<dyn Model> {
    Box::new(Rk4::new(Spring, 0.5, 2))
}

fn augmentations() -> Vec<Augmentation> {
    let kinds = [
        Disturbance::None,
        Disturbance::Input,
        Disturbance::Output,
        Disturbance::States(vec![1]),
        Disturbance::States(vec![1, 0]),
    ];
    let with = |disturbance| {
        let of = Augmentation {
            measured: vec![Measured::Output(1), Measured::State(0)],
            disturbance,
            parameters: vec![0.25, 1.5],
            estimated: vec![1],
            known: Vec::new(),
        };
        [of.clone(), Augmentation { known: vec![0], ..of }]
    };
    kinds.into_iter().flat_map(with).collect()
}

proptest! {
    /// What an estimator and a controller predict is the same, step by step and measured quantity
    /// by measured quantity.
    #[test]
    fn both_models_predict_the_same(
        state in prop::array::uniform2(-2.0..2.0_f64),
        unknown in prop::array::uniform3(-0.5..0.5_f64),
        u in -1.0..1.0_f64,
    ) {
        for augmentation in augmentations() {
            let mut augmented = Augmented::new(spring(), augmentation.clone()).unwrap();
            let mut compensated = Compensated::new(spring(), augmentation.clone()).unwrap();
            let (nz, np) = (augmented.dims().nx, compensated.dims().np);
            let (unknowns, known) = (augmentation.unknowns(spring().dims()), augmented.dims().np);
            prop_assert_eq!(np, unknowns + known);
            let mut z = state.to_vec();
            z.extend(&unknown[..unknowns - 1]);
            z.push(1.5 + unknown[2]);
            let p = vec![0.25 + unknown[0]; known];
            let (mut x, mut w) = ([0.0; 2], [&vec![0.0; unknowns][..], &p].concat());
            augmentation.read(&z, &mut x, &mut w);
            let (mut next, mut y, mut all) = (vec![0.0; nz], [0.0; 2], [0.0; 2]);
            augmented.output(&z, &[u], &p, &mut y);
            compensated.output(&x, &[u], &w, &mut all);
            prop_assert!((y[0] - all[1]).abs() < 1e-12);
            prop_assert!((y[1] - x[0]).abs() < 1e-12);
            augmented.step(&z, &[u], &p, &mut next);
            let mut ahead = [0.0; 2];
            compensated.step(&x, &[u], &w, &mut ahead);
            let (mut expected, mut same) = ([0.0; 2], w.clone());
            augmentation.read(&next, &mut expected, &mut same);
            prop_assert_eq!(&same, &w);
            for (found, expected) in ahead.iter().zip(expected) {
                prop_assert!((found - expected).abs() < 1e-12);
            }
        }
    }
}

/// Values of a model's step and outputs at a point, one after the other.
fn values(model: &mut dyn Model, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
    let Dims { nx, ny, .. } = model.dims();
    let mut all = vec![0.0; nx + ny];
    let (next, y) = all.split_at_mut(nx);
    model.step(x, u, p, next);
    model.output(x, u, p, y);
    all
}

/// Compares the derivatives of steps and outputs with central differences in x, u and p.
fn assert_derivatives(model: &mut dyn Model, at: &[f64]) {
    const STEP: f64 = 1e-5;
    let Dims { nx, nu, np, ny, .. } = model.dims();
    let (x, rest) = at.split_at(nx);
    let (u, p) = rest.split_at(nu);
    let here = Stages { x, u, p };
    let mut step = LinearizationBuffer::new(model.dims(), 1);
    model.linearize(here, step.as_mut());
    let (mut y, mut c, mut d) = (vec![0.0; ny], vec![0.0; ny * nx], vec![0.0; ny * nu]);
    let mut e = vec![0.0; ny * np];
    let out = OutputLinearization { y: &mut y, c: &mut c, d: &mut d, e: &mut e };
    model.linearize_output(here, out);
    for k in 0..at.len() {
        let mut moved = |by: f64| {
            let mut at = at.to_vec();
            at[k] += by;
            values(model, &at[..nx], &at[nx..nx + nu], &at[nx + nu..])
        };
        let (ahead, behind) = (moved(STEP), moved(-STEP));
        let (matrices, column, width) = match k {
            k if k < nx => ([&step.a, &c], k, nx),
            k if k < nx + nu => ([&step.b, &d], k - nx, nu),
            k => ([&step.e, &e], k - nx - nu, np),
        };
        let found = matrices.iter().flat_map(|m| m.iter().skip(column).step_by(width));
        for (row, (found, (a, b))) in found.zip(ahead.iter().zip(&behind)).enumerate() {
            let expected = (a - b) / (2.0 * STEP);
            assert!((found - expected).abs() < 1e-8, "row {row}, variable {k}: {found} {expected}");
        }
    }
}

/// All derivatives of both models agree with their values: by disturbances and parameters, too.
#[test]
fn derivatives_match_the_values() {
    for augmentation in augmentations() {
        let (x, u, w, p) = ([0.7, -0.4], [0.3], [0.21, -0.13], [0.6]);
        let p = &p[..augmentation.known.len()];
        let mut compensated = Compensated::new(spring(), augmentation.clone()).unwrap();
        let unknowns = augmentation.unknowns(spring().dims());
        let w = [&w[..unknowns - 1], &[1.4]].concat();
        assert_derivatives(&mut compensated, &[&x[..], &u, &w, p].concat());
        let mut augmented = Augmented::new(spring(), augmentation).unwrap();
        assert_derivatives(&mut augmented, &[&x[..], &w, &u, p].concat());
    }
}

/// At several points at once, each with its own disturbances and parameters, models give what they
/// give at each: their steps, and the derivatives there.
#[test]
fn points_are_linearized_each_by_itself() {
    for augmentation in augmentations() {
        let mut compensated = Compensated::new(spring(), augmentation.clone()).unwrap();
        let (np, known) = (compensated.dims().np, augmentation.known.len());
        let unknowns = np - known;
        let x = [0.7, -0.4, -1.1, 0.2, 0.3, 0.9];
        let u = [0.3, -0.6, 0.1];
        let w: Vec<f64> = [[0.21, -0.13], [-0.4, 0.35], [0.05, 0.5]]
            .iter()
            .zip([1.4, 0.6, 2.3])
            .fold(Vec::new(), |all, (disturbances, stiffness)| {
                let damping = vec![0.3 * stiffness; known];
                [&all, &disturbances[..unknowns - 1], &[stiffness], &damping].concat()
            });
        assert_each_point(&mut compensated, Stages { x: &x, u: &u, p: &w });
        let z: Vec<f64> =
            x.chunks(2).zip(w.chunks(np)).flat_map(|(x, w)| [x, &w[..unknowns]].concat()).collect();
        let p: Vec<f64> = w.chunks(np).flat_map(|w| w[unknowns..].to_vec()).collect();
        let mut augmented = Augmented::new(spring(), augmentation).unwrap();
        assert_each_point(&mut augmented, Stages { x: &z, u: &u, p: &p });
    }
}

/// Compares a linearization at several points with those at each, and its steps with steps.
fn assert_each_point(model: &mut dyn Model, at: Stages<'_>) {
    let (dims, count) = (model.dims(), at.count(model.dims()));
    let mut all = LinearizationBuffer::new(dims, count);
    model.linearize(at, all.as_mut());
    let part = |all: &[f64], k: usize| {
        let width = all.len() / count;
        all[k * width..(k + 1) * width].to_vec()
    };
    for k in 0..count {
        let point = at.point(k, dims);
        let mut next = vec![0.0; dims.nx];
        model.step(point.x, point.u, point.p, &mut next);
        let mut one = LinearizationBuffer::new(dims, 1);
        model.linearize(point, one.as_mut());
        for (found, expected) in [
            (part(&all.next, k), &next),
            (part(&all.a, k), &one.a),
            (part(&all.b, k), &one.b),
            (part(&all.e, k), &one.e),
        ] {
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-12, "point {k}: {found} {expected}");
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let tanks = || Box::new(Rk4::new(FourTanks::antonelo(), 10.0, 4));
    let refused = |augmentation| Augmented::new(tanks(), augmentation).unwrap_err();
    let measured = |states: &[usize]| Measured::states(states.iter().copied());

    assert_eq!(refused(Augmentation::default()), EstimateError::NothingMeasured);
    let error = refused(Augmentation::measured(measured(&[0, 4])));
    assert_eq!(error, ArgumentError::Index { field: "measured states", found: 4, last: 3 }.into());
    let error = refused(Augmentation::measured(measured(&[1, 1])));
    assert_eq!(error, EstimateError::MeasuredTwice { measured: Measured::State(1) });
    let input = Disturbance::Input;
    let error =
        refused(Augmentation { disturbance: input, ..Augmentation::measured(measured(&[0])) });
    assert_eq!(error, EstimateError::TooManyDisturbances { disturbances: 2, measured: 1 });
    assert!(error.to_string().contains("at most one disturbance per measured quantity"));
    let twice = Disturbance::States(vec![2, 2]);
    let error =
        refused(Augmentation { disturbance: twice, ..Augmentation::measured(measured(&[0, 1])) });
    assert_eq!(error, ArgumentError::Index { field: "disturbed states", found: 2, last: 3 }.into());
    let error =
        refused(Augmentation { estimated: vec![0], ..Augmentation::measured(measured(&[0])) });
    assert_eq!(
        error,
        ArgumentError::Index { field: "estimated parameters", found: 0, last: 0 }.into()
    );

    let right = Tuning {
        initial_estimate: vec![2.0; 4],
        initial_sd: vec![1.0; 4],
        process_sd: vec![0.0; 4],
        measurement_sd: vec![0.1; 4],
        ..Tuning::default()
    };
    assert!(Ekf::new(tanks(), right.clone()).is_ok());
    let wrong = [
        Tuning { measurement_sd: vec![0.0; 4], ..right.clone() },
        Tuning { measurement_sd: vec![0.1; 3], ..right.clone() },
        Tuning { process_sd: vec![-1.0; 4], ..right.clone() },
        Tuning { initial_sd: vec![f64::INFINITY; 4], ..right.clone() },
        Tuning { initial_estimate: vec![f64::NAN; 4], ..right.clone() },
        Tuning { low: vec![1.0; 4], high: vec![0.0; 4], ..right.clone() },
        Tuning { low: vec![1.0; 3], ..right.clone() },
    ];
    for tuning in wrong {
        assert!(Ekf::new(tanks(), tuning.clone()).is_err(), "{tuning:?}");
    }
    let tuning = Tuning { measurement_sd: vec![0.1; 2], ..right };
    let tuning = Tuning { initial_estimate: vec![0.0; 2], ..tuning };
    let error = Ekf::new(spring(), tuning).unwrap_err();
    let length = ArgumentError::Length { field: "parameters", expected: 2, found: 0 };
    assert_eq!(error, length.into());
    let both = Augmentation { known: vec![0, 1], ..augmentations()[0].clone() };
    let error = Augmented::new(spring(), both).unwrap_err();
    assert_eq!(error, EstimateError::KnownAndEstimated { index: 1 });
    assert_eq!(spring().dims(), Dims::new(2, 1).with_parameters(2).with_outputs(2));
}

/// The problem has the parameters that the model takes: no disturbances and the nominal stiffness.
/// Its controller plans what one with a plain model of these parameters does.
#[test]
fn a_compensated_model_gives_a_problem_that_fits_it() {
    let weights = || Weights::uniform(vec![4.0, 1.0], vec![0.5]);
    let first_input = |problem: NmpcProblem, model: Box<dyn Model>| {
        let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
        let step = nmpc.step(&[1.0, -0.5], &[0.2; 8]).unwrap();
        assert_eq!(step.status, SqpStatus::Converged);
        step.u[0]
    };
    let plain = NmpcProblem {
        parameters: vec![0.25, 1.5],
        ..NmpcProblem::new(spring().dims(), 4, weights())
    };
    let expected = first_input(plain, spring());
    for augmentation in augmentations() {
        let model = Compensated::new(spring(), augmentation.clone()).unwrap();
        let problem = model.problem(4, weights());
        let disturbances = augmentation.unknowns(spring().dims()) - 1;
        let known = vec![0.25; augmentation.known.len()];
        assert_eq!(problem.parameters, [vec![0.0; disturbances], vec![1.5], known].concat());
        let found = first_input(problem, Box::new(model));
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

/// T P T' for the T of [`Augmentation::read`], which is linear.
#[test]
fn the_covariance_of_what_a_controller_sees_follows_from_the_estimates() {
    for augmentation in augmentations() {
        let nz = 2 + augmentation.unknowns(spring().dims());
        let t: Vec<Vec<f64>> = (0..nz)
            .map(|column| {
                let mut z = vec![0.0; nz];
                z[column] = 1.0;
                let mut seen = vec![0.0; nz];
                let (x, w) = seen.split_at_mut(2);
                augmentation.read(&z, x, w);
                seen
            })
            .collect();
        let p = |i: usize, j: usize| 1.0 / (1 + i + j) as f64;
        let of_estimate: Vec<f64> = (0..nz * nz).map(|at| p(at / nz, at % nz)).collect();
        let mut found = Vec::new();
        augmentation.read_covariance(&of_estimate, 2, &mut found);
        let width = nz + augmentation.known.len();
        assert_eq!(found.len(), width * width);
        for (at, found) in found.into_iter().enumerate() {
            let (row, column) = (at / width, at % width);
            if row >= nz || column >= nz {
                assert_eq!(found.to_bits(), 0, "what is known has no covariance");
                continue;
            }
            let pairs = (0..nz).flat_map(|i| (0..nz).map(move |j| (i, j)));
            let expected: f64 = pairs.map(|(i, j)| t[i][row] * p(i, j) * t[j][column]).sum();
            assert!((found - expected).abs() < 1e-14, "{augmentation:?} {row} {column}");
        }
    }
}

/// What a controller sees and what its model is asked: input disturbances are added to the input,
/// output disturbances taken from states that are measured, and parameters go to their places.
#[test]
fn arguments_of_a_model_are_those_of_the_compensated_one_without_disturbances() {
    let of = |disturbance: Disturbance| Augmentation {
        measured: vec![Measured::State(1), Measured::Output(0)],
        disturbance,
        parameters: vec![1.0, 2.0, 3.0],
        estimated: vec![2],
        known: vec![0],
    };
    let asked = |disturbance: Disturbance, w: &[f64]| {
        let (mut x, mut u, mut p) = ([10.0, 20.0], [5.0, 6.0], [f64::NAN; 3]);
        of(disturbance).arguments(&mut x, &mut u, w, &mut p);
        assert_eq!(p.to_vec(), [9.0, 2.0, 7.0]);
        (x, u)
    };
    assert_eq!(asked(Disturbance::None, &[7.0, 9.0]), ([10.0, 20.0], [5.0, 6.0]));
    let states = Disturbance::States(vec![0]);
    assert_eq!(asked(states, &[0.5, 7.0, 9.0]), ([10.0, 20.0], [5.0, 6.0]));
    let input = asked(Disturbance::Input, &[0.5, -0.25, 7.0, 9.0]);
    assert_eq!(input, ([10.0, 20.0], [5.5, 5.75]));
    let output = asked(Disturbance::Output, &[0.5, -0.25, 7.0, 9.0]);
    assert_eq!(output, ([10.0, 19.5], [5.0, 6.0]));
    // The other way round, from what is estimated; what is known stays.
    let seen = |disturbance: Disturbance| {
        let (mut x, mut w) = ([0.0; 2], [0.0, 0.0, 0.0, 9.0]);
        of(disturbance).read(&[10.0, 19.5, 0.5, -0.25, 7.0], &mut x, &mut w);
        assert_eq!(w.to_vec(), [0.5, -0.25, 7.0, 9.0]);
        x.to_vec()
    };
    assert_eq!(seen(Disturbance::Output), [10.0, 20.0]);
    assert_eq!(seen(Disturbance::Input), [10.0, 19.5]);
    assert_eq!(of(Disturbance::Input).known_values(), [1.0]);
}
