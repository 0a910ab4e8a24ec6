//! The pace of checkpoints, and threads that come and go.

use super::*;
use pinc_config::Plants;
use std::cell::Cell;
use std::sync::atomic::AtomicBool;

#[test]
fn checkpoints_take_a_small_share_of_time_and_disk() {
    let near = |found: f64, expected: f64| (found - expected).abs() < 1e-9;
    assert!(near(pause(5.0, Duration::from_millis(10), 100_000), 5.0));
    assert!(near(pause(5.0, Duration::from_millis(600), 100_000), 20.0));
    assert!(near(pause(5.0, Duration::from_millis(10), 256_000_000), 64.0));
    assert!(near(pause(90.0, Duration::from_millis(10), 256_000_000), 90.0));
}

/// The net of a training whose numbers of threads are in a list, one after the other.
fn trained(threads: &[usize]) -> (Vec<u8>, usize) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
    let set = "training.phases.0.iterations=60".to_owned();
    let experiment = Experiment::load(Path::new(path), &[set], &Plants::built_in()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let mut run_dir = RunDir::open(dir.path(), &experiment, 1).unwrap();
    let interrupt = AtomicBool::new(false);
    let (verbosity, interrupt) = (Verbosity::Quiet, &interrupt);
    let options = Options { resume: false, verbosity, interrupt, arguments: &[] };
    let looks = Cell::new(0);
    let now = || threads[looks.replace(looks.get() + 1) % threads.len()];
    let threads = Threads { now: &now, every: Duration::ZERO };
    let plant = experiment.plant.dyn_plant();
    let net = stage(&*plant, &experiment, &options, Some(&threads), &mut run_dir).unwrap();
    (net.to_bytes(), looks.get())
}

#[test]
fn threads_may_come_and_go_and_change_no_bit() {
    let (one, _) = trained(&[1]);
    let (changing, looks) = trained(&[1, 3, 3, 2]);
    assert!(looks > 20, "{looks}");
    assert!(one == changing);
}
