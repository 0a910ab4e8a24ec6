//! Run directories.

use super::*;
use pinc_config::Plants;

#[test]
fn a_run_that_another_process_begins_is_no_strangers_directory_at_any_moment() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
    let experiment = Experiment::load(Path::new(path), &[], &Plants::built_in()).unwrap();
    let root = tempfile::tempdir().unwrap();
    for run in 0..100 {
        let dir = root.path().join(run.to_string());
        fs::create_dir(&dir).unwrap();
        std::thread::scope(|scope| {
            let begin = scope.spawn(|| RunDir::open_shared(&dir, &experiment, 1).map(drop));
            while !begin.is_finished() {
                check_owner(&dir, &experiment).unwrap();
            }
            begin.join().unwrap().unwrap();
        });
    }
}

fn experiment(sets: &[&str]) -> Experiment {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    Experiment::load(Path::new(path), &sets, &Plants::built_in()).unwrap()
}

/// A directory is the run's own if it is empty or has its config, and nobody else's.
#[test]
fn a_directory_of_something_else_is_left_alone() {
    let root = tempfile::tempdir().unwrap();
    let dir = root.path().join("run");
    let open = |sets: &[&str]| RunDir::open(&dir, &experiment(sets), 1);
    drop(open(&[]).unwrap());
    assert!(RunDir::is_of(&dir, &experiment(&[])));
    assert!(!RunDir::is_of(&dir, &experiment(&["seed=8"])));
    drop(open(&[]).unwrap());
    let text = fs::read_to_string(dir.join(file::CONFIG)).unwrap();
    let other = open(&["seed=8"]).unwrap_err();
    assert!(matches!(other, RecordError::OtherConfig { .. }), "{other}");
    assert_eq!(fs::read_to_string(dir.join(file::CONFIG)).unwrap(), text);
    // A directory with files but without a config belongs to somebody else.
    let photos = root.path().join("photos");
    fs::create_dir(&photos).unwrap();
    fs::write(photos.join("cat.jpg"), "cat").unwrap();
    let refused = RunDir::open(&photos, &experiment(&[]), 1).unwrap_err();
    assert!(matches!(refused, RecordError::NoRunDirectory { .. }), "{refused}");
    assert_eq!(fs::read_dir(&photos).unwrap().count(), 1);
    for (place, is_run) in [(&dir, true), (&photos, false), (&root.path().join("no"), false)] {
        assert_eq!(RunDir::expect(place).is_ok(), is_run, "{}", place.display());
    }
}

/// A file is as it was noted if its content is; one that was not noted only has to be there.
#[test]
fn files_are_compared_with_what_was_noted() {
    let dir = tempfile::tempdir().unwrap();
    let mut run = RunDir::open(dir.path(), &experiment(&[]), 1).unwrap();
    assert!(!run.is_as_noted("a.csv"));
    run.write("a.csv", b"1,2").unwrap();
    assert!(run.is_as_noted("a.csv"), "not noted, and there");
    run.note(&["a.csv", "b.csv"]);
    assert_eq!(run.metrics().files.len(), 1);
    assert!(run.is_as_noted("a.csv"));
    run.write("a.csv", b"1,3").unwrap();
    assert!(!run.is_as_noted("a.csv"), "of the same length");
    run.remove("a.csv").unwrap();
    assert!(run.metrics().files.is_empty() && !run.is_as_noted("a.csv"));
    run.note(&["a.csv"]);
    assert!(run.metrics().files.is_empty());
    run.remove("a.csv").unwrap();
}

/// A run that goes on keeps its beginning and adds itself; one that begins anew does not.
#[test]
fn the_origin_of_a_run_has_each_time_it_was_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let experiment = experiment(&[]);
    let run = RunDir::open(dir.path(), &experiment, 1).unwrap();
    let started = |started: &str| {
        let invocation = serde_json::json!({
            "started": started, "command": ["pinc"], "version": "1", "rustc": "r",
            "git_commit": "0123456789abcdef", "git_dirty": true, "target": "t",
            "profile": "release", "cpu": "c", "cores": 2, "os": "o",
        });
        Provenance::of(&experiment, serde_json::from_value(invocation).unwrap())
    };
    let read = || {
        let read = Provenance::read(dir.path()).unwrap().unwrap();
        assert_eq!((read.seed, &read.config_sha256), (7, &experiment.fingerprint()));
        read.invocations().map(|of| of.started.clone()).collect::<Vec<_>>()
    };
    for (name, resume, expected) in [
        ("a", true, &["a"][..]),
        ("b", true, &["a", "b"]),
        ("c", true, &["a", "b", "c"]),
        ("d", false, &["d"]),
    ] {
        run.write_provenance(&started(name), resume).unwrap();
        assert_eq!(read(), expected);
    }
    assert_eq!(started("a").begun.source(), "0123456789ab and changes");
}
