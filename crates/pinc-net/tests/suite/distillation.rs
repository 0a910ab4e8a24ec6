//! Nets distilled from an accurate integrator.

use super::trainings::{
    adam, begin, broyden, finish, growth, levenberg_marquardt, small, training, validation_of,
    van_der_pol, van_der_pol_domain,
};
use pinc_ad::Scalar;
use pinc_net::{
    Ansatz, BatchLoss, Domain, InitialScale, LossWeights, Measurements, NetConfig, NetError,
    PincModel, PincNet, ResidualScale, Sampler, Trainer, TrainingConfig, TrainingTarget,
    Validation, Workers,
};
use pinc_ode::{
    BlackBox, Flow, LinearizationBuffer, Model, OdeError, Plant, Rk4, Stages, Tangent, Variable,
};
use pinc_plants::VanDerPol;
use std::sync::Arc;

/// With derivatives.
fn with_derivatives(training: &TrainingConfig, threads: usize) -> Result<Trainer, NetError> {
    let config = TrainingConfig { derivatives: Some(0.1), ..training.clone() };
    distilled(&config, Ansatz::HardLinear, threads)
}

fn distilled(
    training: &TrainingConfig,
    ansatz: Ansatz,
    threads: usize,
) -> Result<Trainer, NetError> {
    let config = TrainingConfig { source: TrainingTarget::Integrator, ..training.clone() };
    begin(&VanDerPol::default(), &small(&config, ansatz, threads))
}

#[test]
fn a_distilled_net_learns_the_integrators_steps_and_says_so_in_its_file() {
    let config = TrainingConfig { growth: growth(), ..training(vec![broyden(300)]) };
    let nets = [1, 2].map(|threads| {
        let mut trainer = distilled(&config, Ansatz::HardLinear, threads).unwrap();
        let (records, _) = finish(&mut trainer);
        let last = records[299];
        // One term alone: neither the equation nor the initial condition is asked for.
        assert_eq!(last.loss.to_bits(), last.loss_measured.to_bits());
        assert!(last.loss < records[0].loss / 1e4, "{} {}", records[0].loss, last.loss);
        assert!(last.collocation_points > 256);
        assert!(trainer.validate().one_step_mse < 1e-4);
        trainer.net()
    });
    assert_eq!(nets[0].to_bytes(), nets[1].to_bytes());
    let read = PincNet::from_bytes(&nets[0].to_bytes()).unwrap();
    assert_eq!(read.source(), TrainingTarget::Integrator);
    // Nothing is asked between the steps, where the net is wrong.
    let Validation { mse_gen, mse_all_normalized, .. } = validation_of(&read);
    assert!(mse_all_normalized < mse_gen, "{mse_all_normalized} {mse_gen}");
    let physics = van_der_pol(&config, Ansatz::HardLinear, 1).net();
    assert!(!String::from_utf8_lossy(&physics.to_bytes()).contains("source"));
}

#[test]
fn what_cannot_be_distilled_is_refused() {
    let config = training(vec![adam(5)]);
    let error = |result: Result<Trainer, NetError>| result.map(|_| ()).unwrap_err().to_string();
    let soft = error(distilled(&config, Ansatz::Direct, 1));
    assert!(soft.starts_with("source: integrator given"), "{soft}");
    let grid = TrainingConfig { sampler: Sampler::CoupledGrid, ..config.clone() };
    let grid = error(distilled(&grid, Ansatz::HardLinear, 1));
    assert!(grid.starts_with("sampler: coupled-grid given"), "{grid}");
    let mut data = Measurements::new(pinc_ode::Dims::new(2, 1));
    data.push(0.1, &[0.0; 2], &[0.0], &[], &[Some(0.1), None]);
    let both = distilled(&config, Ansatz::HardLinear, 1).unwrap().with_measurements(&data, 1.0);
    assert!(error(both).starts_with("source: integrator given"));
}

#[test]
fn derivatives_make_values_and_jacobians_better_on_any_number_of_threads() {
    let config = TrainingConfig { collocation_points: 128, ..training(vec![broyden(400)]) };
    let nets = [1, 2].map(|threads| {
        let mut trainer = with_derivatives(&config, threads).unwrap();
        let (records, _) = finish(&mut trainer);
        let last = records[399];
        assert_eq!(last.loss.to_bits(), last.loss_measured.to_bits());
        trainer.net()
    });
    assert_eq!(nets[0].to_bytes(), nets[1].to_bytes());
    let mut without = distilled(&config, Ansatz::HardLinear, 1).unwrap();
    finish(&mut without);
    let (with, without) = (errors(&nets[0]), errors(&without.net()));
    assert!(with[0] < without[0] && with[1] < without[1] / 1.5, "{with:?} {without:?}");
}

/// The errors of one step and of its Jacobian, root mean square, over the domain.
fn errors(net: &PincNet) -> [f64; 2] {
    let (mut model, mut truth) =
        (PincModel::new(net).unwrap(), Rk4::new(VanDerPol::default(), 0.5, 32));
    let points = Sampler::Sobol.collocation(512, 0.5, &van_der_pol_domain(), 1, 99);
    let mut sums = [0.0; 2];
    for k in 0..points.len() {
        let at = Stages { x: points.state(k), u: points.input(k), p: &[] };
        let [net, truth]: [LinearizationBuffer; 2] = [&mut model as &mut dyn Model, &mut truth]
            .map(|model| {
                let mut out = LinearizationBuffer::new(model.dims(), 1);
                model.linearize(at, out.as_mut());
                out
            });
        let squares =
            |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum() };
        sums[0] += squares(&net.next, &truth.next);
        sums[1] += squares(&net.a, &truth.a) + squares(&net.b, &truth.b);
    }
    sums.map(|sum| (sum / 512.0).sqrt())
}

/// The gradient of the loss, slopes included, against differences of the loss, for plants whose
/// states, inputs and times are in units of any size.
#[test]
fn the_gradient_matches_differences_in_all_units() {
    for scale in [1e-6, 1e-3, 1.0, 1e3, 1e6] {
        let domain = Domain::new(vec![-3.0 * scale..=3.0 * scale; 2], [-scale..=scale]);
        let plant = Scaled { scale };
        let net = PincNet::new(&plant, &NetConfig::new(0.5, 2, 8), &domain, 3).unwrap();
        let (kind, initial) = (ResidualScale::Normalized, InitialScale::Normalized);
        let weights = LossWeights::new(&net, 1.0, &kind, initial).unwrap();
        let weights = LossWeights { derivatives: 0.1, ..weights };
        let points = Sampler::Sobol.collocation(37, 0.5, &domain, 1, 5);
        let mut measured = Measurements::new(net.dims());
        let mut tangent = Tangent::new(&plant, 1e-12).unwrap();
        for k in 0..points.len() {
            let (mut end, mut slope) = (points.state(k).to_vec(), vec![0.0; 2]);
            let along = [0.5 * scale, -scale, 0.7 * scale];
            let u = points.input(k);
            tangent.integrate(&mut end, (u, &[]), (&along, &mut slope), 0.5).unwrap();
            let known: Vec<_> = end.into_iter().map(Some).collect();
            measured.push(0.5, points.state(k), u, &[], &known);
            measured.push_slope(&along, &slope);
        }
        let mut loss = BatchLoss::new(&plant, &net, &weights, &Workers::new(1).unwrap());
        loss.set_measurements(&measured, 1.0);
        let mut at = net.mlp().parameters().to_vec();
        let mut gradient = vec![0.0; at.len()];
        let terms = loss.loss_gradient(&at, &mut gradient);
        assert!(terms.measured > 1e-4 && terms.measured < 1e2, "{scale}: {terms:?}");
        let size = gradient.iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        for i in 0..at.len() {
            let middle = at[i];
            let ends = [1e-5, -1e-5].map(|by| {
                at[i] = middle + by;
                loss.loss(&at).total()
            });
            at[i] = middle;
            let difference = (ends[0] - ends[1]) / 2e-5;
            assert!((difference - gradient[i]).abs() <= 1e-7 * size, "{scale}, {i}");
        }
    }
}

/// The oscillator with states and input in other units.
#[derive(Clone, Debug)]
struct Scaled {
    scale: f64,
}

impl Plant for Scaled {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("x1", ""), Variable::new("x2", "")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "")];
        &INPUTS
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        let of = |v: S| v * (1.0 / self.scale);
        VanDerPol::default().rhs(&[of(x[0]), of(x[1])], &[of(u[0])], p, dx);
        dx.iter_mut().for_each(|dx| *dx = *dx * self.scale);
    }
}

#[test]
fn derivatives_are_refused_where_there_are_none() {
    let config = training(vec![adam(5)]);
    let error = |result: Result<Trainer, NetError>| result.map(|_| ()).unwrap_err().to_string();
    for (weight, source, found) in [
        (0.1, TrainingTarget::Physics, "derivatives: 0.1 given, expected no such key"),
        (-1.0, TrainingTarget::Integrator, "derivatives: -1 given, expected a positive number"),
        (f64::NAN, TrainingTarget::Integrator, "derivatives: NaN given"),
        (f64::INFINITY, TrainingTarget::Integrator, "derivatives: inf given"),
    ] {
        let config = TrainingConfig { source, derivatives: Some(weight), ..config.clone() };
        let plant = VanDerPol::default();
        let got = error(begin(&plant, &small(&config, Ansatz::HardLinear, 1)));
        assert!(got.starts_with(found), "{got}");
    }
    let plant = BlackBox {
        states: Plant::states(&VanDerPol::default()).to_vec(),
        inputs: Plant::inputs(&VanDerPol::default()).to_vec(),
        outputs: Vec::new(),
        difference_steps: vec![1e-6; 3],
        flow: Arc::new(Unmoved),
    };
    let source = TrainingTarget::Integrator;
    let config = TrainingConfig { source, derivatives: Some(0.1), ..config };
    let got = error(begin(&plant, &small(&config, Ansatz::HardLinear, 1)));
    assert!(got.starts_with("derivatives: a weight given, expected none"), "{got}");
}

/// A flow that has no derivatives.
#[derive(Debug)]
struct Unmoved;

impl Flow for Unmoved {
    fn advance(&self, _: &mut [f64], _: &[f64], _: f64) -> Result<(), OdeError> {
        Ok(())
    }
}

#[test]
fn derivatives_go_with_levenberg_and_marquardt() {
    let config = training(vec![levenberg_marquardt(30)]);
    let mut trainer = with_derivatives(&config, 1).unwrap();
    let (records, _) = finish(&mut trainer);
    let (first, last) = (records[0].loss, records.last().unwrap().loss);
    assert!(last < first / 100.0, "{first} {last}");
}

#[test]
fn a_distilled_training_resumes_from_its_checkpoint() {
    let without = |config: &TrainingConfig, threads| distilled(config, Ansatz::HardLinear, threads);
    goes_on(&without);
    goes_on(&with_derivatives);
}

fn goes_on(distilled: &dyn Fn(&TrainingConfig, usize) -> Result<Trainer, NetError>) {
    let config =
        TrainingConfig { collocation_points: 64, growth: growth(), ..training(vec![broyden(120)]) };
    let mut whole = distilled(&config, 1).unwrap();
    let (records, _) = finish(&mut whole);
    assert!(records[119].collocation_points > 64);
    let mut first = distilled(&config, 1).unwrap();
    for _ in 0..80 {
        first.step().unwrap();
        if first.validation_due() {
            first.validate();
        }
    }
    let checkpoint = first.checkpoint().clone();
    let mut second = distilled(&config, 2).unwrap().resume(checkpoint).unwrap();
    assert_eq!(finish(&mut second).0, records[80..]);
}
