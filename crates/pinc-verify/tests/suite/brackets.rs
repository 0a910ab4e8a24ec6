//! Branch and bound over whole domains.

use crate::support::{ends, equations, fresh_net, lattice, net_model, rk4, truth};
use pinc_expr::PlantEquations;
use pinc_net::Domain;
use pinc_ode::{DynRhs, Integrator, Model, Tableau};
use pinc_plants::VanDerPol;
use pinc_verify::{Bracket, Search, SearchSettings, StepError, StepModel, VerifyError};

fn oscillator() -> PlantEquations {
    PlantEquations::traced(VanDerPol::default())
}

fn domain() -> Domain {
    Domain::new([-2.0..=2.0, -3.0..=3.0], [-1.0..=1.0])
}

fn of(ratio: f64) -> SearchSettings {
    SearchSettings { ratio, points: 300, ..SearchSettings::default() }
}

fn search(error: &StepError, ends: &[[f64; 2]], ratio: f64, rounds: usize) -> Search {
    let mut search = Search::new(error, ends, of(ratio), 2).unwrap();
    for _ in 0..rounds {
        if search.is_over() {
            break;
        }
        search.round(error, 2);
    }
    search
}

/// No sampled error is above its leaf's bound, some come close to the bracket, and all is covered.
fn check_against_truth(
    search: &Search,
    bracket: &Bracket,
    plant: &dyn DynRhs,
    model: &mut dyn Model,
    closest: f64,
) {
    let mut largest = vec![0.0_f64; bracket.proven.len()];
    let whole: Vec<[f64; 2]> = search.leaves().fold(Vec::new(), |hull, leaf| {
        let pairs = hull.iter().zip(&leaf.ends);
        let wider = |(a, b): (&[f64; 2], &[f64; 2])| [a[0].min(b[0]), a[1].max(b[1])];
        if hull.is_empty() { leaf.ends } else { pairs.map(wider).collect() }
    });
    for point in lattice(&whole, 1500) {
        let inside = |ends: &[[f64; 2]]| {
            ends.iter().zip(&point).all(|([low, high], v)| low <= v && v <= high)
        };
        let leaf = search.leaves().find(|leaf| inside(&leaf.ends)).expect("all is covered");
        for (i, error) in truth(plant, model, &point).into_iter().enumerate() {
            let (state, bound) = leaf.bounds[i];
            let bound = bound.unwrap_or(f64::INFINITY);
            assert_eq!(state, i, "the oscillator has one part");
            assert!(error.abs() <= bound + 1e-10, "{point:?}: {error} {bound}");
            largest[i] = largest[i].max(error.abs());
        }
    }
    for (i, found) in bracket.found.iter().enumerate() {
        assert!(largest[i] <= found.error * (1.0 + 1e-6), "{largest:?} {bracket:?}");
        assert!(largest[i] >= closest * bracket.proven[i], "{largest:?} {bracket:?}");
        let at = truth(plant, model, &found.at)[i].abs();
        assert!((at / found.error - 1.0).abs() < 0.03, "{at} {found:?}");
    }
}

#[test]
fn the_error_of_a_net_is_bracketed() {
    let net = fresh_net(&domain());
    let error = StepError::new(&oscillator(), &[], 1, StepModel::Net(&net), 0.3).unwrap();
    let search = search(&error, &ends(&domain()), 1.1, 40);
    let bracket = search.bracket();
    assert!(bracket.is_complete && bracket.unproven_volume == 0.0, "{bracket:?}");
    for (proven, found) in bracket.proven.iter().zip(&bracket.found) {
        assert!(*proven >= found.error && *proven <= 1.1 * found.error * (1.0 + 1e-9));
    }
    let plant = VanDerPol::default();
    check_against_truth(&search, &bracket, &plant, &mut net_model(&net), 0.6);
}

#[test]
fn the_error_of_runge_kutta_is_bracketed() {
    let plant = VanDerPol::default();
    for substeps in [1, 3] {
        let model = StepModel::RungeKutta(Tableau::CLASSICAL, substeps);
        let error = StepError::new(&oscillator(), &[], 1, model, 0.3).unwrap();
        let search = search(&error, &ends(&domain()), 1.2, 60);
        let bracket = search.bracket();
        assert!(bracket.is_complete, "{bracket:?}");
        check_against_truth(&search, &bracket, &plant, &mut rk4(substeps), 0.3);
    }
    let five = StepModel::RungeKutta(Tableau::DORMAND_PRINCE, 1);
    let error = StepError::new(&oscillator(), &[], 1, five, 0.3).unwrap();
    let narrow = Domain::new([-1.0..=1.0, -1.0..=1.0], [-1.0..=1.0]);
    let bracket = search(&error, &ends(&narrow), 1.3, 60).bracket();
    assert!(bracket.is_complete && bracket.found[1].error < 1e-4, "{bracket:?}");
}

/// A proof with little work is as near, and never below an error; elsewhere there is none.
#[test]
fn a_small_proof_is_near_or_none() {
    let plant = VanDerPol::default();
    let model = StepModel::RungeKutta(Tableau::CLASSICAL, 2);
    let error = StepError::new(&oscillator(), &[], 1, model, 0.3).unwrap();
    let ends = ends(&domain());
    let proven = error.small_proof(&ends, 1).unwrap();
    assert_eq!(error.small_proof(&ends, 3).as_ref(), Some(&proven));
    let bracket = search(&error, &ends, 1.1, 60).bracket();
    for (i, (proven, found)) in proven.iter().zip(&bracket.found).enumerate() {
        let at = truth(&plant, &mut rk4(2), &found.at)[i].abs();
        assert!(*proven >= at && *proven <= 1.26 * at, "{proven} {at}");
    }
    // A kink through the domain.
    let kink = equations(&[("x", "u - max(x, 0.5)")]);
    let error = StepError::new(&kink, &[], 1, model, 0.5).unwrap();
    assert_eq!(error.small_proof(&[[0.0, 1.0], [0.0, 0.2]], 1), None);
}

/// The oscillator again, beside which so many terms do next to nothing.
#[test]
fn work_for_a_small_proof_grows_with_the_equation() {
    for (terms, is_proven) in [(0, true), (1000, false)] {
        let small: String = (1..=terms).map(|k| format!(" + x1*{k}e-30")).collect();
        let second = format!("(1 - x1^2)*x2 - x1 + u{small}");
        let plant = equations(&[("x1", "x2"), ("x2", &second)]);
        let model = StepModel::RungeKutta(Tableau::CLASSICAL, 2);
        let error = StepError::new(&plant, &[], 1, model, 0.3).unwrap();
        assert_eq!(error.small_proof(&ends(&domain()), 1).is_some(), is_proven, "{terms}");
    }
}

/// A goal below the true maximum is never proven.
#[test]
fn a_bound_below_the_largest_error_is_not_proven() {
    let net = fresh_net(&domain());
    let error = StepError::new(&oscillator(), &[], 1, StepModel::Net(&net), 0.3).unwrap();
    let bracket = search(&error, &ends(&domain()), 0.95, 25).bracket();
    assert!(!bracket.is_complete);
    for (proven, found) in bracket.proven.iter().zip(&bracket.found) {
        assert!(*proven >= found.error, "{bracket:?}");
    }
}

/// One error beyond its tolerance is enough, whatever is asked of the other state.
#[test]
fn an_error_beyond_its_tolerance_refutes_it() {
    let net = fresh_net(&domain());
    let error = StepError::new(&oscillator(), &[], 1, StepModel::Net(&net), 0.3).unwrap();
    let refuted = |tolerance: Option<[f64; 2]>| {
        let tolerance = tolerance.map(Vec::from);
        let settings = SearchSettings { tolerance, ..of(1.1) };
        Search::new(&error, &ends(&domain()), settings, 1).unwrap().is_refuted()
    };
    assert!(!refuted(None));
    assert!(!refuted(Some([f64::INFINITY; 2])) && !refuted(Some([100.0; 2])));
    assert!(refuted(Some([1e-6, f64::INFINITY])));
    assert!(refuted(Some([f64::INFINITY, 1e-6])));
    assert!(refuted(Some([1e-6; 2])));
}

/// Whatever the number of threads, and whether it was stored meanwhile, a search is the same.
#[test]
fn searches_can_be_stored_and_do_not_depend_on_threads() {
    let net = fresh_net(&domain());
    let error = StepError::new(&oscillator(), &[], 1, StepModel::Net(&net), 0.3).unwrap();
    let run = |threads: usize, store: bool| {
        let mut search = Search::new(&error, &ends(&domain()), of(1.2), threads).unwrap();
        for _ in 0..8 {
            search.round(&error, threads);
            if store {
                let text = serde_json::to_string(&search).unwrap();
                search = serde_json::from_str(&text).unwrap();
            }
        }
        serde_json::to_string(&search).unwrap()
    };
    let one = run(1, false);
    assert!(run(3, false) == one && run(2, true) == one);
}

/// Where the equation is not smooth nothing is proven, and the rest is.
#[test]
fn what_is_not_smooth_is_unproven() {
    let tank = equations(&[("h", "u - sqrt(h)")]);
    let model = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
    let error = StepError::new(&tank, &[], 1, model, 0.5).unwrap();
    let bracket = search(&error, &[[0.0, 4.0], [0.0, 1.0]], 1.5, 12).bracket();
    assert!((0.001..0.2).contains(&bracket.unproven_volume), "{bracket:?}");
    let bracket = search(&error, &[[1.0, 4.0], [0.0, 1.0]], 1.5, 30).bracket();
    assert!(bracket.is_complete && bracket.unproven_volume == 0.0, "{bracket:?}");
    // A kink at x = 1/2 through the domain.
    let kink = equations(&[("x", "u - max(x, 0.5)")]);
    let error = StepError::new(&kink, &[], 1, model, 0.5).unwrap();
    let bracket = search(&error, &[[0.0, 1.0], [0.0, 0.2]], 1.5, 12).bracket();
    assert!(bracket.unproven_volume > 0.001 && !bracket.is_complete, "{bracket:?}");
    // With a jump there errors are those of steps across it, which nothing encloses.
    let jump = equations(&[("x", "u - sign(x - 0.5)")]);
    let error = StepError::new(&jump, &[], 1, model, 0.5).unwrap();
    let bracket = search(&error, &[[0.0, 1.0], [0.0, 0.2]], 1.5, 2).bracket();
    assert!(bracket.found[0].error > 1e-3, "{bracket:?}");
}

/// In a step v moves by more than its distance from the kink at 0, but away from it.
#[test]
fn a_kink_that_trajectories_move_away_from_is_no_obstacle() {
    let cart = equations(&[("v", "u - v*abs(v)")]);
    let model = StepModel::RungeKutta(Tableau::CLASSICAL, 4);
    let error = StepError::new(&cart, &[], 1, model, 0.5).unwrap();
    let bracket = search(&error, &[[0.1, 2.0], [0.0, 2.0]], 1.1, 10).bracket();
    assert!(bracket.is_complete && bracket.boxes < 100, "{bracket:?}");
}

/// A state is searched over the variables that it depends on; what is found of each is put together.
#[test]
fn states_that_need_fewer_variables_are_searched_over_these() {
    let chain = equations(&[("x", "u - x - 0.2*x^3"), ("y", "x - 2*sin(y)")]);
    let plant = chain.to_dyn().unwrap();
    let mut model = plant.model(Integrator::Rk4, 0.5, 1).unwrap();
    let step = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
    let error = StepError::new(&chain, &[], 1, step, 0.5).unwrap();
    let domain = [[-1.0, 1.0], [-2.0, 3.0], [-1.0, 1.0]];
    let search = search(&error, &domain, 1.2, 60);
    let bracket = search.bracket();
    assert!(bracket.is_complete && bracket.unproven_volume == 0.0, "{bracket:?}");
    for (i, found) in bracket.found.iter().enumerate() {
        let at = truth(&*plant, &mut *model, &found.at)[i].abs();
        assert!((at / found.error - 1.0).abs() < 0.03, "{at} {found:?}");
        assert!(bracket.proven[i] >= at && bracket.proven[i] <= 1.21 * at, "{bracket:?}");
    }
    let (first, both): (Vec<_>, Vec<_>) =
        search.leaves().partition(|leaf| leaf.bounds.iter().any(|(state, _)| *state == 0));
    let is_whole = |[low, high]: [f64; 2]| (high - low - 5.0).abs() < 1e-12;
    assert!(first.iter().all(|leaf| leaf.bounds.len() == 1 && is_whole(leaf.ends[1])));
    assert!(both.iter().all(|leaf| leaf.bounds[0].0 == 1));
    for leaves in [first, both] {
        let volume = |ends: &[[f64; 2]]| ends.iter().map(|[l, h]| h - l).product::<f64>();
        let sum: f64 = leaves.iter().map(|leaf| volume(&leaf.ends)).sum();
        assert!((sum / volume(&domain) - 1.0).abs() < 1e-12, "{sum}");
    }
}

/// Parameters of a family are variables as the others.
#[test]
fn parameters_are_variables_too() {
    let model = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
    let error = StepError::new(&oscillator(), &["mu"], 1, model, 0.3).unwrap();
    let domain = [[-1.0, 1.0], [-1.0, 1.0], [0.0, 0.1], [0.5, 2.0]];
    let bracket = search(&error, &domain, 1.3, 40).bracket();
    assert!(bracket.is_complete, "{bracket:?}");
    // The error is largest at the largest mu.
    assert!(bracket.found[1].at[3] > 1.9, "{bracket:?}");
    let stronger = PlantEquations::traced(VanDerPol { mu: 2.0 });
    let error = StepError::new(&stronger, &[], 1, model, 0.3).unwrap();
    let alone = search(&error, &domain[..3], 1.3, 40).bracket();
    assert!((alone.found[1].error / bracket.found[1].error - 1.0).abs() < 0.1);
}

#[test]
fn what_cannot_be_searched_is_reported() {
    let wide = equations(&[
        ("a", "b"),
        ("b", "c"),
        ("c", "d"),
        ("d", "e"),
        ("e", "f"),
        ("f", "g"),
        ("g", "u"),
    ]);
    let model = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
    let error = StepError::new(&wide, &[], 1, model, 0.5).unwrap();
    let found = Search::new(&error, &[[0.0, 1.0]; 8], of(1.1), 1).unwrap_err();
    assert!(matches!(found, VerifyError::TooManyVariables { found: 8 }), "{found}");
    let error = StepError::new(&oscillator(), &[], 1, model, 0.5).unwrap();
    let found = Search::new(&error, &[[0.0, 1.0]; 2], of(1.1), 1).unwrap_err();
    assert!(matches!(found, VerifyError::Domain { found: 2, expected: 3 }), "{found}");
}
