//! Measurements in the loss: how trajectories are cut, and what a training makes of them.

use pinc_net::optim::{
    AdamConfig, LbfgsConfig, LevenbergMarquardtConfig, OptimizerConfig, SelfScaledBroydenConfig,
};
use pinc_net::{
    Domain, Measurements, NetConfig, NetError, Phase, Progress, Recorded, SelectNet, Trainer,
    Training, TrainingConfig, ValidationConfig,
};
use pinc_ode::Dopri5;
use pinc_plants::VanDerPol;

const T: f64 = 0.5;

fn row(t: f64, u: f64, state: [Option<f64>; 2]) -> Recorded {
    Recorded { t, input: vec![u], state: state.to_vec() }
}

#[test]
fn a_trajectory_is_cut_where_a_step_can_begin_and_must_end() {
    let rows = [
        row(0.0, 0.1, [Some(1.0), Some(2.0)]),
        row(0.2, 0.1, [Some(3.0), None]),
        row(0.4, 0.3, [Some(4.0), Some(5.0)]),
        row(0.6, 0.3, [None, None]),
        row(0.9, 0.3, [None, Some(6.0)]),
        row(1.4, 0.3, [Some(7.0), Some(8.0)]),
    ];
    let mut measured = Measurements::new(pinc_ode::Dims::new(2, 1));
    measured.push_trajectory(T, &[], &rows);
    // From t = 0: the rows at 0.2 and 0.4, where the input changes. From 0.4: not the empty row,
    // but that at 0.9 = 0.4 + T. No other row has all states and another within T.
    let found: Vec<_> = (0..measured.len())
        .map(|k| {
            let points = measured.points();
            (points.time(k), points.state(k)[0], points.input(k)[0], measured.state(k).to_vec())
        })
        .collect();
    assert_eq!(
        found,
        [
            (0.2, 1.0, 0.1, vec![Some(3.0), None]),
            (0.4, 1.0, 0.1, vec![Some(4.0), Some(5.0)]),
            (0.5, 4.0, 0.3, vec![None, Some(6.0)]),
        ]
    );
    assert_eq!((measured.len(), measured.values()), (3, 4));
}

/// Doubles have Unix times to 2.4e-7 s: the end of a step belongs to it all the same.
#[test]
fn a_trajectory_may_have_unix_times() {
    let times = (0..10).map(|k| 1.7e9 + 0.1 * f64::from(k));
    let rows: Vec<_> = times.map(|t| row(t, 0.1, [Some(1.0), Some(2.0)])).collect();
    let mut measured = Measurements::new(pinc_ode::Dims::new(2, 1));
    measured.push_trajectory(0.1, &[], &rows);
    assert_eq!(measured.len(), 9);
}

fn domain() -> Domain {
    Domain::new(vec![-2.0..=2.0; 2], [-1.0..=1.0])
}

/// One step of the plant with mu = 1 from points of a grid; of every other point only one state.
fn measured() -> Measurements {
    let mut plant = Dopri5::new(VanDerPol { mu: 1.0 }, 1e-10);
    let mut measured = Measurements::new(pinc_ode::Dims::new(2, 1));
    for i in 0..5 {
        for j in 0..5 {
            for (k, t) in [0.25, 0.5].into_iter().enumerate() {
                let y0 = [f64::from(i) - 2.0, f64::from(j) - 2.0];
                let u = [f64::from((i + j) % 3) - 1.0];
                let mut y = y0;
                plant.integrate(&mut y, &u, t).unwrap();
                let partly = k == 0;
                measured.push(t, &y0, &u, &[], &[(!partly).then_some(y[0]), Some(y[1])]);
            }
        }
    }
    measured
}

fn phase(optimizer: OptimizerConfig, iterations: u64) -> Vec<Phase> {
    vec![Phase::new(optimizer, iterations)]
}

/// A training on the equation with a wrong mu, with the measurements held out.
fn trainer(phases: Vec<Phase>, keep: SelectNet, threads: usize) -> Trainer {
    let plant = VanDerPol { mu: 0.5 };
    let training = Training {
        config: TrainingConfig {
            collocation_points: 128,
            phases,
            growth: None,
            validation_every: 50,
            keep,
            ..TrainingConfig::recommended()
        },
        validation: ValidationConfig {
            scenarios: 1,
            subintervals: 1,
            tolerance: 1e-8,
            one_step_points: 8,
            ..ValidationConfig::new(2.0 * T, domain())
        },
        threads,
        ..Training::new(NetConfig::new(T, 2, 8), domain())
    };
    let validation = training.validation_set(&plant).unwrap().with_measurements(measured());
    Trainer::new(&plant, &training, validation).unwrap()
}

/// The error against the measurements at the end, and loss and its term of the measurements at the
/// start and the end.
fn run(mut trainer: Trainer) -> (f64, Vec<(f64, f64)>) {
    let mut losses = Vec::new();
    while let Progress::Iterated(record) = trainer.step().unwrap() {
        let sum = record.loss_data + record.loss_physics + record.loss_measured;
        assert!((sum - record.loss).abs() <= 1e-15 * record.loss, "{record:?}");
        losses.push((record.loss, record.loss_measured));
        if trainer.validation_due() {
            trainer.validate();
        }
    }
    let error = trainer.validate().measured_mse.unwrap();
    (error, losses)
}

fn broyden() -> OptimizerConfig {
    SelfScaledBroydenConfig::default().into()
}

#[test]
fn measurements_pull_a_net_of_a_wrong_equation_to_the_plant() {
    let phases = || phase(broyden(), 200);
    let physics = run(trainer(phases(), SelectNet::Last, 1)).0;
    let both = trainer(phases(), SelectNet::Last, 1).with_measurements(&measured(), 100.0).unwrap();
    let both = run(both).0;
    // The equations differ by up to half a unit of velocity over half a second, a tenth of the box;
    // with measurements a hundred times as heavy as the equation little of that is left.
    assert!(physics > 1e-3, "{physics}");
    assert!(both < 0.1 * physics, "{both} against {physics}");
}

#[test]
fn every_optimizer_fits_them_in_the_same_bits_on_any_number_of_threads() {
    for optimizer in [
        AdamConfig::new(1e-2).into(),
        LbfgsConfig::default().into(),
        broyden(),
        LevenbergMarquardtConfig::default().into(),
    ] {
        let on = |threads| {
            let trainer = trainer(phase(optimizer.clone(), 30), SelectNet::Last, threads);
            run(trainer.with_measurements(&measured(), 10.0).unwrap())
        };
        let (error, losses) = on(1);
        let (first, last) = (losses[0], losses[losses.len() - 1]);
        assert!(last.0 < 0.5 * first.0 && last.1 < first.1, "{optimizer:?}: {first:?} {last:?}");
        let (again, same) = on(2);
        assert_eq!(error.to_bits(), again.to_bits(), "{optimizer:?}");
        assert_eq!(losses, same, "{optimizer:?}");
    }
}

#[test]
fn held_out_measurements_choose_the_best_net() {
    // Physics alone moves away from the plant again after it has come near: the best is not the
    // last.
    let mut trainer = trainer(phase(broyden(), 150), SelectNet::Best, 1);
    let mut best = f64::INFINITY;
    while let Progress::Iterated(_) = trainer.step().unwrap() {
        if trainer.validation_due() {
            let validation = trainer.validate();
            assert_eq!(validation.score().to_bits(), validation.measured_mse.unwrap().to_bits());
            best = best.min(validation.score());
        }
    }
    let kept = trainer.net();
    let measured = measured();
    // Recomputed by hand: squares of errors in standard deviations of the box, 4 / sqrt(12) wide.
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..measured.len() {
        let points = measured.points();
        let y = kept.evaluate(points.time(k), points.state(k), points.input(k), &[]);
        for (y, measured) in y.iter().zip(measured.state(k)) {
            if let Some(measured) = measured {
                sum += (y - measured).powi(2) * 12.0 / 16.0;
                count += 1.0;
            }
        }
    }
    assert!((sum / count - best).abs() < 1e-12 * best, "{} {best}", sum / count);
}

#[test]
fn without_a_value_or_a_weight_they_are_refused() {
    let refused = |measured: &Measurements, weight: f64| {
        let trainer = trainer(phase(broyden(), 1), SelectNet::Last, 1);
        trainer.with_measurements(measured, weight).map(|_| ()).unwrap_err()
    };
    let mut nothing = Measurements::new(pinc_ode::Dims::new(2, 1));
    nothing.push(0.1, &[0.0, 0.0], &[0.0], &[], &[None, None]);
    for (measured, weight, expected) in [
        (&nothing, 1.0, "data"),
        (&measured(), 0.0, "data.weight"),
        (&measured(), f64::NAN, "data.weight"),
    ] {
        match refused(measured, weight) {
            NetError::Setting { key, .. } => assert_eq!(key, expected),
            other => panic!("{other}"),
        }
    }
}
