//! From a `[sweep]` section to its trials: values that go together, shared trainings, candidates.

use crate::common::{parse, read};
use pinc_config::{Experiment, Trial, candidate, trials};
use pinc_mpc::Weight;
use std::collections::BTreeSet;

/// The trials of a config with this sweep.
fn made(config: &str, sets: &[&str]) -> (Experiment, Vec<Trial>) {
    let experiment = parse(&read(config), sets).unwrap();
    let trials = trials(&experiment).unwrap_or_else(|(key, problem)| panic!("{key}: {problem}"));
    (experiment, trials)
}

/// Horizons that are as long as one another, in each trial.
#[test]
fn keys_beside_an_axis_have_its_values_too() {
    let axis =
        "sweep={ grid = [{ key = \"control.n2\", also = [\"control.nu\"], values = [2, 3, 4] }] }";
    let (_, trials) = made("configs/smoke/rk4-only.toml", &[axis]);
    let horizons = trials.iter().map(|trial| {
        let control = trial.experiment.control.as_ref().unwrap();
        (control.n2, control.nu)
    });
    assert_eq!(horizons.collect::<Vec<_>>(), [(2, 2), (3, 3), (4, 4)]);
    assert!(trials.iter().all(|trial| trial.cells.len() == 2), "the axis and the seed");
}

/// A candidate by its place is what its trials run: in each cell of the grid, on each rung.
#[test]
fn a_candidate_has_the_values_of_its_trials() {
    let sets = [
        "sweep.grid=[{ key = \"control.n2\", values = [5, 6] }]",
        "sweep.search.candidates=3",
        "sweep.search.minimize=rk4_iae_dense_sum",
        "sweep.search.ranges=[{ key = \"control.r.0\", low = 0.1, high = 10.0 }]",
        "sweep.search.halving={ key = \"control.repetitions\", least = 1, factor = 2, rungs = 2 }",
    ];
    let (experiment, trials) = made("configs/smoke/rk4-only.toml", &sets);
    assert_eq!(trials.len(), 2 * 2 * 3);
    let values = |of: &Experiment| {
        let control = of.control.as_ref().unwrap();
        let Weight::Diagonal(r) = &control.r else { panic!("a diagonal") };
        (control.n2, control.repetitions, r[0].to_string())
    };
    for trial in &trials {
        let place = trial.search.unwrap();
        let (names, alone) = candidate(&experiment, place).unwrap();
        assert_eq!(values(&alone), values(&trial.experiment), "{place:?}");
        assert_eq!((values(&alone).0, values(&alone).1), (5 + place.group, 1 << place.rung));
        let number = (place.candidate + 1).to_string();
        let named = |column: &str| names.iter().find(|(of, _)| of == column).map(|(_, name)| name);
        assert_eq!(named("candidate"), Some(&number), "{names:?}");
        assert_eq!(named("control.n2"), Some(&(5 + place.group).to_string()));
        assert_eq!(named("seed"), None, "all seeds have it");
    }
    let different: BTreeSet<_> = trials.iter().map(|trial| values(&trial.experiment).2).collect();
    assert_eq!(different.len(), 3);
}

/// What is trained does not depend on what the experiment is called, nor on its loop.
#[test]
fn experiments_of_other_names_share_a_net() {
    let trainings = |sets: &[&str]| -> Vec<String> {
        let sets = [&["sweep.seeds=[1, 2]"], sets].concat();
        let (_, trials) = made("configs/smoke/van-der-pol.toml", &sets);
        trials.iter().map(|trial| trial.training.as_ref().unwrap().0.clone()).collect()
    };
    let own = trainings(&[]);
    assert_eq!(trainings(&["name=another"]), own);
    assert_eq!(trainings(&["control.n2=7"]), own);
    let larger = trainings(&["model.neurons=9"]);
    assert!(own.iter().all(|net| !larger.contains(net)) && own[0] != own[1], "{own:?}");
}
