//! The configs in `configs/smoke/`, run in process, and what they leave in their directories.

use crate::common::repository;
use pinc_config::{Experiment, ModelKind, Plants};
use pinc_record::{Metrics, RunDir};
use pinc_runs::{Options, Verbosity};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicBool;

fn run(config: &str, sets: &[&str], dir: &Path) -> (Experiment, RunDir) {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let experiment =
        Experiment::load(&repository("configs/smoke").join(config), &sets, &Plants::built_in())
            .unwrap();
    let record = pinc_runs::run(&experiment, dir, &options(&AtomicBool::new(false))).unwrap();
    (experiment, record)
}

fn options(interrupt: &AtomicBool) -> Options<'_> {
    let arguments = &[];
    Options { resume: false, verbosity: Verbosity::Quiet, interrupt, arguments }
}

fn header(dir: &Path, file: &str) -> String {
    let text = std::fs::read_to_string(dir.join(file)).unwrap();
    text.lines().next().unwrap().to_owned()
}

fn rows(dir: &Path, file: &str) -> usize {
    std::fs::read_to_string(dir.join(file)).unwrap().lines().count() - 1
}

#[test]
fn van_der_pol_leaves_every_file() {
    let dir = tempfile::tempdir().unwrap();
    let (experiment, record) = run("van-der-pol.toml", &[], dir.path());
    let mut files: Vec<_> = std::fs::read_dir(dir.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    let expected = [
        "config.toml",
        "control-pinc.csv",
        "control-rk4.csv",
        "domain-error.csv",
        "figures",
        "metrics.json",
        "model-error.csv",
        "model.safetensors",
        "prediction.csv",
        "provenance.json",
        "report.html",
        "steps-pinc.csv",
        "steps-rk4.csv",
        "training.csv",
    ];
    assert_eq!(files, expected);

    let dir = dir.path();
    assert!(
        header(dir, "training.csv")
            .starts_with("iteration,loss_evaluations,elapsed_s,loss,validation_mse")
    );
    assert_eq!(header(dir, "prediction.csv"), "t,u,x1,x2,x1_truth,x2_truth,mark");
    assert_eq!(header(dir, "control-rk4.csv"), "t,x1,x2,u,x1_ref,x2_ref");
    assert_eq!(
        header(dir, "steps-pinc.csv"),
        "step,status,sqp_iterations,kkt,solve_us,violated,linearized,factorizations,active_changes"
    );
    // 4 T of 9 parts, and 10 steps of 9 points, each with the initial point.
    assert_eq!((rows(dir, "prediction.csv"), rows(dir, "control-pinc.csv")), (37, 91));
    assert_eq!(rows(dir, "steps-rk4.csv"), 10);
    assert_eq!(header(dir, "model-error.csv"), "t,x1_err,x1_true_err,x2_err,x2_true_err");
    assert_eq!(rows(dir, "model-error.csv"), 10);
    // The largest error of RK4 that `pinc certify` finds is 1.3e-3 of a width.
    let validation = record.metrics().validation.as_ref().unwrap();
    let proven = &validation.domain_error.as_ref().unwrap().proven;
    assert!((1.3e-3..1.66e-3).contains(&proven.rk4["4"]), "{proven:?}");
    assert_eq!(rows(dir, "training.csv"), 300);

    // The resolved config is the experiment again, and the metrics file what the run returned.
    assert_eq!(
        Experiment::load(&dir.join("config.toml"), &[], &Plants::built_in()).unwrap(),
        experiment
    );
    let text = std::fs::read(dir.join("metrics.json")).unwrap();
    assert_eq!(serde_json::from_slice::<Metrics>(&text).unwrap(), *record.metrics());
}

#[test]
fn the_net_controls_nearly_as_well_as_the_equation() {
    let dir = tempfile::tempdir().unwrap();
    let (_, record) = run("one-tank.toml", &[], dir.path());
    let metrics = record.metrics();
    let [pinc, rk4] = &metrics.control[..] else { panic!("{metrics:?}") };
    assert_eq!((pinc.model, rk4.model), (ModelKind::Pinc, ModelKind::RK4));
    for run in [pinc, rk4] {
        assert_eq!(run.status.get("converged"), Some(&20), "{run:?}");
        // The tolerance of the config.
        assert!(run.kkt_max <= 1e-8, "{run:?}");
        assert_eq!(run.wall_s.runs, 2);
        assert!(run.step_us.p50 <= run.step_us.p99 && run.step_us.p99 <= run.step_us.max);
    }
    // A one-step error of 1e-3 cm, hundred times the tiny net's, moves a level that is 0.8 cm from
    // its reference on average by far less than a hundredth.
    assert!(metrics.validation.as_ref().unwrap().one_step_mse < 1e-6);
    assert!((pinc.iae_dense_sum / rk4.iae_dense_sum - 1.0).abs() < 0.01);
}

#[test]
fn four_tanks_run() {
    let dir = tempfile::tempdir().unwrap();
    let (_, record) = run("four-tanks.toml", &[], dir.path());
    assert_eq!(header(dir.path(), "control-pinc.csv"), "t,h1,h2,h3,h4,u1,u2,h1_ref,h2_ref");
    assert_eq!(record.metrics().control.len(), 2);
    assert_eq!(record.metrics().variables["h1"], "cm");
}

#[test]
fn rk4_needs_no_training_and_has_files_without_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let (_, record) = run("rk4-only.toml", &[], dir.path());
    assert!(record.metrics().training.is_none());
    assert_eq!(rows(dir.path(), "control.csv"), 181);
    assert_eq!(rows(dir.path(), "steps.csv"), 20);
    assert!(!dir.path().join("model.safetensors").exists());
}

#[test]
fn the_papers_optimizers_run() {
    for preset in ["preset=as-printed", "preset=as-released"] {
        let dir = tempfile::tempdir().unwrap();
        let (_, record) = run("van-der-pol.toml", &[preset], dir.path());
        let training = record.metrics().training.as_ref().unwrap();
        assert_eq!(training.iterations, 100);
        assert_eq!(training.stop_reason, "iterations-done");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_on_one_and_two_threads() {
    let model = |sets: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        run("one-tank.toml", sets, dir.path());
        std::fs::read(dir.path().join("model.safetensors")).unwrap()
    };
    let one = model(&["training.threads=1"]);
    assert_eq!(one, model(&["training.threads=1"]));
    assert_eq!(one, model(&["training.threads=2"]));
    assert_ne!(one, model(&["seed=8"]));
}

#[test]
fn a_time_limit_ends_a_training_with_its_best_net() {
    let dir = tempfile::tempdir().unwrap();
    let sets = ["training.time_limit_s=0.02", "training.phases.0.iterations=1000000"];
    let (_, record) = run("one-tank.toml", &sets, dir.path());
    let training = record.metrics().training.as_ref().unwrap();
    assert_eq!(training.stop_reason, "time-limit");
    assert!(dir.path().join("model.safetensors").exists());
}

/// A training in memory gives the net of the run, and the best so far when it is stopped.
#[test]
fn a_watched_training_gives_the_net_of_a_run() {
    let dir = tempfile::tempdir().unwrap();
    let few = ["training.phases.0.iterations=120"];
    let (experiment, record) = run("van-der-pol.toml", &few, dir.path());
    let mut seen = Vec::new();
    let trained = pinc_runs::train_watched(&experiment, |now| {
        assert_eq!(now.iterations, 120);
        seen.push((now.iteration, now.validation_mse.is_some()));
        ControlFlow::Continue(())
    })
    .unwrap();
    assert!(seen.iter().map(|(iteration, _)| *iteration).eq(1..=120));
    assert!(!seen[48].1 && seen[49].1, "validated every 50 iterations");
    let file = std::fs::read(dir.path().join("model.safetensors")).unwrap();
    assert!(trained.net.to_bytes() == file, "another net");
    let metrics = record.metrics();
    let (training, validation) = (metrics.training.as_ref(), metrics.validation.as_ref());
    assert_eq!(trained.stop_reason, training.unwrap().stop_reason);
    assert_eq!(trained.totals.loss_evaluations, training.unwrap().loss_evaluations);
    assert!(trained.validation.mse_gen.total_cmp(&validation.unwrap().mse_gen).is_eq());
    let stopped = pinc_runs::train_watched(&experiment, |now| match now.iteration {
        7 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    });
    let stopped = stopped.unwrap();
    assert_eq!((stopped.stop_reason.as_str(), stopped.totals.iterations), ("stopped", 7));
}
