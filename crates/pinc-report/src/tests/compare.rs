//! Runs side by side.

use super::{CONFIG, METRICS, assert_sound, whole, write};
use crate::compare;
use crate::testing::Plot;
use std::path::PathBuf;
use tempfile::TempDir;

fn compared(dirs: &[&TempDir]) -> crate::Comparison {
    let dirs: Vec<PathBuf> = dirs.iter().map(|dir| dir.path().to_owned()).collect();
    compare(&dirs).unwrap()
}

#[test]
fn numbers_are_shown_beside_the_first_runs_with_their_differences() {
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
    assert_eq!(svgs.len(), 4);
    for svg in &svgs {
        let svg = svg.split("</svg>").next().unwrap();
        assert_sound(&format!("<svg {svg}</svg>"));
    }
    assert_eq!(html.matches("<script type=\"application/json\">").count(), 4);
    // Two models in each of two runs, in a panel for each of three states and one input.
    let name = first.path().file_name().unwrap().to_str().unwrap();
    assert_eq!(svgs[0].matches(&format!(">{name}, PINC<")).count(), 4);
    // The reference is the same in both, and said once in each panel of a controlled state.
    assert_eq!(svgs[0].matches(">reference<").count(), 2);
}

#[test]
fn two_models_have_a_picture_of_their_difference_above_the_numbers() {
    let (first, other) = (whole(), whole());
    for (dir, gone) in [(&first, "pinc"), (&other, "rk4")] {
        for kind in ["control", "steps"] {
            std::fs::remove_file(dir.path().join(format!("{kind}-{gone}.csv"))).unwrap();
        }
        let mut metrics: serde_json::Value = serde_json::from_str(METRICS).unwrap();
        let loops = metrics["control"].as_array_mut().unwrap();
        loops.retain(|of| of["model"] != gone);
        write(dir, "metrics.json", &metrics.to_string());
    }
    let compared = compared(&[&first, &other]);
    assert!(!compared.text.contains("nothing"), "{}", compared.text);
    let row = compared.text.lines().find(|line| line.contains("models that ran")).unwrap();
    assert_eq!(
        row.split_whitespace().collect::<Vec<_>>(),
        ["models", "that", "ran", "RK4", "PINC"]
    );
    let html = &compared.html;
    let sections = ["control", "differences", "metrics", "training", "steps"];
    let places = sections.map(|id| html.find(&format!("<section id=\"{id}\">")).unwrap());
    assert!(places.is_sorted(), "{places:?}");
    let svg = html.split("<svg ").nth(2).unwrap().split("</svg>").next().unwrap();
    // The loop with PINC is off by 1e-4 t.
    let plot = Plot::read(svg, "Difference of a");
    assert_eq!(plot.label, "Δa (cm)");
    assert!(svg.contains(">t (s)<"), "the panel that is drawn has the axis of time");
    let name = other.path().file_name().unwrap().to_str().unwrap();
    plot.assert_follows(&plot.lines(name)[0], |t| 1e-4 * t);
    assert!(svg.contains("b is the same in all loops"), "b does not differ");
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
