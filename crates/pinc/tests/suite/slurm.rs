//! Sweeps given to Slurm: the scripts, what they do without it, and what is said to it. `.ci/slurm`
//! tries them on a real one.
#![cfg(unix)]

use crate::common::{Outcome, outcome, pinc};
use crate::sweep::{read, run, sweep_with, tables};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

fn on_slurm(config: &Path, out: &Path, more: &[&str], path: &str) -> Outcome {
    let arguments = ["run".as_ref(), config.as_os_str(), "--out".as_ref()];
    let mut command = pinc(&arguments);
    command.arg(out).args(["--on", "slurm"]).args(more).env("PATH", path);
    outcome(&mut command)
}

fn script(path: &Path, text: &str) {
    fs::write(path, format!("#!/bin/sh\n{text}\n")).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn the_scripts_do_the_whole_sweep_by_hand() {
    let (dir, config) = sweep_with("iterations = 400", "iterations = 3");
    let text = fs::read_to_string(&config).unwrap();
    let options = "[sweep.slurm]\npartition = \"short\"\nmodules = [\"gcc/12\"]\n\n[[sweep.cases]]";
    fs::write(&config, text.replacen("[[sweep.cases]]", options, 1)).unwrap();
    let (whole, out) = (dir.path().join("whole"), dir.path().join("it's out"));
    assert_eq!(run(&config, &whole, &[]).code, Some(0));
    let more =
        ["--dry-run", "--jobs", "3", "--slurm", "partition=long", "--slurm", "modules=a,b/1"];
    let written = on_slurm(&config, &out, &more, "/usr/bin:/bin");
    assert_eq!(written.code, Some(0), "{written:?}");
    assert!(written.stdout.contains("work.sh: one of 3 jobs"), "{written:?}");
    let work = read(&out.join("slurm"), "work.sh");
    for part in ["--array=1-3\n", "--partition=long\n", "--cpus-per-task=1\n", "load a b/1\n"] {
        assert!(work.contains(part), "{part}: {work}");
    }
    // Without the modules, which are not here.
    for name in ["work.sh", "merge.sh"] {
        let path = out.join("slurm").join(name);
        let text = fs::read_to_string(&path).unwrap().replace("module load", "echo");
        fs::write(path, text).unwrap();
    }
    let sh = |name: &str, more: &[&str]| {
        let mut command = Command::new("sh");
        outcome(
            command.arg(out.join("slurm").join(name)).args(more).env("SLURM_CPUS_PER_TASK", "3"),
        )
    };
    assert!(sh("work.sh", &[]).stderr.contains("which share, 1 to 3"));
    for share in ["2", "3", "1"] {
        assert_eq!(sh("work.sh", &[share]).code, Some(0));
    }
    assert!(read(&out, "provenance.json").contains("\"cores\": 3"));
    assert_eq!(sh("merge.sh", &[]).code, Some(0));
    assert_eq!(tables(&out), tables(&whole));
    let again = on_slurm(&config, &out, &[], "/usr/bin:/bin");
    assert!(again.stdout.contains("nothing to submit"), "{again:?}");
}

#[test]
fn a_sweep_is_submitted_once_at_a_time() {
    let (dir, config) = sweep_with("iterations = 400", "iterations = 3");
    let (bin, out) = (dir.path().join("bin"), dir.path().join("out"));
    fs::create_dir(&bin).unwrap();
    let path = format!("{}:/usr/bin:/bin", bin.display());
    let missing = on_slurm(&config, &out, &[], &path);
    assert_eq!(missing.code, Some(1), "{missing:?}");
    assert!(missing.stderr.contains("--dry-run"), "{missing:?}");
    // Numbers with the name of a cluster, as some have them; what is asked for is in a file.
    let said = bin.join("said");
    script(
        &bin.join("sbatch"),
        &format!("echo \"$@\" >> '{0}'; echo $((40 + $(wc -l < '{0}')))\\;one", said.display()),
    );
    script(&bin.join("squeue"), "test \"$4\" = 42 && echo PENDING");
    let submitted = on_slurm(&config, &out, &["--jobs", "2"], &path);
    assert_eq!(submitted.code, Some(0), "{submitted:?}");
    assert!(submitted.stdout.contains("41, 42 (2 jobs"), "{submitted:?}");
    let asked = fs::read_to_string(&said).unwrap();
    assert!(asked.lines().nth(1).unwrap().contains("--dependency=afterany:41 "), "{asked}");
    let again = on_slurm(&config, &out, &[], &path);
    assert_eq!(again.code, Some(1), "{again:?}");
    assert!(again.stderr.contains("still in Slurm's queue: 42"), "{again:?}");
    let mut status = pinc(&["status"]);
    let status = outcome(status.arg(&out).env("PATH", &path)).stdout;
    assert!(status.contains("16 left") && status.contains("in Slurm's queue: 42"), "{status}");
    // Once they are over, it is submitted again.
    script(&bin.join("squeue"), "exit 1");
    assert_eq!(on_slurm(&config, &out, &[], &path).code, Some(0));
}

#[test]
fn mistakes_in_options_are_named() {
    let (dir, config) = sweep_with("seeds", "seeds");
    let out = dir.path().join("out");
    let refused = |option: &str, parts: &[&str]| {
        on_slurm(&config, &out, &["--slurm", option], "/usr/bin:/bin").assert_refused(parts);
        assert!(!out.exists());
    };
    refused("partition", &["--slurm partition", "key=value"]);
    refused("array=1-3", &["array=1-3", "the scripts set this one"]);
    refused("time=$(rm)", &["time=$(rm)", "without spaces and quotes"]);
    run(&config, &out, &["--set", "sweep.slurm.jobs=0"])
        .assert_refused(&["`sweep.slurm.jobs`", "from 1 to 10000"]);
    let smoke = crate::common::repository("configs/smoke/rk4-only.toml");
    on_slurm(&smoke, &out, &["--dry-run"], "/usr/bin").assert_refused(&["section [sweep]"]);
    assert_eq!(run(&config, &out, &["--jobs", "3"]).code, Some(2));
}
