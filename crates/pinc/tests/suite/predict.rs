//! `pinc predict` with a model file that another program wrote (`tests/data/make_model.py`), and
//! the errors it makes of files that are not as they should be.

use crate::common::{Outcome, outcome, pinc, repository};
use std::fs;
use std::path::Path;

fn data(file: &str) -> std::path::PathBuf {
    repository("crates/pinc/tests/data").join(file)
}

fn predict(model: &Path, inputs: &Path, output: &Path) -> Outcome {
    let [m, i, o] = ["--model", "--inputs", "--output"].map(std::ffi::OsStr::new);
    let arguments =
        ["predict".as_ref(), m, model.as_os_str(), i, inputs.as_os_str(), o, output.as_os_str()];
    outcome(&mut pinc(&arguments))
}

/// The outcome for an input file with this text.
fn predict_text(inputs: &str) -> Outcome {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("in.csv");
    fs::write(&path, inputs).unwrap();
    let outcome = predict(&data("model.safetensors"), &path, &dir.path().join("out.csv"));
    assert_eq!(dir.path().join("out.csv").exists(), outcome.code == Some(0), "no half results");
    outcome
}

#[test]
fn a_model_written_by_python_predicts_the_numbers_of_numpy() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out.csv");
    let outcome = predict(&data("model.safetensors"), &data("inputs.csv"), &output);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let (found, expected) =
        (fs::read_to_string(&output).unwrap(), fs::read_to_string(data("expected.csv")).unwrap());
    assert_eq!(found.lines().count(), expected.lines().count());
    assert_eq!(found.lines().next(), expected.lines().next());
    for (found, expected) in found.lines().zip(expected.lines()).skip(1) {
        let found_cells: Vec<_> = found.split(',').collect();
        let expected_cells: Vec<_> = expected.split(',').collect();
        assert_eq!(found_cells[0], expected_cells[0]);
        for (a, b) in found_cells[1..].iter().zip(&expected_cells[1..]) {
            let (a, b): (f64, f64) = (a.parse().unwrap(), b.parse().unwrap());
            // What issue and interface ask for; rounding makes about 1e-15 per step of the chain.
            assert!((a - b).abs() <= 1e-12, "{found} against {expected}");
        }
    }
}

#[test]
fn scenarios_may_be_interleaved_and_columns_reordered() {
    let outcome = predict_text("t,scenario,x2,x1,u\n0,a,1,1,0\n0,b,2,2,0\n0.5,a,,,0\n0.5,b,,,0\n");
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}

#[test]
fn csv_mistakes_name_line_and_column() {
    let header = "scenario,t,u,x1,x2\n";
    let good = "a,0.0,0.1,1.0,2.0\n";
    for (rows, parts) in [
        ("a,0.5,x,,\n", &["in.csv:3: ", "column `u`", "`x` given"][..]),
        ("a,0.5,nan,,\n", &["in.csv:3: ", "column `u`", "expected a finite number"]),
        ("a,inf,0.1,,\n", &["in.csv:3: ", "column `t`"]),
        ("a,0.5,,,\n", &["in.csv:3: ", "column `u`", "`` given"]),
        ("a,0.5,0.1,z,\n", &["in.csv:3: ", "column `x1`", "`z` given"]),
        ("a,0.0,0.1,,\n", &["in.csv:3: ", "column `t`", "expected more than 0 s"]),
        ("a,1e90,0.1,,\n", &["in.csv:3: ", "column `t`", "million steps"]),
        ("a,0.5,1e300,,\n", &["in.csv:3: ", "column `u`", "up to 1e100"]),
        ("a,0.5,0.1\n", &["in.csv:3: ", "not a CSV file"]),
        ("b,0.0,0.1,1.0,\n", &["in.csv:3: ", "column `x2`", "`` given"]),
    ] {
        predict_text(&format!("{header}{good}{rows}")).assert_refused(parts);
    }
    let expected = ["in.csv:1: ", "column `x2` is missing", "scenario,t,u,x1,x2"];
    predict_text("scenario,t,u,x1\na,0,0,1\n").assert_refused(&expected);
    predict_text("scenario;t;u;x1;x2\na;0,0;0,1;1;2\n")
        .assert_refused(&["in.csv:1: ", "separated by \";\", not by commas"]);
    predict_text("").assert_refused(&["in.csv:1: ", "column `scenario` is missing"]);
    let expected = ["in.csv:1: ", "column `v` is unexpected"];
    predict_text("scenario,t,u,v,x1,x2\n").assert_refused(&expected);
    let expected = ["in.csv:1: ", "column `u` more than once"];
    predict_text("scenario,t,u,u,x1,x2\n").assert_refused(&expected);
}

#[test]
fn files_that_are_not_model_files() {
    let dir = tempfile::tempdir().unwrap();
    let good = fs::read(data("model.safetensors")).unwrap();
    let with = |bytes: &[u8]| {
        let path = dir.path().join("m.safetensors");
        fs::write(&path, bytes).unwrap();
        predict(&path, &data("inputs.csv"), &dir.path().join("out.csv"))
    };
    for length in [0, 4, 100, good.len() - 8] {
        with(&good[..length]).assert_refused(&["m.safetensors: ", "safetensors"]);
    }
    with(b"scenario,t,u\n0,0,0\n").assert_refused(&["m.safetensors: "]);
    // A safetensors file of another kind: the same with another format in its metadata.
    let text = String::from_utf8_lossy(&good).into_owned();
    let start = text.find("pinc-model").unwrap();
    let mut foreign = good.clone();
    foreign[start..start + 10].copy_from_slice(b"other-kind");
    with(&foreign).assert_refused(&["m.safetensors: not a PINC model", "format", "pinc-model"]);

    let missing = dir.path().join("missing.safetensors");
    predict(&missing, &data("inputs.csv"), &dir.path().join("out.csv"))
        .assert_refused(&["missing.safetensors: cannot be read"]);
    predict(&data("model.safetensors"), &dir.path().join("none.csv"), &dir.path().join("out.csv"))
        .assert_refused(&["none.csv: cannot be read"]);
    predict(&data("model.safetensors"), &data("inputs.csv"), &dir.path().join("no/such/out.csv"))
        .assert_refused(&["out.csv: cannot be written"]);
}

/// The expected file's run leaves the net's domain nowhere; one that starts far outside does, in
/// every row.
#[test]
fn a_net_asked_outside_its_domain_says_so_or_refuses() {
    let dir = tempfile::tempdir().unwrap();
    let inputs = dir.path().join("in.csv");
    let text = fs::read_to_string(data("inputs.csv")).unwrap();
    let header = text.lines().next().unwrap();
    let columns: Vec<_> = header.split(',').collect();
    let far = |t: &str| {
        let cell = |column: &&str| match *column {
            "scenario" => "far".to_owned(),
            "t" => t.to_owned(),
            _ => "1e3".to_owned(),
        };
        columns.iter().map(cell).collect::<Vec<_>>().join(",")
    };
    fs::write(&inputs, format!("{header}\n{}\n{}\n", far("0"), far("0.1"))).unwrap();
    let output = dir.path().join("out.csv");
    let predict = |more: &[&str]| {
        let model = data("model.safetensors");
        let mut command = pinc(&["predict".as_ref(), "--model".as_ref(), model.as_os_str()]);
        command.arg("--inputs").arg(&inputs).arg("--output").arg(&output).args(more);
        outcome(&mut command)
    };
    let reported = predict(&[]);
    assert_eq!(reported.code, Some(0), "{reported:?}");
    let expected = "warning: outside the training domain in 2 of 2 steps: ";
    assert!(reported.stderr.contains(expected), "{reported:?}");
    fs::remove_file(&output).unwrap();
    let refused = predict(&["--outside-domain", "refuse"]);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    for part in ["in.csv:2: the net", "outside its training domain", "--outside-domain report"] {
        assert!(refused.stderr.contains(part), "no {part} in {refused:?}");
    }
    assert!(!output.exists());
}
