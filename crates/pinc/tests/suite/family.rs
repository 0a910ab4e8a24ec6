//! One net for a family of plants, through the program.

use crate::closed::Closed;
use crate::common::{outcome, pinc};
use crate::ways::{Exported, Served, assert_same, compile};
use pinc_config::ModelKind;
use std::fs;
use std::path::Path;
use std::process::Command;

const FAMILY: &str = r#"
name = "tanks"
preset = "ours"
seed = 3
plant = { one-tank = {} }
model = { horizon_s = 10.0, hidden_layers = 1, neurons = 8 }
domain = { state_low = [2.0], state_high = [20.0], input_low = [0.5], input_high = [4.45], parameters = { k = [2.4, 3.8] } }
[training]
collocation_points = 256
phases = [{ optimizer = { self-scaled-broyden = { initial_step = 0.1, gradient_tolerance = 1e-14 } }, iterations = 120 }]
[validation]
scenarios = 2
duration_s = 50.0
one_step_points = 64
domain = { state_low = [4.0], state_high = [16.0], input_low = [2.0], input_high = [3.0] }
[prediction]
duration_s = 50.0
initial_state = [8.0]
input_low = [2.0]
input_high = [3.0]
[control]
duration_s = 400.0
initial_state = [5.0]
initial_input = [2.2]
controlled = ["h"]
q = [10.0]
r = [1.0]
input_low = [0.5]
input_high = [4.45]
references = [{ start_s = 0.0, value = [9.0] }]
repetitions = 1
"#;

fn run(dir: &Path, name: &str, sets: &[&str]) -> serde_json::Value {
    let config = dir.join("tanks.toml");
    fs::write(&config, FAMILY).unwrap();
    let out = dir.join(name);
    let mut command = pinc(&["run", "--quiet"]);
    command.arg(&config).arg("--out").arg(&out);
    for set in sets {
        command.args(["--set", set]);
    }
    let outcome = outcome(&mut command);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    serde_json::from_str(&fs::read_to_string(out.join("metrics.json")).unwrap()).unwrap()
}

/// The offset of each model at the end of the loop.
fn offsets(metrics: &serde_json::Value) -> [f64; 2] {
    [0, 1].map(|of| metrics["control"][of]["offset"]["h"][0].as_f64().unwrap())
}

/// A controller that is told of a worn pump does as well as one with a new pump; one that is not
/// has an offset, with both models.
#[test]
fn a_controller_gets_its_parameters() {
    let dir = tempfile::tempdir().unwrap();
    let nominal = run(dir.path(), "nominal", &[]);
    let place = &nominal["validation"]["domain_error"]["max_at"];
    let k = place["p"]["k"].as_f64().unwrap();
    assert!((2.4..=3.8).contains(&k), "{place}");
    let worn = "control.plant={one-tank={}}";
    // The built-in tank has no parameters to choose; the models are told of another one instead.
    let wrong = run(dir.path(), "wrong", &[worn, "control.parameters={k=2.6}"]);
    for (right, wrong) in offsets(&nominal).into_iter().zip(offsets(&wrong)) {
        assert!(right < 0.05 && wrong > 0.2, "{right} {wrong}");
    }
    let both = offsets(&wrong);
    assert!((both[0] - both[1]).abs() < 0.05, "{both:?}");
}

/// The guard judges the net, and takes its place, by the member that the config names: in the loop, at
/// a port and in C, whose self-test passes. The points of the loop are certified for it.
#[test]
fn the_guard_is_of_the_member_in_every_way_out() {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), "net", &[]);
    let model = dir.path().join("net/model.safetensors").display().to_string();
    let config = dir.path().join("tanks.toml");
    for on_error in ["integrator", "correct"] {
        let on_error = format!("control.on_error={on_error}");
        let sets = ["control.parameters={k=2.6}", "control.error_tolerance={h=1e-9}", &on_error];
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let sets: Vec<&str> = ["--model", &model].into_iter().chain(sets).collect();
        let out = tempfile::tempdir().unwrap();
        let closed = Closed::run(out.path(), &config, ModelKind::Pinc, &sets);
        let mut served = Served::of(&config, ModelKind::Pinc, &sets);
        assert_same("serve", &closed, &served.answers(&closed.told(), &[]), 1e-9);
        served.end();
        let exported = Exported::of(out.path(), &config, ModelKind::Pinc, &sets, false).unwrap();
        assert_same("C", &closed, &exported.answers(&closed.told()), 1e-9);
        fs::remove_file(out.path().join("c/driver.c")).unwrap();
        compile(&out.path().join("c"), "none");
        let tested = outcome(&mut Command::new(out.path().join("c/program")));
        assert_eq!(tested.code, Some(0), "{tested:?}");
        let mut certify = pinc(&["certify", "--quiet", "--run", "run", "--out", "along"]);
        certify.arg(&config).args(&sets).current_dir(&out);
        let done = outcome(&mut certify);
        assert_eq!(done.code, Some(0), "{done:?}");
        let along = fs::read_to_string(out.path().join("along/certify.csv")).unwrap();
        let mut rows = along.lines();
        assert_eq!(rows.next(), Some("h,u,k,h_err,h_bound"));
        assert!(rows.all(|row| row.split(',').nth(2) == Some("2.6")), "{along}");
        let schedule = "control.parameter_schedule=[{ start_s = 20.0, values = { k = 2.8 } }]";
        let refused = outcome(certify.args(["--set", schedule]));
        refused.assert_refused(&["certify --run", "control.parameter_schedule"]);
    }
}

/// A pump that wears in the middle of the run: told of it at that time, the controller has no
/// offset afterwards; otherwise it has one.
#[test]
fn a_controller_gets_parameters_that_change() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("tanks.toml");
    fs::write(&config, FAMILY).unwrap();
    let wear = "control.plant_schedule=[{ start_s = 200.0, values = { k = 2.6 } }]";
    let told = "control.parameter_schedule=[{ start_s = 200.0, values = { k = 2.6 } }]";
    let halves =
        "control.references=[{ start_s = 0.0, value = [9.0] }, { start_s = 200.0, value = [8.5] }]";
    let run = |name: &str, sets: &[&str]| {
        let out = dir.path().join(name);
        let mut command = pinc(&["control", "--quiet", "--only", "rk4"]);
        command.arg(&config).arg("--out").arg(&out);
        for set in sets {
            command.args(["--set", set]);
        }
        let found = outcome(&mut command);
        assert_eq!(found.code, Some(0), "{found:?}");
        let text = fs::read_to_string(out.join("metrics.json")).unwrap();
        let metrics: serde_json::Value = serde_json::from_str(&text).unwrap();
        let control = &metrics["control"][0];
        let offset = |i: usize| control["offset"]["h"][i].as_f64().unwrap();
        (offset(0), offset(1), control["iae"].as_f64().unwrap())
    };
    let unchanged = run("unchanged", &[halves]);
    assert!(unchanged.0 < 0.05 && unchanged.1 < 0.05, "{unchanged:?}");
    let unaware = run("unaware", &[halves, wear]);
    assert!(unaware.0 < 0.05 && unaware.1 > 0.2, "{unaware:?}");
    let aware = run("aware", &[halves, wear, told]);
    assert!(aware.0 < 0.05 && aware.1 < 0.05, "{aware:?}");
    // Measured, it needs nobody to tell it, and is the same.
    let measured = "control.measured_parameters=[\"k\"]";
    let measured = run("measured", &[halves, wear, measured]);
    assert_eq!(measured.2.to_bits(), aware.2.to_bits());
    // A schedule that changes nothing is none.
    let same = "control.parameter_schedule=[{ start_s = 200.0, values = {} }]";
    let same = run("same", &[halves, same]);
    assert_eq!(same.2.to_bits(), unchanged.2.to_bits());
}

/// The pump wears to k = 2.0, outside the range 2.4 to 3.8 of the net: the steps from then on are
/// counted, by the parameter alone.
#[test]
fn steps_with_a_parameter_outside_its_range_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let wear = "control.plant_schedule=[{ start_s = 200.0, values = { k = 2.0 } }]";
    let sets = [
        wear,
        "control.measured_parameters=[\"k\"]",
        "control.models=[\"pinc\"]",
        "control.max_failed_share=1.0",
    ];
    let metrics = run(dir.path(), "worn", &sets);
    let found = &metrics["control"][0]["outside_domain"];
    assert_eq!((&found["samples"], &found["outside"]), (&40.into(), &20.into()), "{found}");
    let farthest = found["variables"]["k"]["farthest"].as_f64().unwrap();
    assert!((farthest - 0.4).abs() < 1e-12, "{found}");
}

/// A branch asks the net for its own value in each step.
#[test]
fn scenarios_outside_the_range_of_a_parameter_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let scenarios = "control.scenarios={ values = { k = [3.3, 4.0] } }";
    let metrics = run(dir.path(), "tree", &[scenarios, "control.models=[\"pinc\"]"]);
    let found = &metrics["control"][0]["outside_domain"];
    assert_eq!((&found["samples"], &found["outside"]), (&40.into(), &40.into()), "{found}");
    let farthest = found["variables"]["k"]["farthest"].as_f64().unwrap();
    assert!((farthest - 0.2).abs() < 1e-12, "{found}");
}

/// The net is asked for the input with its estimated disturbance.
#[test]
fn inputs_that_their_disturbance_leads_outside_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let estimator = r#"control.estimator={ kind = "ekf", process_sd = [0.01], measurement_sd = [0.01],
        initial_estimate = [5.0], initial_sd = [0.01], disturbance = "input",
        disturbance_sd = [0.1], disturbance_initial_sd = [0.5] }"#;
    let sets = [
        "control.measurement={}",
        &estimator.replace('\n', ""),
        "control.loads=[{ start_s = 100.0, inputs = { u = 2.0 } }]",
        "control.references=[{ start_s = 0.0, value = [19.0] }]",
        "control.models=[\"pinc\"]",
        "control.max_failed_share=1.0",
    ];
    let metrics = run(dir.path(), "load", &sets);
    let column = |file: &str, name: &str| -> Vec<[f64; 2]> {
        let text = fs::read_to_string(dir.path().join("load").join(file)).unwrap();
        let mut rows = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let place = rows.next().unwrap().iter().position(|of| *of == name).unwrap();
        rows.map(|row| [0, place].map(|i| row[i].parse().unwrap())).collect()
    };
    let (u, d) = (column("control.csv", "u"), column("estimates.csv", "d_u"));
    let asked = |[t, d]: &[f64; 2]| d + u.iter().find(|[at, _]| (at - t).abs() < 1e-6).unwrap()[1];
    let beyond: Vec<f64> = d.iter().map(|of| asked(of) - 4.45).filter(|by| *by > 1e-6).collect();
    let found = &metrics["control"][0]["outside_domain"]["variables"]["u"];
    assert!(beyond.len() > 3, "{beyond:?}");
    assert_eq!(found["samples"], beyond.len(), "{found} {beyond:?}");
    let most = beyond.iter().fold(0.0_f64, |most, by| most.max(*by));
    assert!((found["farthest"].as_f64().unwrap() - most).abs() < 1e-9, "{found} {most}");
}

/// As the controller above, one that estimates k asks the net for it outside the range: the estimates
/// in `estimates.csv` say when. Told to refuse that, the loop ends there, and so does a live step.
#[test]
fn steps_with_an_estimate_outside_its_range_are_counted_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let estimator = r#"control.estimator={ kind = "ekf", process_sd = [0.01], measurement_sd = [0.01],
        initial_estimate = [5.0], initial_sd = [0.01],
        parameters = [{ name = "k", initial = 3.3, initial_sd = 0.1, drift_sd = 0.05 }] }"#;
    let estimator = estimator.replace('\n', "");
    let wear = "control.plant_schedule=[{ start_s = 200.0, values = { k = 2.0 } }]";
    let sets = [
        "control.measurement={}",
        &estimator,
        wear,
        "control.models=[\"pinc\"]",
        "control.max_failed_share=1.0",
    ];
    let metrics = run(dir.path(), "worn", &sets);
    let estimates = fs::read_to_string(dir.path().join("worn/estimates.csv")).unwrap();
    let mut rows = estimates.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let place = rows.next().unwrap().iter().position(|name| *name == "k").unwrap();
    let below: Vec<f64> = rows.map(|row| 2.4 - row[place].parse::<f64>().unwrap()).collect();
    let expected = below.iter().filter(|below| **below > 0.0).count();
    let found = &metrics["control"][0]["outside_domain"];
    assert!(expected > 5, "{below:?}");
    assert_eq!(found["variables"]["k"]["samples"], expected, "{found}");
    let most = below.iter().fold(0.0_f64, |most, below| most.max(*below));
    let farthest = found["variables"]["k"]["farthest"].as_f64().unwrap();
    assert!((farthest - most).abs() < 1e-9, "{farthest} {most}");

    let model = dir.path().join("worn/model.safetensors").display().to_string();
    let refuse = [&sets[..], &["control.outside_domain=refuse"]].concat();
    let sets: Vec<&str> = refuse.iter().flat_map(|set| ["--set", *set]).collect();
    let mut control = pinc(&["control", "--quiet", "--model", &model, "--out"]);
    control.arg(dir.path().join("refused")).arg(dir.path().join("tanks.toml")).args(&sets);
    let refused = outcome(&mut control);
    assert_eq!(refused.code, Some(1), "{refused:?}");
    assert!(
        refused.stderr.contains("k is ") && refused.stderr.contains("2.4 to 3.8"),
        "{refused:?}"
    );
    let sets: Vec<&str> = ["--model", &model].into_iter().chain(sets).collect();
    let mut served = Served::of(&dir.path().join("tanks.toml"), ModelKind::Pinc, &sets);
    // A tank that stays low under a large input has a weak pump.
    let answers: Vec<String> =
        (0..12).map(|_| served.ask(&serde_json::json!({ "y": [4.0] })).to_string()).collect();
    assert!(answers.iter().any(|answer| answer.contains("2.4 to 3.8")), "{answers:?}");
}

#[test]
fn schedules_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("tanks.toml");
    fs::write(&config, FAMILY).unwrap();
    for (set, parts) in [
        (
            "control.parameter_schedule=[{ start_s = 200.0, values = { a = 0.07 } }]",
            &["control.parameter_schedule[0].values.a", "`a` is not known"][..],
        ),
        (
            "control.plant_schedule=[{ start_s = 205.0, values = { k = 2.6 } }]",
            &["control.plant_schedule[0].start_s", "whole number of steps"],
        ),
        (
            "control.plant_schedule=[{ start_s = 400.0, values = { k = 2.6 } }]",
            &["less than the duration of the run, 400"],
        ),
        (
            "control.plant_schedule=[{ start_s = 20.0, values = {} }, { start_s = 10.0, values = {} }]",
            &["control.plant_schedule[1].start_s", "more than 20"],
        ),
        ("control.measured_parameters=[\"a\"]", &["control.measured_parameters[0]", "`a`"]),
        ("control.measured_parameters=[\"k\", \"k\"]", &["each parameter once"]),
    ] {
        let mut command = pinc(&["check"]);
        outcome(command.arg(&config).args(["--set", set])).assert_refused(parts);
    }
    let mut command = pinc(&["serve", "--only", "rk4"]);
    let set = "control.parameter_schedule=[{ start_s = 200.0, values = { k = 2.6 } }]";
    outcome(command.arg(&config).args(["--set", set])).assert_refused(&["parameter_schedule"]);
}

#[test]
fn a_free_run_is_given_the_parameters_as_columns() {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), "run", &[]);
    let path = |name: &str| dir.path().join(name);
    let predict = |inputs: &str| {
        fs::write(path("in.csv"), inputs).unwrap();
        let mut command = pinc(&["predict", "--model"]);
        command.arg(path("run/model.safetensors")).arg("--inputs").arg(path("in.csv"));
        outcome(command.arg("--output").arg(path("out.csv")))
    };
    // The pump wears at 10 s: from there on the level rises less.
    let outcome = predict(
        "scenario,t,u,k,h\na,0,3,3.6,8\na,10,3,2.6,\na,20,3,2.6,\nb,0,3,3.6,8\nb,10,3,3.6,\nb,20,3,3.6,\n",
    );
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let text = fs::read_to_string(path("out.csv")).unwrap();
    let levels: Vec<f64> =
        text.lines().skip(1).map(|row| row.rsplit(',').next().unwrap().parse().unwrap()).collect();
    assert!((levels[1] - levels[4]).abs() < 1e-12, "{levels:?}");
    assert!(levels[5] - levels[2] > 0.5, "{levels:?}");
    predict("scenario,t,u,h\na,0,3,8\n").assert_refused(&["in.csv:1: ", "`k`"]);
}

/// A net of the family and the equation find the same pump in a record; what the net does not take
/// it cannot find.
#[test]
fn a_net_of_a_family_identifies_as_the_equation_does() {
    let dir = tempfile::tempdir().unwrap();
    let section =
        "[identify]\ninitial_state = [8.0]\nparameters = [{ name = \"k\", initial = 3.3 }]\n";
    fs::write(dir.path().join("tanks.toml"), format!("{FAMILY}{section}")).unwrap();
    let config = dir.path().join("tanks.toml");
    let run = |command: &[&str], out: &str| {
        let mut program = pinc(command);
        program.arg(&config).arg("--out").arg(dir.path().join(out));
        program
    };
    assert_eq!(outcome(&mut run(&["train", "--quiet"], "net")).code, Some(0));
    // The levels of a pump with k = 2.8, of which the still water says how far they rise.
    let (mut h, mut csv) = (8.0f64, "t,u,y_h\n".to_owned());
    for step in 0..60 {
        let u = if (step / 10) % 2 == 0 { 3.0 } else { 2.4 };
        csv += &format!("{},{u},{h}\n", 10 * step);
        for _ in 0..1000 {
            h += 0.01 * (2.8 * u - 0.071 * (1962.0 * h).sqrt()) / 28.0;
        }
    }
    fs::write(dir.path().join("data.csv"), csv).unwrap();
    let net = dir.path().join("net/model.safetensors");
    let identified = |arguments: &[&str], out: &str| {
        let mut program = run(&["identify"], out);
        program.arg("--data").arg(dir.path().join("data.csv")).arg("--model").arg(&net);
        let found = outcome(program.args(arguments));
        assert_eq!(found.code, Some(0), "{found:?}");
        let text = fs::read_to_string(dir.path().join(out).join("identify.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let k = json["parameters"]["k"]["value"].as_f64().unwrap();
        (json["model"].as_str().unwrap().to_owned(), k, json["parameters"]["k"]["high"].clone())
    };
    let (model, by_net, high) = identified(&[], "by-net");
    // The net's range is a bound: beyond it the net knows nothing.
    assert_eq!((model.as_str(), high.as_f64()), ("pinc", Some(3.8)));
    let (model, by_equation, _) = identified(&["--only", "rk4"], "by-equation");
    assert_eq!(model, "rk4");
    assert!((by_equation - 2.8).abs() < 0.05, "{by_equation}");
    assert!((by_net - by_equation).abs() < 0.05, "{by_net} {by_equation}");
    let mut other = run(&["identify"], "other");
    other.arg("--data").arg(dir.path().join("data.csv")).arg("--model").arg(&net);
    other.args(["--set", "identify.parameters=[{ name = \"a\", initial = 0.07 }]"]);
    outcome(&mut other).assert_refused(&["does not take `a` as an input, but k"]);
}

#[test]
fn parameters_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("tanks.toml");
    fs::write(&config, FAMILY).unwrap();
    for (set, parts) in [
        ("domain.parameters={kk=[2.4, 3.8]}", &["domain.parameters.kk", "did you mean `k`?"][..]),
        ("domain.parameters={k=[3.8, 2.4]}", &["domain.parameters", "k = [3.8, 2.4]"]),
        ("control.parameters={a=0.07}", &["control.parameters.a", "one of [domain.parameters]"]),
        ("validation.domain.parameters={a=[0.06, 0.08]}", &["validation.domain.parameters"]),
        ("plant={two-link-arm={}}", &["domain.parameters.k", "l1, l2, m1, m2"]),
    ] {
        let mut command = pinc(&["check"]);
        let outcome = outcome(command.arg(&config).args(["--set", set]));
        outcome.assert_refused(parts);
    }
}

/// A net that is used as one member of its family is outside its training domain where that member is:
/// to `pinc check`, and in served steps as in a loop. So is one whose plans have intervals that reach
/// outside.
#[test]
fn a_member_outside_the_range_of_its_parameter_is_counted_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), "trained", &["control.models=[\"pinc\"]", "control.max_failed_share=1.0"]);
    let model = dir.path().join("trained/model.safetensors").display().to_string();
    let config = dir.path().join("tanks.toml");
    let member = "control.parameters={ k = 2.2 }";
    let interval =
        "control.uncertainty={ probability = \"worst-case\", parameters = { k = [2.2, 3.0] } }";
    for set in [member, interval] {
        let sets = ["--model", &model, "--set", set, "--set", "control.outside_domain=refuse"];
        let out = tempfile::tempdir().unwrap();
        let mut command = pinc(&["control", "--quiet", "--only", "pinc", "--out"]);
        let refused = outcome(command.arg(out.path().join("run")).arg(&config).args(sets));
        assert_eq!(refused.code, Some(1), "{refused:?}");
        assert!(refused.stderr.contains("k is 0.200 beyond 2.4 to 3.8"), "{refused:?}");
        let mut served = Served::of(&config, ModelKind::Pinc, &sets);
        let answer = served.ask(&serde_json::json!({ "y": [5.0] })).to_string();
        assert!(answer.contains("k is 0.200 beyond 2.4 to 3.8"), "{answer}");
        let mut served = Served::of(&config, ModelKind::Pinc, &sets[..4]);
        let answer = served.ask(&serde_json::json!({ "y": [5.0] }));
        assert!(answer["u"].is_array(), "{answer}");
        let mut command = pinc(&["check", "--set", "control.models=[\"pinc\"]"]);
        let found = outcome(command.arg(&config).args(&sets[2..4]));
        let said = "the net is used with k down to 2.2, but trained from 2.4 to 3.8";
        assert!(found.stdout.contains(said), "{found:?}");
    }
}
