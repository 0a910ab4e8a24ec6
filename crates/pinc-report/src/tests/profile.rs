//! Plants with arrays: few of their elements have curves, all of them are in profiles.

use super::{CONFIG, assert_sound, build, figures, stems, svg, whole, write};
use std::fmt::Write as _;
use tempfile::TempDir;

/// A loop of a plant with the states T\[1\] to T\[12\], of which the third is controlled.
fn with_array() -> TempDir {
    let dir = whole();
    let controlled = CONFIG.replace("controlled = [\"a\", \"b\"]", "controlled = [\"T[3]\"]");
    assert_ne!(controlled, CONFIG);
    let states = format!("initial_state = {:?}", [0.0; 12]);
    let controlled = controlled.replace("initial_state = [0.0, 1.0, 1.0]", &states);
    write(&dir, "config.toml", &controlled);
    let names: Vec<_> = (1..=12).map(|i| format!("T[{i}]")).collect();
    for (model, offset) in [("pinc", 1e-4), ("rk4", 0.0)] {
        let mut table = format!("t,{},u,T[3]_ref\n", names.join(","));
        for k in 0..200 {
            let t = 0.25 * f64::from(k);
            let _ = write!(table, "{t}");
            for i in 1..=12 {
                let value = f64::from(i) * (1.0 - (-t / f64::from(i)).exp()) + offset * t;
                let _ = write!(table, ",{value}");
            }
            let _ = writeln!(table, ",0.5,2.5");
        }
        write(&dir, &format!("control-{model}.csv"), &table);
    }
    dir
}

#[test]
fn an_array_has_profiles_and_few_curves() {
    let dir = with_array();
    assert!(stems(dir.path()).contains(&"profiles".to_owned()));
    let profiles = svg(dir.path(), "profiles");
    assert_sound(&profiles);
    assert!(profiles.contains("T[1..12]") && profiles.contains("index"));
    let page = build(dir.path()).unwrap();
    let plain = page.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(plain.contains("at 7 times from the first to the last. From control-pinc.csv."));
    assert!(plain.contains("in T[1..12] (lowest panel"), "the difference of the array");
    // The first, the middle, the last and the controlled one.
    let control = svg(dir.path(), "control");
    assert_sound(&control);
    for (name, is_shown) in [("T[1]", true), ("T[2]", false), ("T[3]", true), ("T[6]", true)] {
        assert_eq!(control.contains(&format!("{name} with")), is_shown, "{name}");
    }
    let csv = figures(dir.path()).into_iter().find(|figure| figure.name == "profiles").unwrap().csv;
    let csv = String::from_utf8(csv).unwrap();
    // Twelve points of each of seven times, and the names of the columns.
    assert_eq!(csv.lines().count(), 7 * 12 + 1);
}

#[test]
fn a_plant_without_large_arrays_has_no_profiles() {
    assert!(!stems(whole().path()).contains(&"profiles".to_owned()));
}
