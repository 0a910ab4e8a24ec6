//! Controllers of configs in batches.

use pinc_config::{Experiment, ModelKind, Plants};
use pinc_mpc::Reference;
use pinc_runs::BatchController;
use std::path::Path;

fn batch(sets: &[&str]) -> Result<BatchController, String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    let config = root.join("configs/van-der-pol/control.toml");
    let experiment = Experiment::load(&config, &sets, &Plants::built_in()).unwrap();
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
