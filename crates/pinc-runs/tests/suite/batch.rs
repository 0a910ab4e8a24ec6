//! Controllers of configs in batches.

use pinc_config::{Experiment, ModelKind, Plants};
use pinc_mpc::Reference;
use pinc_runs::{BatchController, ModelFile};
use std::path::Path;

fn batch(sets: &[&str]) -> Result<BatchController, String> {
    batch_of("configs/van-der-pol/control.toml", sets)
}

fn batch_of(config: &str, sets: &[&str]) -> Result<BatchController, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    let experiment = Experiment::load(&root.join(config), &sets, &Plants::built_in()).unwrap();
    BatchController::new(&experiment, None, Some(ModelKind::RK4), 1, "the test")
        .map_err(|error| error.to_string())
}

/// What only a loop in time can honour is refused, and named.
#[test]
fn what_a_batch_does_not_have_is_refused() {
    for (set, key) in [
        (
            "control.bound_schedule=[{ start_s = 5.0, input_high = { u = 0.5 } }]",
            "control.bound_schedule",
        ),
        ("control.first_plan={ input = [0.1] }", "control.first_plan"),
        (
            "control.uncertainty={ probability = \"worst-case\", boxes = { x1 = 0.01 } }",
            "control.uncertainty",
        ),
    ] {
        let error = batch(&[set]).unwrap_err();
        assert!(error.contains(key) && error.contains("no time"), "{error}");
    }
    for (set, key) in [
        ("control.plant={ van-der-pol = { mu = 1.5 } }", "control.plant"),
        (
            "control.plant_schedule=[{ start_s = 5.0, values = { mu = 1.5 } }]",
            "control.plant_schedule",
        ),
        ("control.loads=[{ start_s = 5.0, end_s = 9.0, inputs = { u = 0.1 } }]", "control.loads"),
    ] {
        let mut batch = batch(&[set]).unwrap();
        let references = vec![Reference::new(vec![0.0; 20], 2).unwrap()];
        let error = batch.loops(&[0.5, 0.1], &references, &[0.0]).unwrap_err().to_string();
        assert!(error.contains(&format!("`{key}`")), "{error}");
    }
}

/// `pinc control` tells the controller what is measured; loops of a batch would keep the first values.
#[test]
fn loops_of_a_batch_refuse_measured_parameters() {
    let sets = ["domain.parameters.mu=[0.5,1.5]", "control.measured_parameters=[\"mu\"]"];
    let mut batch = batch_of("configs/smoke/van-der-pol.toml", &sets).unwrap();
    assert_eq!(batch.parameter_names(), ["mu"]);
    let references = [Reference::new(vec![0.0; 20], 2).unwrap()];
    let error = batch.loops(&[0.5, 0.1], &references, &[0.0]).unwrap_err().to_string();
    assert!(error.contains("`control.measured_parameters`"), "{error}");
}

/// Steps of a batch do not look whether a net leaves its domain.
#[test]
fn a_net_that_must_stay_in_its_domain_is_refused() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let model = root.join("crates/pinc/tests/data/model.safetensors");
    let batch = |policy: &str| {
        let sets = [format!("control.outside_domain={policy}")];
        let config = root.join("configs/smoke/van-der-pol.toml");
        let experiment = Experiment::load(&config, &sets, &Plants::built_in()).unwrap();
        let of = |model, kind| BatchController::new(&experiment, model, kind, 1, "the test");
        let integrator = of(None, Some(ModelKind::RK4)).map(drop);
        [of(Some(ModelFile::At(&model)), None).map(drop), integrator]
    };
    assert!(batch("report").iter().all(Result::is_ok));
    let [net, integrator] = batch("refuse");
    let error = net.unwrap_err().to_string();
    assert!(error.contains("`the test`") && error.contains("control.outside_domain"), "{error}");
    integrator.unwrap();
}

/// The oscillator at rest, whose reference moves after six steps, within the horizon of the one
/// before.
#[test]
fn a_batch_knows_changes_in_advance_with_preview_only() {
    for preview in [false, true] {
        let inputs = |end: f64| {
            let mut batch = batch(&[&format!("control.preview={preview}")]).unwrap();
            let rows = [[0.0; 2].repeat(6), [end, 0.0].repeat(6)].concat();
            let references = [Reference::new(rows, 2).unwrap()];
            batch.loops(&[0.0; 2], &references, &[0.0]).unwrap().remove(0).inputs
        };
        let (resting, moving) = (inputs(0.0), inputs(0.5));
        let first = resting.iter().zip(&moving).position(|(a, b)| (a - b).abs() > 1e-3);
        let first = first.expect("the reference is followed");
        assert_eq!(first < 6, preview, "{first}");
        assert!(first <= 6, "{first}");
    }
}
