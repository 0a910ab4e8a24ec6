//! Sweeps that several processes work on in one directory, that are there already, or half there.

use crate::common::{outcome, pinc};
use crate::sweep::{read, rows, run, sweep_with, tables};
use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// A process that shares the sweep in `out`.
fn sharing(config: &Path, out: &Path, more: &[&str]) -> Child {
    let arguments = ["run".as_ref(), config.as_os_str(), "--out".as_ref()];
    let mut command = pinc(&arguments);
    command.arg(out).args(["--quiet", "--shared", "--resume"]).args(more);
    command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

fn status(out: &Path) -> String {
    let said = outcome(pinc(&["status"]).arg(out));
    assert_eq!(said.code, Some(0), "{said:?}");
    said.stdout
}

#[test]
fn processes_that_share_a_sweep_have_the_same_tables_also_if_one_is_killed() {
    let (dir, config) = sweep_with("seeds", "seeds");
    let at = |name: &str| dir.path().join(name);
    let begun = Instant::now();
    assert_eq!(run(&config, &at("whole"), &[]).code, Some(0));
    let duration = begun.elapsed();
    let shared = at("shared");
    let mut first = sharing(&config, &shared, &["--shard", "1/2"]);
    let mut second = sharing(&config, &shared, &[]);
    let mut killed = sharing(&config, &shared, &["--shard", "2/2"]);
    std::thread::sleep(duration.mul_f64(0.5).max(Duration::from_millis(20)));
    killed.kill().unwrap();
    killed.wait().unwrap();
    // What the killed one has not done is done by those that are left.
    assert_eq!((first.wait().unwrap().code(), second.wait().unwrap().code()), (Some(0), Some(0)));
    assert_eq!(tables(&shared), tables(&at("whole")));
    assert!(shared.join("report.html").exists());
    // Nothing is left of the work, and each net was trained once.
    assert!(!shared.join("workers").exists());
    assert!(!shared.join(".pinc-lock").exists());
    assert_eq!(fs::read_dir(shared.join("nets")).unwrap().count(), 8);
    assert!(
        status(&shared).ends_with("16 done, 0 failed, 0 left\nnets: 8 trained, 0 left\nover\n")
    );
}

#[test]
fn results_are_not_thrown_away_unasked() {
    let (dir, config) = sweep_with("iterations = 400", "iterations = 3");
    let out = dir.path().join("out");
    assert_eq!(run(&config, &out, &["--shard", "1/4"]).code, Some(0));
    let before = tables(&out);
    let text = status(&out);
    assert!(text.contains("16 trials: 4 done, 0 failed, 12 left"), "{text}");
    assert!(text.contains("nets: 2 trained, 6 left"), "{text}");
    assert!(text.ends_with("no process works on it\n"), "{text}");
    for more in [&[][..], &["--shard", "2/4"], &["--shared"]] {
        let refused = ["4 trials, 2 nets", "--resume", "--fresh"];
        run(&config, &out, more).assert_refused(&refused);
        assert_eq!(tables(&out), before);
    }
    assert_eq!(run(&config, &out, &["--fresh", "--resume"]).code, Some(2));
    assert_eq!(run(&config, &out, &["--fresh", "--shard", "4/4"]).code, Some(0));
    let done = |out: &Path| {
        let trials = rows(&read(out, "sweep.csv")).into_iter();
        trials.map(|trial| trial["status"] == "done").collect::<Vec<_>>()
    };
    let again = done(&out);
    assert!(again.iter().filter(|done| **done).count() == 4 && !again[0]);
    assert_eq!(run(&config, &out, &["--resume"]).code, Some(0));
    assert_eq!(done(&out), [true; 16]);
    outcome(pinc(&["status"]).arg(dir.path())).assert_refused(&["no config.toml of a run"]);
}

#[test]
fn a_result_that_was_damaged_is_made_again() {
    let (dir, config) = sweep_with("iterations = 400", "iterations = 3");
    let out = dir.path().join("out");
    assert_eq!(run(&config, &out, &[]).code, Some(0));
    let whole = tables(&out);
    let trial = rows(&whole.0)[5]["trial"].clone();
    let result = out.join("trials").join(trial).join("result.json");
    let text = fs::read_to_string(&result).unwrap();
    for damaged in ["", &text[..text.len() / 2]] {
        fs::write(&result, damaged).unwrap();
        assert_eq!(run(&config, &out, &["--resume"]).code, Some(0));
        assert_eq!(tables(&out), whole);
    }
}

#[test]
fn a_failed_trial_is_named_by_the_status() {
    let (dir, config) = sweep_with("seeds", "seeds");
    let out = dir.path().join("out");
    let diverges = "training.phases.0.optimizer={ adam = { learning_rate = 1e300 } }";
    assert_eq!(run(&config, &out, &["--set", diverges]).code, Some(1));
    let text = status(&out);
    assert!(text.contains("16 trials: 0 done, 16 failed, 0 left"), "{text}");
    assert!(text.contains("NaN or infinite") && text.contains("failed: 11 more"), "{text}");
}
