//! `pinc compare`: runs side by side.

use crate::common::{Outcome, outcome, pinc, repository};
use std::fs;
use std::path::Path;

fn control(config: &str, out: &Path, set: &str) {
    let mut command = pinc(&["control", "--quiet", "--set", set, "--out"]);
    let ended = outcome(command.arg(out).arg(repository(config)));
    assert_eq!(ended.code, Some(0), "{ended:?}");
}

fn compare(dirs: &[&Path], more: &[&Path]) -> Outcome {
    let mut command = pinc(&["compare"]);
    outcome(command.args(dirs).args(more))
}

#[test]
fn runs_are_compared_in_numbers_and_in_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| dir.path().join(name));
    control("configs/smoke/rk4-only.toml", &one, "seed=7");
    control("configs/smoke/rk4-only.toml", &two, "control.r=[100.0]");
    let said = compare(&[&one, &two], &[]);
    assert_eq!(said.code, Some(0), "{said:?}");
    let line = |start: &str| {
        let mut lines = said.stdout.lines().map(str::trim);
        lines.find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("no {start}"))
    };
    assert!(line("control.r").ends_with("[100.0]"), "{}", line("control.r"));
    // Changes of the input cost more, so the level follows later.
    assert!(line("IAE, dense trace").ends_with("higher)"), "{}", line("IAE, dense trace"));
    assert!(!said.stdout.contains("seed"), "what is the same is not said: {}", said.stdout);

    let page = dir.path().join("both.html");
    let said = compare(&[&one, &two], &["--out".as_ref(), &page]);
    assert_eq!((said.code, said.stdout.trim()), (Some(0), page.to_str().unwrap()));
    let html = fs::read_to_string(&page).unwrap();
    for part in ["<section id=\"control\">", "<section id=\"steps\">", "Closed loops", "one", "two"]
    {
        assert!(html.contains(part), "no {part}");
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3);

    // A page may lie in the directory of a run, but not in the place of its files.
    let inside = two.join("both.html");
    for _ in 0..2 {
        assert_eq!(compare(&[&one, &two], &["--out".as_ref(), &inside]).code, Some(0));
    }
    for name in ["metrics.json", "report.html"] {
        let kept = fs::read(two.join(name)).unwrap();
        let said = compare(&[&one, &two], &["--out".as_ref(), &two.join(name)]);
        said.assert_refused(&["--out", name, "is also a file of the run", "overwrite"]);
        assert!(fs::read(two.join(name)).unwrap() == kept, "{name}");
    }
}

#[test]
fn what_cannot_be_compared_is_refused_in_words() {
    let dir = tempfile::tempdir().unwrap();
    let [tank, oscillator, empty] = ["tank", "oscillator", "empty"].map(|n| dir.path().join(n));
    control("configs/smoke/rk4-only.toml", &tank, "seed=7");
    fs::create_dir(&empty).unwrap();
    let found = dir.path().join("found");
    let mut identify = pinc(&["identify", "--quiet", "--starts", "1", "--out"]);
    identify.arg(&found).arg(repository("configs/identification/tanks.toml"));
    identify.arg("--data").arg(repository("configs/identification/tanks.csv"));
    assert_eq!(outcome(&mut identify).code, Some(0));
    compare(&[&found, &found], &[]).assert_refused(&["results of `pinc identify`", "report.html"]);
    compare(&[&tank, &empty], &[]).assert_refused(&["empty", "no config.toml of a run"]);
    compare(&[&tank, &dir.path().join("none")], &[]).assert_refused(&["none: not a directory"]);
    outcome(pinc(&["status"]).arg(dir.path().join("none"))).assert_refused(&["it does not exist"]);
    let alone = compare(&[&tank], &[]);
    assert_eq!(alone.code, Some(2), "{alone:?}");

    let mut command = pinc(&["control", "--quiet", "--only", "rk4", "--out"]);
    let config = repository("configs/smoke/van-der-pol.toml");
    assert_eq!(outcome(command.arg(&oscillator).arg(config)).code, Some(0));
    compare(&[&tank, &oscillator], &[]).assert_refused(&[
        "its plant is van-der-pol with states x1, x2, inputs u",
        "expected the plant of",
        "one-tank with states h (cm), inputs u (V)",
    ]);
    fs::remove_file(oscillator.join("metrics.json")).unwrap();
    compare(&[&oscillator, &tank], &[]).assert_refused(&["the run has no metrics.json"]);
}

/// Only errors are printed, by `check` too.
#[test]
fn quiet_commands_print_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| dir.path().join(name));
    control("configs/smoke/rk4-only.toml", &one, "seed=7");
    control("configs/smoke/rk4-only.toml", &other, "seed=8");
    for (quiet, prints) in [(&[][..], true), (&["--quiet"], false)] {
        let found = outcome(pinc(&["compare"]).args([&one, &other]).args(quiet));
        assert_eq!((found.code, !found.stdout.is_empty()), (Some(0), prints), "{found:?}");
        let config = repository("configs/smoke/van-der-pol.toml");
        let found = outcome(pinc(&["check"]).args(quiet).arg(config));
        assert_eq!((found.code, !found.stdout.is_empty()), (Some(0), prints), "{found:?}");
    }
}
