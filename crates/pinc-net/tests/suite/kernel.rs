//! The batched kernel against its specification, dual numbers inside a tape.

use super::family::{Member, Pendulum};
use pinc_ad::{Scalar, Tape};
use pinc_net::{
    Ansatz, BatchLoss, Domain, InitialScale, Isa, LossTerms, LossWeights, Measurements, NetConfig,
    ParameterRange, PincNet, Points, ResidualScale, Sampler, Scenario, Workers, initial_conditions,
    reference_loss, reference_measured, reference_residuals,
};
use pinc_ode::Plant;
use pinc_plants::{FourTanks, OneTank, VanDerPol};
use proptest::prelude::*;

/// The weight of the measurements.
const MEASURED: f64 = 0.7;

/// A box around the origin, or around 5 for tanks (partly below 0, to meet empty tanks).
fn domain(plant: &impl Plant) -> Domain {
    let dims = plant.dims();
    Domain {
        state_low: vec![-1.0; dims.nx],
        state_high: vec![6.0; dims.nx],
        input_low: vec![-1.0; dims.nu],
        input_high: vec![3.0; dims.nu],
        parameters: Vec::new(),
    }
    .with_parameters(plant.parameters().iter().map(|p| ParameterRange::new(&*p.name, 0.2..=1.4)))
}

#[derive(Clone, Debug)]
struct Case {
    hidden_layers: usize,
    neurons: usize,
    ansatz: Ansatz,
    time_only: bool,
    collocation: usize,
    initial: usize,
    measured: usize,
    /// Whether measurements have derivatives.
    slopes: bool,
    seed: u64,
}

fn case() -> impl Strategy<Value = Case> {
    let ansatz = prop_oneof![Just(Ansatz::Direct), Just(Ansatz::HardLinear)];
    let sizes = (1..=10_usize, prop_oneof![Just(3), Just(5), Just(10), 1..=12_usize, Just(20)]);
    let points = (0..40_usize, 0..20_usize, 0..40_usize);
    let choices = (ansatz, any::<bool>(), any::<bool>(), any::<u64>());
    (sizes, points, choices).prop_map(|(sizes, points, (ansatz, time_only, slopes, seed))| {
        let ((hidden_layers, neurons), (collocation, initial, measured)) = (sizes, points);
        let kind = Case { hidden_layers, neurons, ansatz, time_only, slopes, seed, ..large() };
        Case { collocation, initial, measured, ..kind }
    })
}

struct Problem<P> {
    plant: P,
    net: PincNet,
    weights: LossWeights,
    collocation: Points,
    initial: Points,
    measured: Measurements,
}

fn problem<P: Plant>(plant: P, case: &Case) -> Problem<P> {
    let dims = plant.dims();
    let domain = domain(&plant);
    let scenario = Scenario { initial_state: vec![1.5; dims.nx], input: vec![0.5; dims.nu] };
    // A conventional PINN is of one plant.
    let time_only = case.time_only && dims.np == 0;
    let config = NetConfig {
        sample_time_s: 0.7,
        hidden_layers: case.hidden_layers,
        neurons: case.neurons,
        ansatz: case.ansatz,
        time_only: time_only.then(|| scenario.clone()),
    };
    let net = PincNet::new(&plant, &config, &domain, case.seed).unwrap();
    let domain = net.domain().clone();
    let scale = ResidualScale::Normalized;
    let weights = LossWeights::new(&net, 0.3, &scale, InitialScale::Normalized).unwrap();
    let weights = LossWeights { derivatives: 0.4, ..weights };
    let (collocation, initial) = if time_only {
        let mut initial = Points::new(dims);
        initial.push(0.0, &scenario.initial_state, &scenario.input, &[]);
        (Sampler::Sobol.scenario(case.collocation, 0.7, &scenario, case.seed), initial)
    } else {
        (
            Sampler::Sobol.collocation(case.collocation, 0.7, &domain, 1, case.seed),
            initial_conditions(case.initial, &domain, case.seed),
        )
    };
    let measured = measured(case, &domain);
    Problem { plant, net, weights, collocation, initial, measured }
}

/// Values about as large as the states, every third of them missing, with slopes where they are
/// wanted.
fn measured(case: &Case, domain: &Domain) -> Measurements {
    let points = Sampler::Independent.collocation(case.measured, 0.7, domain, 1, !case.seed);
    let mut measured = Measurements::new(domain.dims());
    for k in 0..points.len() {
        let y0 = points.state(k);
        let value = |i: usize| (!(k + i).is_multiple_of(3)).then_some(1.0 - 0.5 * y0[i]);
        let y: Vec<_> = (0..y0.len()).map(value).collect();
        let (u, p) = (points.input(k), points.parameters(k));
        measured.push(points.time(k), y0, u, p, &y);
        if case.slopes {
            let direction: Vec<f64> = [y0, u, p].concat().iter().map(|v| 0.3 - 0.2 * v).collect();
            let slope: Vec<f64> = y0.iter().map(|y0| 0.1 + 0.3 * y0).collect();
            measured.push_slope(&direction, &slope);
        }
    }
    measured
}

impl<P: Plant> Problem<P> {
    fn kernel(&self, isa: Isa, threads: usize) -> (LossTerms, Vec<f64>) {
        let workers = Workers::with_isa(threads, isa).unwrap();
        let mut loss = BatchLoss::new(&self.plant, &self.net, &self.weights, &workers);
        loss.set_points(&self.collocation, &self.initial);
        loss.set_measurements(&self.measured, MEASURED);
        let mut gradient = vec![f64::NAN; self.net.mlp().parameters().len()];
        let terms = loss.loss_gradient(self.net.mlp().parameters(), &mut gradient);
        assert_eq!(terms, loss.loss(self.net.mlp().parameters()), "with and without gradient");
        (terms, gradient)
    }

    fn reference(&self) -> ([f64; 3], Vec<f64>) {
        let tape = Tape::new();
        let w: Vec<_> = self.net.mlp().parameters().iter().map(|&w| tape.variable(w)).collect();
        let points = (&self.collocation, &self.initial);
        let [data, physics] =
            reference_loss(&self.plant, &self.net, &self.weights, &w, points, w[0]);
        let measured =
            reference_measured(&self.net, &self.weights, &w, (&self.measured, MEASURED), w[0]);
        let measured = measured.into_iter().fold(w[0].constant(0.0), |sum, r| sum + r * r);
        let gradient = tape.gradient(data + physics + measured, &w);
        ([data.value(), physics.value(), measured.value()], gradient)
    }

    fn normal_matrix(&self, isa: Isa, threads: usize) -> Vec<f64> {
        let workers = Workers::with_isa(threads, isa).unwrap();
        let mut loss = BatchLoss::new(&self.plant, &self.net, &self.weights, &workers);
        loss.set_points(&self.collocation, &self.initial);
        loss.set_measurements(&self.measured, MEASURED);
        let parameters = self.net.mlp().parameters();
        let mut out = vec![f64::NAN; parameters.len().pow(2)];
        loss.normal_matrix(parameters, &mut out);
        let first = out.clone();
        loss.normal_matrix(parameters, &mut out);
        assert_eq!(first, out, "nothing is left of the first time");
        out
    }

    /// J'J, row by row, with each row of J from a sweep through the tape.
    fn reference_normal_matrix(&self) -> Vec<Vec<f64>> {
        let tape = Tape::new();
        let w: Vec<_> = self.net.mlp().parameters().iter().map(|&w| tape.variable(w)).collect();
        let points = (&self.collocation, &self.initial);
        let residuals =
            reference_residuals(&self.plant, &self.net, &self.weights, &w, points, w[0]);
        let mut matrix = vec![vec![0.0; w.len()]; w.len()];
        let measured =
            reference_measured(&self.net, &self.weights, &w, (&self.measured, MEASURED), w[0]);
        for residual in residuals.into_iter().flatten().chain(measured) {
            let row = tape.gradient(residual, &w);
            for (to, a) in matrix.iter_mut().zip(&row) {
                for (to, b) in to.iter_mut().zip(&row) {
                    *to += a * b;
                }
            }
        }
        matrix
    }

    fn check_normal_matrix(&self) -> Result<(), TestCaseError> {
        let expected = self.reference_normal_matrix();
        let size = expected.iter().flatten().fold(1e-3, |m: f64, a| m.max(a.abs()));
        for isa in Isa::available() {
            let matrix = self.normal_matrix(isa, 2);
            for (i, row) in expected.iter().enumerate() {
                for (j, want) in row[..=i].iter().enumerate() {
                    let got = matrix[j * expected.len() + i];
                    prop_assert!(
                        (got - want).abs() <= 1e-12 * size,
                        "{isa}, {i} {j}: {got} {want}"
                    );
                }
            }
        }
        Ok(())
    }

    /// Sums of up to some thousand products of rounded factors, in another order: errors of a few
    /// hundred roundings of the largest term.
    fn check(&self) -> Result<(), TestCaseError> {
        let (expected, expected_gradient) = self.reference();
        let size = expected_gradient.iter().fold(1e-3, |m: f64, g| m.max(g.abs()));
        for isa in Isa::available() {
            let (terms, gradient) = self.kernel(isa, 1);
            let terms = [terms.data, terms.physics, terms.measured];
            for (got, want) in terms.iter().zip(expected) {
                prop_assert!((got - want).abs() <= 1e-12 * want.max(1.0), "{isa}: {got} {want}");
            }
            for (i, (got, want)) in gradient.iter().zip(&expected_gradient).enumerate() {
                prop_assert!((got - want).abs() <= 1e-12 * size, "{isa}, {i}: {got} {want}");
            }
        }
        Ok(())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn van_der_pol_agrees_with_the_specification(case in case()) {
        problem(VanDerPol::default(), &case).check()?;
    }

    #[test]
    fn one_tank_agrees_with_the_specification(case in case()) {
        problem(OneTank::default(), &case).check()?;
    }

    #[test]
    fn a_family_agrees_with_the_specification(case in case()) {
        problem(Pendulum, &case).check()?;
    }

    #[test]
    fn four_tanks_agree_with_the_specification(case in case()) {
        problem(FourTanks::antonelo(), &case).check()?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn normal_matrices_agree_with_the_specification(mut case in case()) {
        // The tape is swept once per residual.
        case.hidden_layers = case.hidden_layers.min(3);
        case.neurons = case.neurons.min(8);
        problem(VanDerPol::default(), &case).check_normal_matrix()?;
        problem(OneTank::default(), &case).check_normal_matrix()?;
        problem(Pendulum, &case).check_normal_matrix()?;
        problem(FourTanks::antonelo(), &case).check_normal_matrix()?;
    }
}

#[test]
fn normal_matrices_of_several_slabs_and_strips_agree_with_the_specification() {
    // More than 8 slabs of 256 rows, and more than 2 strips of 128 columns.
    let case = Case {
        hidden_layers: 2,
        neurons: 12,
        collocation: 460,
        initial: 40,
        measured: 40,
        ..large()
    };
    problem(FourTanks::antonelo(), &case).check_normal_matrix().unwrap();
    let slopes = Case { collocation: 0, initial: 0, measured: 230, slopes: true, ..case };
    problem(FourTanks::antonelo(), &slopes).check_normal_matrix().unwrap();
}

#[test]
fn normal_matrices_are_the_same_on_any_number_of_threads() {
    let problem = problem(VanDerPol::default(), &Case { neurons: 10, slopes: true, ..large() });
    for isa in Isa::available() {
        let one = problem.normal_matrix(isa, 1);
        assert_eq!(one, problem.normal_matrix(isa, 2));
        assert_eq!(one, problem.normal_matrix(isa, 5));
    }
}

#[test]
fn without_points_the_normal_matrix_is_zero() {
    let case = Case { collocation: 0, initial: 0, measured: 0, hidden_layers: 1, ..large() };
    let matrix = problem(VanDerPol::default(), &case).normal_matrix(Isa::detect(), 2);
    assert!(matrix.iter().all(|a| a.to_bits() == 0));
}

fn large() -> Case {
    Case {
        hidden_layers: 4,
        neurons: 20,
        ansatz: Ansatz::Direct,
        time_only: false,
        collocation: 3001,
        initial: 157,
        measured: 301,
        slopes: false,
        seed: 5,
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let wide = Case { hidden_layers: 2, neurons: 47, collocation: 301, ..large() };
    let slopes = Case { slopes: true, measured: 3001, ..large() };
    for case in [large(), wide, slopes] {
        let problem = problem(VanDerPol::default(), &case);
        for isa in Isa::available() {
            let one = problem.kernel(isa, 1);
            assert_eq!(one, problem.kernel(isa, 2));
            assert_eq!(one, problem.kernel(isa, 5));
        }
    }
}

#[test]
fn wide_and_deep_nets_agree_with_the_specification() {
    for (hidden_layers, neurons) in [(1, 64), (2, 64), (2, 47), (10, 15), (10, 20)] {
        let (size, slopes) = (large(), hidden_layers == 2);
        let size = Case { hidden_layers, neurons, slopes, ..size };
        let case = Case { collocation: 33, initial: 9, measured: 21, ..size };
        problem(FourTanks::johansson_minimum(), &case).check().unwrap();
    }
}

#[test]
fn a_nan_or_infinite_weight_shows_in_loss_and_gradient() {
    let problem = problem(VanDerPol::default(), &large());
    for bad in [f64::NAN, f64::INFINITY] {
        // A weight of the output layer, and one of the first layer with every point.
        for index in [0, problem.net.mlp().parameters().len() - 1] {
            let mut parameters = problem.net.mlp().parameters().to_vec();
            parameters[index] = bad;
            for isa in Isa::available() {
                let workers = Workers::with_isa(2, isa).unwrap();
                let mut loss =
                    BatchLoss::new(&problem.plant, &problem.net, &problem.weights, &workers);
                loss.set_points(&problem.collocation, &problem.initial);
                let mut gradient = vec![0.0; parameters.len()];
                let terms = loss.loss_gradient(&parameters, &mut gradient);
                let finite = terms.total().is_finite() && gradient.iter().all(|g| g.is_finite());
                assert!(!finite || (bad.is_infinite() && index == 0), "{isa}, {bad}, {index}");
            }
        }
    }
}

/// Loss, gradient and normal matrix with unknown parameters: in the weights they equal the known
/// plant's, in the parameters its differences.
#[test]
fn unknown_parameters_agree_with_the_specification() {
    for (neurons, start, q) in [
        (5, [0.8, -0.3], [0.5, 0.2]),
        (5, [1e-3, 0.0], [3.0, 0.7]),
        (5, [4e3, 2.0], [0.1, -0.4]),
        (46, [0.8, -0.3], [0.5, 0.2]),
    ] {
        let size = Case { hidden_layers: 2, neurons, slopes: true, ..large() };
        let case = Case { collocation: 37, initial: 9, ..size };
        let scale = start.map(|start: f64| if start.abs() > 0.0 { start.abs() } else { 1.0 });
        let at = |q: [f64; 2]| Member([0, 1].map(|i| start[i] + scale[i] * q[i]));
        let known = problem(at(q), &case);
        let residuals = |q: [f64; 2]| {
            let points = (&known.collocation, &known.initial);
            let w = known.net.mlp().parameters();
            let [data, physics] =
                reference_residuals(&at(q), &known.net, &known.weights, w, points, 0.0);
            let measured = (&known.measured, MEASURED);
            [data, physics, reference_measured(&known.net, &known.weights, w, measured, 0.0)]
                .concat()
        };
        // The residuals are linear in the parameters.
        let columns = [0, 1].map(|i| {
            let moved = |by: f64| residuals([0, 1].map(|j| if i == j { q[j] + by } else { q[j] }));
            let ends = moved(0.5).into_iter().zip(moved(-0.5));
            ends.map(|(after, before)| after - before).collect::<Vec<f64>>()
        });
        let (r, (_, expected)) = (residuals(q), known.reference());
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let in_q = [0, 1].map(|i| 2.0 * dot(&columns[i], &r));
        let expected = [&expected[..], &in_q].concat();
        let size = expected.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        for isa in Isa::available() {
            let workers = Workers::with_isa(2, isa).unwrap();
            let mut loss =
                BatchLoss::inverse(&Pendulum, &known.net, &known.weights, &start, &workers);
            loss.set_points(&known.collocation, &known.initial);
            loss.set_measurements(&known.measured, MEASURED);
            let x = [known.net.mlp().parameters(), &q].concat();
            let mut gradient = vec![f64::NAN; x.len()];
            let terms = loss.loss_gradient(&x, &mut gradient);
            assert_eq!(terms, loss.loss(&x));
            assert!((terms.total() - dot(&r, &r)).abs() <= 1e-12 * terms.total(), "{isa}");
            for (got, want) in gradient.iter().zip(&expected) {
                assert!((got - want).abs() <= 1e-11 * size, "{isa}: {got} {want}");
            }
            let mut matrix = vec![f64::NAN; x.len().pow(2)];
            loss.normal_matrix(&x, &mut matrix);
            let first = x.len() - 2;
            for (i, j) in [(0, 0), (1, 0), (1, 1)] {
                let want = dot(&columns[i], &columns[j]);
                let got = matrix[(first + j) * x.len() + first + i];
                let size = (dot(&columns[i], &columns[i]) * dot(&columns[j], &columns[j])).sqrt();
                assert!((got - want).abs() <= 1e-10 * size, "{isa}, {i} {j}: {got} {want}");
            }
        }
    }
}
