//! Training: schedule, determinism, resuming, and what stops it.

use super::trainings::{
    adam, begin, broyden, finish, growth, lbfgs, levenberg_marquardt, small, training, validation,
    validation_of, van_der_pol, van_der_pol_domain,
};
use pinc_ad::Scalar;
use pinc_net::optim::OptimizerConfig;
use pinc_net::{
    Ansatz, Checkpoint, Domain, GrowthConfig, NetConfig, NetError, PincNet, Progress, Sampler,
    Scenario, SelectNet, StopReason, Training, TrainingConfig, ValidationConfig, ValidationSet,
};
use pinc_ode::{Dopri5, Plant, Variable};
use pinc_plants::{OneTank, VanDerPol};

#[test]
fn the_two_phase_schedule_reduces_the_loss_with_every_sampler_and_ansatz() {
    for sampler in [Sampler::Independent, Sampler::CoupledGrid, Sampler::Sobol] {
        for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
            let config = TrainingConfig { sampler, ..training(vec![adam(50), lbfgs(100)]) };
            let mut trainer = van_der_pol(&config, ansatz, 1);
            let (records, reason) = finish(&mut trainer);
            assert_eq!((records.len(), reason), (150, StopReason::IterationsDone));
            assert_eq!((records[49].phase, records[50].phase), (0, 1));
            let (first, last) = (records[0], records[149]);
            assert!(
                last.loss < first.loss / 20.0,
                "{sampler:?} {ansatz:?}: {} {}",
                first.loss,
                last.loss
            );
            assert_eq!(last.loss_data.to_bits() == 0, ansatz == Ansatz::HardLinear);
            let sum = last.loss_data + last.loss_physics;
            assert!((sum - last.loss).abs() <= 1e-15 * last.loss);
        }
    }
}

#[test]
fn levenberg_marquardt_goes_much_further_than_lbfgs_in_as_many_iterations() {
    let last = |phase, ansatz| {
        let config = training(vec![phase]);
        let (records, reason) = finish(&mut van_der_pol(&config, ansatz, 2));
        assert_eq!((records.len(), reason), (40, StopReason::IterationsDone));
        records[39]
    };
    for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
        let (slow, fast) = (last(lbfgs(40), ansatz), last(levenberg_marquardt(40), ansatz));
        assert!(fast.loss < slow.loss / 20.0, "{ansatz:?}: {} {}", fast.loss, slow.loss);
        assert!(fast.loss_evaluations < 100, "{}", fast.loss_evaluations);
    }
}

#[test]
fn the_best_net_on_validation_is_kept() {
    let mut trainer = van_der_pol(&training(vec![adam(40), broyden(60)]), Ansatz::HardLinear, 1);
    let mut best = (f64::INFINITY, Vec::new());
    while let Progress::Iterated(_) = trainer.step().unwrap() {
        if trainer.validation_due() {
            let error = trainer.validate().score();
            if error < best.0 {
                best = (error, trainer.net().to_bytes());
            }
        }
    }
    assert_eq!(trainer.net().to_bytes(), best.1);
}

#[test]
fn the_last_net_is_kept_if_asked_for_and_phases_can_go_back_to_the_best() {
    let mut phases = vec![adam(30), lbfgs(1)];
    phases[0].restore_best = true;
    let config = TrainingConfig { keep: SelectNet::Last, ..training(phases) };
    let mut trainer = van_der_pol(&config, Ansatz::HardLinear, 1);
    let (records, _) = finish(&mut trainer);
    assert_eq!(records.len(), 31);
    let validation = trainer.validate();
    let again = validation_of(&trainer.net());
    assert_eq!(validation.mse_gen.to_bits(), again.mse_gen.to_bits());
}

#[test]
fn the_same_seed_gives_the_same_net_on_one_thread_or_two_and_another_seed_another() {
    let config = TrainingConfig { growth: growth(), ..training(vec![broyden(120)]) };
    let nets: Vec<_> = [1, 2]
        .map(|threads| {
            let mut trainer = van_der_pol(&config, Ansatz::HardLinear, threads);
            finish(&mut trainer);
            trainer.net().to_bytes()
        })
        .into();
    assert_eq!(nets[0], nets[1]);
}

#[test]
fn the_sample_grows_when_the_net_overfits_it() {
    let config =
        TrainingConfig { collocation_points: 64, growth: growth(), ..training(vec![broyden(300)]) };
    let (records, _) = finish(&mut van_der_pol(&config, Ansatz::HardLinear, 1));
    assert!(records.iter().all(|r| r.fresh_loss.is_some() == r.iteration.is_multiple_of(20)));
    let sizes: Vec<_> = records.iter().map(|r| r.collocation_points).collect();
    assert!(sizes.is_sorted() && sizes.last() > Some(&64), "{sizes:?}");
    // Growing does not lose what was learnt: the fresh loss keeps falling.
    let fresh: Vec<_> = records.iter().filter_map(|r| r.fresh_loss).collect();
    assert!(fresh[fresh.len() - 1] < fresh[0] / 10.0, "{fresh:?}");
}

#[test]
fn resuming_gives_the_bits_of_an_uninterrupted_run() {
    let config = TrainingConfig {
        collocation_points: 64,
        growth: growth(),
        ..training(vec![adam(15), lbfgs(30), broyden(70), levenberg_marquardt(25)])
    };
    let mut whole = van_der_pol(&config, Ansatz::Direct, 1);
    let (records, _) = finish(&mut whole);
    for stop in [7, 15, 16, 44, 45, 46, 60, 101, 115, 116, 130, 140] {
        let mut first = van_der_pol(&config, Ansatz::Direct, 2);
        for _ in 0..stop {
            assert!(matches!(first.step().unwrap(), Progress::Iterated(_)));
            if first.validation_due() {
                first.validate();
            }
        }
        let bytes = postcard::to_stdvec(first.checkpoint()).unwrap();
        drop(first);
        let checkpoint: Checkpoint = postcard::from_bytes(&bytes).unwrap();
        let mut second = van_der_pol(&config, Ansatz::Direct, 1).resume(checkpoint).unwrap();
        let (rest, _) = finish(&mut second);
        assert_eq!(rest, records[stop..], "stopped after {stop}");
        assert_eq!(second.net().to_bytes(), whole.net().to_bytes(), "stopped after {stop}");
    }
}

#[test]
fn a_checkpoint_of_another_net_is_refused() {
    let config = training(vec![adam(5)]);
    let trainer = van_der_pol(&config, Ansatz::Direct, 1);
    let mut deeper = small(&config, Ansatz::Direct, 1);
    deeper.net.hidden_layers = 3;
    let deeper = begin(&VanDerPol::default(), &deeper).unwrap();
    let error = deeper.resume(trainer.checkpoint().clone()).unwrap_err();
    assert!(matches!(error, NetError::Checkpoint { .. }), "{error}");
}

#[test]
fn a_loss_that_is_not_finite_stops_with_the_last_good_net() {
    let mut phases = vec![adam(50)];
    if let OptimizerConfig::Adam(config) = &mut phases[0].optimizer {
        config.learning_rate = 1e200;
    }
    let mut trainer = van_der_pol(&training(phases), Ansatz::Direct, 1);
    let error = loop {
        match trainer.step() {
            Ok(Progress::Iterated(_)) => {}
            Ok(other) => panic!("{other:?}"),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, NetError::NotFinite { .. }), "{error}");
    assert!(error.to_string().contains("MSE_"), "{error}");
    assert!(trainer.net().mlp().parameters().iter().all(|w| w.is_finite()));
}

#[test]
fn a_plant_without_value_in_the_domain_is_named() {
    /// x' = sqrt(x), on a domain that reaches below 0.
    #[derive(Clone, Debug)]
    struct Root;
    impl Plant for Root {
        fn states(&self) -> &[Variable] {
            static VARIABLES: [Variable; 1] = [Variable::new("level", "m")];
            &VARIABLES
        }
        fn inputs(&self) -> &[Variable] {
            &[]
        }
        fn rhs<S: Scalar>(&self, x: &[S], _: &[S], _p: &[S], dx: &mut [S]) {
            dx[0] = x[0].sqrt();
        }
    }
    for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
        let training = Training {
            config: training(vec![adam(3)]),
            validation: validation(0.5, &Domain::new([0.1..=1.0], [])),
            ..Training::new(
                NetConfig { ansatz, ..NetConfig::new(0.5, 1, 4) },
                Domain::new([-1.0..=1.0], []),
            )
        };
        let message = match begin(&Root, &training) {
            Err(error) => error.to_string(),
            Ok(mut trainer) => trainer.step().unwrap_err().to_string(),
        };
        let named = if ansatz == Ansatz::HardLinear { "level" } else { "MSE_F" };
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn a_conventional_pinn_learns_its_one_scenario() {
    let plant = OneTank::default();
    let domain = Domain::new([2.0..=20.0], [0.5..=4.45]);
    let scenario = Scenario { initial_state: vec![15.0], input: vec![2.0] };
    for ansatz in [Ansatz::Direct, Ansatz::HardLinear] {
        let time_only = Some(scenario.clone());
        let net = NetConfig { ansatz, time_only, ..NetConfig::new(30.0, 2, 10) };
        let config = training(vec![broyden(200)]);
        let training = Training {
            config: TrainingConfig { collocation_points: 100, ..config },
            validation: ValidationConfig {
                scenarios: 1,
                subintervals: 10,
                one_step_points: 1,
                ..ValidationConfig::new(30.0, domain.clone())
            },
            ..Training::new(net, domain.clone())
        };
        let set = training.validation_set(&plant).unwrap();
        let mut trainer = begin(&plant, &training).unwrap();
        while let Progress::Iterated(_) = trainer.step().unwrap() {}
        let mut truth = scenario.initial_state.clone();
        let mut integrator = Dopri5::new(plant, 1e-12);
        let mut squares = (trainer.net().evaluate(0.0, &[15.0], &[2.0], &[])[0] - 15.0).powi(2);
        for k in 1..=10 {
            integrator.integrate(&mut truth, &scenario.input, 3.0).unwrap();
            let y = trainer.net().evaluate(3.0 * f64::from(k), &[15.0], &[2.0], &[]);
            assert!(
                (y[0] - truth[0]).abs() < 1e-3,
                "{ansatz:?}, t = {}: {} {}",
                3 * k,
                y[0],
                truth[0]
            );
            squares += (y[0] - truth[0]).powi(2);
            if k == 10 {
                // Its validation is of these very rows, in standard deviations of the box: 18 /
                // sqrt 12.
                let found = set.evaluate(&trainer.net());
                let last = (y[0] - truth[0]).powi(2);
                assert!((found.mse_gen - last).abs() <= 1e-6 * last + 1e-20, "{found:?}");
                assert!((found.one_step_mse - last).abs() <= 1e-6 * last + 1e-20, "{found:?}");
                let all = squares / 11.0 / (18.0 * 18.0 / 12.0);
                assert!((found.mse_all_normalized - all).abs() <= 1e-6 * all + 1e-20, "{found:?}");
            }
        }
    }
}

#[test]
fn validation_chains_the_net_as_the_paper_says() {
    // A hand-made chain of a fresh net on a set with one scenario and one row a step.
    let plant = VanDerPol::default();
    let domain = van_der_pol_domain();
    // A box this thin pins the scenario down.
    let thin = |low: f64| low..=low + 1e-12;
    let config = ValidationConfig {
        scenarios: 1,
        subintervals: 1,
        one_step_points: 1,
        ..ValidationConfig::new(1.5, Domain::new([thin(1.0), thin(-0.5)], [thin(0.25)]))
    };
    let net = PincNet::new(&plant, &NetConfig::new(0.5, 1, 5), &domain, 9).unwrap();
    let set = ValidationSet::generate(&plant, 0.5, &config, 0).unwrap();
    assert_eq!(set.rows(), 4);
    let (mut y, mut truth, mut squares) = (vec![1.0, -0.5], vec![1.0, -0.5], 0.0);
    let mut integrator = Dopri5::new(plant, 1e-12);
    for step in 0..3 {
        y = net.evaluate(0.5, &y, &[0.25], &[]);
        integrator.integrate(&mut truth, &[0.25], 0.5).unwrap();
        squares += (y[0] - truth[0]).powi(2) + (y[1] - truth[1]).powi(2);
        if step == 0 {
            let one_step = set.evaluate(&net).one_step_mse;
            assert!((one_step - squares / 2.0).abs() <= 1e-9 * squares);
        }
    }
    assert!((set.evaluate(&net).mse_gen - squares / 6.0).abs() <= 1e-9 * squares);
}

#[test]
fn the_training_ends_at_the_accuracy_wanted() {
    let target = 0.05;
    let config =
        TrainingConfig { target_one_step_rms: Some(target), ..training(vec![broyden(500)]) };
    let mut trainer = van_der_pol(&config, Ansatz::HardLinear, 1);
    let (records, reason) = finish(&mut trainer);
    assert_eq!(reason, StopReason::TargetReached);
    assert!(records.len() < 500 && records.len().is_multiple_of(10), "{}", records.len());
    assert!(validation_of(&trainer.net()).one_step_mse.sqrt() <= target);
}

#[test]
fn settings_that_make_no_sense_are_named() {
    type Spoil = fn(&mut TrainingConfig);
    let bad: [(&str, Spoil); 6] = [
        ("collocation_points", |c| c.collocation_points = 0),
        ("initial_points", |c| c.initial_points = 0),
        ("validation_every", |c| c.validation_every = 0),
        ("phases", |c| c.phases.clear()),
        ("growth.factor", |c| c.growth = growth().map(|g| GrowthConfig { factor: 1, ..g })),
        ("learning_rate", |c| {
            if let OptimizerConfig::Adam(adam) = &mut c.phases[0].optimizer {
                adam.learning_rate = f64::NAN;
            }
        }),
    ];
    for (key, spoil) in bad {
        let mut config = training(vec![adam(1)]);
        spoil(&mut config);
        let message = config.validate().unwrap_err().to_string();
        assert!(message.starts_with(key), "{message}");
    }
}
