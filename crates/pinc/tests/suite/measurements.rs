//! `[data]`: measurements from CSV files in the training, and what is said of bad ones.

use crate::common::{Outcome, outcome, pinc, smoke};
use pinc_ode::Dopri5;
use pinc_plants::VanDerPol;
use std::path::Path;

/// Trains the smoke config for a few iterations, with `[data]` of these files.
fn train(dir: &Path, files: &[(&str, &str)], data: &str) -> Outcome {
    for (name, text) in files {
        std::fs::write(dir.join(name), text).unwrap();
    }
    let config = smoke().replace("[training]", &format!("[data]\n{data}\n[training]"));
    std::fs::write(dir.join("experiment.toml"), config).unwrap();
    let iterations = "training.phases.0.iterations=5";
    let arguments = ["train", "experiment.toml", "--out", "run", "--set", iterations];
    outcome(pinc(&arguments).current_dir(dir))
}

fn refused(csv: &str, parts: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let outcome = train(dir.path(), &[("m.csv", csv)], "files = [\"m.csv\"]");
    outcome.assert_refused(parts);
    assert!(!dir.path().join("run/model.safetensors").exists());
}

const TRAJECTORY: &str = "scenario,t,u,x1,x2\n\
                          a,0,0.5,1,0\n\
                          b,0,0.0,-1,0.5\n\
                          a,0.25,0.5,0.95,\n\
                          b,0.3,0.0,,0.9\n\
                          a,0.5,0.5,0.8,-0.5\n";

const STEPS: &str = "x1_0,x2_0,u,t,x1,x2\n1,0,0.5,0.5,0.8,\n-1,0.5,0,0.25,,0.8\n";

#[test]
fn both_kinds_of_file_enter_loss_record_and_metrics() {
    let dir = tempfile::tempdir().unwrap();
    let files = [("a.csv", TRAJECTORY), ("b.csv", STEPS), ("c.csv", STEPS)];
    let data = "files = [\"a.csv\", \"b.csv\"]\nheld_out = [\"c.csv\"]";
    let outcome = train(dir.path(), &files, data);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(outcome.stdout.contains("held out"), "{outcome:?}");
    let metrics = std::fs::read(dir.path().join("run/metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_slice(&metrics).unwrap();
    assert!(metrics["validation"]["measured_mse"].as_f64().unwrap() > 0.0, "{metrics}");
    // The equation does not judge a net that data may have corrected.
    let judged = |outcome: &Outcome| {
        outcome.stdout.contains("is wrong in a part")
            || outcome.stderr.contains("is wrong in a part")
    };
    assert!(!judged(&outcome), "{outcome:?}");
    let other = tempfile::tempdir().unwrap();
    assert!(judged(&train(other.path(), &files, "files = [\"a.csv\"]")));
    let record = std::fs::read_to_string(dir.path().join("run/training.csv")).unwrap();
    let header: Vec<_> = record.lines().next().unwrap().split(',').collect();
    let place = header.iter().position(|column| *column == "loss_measured").unwrap();
    for line in record.lines().skip(1) {
        let value: f64 = line.split(',').nth(place).unwrap().parse().unwrap();
        assert!(value > 0.0, "{line}");
    }
}

/// Names of states that look like the columns of another form.
#[test]
fn the_form_of_a_file_is_told_from_its_columns_whatever_the_states_are_called() {
    let plant = "[plant.expression]\nstates = [\"y\", \"y_b\"]\ninputs = [\"u\"]\n\
                 derivatives = { y = \"y_b\", y_b = \"(1 - y^2) * y_b - y + u\" }\n";
    let renamed = |text: &str| text.replace("x1", "y").replace("x2", "y_b");
    let config = renamed(&smoke()).replace("[plant]\nvan-der-pol = { mu = 1.0 }\n", plant);
    assert!(config.contains("[plant.expression]"), "{config}");
    let measured = |text: &str| {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("m.csv"), text).unwrap();
        std::fs::write(dir.path().join("trained.csv"), renamed(STEPS)).unwrap();
        let data = "[data]\nfiles = [\"trained.csv\"]\nheld_out = [\"m.csv\"]\n\n[training]";
        std::fs::write(dir.path().join("c.toml"), config.replace("[training]", data)).unwrap();
        let set = "training.phases.0.iterations=5";
        let arguments = ["train", "c.toml", "--out", "run", "--set", set];
        let outcome = outcome(pinc(&arguments).current_dir(dir.path()));
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        let metrics = std::fs::read(dir.path().join("run/metrics.json")).unwrap();
        let metrics: serde_json::Value = serde_json::from_slice(&metrics).unwrap();
        metrics["validation"]["measured_mse"].to_string()
    };
    assert_ne!(measured(&renamed(STEPS)), "null");
    let rows = "0,0.5,1,0\n0.25,0.5,0.95,\n0.5,0.5,0.8,-0.5\n";
    let one = measured(&format!("t,u,y,y_b\n{rows}"));
    assert_ne!(one, "null");
    assert_eq!(measured(&format!("t,u,y_y,y_y_b\n{rows}")), one);
    let named = rows.lines().map(|row| format!("a,{row}\n")).collect::<String>();
    assert_eq!(measured(&format!("scenario,t,u,y,y_b\n{named}")), one);
}

#[test]
fn bad_files_are_refused_with_line_and_column() {
    refused(
        &TRAJECTORY.replace("0.95", "1e308"),
        &["m.csv:4: column `x1`: `1e308` given, expected a finite number up to 1e100"],
    );
    refused(
        &TRAJECTORY.replace("0.95", "much"),
        &["m.csv:4: column `x1`: `much` given, expected a finite number"],
    );
    refused(
        &TRAJECTORY.replace("a,0.25", "a,-0.25"),
        &["m.csv:4: column `t`: -0.25 s given, expected more than 0 s"],
    );
    refused(
        &TRAJECTORY.replace("t,u", "t,v"),
        &["m.csv:1: column `v` is unexpected; expected scenario,t,u,x1,x2"],
    );
    refused(&STEPS.replace("x2_0", "x1_0"), &["m.csv:1: column `x1_0` more than once"]);
    refused(
        &STEPS.replace("0,0.25,,0.8", "0,0.75,,0.8"),
        &["m.csv:3: column `t`: 0.75 s given, expected more than 0, up to T = 0.5 s"],
    );
    refused(&STEPS.replace("0,0.25,,0.8", "0,0,,0.8"), &["m.csv:3: column `t`: 0 s given"]);
    refused(&STEPS.replace("1,0,0.5", "1,,0.5"), &["m.csv:2: column `x2_0`: `` given"]);
    refused(&STEPS.replace("0.25,,0.8", "0.25,0.8"), &["m.csv:3: not a CSV file"]);
    // Nothing follows a full row within T.
    refused(
        "scenario,t,u,x1,x2\na,0,0,1,1\na,2,0,1,1\n",
        &["m.csv: nothing to compare a net with"],
    );
}

/// Measurements in wrong units, or of another operating point, are used and not passed over.
#[test]
fn measurements_outside_the_domain_are_counted() {
    for (steps, said) in [(STEPS, None), (&STEPS.replace("1,0,0.5,", "1,0,30,"), Some("1 of 2"))] {
        let dir = tempfile::tempdir().unwrap();
        let outcome = train(dir.path(), &[("m.csv", steps)], "files = [\"m.csv\"]");
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        let warned = outcome.stderr.contains("points lie outside [domain]");
        assert_eq!(warned, said.is_some(), "{outcome:?}");
        assert!(said.is_none_or(|said| outcome.stderr.contains(said)), "{outcome:?}");
    }
}

#[test]
fn bad_sections_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |data: &str, parts: &[&str]| train(dir.path(), &[], data).assert_refused(parts);
    refused("files = []", &["`data.files`: [] given, expected at least one CSV file"]);
    refused("files = [\"m.csv\"]\nweight = -1.0", &["`data.weight`: -1 given"]);
    refused("files = [\"m.csv\", \"m.csv\"]", &["`data.files[1]`: m.csv given, expected each"]);
    refused("files = [\"none.csv\"]", &["none.csv: cannot be read"]);
    refused(
        "files = [\"a.csv\", \"m.csv\"]\nheld_out = [\"m.csv\"]",
        &["`data.held_out[0]`: m.csv given, expected a file that is not in data.files"],
    );
    refused("file = [\"m.csv\"]", &["`data.file`: unknown key", "did you mean `files`?"]);
}

#[test]
fn a_training_resumes_with_the_same_measurements_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let data = "files = [\"m.csv\"]";
    let config = smoke()
        .replace("[training]", &format!("[data]\n{data}\n[training]"))
        .replace("[validation]", "checkpoint_every_s = 1e-6\n[validation]");
    std::fs::write(dir.path().join("experiment.toml"), config).unwrap();
    std::fs::write(dir.path().join("m.csv"), STEPS).unwrap();
    let arguments = ["train", "experiment.toml", "--out", "run", "--resume"];
    let mut child = pinc(&arguments).current_dir(dir.path()).spawn().unwrap();
    let checkpoint = dir.path().join("run/checkpoint.bin");
    while !checkpoint.exists() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(checkpoint.exists(), "the training was over before it could be killed");
    std::fs::write(dir.path().join("m.csv"), STEPS.replace("0.8,", "0.7,")).unwrap();
    let outcome = outcome(pinc(&arguments).current_dir(dir.path()));
    outcome.assert_refused(&["checkpoint.bin: belongs to another config or other measurements"]);
}

/// Measurements of an oscillator of mu 0.7, as `pinc identify` reads them.
fn recorded() -> String {
    let mut text = "t,u,y_x1,y_x2\n".to_owned();
    let mut x = [1.0, 0.0];
    for k in 0..60_u32 {
        let u = f64::from(k / 5 * 7 % 11) / 5.0 - 1.0;
        text += &format!("{},{u},{},{}\n", 0.5 * f64::from(k), x[0], x[1]);
        Dopri5::new(VanDerPol { mu: 0.7 }, 1e-10).integrate(&mut x, &[u], 0.5).unwrap();
    }
    text
}

/// The parameter is found, and everything after the training is of the plant that was found.
#[test]
fn an_unknown_parameter_is_trained_with_the_net() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.csv"), recorded()).unwrap();
    let data = "[data]\nfiles = [\"m.csv\"]\nparameters = [\"mu\"]\n[training]";
    std::fs::write(dir.path().join("a.toml"), smoke().replace("[training]", data)).unwrap();
    let iterations = "training.phases.0.iterations=1000";
    let run = ["run", "a.toml", "--out", "run", "--set", iterations];
    let first = outcome(pinc(&run).current_dir(dir.path()));
    assert_eq!(first.code, Some(0), "{first:?}");
    assert!(first.stdout.contains("trained with the net"), "{first:?}");
    let metrics = || -> serde_json::Value {
        let text = std::fs::read(dir.path().join("run/metrics.json")).unwrap();
        serde_json::from_slice(&text).unwrap()
    };
    let before = metrics();
    let mu = before["training"]["parameters"]["mu"].as_f64().unwrap();
    // The equation's part of the loss, of a net that is 3e-3 of the box off, moves it by 2 %.
    assert!((mu - 0.7).abs() < 0.03, "{mu}");
    // Against mu = 1, where the training began, it would be larger: the velocity would be off by
    // 0.3 |1 - x1^2| |x2| T, root mean square 0.9 of 6 over the box. The net is of mu = 0.7.
    let error = before["validation"]["domain_error"]["rms"].as_f64().unwrap();
    assert!(error < 0.01, "{error}");
    // The loop of a run that is resumed after its training is the same.
    std::fs::remove_file(dir.path().join("run/control-pinc.csv")).unwrap();
    let again = [&run[..], &["--resume"]].concat();
    let again = outcome(pinc(&again).current_dir(dir.path()));
    assert_eq!(again.code, Some(0), "{again:?}");
    assert_eq!(metrics()["control"][0]["iae"], before["control"][0]["iae"]);
    // Other commands know the plant of the config alone, which is not the net's.
    let model = ["--model", "run/model.safetensors"];
    let points = "scenario,t,u,x1,x2\na,0,0.5,1,0\na,0.5,0.5,,\n";
    std::fs::write(dir.path().join("in.csv"), points).unwrap();
    let predict = ["predict", "--inputs", "in.csv", "--output", "out.csv", "--errors"];
    let export = ["export", "a.toml", "--only", "pinc", "--to", "c"];
    for command in [
        &["control", "a.toml"][..],
        &["serve", "a.toml"],
        &["certify", "a.toml"],
        &predict,
        &export,
    ] {
        let refused = outcome(pinc(&[command, &model].concat()).current_dir(dir.path()));
        refused.assert_refused(&[
            "run/model.safetensors",
            "training.parameters",
            "data.parameters",
        ]);
    }
    let refused = outcome(pinc(&["choose", "a.toml"]).current_dir(dir.path()));
    refused.assert_refused(&["pinc choose", "data.parameters"]);
    let mu = format!("plant.van-der-pol.mu={mu}");
    let known = ["control", "a.toml", "--out", "known", "--unset", "data.parameters", "--set", &mu];
    let known = outcome(pinc(&[&known[..], &model].concat()).current_dir(dir.path()));
    assert_eq!(known.code, Some(0), "{known:?}");
}

#[test]
fn unknown_parameters_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |data: &str, parts: &[&str]| {
        train(dir.path(), &[], &format!("files = [\"m.csv\"]\n{data}")).assert_refused(parts);
    };
    refused("parameters = [\"mi\"]", &["data.parameters[0]", "mi", "mu"]);
    refused("parameters = [\"mu\", \"mu\"]", &["data.parameters[1]", "each parameter once"]);
    refused("[domain.parameters]\nmu = [0.5, 1.5]", &["data.files", "of which plant"]);
    refused(
        "parameters = [\"mu\"]\n[domain.parameters]\nmu = [0.5, 1.5]",
        &["data.files", "no such key with [domain.parameters]"],
    );
    refused(
        "parameters = [\"mu\"]\nheld_out = [\"other.csv\"]",
        &["data.held_out", "no such key with data.parameters"],
    );
}
