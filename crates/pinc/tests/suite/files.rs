//! Files that are damaged, locked, in the way or elsewhere: nothing of the user's is overwritten,
//! and a resumed run makes what is missing.

use crate::common::{Outcome, leftovers, outcome, pinc, repository, smoke};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

fn smoke_config() -> PathBuf {
    repository("configs/smoke/van-der-pol.toml")
}

fn run(command: &str, dir: &Path, more: &[&str]) -> Outcome {
    let config = smoke_config();
    let mut command = pinc(&[command.as_ref(), config.as_os_str(), "--out".as_ref(), dir.as_ref()]);
    outcome(command.arg("--quiet").args(more))
}

#[track_caller]
fn fine(outcome: &Outcome) {
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}

fn predict(model: &Path, inputs: &Path, output: &Path) -> Outcome {
    let arguments: [&std::ffi::OsStr; 7] = [
        "predict".as_ref(),
        "--model".as_ref(),
        model.as_ref(),
        "--inputs".as_ref(),
        inputs.as_ref(),
        "--output".as_ref(),
        output.as_ref(),
    ];
    outcome(&mut pinc(&arguments))
}

/// A model file and an input file, copied to `dir`.
fn model_and_inputs(dir: &Path) -> (PathBuf, PathBuf) {
    let copy = |name: &str| {
        let to = dir.join(name);
        fs::copy(repository("crates/pinc/tests/data").join(name), &to).unwrap();
        to
    };
    (copy("model.safetensors"), copy("inputs.csv"))
}

#[cfg(unix)]
#[test]
fn predictions_go_through_links_and_into_pipes() {
    let dir = tempfile::tempdir().unwrap();
    let (model, inputs) = model_and_inputs(dir.path());
    let plain = dir.path().join("plain.csv");
    fine(&predict(&model, &inputs, &plain));
    let expected = fs::read(&plain).unwrap();

    let (target, link) = (dir.path().join("target.csv"), dir.path().join("link.csv"));
    std::os::unix::fs::symlink(&target, &link).unwrap();
    // First to a link that leads to nothing, then to one that leads to a file.
    for _ in 0..2 {
        fine(&predict(&model, &inputs, &link));
        assert!(link.is_symlink());
        assert!(fs::read(&target).unwrap() == expected);
        fs::write(&target, "old").unwrap();
    }

    let pipe = dir.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let reader = {
        let pipe = pipe.clone();
        std::thread::spawn(move || fs::read(pipe).unwrap())
    };
    fine(&predict(&model, &inputs, &pipe));
    assert!(reader.join().unwrap() == expected);
    assert!(!fs::symlink_metadata(&pipe).unwrap().is_file());
    fine(&predict(&model, &inputs, Path::new("/dev/null")));
    assert!(!fs::symlink_metadata("/dev/null").unwrap().is_file());
}

#[test]
fn an_output_that_is_an_input_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (model, inputs) = model_and_inputs(dir.path());
    let before = (fs::read(&model).unwrap(), fs::read(&inputs).unwrap());
    predict(&model, &inputs, &model).assert_refused(&["is also --model"]);
    // By another name.
    let around = dir.path().join(".").join("inputs.csv");
    predict(&model, &inputs, &around).assert_refused(&["is also --inputs"]);
    assert!((fs::read(&model).unwrap(), fs::read(&inputs).unwrap()) == before);
}

#[test]
fn estimates_do_not_overwrite_what_they_are_made_from() {
    let dir = tempfile::tempdir().unwrap();
    let copy = |from: &str| {
        let to = dir.path().join(Path::new(from).file_name().unwrap());
        fs::copy(repository(from), &to).unwrap();
        to
    };
    let config = copy("configs/estimation/recorded-tanks.toml");
    let data = copy("crates/pinc-estimate/tests/data/estim-tanks.csv");
    let before = [&config, &data].map(|path| fs::read(path).unwrap());
    let around = dir.path().join(".").join("estim-tanks.csv");
    for (output, read) in [(&around, "is also --data"), (&config, "is also the config")] {
        let mut command = pinc(&["estimate"]);
        command.arg(&config).arg("--data").arg(&data).arg("--output").arg(output);
        outcome(&mut command).assert_refused(&["--output", read, "which it would overwrite"]);
    }
    assert!(before == [&config, &data].map(|path| fs::read(path).unwrap()));
}

/// An expression may be finite for one size of a state and not for the next.
#[test]
fn states_that_are_no_numbers_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let (model, inputs) = model_and_inputs(dir.path());
    // The last bias of the net, the last of the file's numbers, which are little-endian.
    let mut bytes = fs::read(&model).unwrap();
    let end = bytes.len();
    bytes[end - 8..].copy_from_slice(&f64::MAX.to_le_bytes());
    bytes[end - 16..end - 8].copy_from_slice(&f64::MAX.to_le_bytes());
    fs::write(&model, bytes).unwrap();
    let output = dir.path().join("out.csv");
    let outcome = predict(&model, &inputs, &output);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains("inputs.csv:") && outcome.stderr.contains("the net's x"));
    assert!(!output.exists());
}

#[test]
fn a_resumed_run_makes_what_is_missing_or_damaged() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("run");
    fine(&run("run", &dir, &[]));
    let names = [
        "prediction.csv",
        "control-pinc.csv",
        "steps-rk4.csv",
        "model.safetensors",
        "training.csv",
        "domain-error.csv",
        "model-error.csv",
    ];
    let without_times = |name: &str| name == "training.csv" || name.starts_with("steps");
    for name in names {
        let path = dir.join(name);
        let good = fs::read(&path).unwrap();
        let cut = &good[..good.len() - 20];
        let mut other = good.clone();
        let middle = other.len() / 2;
        other[middle..middle + 8].copy_from_slice(b"\xff,,,,,,\xff");
        for damaged in [None, Some(cut), Some(&other[..]), Some(&[])] {
            match damaged {
                None => fs::remove_file(&path).unwrap(),
                Some(bytes) => fs::write(&path, bytes).unwrap(),
            }
            fine(&run("run", &dir, &["--resume"]));
            let again = fs::read(&path).unwrap();
            assert!(without_times(name) || again == good, "{name}");
            assert!(again.len() > good.len() / 2, "{name}");
        }
        assert_eq!(leftovers(&dir), Vec::<PathBuf>::new());
    }
}

/// A run that is done is not made again; what says where it is from is.
#[test]
fn a_resumed_run_says_again_where_it_is_from() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("run");
    fine(&run("run", &dir, &[]));
    let path = dir.join("provenance.json");
    let of = |key: &str| {
        let text = fs::read_to_string(&path).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()[key].clone()
    };
    let (seed, config) = (of("seed"), of("config_sha256"));
    for damaged in [&b""[..], b"{ \"seed\": "] {
        fs::write(&path, damaged).unwrap();
        fine(&run("run", &dir, &["--resume"]));
        assert_eq!((of("seed"), of("config_sha256")), (seed.clone(), config.clone()));
    }
}

/// A disk that is full takes no results: whoever reads the exit code learns it.
#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_printed_is_an_error() {
    let config = repository("configs/smoke/rk4-only.toml");
    let config = config.to_str().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().to_str().unwrap();
    for arguments in [
        &["--help"][..],
        &["--version"],
        &["check", "--help"],
        &["check", config],
        &["control", config, "--out", out],
        &["report", out],
        &["compare", out, out],
    ] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let output = pinc(arguments).stdout(full).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("error: standard output cannot be written"), "{arguments:?}: {said}");
    }
}

#[test]
fn what_a_killed_run_left_is_removed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("run");
    fine(&run("run", &dir, &[]));
    for stale in
        [".pinc-unfinished-a", "figures/.pinc-unfinished-b", "checkpoint.bin", ".pinc-lock"]
    {
        fs::write(dir.join(stale), "left").unwrap();
    }
    fine(&run("run", &dir, &["--resume"]));
    assert_eq!(leftovers(&dir), Vec::<PathBuf>::new());
}

#[test]
fn a_second_process_is_refused_by_the_first_ones_id() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("run");
    let config = smoke_config();
    let long = ["--set", "training.phases.0.iterations=1000000"];
    let mut command = pinc(&["train".as_ref(), config.as_os_str(), "--out".as_ref(), dir.as_ref()]);
    let mut first = command.arg("--quiet").args(long).stderr(Stdio::null()).spawn().unwrap();
    while !dir.join("provenance.json").exists() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let id = first.id().to_string();
    run("train", &dir, &long).assert_refused(&["works on this run", &format!("process {id}")]);
    run("run", &dir, &[&long[..], &["--resume"]].concat()).assert_refused(&[&id]);
    first.kill().unwrap();
    first.wait().unwrap();
    // A dead process holds nothing, although its file is still there.
    assert!(dir.join(".pinc-lock").exists());
    let limited = [&long[..], &["--resume", "--set", "training.time_limit_s=1.0"]].concat();
    run("train", &dir, &limited).assert_refused(&["belongs to a run of another config"]);
    let again = dir.with_file_name("again");
    let limited = [&long[..], &["--set", "training.time_limit_s=0.5"]].concat();
    fine(&run("train", &again, &limited));
    fs::write(again.join(".pinc-lock"), &id).unwrap();
    fine(&run("train", &again, &limited));
    assert_eq!(leftovers(&again), Vec::<PathBuf>::new());
}

/// The log of a training is longer than the file that the shell allows, its net shorter.
#[cfg(unix)]
#[test]
fn a_full_disk_does_not_lose_the_net() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("run");
    let config = smoke_config();
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$@\"";
    let mut command = std::process::Command::new("sh");
    command.args(["-c", script, "sh", env!("CARGO_BIN_EXE_pinc"), "train", "--quiet", "--out"]);
    let outcome = outcome(command.arg(&dir).arg(&config));
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains("training.csv: cannot be written"), "{outcome:?}");
    let model = dir.join("model.safetensors");
    let output = dir.with_file_name("out.csv");
    let inputs = repository("crates/pinc/tests/data/inputs.csv");
    fine(&predict(&model, &inputs, &output));
    assert_eq!(leftovers(&dir), Vec::<PathBuf>::new());
}

#[test]
fn one_directory_is_for_one_config() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("loop.toml");
    fs::write(&path, smoke()).unwrap();
    let twice = [path.as_os_str(), path.as_os_str()];
    let mut command = pinc(&["run"]);
    outcome(command.args(twice).arg("--out").arg(dir.path().join("runs")))
        .assert_refused(&["two of the configs have this run directory"]);
    let list = dir.path().join("list.toml");
    let run_list = |runs: &str| {
        fs::write(&list, format!("name = \"list\"\nruns = [{runs}]\n")).unwrap();
        let mut command = pinc(&["run".as_ref(), list.as_os_str(), "--out".as_ref()]);
        outcome(command.arg(dir.path().join("runs")))
    };
    run_list("").assert_refused(&["`runs`: [] given, expected at least one"]);
    run_list("{ config = \"loop.toml\" }, { config = \"loop.toml\" }")
        .assert_refused(&["`runs[1]`", "once more"]);
}
