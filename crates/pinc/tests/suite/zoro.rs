//! The first plan of the differential drive and the bounds that its tube tightens, against IPOPT's
//! on the same discretization, as `benches/peers/zoro.py` found them.

use crate::common::repository;
use pinc_config::{Experiment, Plants};
use pinc_mpc::SqpStatus;
use pinc_runs::{Follow, LiveController};
use serde::Deserialize;

#[derive(Deserialize)]
struct Answer {
    status: String,
    /// `[N, m]`
    inputs: Vec<f64>,
    /// How far bounds moved, `[N, n]` and `[N, outputs]`.
    states_by: Vec<f64>,
    outputs_by: Vec<f64>,
}

#[test]
fn bounds_of_a_differential_drive_are_tightened_as_by_ipopt_and_numpy() {
    let expected: Answer = serde_json::from_str(include_str!("zoro.json")).unwrap();
    assert_eq!(expected.status, "Solve_Succeeded");
    let path = repository("configs/robust/differential-drive.toml");
    // Until the bounds are those of the plan itself.
    let settled = "control.uncertainty.tightenings=20".to_owned();
    let experiment = Experiment::load(&path, &[settled], &Plants::built_in()).unwrap();
    let mut controller = LiveController::new(&experiment, None, None, "the test").unwrap();
    let start = controller.spec().initial_state.clone();
    let step = controller.step(&start, Follow::Config, None).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    let tightened = controller.nmpc().tightened().unwrap();
    assert!(tightened.fits);
    let found = tightened.back_offs;
    let outputs = found.outputs.chunks_exact(found.outputs.len() / 20);
    let bounded: Vec<f64> = outputs.flat_map(|y| &y[y.len() - 3..]).copied().collect();
    let inputs = controller.nmpc().plan().inputs();
    for (what, found, expected, tolerance) in [
        ("states", &found.states[..], &expected.states_by, 1e-6),
        ("outputs", &bounded, &expected.outputs_by, 1e-6),
        ("inputs", inputs, &expected.inputs, 1e-5),
    ] {
        assert_eq!(found.len(), expected.len(), "{what}");
        let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < tolerance, "{what}: {off}");
    }
    assert!(found.inputs.iter().all(|by| *by == 0.0));
}
