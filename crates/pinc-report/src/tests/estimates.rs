//! The estimates of a loop whose controller does not see the state.

use super::{CONFIG, METRICS, assert_sound, build, control, stems, svg, whole, write};
use crate::testing::Plot;
use std::fmt::Write as _;
use std::fs;
use tempfile::TempDir;

/// Estimates of the states a, b and c and of a disturbance from measurements of a, of both models.
fn with_estimates() -> TempDir {
    let dir = whole();
    let mut table = "t,a,b,c,d_u,a_sd,b_sd,c_sd,d_u_sd,y_a,innovation_a,nis,nees\n".to_owned();
    for i in 0..100 {
        let t = 0.5 * f64::from(i);
        let a = 1.0 - (-t).exp();
        let noise = 0.01 * f64::from(i % 7) - 0.03;
        let missing = i == 30;
        let y = if missing { String::new() } else { (a + noise).to_string() };
        let v = if missing { String::new() } else { noise.to_string() };
        let _ = writeln!(
            table,
            "{t},{a},{},{},-0.15,0.02,0.05,0.1,0.03,{y},{v},{},{}",
            (-t).exp(),
            1.0 + 0.5 * a,
            0.5 + 0.1 * f64::from(i % 5),
            2.0 + 0.2 * f64::from(i % 11),
        );
    }
    for model in ["pinc", "rk4"] {
        write(&dir, &format!("estimates-{model}.csv"), &table);
    }
    dir
}

#[test]
fn estimates_are_shown_beside_the_plant_and_the_measurements() {
    let dir = with_estimates();
    for model in ["pinc", "rk4"] {
        let picture = svg(dir.path(), &format!("estimates-{model}"));
        assert_sound(&picture);
        for word in
            ["estimate", "95 % band", "plant", "measured", "d_u", "Innovation of a", "NIS", "NEES"]
        {
            assert!(picture.contains(word), "no {word}");
        }
        let html = build(dir.path()).unwrap();
        assert!(html.contains(&format!("From estimates-{model}.csv")));
    }
    assert!(build(dir.path()).unwrap().contains("<h2>Estimates with RK4</h2>"));
    // With one model they need no name.
    fs::remove_file(dir.path().join("estimates-rk4.csv")).unwrap();
    assert!(stems(dir.path()).contains(&"estimates".to_owned()));
}

#[test]
fn the_caption_says_whether_the_estimator_is_consistent() {
    let dir = with_estimates();
    let page = |nis: &str| {
        let estimator = format!(
            r#"{nis}, "nees_mean": 2.5, "nees_steps": 100,
            "estimate_rmse": {{ "a": 0.01, "b": 0.02, "c": 0.03 }},
            "estimator_us": {{ "p50": 1.0, "p99": 2.0, "max": 3.0 }},
            "estimator_status": {{ "updated": 98, "nothing-measured": 2 }}, "model": "pinc","#
        );
        let metrics = METRICS.replacen("\"model\": \"pinc\",", &estimator, 1);
        assert_ne!(metrics, METRICS);
        write(&dir, "metrics.json", &metrics);
        build(dir.path()).unwrap().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    // One quantity is measured, in some steps: what is expected is what was used on average.
    let nis = r#""nis_mean": 1.25, "nis_expected": 0.83, "nis_steps": 100"#;
    let html = page(nis);
    for said in [
        "The mean NIS is 1.25, of a consistent estimator 0.830.",
        "The mean NEES is 2.50, of a consistent estimator 3.00.",
        "did not end as usual: 2 nothing-measured",
    ] {
        assert!(html.contains(said), "no {said}");
    }
    assert!(!html.contains("is inconsistent"));
    let html = page(&nis.replace("1.25", "108"));
    let said = "With PINC the estimator is inconsistent: its mean NIS is 108, where a consistent one \
                has 0.830 (";
    assert!(html.contains(said) && html.contains("raise process_sd"), "no {said}");
    let html = page(r#""nis_mean": null, "nis_expected": null, "nis_undefined": 100"#);
    for said in ["No step has a NIS.", "With PINC the NIS is undefined in 100 of 120 steps"] {
        assert!(html.contains(said), "no {said}");
    }
}

#[test]
fn without_estimates_there_is_no_picture_of_them() {
    let dir = with_estimates();
    for model in ["pinc", "rk4"] {
        fs::remove_file(dir.path().join(format!("estimates-{model}.csv"))).unwrap();
    }
    assert!(!stems(dir.path()).iter().any(|stem| stem.starts_with("estimates")));
    write(&dir, "estimates-pinc.csv", "t,a,a_sd,nis,nees\n0,1,0.1,high,1\n");
    let error = build(dir.path()).unwrap_err().to_string();
    assert!(error.contains("estimates-pinc.csv:2"), "{error}");
}

/// Estimates of a loop in which a, in cm, and c, in kg, are measured; rows every 0.5 s.
fn with_two_measured() -> TempDir {
    let dir = whole();
    let unit = |text: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    };
    let c = r#"{ name = "c", unit = "cm" }"#;
    write(&dir, "config.toml", &unit(CONFIG, c, r#"{ name = "c", unit = "kg" }"#));
    write(&dir, "metrics.json", &unit(METRICS, r#""c": "cm""#, r#""c": "kg""#));
    let mut table =
        "t,a,b,c,a_sd,b_sd,c_sd,y_a,y_c,innovation_a,innovation_c,nis,nees\n".to_owned();
    for i in 0..100 {
        let t = 0.5 * f64::from(i);
        let (a, b, c) = estimated(t);
        let (of_a, of_c) = innovations(i);
        let _ = writeln!(
            table,
            "{t},{a},{b},{c},0.02,{B_SD},0.1,{},{},{of_a},{of_c},1,2",
            a + of_a,
            c + of_c
        );
    }
    for model in ["pinc", "rk4"] {
        write(&dir, &format!("estimates-{model}.csv"), &table);
    }
    dir
}

const B_SD: f64 = 0.05;

fn estimated(t: f64) -> (f64, f64, f64) {
    let a = 1.0 - (-0.2 * t).exp();
    (a, (-0.1 * t).exp(), 1.0 + 0.5 * a)
}

fn innovations(i: i32) -> (f64, f64) {
    (0.01 * f64::from(i % 7) - 0.03, 2.0 - 0.3 * f64::from(i % 11))
}

#[test]
fn bands_are_of_95_per_cent_around_the_estimate_in_its_unit() {
    let picture = svg(with_two_measured().path(), "estimates-rk4");
    let b = Plot::read(&picture, "b");
    assert_eq!((b.label.as_str(), b.time.as_str()), ("b (cm)", "t (s)"));
    let estimate = b.lines("estimate");
    assert_eq!(estimate.len(), 1);
    b.assert_follows(&estimate[0], |t| estimated(t).1);
    let band = b.lines("95 % band");
    assert_eq!(band.len(), 2);
    b.assert_follows(&band[0], |t| estimated(t).1 + 1.96 * B_SD);
    b.assert_follows(&band[1], |t| estimated(t).1 - 1.96 * B_SD);
    // A band of ten per cent more or less would be seen.
    assert!(0.1 * 1.96 * B_SD > 2.0 * b.tolerance, "{}", b.tolerance);
    let c = Plot::read(&picture, "c");
    assert_eq!(c.label, "c (kg)");
    c.assert_follows(&c.lines("estimate")[0], |t| estimated(t).2);
}

#[test]
fn the_plant_beside_an_estimate_is_the_one_of_the_same_loop() {
    let dir = with_two_measured();
    write(&dir, "control-rk4.csv", &control(900, 0.01));
    for (model, drift) in [("pinc", 1e-4), ("rk4", 0.01)] {
        let a = Plot::read(&svg(dir.path(), &format!("estimates-{model}")), "a");
        let plant = a.lines("plant");
        assert_eq!(plant.len(), 1);
        a.assert_follows(&plant[0], |t| 1.0 - (-t).exp() + drift * t);
    }
}

#[test]
fn innovations_are_drawn_for_their_quantity_over_time() {
    let picture = svg(with_two_measured().path(), "estimates-pinc");
    let all = |title: &str, label: &str, of: fn((f64, f64)) -> f64| {
        let panel = Plot::read(&picture, title);
        assert_eq!(panel.label, label);
        let dots = panel.dots();
        assert_eq!(dots.len(), 100);
        for (i, (t, value)) in (0..).zip(dots) {
            assert!((t - 0.5 * f64::from(i)).abs() < 0.02, "dot {i} at {t} s");
            let truth = of(innovations(i));
            assert!((value - truth).abs() <= panel.tolerance, "{value} instead of {truth}");
        }
    };
    all("Innovation of a", "innovation (cm)", |(a, _)| a);
    all("Innovation of c", "innovation (kg)", |(_, c)| c);
}
