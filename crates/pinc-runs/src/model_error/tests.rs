use super::*;
use pinc_config::{Experiment, Plants};
use pinc_net::PincModel;
use pinc_ode::{Model, Simulator};
use std::path::Path;

#[test]
fn a_step_is_beyond_its_tolerance_if_one_state_is() {
    let tolerance = vec![0.1, f64::INFINITY, 1.0];
    let mut log = ErrorLog { tolerance, largest: vec![0.0; 3], ..ErrorLog::default() };
    let mut is_within = |last: [f64; 3]| {
        log.last = last.to_vec();
        log.add()
    };
    assert!(is_within([0.05, 50.0, -1.0]));
    assert!(!is_within([-0.2, 0.0, 0.0]));
    assert!(!is_within([0.0, 0.0, 1.5]));
    assert!(!is_within([0.0, 0.0, f64::NAN]));
    let metrics = log.metrics(&["a", "b", "c"].map(str::to_owned));
    assert_eq!((metrics.steps, metrics.beyond), (4, 3));
    let named = |values: [f64; 2]| ["a", "c"].map(str::to_owned).into_iter().zip(values);
    assert!(metrics.largest.into_iter().eq(named([0.2, f64::INFINITY])));
    assert!(metrics.tolerance.into_iter().eq(named([0.1, 1.0])));
}

/// The corrections take the estimated error off the net's step: what is left is smaller.
#[test]
fn corrections_bring_a_step_nearer_to_the_plants() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let sets = ["control.error_tolerance={ x1 = 1e-9 }", "control.on_error=correct"];
    let config = root.join("configs/smoke/van-der-pol.toml");
    let experiment =
        Experiment::load(&config, &sets.map(str::to_owned), &Plants::built_in()).unwrap();
    let net = crate::read_model(&root.join("crates/pinc/tests/data/model.safetensors")).unwrap();
    let plant = experiment.plant.dyn_plant();
    let spec = experiment.control.as_ref().unwrap();
    let (mut judge, _) = ErrorJudge::new(spec, &net, &*plant, None).unwrap();
    let (x, u) = ([0.5, -0.4], [0.3]);
    assert!(!judge.trusts(&x, &u, &[]));
    let mut corrections = [0.0; 2];
    judge.substitute_parameters(&[], &mut corrections);
    let (mut next, mut exact) = ([0.0; 2], x);
    PincModel::new(&net).unwrap().step(&x, &u, &[], &mut next);
    Simulator::new(&*plant, 1e-10).integrate(&mut exact, &u, net.sample_time_s()).unwrap();
    let (mut all, mut left) = (0.0, 0.0);
    for ((next, exact), correction) in next.iter().zip(exact).zip(corrections) {
        let error: f64 = next - exact;
        all += error.powi(2);
        left += (error + correction).powi(2);
    }
    assert!(left < 0.2 * all, "{left} of {all}");
}
