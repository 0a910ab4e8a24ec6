//! Nets of a family of plants: parameters as inputs of the net.

use super::model_file::with_header;
use pinc_ad::Scalar;
use pinc_net::{
    Domain, Measurements, NetConfig, NetError, ParameterRange, PincModel, PincNet, Trained,
    Trainer, Training, TrainingConfig, TrainingTarget, ValidationConfig,
};
use pinc_ode::{Dims, Dopri5, Model, Plant, Variable};

/// A pendulum with friction, x'' = -p1 sin x - p2 x' + u, whose parameters vary.
#[derive(Clone, Debug)]
pub(crate) struct Pendulum;

impl Plant for Pendulum {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("q", "rad"), Variable::new("w", "rad/s")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "rad/s^2")];
        &INPUTS
    }

    fn parameters(&self) -> &[Variable] {
        static PARAMETERS: [Variable; 2] =
            [Variable::new("stiffness", "1/s^2"), Variable::new("friction", "1/s")];
        &PARAMETERS
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = x[1];
        dx[1] = u[0] - p[0] * x[0].sin() - p[1] * x[1];
    }
}

/// The parameters in another order than the plant's.
fn domain() -> Domain {
    Domain::new([-1.5..=1.5, -2.0..=2.0], [-1.0..=1.0]).with_parameters([
        ParameterRange::new("friction", 0.1..=0.6),
        ParameterRange::new("stiffness", 0.5..=2.0),
    ])
}

fn trained(source: TrainingTarget) -> Trained {
    let config =
        TrainingConfig { target_one_step_rms: Some(2e-3), source, ..TrainingConfig::recommended() };
    let training = Training { config, ..Training::new(NetConfig::new(0.4, 2, 10), domain()) };
    training.run(&Pendulum).unwrap()
}

/// A parameter outside its range is as far outside the box as a state.
#[test]
fn the_box_has_the_ranges_of_the_parameters() {
    let domain = domain();
    let excess = |x: [f64; 2], u: f64, p: [f64; 2]| -> Vec<f64> {
        domain.excess(&x, &[u], &p).map(|excess| (excess * 1e9).round() / 1e9).collect()
    };
    assert_eq!(excess([0.0, 0.0], 0.0, [0.3, 1.0]), [0.0; 5]);
    assert_eq!(excess([0.0, -2.5], 1.25, [0.7, 0.375]), [0.0, 0.5, 0.25, 0.1, 0.125]);
    assert_eq!(excess([1.75, 0.0], -1.0, [0.05, 2.5]), [0.25, 0.0, 0.0, 0.05, 0.5]);
}

/// One net is right for members of the family that nothing singled out, after one step and after
/// several.
#[test]
fn one_net_serves_the_family() {
    for source in [TrainingTarget::Physics, TrainingTarget::Integrator] {
        let Trained { net, validation, .. } = trained(source);
        assert!(validation.one_step_mse.sqrt() <= 2e-3);
        assert_eq!(net.parameter_names().collect::<Vec<_>>(), ["stiffness", "friction"]);
        let mut model = PincModel::new(&net).unwrap();
        let mut worst: f64 = 0.0;
        for p in [[0.6, 0.5], [1.3, 0.2], [1.9, 0.15]] {
            let (mut x, mut truth) = ([0.8, -0.3], [0.8, -0.3]);
            let mut integrator = Dopri5::new(Pendulum, 1e-10);
            integrator.set_parameters(&p);
            for _ in 0..5 {
                let mut next = [0.0; 2];
                model.step(&x, &[0.4], &p, &mut next);
                x = next;
                integrator.integrate(&mut truth, &[0.4], 0.4).unwrap();
            }
            worst = worst.max((x[0] - truth[0]).abs()).max((x[1] - truth[1]).abs());
        }
        assert!(worst < 0.03, "{worst}");
        // The net of one member is that member, and takes no parameters.
        let (p, member) = ([1.3, 0.2], net.member(&[1.3, 0.2]));
        assert_eq!(member.parameter_names().count(), 0);
        for t in [0.1, 0.4] {
            let both = [
                net.evaluate(t, &[0.8, -0.3], &[0.4], &p),
                member.evaluate(t, &[0.8, -0.3], &[0.4], &[]),
            ];
            assert!(both[0].iter().zip(&both[1]).all(|(a, b)| (a - b).abs() < 1e-14), "{both:?}");
        }
        // Which member it is matters: another one is somewhere else.
        let [one, other] =
            [[0.6, 0.5], [1.9, 0.15]].map(|p| net.evaluate(0.4, &[0.8, -0.3], &[0.4], &p));
        assert!((one[1] - other[1]).abs() > 0.2, "{one:?} {other:?}");
    }
}

#[test]
fn the_file_of_a_family_has_version_2_and_its_parameters() {
    let net = PincNet::new(&Pendulum, &NetConfig::new(0.4, 1, 4), &domain(), 3).unwrap();
    let bytes = net.to_bytes();
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.contains(r#""version":"2""#), "{text}");
    assert_eq!(PincNet::from_bytes(&bytes).unwrap(), net);
    // Version 1 knows no parameters.
    let old = with_header(&bytes, |text| text.replace(r#""version":"2""#, r#""version":"1""#));
    let error = PincNet::from_bytes(&old).unwrap_err().to_string();
    assert!(error.contains("`parameters` are known from version 2 on"), "{error}");
}

#[test]
fn domain_and_plant_agree_on_the_parameters() {
    let config = NetConfig::new(0.4, 1, 4);
    let with = |ranges: &[(&str, f64, f64)]| {
        let ranges = ranges.iter().map(|&(name, low, high)| ParameterRange::new(name, low..=high));
        let domain = Domain { parameters: Vec::new(), ..domain() }.with_parameters(ranges);
        PincNet::new(&Pendulum, &config, &domain, 0).unwrap_err()
    };
    let both = [("stiffness", 0.5, 2.0), ("friction", 0.1, 0.6)];
    for (ranges, expected) in [
        (&both[..1], "`friction` varies in the plant"),
        (&[both[0], both[1], ("mass", 1.0, 2.0)], "`mass` has a range in the domain"),
        (&[both[0], ("friction", 0.6, 0.1)], "friction = [0.6, 0.1]"),
        (&[both[0], ("friction", 0.1, f64::INFINITY)], "friction = [0.1, inf]"),
    ] {
        let error = with(ranges).to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// The scenarios of the validation are of members from all over the family, the same with the same
/// seed.
#[test]
fn validation_goes_over_the_family() {
    let training = Training::new(NetConfig::new(0.4, 1, 4), domain());
    let [one, other] = [
        domain(),
        domain().with_parameters([
            ParameterRange::new("friction", 0.1..=0.1001),
            ParameterRange::new("stiffness", 0.5..=0.5001),
        ]),
    ]
    .map(|domain| {
        let validation =
            ValidationConfig { one_step_points: 64, ..ValidationConfig::new(2.0, domain) };
        let net = PincNet::new(&Pendulum, &training.net, &training.domain, 0).unwrap();
        let training = Training { validation, ..training.clone() };
        let set = training.validation_set(&Pendulum).unwrap();
        assert_eq!(set, training.validation_set(&Pendulum).unwrap());
        set.evaluate(&net)
    });
    assert!((one.mse_gen - other.mse_gen).abs() > 1e-6);
    assert!((one.one_step_mse - other.one_step_mse).abs() > 1e-6);
}

/// A label is the state after T of the member that its point names.
#[test]
fn measurements_keep_their_parameters() {
    let mut measured = Measurements::new(Pendulum.dims());
    measured.push(0.2, &[0.1, 0.2], &[0.3], &[1.0, 0.4], &[Some(0.5), None]);
    assert_eq!(measured.points().parameters(0), [1.0, 0.4]);
}

#[test]
fn a_conventional_pinn_has_no_family() {
    let scenario = pinc_net::Scenario { initial_state: vec![0.5, 0.0], input: vec![0.0] };
    let config = NetConfig { time_only: Some(scenario), ..NetConfig::new(0.4, 1, 4) };
    let error = PincNet::new(&Pendulum, &config, &domain(), 0).unwrap_err();
    assert!(matches!(error, NetError::Setting { key: "time_only", .. }), "{error}");
}

/// Steps of the pendulum with these parameters, from points all over the domain.
fn measured(p: [f64; 2]) -> Measurements {
    let mut measured = Measurements::new(Dims::new(2, 1));
    for k in 0..60_u32 {
        let part = |n: u32| f64::from(k * n % 61) / 60.0;
        let (y0, u) = ([3.0 * part(7) - 1.5, 4.0 * part(17) - 2.0], [2.0 * part(29) - 1.0]);
        let mut x = y0;
        let mut integrator = Dopri5::new(Pendulum, 1e-10);
        integrator.set_parameters(&p);
        integrator.integrate(&mut x, &u, 0.4).unwrap();
        measured.push(0.4, &y0, &u, &[], &x.map(Some));
    }
    measured
}

/// A member of the family whose parameters do not vary: what an inverse problem has at one of its
/// points.
#[derive(Clone, Debug)]
pub(crate) struct Member(pub(crate) [f64; 2]);

impl Plant for Member {
    fn states(&self) -> &[Variable] {
        Plant::states(&Pendulum)
    }

    fn inputs(&self) -> &[Variable] {
        Plant::inputs(&Pendulum)
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _: &[S], dx: &mut [S]) {
        Pendulum.rhs(x, u, &self.0.map(|p| x[0].constant(p)), dx);
    }
}

/// Net and parameters are found in one training, from a start that is far off; and a training that
/// is resumed finds the same bits.
#[test]
fn unknown_parameters_are_trained_with_the_net() {
    let (truth, start) = ([1.3, 0.2], [0.4, 0.7]);
    let domain = Domain { parameters: Vec::new(), ..domain() };
    let mut config = TrainingConfig::recommended();
    config.phases[0].iterations = 400;
    let training = Training { config, ..Training::new(NetConfig::new(0.4, 2, 12), domain) };
    let plant = Member(start);
    let trainer = || {
        let validation = training.validation_set(&plant).unwrap();
        let trainer = Trainer::new(&plant, &training, validation).unwrap();
        let trainer = trainer.with_unknown(&Pendulum, &start).unwrap();
        trainer.with_measurements(&measured(truth), 1.0).unwrap()
    };
    let mut whole = trainer();
    assert_eq!(whole.estimates(), start);
    for _ in 0..150 {
        whole.step().unwrap();
    }
    let mut resumed = trainer().resume(whole.checkpoint().clone()).unwrap();
    whole.run().unwrap();
    resumed.run().unwrap();
    assert_eq!(whole.estimates(), resumed.estimates());
    assert_eq!(whole.net(), resumed.net());
    let found = whole.estimates();
    assert!(
        found.iter().zip(truth).all(|(found, truth)| (found - truth).abs() < 2e-3),
        "{found:?}"
    );
    // It is the net of the plant that was found.
    let set = training.test_set(&Member(truth)).unwrap();
    let error = set.evaluate(&whole.net()).one_step_mse.sqrt();
    assert!(error < 3e-3, "{error}");
}

#[test]
fn unknown_parameters_that_do_not_fit_are_refused() {
    let flat = Domain { parameters: Vec::new(), ..domain() };
    let member = Training::new(NetConfig::new(0.4, 1, 4), flat);
    let fresh = || {
        let validation = member.validation_set(&Member([1.0, 0.2])).unwrap();
        Trainer::new(&Member([1.0, 0.2]), &member, validation).unwrap()
    };
    let family = Training::new(NetConfig::new(0.4, 1, 4), domain());
    let of_family =
        Trainer::new(&Pendulum, &family, family.validation_set(&Pendulum).unwrap()).unwrap();
    for (refused, expected) in [
        (fresh().with_unknown(&Pendulum, &[1.0]), "unknown parameter"),
        (fresh().with_unknown(&Pendulum, &[1.0, f64::NAN]), "NaN"),
        (of_family.with_unknown(&Pendulum, &[1.0, 0.2]), "none for a net that takes parameters"),
    ] {
        let error = refused.unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
