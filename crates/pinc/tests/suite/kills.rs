//! Runs that are killed at random moments and resumed: the same bits, and no file left behind.
//!
//! Each kind of run is killed as often as `PINC_KILLS` says, `docs/testing.md` says how a long test
//! is run.

use crate::common::{leftovers, outcome, pinc, repository};
use crate::sweep::SWEEP;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Kills of each kind if nothing else is asked for.
const KILLS: u32 = 2;

fn kills() -> u32 {
    std::env::var("PINC_KILLS").ok().map_or(KILLS, |text| text.parse().unwrap())
}

/// Kills the run that `command` makes in a directory, resumes it, and compares `files` with an
/// undisturbed run's.
fn kill(command: &dyn Fn(&Path) -> Command, files: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole");
    let begun = Instant::now();
    let done = outcome(&mut command(&whole));
    assert_eq!(done.code, Some(0), "{done:?}");
    let duration = begun.elapsed();
    let expected: Vec<Vec<u8>> =
        files.iter().map(|file| fs::read(whole.join(file)).unwrap()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for round in 0..kills() {
        let run = dir.path().join(format!("killed-{round}"));
        // Some runs are killed once more while they are resumed.
        for resume in [&[][..], &["--resume"]].into_iter().take(1 + round as usize % 2) {
            let after = duration.mul_f64(rng.random::<f64>());
            let mut child = command(&run).args(resume).stderr(Stdio::null()).spawn().unwrap();
            std::thread::sleep(after.max(Duration::from_millis(1)));
            // It may be over.
            let _ = child.kill();
            child.wait().unwrap();
        }
        let resumed = outcome(command(&run).arg("--resume"));
        assert_eq!(resumed.code, Some(0), "{resumed:?}");
        for (file, expected) in files.iter().zip(&expected) {
            assert!(fs::read(run.join(file)).unwrap() == *expected, "round {round}: {file}");
        }
        assert_eq!(leftovers(&run), Vec::<PathBuf>::new(), "round {round}");
        fs::remove_dir_all(run).unwrap();
    }
}

fn of_smoke(name: &'static str, more: &'static [&'static str]) -> impl Fn(&Path) -> Command {
    move |out| {
        let config = repository("configs/smoke/van-der-pol.toml");
        let mut command =
            pinc(&[name.as_ref(), config.as_os_str(), "--out".as_ref(), out.as_ref()]);
        command.arg("--quiet").args(more);
        command
    }
}

#[test]
fn a_training_may_be_killed_at_any_moment() {
    const MORE: [&str; 4] =
        ["--set", "training.phases.0.iterations=1500", "--set", "training.checkpoint_every_s=0.02"];
    kill(&of_smoke("train", &MORE), &["model.safetensors", "config.toml"]);
}

#[test]
fn a_run_may_be_killed_at_any_moment() {
    let files = ["model.safetensors", "prediction.csv", "control-pinc.csv", "control-rk4.csv"];
    kill(&of_smoke("run", &["--set", "training.checkpoint_every_s=0.02"]), &files);
}

#[test]
fn a_loop_may_be_killed_at_any_moment() {
    const MORE: [&str; 4] = ["--only", "rk4", "--set", "control.duration_s=500.0"];
    kill(&of_smoke("control", &MORE), &["control.csv"]);
}

#[test]
fn a_sweep_may_be_killed_at_any_moment() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("sweep.toml");
    fs::write(&config, SWEEP).unwrap();
    let command = |out: &Path| {
        let arguments = ["run".as_ref(), config.as_os_str(), "--quiet".as_ref(), "--out".as_ref()];
        let mut command = pinc(&arguments);
        command.arg(out);
        command
    };
    kill(&command, &["sweep.csv", "summary.csv"]);
}
