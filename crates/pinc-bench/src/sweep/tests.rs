//! Shares of a sweep, searches with halving, and parts that are merged.

use super::*;
use std::fs;
use std::sync::atomic::AtomicBool;

/// A sweep of loops with RK4 on a tank, with some values set.
fn experiment(sets: &[&str]) -> Experiment {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/rk4-only.toml");
    let short = ["control.duration_s=60.0", "control.repetitions=1"];
    let sets: Vec<String> = short.iter().chain(sets).map(|&set| set.to_owned()).collect();
    Experiment::load(path.as_ref(), &sets, &Plants::built_in()).unwrap()
}

const GRID: &str = "sweep.grid=[{ key = \"control.n2\", values = [5, 6, 7, 8, 9, 10, 11] }]";

static GO_ON: AtomicBool = AtomicBool::new(false);

fn options(resume: bool) -> Options<'static> {
    Options { resume, verbosity: Verbosity::Quiet, interrupt: &GO_ON, arguments: &[] }
}

/// The places of the trials of a share, in the order in which they are run.
fn share(experiment: &Experiment, shard: Shard) -> Vec<usize> {
    let trials = made(experiment).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let options = options(false);
    let session = Session::open(experiment, &trials, dir.path(), &options, shard.shared).unwrap();
    let own = session.share(shard).unwrap();
    own.iter().map(|own| trials.iter().position(|trial| trial.id == own.id).unwrap()).collect()
}

/// Every third trial is one of three shares; processes that share all trials begin with their own,
/// and go on with the next share.
#[test]
fn trials_are_dealt_out_in_turn() {
    let experiment = experiment(&[GRID]);
    let of = |number, shared| share(&experiment, Shard { number, of: 3, shared });
    assert_eq!(of(1, false), [0, 3, 6]);
    assert_eq!(of(2, false), [1, 4]);
    assert_eq!(of(3, false), [2, 5]);
    assert_eq!(of(1, true), [0, 3, 6, 1, 4, 2, 5]);
    assert_eq!(of(2, true), [1, 4, 2, 5, 0, 3, 6]);
    assert_eq!(of(3, true), [2, 5, 0, 3, 6, 1, 4]);
    assert_eq!(share(&experiment, Shard::WHOLE), [0, 1, 2, 3, 4, 5, 6]);
}

/// The rows of a table of trials, by the cells of some columns.
fn rows(run: &RunDir, columns: &[&str]) -> Vec<Vec<String>> {
    let text = fs::read_to_string(run.path(file::SWEEP)).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect());
    let head: Vec<String> = lines.next().unwrap();
    let places = columns.iter().map(|name| head.iter().position(|head| head == name).unwrap());
    let places: Vec<usize> = places.collect();
    lines.map(|row: Vec<String>| places.iter().map(|&place| row[place].clone()).collect()).collect()
}

/// Of four candidates two go on to loops that are run twice; the best of these is written with its
/// values, and the others' second trials are dropped.
#[test]
fn a_search_runs_the_better_half_again() {
    let search = "sweep.search={ candidates = 4, minimize = \"rk4_iae_dense_sum\", \
                  ranges = [{ key = \"control.r.0\", low = 0.1, high = 300.0, log = true }], \
                  halving = { key = \"control.repetitions\", least = 1, factor = 2, rungs = 2 } }";
    let experiment = experiment(&[search]);
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(units_left(&experiment, dir.path()).unwrap(), 8);
    let run = sweep(&experiment, dir.path(), &options(false), Shard::WHOLE).unwrap();
    let counts = run.metrics().sweep.as_ref().unwrap();
    assert_eq!((counts.trials, counts.done, counts.failed, counts.dropped), (8, 6, 0, 2));
    assert_eq!(units_left(&experiment, dir.path()).unwrap(), 0);
    assert_eq!(kept(&experiment, dir.path()), Some(Kept { trials: 6, nets: 0 }));

    let cells = rows(&run, &["control.r.0", "control.repetitions", "rk4_iae_dense_sum", "status"]);
    let iae = |row: &[String]| row[2].parse::<f64>().ok();
    let (first, second): (Vec<_>, Vec<_>) = cells.iter().partition(|row| row[1] == "1");
    assert_eq!((first.len(), second.len()), (4, 4));
    let mut order: Vec<f64> = first.iter().map(|row| iae(row).unwrap()).collect();
    order.sort_by(f64::total_cmp);
    for (one, two) in first.iter().zip(&second) {
        assert_eq!(one[0], two[0]);
        let is_left = iae(one).unwrap() <= order[1];
        assert_eq!(two[3], if is_left { "done" } else { "dropped" });
        assert_eq!(iae(two), is_left.then(|| iae(one).unwrap()), "the same loop");
    }
    let best = fs::read_to_string(run.path(file::BEST)).unwrap();
    let winner = first.iter().find(|row| iae(row) == Some(order[0])).unwrap();
    assert!(best.contains(&format!("control.r.0 = {}", winner[0])), "{best}");
    assert!(best.contains("name = \"smoke-rk4-only-best\""), "{best}");
    let said = status(dir.path(), &Plants::built_in()).unwrap().to_string();
    assert_eq!(
        said,
        "smoke-rk4-only: 8 trials: 6 done, 0 failed, 0 left\ndropped by the search: 2\nover"
    );
}

/// Two shares in directories of their own make the table of the whole; a part of another sweep is
/// refused.
#[test]
fn shares_are_merged_into_the_whole() {
    let grid = "sweep.grid=[{ key = \"control.n2\", values = [5, 7, 9] }]";
    let experiment = experiment(&[grid]);
    let root = tempfile::tempdir().unwrap();
    let [one, two, all] = ["one", "two", "all"].map(|name| root.path().join(name));
    let quiet = options(false);
    for (number, dir, done) in [(1, &one, 2), (2, &two, 1)] {
        let run = sweep(&experiment, dir, &quiet, Shard { number, of: 2, shared: false }).unwrap();
        let counts = run.metrics().sweep.as_ref().unwrap();
        assert_eq!((counts.trials, counts.done, counts.pending()), (3, done, 3 - done));
    }
    let parts = [one.clone(), two.clone()];
    let merged = merge(&parts, &all, &Plants::built_in(), &quiet).unwrap();
    assert_eq!(merged.metrics().sweep.as_ref().unwrap().done, 3);
    let columns = ["control.n2", "rk4_iae_dense_sum", "status"];
    let found = rows(&merged, &columns);
    let of = |dir: &PathBuf| rows(&RunDir::existing(dir).unwrap(), &columns);
    assert_eq!(found, [of(&one)[0].clone(), of(&two)[1].clone(), of(&one)[2].clone()]);
    assert!(found.iter().all(|row| row[2] == "done"), "{found:?}");

    // What a part has done already is done again only if it is asked for.
    assert_eq!(kept(&experiment, &all), Some(Kept { trials: 3, nets: 0 }));
    clear(&experiment, &all).unwrap();
    assert_eq!(kept(&experiment, &all), None);
    let other = self::experiment(&[grid, "control.q=[11.0]"]);
    let third = root.path().join("third");
    sweep(&other, &third, &options(false), Shard { number: 3, of: 3, shared: false }).unwrap();
    let parts = [one, third.clone()];
    let said = merge(&parts, &all, &Plants::built_in(), &quiet).unwrap_err().to_string();
    let begin = format!("{}: belongs to another sweep than ", third.display());
    assert!(said.starts_with(&begin), "{said}");
}

/// A trial that fails, as that of a plant which reaches infinity in 0.2 s, is counted, named in the table, and does not keep the others from being run.
#[test]
fn a_trial_that_fails_leaves_the_others() {
    let plant =
        "{ expression = { states = [\"h\"], inputs = [\"u\"], derivatives = { h = \"h^2\" } } }";
    let wrong = format!("{{ name = \"wrong\", set = {{ plant = {plant} }} }}");
    let cases = format!("sweep.cases=[{{ name = \"fine\", set = {{}} }}, {wrong}]");
    let experiment = experiment(&[&cases]);
    let dir = tempfile::tempdir().unwrap();
    let ended = sweep(&experiment, dir.path(), &options(false), Shard::WHOLE);
    let said = ended.unwrap_err().to_string();
    assert!(said.starts_with("1 of 2 trials failed; "), "{said}");
    let run = RunDir::existing(dir.path()).unwrap();
    assert_eq!(rows(&run, &["case", "status"]), [["fine", "done"], ["wrong", "failed"]]);
    let found = status(dir.path(), &Plants::built_in()).unwrap();
    assert_eq!((found.counts.done, found.counts.failed, found.failures.len()), (1, 1, 1));
}
