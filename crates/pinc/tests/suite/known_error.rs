//! A net that knows its error: estimates beside predictions, the guard of a loop, and proofs.

use crate::closed::Closed;
use crate::common::{Outcome, outcome, pinc, smoke};
use crate::ways::{Exported, Served, assert_same, compile};
use pinc::ode::Dopri5;
use pinc::plants::VanDerPol;
use pinc_config::{Experiment, ModelKind};
use serde_json::{Value, json};
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;

/// Trains the smoke config's net for `iterations` and returns its file.
fn train(dir: &Path, config: &str, iterations: u32, sets: &[&str]) -> Outcome {
    fs::write(dir.join("experiment.toml"), config).unwrap();
    let iterations = format!("training.phases.0.iterations={iterations}");
    let mut command = pinc(&["train", "experiment.toml", "--out", "run", "--set", &iterations]);
    outcome(command.args(sets.iter().flat_map(|set| ["--set", set])).current_dir(dir))
}

/// The smoke config with a net for a small domain, where even that is good.
fn small() -> String {
    let low = smoke().replacen("state_low = [-3.0, -4.35]", "state_low = [-1.0, -1.0]", 1);
    low.replacen("state_high = [3.0, 4.35]", "state_high = [1.0, 1.0]", 1)
}

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// The estimated error of each row beside the true one, along a chain with a step that is cut short.
#[test]
fn predictions_come_with_their_estimated_errors() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(train(dir.path(), &small(), 300, &[]).code, Some(0));
    let inputs = "scenario,t,u,x1,x2\na,0,0.3,0.5,-0.4\na,0.5,0.3,,\na,0.7,-0.6,,\na,1.2,-0.6,,\n";
    fs::write(dir.path().join("in.csv"), inputs).unwrap();
    let files = ["--inputs", "in.csv", "--output", "out.csv", "--errors"];
    let predict = |more: &[&str]| {
        let model = ["predict", "--model", "run/model.safetensors"];
        outcome(pinc(&[&model[..], &files, more].concat()).current_dir(dir.path()))
    };
    assert_eq!(predict(&[]).code, Some(0));
    let text = fs::read_to_string(dir.path().join("out.csv")).unwrap();
    assert!(text.starts_with("scenario,t,u,x1,x2,x1_err,x2_err\n"), "{text}");
    let row = |line: &str| -> Vec<f64> {
        line.split(',').skip(1).map(|cell| cell.parse().unwrap()).collect()
    };
    let rows: Vec<Vec<f64>> = text.lines().skip(1).map(row).collect();
    let (mut truth, mut x) = (Dopri5::new(VanDerPol::default(), 1e-12), [0.5, -0.4]);
    assert_eq!(rows[0][4..], [0.0, 0.0]);
    for pair in rows.windows(2) {
        truth.integrate(&mut x, &pair[0][1..2], pair[1][0] - pair[0][0]).unwrap();
        let exact = [pair[1][2] - x[0], pair[1][3] - x[1]];
        let size = exact[0].hypot(exact[1]);
        assert!(size > 1e-5, "{exact:?}");
        for (found, exact) in pair[1][4..].iter().zip(exact) {
            assert!((found - exact).abs() < 0.05 * size, "{pair:?} {exact}");
        }
    }
    // The config is that beside the model, or another.
    fs::rename(dir.path().join("run/config.toml"), dir.path().join("other.toml")).unwrap();
    predict(&[]).assert_refused(&["config.toml"]);
    assert_eq!(predict(&["--config", "other.toml"]).code, Some(0));
}

/// A loop that begins where the net has not been trained: with the integrator's help it is the
/// integrator's own.
#[test]
fn a_loop_is_guarded_by_the_estimated_error() {
    let dir = tempfile::tempdir().unwrap();
    let config = small().replacen("state_high = [1.0, 1.0]", "state_high = [0.3, 1.0]", 1);
    assert_eq!(train(dir.path(), &config, 300, &[]).code, Some(0));
    let control = |on_error: &str| {
        let on_error = format!("control.on_error=\"{on_error}\"");
        let sets = [
            "control.models=[\"pinc\", \"rk4\"]",
            "control.error_tolerance={ x1 = 1e-5, x2 = 1e-5 }",
            &on_error,
            "control.max_failed_share=1.0",
        ];
        let mut command = pinc(&["control", "experiment.toml", "--out", "loop"]);
        command.args(["--model", "run/model.safetensors"]);
        command.args(sets.iter().flat_map(|set| ["--set", set])).current_dir(dir.path());
        let done = outcome(&mut command);
        assert_eq!(done.code, Some(0), "{done:?}");
        assert!(done.stdout.contains("estimated error beyond control.error_tolerance in "));
        let loops = json_of(&dir.path().join("loop/metrics.json"))["control"].clone();
        check_errors_along_the_loop(dir.path());
        fs::remove_dir_all(dir.path().join("loop")).unwrap();
        loops
    };
    let iae = |loops: &Value, i: usize| loops[i]["iae_dense_sum"].as_f64().unwrap();
    let counted = control("count");
    let found = &counted[0]["model_error"];
    assert_eq!(found["steps"], 10, "{found}");
    assert!((2..=10).contains(&found["beyond"].as_u64().unwrap()), "{found}");
    assert_eq!(found["tolerance"], json!({ "x1": 1e-5, "x2": 1e-5 }));
    assert!(found["largest"]["x1"].as_f64().unwrap() > 1e-4);
    assert!(counted[1]["model_error"].is_null());
    let off = |loops: &Value| (iae(loops, 0) / iae(loops, 1) - 1.0).abs();
    let [helped, corrected] = ["integrator", "correct"].map(|of| off(&control(of)));
    assert!(off(&counted) > 1e-5, "{counted}");
    assert!(helped < 0.01 * off(&counted), "{helped} {counted}");
    assert!(corrected < 0.5 * off(&counted), "{corrected} {counted}");
}

/// The table of the net's errors along the loop, beside the enclosures of `certify --run`; and its
/// picture.
fn check_errors_along_the_loop(dir: &Path) {
    let read = |path: &str| -> Vec<Vec<f64>> {
        let text = fs::read_to_string(dir.join(path)).unwrap();
        let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
        text.lines().skip(1).map(row).collect()
    };
    let certify = ["--quiet", "certify", "loop/config.toml", "--model", "run/model.safetensors"];
    let certify = [&certify[..], &["--run", "loop", "--out", "along"]].concat();
    let done = outcome(pinc(&certify).current_dir(dir));
    assert_eq!(done.code, Some(0), "{done:?}");
    let (trace, along) = (read("loop/control-pinc.csv"), read("along/certify.csv"));
    assert_eq!(trace.len(), along.len());
    let errors = read("loop/model-error.csv");
    assert_eq!(errors.len(), 10);
    let mut largest = 0.0_f64;
    for row in &errors {
        let [t, x1, x1_true, x2, x2_true] = row[..] else { panic!("{row:?}") };
        let place = trace.iter().position(|sample| (sample[0] - t).abs() < 1e-9).unwrap();
        let [.., e1, bound1, e2, bound2] = along[place][..] else { panic!("{along:?}") };
        for (truth, error, bound) in [(x1_true, e1, bound1), (x2_true, e2, bound2)] {
            // What an enclosure leaves open.
            let open = bound - error.abs();
            assert!((truth - error).abs() <= open + 1e-9 && open < 0.02 * bound + 1e-9, "{row:?}");
        }
        let size = x1_true.hypot(x2_true);
        assert!((x1 - x1_true).hypot(x2 - x2_true) < 0.1 * size + 1e-8, "{row:?}");
        largest = largest.max(size);
    }
    assert!(largest > 1e-4, "{largest}");
    let picture = fs::read_to_string(dir.join("loop/figures/model-error.svg")).unwrap();
    assert!(picture.contains("estimated") && picture.contains("tolerance"));
    fs::remove_dir_all(dir.join("along")).unwrap();
}

/// The served controller says what it thinks of its net, and exported ones take the loop's steps.
#[test]
fn other_ways_out_have_the_guard() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(train(dir.path(), &smoke(), 100, &[]).code, Some(0));
    let model = dir.path().join("run/model.safetensors").display().to_string();
    let tolerance = "control.error_tolerance={ x1 = 1e-9 }";
    let sets = ["--model", &model, "--set", tolerance, "--set", "control.on_error=\"integrator\""];
    let config = dir.path().join("experiment.toml");
    let mut served = Served::of(&config, ModelKind::Pinc, &sets);
    let answer = served.ask(&json!({ "y": [0.4, 0.1] }));
    assert_eq!(answer["trust"], "substituted", "{answer}");
    assert!(answer["model_error"][0].as_f64().unwrap().abs() > 1e-9, "{answer}");
    served.end();
    let mut plain = Served::of(&config, ModelKind::Pinc, &["--model", &model]);
    let answer = plain.ask(&json!({ "y": [0.4, 0.1] }));
    assert!(answer["trust"].is_null() && answer["model_error"].is_null(), "{answer}");
    plain.end();
    let (mut loops, loose) = (Vec::new(), "control.error_tolerance={ x2 = 0.05 }");
    for on_error in ["count", "integrator", "correct"] {
        let on_error = format!("control.on_error=\"{on_error}\"");
        let sets = ["--model", &model, "--set", loose, "--set", &on_error];
        let sets = [&sets[..], &["--set", "control.max_failed_share=1.0"]].concat();
        let out = tempfile::tempdir().unwrap();
        let closed = Closed::run(out.path(), &config, ModelKind::Pinc, &sets);
        let exported = Exported::of(out.path(), &config, ModelKind::Pinc, &sets, false).unwrap();
        assert_same(&on_error, &closed, &exported.answers(&closed.told()), 1e-9);
        loops.push(closed.inputs);
    }
    assert!(loops[0] != loops[1] && loops[1] != loops[2], "{loops:?}");
    check_exported_estimates(dir.path(), &model);
}

/// Net and controller in C have the estimate, whose self-test passes, or refuse it.
fn check_exported_estimates(dir: &Path, model: &str) {
    let export = |more: &[&str]| {
        outcome(pinc(&[&["export", "--errors", "--model", model], more].concat()).current_dir(dir))
    };
    for (out, config, header) in [
        ("net", None, "model_error.h"),
        ("loop", Some("experiment.toml"), "smoke_van_der_pol_error.h"),
    ] {
        let more: Vec<&str> = config.into_iter().chain(["--to", "c", "--out", out]).collect();
        let done = export(&more);
        assert_eq!(done.code, Some(0), "{done:?}");
        let out = dir.join(out);
        let names: Vec<_> = fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(out.join(header).exists(), "{names:?}");
        compile(&out, "none");
        let ended = outcome(Command::new(out.join("program")).current_dir(&out));
        assert_eq!(ended.code, Some(0), "{ended:?}");
    }
    export(&["--to", "fmu"]).assert_refused(&["--errors", "--to fmu"]);
    let integrator = ["export", "--errors", "experiment.toml", "--only", "rk4", "--to", "c"];
    let refused = outcome(pinc(&integrator).current_dir(dir));
    refused.assert_refused(&["estimated error of an integrator"]);
    fs::copy(model, dir.join("alone.safetensors")).unwrap();
    let alone = ["export", "--errors", "--model", "alone.safetensors", "--to", "c"];
    outcome(pinc(&alone).current_dir(dir)).assert_refused(&["config.toml"]);
}

#[test]
fn tolerances_name_states_and_are_positive() {
    let dir = tempfile::tempdir().unwrap();
    let control = |set: &str, parts: &[&str]| {
        fs::write(dir.path().join("experiment.toml"), smoke()).unwrap();
        let mut command = pinc(&["run", "experiment.toml", "--set", set]);
        outcome(command.current_dir(dir.path())).assert_refused(parts);
    };
    control("control.error_tolerance={ x3 = 0.1 }", &["control.error_tolerance.x3", "x1, x2"]);
    control("control.error_tolerance={ x1 = 0.0 }", &["control.error_tolerance.x1", "positive"]);
    control("control.on_error=\"correct\"", &["control.on_error", "control.error_tolerance"]);
    // Nothing judges the steps of an integrator.
    let path = dir.path().join("experiment.toml");
    let alone = ["control.models=[\"rk4\"]", "control.error_tolerance={ x1 = 0.1 }"];
    fs::write(&path, smoke()).unwrap();
    for command in ["run", "control", "check", "choose"] {
        let sets = alone.iter().flat_map(|set| ["--set", set]);
        let mut command = pinc(&[command, "experiment.toml"]);
        let refused = outcome(command.args(sets).current_dir(dir.path()));
        refused.assert_refused(&["control.error_tolerance", "\"pinc\" among"]);
    }
    let proven = "training.proven_tolerance={ x1 = -1.0 }";
    control(proven, &["training.proven_tolerance.x1", "a positive number"]);
    // Without a run directory there is no model file for the certificate.
    let proven = ["training.proven_tolerance={ x1 = 1.0 }".to_owned()];
    let plants = pinc_config::Plants::built_in();
    let experiment = Experiment::parse("smoke.toml".as_ref(), &smoke(), &proven, &plants).unwrap();
    let refused = pinc_runs::train_watched(&experiment, |_| ControlFlow::Continue(()));
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("training.proven_tolerance") && message.contains("`pinc.run`"));
    let unknown = "data={ files = [\"d.csv\"], weight = 1.0, parameters = [\"mu\"] }";
    let sets = [proven[0].clone(), unknown.to_owned()];
    let refused = Experiment::parse("smoke.toml".as_ref(), &smoke(), &sets, &plants);
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("training.proven_tolerance"), "{message}");
    assert!(message.contains("data.parameters"), "{message}");
    control("training.proven={ x1 = 1.0 }", &["training.proven", "proven_tolerance"]);
}

/// The time limit ends the training, and leaves time for a proof.
#[test]
fn a_net_that_is_trained_to_the_time_limit_is_proven() {
    let dir = tempfile::tempdir().unwrap();
    let sets = ["training.proven_tolerance={ x1 = 10.0, x2 = 20.0 }", "training.time_limit_s=2.0"];
    let done = train(dir.path(), &small(), 10_000_000, &sets);
    assert_eq!(done.code, Some(0), "{done:?}");
    let bytes = fs::read(dir.path().join("run/model.safetensors")).unwrap();
    let net = pinc_net::PincNet::from_bytes(&bytes).unwrap();
    assert!(pinc_runs::certificate(&net).unwrap().proven["x1"] <= 10.0);
}

/// A net is trained until its error is proven; the certificate is checked against net, equation and
/// domain, and its bounds are proven again.
#[test]
fn a_proven_net_carries_its_certificate() {
    let dir = tempfile::tempdir().unwrap();
    let small = small();
    // A net of 40 iterations is not that good: the rounds after it have to help.
    let sets = ["training.proven_tolerance={ x1 = 0.06, x2 = 0.06 }"];
    let done = train(dir.path(), &small, 40, &sets);
    assert_eq!(done.code, Some(0), "{done:?}");
    let log = fs::read_to_string(dir.path().join("run/training.csv")).unwrap();
    assert!(log.lines().count() > 41, "no round of training after the first");
    let verify = |model: &str, more: &[&str]| {
        let fixed = ["certify", "experiment.toml", "--model", model, "--verify"];
        outcome(pinc(&[&fixed[..], more].concat()).current_dir(dir.path()))
    };
    let model = "run/model.safetensors";
    let checked = verify(model, &[]);
    assert_eq!(checked.code, Some(0), "{checked:?}");
    assert!(checked.stdout.contains("one step is off by at most x1 "), "{checked:?}");
    let bytes = fs::read(dir.path().join(model)).unwrap();
    let net = pinc_net::PincNet::from_bytes(&bytes).unwrap();
    let certificate = pinc_runs::certificate(&net).unwrap();
    for state in ["x1", "x2"] {
        assert!(certificate.proven[state] <= 0.06, "{certificate:?}");
    }
    assert_eq!(certificate.domain["u"].map(f64::to_bits), [-1.0_f64, 1.0].map(f64::to_bits));
    // A tube takes its bounds: the inputs are those of the same numbers as boxes.
    let control = |out: &str, model: &str, uncertainty: &str| {
        let fixed = ["control", "experiment.toml", "--only", "pinc", "--quiet", "--model", model];
        let set = format!("control.uncertainty={{ probability = \"worst-case\", {uncertainty} }}");
        let high = "control.state_high=[0.4, 2.0]";
        let more = ["--out", out, "--set", &set, "--set", high];
        let done = outcome(pinc(&[&fixed[..], &more].concat()).current_dir(dir.path()));
        (done, fs::read_to_string(dir.path().join(out).join("control.csv")).ok())
    };
    let proven = "net_error = \"proven\"";
    let [x1, x2] = ["x1", "x2"].map(|state| certificate.proven[state]);
    let as_boxes = control("boxes", model, &format!("boxes = {{ x1 = {x1}, x2 = {x2} }}")).1;
    assert_eq!(control("proven", model, proven).1, as_boxes);
    assert_ne!(control("tiny", model, "boxes = { x1 = 1e-9 }").1, as_boxes);
    // Without a tolerance in the training there is nothing to wait for.
    let uncertainty =
        "control.uncertainty={ probability = \"worst-case\", net_error = \"proven\" }";
    let run = ["run", "experiment.toml", "--out", "unproven", "--set", uncertainty];
    outcome(pinc(&run).current_dir(dir.path()))
        .assert_refused(&["control.uncertainty.net_error", "it needs training.proven_tolerance"]);
    assert!(!dir.path().join("unproven/training.csv").exists());
    // What is generated from it says so.
    let export = ["export", "--model", model, "--to", "c", "--out", "c"];
    assert_eq!(outcome(pinc(&export).current_dir(dir.path())).code, Some(0));
    let header = fs::read_to_string(dir.path().join("c/model_net.h")).unwrap();
    assert!(
        header.contains(
            " * Certificate, in double precision: proven: one step is off by at most x1 "
        ),
        "{header}"
    );
    // One weight changed, another equation, a bound that is too low.
    let mut changed = bytes.clone();
    let last = changed.len() - 5;
    changed[last] ^= 1;
    fs::write(dir.path().join("changed.safetensors"), changed).unwrap();
    control("changed", "changed.safetensors", proven)
        .0
        .assert_refused(&["control.uncertainty.net_error", "another net"]);
    verify("changed.safetensors", &["--quiet"])
        .assert_refused(&["changed.safetensors", "another net"]);
    let other = ["--quiet", "--set", "plant.van-der-pol.mu=1.01"];
    verify(model, &other).assert_refused(&["another equation"]);
    // The config's domain is within the certificate's, or else that is refused.
    assert_eq!(verify(model, &["--set", "domain.state_high=[0.9, 1.0]"]).code, Some(0));
    let wider = ["--set", "domain.state_low=[-9.0, -3.0]"];
    verify(model, &wider).assert_refused(&["x1 from -1 to 1", "[domain] has -9 to"]);
    let lower = ["--set", "training.proven_tolerance={ x2 = 1e-6 }"];
    verify(model, &lower).assert_refused(&["training.proven_tolerance.x2 asks for 0.000001"]);
    // Neither says anything of a certificate that is not its own.
    let header = |arguments: &[&str], file: &str| {
        let export = [&["export", "--to", "c", "--name", "it", "--out", "it"], arguments].concat();
        assert_eq!(outcome(pinc(&export).current_dir(dir.path())).code, Some(0));
        fs::read_to_string(dir.path().join("it").join(file)).unwrap()
    };
    assert!(!header(&["--model", "changed.safetensors"], "it_net.h").contains("Certificate"));
    let controller = ["experiment.toml", "--only", "pinc", "--model", model];
    assert!(header(&controller, "it_mpc.h").contains("Certificate"));
    let controller = [&controller[..], &other[1..]].concat();
    assert!(!header(&controller, "it_mpc.h").contains("Certificate"));
    let text = String::from_utf8_lossy(&bytes[8..]).into_owned();
    let bound = format!("{}", certificate.proven["x1"]);
    let start = 8 + text.find(&bound).expect("the bound is in the header");
    let mut lower = bytes.clone();
    lower[start + bound.len() - 4..start + bound.len()].copy_from_slice(b"e-09");
    fs::write(dir.path().join("lower.safetensors"), lower).unwrap();
    verify("lower.safetensors", &["--quiet"]).assert_refused(&["cannot be proven again"]);
    fs::remove_dir_all(dir.path().join("run")).unwrap();
    assert_eq!(train(dir.path(), &small, 20, &[]).code, Some(0));
    verify(model, &["--quiet"]).assert_refused(&["no certificate", "training.proven_tolerance"]);
}
