//! Distilled nets, and the charts of accuracy against cost.

use crate::common::{outcome, pinc, repository};
use std::fs;
use std::path::Path;

/// Runs the smallest config with `sets` over its values, in `dir`; returns what it printed.
fn run(dir: &Path, sets: &[&str]) -> String {
    let config = repository("configs/smoke/one-tank.toml");
    let (config, out) = (config.to_str().unwrap(), dir.to_str().unwrap());
    let mut arguments = vec!["run", config, "--out", out];
    for set in sets {
        arguments.extend(["--set", set]);
    }
    let outcome = outcome(&mut pinc(&arguments));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    outcome.stdout
}

/// The cells of a column of a CSV file without quotes.
fn column(path: &Path, name: &str) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    let mut rows = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let place = rows.next().unwrap().iter().position(|head| head == name).unwrap();
    rows.map(|row| row[place].clone()).collect()
}

#[test]
fn a_distilled_net_is_called_so_and_asked_at_step_marks_only() {
    let dir = tempfile::tempdir().unwrap();
    let run_dir = dir.path().join("run");
    let printed = run(&run_dir, &["training.source=integrator"]);
    assert!(printed.contains("\n  distilled "), "{printed}");
    assert!(!printed.contains("\n  pinc "), "{printed}");
    let metrics = fs::read_to_string(run_dir.join("metrics.json")).unwrap();
    assert!(metrics.contains(r#""source": "integrator""#));
    let report = fs::read_to_string(run_dir.join("report.html")).unwrap();
    assert!(report.contains("distilled net") && !report.contains("with PINC"));
    // The loop of the net that was trained.
    let (config, model) = (run_dir.join("config.toml"), run_dir.join("model.safetensors"));
    let (alone, out) = (dir.path().join("alone"), |path: &Path| path.to_str().unwrap().to_owned());
    let arguments = ["control", &out(&config), "--model", &out(&model), "--out", &out(&alone)];
    let printed = outcome(&mut pinc(&arguments)).stdout;
    assert!(printed.contains("\n  distilled ") && !printed.contains("\n  pinc "), "{printed}");
    let report = fs::read_to_string(alone.join("report.html")).unwrap();
    assert!(report.contains("distilled net") && !report.contains("with PINC"));
    // 100 s in steps of 10 s, and the initial state.
    let marks = column(&run_dir.join("prediction.csv"), "mark");
    assert_eq!(marks, ["1"; 11]);

    let predict = |rows: &str| {
        let (inputs, output) = (dir.path().join("in.csv"), dir.path().join("out.csv"));
        fs::write(&inputs, format!("scenario,t,u,h\n{rows}")).unwrap();
        let model = run_dir.join("model.safetensors");
        let paths = [&model, &inputs, &output].map(|path| path.to_str().unwrap());
        let [model, inputs, output] = paths;
        outcome(&mut pinc(&["predict", "--model", model, "--inputs", inputs, "--output", output]))
    };
    let on_marks = predict("a,0,2.5,8\na,10,2.5,\na,20,2.5,\n");
    assert_eq!(on_marks.code, Some(0), "{on_marks:?}");
    let between = predict("a,0,2.5,8\na,5,2.5,\n");
    assert_ne!(between.code, Some(0));
    assert!(
        between.stderr.contains("in.csv:3: column `t`: 5 s")
            && between.stderr.contains("between steps"),
        "{between:?}"
    );
}

#[test]
fn data_and_an_integrator_exclude_one_another() {
    let config = repository("configs/van-der-pol/data.toml");
    let set = ["--set", "training.source=integrator"];
    let outcome = outcome(&mut pinc(&["check", config.to_str().unwrap(), set[0], set[1]]));
    outcome.assert_refused(&["`training.source`", "with [data]"]);
}

/// A net and integrators, one step of each by itself. The config has a loop with the net and one
/// with RK4.
const CASES: &str = r#"sweep.cases=[
    { name = "net", set = { "control.models" = ["pinc"] } },
    { name = "distilled", set = { "control.models" = ["pinc"], "training.source" = "integrator" } },
    { name = "RK4 x1", set = { "control.models" = ["rk4"], "control.rk4_substeps" = 1 } },
    { name = "RK4 x2", set = { "control.models" = ["rk4"], "control.rk4_substeps" = 2 } },
    { name = "RK5 x1", set = { "control.models" = ["rk5"] } },
]"#;

#[test]
fn a_timed_sweep_draws_accuracy_against_cost() {
    let dir = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(repository("configs/smoke/one-tank.toml")).unwrap();
    // A free run would need a net in every trial.
    let (before, after) = text.split_once("[prediction]").unwrap();
    let control = &after[after.find("[control]").unwrap()..];
    let config = dir.path().join("chart.toml");
    fs::write(&config, format!("{before}{control}\n[sweep]\ntimed = true\n")).unwrap();
    let out = dir.path().join("run");
    let (config, run_dir) = (config.to_str().unwrap(), out.to_str().unwrap());
    let sets = ["one_step.points=64", "one_step.measure_s=0.001", CASES]
        .map(|set| ["--set", set])
        .concat();
    let mut arguments = vec!["run", config, "--out", run_dir];
    arguments.extend(sets);
    let outcome = outcome(&mut pinc(&arguments));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");

    assert_eq!(column(&out.join("sweep.csv"), "source"), ["physics", "integrator", "", "", ""]);
    let errors = column(&out.join("sweep.csv"), "rk4_one_step_rms");
    assert_eq!(errors[..2], ["", ""]);
    let [one, two]: [f64; 2] = [errors[2].parse().unwrap(), errors[3].parse().unwrap()];
    // Order 4, and a tank is smooth.
    assert!(one / two > 10.0, "{one} {two}");
    for name in ["rk4_forward_ns", "rk4_forward_jacobian_ns"] {
        let times = column(&out.join("timings.csv"), name);
        assert!(times[2].parse::<f64>().unwrap() > 0.0, "{name}: {times:?}");
    }
    // A model that only one case has.
    for (file, name) in [("sweep.csv", "rk5_one_step_rms"), ("timings.csv", "rk5_step_us")] {
        let cells = column(&out.join(file), name);
        let is_there: Vec<bool> = cells.iter().map(|cell| !cell.is_empty()).collect();
        assert_eq!(is_there, [false, false, false, false, true], "{name}");
    }
    let summary = fs::read_to_string(out.join("summary.csv")).unwrap();
    assert!(summary.contains("RK5 x1,rk5_iae_dense_sum,"), "{summary}");
    // The two nets, and no third for the numerical models.
    assert_eq!(fs::read_dir(out.join("nets")).unwrap().count(), 2);
    for figure in ["accuracy-cost.svg", "loop-cost.svg"] {
        assert!(out.join("figures").join(figure).exists(), "{figure}");
    }
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("distilled net") && report.contains("times faster"));
}
