//! `pinc identify`: recorded data to parameters, and what is said of data that are no good.

use crate::common::{outcome, pinc, repository};
use pinc_config::{Experiment, Plants};
use pinc_runs::{Options, Verbosity};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

const TANKS: &str = r#"
name = "unknown"
preset = "ours"
seed = 1
[plant]
four-tanks = { parameters = "antonelo" }
[identify]
measured = ["h1", "h2", "h3", "h4"]
measurement_sd = [1.0, 1.0, 1.0, 1.0]
initial_state = [8.0, 10.0, 3.0, 4.0]
parameters = [
    { name = "k1", initial = 5.0, low = 0.5, high = 8.0 },
    { name = "k2", initial = 2.0, low = 0.5, high = 8.0 },
    { name = "gamma1", initial = 0.3 },
    { name = "gamma2", initial = 0.7 },
    { name = "a1", initial = 0.1 },
    { name = "a2", initial = 0.1 },
    { name = "a3", initial = 0.1 },
    { name = "a4", initial = 0.1 },
]
"#;

/// A tank with an equation in which only the product of two parameters counts.
const TANK: &str = r#"
name = "tank"
preset = "ours"
seed = 1
[plant.expression]
states = [{ name = "h", unit = "cm" }]
inputs = [{ name = "u", unit = "V" }]
parameters = { a = 0.07, gamma = 0.6, k = 3.3 }
derivatives = { h = "(k*gamma*u - a*sqrt(max(h, 0)*1962))/28" }
[identify]
initial_state = [8.0]
measurement_sd = [0.05]
step_s = 10.0
parameters = [
    { name = "k", initial = 3.0, low = 0.1, high = 9.0 },
    { name = "a", initial = 0.06, low = 0.01, high = 0.2 },
]
"#;

fn recorded() -> PathBuf {
    repository("configs/identification/tanks.csv")
}

/// A directory with a config.
fn directory(text: &str) -> (tempfile::TempDir, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("config.toml");
    fs::write(&path, text).unwrap();
    let path = path.to_str().unwrap().to_owned();
    (dir, path)
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

fn json(dir: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(dir.join("identify.json")).unwrap()).unwrap()
}

/// The level of that tank with k = 3.1, a step of 10 s per row, by Euler's method in small steps.
fn tank_csv(rows: usize, factor: f64) -> String {
    let (mut h, mut csv) = (8.0f64, "t,u,y_h\n".to_owned());
    for k in 0..rows {
        let u = if (k / 12) % 2 == 0 { 3.5 } else { 2.0 };
        // A noise of some hundredths that repeats after a long time.
        let noise = 0.07 * ((k * k * 7919 % 1009) as f64 / 1009.0 - 0.5);
        csv += &format!("{},{u},{}\n", 10 * k, factor * (h + noise));
        for _ in 0..1000 {
            h += 0.01 * (3.1 * 0.6 * u - 0.07 * (h * 1962.0).sqrt()) / 28.0;
        }
    }
    csv
}

#[test]
fn recorded_data_give_the_plant() {
    let (dir, config) = directory(TANKS);
    let out = dir.path().join("out");
    let arguments = ["identify", &config, "--data", &text(&recorded()), "--out", &text(&out)];
    let found = outcome(&mut pinc(&arguments));
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("single shooting"), "{found:?}");
    assert!(found.stdout.contains("k1 = 3.203255 +- 1.29e-2"), "{found:?}");
    assert!(!found.stdout.contains("note:"), "{found:?}");
    let json = json(&out);
    for (name, value, width) in
        [("k1", 3.203_255, 0.0129), ("k2", 3.480_243, 0.0124), ("a4", 0.059_779, 0.0003)]
    {
        let of = &json["parameters"][name];
        assert!((of["value"].as_f64().unwrap() - value).abs() < 1e-6 * value + 5e-7, "{of}");
        assert!((of["half_width_95"].as_f64().unwrap() - width).abs() < 0.5e-4, "{of}");
    }
    assert_eq!(json["outputs"], serde_json::json!(["h1", "h2", "h3", "h4"]));
    // With a noise of 1 the residuals are in cm.
    let cost = json["cost"].as_f64().unwrap();
    assert!((cost - 409.761_095 * 0.05 * 0.05).abs() < 1e-6 * cost, "{cost}");
    assert_eq!(json["initial_states"][0]["file"], "tanks.csv");
    let matrix = json["correlation"]["matrix"].as_array().unwrap();
    assert_eq!((matrix.len(), matrix[3].as_array().unwrap().len()), (12, 12));

    // Data and fit, row by row, and a report of them.
    let residuals = fs::read_to_string(out.join("residuals.csv")).unwrap();
    assert!(residuals.starts_with("file,t,y_h1,y_h2,y_h3,y_h4,fit_h1,"), "{residuals}");
    assert_eq!(residuals.lines().count(), 202);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("Residuals of h3") && report.contains("half width"));
    assert!(out.join("figures/identification.svg").exists());

    // A config of the plant that was found, which is one.
    let identified = text(&out.join("identified.toml"));
    let checked = outcome(&mut pinc(&["check", &identified]));
    assert_eq!(checked.code, Some(0), "{checked:?}");
    let written = fs::read_to_string(&identified).unwrap();
    assert!(written.contains("# k1 = 3.20325"), "{written}");
    assert!(written.contains("k1 = 3.20325"), "{written}");
}

/// Ctrl-C ends the search, as other commands.
#[test]
fn an_interrupted_search_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let config = repository("configs/identification/tanks.toml");
    let experiment = Experiment::load(&config, &[], &Plants::built_in()).unwrap();
    let (verbosity, interrupt) = (Verbosity::Quiet, &AtomicBool::new(true));
    let options = Options { resume: false, verbosity, interrupt, arguments: &[] };
    for starts in [1, 500] {
        let files = (&[recorded()][..], &[][..]);
        let found =
            pinc_runs::identify(&experiment, files, &out, &options, None, None, Some(starts));
        let error = found.unwrap_err();
        assert_eq!((error.to_string().as_str(), error.exit_code()), ("interrupted", 1));
        assert!(!out.exists());
    }
}

/// The noise of the sensors is the loop's where the section has none; pumps and valves have keys of
/// their own in the plant's section.
#[test]
fn the_shipped_config_is_identified_with_two_sensors_too() {
    let dir = tempfile::tempdir().unwrap();
    let (config, data) =
        (text(&repository("configs/identification/tanks.toml")), text(&recorded()));
    let out = text(&dir.path().join("out"));
    let sets = ["identify.measured=[\"h1\", \"h2\"]", "identify.measurement_sd=[0.05, 0.05]"];
    let arguments = ["identify", &config, "--data", &data, "--out", &out];
    let arguments = [&arguments[..], &["--set", sets[0], "--set", sets[1]]].concat();
    let found = outcome(&mut pinc(&arguments));
    assert_eq!(found.code, Some(0), "{found:?}");
    let json = json(Path::new(&out));
    let cost = json["cost"].as_f64().unwrap();
    assert!((cost - 207.618_614).abs() < 1e-6 * cost, "{cost}");
    let k2 = &json["parameters"]["k2"];
    assert!((k2["value"].as_f64().unwrap() - 3.484_454).abs() < 4e-6, "{k2}");
    assert!((k2["half_width_95"].as_f64().unwrap() - 0.0202).abs() < 2e-4, "{k2}");
}

#[test]
fn gaps_and_several_files_are_taken() {
    let (dir, config) = directory(TANK);
    let whole = tank_csv(80, 1.0);
    let lines: Vec<&str> = whole.lines().collect();
    let file = |name: &str, rows: &dyn Fn(usize) -> bool| {
        let kept = lines.iter().enumerate().filter(|(i, _)| *i == 0 || rows(*i));
        let kept: Vec<_> = kept.map(|(_, line)| *line).collect();
        let path = dir.path().join(name);
        fs::write(&path, kept.join("\n")).unwrap();
        text(&path)
    };
    // Rows that are missing in the first, from where the input stays as it was.
    let gappy = file("gappy.csv", &|i| i <= 40 && !(16..20).contains(&i));
    let second = file("second.csv", &|i| i > 40);
    let out = text(&dir.path().join("out"));
    let found =
        outcome(&mut pinc(&["identify", &config, "--data", &gappy, &second, "--out", &out]));
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("h(0) of second.csv = "), "{found:?}");
    let json = json(Path::new(&out));
    assert_eq!(json["measurements"], 76);
    let k = json["parameters"]["k"]["value"].as_f64().unwrap();
    assert!((k - 3.1).abs() < 0.05, "{k}");
    let residuals = fs::read_to_string(Path::new(&out).join("residuals.csv")).unwrap();
    assert_eq!(residuals.lines().count(), 81);
    // The identified equation has the value that was found.
    let written = fs::read_to_string(Path::new(&out).join("identified.toml")).unwrap();
    assert!(written.contains(&format!("k = {k:?}")), "{written}");
    // A held-out file with a row for each change of the input has its state from three rows, not from three steps.
    let sparse = file("sparse.csv", &|i| i > 36 && i % 12 == 1);
    let held_out = |name: &str, rows: &str| {
        let (out, set) = (text(&dir.path().join(name)), format!("identify.validation_rows={rows}"));
        let files = ["--data", &gappy, "--validate", &sparse, "--out", &out, "--set", &set];
        outcome(pinc(&["identify", &config]).args(files))
    };
    let found = held_out("held-out", "3");
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("h of sparse.csv, held out: error 0.0"), "{found:?}");
    for (rows, said) in [("1", "1 measured values cannot"), ("5", "no row is left to judge")] {
        let key = format!("identify.validation_rows = {rows}");
        held_out("none", rows).assert_refused(&["sparse.csv: held out with", &key, said]);
    }
    let known = fs::read_to_string(&second).unwrap().replacen('\n', ",k\n", 1);
    fs::write(&second, known).unwrap();
    outcome(&mut pinc(&["identify", &config, "--data", &second, "--out", &out]))
        .assert_refused(&["second.csv:1: column `k` is a parameter"]);
}

/// An output that depends on the input is read in the first row under `control.initial_input`, in
/// files of the fit and in those held out, as `pinc estimate` reads it.
#[test]
fn the_first_row_is_read_under_the_initial_input_of_the_loop() {
    let (dir, config) = directory(
        "name = \"lag\"\npreset = \"ours\"\nseed = 1\n[plant.expression]\nstates = [\"x\"]\n\
         inputs = [\"u\"]\nparameters = { a = 0.5 }\nderivatives = { x = \"a*(u - x)\" }\n\
         outputs = { sum = \"x + u\" }\n[identify]\nmeasured = [\"sum\"]\n\
         measurement_sd = [0.01]\ninitial_state = [0.0]\n\
         parameters = [{ name = \"a\", initial = 0.3 }]\n[control]\nmodels = [\"rk4\"]\n\
         step_s = 1.0\nduration_s = 10.0\ninitial_state = [0.0]\ninitial_input = [2.0]\n\
         controlled = [\"x\"]\nq = [1.0]\nr = [1.0]\ninput_low = [-3.0]\ninput_high = [3.0]\n\
         references = [{ start_s = 0.0, value = [0.0] }]\n",
    );
    let (mut csv, mut x, mut before) = ("t,u,y_sum\n".to_owned(), 1.0, 2.0);
    for k in 0..40 {
        let u = f64::from(k).sin();
        let _ = writeln!(csv, "{k},{u},{}", x + before);
        (x, before) = (u + (x - u) * (-0.5_f64).exp(), u);
    }
    let data = text(&dir.path().join("lag.csv"));
    fs::write(&data, csv).unwrap();
    let run = |out: &str, set: &[&str]| {
        let out = text(&dir.path().join(out));
        let files = ["identify", &config, "--data", &data, "--validate", &data, "--out", &out];
        let outcome = outcome(pinc(&files).args(set));
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        let found = json(Path::new(&out));
        [&found["cost"], &found["held_out"][0]["rms"]["sum"]].map(|of| of.as_f64().unwrap())
    };
    let [cost, rms] = run("known", &[]);
    assert!(cost < 1e-3 && rms < 1e-4, "{cost} {rms}");
    // Without that key it is read under its own input, which was another.
    let [cost, rms] = run("unknown", &["--unset", "control.initial_input"]);
    assert!(cost > 1.0 && rms > 1e-3, "{cost} {rms}");
}

/// The models of a loop have another gamma than the plant's section: with it an integrator is fitted,
/// as a net would be.
#[test]
fn parameters_that_are_not_identified_are_those_of_the_models() {
    let family = "[domain]\nstate_low = [1.0]\nstate_high = [15.0]\ninput_low = [0.0]\n\
        input_high = [5.0]\nparameters = { gamma = [0.3, 0.9] }\n[control]\nmodels = [\"rk4\"]\n\
        step_s = 10.0\nduration_s = 100.0\ninitial_state = [8.0]\ncontrolled = [\"h\"]\nq = [1.0]\n\
        r = [1.0]\ninput_low = [0.0]\ninput_high = [5.0]\nparameters = { gamma = 0.5 }\n\
        references = [{ start_s = 0.0, value = [8.0] }]\n";
    let (dir, config) = directory(&format!("{TANK}{family}"));
    let (data, out) = (text(&dir.path().join("data.csv")), dir.path().join("out"));
    fs::write(&data, tank_csv(80, 1.0)).unwrap();
    let found = |set: &str| {
        let arguments = ["identify", &config, "--data", &data, "--out", &text(&out.join(set))];
        let found = outcome(pinc(&arguments).args(["--set", set]));
        assert_eq!(found.code, Some(0), "{found:?}");
        json(&out.join(set))["parameters"]["k"]["value"].as_f64().unwrap()
    };
    // The data tell the product, 3.1 * 0.6.
    let models = found("seed=1");
    assert!((models * 0.5 - 1.86).abs() < 0.03, "{models}");
    let plant = found("control.parameters={}");
    assert!((plant * 0.6 - 1.86).abs() < 0.03, "{plant}");
    assert!((models * 0.5 - plant * 0.6).abs() < 1e-6, "{models} {plant}");
    // What the controller is told anew in each step is constant to the fit, which says so.
    let measured = "control.measured_parameters=[\"gamma\"]";
    assert!((found(measured) - plant).abs() < 1e-9);
    let findings = &json(&out.join(measured))["findings"];
    let said = "gamma is 0.6 in all rows: if it changes, make it an input of the plant";
    assert_eq!(findings[0], said, "{findings}");
    assert_eq!(json(&out.join("seed=1"))["findings"].as_array().unwrap().len(), 0);
}

/// Quantities whose noise nobody gives, in cm and in a thousandth of it, count by their residuals: the
/// fit is nearly that with the noise given, and says what it took.
#[test]
fn unknown_noise_is_found_from_residuals() {
    let fine = TANK.replace(
        "[identify]\n",
        "[plant.expression.outputs]\nfine = \"1000*h\"\n[identify]\nmeasured = [\"h\", \"fine\"]\n",
    );
    let unknown = fine.replace("measurement_sd = [0.05]\n", "");
    let known = fine.replace("[0.05]", "[0.0202, 200.0]");
    let (dir, _) = directory(TANK);
    let data = dir.path().join("both.csv");
    let mut csv = "t,u,y_h,y_fine\n".to_owned();
    let mut exact = tank_csv(200, 1.0);
    exact.drain(..="t,u,y_h".len());
    for (k, row) in exact.lines().enumerate() {
        let h: f64 = row.rsplit_once(',').unwrap().1.parse().unwrap();
        let noise = 0.07 * ((k * k * 7919 % 1009) as f64 / 1009.0 - 0.5);
        let other = 693.0 * ((k * k * 3571 % 997) as f64 / 997.0 - 0.5);
        writeln!(csv, "{row},{}", 1000.0 * (h - noise) + other).unwrap();
    }
    fs::write(&data, csv).unwrap();
    let fit = |name: &str, config: &str| {
        let (path, out) = (dir.path().join(format!("{name}.toml")), dir.path().join(name));
        fs::write(&path, config).unwrap();
        let arguments = ["identify", &text(&path), "--data", &text(&data), "--out", &text(&out)];
        let found = outcome(&mut pinc(&arguments));
        assert_eq!(found.code, Some(0), "{found:?}");
        let json = json(&out);
        let k = json["parameters"]["k"].clone();
        let number = |key: &str| k[key].as_f64().unwrap();
        (number("value"), number("half_width_95"), json, found.stdout)
    };
    let (value, half_width, ..) = fit("known", &known);
    let (found, width, json, said) = fit("unknown", &unknown);
    assert!((found - value).abs() < 0.1 * half_width, "{found}, {value} +- {half_width}");
    assert!((width / half_width - 1.0).abs() < 0.1, "{width}, {half_width}");
    for (i, expected) in [0.0202, 200.0].into_iter().enumerate() {
        let sd = json["measurement_sd"][i].as_f64().unwrap();
        assert!((sd / expected - 1.0).abs() < 0.1, "{sd} instead of {expected}");
    }
    assert!(said.contains("note: fine: its noise is not known, and counts as large as"), "{said}");
    // By their size alone the fine readings, which are ten times as noisy, would outweigh the others.
    let (_, width, ..) = fit("even", &fine.replace("[0.05]", "[1.0, 1.0]"));
    assert!(width > 3.0 * half_width, "{width}, {half_width}");
}

/// Predictions from row to row are fitted over gaps too, and their gain is in the results.
#[test]
fn errors_of_prediction_have_a_gain() {
    let (dir, config) = directory(TANK);
    let data = dir.path().join("data.csv");
    let csv = tank_csv(80, 1.0);
    let kept: Vec<_> = csv.lines().enumerate().filter(|(i, _)| !(16..20).contains(i)).collect();
    fs::write(&data, kept.iter().map(|(_, line)| format!("{line}\n")).collect::<String>()).unwrap();
    let (data, out) = (text(&data), dir.path().join("out"));
    let arguments =
        ["identify", &config, "--data", &data, "--validate", &data, "--out", &text(&out)];
    let set = ["--set", "identify.criterion=\"prediction-error\""];
    let found = outcome(&mut pinc(&[&arguments[..], &set].concat()));
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("single shooting of predictions"), "{found:?}");
    assert!(found.stdout.contains("K[h, h] = "), "{found:?}");
    let json = json(&out);
    let gain = json["gains"]["K[h, h]"]["value"].as_f64().unwrap();
    // Nothing but noise is in the data.
    assert!(gain.abs() < 0.3, "{gain}");
    let k = json["parameters"]["k"]["value"].as_f64().unwrap();
    assert!((k - 3.1).abs() < 0.05, "{k}");
    assert!(
        fs::read_to_string(out.join("report.html")).unwrap().contains("Gains of the prediction")
    );
}

#[test]
fn bad_data_are_answered_in_words() {
    let (dir, config) = directory(TANK);
    let path = dir.path().join("data.csv");
    let mut number = 0;
    let mut identify = |csv: &str, sets: &[&str]| {
        fs::write(&path, csv).unwrap();
        number += 1;
        let out = text(&dir.path().join(format!("out{number}")));
        let data = text(&path);
        let mut arguments = vec!["identify", &config, "--data", &data, "--out", &out];
        sets.iter().for_each(|set| arguments.extend(["--set", set]));
        let found = outcome(&mut pinc(&arguments));
        assert!(!found.stderr.contains("panicked"), "{found:?}");
        found
    };
    for (csv, said) in [
        ("", "column `t` is missing"),
        ("t,u,y_h\n", "0 rows of data, expected 2 or more"),
        ("t,u,y_h\n0,1,8\n", "1 rows of data, expected 2 or more"),
        ("t,u,y_h\n0,1,8\n10,1,\n", "1 measured values cannot determine 3 unknowns"),
        ("t,u,y_h\n0,1,8\n0,1,8\n", "0 s given, expected more than 0 s"),
        ("t,u,y_h\n0,1,8\n15,1,8\n", "15 s after 0 s given, expected a whole number of steps"),
        ("t,u,y_h\n0,1,8\n10,x,8\n", "`x` given, expected a finite number"),
        ("t,u\n0,1\n10,1\n", "column `y_h` is missing"),
    ] {
        let found = identify(csv, &[]);
        found.assert_refused(&[said]);
    }
    let good = tank_csv(80, 1.0);
    let found = identify(&good, &[]);
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(!found.stdout.contains("note:"), "{found:?}");
    // Files given twice.
    let (data, out) = (text(&path), text(&dir.path().join("twice")));
    let arguments = ["identify", &config, "--data", &data, &data, "--out", &out];
    outcome(&mut pinc(&arguments)).assert_refused(&["data.csv: given twice"]);
    // Only a product counts.
    let pair = "identify.parameters=[{ name = \"k\", initial = 3.0 }, { name = \"gamma\", initial = 0.5 }]";
    let found = identify(&good, &[pair]);
    assert!(found.stdout.contains("k, gamma cannot be identified together"), "{found:?}");
    assert!(found.stdout.contains("k = ") && found.stdout.contains("without an interval"));
    // Millimetres and more in place of centimetres.
    let found = identify(&tank_csv(80, 1000.0), &[]);
    assert!(found.stdout.contains("the measurements are about 1e3 times"), "{found:?}");
    assert!(found.stdout.contains("bound"), "{found:?}");
    // Keys that make no sense.
    for (set, said) in [
        ("identify.parameters.0.name=kk", "`kk` is not known"),
        ("identify.parameters.0.initial=10.0", "a start within its bounds, 0.1 to 9"),
        ("identify.measured=[\"v\"]", "`v` is not known"),
        ("identify.fixed_initial_state=[8.0]", "no such key with identify.initial_state"),
        ("identify.initial_state=[8.0, 1.0]", "2 values given, expected 1"),
        ("identify.step_s=-1.0", "a positive number"),
    ] {
        let found = identify(&good, &[set]);
        found.assert_refused(&[said]);
    }
}

/// The starts are listed, the best first, and how many ended where is said; parameters without
/// bounds have one start.
#[test]
fn a_fit_begins_at_several_points_within_the_bounds() {
    let (dir, config) = directory(TANK);
    let data = dir.path().join("tank.csv");
    fs::write(&data, tank_csv(80, 1.0)).unwrap();
    let run = |config: &str, more: &[&str]| {
        let (out, data) = (format!("{config}-out"), text(&data));
        let arguments = [&["identify", config, "--data", &data, "--out", &out], more].concat();
        outcome(&mut pinc(&arguments))
    };
    let out = PathBuf::from(format!("{config}-out"));
    let starts = || json(&out)["starts"].as_array().unwrap().clone();
    let found = run(&config, &[]);
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("converged from 16 starts: 5 of 5 that"), "{found:?}");
    let many = starts();
    assert_eq!(many.len(), 16);
    let costs: Vec<f64> = many.iter().map(|start| start["cost"].as_f64().unwrap()).collect();
    // Up to rounding, where the config's own start comes first.
    assert!(costs[1..].is_sorted() && costs[0] <= (1.0 + 1e-6) * costs[1], "{costs:?}");
    let best = json(&out);
    assert_eq!(many[0]["cost"], best["cost"]);
    for name in ["a", "k"] {
        assert_eq!(many[0]["parameters"][name], best["parameters"][name]["value"]);
    }
    let aside = many.iter().filter(|start| start["status"] == "set aside").count();
    assert_eq!(aside, 11);

    let single = run(&config, &["--starts", "1"]);
    assert!(single.stdout.contains("converged from a single start"), "{single:?}");
    assert_eq!(starts().len(), 1);
    assert_eq!(json(&out)["parameters"], best["parameters"]);

    let unbounded = TANK.replace(", high = 0.2", "");
    fs::write(dir.path().join("unbounded.toml"), unbounded).unwrap();
    let unbounded = text(&dir.path().join("unbounded.toml"));
    let found = run(&unbounded, &[]);
    assert!(found.stdout.contains("converged from a single start"), "{found:?}");
    run(&unbounded, &["--starts", "4"])
        .assert_refused(&["a needs a lower and an upper bound", "the 4 starts"]);
    assert_eq!(run(&config, &["--starts", "0"]).code, Some(2));
}

/// The tank with a wrong outlet, and a net for what is missing.
const HYBRID: &str = r#"
name = "hybrid"
preset = "ours"
seed = 1
[plant.expression]
states = [{ name = "h", unit = "cm" }]
inputs = [{ name = "u", unit = "V" }]
parameters = { k = 1.86 }
derivatives = { h = "(k*u - 0.8*h + 2*missing)/28" }
nets.rest = { inputs = ["(h - 6)/4"], outputs = ["missing"], layers = [3] }
[identify]
initial_state = [8.0]
measurement_sd = [0.02]
step_s = 10.0
nets = [{ name = "rest", weight_sd = 3.0 }]
starts = 3
finished_starts = 1
"#;

#[test]
fn a_hybrid_is_learned_judged_on_unseen_data_and_a_plant_like_any_other() {
    let (dir, config) = directory(HYBRID);
    let file = |name: &str| text(&dir.path().join(name));
    let csv = tank_csv(140, 1.0);
    let unseen: Vec<&str> = csv.lines().take(1).chain(csv.lines().skip(91)).collect();
    let seen: Vec<&str> = csv.lines().take(91).collect();
    fs::write(file("seen.csv"), seen.join("\n")).unwrap();
    fs::write(file("unseen.csv"), unseen.join("\n")).unwrap();
    let identify = |config: &str, out: &str, sets: &[&str]| {
        let (seen, unseen, out) = (file("seen.csv"), file("unseen.csv"), file(out));
        let mut arguments = vec!["identify", config, "--data", &seen, "--validate", &unseen];
        arguments
            .extend(["--out", &out].into_iter().chain(sets.iter().flat_map(|of| ["--set", of])));
        let found = outcome(&mut pinc(&arguments));
        assert_eq!(found.code, Some(0), "{found:?}");
        (found.stdout, json(Path::new(&out)))
    };
    let error = |of: &Value| of["held_out"][0]["rms"]["h"].as_f64().unwrap();
    let equation = [
        "identify.nets=[]",
        "identify.parameters=[{ name = \"k\", initial = 1.86, low = 1.0, high = 3.0 }]",
    ];
    let (said, without) = identify(&config, "without", &equation);
    assert!(said.contains("note: h: the residuals are not white"), "{said}");
    let (said, with) = identify(&config, "with", &[]);
    assert!(
        said.contains("rest: 10 weights of") && said.contains("unseen.csv, held out"),
        "{said}"
    );
    assert!(error(&with) < 0.25 * error(&without), "{with} {without}");
    assert_eq!(with["held_out"][0]["fitted_rows"], 5);
    assert_eq!(with["nets"], serde_json::json!(["rest"]));
    let ends = with["minima"].as_array().unwrap();
    assert_eq!(ends.iter().map(|of| of["starts"].as_u64().unwrap()).sum::<u64>(), 2);

    // The weights are in a file beside the config of the plant that was found.
    let (identified, weights) = (file("with/identified.toml"), file("with/weights-rest.csv"));
    let written = fs::read_to_string(&identified).unwrap();
    assert!(written.contains("weights = \"weights-rest.csv\""), "{written}");
    let first = with["parameters"]["rest[1]"]["value"].as_f64().unwrap();
    let rows = fs::read_to_string(&weights).unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    assert_eq!((rows.len(), rows[0]), (11, "weight"));
    assert_eq!(rows[1].parse::<f64>().unwrap().to_bits(), first.to_bits());
    let checked = outcome(&mut pinc(&["check", &identified]));
    assert_eq!(checked.code, Some(0), "{checked:?}");
    // A fit of the initial state alone has the weights as they are.
    let (_, again) = identify(&identified, "again", &["identify.nets=[]"]);
    assert!((error(&again) - error(&with)).abs() < 1e-6 * error(&with), "{again}");
    fs::write(&weights, "weight\n0.5\nno\n").unwrap();
    let refused = outcome(&mut pinc(&["check", &identified]));
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.stderr.contains("plant.expression.nets.rest.weights"), "{refused:?}");
    assert!(refused.stderr.contains("weights-rest.csv, line 3: no"), "{refused:?}");
}
