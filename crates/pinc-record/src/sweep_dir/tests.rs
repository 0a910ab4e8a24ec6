//! Results of a sweep in their directory.

use super::*;

#[test]
fn what_killed_processes_leave_is_removed_and_results_stay() {
    let dir = tempfile::tempdir().unwrap();
    let sweep = SweepDir::of(dir.path());
    let figures = sweep.net("b").join(file::FIGURES);
    let results = [sweep.net("a").join(file::METRICS), sweep.trial("c").join(RESULT)];
    let left = [
        sweep.net("a").join(LOCK),
        sweep.net("a").join(".pinc-unfinished-1"),
        figures.join(".pinc-unfinished-2"),
        sweep.trial("c").join(".pinc-unfinished-3"),
        dir.path().join(WORKERS).join("host-1.json"),
    ];
    for path in left.iter().chain(&results) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "").unwrap();
    }
    sweep.remove_leftovers().unwrap();
    let there = |path: &PathBuf| path.exists();
    assert!(!left.iter().any(there) && results.iter().all(there));
}

/// A net without its metrics, which are copied last, was not copied to its end.
#[test]
fn a_net_that_a_killed_merge_has_copied_in_part_is_copied() {
    let dir = tempfile::tempdir().unwrap();
    let [part, whole] = ["part", "whole"].map(|name| SweepDir::of(&dir.path().join(name)));
    for file in [part.net("n").join(file::MODEL), part.net("n").join(file::METRICS)] {
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, "right").unwrap();
    }
    fs::create_dir_all(part.trial("t")).unwrap();
    fs::create_dir_all(whole.net("n")).unwrap();
    fs::write(whole.net("n").join(file::MODEL), "").unwrap();
    whole.import_trial(&part, "t", Some("n")).unwrap();
    for name in [file::MODEL, file::METRICS] {
        assert_eq!(fs::read_to_string(whole.net("n").join(name)).unwrap(), "right");
    }
}

/// A result that was cut off when the machine stopped is none, and is written anew.
#[test]
fn a_damaged_result_is_none() {
    let dir = tempfile::tempdir().unwrap();
    let sweep = SweepDir::of(dir.path());
    let finished = crate::search::tests::finished(2.0);
    for id in ["a", "b"] {
        sweep.begin(id).unwrap();
        sweep.finish(id, &finished).unwrap();
    }
    fs::create_dir_all(sweep.net("n")).unwrap();
    fs::write(sweep.net("n").join(file::METRICS), "{}").unwrap();
    sweep.begin("c").unwrap();
    assert_eq!(sweep.results(), (2, 1));
    assert_eq!(sweep.finished("a").unwrap().as_ref(), Some(&finished));
    assert_eq!(sweep.finished("c").unwrap(), None);
    let text = fs::read_to_string(sweep.trial("b").join(RESULT)).unwrap();
    fs::write(sweep.trial("b").join(RESULT), &text[..text.len() / 2]).unwrap();
    assert_eq!(sweep.finished("b").unwrap(), None);
    // What an attempt left is gone when the next begins.
    fs::write(sweep.trial("b").join("trace.csv"), "t").unwrap();
    let place = sweep.begin("b").unwrap();
    assert_eq!(fs::read_dir(place).unwrap().count(), 0);
    sweep.clear().unwrap();
    assert_eq!(sweep.results(), (0, 0));
}

/// A process that has said nothing for a minute is not at work.
#[test]
fn notes_are_fresh_for_a_minute() {
    let dir = tempfile::tempdir().unwrap();
    let sweep = SweepDir::of(dir.path());
    let note = WorkerNote {
        at_s: 100.0,
        lanes: 1,
        trained: 2.0,
        trained_s: 3.0,
        trials: 4.0,
        trials_s: 5.0,
    };
    sweep.write_note("host-1", &note).unwrap();
    let _claim = sweep.claim("part", 1).unwrap().unwrap();
    assert_eq!(sweep.notes(), std::slice::from_ref(&note));
    assert!(note.is_fresh(159.0) && !note.is_fresh(161.0));
    sweep.remove_note("host-1");
    assert_eq!(sweep.notes(), []);
}
