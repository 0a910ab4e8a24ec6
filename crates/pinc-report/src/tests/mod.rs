//! The report of synthetic run directories: whole, incomplete and damaged ones.

mod compare;
mod domain;
mod estimates;
mod profile;
mod zoom;

use crate::error::ReportError;
use crate::report::{self, FigureFiles};
use crate::testing::{Plot, assert_sound};
use pinc_chart::{Color, GREY, INK, input_color, state_color};
use pinc_record::RecordError;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const CONFIG: &str = r#"
name = "a-<synthetic>-run"
preset = "ours"
seed = 7
[plant.expression]
states = [{ name = "a", unit = "cm" }, { name = "b", unit = "cm" }, { name = "c", unit = "cm" }]
inputs = [{ name = "u", unit = "V" }]
derivatives = { a = "u", b = "a", c = "b" }
[model]
horizon_s = 0.5
hidden_layers = 2
neurons = 5
[domain]
state_low = [-1.0, -1.0, 0.0]
state_high = [1.0, 1.0, 3.0]
input_low = [-1.0]
input_high = [1.0]
[[training.phases]]
optimizer = { adam = { learning_rate = 1e-3 } }
iterations = 100
[[training.phases]]
optimizer = { self-scaled-broyden = { initial_step = 0.1, gradient_tolerance = 1e-14 } }
iterations = 300
[prediction]
duration_s = 5.0
initial_state = [0.0, 1.0, 2.0]
input_low = [-1.0]
input_high = [1.0]
[control]
models = ["pinc", "rk4"]
duration_s = 50.0
initial_state = [0.0, 1.0, 1.0]
controlled = ["a", "b"]
n2 = 5
q = [1.0, 1.0]
r = [1.0]
state_low = [-1.0, -1.0, 0.0]
state_high = [1.0, 1.0, 3.0]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [1.0, 0.0] }]
[control.sqp]
tolerance = 1e-8
"#;

const PROVENANCE: &str = r#"{
  "started": "2026-01-31T12:00:00Z", "command": ["pinc", "run"], "version": "0.1.0",
  "git_commit": "abc<def", "git_dirty": false, "rustc": "rustc", "target": "t", "profile": "release",
  "cpu": "c", "cores": 2, "os": "linux", "seed": 7, "config_sha256": "00",
  "resumed": [] }"#;

const METRICS: &str = r#"{
  "experiment": "x", "preset": "ours",
  "training": { "wall_s": 11.5, "optimizer_s": 10.25, "iterations": 1234, "loss_evaluations": 2345,
                "stop_reason": "iterations-done" },
  "validation": { "mse_gen": 1.11e-6, "mse_all_normalized": 2.22e-6, "one_step_mse": 3.33e-8 },
  "prediction": { "mse_marks": 4.44e-6, "mse_all": 5.55e-6 },
  "variables": { "a": "cm", "b": "cm", "c": "cm", "u": "V" },
  "control": [
    { "model": "pinc", "rmse": 0.13131, "iae": 5.875, "rmse_dense": 0.14121, "iae_dense_sum": 113.575,
      "wall_s": { "mean": 0.0012, "sd": 0.0001, "median": 0.0011, "runs": 10 },
      "step_us": { "p50": 6.125, "p99": 9.25, "max": 77.5 }, "sqp_iterations_mean": 3.25,
      "kkt_max": 6.6e-9, "max_violation": 7.7e-4, "status": { "converged": 120 } },
    { "model": "rk4", "rmse": 0.13083, "iae": 5.874, "rmse_dense": 0.14106, "iae_dense_sum": 113.461425,
      "wall_s": { "mean": 0.0006, "sd": 0.0001, "median": 0.0005, "runs": 10 },
      "step_us": { "p50": 3.0625, "p99": 4.5, "max": 33.5 }, "sqp_iterations_mean": 3.5,
      "kkt_max": 8.8e-9, "max_violation": 0.031, "violations": [{ "of": "x1", "unit": "m",
        "side": "high", "bound": 0.5, "hard": true, "amount": 0.031, "time_s": 3.25, "at_steps": 0.0,
        "share": 0.06 }], "status": { "converged": 119, "iteration-limit": 1 } } ] }"#;

/// What [`METRICS`] has to look like on the page.
/// 113.575 / 113.461425 = 1.001001.
const SHOWN: &str = "x1: 0.0310 m above 0.5 m at 3.25 s|11.5 s|10.2 s|1234|2345|iterations-done|1.11·10⁻⁶|\
    2.22·10⁻⁶|3.33·10⁻⁸|4.44·10⁻⁶|5.55·10⁻⁶|0.13131|5.87500|0.14121|113.575|\
    1.20 ms ± 100 µs (10 runs)|1.10 ms|6.12 µs|9.25 µs|77.5 µs|3.25|6.6·10⁻⁹|7.7·10⁻⁴|\
    converged 120|0.13083|113.461|600 µs|3.06 µs|33.5 µs|8.8·10⁻⁹|\
    converged 119, iteration-limit 1|0.10 % higher";

const STEMS: [&str; 5] = ["control", "control-0-10", "steps", "prediction", "training"];

/// A run directory with every file: 3 states, 1 input, 100 steps, both models.
fn whole() -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    write(&dir, "config.toml", CONFIG);
    write(&dir, "metrics.json", METRICS);
    write(&dir, "provenance.json", PROVENANCE);
    write(&dir, "training.csv", &training(400));
    write(&dir, "prediction.csv", &prediction(90));
    for (model, offset) in [("pinc", 1e-4), ("rk4", 0.0)] {
        write(&dir, &format!("control-{model}.csv"), &control(900, offset));
        write(&dir, &format!("steps-{model}.csv"), &steps(100));
    }
    dir
}

fn write(dir: &TempDir, name: &str, text: &str) {
    fs::write(dir.path().join(name), text).unwrap();
}

fn training(rows: u32) -> String {
    let mut text = "iteration,loss_evaluations,elapsed_s,loss,validation_mse,phase,loss_data,\
                    loss_physics,gradient_norm,collocation_points,fresh_loss\n"
        .to_owned();
    for i in 1..=rows {
        let loss = 1.0 / f64::from(i * i);
        let validation = if i % 10 == 0 { (3.0 * loss).to_string() } else { String::new() };
        let (phase, points) = if i <= 100 { (0, 1024) } else { (1, 2048) };
        let (data, physics) = (0.25 * loss, 0.75 * loss);
        let _ = writeln!(
            text,
            "{i},{},0.{i:04},{loss},{validation},{phase},{data},{physics},{loss},{points},",
            2 * i
        );
    }
    text
}

fn prediction(rows: u32) -> String {
    let mut text = "t,u,a,b,c,a_truth,b_truth,c_truth,mark\n".to_owned();
    for i in 0..=rows {
        let t = f64::from(i) / 18.0;
        let (a, b) = (t.sin(), t.cos());
        let mark = u32::from(i % 9 == 0);
        let _ = writeln!(text, "{t},0.5,{},{b},2,{a},{},2.01,{mark}", a + 1e-3 * t, b + 1e-4);
    }
    text
}

fn control(rows: u32, offset: f64) -> String {
    let mut text = "t,a,b,c,u,a_ref,b_ref\n".to_owned();
    for i in 0..=rows {
        let t = f64::from(i) / 18.0;
        let a = 1.0 - (-t).exp() + offset * t;
        let _ = writeln!(text, "{t},{a},{},{},{},1,0", (-t).exp(), 1.0 + 0.5 * a, 0.9 - offset);
    }
    text
}

fn steps(rows: u32) -> String {
    let mut text = "step,status,sqp_iterations,kkt,solve_us\n".to_owned();
    for i in 0..rows {
        let status = if i == 42 { "iteration-limit" } else { "converged" };
        let _ =
            writeln!(text, "{i},{status},{},{}e-10,{}", 2 + i % 3, 1 + i, 5.0 + f64::from(i % 7));
    }
    text
}

fn build(dir: &Path) -> Result<String, ReportError> {
    Ok(report::build(dir)?.html)
}

fn figures(dir: &Path) -> Vec<FigureFiles> {
    report::build(dir).unwrap().figures
}

fn stems(dir: &Path) -> Vec<String> {
    figures(dir).into_iter().map(|figure| figure.name).collect()
}

fn svg(dir: &Path, stem: &str) -> String {
    let mut figures = figures(dir).into_iter();
    figures.find(|figure| figure.name == stem).unwrap().svg
}

#[test]
fn a_whole_run_shows_every_picture_and_every_metric() {
    let dir = whole();
    let html = build(dir.path()).unwrap();
    assert_eq!(stems(dir.path()), STEMS);
    for stem in STEMS {
        assert!(html.contains(&format!("<section id=\"{stem}\">")), "no {stem}");
    }
    assert_eq!(html.matches("<svg ").count(), STEMS.len());
    let metrics = html.split("<section id=\"metrics\">").nth(1).unwrap();
    let metrics = metrics.split("</section>").next().unwrap();
    for shown in SHOWN.split('|') {
        assert!(metrics.contains(shown), "no {shown}");
    }
    for said in ["a-&lt;synthetic&gt;-run", "abc&lt;def", "git_commit", "expression", "a, b (cm)"] {
        assert!(html.contains(said), "no {said}");
    }
    assert!(!html.contains("class=\"note\""), "nothing is missing");
}

#[test]
fn the_page_needs_nothing_else() {
    let html = build(whole().path()).unwrap();
    for link in ["src=", "href=", "url(", "@import", "import(", "fetch(", "XMLHttpRequest"] {
        assert!(!html.contains(link), "{link} in the page");
    }
    // The name of SVG's vocabulary is no address to load, nor is uPlot's home page.
    let addresses = html.replace("http://www.w3.org/2000/svg", "");
    let addresses = addresses.replacen("https://github.com/leeoniya/uPlot", "", 1);
    let addresses = addresses.replacen("http-equiv", "", 1);
    assert!(!addresses.contains("http"), "an address in the page");
    assert!(html.contains("default-src 'none'"), "a browser may load something");
}

#[test]
fn pictures_are_sound_and_mark_what_they_should() {
    let dir = whole();
    for figure in figures(dir.path()) {
        assert_sound(&figure.svg);
    }
    let training = svg(dir.path(), "training");
    for word in [
        "Adam, 1024 points",
        "self-scaled Broyden, 2048 points",
        "its lowest value",
        "physics term",
        "data term",
    ] {
        assert!(training.contains(word), "no {word}");
    }
    let steps = svg(dir.path(), "steps");
    assert!(steps.contains("not converged") && steps.contains("tolerance"));
    let control = svg(dir.path(), "control");
    for word in
        ["a with PINC", "with RK4", "reference", "limits", "|PINC − RK4| (cm)", "Other states"]
    {
        assert!(control.contains(word), "no {word}");
    }
    let prediction = svg(dir.path(), "prediction");
    // A mark per state and end of a step (0 to 10), dots for the first state, squares and triangles
    // for the others; and a dot in the legend of each of the two panels.
    assert_eq!(prediction.matches("<circle").count(), 11 + 2);
    assert_eq!(prediction.matches("<polygon").count(), 2 * 11);
}

#[test]
fn the_closed_loop_comes_first_then_the_few_numbers_then_the_rest() {
    let html = build(whole().path()).unwrap();
    let place = |what: &str| html.find(what).unwrap_or_else(|| panic!("no {what}"));
    let section = |id: &str| place(&format!("<section id=\"{id}\">"));
    let first = html.find("<section ").unwrap();
    assert_eq!(first, section("control"), "something stands above the closed loop");
    let others =
        [section("control-0-10"), section("steps"), section("training"), section("metrics")];
    let order = [section("control"), section("key"), place("class=\"summary\"")];
    assert!(order.iter().chain(&others).is_sorted(), "{order:?} {others:?}");
    let key = &html[section("key")..others[0]];
    for row in [
        "model</th><th scope=\"col\">IAE (cm)</th>",
        ">PINC</th><td>113.575</td><td>7.7·10⁻⁴</td><td>6.12 µs</td><td>0 of 120</td>",
        ">RK4</th><td>113.461</td><td>0.031</td><td>3.06 µs</td><td>1 of 120</td>",
    ] {
        assert!(key.contains(row), "no {row} in {key}");
    }
}

#[test]
fn variables_of_other_units_and_ranges_have_panels_of_their_own() {
    let dir = whole();
    // The second state in degrees, and two more inputs: one in V of a like size, one in bar.
    write(
        &dir,
        "config.toml",
        &CONFIG.replace("input_low = [-1.0]", "input_low = [-1.0, 0.0, 0.0]"),
    );
    let units = r#""b": "deg", "c": "cm", "u": "V", "v": "V", "w": "bar" }"#;
    let known = r#""b": "cm", "c": "cm", "u": "V" }"#;
    write(&dir, "metrics.json", &METRICS.replace(known, units));
    let rows = |last: f64| {
        let row =
            |t: u32| format!("{t},0.{t},{t},1,0.{t},0.{},{},1,0\n", t + 1, last * f64::from(t));
        let rows: String = (1..9).map(row).collect();
        format!("t,a,b,c,u,v,w,a_ref,b_ref\n{rows}")
    };
    for model in ["pinc", "rk4"] {
        write(&dir, &format!("control-{model}.csv"), &rows(0.1));
    }
    let control = svg(dir.path(), "control");
    assert_sound(&control);
    for (title, label) in [
        ("Controlled states: a", "a (cm)"),
        ("Controlled states: b", "b (deg)"),
        ("Inputs: u, v", "u, v (V)"),
        ("Inputs: w", "w (bar)"),
    ] {
        let plot = Plot::read(&control, title);
        assert_eq!(plot.label, label);
    }
    // The input in bar rises from 0.1 to 0.8 in steps.
    let plot = Plot::read(&control, "Inputs: w");
    let (first, last) =
        (plot.lines("w with PINC")[0][0].1, plot.lines("w with PINC")[0].last().unwrap().1);
    assert!((first - 0.1).abs() < plot.tolerance && (last - 0.8).abs() < plot.tolerance);
    // A range a hundred times as large takes a panel of its own, whatever the unit.
    let alike = METRICS.replace(known, &units.replace("bar", "V"));
    write(&dir, "metrics.json", &alike);
    assert!(svg(dir.path(), "control").contains(">Inputs<"), "ranges are alike");
    for model in ["pinc", "rk4"] {
        write(&dir, &format!("control-{model}.csv"), &rows(10.0));
    }
    assert_eq!(Plot::read(&svg(dir.path(), "control"), "Inputs: w").label, "w (V)");
}

/// Pictures are turned around in the dark by a filter: what it makes of each color stands out from
/// the ground by 3 to 1 (WCAG 2.1, 1.4.11), as far as the color does on white.
#[test]
fn colors_stand_out_in_the_dark() {
    let html = build(whole().path()).unwrap();
    let amount = html.split("invert(").nth(1).unwrap().split(')').next().unwrap();
    let amount: f64 = amount.parse().unwrap();
    let in_the_dark = |Color(r, g, b): Color| {
        let [r, g, b] = [r, g, b].map(|c| amount + f64::from(c) / 255.0 * (1.0 - 2.0 * amount));
        // The matrix of a turn by 180 degrees (Filter Effects, 9.8).
        let grey = 2.0 * (0.213 * r + 0.715 * g + 0.072 * b);
        [grey - r, grey - g, grey - b].map(|c| c.clamp(0.0, 1.0))
    };
    let luminance = |color: [f64; 3]| {
        let linear =
            |c: f64| if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
        let [r, g, b] = color.map(linear);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let ground = in_the_dark(Color(255, 255, 255));
    let is_ground = |channel: f64| (255.0 * channel - f64::from(0x1a)).abs() < 0.5;
    assert!(ground.into_iter().all(is_ground), "white becomes the page's ground");
    for color in (0..6).flat_map(|i| [state_color(i), input_color(i)]).chain([INK, GREY]) {
        let contrast = (luminance(in_the_dark(color)) + 0.05) / (luminance(ground) + 0.05);
        assert!(contrast > 3.0, "{color:?}: {contrast}");
    }
}

#[test]
fn screen_readers_are_told_what_is_drawn() {
    let html = build(whole().path()).unwrap();
    assert_eq!(html.matches("<table").count(), html.matches("<caption>").count() + 1);
    assert_eq!(html.matches("aria-label=\"Provenance\"").count(), 1);
    assert_eq!(html.matches("<svg ").count(), html.matches("<desc>").count());
    let control = svg(whole().path(), "control");
    assert!(control.contains("<title>Closed loop</title>"));
    let said = "Controlled states, a, b (cm) over t (s): a with PINC, b with PINC, with RK4, \
                reference, failed steps and limits.";
    let about = control.split("<desc>").nth(1).unwrap().split("</desc>").next().unwrap();
    assert!(about.contains(said), "{about}");
}

#[test]
fn loops_are_drawn_over_time_in_the_units_of_their_states() {
    let picture = svg(whole().path(), "control");
    let plot = Plot::read(&picture, "Controlled states");
    assert_eq!((plot.label.as_str(), plot.time.as_str()), ("a, b (cm)", "t (s)"));
    let line = plot.lines("a with PINC");
    assert_eq!(line.len(), 1);
    plot.assert_follows(&line[0], |t| 1.0 - (-t).exp() + 1e-4 * t);
    plot.assert_follows(&plot.lines("b with PINC")[0], |t| (-t).exp());
    let last = line[0][line[0].len() - 1].0;
    assert!((last - 50.0).abs() < 0.1, "the loop ends at {last} s");
}

#[test]
fn bounds_that_change_are_drawn_as_they_change() {
    let dir = whole();
    let changes = "[{ start_s = 20.0, state_high = { a = 1.5 }, state_low = { b = -0.5 } }]";
    let schedule = format!("bound_schedule = {changes}\n[control.sqp]");
    let config = CONFIG.replace("[control.sqp]", &schedule);
    for (unit, seconds) in [("s", 1.0), ("min", 60.0)] {
        let unit = format!("seed = 7\ntime_unit = \"{unit}\"");
        write(&dir, "config.toml", &config.replace("seed = 7", &unit));
        let plot = Plot::read(&svg(dir.path(), "control"), "Controlled states");
        let limits = plot.lines("limits");
        for (before, after) in [(1.0, 1.5), (-1.0, -0.5)] {
            // The corners of a bound that changes; the constant ones are levels.
            let corners = [(0.0, before), (20.0, before), (20.0, after), (50.0, after)];
            let near = |(a, b): (&(f64, f64), &(f64, f64))| {
                (seconds * a.0 - b.0).abs() < 0.1 && (a.1 - b.1).abs() < plot.tolerance
            };
            let drawn = |line: &Vec<_>| line.len() == 4 && line.iter().zip(&corners).all(near);
            assert!(limits.iter().any(drawn), "{after} in {unit}: {limits:?}");
        }
    }
}

/// Of the times 5, 6, .. 11 us, each as often as the others or once more, the middle one.
#[test]
fn the_median_time_of_a_step_is_named_beside_its_model() {
    let picture = svg(whole().path(), "steps");
    for model in ["PINC", "RK4"] {
        assert!(picture.contains(&format!(">{model}, median 8.00 µs<")), "{picture}");
    }
}

#[test]
fn missing_files_leave_their_sections_out() {
    for (file, gone) in [("training.csv", "training"), ("prediction.csv", "prediction")] {
        let dir = whole();
        fs::remove_file(dir.path().join(file)).unwrap();
        assert!(!stems(dir.path()).iter().any(|stem| stem == gone));
        let html = build(dir.path()).unwrap();
        assert!(html.contains(&format!("There is no {file}")), "no note on {file}");
        // Nothing is missing of a stage that did not run.
        let mut metrics: serde_json::Value = serde_json::from_str(METRICS).unwrap();
        assert!(metrics.as_object_mut().unwrap().remove(gone).is_some(), "{gone}");
        write(&dir, "metrics.json", &metrics.to_string());
        let html = build(dir.path()).unwrap();
        assert!(!html.contains(&format!("There is no {file}")), "a note on {file}");
    }
    let dir = whole();
    fs::remove_file(dir.path().join("metrics.json")).unwrap();
    assert!(build(dir.path()).unwrap().contains("There is no metrics.json"));
    let empty = tempfile::tempdir().unwrap();
    let error = build(empty.path()).unwrap_err().to_string();
    assert!(error.contains("config.toml: cannot be read"), "{error}");
}

/// A killed training leaves its checkpoint, and no loop has run.
#[test]
fn an_unfinished_run_says_so() {
    let dir = whole();
    write(&dir, "checkpoint.bin", "");
    let mut metrics: serde_json::Value = serde_json::from_str(METRICS).unwrap();
    metrics.as_object_mut().unwrap().remove("control").unwrap();
    write(&dir, "metrics.json", &metrics.to_string());
    let html = build(dir.path()).unwrap();
    for said in ["The training is not finished", "The closed loop has not run."] {
        assert!(html.contains(said), "no note: {said}");
    }
    // A loop that has a trace, and no numbers yet.
    let said = "The closed loop is not finished";
    assert!(!html.contains(said) && !build(whole().path()).unwrap().contains(said));
    fs::remove_file(dir.path().join("checkpoint.bin")).unwrap();
    assert!(build(dir.path()).unwrap().contains(said));
    write(&dir, "checkpoint.bin", "");
    // Before its first checkpoint, it leaves nothing.
    for file in ["checkpoint.bin", "metrics.json"] {
        fs::remove_file(dir.path().join(file)).unwrap();
    }
    assert!(build(dir.path()).unwrap().contains("The training is not finished"));
    write(&dir, "provenance.json", &PROVENANCE.replace("\"run\"", "\"control\""));
    assert!(!build(dir.path()).unwrap().contains("The training is not finished"));
    // A sweep has trainings in directories of their own.
    write(&dir, "provenance.json", PROVENANCE);
    write(&dir, "config.toml", &format!("{CONFIG}\n[sweep]\nseeds = [1, 2]\n"));
    assert!(!build(dir.path()).unwrap().contains("The training is not finished"));
}

/// Each of these commands leaves a table or a report of its own, and a config.
#[test]
fn directories_of_other_commands_are_refused_by_name() {
    for (file, command, place) in [
        ("tune.csv", "pinc tune", "held-out/report.html"),
        ("recommended.toml", "pinc choose", "tried/report.html"),
        ("shrink.csv", "pinc shrink", "shrink.csv"),
        ("certify.json", "pinc certify", "certify.json"),
    ] {
        let dir = whole();
        write(&dir, file, "");
        assert!(build(dir.path()).is_ok(), "a run with results is shown whatever is beside them");
        fs::remove_file(dir.path().join("metrics.json")).unwrap();
        let error = build(dir.path()).unwrap_err().to_string();
        assert!(error.contains(command) && error.ends_with(place), "{error}");
        // Without it, the command was interrupted.
        fs::remove_file(dir.path().join(file)).unwrap();
        let name = command.strip_prefix("pinc ").unwrap();
        write(&dir, "provenance.json", &PROVENANCE.replace("\"run\"", &format!("\"{name}\"")));
        let error = build(dir.path()).unwrap_err().to_string();
        assert!(
            error.ends_with(&format!(": `{command}` was interrupted; run it again to its end"))
        );
    }
}

/// An older run directory lacks what was added since; `null` stands for NaN and infinity.
#[test]
fn metrics_of_an_older_run_are_read_and_missing_numbers_are_dashes() {
    let dir = whole();
    let older = METRICS.replace("\"optimizer_s\": 10.25, ", "").replace("0.13131", "null");
    assert!(!older.contains("\"states\"") && !older.contains("source") && older != METRICS);
    write(&dir, "metrics.json", &older);
    let html = build(dir.path()).unwrap();
    assert!(html.contains("<th scope=\"row\">RMSE at the steps</th><td>–</td>"));
    let config =
        CONFIG.replace("models = [\"pinc\", \"rk4\"]\n", "").replace("[control.sqp]\n", "");
    write(&dir, "config.toml", &config.replace("tolerance = 1e-8\n", ""));
    assert_eq!(stems(dir.path()), STEMS);
}

#[test]
fn one_model_has_no_comparison() {
    let dir = whole();
    for kind in ["control", "steps"] {
        let of = |model: &str| dir.path().join(format!("{kind}{model}.csv"));
        fs::rename(of("-pinc"), of("")).unwrap();
        fs::remove_file(of("-rk4")).unwrap();
    }
    let control = svg(dir.path(), "control");
    assert!(!control.contains("RK4") && !control.contains("Difference"));
    assert!(svg(dir.path(), "steps").contains("PINC, median"));
}

#[test]
fn damaged_files_are_named_with_their_line() {
    for (file, text, place) in [
        ("training.csv", "iteration,loss\n1,0.5\n", "training.csv:1: no column `loss_evaluations`"),
        ("metrics.json", "{\n\"experiment\": 7\n}", "metrics.json:2: damaged JSON: invalid type"),
        ("prediction.csv", "time,x\n0,1\n", "prediction.csv:1: no column `t`"),
        (
            "steps-pinc.csv",
            "step,status,sqp_iterations,kkt,solve_us\nzero,lost,1,0,1\n",
            "steps-pinc.csv:2: column `step`",
        ),
        ("metrics.json", "{\n\"control\": ,\n}", "metrics.json:2: damaged JSON"),
        ("config.toml", "name = \"x\"\nseed = = 1\n", "config.toml:2: not valid TOML"),
    ] {
        let dir = whole();
        write(&dir, file, text);
        let message = build(dir.path()).unwrap_err().to_string();
        assert!(message.contains(place), "{message}");
    }
    let missing = whole().path().join("nowhere");
    let error = build(&missing).unwrap_err();
    assert!(matches!(error, ReportError::Record(RecordError::NotADirectory { .. })), "{error}");
}

#[test]
fn values_without_a_place_on_a_log_axis_are_left_out() {
    let dir = whole();
    let header = "iteration,loss_evaluations,elapsed_s,loss,validation_mse,loss_data";
    let rows = ["NaN,,-1", "inf,,0", "-inf,,NaN", "0.5,,1e-320", "-3,,1e308", "0,,2", "0.25,,3"];
    let rows: Vec<_> = rows.iter().enumerate().map(|(i, row)| format!("{i},{i},0,{row}")).collect();
    write(&dir, "training.csv", &format!("{header}\n{}\n", rows.join("\n")));
    let steps = "step,status,sqp_iterations,kkt,solve_us\n";
    write(&dir, "steps-pinc.csv", &format!("{steps}0,lost,1,NaN,-1\n"));
    write(&dir, "steps-rk4.csv", &format!("{steps}0,lost,0,-1,inf\n"));
    for figure in figures(dir.path()) {
        assert_sound(&figure.svg);
    }
    // Nothing but NaN: no panel, so no picture.
    write(&dir, "training.csv", &format!("{header}\n1,1,0,NaN,,NaN\n2,2,0,NaN,,NaN\n"));
    assert!(!stems(dir.path()).contains(&"training".to_owned()));
}

#[test]
fn files_of_one_row_or_none_are_no_trouble() {
    let dir = whole();
    write(&dir, "training.csv", &training(1));
    write(&dir, "prediction.csv", &prediction(0));
    for model in ["pinc", "rk4"] {
        write(&dir, &format!("control-{model}.csv"), &control(0, 0.0));
        write(&dir, &format!("steps-{model}.csv"), &steps(1));
    }
    assert_eq!(stems(dir.path()), ["control", "steps", "prediction", "training"]);
    for figure in figures(dir.path()) {
        assert_sound(&figure.svg);
    }
    write(&dir, "training.csv", &training(0));
    assert!(build(dir.path()).unwrap().contains("training.csv has no rows"));
}

#[test]
fn constants_are_drawn_in_the_middle() {
    let dir = whole();
    let header = "t,a,b,c,u,a_ref,b_ref\n";
    let rows: String = (0..20).map(|i| format!("{i},0,0,1e12,0.5,0,0\n")).collect();
    write(&dir, "control-pinc.csv", &format!("{header}{rows}"));
    write(&dir, "control-rk4.csv", &format!("{header}{rows}"));
    let control = svg(dir.path(), "control");
    assert_sound(&control);
    assert!(!control.contains("Difference"), "two equal loops have no difference to draw");
}

#[test]
fn long_trainings_make_no_heavy_page() {
    let dir = whole();
    write(&dir, "training.csv", &training(20_000));
    let size = build(dir.path()).unwrap().len();
    assert!(size < 2_000_000, "{size} bytes");
}
