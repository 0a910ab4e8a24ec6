//! The findings of `pinc check` in the shipped configs. Each of its messages has a test plant in
//! `runs/check`.

use crate::common::{outcome, pinc, repository};
use pinc_config::{Experiment, Plants};
use pinc_runs::{Finding, Severity, check};

fn findings(config: &str, sets: &[&str]) -> Vec<Finding> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(
        &Experiment::load(&repository("configs").join(config), &sets, &Plants::built_in()).unwrap(),
    )
}

fn warnings(findings: &[Finding]) -> Vec<&Finding> {
    let errors: Vec<_> = findings.iter().filter(|f| f.severity == Severity::Error).collect();
    assert!(errors.is_empty(), "{errors:?}");
    findings.iter().filter(|f| f.severity == Severity::Warning).collect()
}

/// The finding whose text has all of `parts`.
#[track_caller]
fn with<'f>(findings: &'f [Finding], parts: &[&str]) -> &'f Finding {
    let all: Vec<_> = findings.iter().map(Finding::to_string).collect();
    let place = all.iter().position(|text| parts.iter().all(|part| text.contains(part)));
    &findings[place.unwrap_or_else(|| panic!("no {parts:?} in\n{}", all.join("\n")))]
}

#[test]
fn sound_configs_give_no_cause_for_warnings() {
    for config in ["van-der-pol/main.toml", "smoke/rk4-only.toml", "smoke/one-tank.toml"] {
        let findings = findings(config, &[]);
        assert_eq!(warnings(&findings), [&findings[0]; 0], "{config}");
    }
}

/// Two of its four states are without bounds.
#[test]
fn a_state_without_bounds_is_examined_near_its_start() {
    let findings = findings("gallery/crane.toml", &[]);
    warnings(&findings);
    let finite = with(&findings, &["values and derivatives are finite"]);
    let rates = numbers(&finite.what, "<= ");
    let expected = [0.5, 1.5, 2.0, 5.3];
    assert_eq!(rates.len(), expected.len(), "{finite}");
    assert!(rates.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.05), "{finite}");
}

#[test]
fn an_unknown_number_to_minimize_is_named() {
    let findings = findings("van-der-pol/search.toml", &["sweep.search.minimize=mse"]);
    let unknown = with(&findings, &["mse", "no loop of this config has such a number"]);
    assert_eq!((unknown.severity, &*unknown.place), (Severity::Error, "sweep.search.minimize"));
}

/// The bounds are above what was found, and as near as a small proof is.
#[test]
fn the_proven_error_of_rk4_is_reported() {
    let findings = findings("van-der-pol/main.toml", &[]);
    let proven = with(&findings, &["one step of RK4 x4 is proven to be wrong by at most"]);
    let found = with(&findings, &["the largest error of one step of RK4 x4 that a search found"]);
    let before = |text: &str, mark: &str| -> f64 {
        let start = text.split(mark).next().unwrap();
        start.split(' ').next_back().unwrap().parse().unwrap()
    };
    let bound = before(&proven.what, ", in widths");
    let largest = before(&found.what, " of the range of ");
    assert!(bound >= 0.97 * largest && bound < 1.3 * largest, "{proven} {found}");
}

#[test]
fn wells_with_algebraic_pressures_are_examined_too() {
    for config in ["oil-well/gas-lift.toml", "pareto/gas-lift.toml"] {
        let all = findings(config, &["model.neurons=8", "control.duration_s=1200.0"]);
        let warned = warnings(&all);
        // The valve closes by a max where the pressures meet: a kink, seen along three states.
        let is_kink = |f: &&&Finding| {
            f.place == "plant"
                && f.what.contains("the derivative of gas_annulus' jumps")
                && f.what.contains("plant.expression.let.injected: p_annulus - p_foot - 0")
        };
        assert_eq!(warned.iter().filter(is_kink).count(), 3, "{config}: {warned:?}");
        assert_eq!(warned.len(), 3, "{config}: {warned:?}");
    }
}

#[test]
fn four_tanks_whose_gammas_add_up_to_1_have_a_singular_gain() {
    let findings = findings("four-tanks/main.toml", &[]);
    // At the first reference, by an independent computation: singular values 8.39 and 0; every
    // steady state has h2/h1 = (a1/a2)^2 = (0.071/0.057)^2 = 1.5516.
    let gain = with(&findings, &["singular values 8.39", ", 0, rank 1: singular"]);
    assert!(gain.what.contains("all steady states lie on the line h2/h1 = 1.5516"), "{gain}");
    with(&findings, &["transmission zeros", "one is at s = 0"]);
    assert_eq!(warnings(&findings).len(), 2, "{findings:?}");
}

#[test]
fn inputs_that_do_the_same_leave_the_plane_that_they_reach() {
    let text = r#"
        name = "twins"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["a", "b"]
        inputs = ["u", "v"]
        derivatives = { a = "u + v - a", b = "u + v + 1 - b" }
        [control]
        models = ["rk4"]
        step_s = 0.5
        duration_s = 5.0
        initial_state = [0.0, 1.0]
        controlled = ["a", "b"]
        q = [1.0, 1.0]
        r = [1.0, 1.0]
        state_low = [-4.0, -4.0]
        state_high = [4.0, 4.0]
        input_low = [-1.0, -1.0]
        input_high = [1.0, 1.0]
        references = [{ start_s = 0.0, value = [0.0, 1.0] }]
    "#;
    let found =
        check(&Experiment::parse("twins.toml".as_ref(), text, &[], &Plants::built_in()).unwrap());
    // b - a = 1, in a unit normal of either sign.
    let gain =
        with(&found, &["rank 1: singular", "all steady states have ", "0.7071 a + ", " b = "]);
    assert_eq!(gain.what.matches("0.7071").count(), 3, "{gain}");
    // A state that no input moves is one number at rest.
    let alone = [
        "plant.expression.derivatives.b=\"1 - b\"",
        "control.controlled=[\"b\"]",
        "control.q=[1.0]",
        "control.references=[{ start_s = 0.0, value = [1.0] }]",
    ];
    let found = check(
        &Experiment::parse(
            "twins.toml".as_ref(),
            text,
            &alone.map(str::to_owned),
            &Plants::built_in(),
        )
        .unwrap(),
    );
    with(&found, &["rank 0: singular", "all steady states have ", "1.0000 b = "]);
}

#[test]
fn references_off_the_line_are_named_and_those_on_it_are_not() {
    let sets = ["control.references.1.value=[13.0, 13.0]"];
    let findings = findings("four-tanks/main.toml", &sets);
    let off = with(&findings, &["control.references[1]: h1 = 13, h2 = 13 is no steady state"]);
    assert_eq!(off.severity, Severity::Warning);
    // The steady state that is named instead lies on the line.
    let level = |name: &str| -> f64 {
        let rest = off.what.split("near it has ").nth(1).unwrap();
        let rest = rest.split(name).nth(1).unwrap();
        rest.split([',', ' ']).next().unwrap().parse().unwrap()
    };
    let (h1, h2) = (level("h1 = "), level("h2 = "));
    // Levels are shown with five digits.
    assert!((h2 / h1 - 1.5516).abs() < 1e-3, "{off}");
    // The last reference is the first one again.
    for (k, text) in [(0, "(and once more) is held at"), (2, "is held at")] {
        let held = with(&findings, &[&format!("control.references[{k}]: "), text]);
        assert_eq!(held.severity, Severity::Fact);
    }
}

#[test]
fn a_loop_that_leaves_the_training_domain_triggers_a_warning() {
    // The box of the paper's Table 1, left by h3, h4 and both inputs.
    let findings = findings("four-tanks/main.toml", &["preset=as-released"]);
    for variable in ["h3", "h4", "u1", "u2"] {
        with(&findings, &[&format!("the bounds of {variable} reach outside the training domain")]);
    }
    let left = with(&findings, &["the closed loop with RK4: "]);
    for part in ["h3 goes down to 0.6 (domain from 2)", "h4 goes down to", "u1 goes up to"] {
        assert!(left.what.contains(part), "no `{part}` in {left}");
    }
    // The box that is proposed is one that can be put into the config, and holds the loop.
    let proposal = with(&findings, &["a box that holds all of these trajectories"]);
    let table: toml::Table = proposal.change.parse().unwrap();
    let number = |key: &str, i: usize| table["domain"][key][i].as_float().unwrap();
    assert!((0.0..=0.6).contains(&number("state_low", 2)), "{proposal}");
    assert!(number("input_high", 0) > 3.0, "{proposal}");
}

/// Numbers after `word` in a text.
fn numbers(text: &str, word: &str) -> Vec<f64> {
    let after = text.split(word).skip(1);
    let mut found: Vec<f64> =
        after.map(|rest| rest.split([' ', ',']).next().unwrap().parse().unwrap()).collect();
    found.sort_by(f64::total_cmp);
    found
}

#[test]
fn time_constants_and_zeros_are_those_that_johansson_published() {
    let sets =
        ["control.references.0.value=[12.4, 12.7]", "control.references.1.value=[12.4, 12.7]"];
    let findings = findings("smoke/four-tanks.toml", &sets);
    let modes = with(&findings, &["the steady state of control.references[0]", "modes"]);
    let found = numbers(&modes.what, "time constant ");
    assert_eq!(found.len(), 4, "{modes}");
    // He gives whole seconds, for levels rounded to 0.1 cm: sqrt(h) of the lowest, 1.4 cm, is thus
    // known to 4 %.
    for (found, published) in found.iter().zip([23.0, 30.0, 62.0, 90.0]) {
        assert!((found / published - 1.0).abs() < 0.04, "{found} against {published}: {modes}");
    }
    let zeros = with(&findings, &["transmission zeros"]);
    let text = zeros.what.replace(", ", " zeros ");
    let found = numbers(&text, "zeros ");
    // The zeros go like 1/T3 and 1/T4, which the levels of the laboratory move by 5 %.
    for (found, published) in found.iter().zip([-0.060, -0.018]) {
        assert!((found / published - 1.0).abs() < 0.06, "{found} against {published}: {zeros}");
    }
    assert_eq!(found.len(), 2, "{zeros}");
    // His other setting is nonminimum phase, by a zero of +0.013.
    let sets = [sets[0], sets[1], "plant.four-tanks.parameters=johansson-nonminimum"];
    let findings = self::findings("smoke/four-tanks.toml", &sets);
    with(&findings, &["transmission zeros", "nonminimum phase"]);
}

#[test]
fn findings_are_printed_as_text_or_as_json() {
    let config = repository("configs/four-tanks/main.toml");
    let run = |more: &[&str]| {
        let outcome = outcome(pinc(&["check".as_ref(), config.as_os_str()]).args(more));
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        outcome.stdout
    };
    let text = run(&[]);
    assert!(text.contains("\nwarn  ") && text.contains("\n        why: "), "{text}");
    let json: serde_json::Value = serde_json::from_str(&run(&["--json"])).unwrap();
    let all = json.as_array().unwrap();
    assert!(all.iter().any(|finding| finding["severity"] == "warning"), "{json}");
    assert!(all.iter().all(|finding| finding["what"].is_string()), "{json}");
}

/// Programs that read the findings read the error of a config, too.
#[test]
fn the_error_of_an_unusable_config_is_a_finding_in_json() {
    let config = repository("configs/four-tanks/main.toml");
    let place = |config: &std::ffi::OsStr, set: &str| {
        let arguments =
            ["check".as_ref(), config, "--json".as_ref(), "--set".as_ref(), set.as_ref()];
        let outcome = outcome(&mut pinc(&arguments));
        assert_eq!(outcome.code, Some(2), "{outcome:?}");
        let json: serde_json::Value = serde_json::from_str(&outcome.stdout).unwrap();
        let [finding] = &json.as_array().unwrap()[..] else { panic!("{json}") };
        assert_eq!(finding["severity"], "error");
        let what = finding["what"].as_str().unwrap();
        assert!(outcome.stderr.contains(what), "{outcome:?}");
        finding["place"].as_str().unwrap().to_owned()
    };
    assert_eq!(place(config.as_os_str(), "control.nuu=1"), "control.nuu");
    assert_eq!(place("none.toml".as_ref(), "seed=1"), "none.toml");
}

/// The chemostat with a pole at S = -0.1, rates per hour; `S` is how the growth rate has the
/// substrate.
fn chemostat(substrate: &str) -> Experiment {
    let text = r#"
        name = "chemostat"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = [{ name = "X", unit = "g/L" }, { name = "S", unit = "g/L" }]
        inputs = [{ name = "D", unit = "1/h" }]
        [plant.expression.let]
        mu = "0.4*SUBSTRATE/(0.1 + SUBSTRATE)"
        [plant.expression.derivatives]
        X = "(mu - D)*X/3600"
        S = "(D*(10 - S) - 2*mu*X)/3600"
        [domain]
        state_low = [2.0, 0.0]
        state_high = [6.0, 3.0]
        input_low = [0.0]
        input_high = [0.38]
        [control]
        models = ["rk4"]
        step_s = 900.0
        duration_s = 9000.0
        initial_state = [4.9, 0.2]
        controlled = ["S"]
        q = [100.0]
        r = [100.0]
        n2 = 8
        nu = 8
        state_low = [2.0, 0.0]
        state_high = [6.0, 3.0]
        input_low = [0.0]
        input_high = [0.38]
        references = [{ start_s = 0.0, value = [0.1] }, { start_s = 4500.0, value = [0.2] }]
    "#;
    let text = text.replace("SUBSTRATE", substrate);
    Experiment::parse("chemostat.toml".as_ref(), &text, &[], &Plants::built_in()).unwrap()
}

#[test]
fn a_pole_just_outside_the_domain_is_named_with_what_to_write() {
    let found = check(&chemostat("S"));
    let parts = ["plant.expression.let.mu", "S + 0.1 is 0 at", "S = -0.1", "just outside"];
    let pole = with(&found, &parts);
    assert_eq!(pole.severity, Severity::Warning);
    assert!(pole.change.contains("max(S, 0)"), "{pole}");
    let guarded = check(&chemostat("max(S, 0)"));
    assert_eq!(warnings(&guarded), [&guarded[0]; 0]);
    // D = mu holds S = 0.1; the washout S = 10 does not count.
    with(&guarded, &["S = 0.1 is held at X = 4.95, S = 0.1 by D = 0.2"]);
    assert!(guarded.iter().all(|f| !f.place.contains("S = 10")), "{guarded:?}");
}

/// A motor with dry friction tanh(w/0.01).
fn motor(sets: &[&str]) -> Vec<Finding> {
    let text = r#"
        name = "motor"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["theta", "w", "i"]
        inputs = ["u"]
        [plant.expression.derivatives]
        theta = "w"
        w = "(0.05*i - 1e-3*w - 0.02*tanh(w/0.01))/1e-3"
        i = "(u - i - 0.05*w)/5e-3"
        [domain]
        state_low = [-1.0, -40.0, -12.0]
        state_high = [4.0, 40.0, 12.0]
        input_low = [-12.0]
        input_high = [12.0]
        [control]
        models = ["rk4"]
        step_s = 0.01
        duration_s = 0.1
        initial_state = [0.0, 0.0, 0.0]
        controlled = ["theta", "w"]
        q = [100.0, 0.01]
        r = [0.1]
        n2 = 15
        nu = 15
        rk4_substeps = 4
        input_low = [-12.0]
        input_high = [12.0]
        references = [{ start_s = 0.0, value = [1.0, 0.0] }, { start_s = 0.05, value = [2.0, 0.0] }]
    "#;
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(&Experiment::parse("motor.toml".as_ref(), text, &sets, &Plants::built_in()).unwrap())
}

#[test]
fn substeps_that_are_unstable_at_a_reference_trigger_a_warning() {
    let found = motor(&[]);
    // The friction's slope is 0.02/0.01/1e-3 = 2000 1/s: 2000 * 0.01/4 = 5 is beyond 2.785, and
    // 20/2.785 = 7.2.
    let warning =
        with(&found, &["control.rk4_substeps: 4 substeps are unstable at control.references"]);
    assert!(warning.change.contains("rk4_substeps = 8"), "{warning}");
    with(&found, &["a knee in w"]);
    let stable = motor(&["control.rk4_substeps=8"]);
    assert!(stable.iter().all(|f| !f.what.contains("substeps are unstable")), "{stable:?}");
}

#[test]
fn advice_on_the_step_of_an_unstable_plant_is_from_its_doubling_time() {
    // x'' = -0.3 x' + x - x^3 + u: at x = 0 it doubles in ln 2/0.861 = 0.805 s.
    let check = |step: f64| {
        let text = format!(
            r#"
            name = "duffing"
            preset = "ours"
            seed = 1
            [plant.expression]
            states = ["x1", "x2"]
            inputs = ["u"]
            [plant.expression.derivatives]
            x1 = "x2"
            x2 = "-0.3*x2 + x1 - x1^3 + u"
            [control]
            models = ["rk4"]
            step_s = {step:?}
            duration_s = {:?}
            initial_state = [0.1, 0.0]
            controlled = ["x1", "x2"]
            q = [10.0, 1.0]
            r = [0.5]
            state_low = [-1.5, -1.5]
            state_high = [1.5, 1.5]
            input_low = [-1.0]
            input_high = [1.0]
            references = [{{ start_s = 0.0, value = [0.0, 0.0] }}]
            "#,
            4.0 * step
        );
        check(&Experiment::parse("duffing.toml".as_ref(), &text, &[], &Plants::built_in()).unwrap())
    };
    let slow = check(2.0);
    let warning =
        with(&slow, &["T = 2 s is 2.48", "times the 0.805 s in which a deviation doubles"]);
    assert!(warning.change.contains("0.161 s"), "{warning}");
    let fast = check(0.2);
    assert!(
        fast.iter().all(|f| !f.what.contains("has settled") && !f.what.contains("T = 0.2 s is"))
    );
}

#[test]
fn states_with_names_of_columns_are_refused() {
    let of_x =
        ["x_truth", "x_ref", "x_0", "x_sd", "x_err", "x_bound", "y_x", "innovation_x", "d_x"];
    let taken = ["mark", "nis", "nees", "rejected", "error"];
    let taken = taken.map(|name| (name, "column of the tables of runs"));
    // A disturbance of the input has a column, too.
    let all = of_x.map(|name| (name, "column of x in tables")).into_iter().chain(taken);
    for (name, column) in all.chain([("d_u", "column of u in tables")]) {
        let text = format!(
            "name = \"n\"\npreset = \"ours\"\nseed = 1\n[plant.expression]\nstates = [\"x\", \"{name}\"]\n\
             inputs = [\"u\"]\nderivatives = {{ x = \"u\", {name} = \"x\" }}\n"
        );
        let error = Experiment::parse("n.toml".as_ref(), &text, &[], &Plants::built_in())
            .unwrap_err()
            .to_string();
        assert!(error.contains("plant.expression.states[1]") && error.contains(column), "{error}");
    }
}

/// A cart x'' = b u - v on a line, with the square of its distance from an obstacle at 1 as an
/// output.
fn cart(sets: &[&str]) -> Vec<Finding> {
    let text = r#"
        name = "cart"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["x"]
        inputs = ["u"]
        parameters = { b = 1.0 }
        derivatives = { x = "b*u - x" }
        outputs = { clearance = "(x - 1)^2" }
        [control]
        models = ["rk4"]
        step_s = 0.5
        duration_s = 10.0
        initial_state = [0.0]
        controlled = ["x"]
        q = [1.0]
        r = [1.0]
        state_low = [-3.0]
        state_high = [3.0]
        output_low = [0.16]
        input_low = [-3.0]
        input_high = [3.0]
        references = [{ start_s = 0.0, value = [0.5] }, { start_s = 5.0, value = [0.7] }]
    "#;
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(&Experiment::parse("cart.toml".as_ref(), text, &sets, &Plants::built_in()).unwrap())
}

#[test]
fn a_reference_inside_an_obstacle_is_named() {
    let found = cart(&[]);
    // (0.7 - 1)^2 = 0.09, less than 0.16; (0.5 - 1)^2 = 0.25 is free.
    let inside = with(&found, &["control.references[1]: clearance is 0.09", "0.16 to inf"]);
    assert_eq!(inside.severity, Severity::Warning);
    let about = found.iter().filter(|f| f.what.starts_with("clearance"));
    assert_eq!(about.count(), 1, "{found:?}");
    let free = cart(&["control.references.1.value=[0.55]"]);
    with(&free, &["start and references are within the bounds, also of outputs"]);
}

#[test]
fn a_plant_whose_gain_has_another_sign_is_named() {
    let schedule =
        |b: f64| format!("control.plant_schedule=[{{ start_s = 2.0, values = {{ b = {b:?} }} }}]");
    let found = cart(&[&schedule(-0.5)]);
    let parts = [
        "control.plant: ",
        "with the plant of the loop from 2 s on",
        "from u to x has another sign",
    ];
    assert_eq!(with(&found, &parts).severity, Severity::Warning);
    let found = cart(&[&schedule(0.5)]);
    assert!(found.iter().all(|f| !f.what.contains("another sign")), "{found:?}");
}

/// A cart is at rest at every position, also where its loop keeps a speed, at no steady state.
#[test]
fn a_cart_has_steady_states() {
    let text = r#"
        name = "cart"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["position", "speed"]
        inputs = ["F"]
        derivatives = { position = "speed", speed = "F - 0.5*speed" }
        [control]
        step_s = 0.5
        duration_s = 15.0
        initial_state = [0.0, 0.0]
        controlled = ["speed"]
        n2 = 10
        nu = 4
        q = [1.0]
        r = [0.1]
        input_low = [-2.0]
        input_high = [2.0]
        models = ["rk4"]
        references = [{ start_s = 0.0, value = [1.0] }]
        "#;
    let plants = Plants::built_in();
    let findings = check(&Experiment::parse("cart.toml".as_ref(), text, &[], &plants).unwrap());
    with(&findings, &["speed = 1 is kept by the closed loop"]);
    let denied = |f: &Finding| f.what.contains("no steady state was found");
    assert!(!findings.iter().any(denied), "{findings:#?}");
}

/// The findings on a loop of 6 s with the plant x' = `rhs`, from .5 to 1 and then to -1.
fn of_scalar_loop(rhs: &str, sets: &[&str]) -> Vec<Finding> {
    let text = format!(
        r#"
        name = "scalar"
        preset = "ours"
        seed = 1
        plant.expression = {{ states = ["x"], inputs = ["u"], derivatives = {{ x = "{rhs}" }} }}
        [control]
        step_s = 0.2
        n2 = 10
        nu = 5
        input_low = [-1.0]
        input_high = [1.0]
        controlled = ["x"]
        q = [1.0]
        r = [0.1]
        initial_state = [0.5]
        references = [{{ start_s = 0.0, value = [1.0] }}, {{ start_s = 3.0, value = [-1.0] }}]
        models = ["rk4"]
        duration_s = 6.0
        "#
    );
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(&Experiment::parse("scalar.toml".as_ref(), &text, &sets, &Plants::built_in()).unwrap())
}

/// The gain of x - x^3 + u x changes its sign between the references, with 0 between; the reference 2
/// needs an input of 2, which is said where references are.
#[test]
fn a_loop_that_misses_its_references_triggers_a_warning_once() {
    let missed =
        "does not reach 1 of its 2 references: it ends 1.35 off on average with the one from 3 s";
    let found = of_scalar_loop("x - x^3 + u*x", &[]);
    let missed = with(&found, &["in the closed loop with RK4 x", missed]);
    assert_eq!((missed.severity, &*missed.place), (Severity::Warning, "control"));
    let is_missed = |found: &[Finding]| found.iter().any(|f| f.what.contains("does not reach"));
    let wide = "control.input_high=[3.0]";
    assert!(!is_missed(&of_scalar_loop("u - x", &[wide, "control.input_low=[-3.0]"])));
    let sets = ["control.references.0.value=[2.0]", "control.references.1.value=[0.0]"];
    let outside = of_scalar_loop("u - x", &sets);
    with(&outside, &["control.references[0]", "it needs u = 2"]);
    assert!(!is_missed(&outside));
    let unweighted = of_scalar_loop("x - x^3 + u*x", &["control.q=[0.0]"]);
    assert!(!is_missed(&unweighted));
}

#[test]
fn bounds_that_break_in_the_loop_trigger_a_warning() {
    let found = findings("gallery/crane.toml", &[]);
    let broken = with(
        &found,
        &["in the closed loop with RK4 angle broke a hard bound between control steps"],
    );
    assert_eq!(broken.severity, Severity::Warning);
}
