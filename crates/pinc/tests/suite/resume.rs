//! A killed training, gone on with, gives bit for bit the net of one that was not killed.

use crate::common::{Outcome, outcome, pinc, repository};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A training of some seconds, with a checkpoint every twentieth of a second.
fn command(dir: &Path, seed: &str, more: &[&str]) -> Command {
    let config = repository("configs/smoke/van-der-pol.toml");
    let mut command = pinc(&["train".as_ref(), config.as_os_str()]);
    command.args(["--set", "training.phases.0.iterations=6000", "--set", seed]);
    command.args(["--set", "training.checkpoint_every_s=0.05", "--quiet", "--out"]);
    command.arg(dir).args(more);
    command
}

fn run(dir: &Path, seed: &str, more: &[&str]) -> Outcome {
    outcome(&mut command(dir, seed, more))
}

/// Starts a training, and kills it once it has written a checkpoint (another one than it found).
fn start_and_kill(dir: &Path, seed: &str, more: &[&str]) {
    let path = dir.join("checkpoint.bin");
    let stamp = || fs::metadata(&path).and_then(|m| m.modified()).ok();
    let before = stamp();
    let mut child = command(dir, seed, more).stderr(Stdio::null()).spawn().unwrap();
    let begun = Instant::now();
    while stamp() == before {
        assert!(begun.elapsed() < Duration::from_secs(60), "no checkpoint in a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    // SIGKILL on Unix.
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!dir.join("model.safetensors").exists(), "the training was over before it was killed");
}

fn killed() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let run = dir.path().join("run");
    start_and_kill(&run, "seed=7", &[]);
    (dir, run)
}

#[test]
fn killing_and_resuming_changes_no_bit() {
    let (dir, killed) = killed();
    start_and_kill(&killed, "seed=7", &["--resume"]);
    let resumed = run(&killed, "seed=7", &["--resume"]);
    assert_eq!(resumed.code, Some(0), "{resumed:?}");

    let whole = dir.path().join("whole");
    let outcome = run(&whole, "seed=7", &[]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let read = |dir: &Path, file: &str| fs::read(dir.join(file)).unwrap();
    assert!(read(&killed, "model.safetensors") == read(&whole, "model.safetensors"));
    assert!(!killed.join("checkpoint.bin").exists());

    // The log has every iteration once, with the same losses.
    let losses = |dir: &Path| -> Vec<String> {
        let text = String::from_utf8(read(dir, "training.csv")).unwrap();
        let without_time = |line: &str| {
            let cells: Vec<_> = line.split(',').collect();
            [&cells[..2], &cells[3..]].concat().join(",")
        };
        text.lines().map(without_time).collect()
    };
    assert_eq!(losses(&killed), losses(&whole));

    // Each call that worked on the run is named, the first with the run's own keys.
    let provenance: serde_json::Value =
        serde_json::from_slice(&read(&killed, "provenance.json")).unwrap();
    let calls = provenance["resumed"].as_array().unwrap();
    assert_eq!(calls.len(), 2);
    assert!(provenance["started"].as_str() <= calls[1]["started"].as_str());

    // Once more: there is nothing left to do.
    let model = read(&killed, "model.safetensors");
    let provenance = read(&killed, "provenance.json");
    let begun = Instant::now();
    assert_eq!(run(&killed, "seed=7", &["--resume"]).code, Some(0));
    assert!(begun.elapsed() < Duration::from_secs(30));
    assert!(read(&killed, "model.safetensors") == model);
    assert!(read(&killed, "provenance.json") == provenance);
}

#[test]
fn a_checkpoint_of_another_config_is_refused() {
    let (_dir, killed) = killed();
    run(&killed, "seed=8", &["--resume"])
        .assert_refused(&["belongs to a run of another config", "--out"]);
    // Nor does a fresh run of another config overwrite it.
    run(&killed, "seed=8", &[]).assert_refused(&["belongs to a run of another config", "--out"]);

    // A checkpoint that was copied from elsewhere.
    let other = killed.with_file_name("other");
    start_and_kill(&other, "seed=8", &[]);
    fs::copy(other.join("checkpoint.bin"), killed.join("checkpoint.bin")).unwrap();
    run(&killed, "seed=7", &["--resume"])
        .assert_refused(&["checkpoint.bin: belongs to another config"]);
}

#[test]
fn damaged_checkpoints_are_refused() {
    let (_dir, killed) = killed();
    let path = killed.join("checkpoint.bin");
    let good = fs::read(&path).unwrap();
    let with = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        run(&killed, "seed=7", &["--resume"])
    };
    with(&good[..good.len() - 1]).assert_refused(&["checkpoint.bin: damaged"]);
    with(&good[..20]).assert_refused(&["checkpoint.bin: damaged"]);
    with(b"something else").assert_refused(&["checkpoint.bin: not a checkpoint"]);
    with(&[]).assert_refused(&["checkpoint.bin: not a checkpoint"]);
    let mut changed = good.clone();
    *changed.last_mut().unwrap() ^= 1;
    with(&changed).assert_refused(&["checkpoint.bin: damaged"]);
    let mut newer = good.clone();
    newer[8] = 99;
    with(&newer).assert_refused(&["checkpoint.bin: written by another version"]);

    fs::write(&path, &good).unwrap();
    fs::remove_file(killed.join("training.csv")).unwrap();
    run(&killed, "seed=7", &["--resume"]).assert_refused(&["training.csv"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_state_to_resume_from() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run");
    let mut child = command(&path, "seed=7", &[]).stderr(Stdio::piped()).spawn().unwrap();
    while !path.join("checkpoint.bin").exists() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let mut text = String::new();
    std::io::Read::read_to_string(child.stderr.as_mut().unwrap(), &mut text).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{text}");
    assert!(text.contains("--resume"), "{text}");
    let resumed = run(&path, "seed=7", &["--resume"]);
    assert_eq!(resumed.code, Some(0), "{resumed:?}");
}
