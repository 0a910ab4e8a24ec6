//! Runs side by side.

use super::{CONFIG, METRICS, assert_sound, whole, write};
use crate::compare;
use std::path::PathBuf;
use tempfile::TempDir;

fn compared(dirs: &[&TempDir]) -> crate::Comparison {
    let dirs: Vec<PathBuf> = dirs.iter().map(|dir| dir.path().to_owned()).collect();
    compare(&dirs).unwrap()
}

#[test]
fn numbers_stand_beside_those_of_the_first_run_with_what_they_differ_by() {
    let (first, other) = (whole(), whole());
    // A twentieth of the validation error, and 1 % more IAE with PINC than 113.575.
    let better = METRICS.replace("1.11e-6", "5.55e-8").replace("113.575", "114.71075");
    write(&other, "metrics.json", &better);
    write(&other, "config.toml", &CONFIG.replace("neurons = 5", "neurons = 20"));
    let text = compared(&[&first, &other]).text;
    let line = |start: &str| {
        let mut lines = text.lines().map(str::trim);
        let line = lines.find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("{text}"));
        line.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(line("model.neurons"), "model.neurons 5 20");
    assert_eq!(
        line("Validation, MSE at the steps"),
        "Validation, MSE at the steps 1.11·10⁻⁶ 5.55·10⁻⁸ (× 0.05)"
    );
    let iae = line("IAE, dense trace");
    assert!(iae.ends_with("113.461 (0.10 % lower) 114.711 (1.0 % higher) 113.461 (0.10 % lower)"));
    assert!(!text.contains("model.hidden_layers"), "that is the same in both");
}

#[test]
fn traces_lie_in_one_picture_that_can_be_zoomed() {
    let (first, other) = (whole(), whole());
    let html = compared(&[&first, &other]).html;
    let svgs: Vec<&str> = html.split("<svg ").skip(1).collect();
    assert_eq!(svgs.len(), 3);
    for svg in &svgs {
        let svg = svg.split("</svg>").next().unwrap();
        assert_sound(&format!("<svg {svg}</svg>"));
    }
    assert_eq!(html.matches("<script type=\"application/json\">").count(), 3);
    // Two models in each of two runs, in a panel for each of three states and one input.
    let name = first.path().file_name().unwrap().to_str().unwrap();
    assert_eq!(svgs[0].matches(&format!(">{name}, PINC<")).count(), 4);
    // The reference is the same in both, and said once in each panel of a controlled state.
    assert_eq!(svgs[0].matches(">reference<").count(), 2);
}

#[test]
fn sweeps_and_runs_without_results_are_refused() {
    let (first, other) = (whole(), whole());
    let dirs = [first.path().to_owned(), other.path().to_owned()];
    write(&other, "config.toml", &format!("{CONFIG}\n[sweep]\nseeds = [1, 2]\n"));
    let error = compare(&dirs).unwrap_err().to_string();
    assert!(error.contains("a sweep, whose report compares its trials"), "{error}");
    write(&other, "config.toml", CONFIG);
    std::fs::remove_file(other.path().join("metrics.json")).unwrap();
    let error = compare(&dirs).unwrap_err().to_string();
    assert!(error.contains("no metrics.json"), "{error}");
}
