//! Every mistake in a config is an error that names file, line, key and what was expected, with
//! exit code 2.

use crate::common::{Outcome, outcome, pinc, repository, smoke};

/// Checks the smoke config with `from` replaced by `to`.
fn check_with(from: &str, to: &str) -> Outcome {
    let text = smoke();
    assert!(text.contains(from), "`{from}` is not in the config");
    check(&text.replacen(from, to, 1))
}

fn check(text: &str) -> Outcome {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("experiment.toml");
    std::fs::write(&path, text).unwrap();
    outcome(&mut pinc(&["check".as_ref(), path.as_os_str()]))
}

/// `experiment.toml:<line>` of the first line of the smoke config that begins with `start`.
fn place(start: &str) -> String {
    let line = smoke().lines().position(|line| line.starts_with(start)).unwrap();
    format!("experiment.toml:{}: ", line + 1)
}

#[test]
fn the_config_itself_is_valid() {
    let outcome = check(&smoke());
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(outcome.stdout.contains("a valid config of smoke-van-der-pol"), "{outcome:?}");
}

#[test]
fn misspelt_keys_name_the_right_one() {
    let expected = ["`control.repetitons`: unknown key", "did you mean `repetitions`?"];
    let outcome = check_with("repetitions = 2", "repetitons = 2");
    outcome.assert_refused(&expected);
    outcome.assert_refused(&[&place("repetitions")]);

    let expected = ["`training.thread`", "did you mean `threads`?"];
    check_with("validation_every = 50", "thread = 1").assert_refused(&expected);
    let expected = ["`modle`: unknown key", "did you mean `model`?"];
    check_with("[model]", "[modle]").assert_refused(&expected);
    // Nothing looks like this one, but the known ones are listed.
    let expected = ["`model.q`: unknown key", "neurons"];
    check_with("neurons = 10", "neurons = 10\nq = 1").assert_refused(&expected);
}

#[test]
fn keys_inside_lists_and_variants_are_named() {
    let expected = ["`training.phases[0].optimizer.self-scaled-broyden.initial_stepp`"];
    check_with("initial_step =", "initial_stepp =").assert_refused(&expected);
    let expected = ["`control.references[1].value`: missing", &place("    { start_s = 2.5")];
    check_with("{ start_s = 2.5, value = [-0.5, 0.0] }", "{ start_s = 2.5 }")
        .assert_refused(&expected);
    let expected = ["`plant.van-der-pol.nu`: unknown key", &place("van-der-pol")];
    check_with("mu = 1.0", "mu = 1.0, nu = 2").assert_refused(&expected);
}

#[test]
fn wrong_types() {
    let expected = ["`model.horizon_s`: invalid type: string \"half\", expected a number"];
    let outcome = check_with("horizon_s = 0.5", "horizon_s = \"half\"");
    outcome.assert_refused(&expected);
    outcome.assert_refused(&[&place("horizon_s")]);
    let expected = ["`control.n2`", "expected a whole number"];
    check_with("repetitions = 2", "n2 = 5.0").assert_refused(&expected);
    check_with("seed = 7", "seed = -7").assert_refused(&["`seed`", "expected a whole number"]);
    let expected = ["`control.models[0]`: `pink` is not known", "did you mean `pinc`?"];
    check_with("repetitions = 2", "models = [\"pink\"]").assert_refused(&expected);
    let expected = ["`plant`: no key or several given, expected exactly one"];
    check_with("[model]", "one-tank = {}\n[model]").assert_refused(&expected);
}

#[test]
fn mandatory_keys() {
    for (line, key) in [
        ("seed = 7", "`seed`: missing"),
        ("name = \"smoke-van-der-pol\"", "`name`: missing"),
        ("preset = \"ours\"", "`preset`: missing"),
        ("horizon_s = 0.5", "`model.horizon_s`: missing"),
        ("hidden_layers = 2", "`model.hidden_layers`: missing"),
    ] {
        check_with(line, "").assert_refused(&["experiment.toml:", key]);
    }
    check_with("[domain]", "[validation.domain]").assert_refused(&["not valid TOML"]);
    let without_domain: String = {
        let text = smoke();
        let (before, rest) = text.split_once("[domain]").unwrap();
        let (_, after) = rest.split_once("[training]").unwrap();
        format!("{before}[training]{after}")
    };
    check(&without_domain)
        .assert_refused(&["`domain`: this section is missing; training needs it"]);
    // A section that only one command needs: the file, the section, and what it is for.
    let config = repository("configs/smoke/rk4-only.toml");
    let path = config.to_str().unwrap();
    let data = ["--data", "none.csv"];
    for (command, more, section) in [
        ("tune", &[][..], "[tune]"),
        ("train", &[], "[training]"),
        ("identify", &data, "[identify]"),
    ] {
        let refused = outcome(pinc(&[command, path]).args(more));
        refused.assert_refused(&[path, section, &format!("{command}` needs")]);
    }
}

#[test]
fn unknown_presets() {
    let expected = ["`preset`: `our` is not known", "did you mean `ours`?", &place("preset")];
    check_with("preset = \"ours\"", "preset = \"our\"").assert_refused(&expected);
    check_with("preset = \"ours\"", "preset = 3").assert_refused(&["`preset`: invalid type"]);
    let expected = ["`presets.printed`: `printed` is not known"];
    check_with("[presets.as-printed.training]", "[presets.printed.training]")
        .assert_refused(&expected);
}

#[test]
fn not_toml() {
    let outcome = check_with("seed = 7", "seed = = 7");
    outcome.assert_refused(&["not valid TOML", &place("seed")]);
}

#[test]
fn values_that_are_not_numbers() {
    for number in ["nan", "inf", "-inf"] {
        let outcome = check_with("horizon_s = 0.5", &format!("horizon_s = {number}"));
        outcome.assert_refused(&["`model.horizon_s`", "expected a finite number"]);
    }
    let expected = ["`control.references[1].value[1]`: NaN given", &place("    { start_s = 2.5")];
    check_with("value = [-0.5, 0.0]", "value = [-0.5, nan]").assert_refused(&expected);
}

#[test]
fn horizons() {
    for number in ["0.0", "-0.5", "0"] {
        let outcome = check_with("horizon_s = 0.5", &format!("horizon_s = {number}"));
        outcome.assert_refused(&[
            "`model.horizon_s`",
            "expected a positive number",
            &place("horizon_s"),
        ]);
    }
    let set = |key: &str| check_with("repetitions = 2", key);
    set("nu = 6").assert_refused(&["`control.nu`: 6 given, expected from 1 to n2 = 5"]);
    set("nu = 0").assert_refused(&["`control.nu`: 0 given"]);
    set("n1 = 6").assert_refused(&["`control.n1`: 6 given, expected from 1 to n2 = 5"]);
    // The mistake may also be in a value of the preset.
    set("n2 = 3").assert_refused(&["built-in preset ours: `control.nu`: 5 given"]);
    set("n2 = 0").assert_refused(&["`control.n2`: 0 given, expected 1 or more"]);
    set("step_s = 0.25").assert_refused(&["`control.step_s`: 0.25 given"]);
    let expected =
        ["`control.duration_s`: 5.2 given, expected a whole number of steps of T = 0.5 s"];
    check_with("duration_s = 5.0", "duration_s = 5.2").assert_refused(&expected);
}

#[test]
fn bounds_that_cross() {
    let expected = ["`control.state_low[1]`: 2 given, expected at most the upper end, 1"];
    check_with("state_low = [-1.0, -1.0]", "state_low = [-1.0, 2.0]").assert_refused(&expected);
    let expected = ["`domain.state_low`", "less than the upper end"];
    check_with("state_low = [-3.0, -4.35]", "state_low = [-3.0, 4.35]").assert_refused(&expected);
    let expected = ["`validation.domain.state_low`", "less than the upper end"];
    check_with("state_low = [-2.0, -2.0]", "state_low = [5.0, -2.0]").assert_refused(&expected);
}

#[test]
fn dimensions() {
    for (from, to, key) in [
        ("state_low = [-3.0, -4.35]", "state_low = [-3.0]", "`domain.state_low`: 1"),
        ("initial_state = [-1.0, 1.0]", "initial_state = [1.0]", "`prediction.initial_state`: 1"),
        ("initial_state = [0.5, 0.0]", "initial_state = [1, 2, 3]", "`control.initial_state`: 3"),
        ("q = [10.0, 10.0]", "q = [10.0]", "`control.q`: 1"),
        ("r = [1.0]", "r = [1.0, 1.0]", "`control.r`: 2"),
        ("value = [-0.5, 0.0]", "value = [-0.5]", "`control.references[1].value`: 1"),
        ("state_high = [1.0, 1.0]", "state_high = [1.0]", "`control.state_high`: 1"),
        ("state_high = [2.0, 2.0]", "state_high = [2.0]", "`validation.domain.state_high`: 1"),
        (
            "validation_every = 50",
            "residual_scale = { custom = [1.0] }",
            "`training.residual_scale.custom`: 1",
        ),
    ] {
        let names = if key.contains("control.r`") { "1: u" } else { "2: x1, x2" };
        let expected = format!("values given, expected {names}");
        check_with(from, to).assert_refused(&[key, &expected]);
    }
}

#[test]
fn other_values_out_of_range() {
    for (from, to, key) in [
        ("neurons = 10", "neurons = 0", "`model.neurons`"),
        ("hidden_layers = 2", "hidden_layers = 0", "`model.hidden_layers`"),
        ("collocation_points = 256", "collocation_points = 0", "`training.collocation_points`"),
        ("validation_every = 50", "lambda = 0.0", "`training.lambda`"),
        ("validation_every = 50", "time_limit_s = 0.0", "`training.time_limit_s`"),
        (
            "initial_step = 0.1",
            "initial_step = -1.0",
            "`training.phases[0].optimizer.initial_step`",
        ),
        ("scenarios = 2", "scenarios = 0", "`validation.scenarios`"),
        ("scenarios = 2", "scenarios = 2\ntolerance = 0.0", "`validation.tolerance`"),
        ("repetitions = 2", "repetitions = 0", "`control.repetitions`"),
        ("repetitions = 2", "rk4_substeps = 0", "`control.rk4_substeps`"),
        ("repetitions = 2", "models = []", "`control.models`"),
        ("repetitions = 2", "models = [\"rk4\", \"rk4\"]", "`control.models`"),
        ("q = [10.0, 10.0]", "q = [10.0, -1.0]", "`control.q[1]`"),
        ("q = [10.0, 10.0]", "q = [[1.0, 2.0], [2.0, 1.0]]", "a positive semidefinite matrix"),
        ("q = [10.0, 10.0]", "q = [[1.0, 0.5], [0.0, 1.0]]", "a symmetric matrix"),
        ("r = [1.0]", "r = [1.0]\nincrement_low = [0.5]", "`control.increment_low"),
        (
            "r = [1.0]",
            "r = [1.0]\nincrement_low = [0.2]\nincrement_high = [0.1]",
            "`control.increment_low, control.increment_high`: 0.2 above 0.1 at place 0",
        ),
        ("r = [1.0]", "r = [1.0]\nstep_s = 0.0", "`control.step_s`: 0"),
        ("r = [1.0]", "r = [1.0]\nbudget_us = 0.0", "`control.budget_us`"),
        ("r = [1.0]", "r = [1.0]\nq_terminal = [1.0]", "`control.q_terminal`: 1"),
        ("{ start_s = 0.0,", "{ start_s = 1.0,", "`control.references[0].start_s`"),
        ("{ start_s = 2.5,", "{ start_s = 0.0,", "`control.references[1].start_s`"),
        ("name = \"smoke-van-der-pol\"", "name = \"../elsewhere\"", "`name`"),
        ("mu = 1.0", "mu = -1.0", "`plant.van-der-pol.mu`"),
    ] {
        check_with(from, to).assert_refused(&["experiment.toml:", key, "expected"]);
    }
}

#[test]
fn names_that_are_not_states() {
    let expected = ["`control.controlled[1]`: `x3` is not known", "expected one of x1, x2"];
    check_with("controlled = [\"x1\", \"x2\"]", "controlled = [\"x1\", \"x3\"]")
        .assert_refused(&expected);
    check_with("controlled = [\"x1\", \"x2\"]", "controlled = [\"x1\", \"x1\"]")
        .assert_refused(&["`control.controlled[1]`"]);
}

#[test]
fn overrides() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("experiment.toml");
    std::fs::write(&path, smoke()).unwrap();
    let with = |set: &str| {
        outcome(&mut pinc(&["check".as_ref(), path.as_os_str(), "--set".as_ref(), set.as_ref()]))
    };
    with("control.nuu=3").assert_refused(&["--set control.nuu=3", "did you mean `nu`?"]);
    with("control.nu=6").assert_refused(&["--set control.nu=6", "from 1 to n2 = 5"]);
    with("control.nu=nan").assert_refused(&["--set control.nu=nan", "finite"]);
    with("control.nu").assert_refused(&["expected key=value"]);
    with("=3").assert_refused(&["expected key=value"]);
    with("name=a b").assert_refused(&["needs quotes"]);
    with("seed=3\nname=\"x\"").assert_refused(&["one value expected"]);
    with("seed.x=3").assert_refused(&["--set seed.x=3"]);
    with("training.phases.7.iterations=3")
        .assert_refused(&["is not a table, or has no such element"]);
    with("preset=as-print")
        .assert_refused(&["--set preset=as-print", "did you mean `as-printed`?"]);
}

#[test]
fn files_that_are_not_there() {
    outcome(&mut pinc(&["check", "no/such/file.toml"]))
        .assert_refused(&["no/such/file.toml", "cannot be read"]);
    outcome(&mut pinc(&["report", "no/such/dir"])).assert_refused(&["no/such/dir"]);
}

#[test]
fn bad_usage() {
    for arguments in [&["run"][..], &["walk"], &["predict"], &["run", "a.toml", "--out"]] {
        let outcome = outcome(&mut pinc(arguments));
        assert_eq!(outcome.code, Some(2), "{outcome:?}");
    }
}
