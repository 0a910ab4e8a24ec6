//! Lists of experiments, the page made of them, and plants in the loop that the models do not know.

use crate::common::{outcome, pinc, repository};
use pinc_config::{Experiment, Plants, RunList};
use pinc_runs::{Options, Verbosity};
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A short closed loop of the four tanks with RK4.
const LOOP: &str = r#"
name = "four-tanks-worst-case"
preset = "ours"
seed = 1

[plant]
four-tanks = { parameters = "antonelo" }

[control]
models = ["rk4"]
step_s = 10.0
duration_s = 200.0
initial_state = [9.0, 9.0, 0.6, 0.6]
controlled = ["h1", "h2"]
q = [10.0, 10.0]
r = [1.0, 1.0]
input_low = [0.0, 0.0]
input_high = [5.0, 5.0]
references = [{ start_s = 0.0, value = [9.16, 14.21] }]
repetitions = 1
"#;

#[test]
fn the_papers_lists_are_valid() {
    for (name, least) in [("paper", 20), ("paper-quick", 11)] {
        let path = repository("configs").join(format!("{name}.toml"));
        let list = RunList::load(&path).unwrap().unwrap();
        assert_eq!(list.name, name);
        let experiments = list.experiments(&path, &[], &Plants::built_in()).unwrap();
        assert!(experiments.len() >= least, "{}", experiments.len());
        let mut places: Vec<_> = experiments.iter().map(|(_, place)| place).collect();
        places.sort();
        places.dedup();
        assert_eq!(places.len(), experiments.len(), "two runs share a directory");
    }
    assert_eq!(RunList::load(&repository("configs/smoke/rk4-only.toml")).unwrap(), None);
}

#[test]
fn a_list_runs_all_and_its_page_has_their_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("loop.toml"), LOOP).unwrap();
    // A loop with a net that nothing trains: that shows when it is run.
    let broken = LOOP.replace("worst-case", "broken").replace("[\"rk4\"]", "[\"pinc\"]");
    fs::write(at("broken.toml"), broken).unwrap();
    let list = r#"
        name = "list"
        runs = [
            { config = "broken.toml" },
            { config = "loop.toml", presets = ["ours", "as-released"], set = ["control.n2=4", "control.nu=4"] },
        ]
    "#;
    fs::write(at("list.toml"), list).unwrap();
    let mut command = pinc(&["run".as_ref(), at("list.toml").as_os_str()]);
    let ran = outcome(command.arg("--quiet").arg("--out").arg(at("out")));
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.stderr.contains("1 of 3 experiments failed"), "{ran:?}");

    let page = outcome(&mut pinc(&["results".as_ref(), at("out").as_os_str()]));
    assert_eq!(page.code, Some(0), "{page:?}");
    for preset in ["ours", "as-released"] {
        let run = at("out").join("four-tanks-worst-case").join(preset);
        let metrics = fs::read_to_string(run.join("metrics.json")).unwrap();
        let metrics: pinc_record::Metrics = serde_json::from_str(&metrics).unwrap();
        let row = format!("| `{preset}` | RK4 | {:.2} |", metrics.control[0].iae_dense_sum);
        assert!(page.stdout.contains(&row), "{row}: {}", page.stdout);
    }

    // In a file it has pictures beside it.
    let results = |out: &Path| {
        let mut command = pinc(&["results".as_ref(), at("out").as_os_str()]);
        outcome(command.arg("--out").arg(out))
    };
    assert_eq!(results(&at("page.md")).code, Some(0));
    let illustrated = fs::read_to_string(at("page.md")).unwrap();
    let picture = "page/four-tanks-worst-case-ours-control.svg";
    assert!(illustrated.contains(&format!("]({picture})")), "{illustrated}");
    assert!(fs::read_to_string(at(picture)).unwrap().starts_with("<svg"));
    results(&at("page")).assert_refused(&["--out", "results.md"]);
    outcome(&mut pinc(&["results".as_ref(), at("nothing").as_os_str()]))
        .assert_refused(&["nothing", "no runs of the paper's experiments"]);
}

#[test]
fn mistakes_in_lists_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("list.toml");
    let refused = |text: &str, parts: &[&str]| {
        fs::write(&path, text).unwrap();
        outcome(&mut pinc(&["run".as_ref(), path.as_os_str()])).assert_refused(parts);
    };
    refused("name = \"a\"\nruns = [{ confg = \"x\" }]", &["list.toml:2", "did you mean `config`?"]);
    refused("name = \"a\"\nruns = [{ config = \"x.toml\" }]", &["x.toml", "cannot be read"]);
    refused("name = \"a/b\"\nruns = []", &["list.toml:1: `name`", "a name for a directory"]);
    refused("runs = []", &["`name`: missing"]);
}

fn iae(sets: &[&str]) -> f64 {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let experiment =
        Experiment::parse(Path::new("loop.toml"), LOOP, &sets, &Plants::built_in()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let interrupt = AtomicBool::new(false);
    let (verbosity, interrupt) = (Verbosity::Quiet, &interrupt);
    let options = Options { resume: false, verbosity, interrupt, arguments: &[] };
    let record = pinc_runs::run(&experiment, dir.path(), &options).unwrap();
    record.metrics().control[0].iae_dense_sum
}

#[test]
fn the_plant_in_the_loop_may_differ_from_the_models() {
    let plant = |pump: &str| {
        format!("control.plant={{ four-tanks = {{ parameters = \"antonelo\", pump = {pump} }} }}")
    };
    // The nominal constants written out are the nominal plant, bit for bit.
    let nominal = iae(&[]);
    assert_eq!(iae(&[&plant("[3.33, 3.35]")]).to_bits(), nominal.to_bits());
    // Pumps that the model overestimates, or knows to be weaker: the same plant, other plans.
    let weak = iae(&[&plant("[3.0, 3.0]")]);
    let known = "plant={ four-tanks = { parameters = \"antonelo\", pump = [3.0, 3.0] } }";
    let known = iae(&[known]);
    assert!((weak - nominal).abs() > 1e-3 * nominal, "{weak} {nominal}");
    assert!((weak - known).abs() > 1e-3 * nominal, "{weak} {known}");

    let refused = |set: &str, part: &str| {
        let error =
            Experiment::parse(Path::new("loop.toml"), LOOP, &[set.to_owned()], &Plants::built_in());
        let error = error.unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    };
    refused("control.plant={ one-tank = {} }", "expected one with the states h1, h2, h3, h4");
    refused(&plant("[-1.0, 3.0]"), "`control.plant.four-tanks.pump[0]`: -1 given");
    let equations = "control.plant={ expression = { states = [\"h1\"], inputs = [\"u1\"], \
                     derivatives = { h1 = \"u2\" } } }";
    refused(equations, "`control.plant.expression.derivatives.h1`: unknown name `u2`");
    let gamma = "plant={ four-tanks = { parameters = \"antonelo\", gamma = [0.5, 1.5] } }";
    refused(gamma, "`plant.four-tanks.gamma[1]`: 1.5 given, expected a share from 0 to 1");
}
