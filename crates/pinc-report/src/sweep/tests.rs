//! The reports of synthetic sweeps.

use crate::report::{FigureFiles, build};
use crate::testing::assert_sound;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const METRICS: &str = r#"{ "experiment": "s", "preset": "ours", "states": ["h1", "h2"],
  "variables": { "h1": "cm", "h2": "cm", "u": "V" } }"#;

const CONFIG: &str = r#"
name = "s"
preset = "ours"
seed = 1
[plant.expression]
states = [{ name = "h1", unit = "cm" }, { name = "h2", unit = "cm" }]
inputs = [{ name = "u", unit = "V" }]
derivatives = { h1 = "u", h2 = "h1" }
[model]
horizon_s = 0.5
hidden_layers = 2
neurons = 5
[domain]
state_low = [-1.0, -1.0]
state_high = [1.0, 1.0]
input_low = [-1.0]
input_high = [1.0]
[training]
[prediction]
duration_s = 5.0
initial_state = [0.0, 1.0]
input_low = [-1.0]
input_high = [1.0]
"#;

const CONTROL: &str = r#"
[control]
models = ["pinc", "rk4"]
duration_s = 5.0
initial_state = [0.0, 1.0]
controlled = ["h1"]
q = [1.0]
r = [1.0]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [1.0] }]
"#;

/// A trial: its cell, its draw if there are some, its metric and its status.
struct SyntheticTrial<'a> {
    place: &'a [&'a str],
    draw: Option<u32>,
    value: f64,
    status: &'a str,
}

/// A directory with the tables of a sweep over `columns`, with the same value for each metric.
fn directory(columns: &[&str], metrics: &[&str], trials: &[SyntheticTrial<'_>]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(dir.path().join(name), text).unwrap();
    write("config.toml", &config(columns, metrics, trials));
    write("metrics.json", METRICS);
    let draws = if trials.iter().any(|t| t.draw.is_some()) { "draw," } else { "" };
    let columns: String = columns.iter().map(|c| format!("{c},")).collect();
    let mut sweep = format!("trial,{columns}{draws}seed,{},status,error\n", metrics.join(","));
    for (i, trial) in trials.iter().enumerate() {
        let place: String = trial.place.iter().map(|p| format!("\"{p}\",")).collect();
        let draw = trial.draw.map_or(String::new(), |draw| format!("{draw},"));
        let done = trial.status == "done";
        let value = if done { trial.value.to_string() } else { String::new() };
        let values = vec![value; metrics.len()].join(",");
        let error = if trial.status == "failed" { "\"diverged, at step 3\"" } else { "" };
        let _ = writeln!(sweep, "t{i},{place}{draw}{i},{values},{},{error}", trial.status);
    }
    write("sweep.csv", &sweep);
    dir
}

/// The config of a sweep with these columns and metrics.
fn config(columns: &[&str], metrics: &[&str], trials: &[SyntheticTrial<'_>]) -> String {
    let mut text = CONFIG.to_owned();
    if metrics.iter().any(|metric| metric.starts_with("pinc_") || metric.starts_with("rk4_")) {
        text += CONTROL;
    }
    let mut sweep = String::new();
    for column in columns {
        let _ = match *column {
            "case" => Ok(()),
            "drawn" => write!(sweep, "[[sweep.draws]]\nname = \"d\"\ncount = 1\nranges = []\n"),
            key => write!(sweep, "[[sweep.grid]]\nkey = \"{key}\"\nvalues = [1]\n"),
        };
    }
    let mut cases: Vec<&str> = Vec::new();
    if let Some(i) = columns.iter().position(|column| *column == "case") {
        trials.iter().for_each(|trial| {
            if !cases.contains(&trial.place[i]) {
                cases.push(trial.place[i]);
            }
        });
    }
    for case in cases {
        let _ = write!(sweep, "[[sweep.cases]]\nname = \"{case}\"\nset = {{}}\n");
    }
    text + "[sweep]\n" + &sweep
}

fn trial<'a>(place: &'a [&'a str], value: f64) -> SyntheticTrial<'a> {
    SyntheticTrial { place, draw: None, value, status: "done" }
}

/// The pictures, each of them sound, and the page.
fn report(dir: &Path) -> (Vec<FigureFiles>, String) {
    let report = build(dir).unwrap();
    for figure in &report.figures {
        assert_sound(&figure.svg);
    }
    (report.figures, report.html)
}

fn csv(figure: &FigureFiles) -> &str {
    std::str::from_utf8(&figure.csv).unwrap()
}

const AXES: [&str; 2] = ["model.hidden_layers", "model.neurons"];

#[test]
fn two_axes_make_a_map_with_every_cell() {
    let mut trials = Vec::new();
    for (i, layers) in ["2", "10"].iter().enumerate() {
        for (j, neurons) in ["3", "20", "100"].iter().enumerate() {
            let place: &[&str] = Vec::leak(vec![*layers, *neurons]);
            let exponent = i32::try_from(i + 2 * j).unwrap();
            trials.push(trial(place, 10f64.powi(-exponent)));
        }
    }
    // One cell has failed, and one has not been run.
    (trials[0].status, trials[5].status) = ("failed", "pending");
    let dir = directory(&AXES, &["mse_gen"], &trials);
    let (figures, html) = report(dir.path());
    assert_eq!(figures.len(), 1);
    for word in ["hidden layers", "neurons per layer", "failed", "not run", "(cm²)", "−3.00"] {
        assert!(figures[0].svg.contains(word), "no {word}");
    }
    // 10 layers of 20 neurons: 10^-(1 + 2).
    let rows: Vec<&str> = csv(&figures[0]).lines().filter(|l| l.contains(",20,,10,")).collect();
    assert_eq!(rows.len(), 1);
    assert!(rows[0].ends_with(",-3.0"), "{}", rows[0]);
    for said in ["6 trials in 6 cells", "1 failed", "One has not been run", "diverged, at step 3"] {
        assert!(html.contains(said), "no {said}");
    }
}

#[test]
fn one_trial_alone_is_a_bar() {
    let dir = directory(&[], &["mse_gen"], &[trial(&[], 3e-7)]);
    let (figures, html) = report(dir.path());
    assert_eq!(figures.len(), 1);
    assert!(figures[0].svg.contains("all trials") && html.contains("1 trial in 1 cell."));
}

#[test]
fn an_axis_makes_curves_over_huge_and_narrow_ranges() {
    for values in [[1e-300, 1e-3, 1e200], [0.5, 0.5, 0.6], [0.0, f64::NAN, 1e-8]] {
        let trials =
            [trial(&["0.1"], values[0]), trial(&["1.0"], values[1]), trial(&["50.0"], values[2])];
        let dir = directory(&["model.horizon_s"], &["mse_gen"], &trials);
        let (figures, _) = report(dir.path());
        assert_eq!(figures.len(), 1);
        assert!(figures[0].svg.contains("step T (s)"));
    }
}

#[test]
fn what_is_the_same_in_every_trial_is_reported_and_not_drawn() {
    let values = [trial(&["1"], 113.5332), trial(&["2"], 113.5710), trial(&["4"], 113.5710)];
    let dir = directory(&["control.rk4_substeps"], &["mse_gen", "rk4_iae_dense_sum"], &values);
    let path = dir.path().join("sweep.csv");
    let mut sweep = fs::read_to_string(&path).unwrap();
    for value in ["113.5332", "113.571"] {
        sweep = sweep.replace(&format!(",{value},{value},"), &format!(",3.55e-8,{value},"));
    }
    fs::write(&path, sweep).unwrap();
    let (figures, html) = report(dir.path());
    let stems: Vec<&str> = figures.iter().map(|figure| figure.name.as_str()).collect();
    assert_eq!(stems, ["iae"]);
    assert!(html.contains("The same in every trial: validation MSE (cm²) 3.55·10⁻⁸."));
    // As many digits as tell the cells apart, and no quartiles of one trial.
    assert!(html.contains("113.5<") && html.contains("113.6<") && !html.contains("quartiles<"));
}

#[test]
fn without_a_number_there_is_a_note() {
    let failed = |place| SyntheticTrial { place, draw: None, value: 0.0, status: "failed" };
    let cases = [failed(&["a"]), failed(&["b"])];
    let (figures, _) = report(directory(&["case"], &["mse_gen"], &cases).path());
    assert!(figures[0].svg.contains("No trial has a number."));
    let axis = [failed(&["1.0"]), failed(&["2.0"])];
    let (figures, _) = report(directory(&["model.horizon_s"], &["mse_gen"], &axis).path());
    assert!(figures[0].svg.contains("No trial has a number."));
    let cells = [failed(&["1", "2"]), failed(&["2", "2"])];
    let (figures, _) = report(directory(&AXES, &["mse_gen"], &cells).path());
    assert_eq!(figures[0].svg.matches(">failed<").count(), 2);
}

#[test]
fn long_names_are_broken_and_cut() {
    let long = "a conventional net trained on a good deal more than the others";
    let cases: Vec<SyntheticTrial<'_>> = (0..12)
        .map(|i| {
            let name: &str = String::leak(format!("{long} {i}"));
            trial(Vec::leak(vec![name]), 1.0 + f64::from(i))
        })
        .collect();
    let (figures, _) = report(directory(&["case"], &["free_run_rmse"], &cases).path());
    assert!(figures[0].svg.contains('…'));
    assert!(csv(&figures[0]).contains(long), "in the table the names are whole");
}

#[test]
fn draws_make_histograms_that_count_every_trial() {
    let mut trials = Vec::new();
    for place in [&["5", "pumps"], &["5", "levels"], &["8", "pumps"], &["8", "levels"]] {
        for draw in 0..151_u32 {
            let value = 500.0 + f64::from(draw * draw % 97);
            trials.push(SyntheticTrial { place, draw: Some(draw), value, status: "done" });
        }
    }
    trials[7].status = "failed";
    let metrics = ["pinc_iae_dense_sum", "rk4_iae_dense_sum"];
    let dir = directory(&["model.hidden_layers", "drawn"], &metrics, &trials);
    let (figures, _) = report(dir.path());
    assert_eq!(figures.len(), 1);
    assert!(figures[0].svg.contains("hidden layers 8, levels"));
    let counted = |model: &str| {
        let bars = csv(&figures[0]).lines().filter(|line| line.contains(model));
        bars.map(|line| line.rsplit(',').nth(1).unwrap().parse::<f64>().unwrap()).sum::<f64>()
    };
    for model in [",PINC,", ",RK4,"] {
        assert!((counted(model) - 603.0).abs() < 0.5, "{model} {}", counted(model));
    }
    // The bars of a bin stand side by side, with a small gap.
    let ends = |model: &str| {
        let (_, cells) = csv(&figures[0]).lines().find_map(|line| line.split_once(model)).unwrap();
        let mut cells = cells.split(',').map(|cell| cell.parse::<f64>().unwrap());
        [cells.next().unwrap(), cells.next().unwrap()]
    };
    let ([from, to], [next, _]) = (ends(",PINC,"), ends(",RK4,"));
    assert!((0.8..1.0).contains(&((to - from) / (next - from))), "{from} {to} {next}");
}

#[test]
fn cases_with_draws_make_boxes_side_by_side() {
    let mut trials = Vec::new();
    for (place, factor) in [(&["plain", "pumps"], 1.0), (&["offset-free", "pumps"], 0.001)] {
        for draw in 1..=5_u32 {
            let value = factor * f64::from(draw);
            trials.push(SyntheticTrial { place, draw: Some(draw), value, status: "done" });
        }
    }
    let metrics = ["rk4_iae_dense_sum", "rk4_offset_max", "rk4_max_violation"];
    let dir = directory(&["case", "drawn"], &metrics, &trials);
    let (figures, html) = report(dir.path());
    let stems: Vec<&str> = figures.iter().map(|figure| figure.name.as_str()).collect();
    assert_eq!(stems, ["iae", "offset", "violation"]);
    for figure in &figures {
        // From 0.001 to 5: of 1 to 5 the quartiles are 2 and 4, the median is 3.
        let rows = csv(figure);
        for row in [
            ",\"RK4 plain, quartiles\",plain,,2.0,4.0,3.0",
            ",\"RK4 offset-free, quartiles\",offset-free,,0.002,0.004,0.003",
            ",\"RK4 offset-free, extremes\",offset-free,,0.001,0.005,",
        ] {
            assert!(rows.contains(row), "no {row} in {rows}");
        }
        assert_eq!(rows.matches("\"RK4 plain, trials\"").count(), 5);
        // What all cells have in common is no part of their names.
        assert!(figure.svg.contains(">plain<") && !figure.svg.contains("pumps"));
    }
    assert!(html.contains("5 trials in each cell"));
    // What no case does is said.
    let path = dir.path().join("sweep.csv");
    let kept = |line: &str| match line.rsplit_once(",done,") {
        Some((values, end)) => format!("{},0,done,{end}\n", values.rsplit_once(',').unwrap().0),
        None => format!("{line}\n"),
    };
    let sweep: String = fs::read_to_string(&path).unwrap().lines().map(kept).collect();
    fs::write(&path, sweep).unwrap();
    let (figures, html) = report(dir.path());
    assert_eq!(figures.len(), 2);
    assert!(html.contains("The same in every trial: largest violation of a bound 0."));
}

#[test]
fn pinns_stand_in_columns_beside_the_chained_net() {
    let cases = ["PINC", "PINN, T = 0.5 s", "PINN, T = 10 s"];
    let trials: Vec<SyntheticTrial<'_>> =
        cases.iter().map(|name| trial(Vec::leak(vec![*name]), 1e-3)).collect();
    let dir = directory(&["case"], &["free_run_rmse"], &trials);
    let mut config = format!("{CONFIG}[sweep]\n");
    for (i, (name, horizon)) in cases.iter().zip([0.5, 0.5, 10.0]).enumerate() {
        let time_only = if i == 0 { "" } else { "\"model.time_only\" = { input = [0.5] }\n" };
        let _ = write!(
            config,
            "[[sweep.cases]]\nname = \"{name}\"\n[sweep.cases.set]\n\"model.horizon_s\" = \
            {horizon:?}\n{time_only}"
        );
        let mut rows = "t,u,h1,h2,h1_truth,h2_truth,mark\n".to_owned();
        for k in 0..=100_u32 {
            let t = 0.1 * f64::from(k);
            // The PINNs run away.
            let off = if i == 0 { 0.0 } else { t.powi(6) };
            let _ = writeln!(
                rows,
                "{t},0.5,{},{off},{},0,{}",
                t.sin() + off,
                t.sin(),
                u8::from(k % 5 == 0)
            );
        }
        let trial = dir.path().join("trials").join(format!("t{i}"));
        fs::create_dir_all(&trial).unwrap();
        fs::write(trial.join("prediction.csv"), rows).unwrap();
    }
    fs::write(dir.path().join("config.toml"), config).unwrap();
    let (figures, _) = report(dir.path());
    assert_eq!(figures.len(), 2);
    let runs = &figures[0].svg;
    for word in ["PINN, T = 10 s", "h1, PINC", "truth", "h2 (cm)", "t (s)"] {
        assert!(runs.contains(word), "no {word}");
    }
    assert_eq!(runs.matches(">t (s)<").count(), 2, "a column for each PINN");
}
