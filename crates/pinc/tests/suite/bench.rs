//! `pinc bench --quick`: everything is measured, and every figure is a positive number. How large
//! they are is the machine's business.

use crate::common::{outcome, pinc};
use serde_json::Value;
use std::sync::LazyLock;

/// What a quick bench says: it takes long enough for one to be run.
static REPORT: LazyLock<Value> = LazyLock::new(|| quick(&[]));

/// Checks that `row` has these keys, and that all numbers in it, at any depth, are positive and
/// finite (JSON has no other numbers, but null where one was not finite).
#[track_caller]
fn assert_row(row: &Value, keys: &[&str]) {
    for key in keys {
        assert!(row.get(key).is_some(), "no `{key}` in {row}");
    }
    assert_positive(row);
}

#[track_caller]
fn assert_positive(value: &Value) {
    match value {
        Value::Number(number) => assert!(number.as_f64().is_some_and(|v| v > 0.0), "{number}"),
        Value::Array(values) => values.iter().for_each(assert_positive),
        Value::Object(values) => values.values().for_each(assert_positive),
        Value::String(_) | Value::Bool(_) => {}
        Value::Null => panic!("a number that is not finite"),
    }
}

/// The values of `key` in the rows of a list.
fn column<'a>(report: &'a Value, list: &str, key: &str) -> Vec<&'a str> {
    let rows = report[list].as_array().unwrap();
    rows.iter().map(|row| row[key].as_str().unwrap_or_default()).collect()
}

fn quick(arguments: &[&str]) -> Value {
    let result = outcome(&mut pinc(&[&["bench", "--quick", "--json"], arguments].concat()));
    assert_eq!(result.code, Some(0), "{result:?}");
    serde_json::from_str(&result.stdout).unwrap()
}

#[test]
fn a_quick_bench_has_every_figure() {
    let report = &*REPORT;
    assert_row(&report["fma_peak_gflops"], &["f64_1", "f64_all"]);
    for row in report["loss_gradient"].as_array().unwrap() {
        let keys = ["plant", "layers", "points", "precision", "threads", "isa", "ms", "gflops"];
        assert_row(row, &keys);
        assert_row(row, &["fraction_of_peak"]);
    }
    for row in report["model_step"].as_array().unwrap() {
        assert_row(row, &["plant", "model", "forward_ns", "forward_jacobian_ns", "one_step_rms"]);
        let size = if row["model"] == "pinc" { "layers" } else { "substeps" };
        assert_row(row, &[size]);
    }
    for row in report["qp"].as_array().unwrap() {
        assert_row(row, &["plant", "solver", "us"]);
    }
    for row in report["nmpc"].as_array().unwrap() {
        let keys = ["plant", "model", "kkt_tol", "step_us", "sqp_iterations_mean", "qp_solver"];
        assert_row(row, &keys);
        assert_row(&row["step_us"], &["p50", "p99", "max"]);
    }
}

#[test]
fn both_plants_are_measured_with_both_models_and_all_instruction_sets() {
    let report = &*REPORT;
    for list in ["loss_gradient", "model_step", "nmpc"] {
        let plants = column(report, list, "plant");
        assert!(plants.contains(&"van-der-pol") && plants.contains(&"four-tanks"), "{list}");
    }
    let of_text = |row: &&Value| row["as_text"] == true;
    let text = report["model_step"].as_array().unwrap().iter().filter(of_text);
    for plant in ["van-der-pol", "four-tanks"] {
        assert!(text.clone().any(|row| row["plant"] == plant && row["model"] == "rk4"), "{plant}");
    }
    let models = column(report, "nmpc", "model");
    assert_eq!(models, ["pinc", "rk4", "pinc", "rk4"]);
    let measured = column(report, "loss_gradient", "isa");
    for isa in pinc_net::Isa::available() {
        assert!(measured.contains(&isa.to_string().as_str()), "{isa}");
    }
}

#[test]
fn an_evaluation_is_written_for_other_programs() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("evaluation.safetensors");
    let report = quick(&["--loss-gradient-file", path.to_str().unwrap()]);
    assert!(report["nmpc"].as_array().unwrap().is_empty());

    let bytes = std::fs::read(&path).unwrap();
    // It is a model file, with more in it.
    let net = pinc_net::PincNet::from_bytes(&bytes).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let shape = |name: &str| tensors.tensor(name).unwrap().shape().to_vec();
    assert_eq!(shape("points.collocation"), [2000, 4]);
    assert_eq!(shape("points.initial"), [20, 4]);
    assert_eq!(shape("loss.terms"), [2]);
    assert_eq!(shape("loss.gradient"), [net.mlp().parameters().len()]);
}
