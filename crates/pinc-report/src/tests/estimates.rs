//! The estimates of a loop whose controller does not see the state.

use super::{METRICS, assert_sound, build, stems, svg, whole, write};
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
fn estimates_stand_beside_the_plant_and_the_measurements() {
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
    // Of one model they need no name.
    fs::remove_file(dir.path().join("estimates-rk4.csv")).unwrap();
    assert!(stems(dir.path()).contains(&"estimates".to_owned()));
}

#[test]
fn the_caption_says_whether_the_estimator_is_consistent() {
    let dir = with_estimates();
    let estimator = r#""nis_mean": 1.25, "nees_mean": 2.5, "estimate_rmse": { "a": 0.01, "b": 0.02,
        "c": 0.03 }, "estimator_us": { "p50": 1.0, "p99": 2.0, "max": 3.0 },
        "estimator_status": { "updated": 98, "nothing-measured": 2 }, "model": "pinc","#;
    let metrics = METRICS.replacen("\"model\": \"pinc\",", estimator, 1);
    assert_ne!(metrics, METRICS);
    write(&dir, "metrics.json", &metrics);
    let html = build(dir.path()).unwrap();
    for said in [
        "The mean NIS is 1.25, of a consistent estimator 1",
        "the mean NEES 2.5",
        "did not end as usual: 2 nothing-measured",
    ] {
        let plain = html.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(plain.contains(said), "no {said}");
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
