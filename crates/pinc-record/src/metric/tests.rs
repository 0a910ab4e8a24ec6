//! The rows against `metrics.json`.

use super::*;
use serde_json::{Value as Json, json};
use std::collections::BTreeSet;

/// A `metrics.json` without the numbers that are metrics.
fn base() -> Json {
    let times = json!({ "mean": 0.0, "sd": 0.0, "runs": 1 });
    let rk4 = json!({ "1": 0.0, "2": 0.0, "4": 0.0 });
    let domain = json!({
        "max_at": { "x": [], "u": [] }, "max_of": "h", "predicted": 0.0, "truth": 0.0,
        "share_off": 0.0, "points": 1, "unsolved": 0, "rk4": rk4
    });
    json!({
        "experiment": "e", "preset": "ours", "variables": {},
        "training": { "source": "integrator", "stop_reason": "done" },
        "validation": { "domain_error": domain },
        "prediction": {},
        "control": [{
            "model": "rk5", "wall_s": times, "step_us": {}, "status": {},
            "offset": { "h": [1e-3, 1e-2, null], "v": [5e-3] }
        }],
        "one_step": [{ "model": "rk5" }]
    })
}

/// The place of a metric below its section.
fn place<'j>(json: &'j mut Json, metric: &Metric) -> &'j mut Json {
    let section = match metric.of {
        Of::Name(_) | Of::Training(_) => &mut json["training"],
        Of::Validation(_) => &mut json["validation"],
        Of::Domain(_) => &mut json["validation"]["domain_error"],
        Of::FreeRun(_) => &mut json["prediction"],
        Of::Loop(_) => &mut json["control"][0],
        Of::OneStep(_) => &mut json["one_step"][0],
    };
    metric.path.split('.').fold(section, |of, key| &mut of[key])
}

fn model_of(metric: &Metric) -> Option<ModelKind> {
    metric.is_of_models().then_some(ModelKind::RK5)
}

/// A run in which all numbers are 1, but for these.
pub(crate) fn run(numbers: &[(&Metric, f64)]) -> Metrics {
    let mut json = base();
    json["control"][0]["model"] = json!("rk4");
    for metric in Metric::all().filter(|of| !of.path.is_empty() && of.unit != Unit::Name) {
        let special = numbers.iter().find(|(other, _)| *other == metric);
        *place(&mut json, metric) = match (special, metric.digits) {
            (Some((_, number)), _) => json!(number),
            (None, 0) => json!(1),
            (None, _) => json!(1.0),
        };
    }
    serde_json::from_value(json).unwrap()
}

/// A whole number for each row, so that counts can be read.
#[test]
fn each_row_has_the_number_at_its_place() {
    let mut json = base();
    let is_stored = |of: &&Metric| !of.path.is_empty() && of.unit != Unit::Name;
    let stored: Vec<_> = (2_u32..).zip(Metric::all().filter(is_stored)).collect();
    for (i, metric) in &stored {
        *place(&mut json, metric) = match metric.digits {
            0 => json!(i),
            _ => json!(f64::from(*i)),
        };
    }
    let run: Metrics = serde_json::from_value(json).unwrap();
    for (i, metric) in stored {
        let value = metric.value(&run, model_of(metric));
        assert_eq!(value, Some(Value::Number(f64::from(i))), "{}", metric.title);
        assert!(metric.value(&run, Some(ModelKind::Pinc)).is_none() || model_of(metric).is_none());
    }
    let Some(Value::Number(mse)) = place_of(&run, "Free run, MSE of all rows") else { panic!() };
    assert_eq!(FREE_RUN_RMSE.value(&run, None), Some(Value::Number(mse.sqrt())));
    assert!((OFFSET_MAX.of_loop(&run.control[0]) - 1e-2).abs() < 1e-15);
    assert!(MSE_GEN.of_loop(&run.control[0]).is_nan());
    let name = |metric: &str| place_of(&run, metric);
    assert_eq!(name("Training, on"), Some(Value::Name("integrator".to_owned())));
    assert_eq!(name("Training, stopped because"), Some(Value::Name("done".to_owned())));
}

fn place_of(run: &Metrics, title: &str) -> Option<Value> {
    Metric::all().find(|metric| metric.title == title)?.value(run, None)
}

/// As they are in metrics.json, so that a table made of files read again is the same.
#[test]
fn numbers_that_are_infinite_are_none() {
    let mut run = run(&[]);
    let of = &mut run.control[0];
    (of.kkt_max, of.iae) = (f64::INFINITY, f64::NEG_INFINITY);
    for column in ["kkt_max", "iae"] {
        let metric = Metric::all().find(|metric| metric.column == column).unwrap();
        let value = metric.value(&run, Some(ModelKind::RK4)).unwrap();
        assert_eq!(metric.cell(value), "NaN");
    }
}

#[test]
fn a_run_without_a_stage_has_none_of_its_metrics() {
    let text = r#"{ "experiment": "e", "preset": "ours", "variables": {} }"#;
    let run: Metrics = serde_json::from_str(text).unwrap();
    assert!(Metric::all().all(|metric| metric.value(&run, model_of(metric)).is_none()));
}

#[test]
fn rows_are_told_apart_by_title_and_column() {
    let titles: BTreeSet<_> = Metric::all().map(|metric| metric.title).collect();
    assert_eq!(titles.len(), Metric::all().count());
    let with_column = || Metric::all().filter(|metric| !metric.column.is_empty());
    let columns: BTreeSet<_> = with_column().map(|metric| metric.column).collect();
    assert_eq!(columns.len(), with_column().count());
    assert!(MSE_GEN != ONE_STEP_MSE && MSE_GEN == MSE_GEN);
}

#[test]
fn tables_have_errors_then_times_then_counts() {
    let names = |stage: &'static [Metric]| {
        Metric::rows(stage).iter().filter_map(|of| of.row).collect::<Vec<_>>()
    };
    let training =
        ["Wall time", "Optimizer alone", "Iterations", "Loss evaluations", "Stopped because"];
    assert_eq!(names(TRAINING), training);
    let loops = names(LOOP);
    let after = |name| loops.iter().position(|row| *row == name).unwrap();
    assert!(after("IAE, dense trace, sum over outputs") < after("Controller, whole run: median"));
    assert!(after("Controller, one step: longest") < after("SQP iterations per step"));
    assert!(after("SQP iterations per step") < after("Largest KKT residual"));
    assert!(!loops.contains(&OFFSET_MAX.title));
}

#[test]
fn times_are_in_seconds_and_cells_round_trip() {
    assert_eq!(WALL.unit.seconds(), Some(1.0));
    assert_eq!(STEP_TIME.unit.seconds(), Some(1e-6));
    assert_eq!(FORWARD.unit.seconds(), Some(1e-9));
    assert_eq!(IAE_DENSE_SUM.unit.seconds(), None);
    assert_eq!(MSE_GEN.cell(Value::Number(0.1 + 0.2)), "0.30000000000000004");
    assert_eq!(WALL.cell(Value::Number(2.0)), "2.0");
    let iterations = Metric::all().find(|metric| metric.column == "iterations").unwrap();
    assert_eq!(iterations.cell(Value::Number(12000.0)), "12000");
}
