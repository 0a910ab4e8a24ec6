//! Searches: candidates drawn at random, and successive halving among them.

use crate::common::{outcome, pinc, repository};
use crate::sweep::{SWEEP, read, rows, run, tables};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

const SEARCH: &str = r#"
[sweep]
seeds = [1, 2]

[sweep.search]
candidates = 8
minimize = "mse_gen"
ranges = [
    { key = "model.neurons", low = 2, high = 6, whole = true, log = true },
    { key = "model.horizon_s", values = [10.0, 20.0] },
    { key = "training.lambda", low = 0.1, high = 10.0, log = true },
]
"#;

const HALVING: &str = r#"
[sweep.search.halving]
key = "training.phases.0.iterations"
least = 20
factor = 2
rungs = 3
"#;

/// A folder with the config of a search.
fn search(more: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("search.toml");
    let base = &SWEEP[..SWEEP.find("[sweep]").unwrap()];
    fs::write(&config, format!("{base}{SEARCH}{more}")).unwrap();
    (dir, config)
}

#[test]
fn a_random_search_is_the_same_in_shards_and_finds_the_best_candidate() {
    let (dir, config) = search("");
    let at = |name: &str| dir.path().join(name);
    let set = ["--set", "training.phases.0.iterations=30"];
    let found = outcome(
        pinc(&["run".as_ref(), config.as_os_str(), "--out".as_ref(), at("whole").as_os_str()])
            .args(set),
    );
    assert_eq!(found.code, Some(0), "{found:?}");
    let trials = rows(&read(&at("whole"), "sweep.csv"));
    assert_eq!(trials.len(), 16);
    for trial in &trials {
        let number = |key: &str| trial[key].parse::<f64>().unwrap();
        assert!([2.0, 3.0, 4.0, 5.0, 6.0].contains(&number("model.neurons")));
        assert!([10.0, 20.0].contains(&number("model.horizon_s")));
        assert!((0.1..=10.0).contains(&number("training.lambda")));
    }
    for shard in ["1/2", "2/2"] {
        let out = at(&shard[..1]);
        assert_eq!(run(&config, &out, &[&set[..], &["--shard", shard]].concat()).code, Some(0));
    }
    let mut merge = pinc(&["merge", "--quiet", "--out"]);
    merge.arg(at("merged")).args([at("1"), at("2")]);
    assert_eq!(outcome(&mut merge).code, Some(0));
    assert_eq!(tables(&at("merged")), tables(&at("whole")));
    // The best one by its median over seeds, and its config.
    let mean = |candidate: usize| {
        let of = trials.iter().filter(|t| t["candidate"] == candidate.to_string());
        of.map(|t| t["mse_gen"].parse::<f64>().unwrap()).sum::<f64>() / 2.0
    };
    let best = (1..=8).min_by(|a, b| mean(*a).total_cmp(&mean(*b))).unwrap();
    assert!(found.stdout.contains(&format!("best        candidate {best}, ")), "{found:?}");
    let text = read(&at("whole"), "best.toml");
    assert_eq!(read(&at("merged"), "best.toml"), text);
    let row = trials.iter().find(|t| t["candidate"] == best.to_string()).unwrap();
    assert!(text.contains(&format!("\nneurons = {}\n", row["model.neurons"])), "{text}");
    let config = at("whole").join("best.toml");
    assert!(text.contains("\nseed = 3\n"), "the config's own: {text}");
    let train = ["train".as_ref(), config.as_os_str(), "--set".as_ref(), "seed=1".as_ref()];
    let trained = outcome(pinc(&train).arg("--out").arg(at("best")));
    assert_eq!(trained.code, Some(0), "{trained:?}");
    let metrics = read(&at("best"), "metrics.json");
    assert!(metrics.contains(&format!("\"mse_gen\": {}", row["mse_gen"])), "{metrics}");
    // More candidates leave the first as they were.
    let more = run(
        &config_of(&dir),
        &at("more"),
        &["--shard", "1/100", "--set", "sweep.search.candidates=9"],
    );
    assert_eq!(more.code, Some(0), "{more:?}");
    let ids = |rows: &[std::collections::HashMap<String, String>]| {
        rows.iter().take(8).map(|t| t["training.lambda"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(ids(&rows(&read(&at("more"), "sweep.csv"))), ids(&trials));
}

/// A sweep of two candidates of each of two cases, judged by draws of the initial state; and one
/// whose loops all fail.
#[test]
fn the_best_candidate_is_the_config_with_its_values_and_none_of_the_draws() {
    let sweep = r#"
[sweep]
seeds = [1, 2]
cases = [{ name = "A", set = {} }, { name = "B", set = { "control.input_high" = [4.0] } }]
draws = [{ name = "x0", count = 2, ranges = [{ key = "control.initial_state.0", low = 4.5, high = 5.5 }] }]
[sweep.search]
candidates = 2
minimize = "rk4_iae_dense_sum"
ranges = [{ key = "control.r.0", low = 0.1, high = 10.0 }]
"#;
    let base = fs::read_to_string(repository("configs/smoke/rk4-only.toml")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (config_of(&dir), dir.path().join("out"));
    fs::write(&config, format!("{base}{sweep}")).unwrap();
    let found = run(&config, &out, &[]);
    assert_eq!(found.code, Some(0), "{found:?}");
    let trials = rows(&read(&out, "sweep.csv"));
    let text = read(&out, "best.toml");
    let [best, own]: [toml::Table; 2] = [&text, &base].map(|text| toml::from_str(text).unwrap());
    let of = |table: &toml::Table, key: &str| table["control"][key].clone();
    assert_eq!(best["seed"], own["seed"]);
    assert_eq!(of(&best, "initial_state"), of(&own, "initial_state"));
    let r = of(&best, "r")[0].as_float().unwrap();
    let cell = |trial: &std::collections::HashMap<String, String>| {
        trial["control.r.0"].parse::<f64>().unwrap()
    };
    assert!(trials.iter().any(|trial| (cell(trial) - r).abs() < 1e-12), "{text}");
    assert!(text.contains("\n# case = ") && !text.contains("# case = B, draw"), "{text}");
    assert!(!text.contains("draw = ") && !text.contains("initial_state.0 ="), "{text}");
    assert!(read(&out, "summary.csv").contains("rk4_iae_dense_sum,4,0,0,4,4,"));

    // Loops of two steps have no offset.
    let none =
        ["--set", "sweep.search.minimize=\"rk4_offset_max\"", "--set", "control.duration_s=20.0"];
    let none = run(&config, &dir.path().join("none"), &none);
    assert_eq!(none.code, Some(1), "{none:?}");
    assert!(none.stderr.contains("no trial has a value of rk4_offset_max"), "{none:?}");

    let fails = ["--fresh", "--set", "control.sqp.max_iterations=1"];
    let failed = run(&config, &dir.path().join("failed"), &fails);
    assert_eq!(failed.code, Some(1), "{failed:?}");
    let trials = rows(&read(&dir.path().join("failed"), "sweep.csv"));
    for trial in trials {
        let [status, error] = ["status", "error"].map(|column| trial[column].as_str());
        assert!(status == "failed" && error.contains("control.max_failed_share"), "{trial:?}");
    }
}

/// Two values for one key, of which one would be ignored, and trials that would count twice.
#[test]
fn keys_that_two_parts_of_a_sweep_set_are_named() {
    let axis = "grid = [{ key = \"control.n2\", also = [\"control.nu\"], values = [4, 6] }";
    let draws =
        |ranges: &str| format!("draws = [{{ name = \"d\", count = 2, ranges = [{ranges}] }}]");
    let range = "{ key = \"control.r.0\", low = 0.1, high = 1.0 }";
    let case = |key: &str| format!("cases = [{{ name = \"c\", set = {{ {key} }} }}]");
    for (sweep, parts) in [
        (
            format!("{axis}, {{ key = \"control.nu\", values = [3] }}]"),
            ["grid[1].key", "control.nu"],
        ),
        (format!("{axis}]\n{}", case("\"control.n2\" = 7")), ["grid[0].key", "control.n2"]),
        (draws(&format!("{range}, {range}")), ["draws[0].ranges[1].key", "control.r.0"]),
        (
            format!("{}\n{}", case("\"control.r.0\" = 1.0"), draws(range)),
            ["draws[0].ranges[0].key", "control.r.0"],
        ),
        (
            format!(
                "{}\ngrid = [{{ key = \"control.r\", values = [[1.0]] }}]",
                case("\"control.r.0\" = 1.0")
            ),
            ["grid[0].key", "control.r"],
        ),
        (draws(""), ["draws[0].ranges", "equal otherwise"]),
        ("seeds = [1, 2, 1]".to_owned(), ["sweep.seeds", "1 twice"]),
        (
            "grid = [{ key = \"control.n2\", values = [4, 4] }]".to_owned(),
            ["grid[0].values", "4 twice"],
        ),
    ] {
        let base = fs::read_to_string(repository("configs/smoke/rk4-only.toml")).unwrap();
        let dir = tempfile::tempdir().unwrap();
        fs::write(config_of(&dir), format!("{base}\n[sweep]\n{sweep}\n")).unwrap();
        run(&config_of(&dir), &dir.path().join("out"), &[]).assert_refused(&parts);
    }
}

fn config_of(dir: &tempfile::TempDir) -> PathBuf {
    dir.path().join("search.toml")
}

#[test]
fn halving_gives_the_best_of_each_rung_more_and_is_the_same_however_it_is_run() {
    let (dir, config) = search(HALVING);
    let at = |name: &str| dir.path().join(name);
    let begun = Instant::now();
    assert_eq!(run(&config, &at("whole"), &[]).code, Some(0));
    let duration = begun.elapsed();
    let trials = rows(&read(&at("whole"), "sweep.csv"));
    let key = "training.phases.0.iterations";
    let of = |budget: &str, status: &str| {
        let of = trials.iter().filter(|t| t[key] == budget && t["status"] == status);
        let mut candidates: Vec<_> = of.map(|t| t["candidate"].clone()).collect();
        candidates.sort();
        candidates.dedup();
        candidates
    };
    assert_eq!((of("20", "done").len(), of("20", "dropped").len()), (8, 0));
    assert_eq!((of("40", "done").len(), of("40", "dropped").len()), (4, 4));
    assert_eq!((of("80", "done").len(), of("80", "dropped").len()), (2, 6));
    // Those that go on are the best.
    for (budget, next) in [("20", "40"), ("40", "80")] {
        let score = |candidate: &String| {
            let mut of = trials.iter().filter(|t| t[key] == budget && t["candidate"] == *candidate);
            let value = |t: &std::collections::HashMap<String, String>| t["mse_gen"].parse::<f64>();
            f64::midpoint(value(of.next().unwrap()).unwrap(), value(of.next().unwrap()).unwrap())
        };
        let (up, all) = (of(next, "done"), of(budget, "done"));
        let worst = up.iter().map(score).fold(0.0, f64::max);
        let left = all.iter().filter(|candidate| !up.contains(candidate)).map(score);
        assert!(left.fold(f64::INFINITY, f64::min) >= worst);
    }
    let report = read(&at("whole"), "report.html");
    assert!(report.contains("Best candidates by mse_gen"));
    assert!(at("whole").join("figures/search.svg").exists());

    // Killed and resumed.
    let mut command = pinc(&["run".as_ref(), config.as_os_str(), "--quiet".as_ref()]);
    command.args(["--resume", "--out"]).arg(at("killed")).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    std::thread::sleep(duration.mul_f64(0.5).max(Duration::from_millis(20)));
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(run(&config, &at("killed"), &["--resume"]).code, Some(0));
    assert_eq!(tables(&at("killed")), tables(&at("whole")));

    // Shared by two processes, which wait for one another.
    let share = |number: &str| {
        let mut command = pinc(&["run".as_ref(), config.as_os_str(), "--quiet".as_ref()]);
        command.args(["--resume", "--shared", "--shard", number, "--out"]).arg(at("shared"));
        command.spawn().unwrap()
    };
    let (mut first, mut second) = (share("1/2"), share("2/2"));
    assert!(first.wait().unwrap().success() && second.wait().unwrap().success());
    assert_eq!(tables(&at("shared")), tables(&at("whole")));

    // Shares in directories of their own know the first rung only; merged, the rest is done.
    for shard in ["1/2", "2/2"] {
        assert_eq!(run(&config, &at(&shard[..1]), &["--shard", shard]).code, Some(0));
    }
    assert!(rows(&read(&at("1"), "sweep.csv")).iter().any(|t| t["status"] == "pending"));
    let mut merge = pinc(&["merge", "--quiet", "--out"]);
    assert_eq!(outcome(merge.arg(at("merged")).args([at("1"), at("2")])).code, Some(0));
    assert_eq!(run(&config, &at("merged"), &["--resume"]).code, Some(0));
    assert_eq!(tables(&at("merged")), tables(&at("whole")));
}

#[test]
fn mistakes_in_a_search_are_named() {
    let refused = |from: &str, to: &str, parts: &[&str]| {
        let (dir, config) = search(HALVING);
        let text = fs::read_to_string(&config).unwrap();
        assert!(text.contains(from), "{from}");
        fs::write(&config, text.replacen(from, to, 1)).unwrap();
        let out = dir.path().join("out");
        run(&config, &out, &[]).assert_refused(parts);
        assert!(!Path::new(&out).exists());
    };
    refused("\"mse_gen\"", "\"mse\"", &["`sweep.search.minimize`", "mse_gen, ", "pinc_rmse"]);
    refused("low = 2, high = 6", "low = 6, high = 6", &["`sweep.search.ranges[0]`", "below"]);
    refused("low = 0.1", "low = 0.0", &["`sweep.search.ranges[2]`", "positive ends"]);
    refused("values = [10.0, 20.0]", "values = [10.0, 7.0]", &["in the trial with", "candidate"]);
    refused(
        "key = \"model.horizon_s\"",
        "key = \"model.neurons\"",
        &["`sweep.search.ranges[1].key`"],
    );
    refused("factor = 2", "factor = 1", &["`sweep.search.halving.factor`", "2 or more"]);
    refused("candidates = 8", "candidates = 100000", &["600000 trials"]);
}
