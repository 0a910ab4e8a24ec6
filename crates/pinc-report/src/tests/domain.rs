//! The error over the domain, failed steps, states of different size, and the unit of time.

use super::{CONFIG, METRICS, assert_sound, build, control, stems, svg, whole, write};
use crate::testing::Plot;
use std::fmt::Write as _;
use tempfile::TempDir;

/// A run whose net is wrong where a > 0.5 and b < -0.5, whatever c and u are.
fn with_domain_error() -> TempDir {
    let dir = whole();
    let of = r#""states": ["a", "b", "c"], "inputs": ["u"],
        "validation": { "domain_error": { "rms": 1.25e-3, "p99": 0.0625, "max": 0.375,
            "max_at": { "x": [0.75, -1.0, 1.5], "u": [0.5] }, "max_of": "b",
            "predicted": -0.25, "truth": 0.5, "share_off": 0.0625, "points": 1000, "unsolved": 0,
            "rk4": { "1": 0.5, "2": 3.5e-2, "4": null },
            "proven": { "net": 0.4, "rk4": { "2": 0.0366 } } },"#;
    write(&dir, "metrics.json", &METRICS.replace("\"validation\": {", of));
    let mut table = "a,b,c,u,error\n".to_owned();
    for i in 0..1000 {
        let share = |n: i32| f64::from((i * n) % 1000) / 1000.0;
        let (a, b) = (2.0 * share(7) - 1.0, 2.0 * share(111) - 1.0);
        let error = if a > 0.5 && b < -0.5 { 0.2 } else { 1e-4 };
        let _ = writeln!(table, "{a},{b},{},{},{error}", 3.0 * share(37), 2.0 * share(3) - 1.0);
    }
    write(&dir, "domain-error.csv", &table);
    dir
}

#[test]
fn a_net_that_is_wrong_in_a_corner_is_shown_there_and_warned_of() {
    let dir = with_domain_error();
    assert!(stems(dir.path()).contains(&"domain-error".to_owned()));
    let map = svg(dir.path(), "domain-error");
    assert_sound(&map);
    // The two states that matter, and the place.
    for word in ["a (cm)", "b (cm)", "the largest error found", "log₁₀ of the largest error"] {
        assert!(map.contains(word), "no {word}");
    }
    assert!(!map.contains("c (cm)"));
    let html = build(dir.path()).unwrap();
    for said in [
        "6.25 % of [domain] is off by more than 1 % of a state's range",
        "worst at a = 0.75, b = -1, c = 1.5; u = 0.5, where b is to become 0.5 and the net says -0.25",
        "(37.5 % of its range off)",
        "Largest</th><td>0.3",
        "RK4 with 2 substeps</th><td>0.035",
        "RK4 with 4 substeps</th><td>–</td>",
        "Anywhere in it the net is proven to be wrong by at most 4.0e-1, RK4 x2 by 3.7e-2.",
    ] {
        assert!(html.contains(said), "no {said}");
    }
}

/// RK4 cannot step a black box.
#[test]
fn a_net_of_a_black_box_is_compared_with_no_integrator() {
    let dir = with_domain_error();
    assert!(build(dir.path()).unwrap().contains("RK4 with 1, 2 and 4 substeps"));
    let metrics = std::fs::read_to_string(dir.path().join("metrics.json")).unwrap();
    let none = metrics.replace(
        r#"{ "1": 0.5, "2": 3.5e-2, "4": null }"#,
        r#"{ "1": null, "2": null, "4": null }"#,
    );
    write(&dir, "metrics.json", &none);
    let html = build(dir.path()).unwrap();
    assert!(!html.contains("4 substeps"), "{html}");
}

#[test]
fn errors_that_are_no_numbers_are_hatched() {
    let dir = with_domain_error();
    write(&dir, "domain-error.csv", "a,b,c,u,error\n0,0,1,0,inf\n0.5,0.5,1,0,1e-3\n");
    let map = svg(dir.path(), "domain-error");
    assert_sound(&map);
    assert!(map.contains("no finite number"));
    // Columns that do not belong to the config make no picture.
    write(&dir, "domain-error.csv", "a,b,error\n0,0,1\n");
    assert!(!stems(dir.path()).contains(&"domain-error".to_owned()));
}

#[test]
fn the_errors_of_the_net_are_drawn_along_the_loop() {
    let dir = whole();
    assert!(!stems(dir.path()).contains(&"model-error".to_owned()));
    let mut table = "t,a_err,a_true_err,b_err,b_true_err,c_err,c_true_err\n".to_owned();
    for k in 0..100 {
        let t = 0.5 * f64::from(k);
        let error = 1e-4 * (0.3 * t).sin();
        let _ = writeln!(table, "{t},{error},{},1e-6,-1e-6,0,nan", 1.1 * error);
    }
    write(&dir, "model-error.csv", &table);
    let config = CONFIG.replace(
        "[control]",
        "[control]\nerror_tolerance = { a = 5e-5 }\non_error = \"integrator\"",
    );
    write(&dir, "config.toml", &config);
    let judged = r#""model_error": { "steps": 100, "beyond": 42, "largest": { "a": 1e-4 },
        "tolerance": { "a": 5e-5 } }, "model": "pinc","#;
    let metrics = METRICS.replacen(r#""model": "pinc","#, judged, 1);
    write(&dir, "metrics.json", &metrics);
    let picture = svg(dir.path(), "model-error");
    assert_sound(&picture);
    for word in ["|error of a| (cm)", "|error of b| (cm)", "true", "estimated", "tolerance"] {
        assert!(picture.contains(word), "no {word}");
    }
    let html = build(dir.path()).unwrap();
    let said = "in 42 of 100 steps: a at most 1.0e-4; an integrator made these steps.";
    assert!(html.contains(said));
}

#[test]
fn the_range_of_plans_is_drawn_along_the_loop() {
    let dir = whole();
    assert!(!svg(dir.path(), "control").contains("range of plans"));
    // Two plans of ten steps, around a parabola.
    let mut table = "t,a_low,a_high,b_low,b_high,c_low,c_high\n".to_owned();
    let middle = |t: f64| 0.2 + 1e-3 * t * t;
    for k in 0..24 {
        let t = 0.5 * f64::from(k);
        let width = 0.01 * f64::from(k % 12);
        let ends = [middle(t) - width, middle(t) + width];
        let _ = match k % 12 {
            11 => writeln!(table, "{t},,,,,,"),
            _ => writeln!(table, "{t},{},{},0,0,1,1", ends[0], ends[1]),
        };
    }
    write(&dir, "plans-pinc.csv", &table);
    let picture = svg(dir.path(), "control");
    assert_sound(&picture);
    assert!(picture.contains("range of plans"));
    let plot = Plot::read(&picture, "Controlled states");
    let lines = plot.lines("range of plans");
    assert_eq!(lines.len(), 4, "two ends, each with a gap between the plans");
    for line in &lines {
        let (begin, last) = (line[0].0, line[line.len() - 1]);
        assert!(begin.abs() < 0.1 || (begin - 6.0).abs() < 0.1, "{begin}");
        let side = (last.1 - middle(last.0)).signum();
        plot.assert_follows(line, |t| middle(t) + side * 0.02 * (t - begin));
    }
    assert!(build(dir.path()).unwrap().contains("(from plans-pinc.csv)"));
}

#[test]
fn the_start_of_the_first_plan_is_named() {
    let dir = whole();
    assert!(!build(dir.path()).unwrap().contains("the first plan."));
    let started = r#""start": { "starts": 8, "best": 2 }, "model": "pinc","#;
    write(&dir, "metrics.json", &METRICS.replacen(r#""model": "pinc","#, started, 1));
    let html = build(dir.path()).unwrap();
    assert!(html.contains("With PINC start 2 of 0 to 7 gives the first plan."));
}

#[test]
fn failed_steps_are_marked_where_the_state_was() {
    let dir = whole();
    // Step 42 of both models ended at its iteration limit.
    assert!(svg(dir.path(), "control").contains("failed steps"));
    for model in ["pinc", "rk4"] {
        let fine =
            "step,status,sqp_iterations,kkt,solve_us\n0,converged,2,1e-9,5\n1,deadline,2,1e-3,5\n";
        write(&dir, &format!("steps-{model}.csv"), fine);
    }
    assert!(!svg(dir.path(), "control").contains("failed steps"));
}

#[test]
fn a_state_too_small_to_be_read_beside_another_has_a_panel_of_its_own() {
    let dir = whole();
    assert!(svg(dir.path(), "control").contains("Controlled states"));
    for model in ["pinc", "rk4"] {
        let mut text = "t,a,b,c,u,a_ref,b_ref\n".to_owned();
        for i in 0..=900 {
            let t = f64::from(i) / 18.0;
            let _ = writeln!(text, "{t},{},{},1,0,1,0", (-t).exp(), 500.0 * (-t).exp());
        }
        write(&dir, &format!("control-{model}.csv"), &text);
    }
    let control = svg(dir.path(), "control");
    assert!(control.contains("Controlled states: a") && control.contains("Controlled states: b"));
    assert_sound(&control);
}

#[test]
fn times_are_shown_in_the_unit_of_the_config() {
    let dir = whole();
    assert!(svg(dir.path(), "control").contains("t (s)"));
    let config = CONFIG.replace("seed = 7", "seed = 7\ntime_unit = \"min\"");
    write(&dir, "config.toml", &config);
    let control = svg(dir.path(), "control");
    // 50 s are 0.833 min.
    assert!(control.contains("t (min)") && control.contains(">0.8<"), "{control}");
    assert!(svg(dir.path(), "prediction").contains("t (min)"));
    // So are those of other tables, and with them the first steps of a long run, which are enlarged.
    assert!(stems(dir.path()).iter().any(|stem| stem.starts_with("control-0-")));
    let mut table = "t,a_err,a_true_err,b_err,b_true_err,c_err,c_true_err\n".to_owned();
    for k in 0..=100 {
        let _ = writeln!(table, "{},1e-4,1e-4,1e-6,1e-6,1e-6,1e-6", 0.5 * f64::from(k));
    }
    write(&dir, "model-error.csv", &table);
    let errors = svg(dir.path(), "model-error");
    assert!(errors.contains("t (min)") && errors.contains(">0.80<"), "{errors}");
    assert!(!errors.contains(">40<") && !errors.contains(">50<"), "{errors}");
}

/// A loop that ended at 25 s of 50 has nothing to show after that.
#[test]
fn windows_after_the_end_of_a_loop_are_left_out() {
    let dir = whole();
    let windows = "[control]\nclose_ups_s = [[1.0, 4.0], [24.0, 30.0], [30.0, 40.0], [25.0, 26.0]]";
    write(&dir, "config.toml", &CONFIG.replace("[control]", windows));
    for model in ["pinc", "rk4"] {
        write(&dir, &format!("control-{model}.csv"), &control(450, 0.0));
    }
    let names = stems(dir.path());
    let enlarged: Vec<_> = names.iter().filter(|name| name.starts_with("control-")).collect();
    assert_eq!(enlarged, ["control-1-4", "control-24-25"]);
}

/// Outputs follow the states in a table, but have bounds of their own.
#[test]
fn bounds_of_outputs_are_drawn_in_their_panel() {
    let dir = whole();
    let config =
        CONFIG.replace("[model]\n", "outputs = { y = \"a + b\", z = \"c\" }\n[model]\n").replace(
            "[control.sqp]",
            "output_low = [-0.25, -1.0]\noutput_high = [1.25, 3.5]\n\
                 bound_schedule = [{ start_s = 20.0, output_high = { y = 1.5, z = 3.75 } }]\n\
                 [control.sqp]",
        );
    write(&dir, "config.toml", &config);
    for model in ["pinc", "rk4"] {
        let text = control(900, 0.0);
        let rows = text.lines().enumerate().map(|(i, row)| match i {
            0 => format!("{row},y,z\n"),
            _ => format!("{row},1,1.2\n"),
        });
        write(&dir, &format!("control-{model}.csv"), &rows.collect::<String>());
    }
    let plot = Plot::read(&svg(dir.path(), "control"), "Outputs");
    let limits = plot.lines("limits");
    let corners = [(0.0, 1.25), (20.0, 1.25), (20.0, 1.5), (50.0, 1.5)];
    let near = |(a, b): (&(f64, f64), &(f64, f64))| {
        (a.0 - b.0).abs() < 0.1 && (a.1 - b.1).abs() < plot.tolerance
    };
    let drawn = |line: &Vec<_>| line.len() == 4 && line.iter().zip(&corners).all(near);
    assert!(limits.iter().any(drawn), "{limits:?}");
}
