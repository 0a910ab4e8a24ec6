//! Plants that a net cannot learn in a part of its domain: `pinc check` names the reason, and a
//! training the place; and plants that only look hard in their units.

use crate::common::{outcome, pinc, repository};
use pinc_config::{Experiment, Plants};
use pinc_record::Metrics;
use pinc_runs::{Finding, Severity, check};

fn trap(name: &str, sets: &[&str]) -> Vec<Finding> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let path = repository("crates/pinc/tests/data/traps").join(name);
    check(&Experiment::load(&path, &sets, &Plants::built_in()).unwrap())
}

fn warnings(findings: &[Finding]) -> Vec<String> {
    let serious = findings.iter().filter(|f| f.severity != Severity::Fact);
    serious.map(ToString::to_string).collect()
}

/// The one warning, which has all of `parts`.
#[track_caller]
fn assert_warns(findings: &[Finding], parts: &[&str]) {
    let found = warnings(findings);
    let [warning] = &found[..] else { panic!("{found:?}") };
    assert!(parts.iter().all(|part| warning.contains(part)), "no {parts:?} in {warning}");
}

const GUARDED: &str = "plant.expression.let.s=\"max(S, 0)\"";

#[test]
fn a_pole_triggers_a_warning_until_it_is_guarded() {
    let found = trap("chemostat.toml", &[]);
    assert_warns(&found, &["let.mu", "s + 0.1 is 0 at", "just outside", "write max(S, 0) for S"]);
    assert_eq!(warnings(&trap("chemostat.toml", &[GUARDED])), [""; 0]);
}

#[test]
fn times_and_rates_are_in_the_unit_that_the_config_says() {
    let said = |sets: &[&str]| {
        let found = trap("chemostat.toml", sets);
        found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    // At S = 0.1 the slow mode is D = 0.2 per hour.
    let hours = said(&[]);
    for part in ["-0.2000 1/h (time constant 5 h)", "T = 0.25 h: ", "zeros -0.2000 1/h"] {
        assert!(hours.contains(part), "no {part} in {hours}");
    }
    let days = said(&["time_unit=d"]);
    assert!(days.contains("-4.8000 1/d (time constant 0.208 d)"), "{days}");
    let wrong = ["time_unit=hours".to_owned()];
    let path = repository("crates/pinc/tests/data/traps/chemostat.toml");
    let error = Experiment::load(&path, &wrong, &Plants::built_in()).unwrap_err().to_string();
    for part in ["`time_unit`: `hours` is not known", "min, h, d"] {
        assert!(error.contains(part), "no {part} in {error}");
    }
}

/// The same plant with rates per hour gives the same findings; a unit that does not suit T is asked
/// about.
#[test]
fn equations_may_be_in_another_unit_of_time() {
    // Without measured times.
    let texts = |findings: &[Finding]| {
        let texts = findings.iter().map(ToString::to_string);
        texts
            .filter(|text| ![" us", " ns"].iter().any(|unit| text.contains(unit)))
            .collect::<Vec<_>>()
    };
    let hourly = "plant.expression.derivatives={ X = \"(mu - D)*X\", S = \"D*(10 - S) - 2*mu*X\" }";
    let in_hours = ["--unset time_unit", "plant.expression.time_unit=h", hourly, GUARDED];
    assert_eq!(
        texts(&trap("chemostat.toml", &in_hours)),
        texts(&trap("chemostat.toml", &[GUARDED]))
    );
    let asked = |sets: &[&str]| warnings(&trap("chemostat.toml", sets)).join("\n");
    let fast = asked(&[hourly, GUARDED]);
    assert!(fast.contains("are the equation's rates per h instead of per second?"), "{fast}");
    assert!(fast.contains("plant.expression.time_unit = \"h\""), "{fast}");
    let slow = asked(&["plant.expression.time_unit=d", GUARDED]);
    assert!(slow.contains("no state moves more than") && slow.contains("rates per d"), "{slow}");
}

/// A rod of twenty pieces that is heated at one end, and cools at all.
#[test]
fn only_a_few_of_many_states_are_written_out() {
    let list = |value: &str| vec![value; 20].join(", ");
    let rates: Vec<String> = (1..=20)
        .map(|k| {
            let before = if k == 1 { "T1 + u".to_owned() } else { format!("T{}", k - 1) };
            let after = (k + 1).min(20);
            format!("T{k} = \"2*({before} - 2*T{k} + T{after}) - 0.1*T{k}\"")
        })
        .collect();
    let names: Vec<String> = (1..=20).map(|k| format!("\"T{k}\"")).collect();
    let text = format!(
        "name = \"rod\"\npreset = \"ours\"\nseed = 1\n[plant.expression]\nstates = [{}]\n\
         inputs = [\"u\"]\n[plant.expression.derivatives]\n{}\n[control]\nmodels = [\"rk4\"]\n\
         step_s = 1.0\nduration_s = 4.0\ninitial_state = [{}]\ncontrolled = [\"T5\"]\nq = [1.0]\n\
         r = [1e-3]\nstate_low = [{}]\nstate_high = [{}]\ninput_low = [0.0]\ninput_high = [50.0]\n\
         references = [{{ start_s = 0.0, value = [10.0] }}]\n",
        names.join(", "),
        rates.join("\n"),
        list("8.0"),
        list("0.0"),
        list("100.0"),
    );
    let found =
        check(&Experiment::parse("rod.toml".as_ref(), &text, &[], &Plants::built_in()).unwrap());
    for finding in &found {
        let longest = finding.to_string().lines().map(str::len).max().unwrap();
        assert!(longest < 400, "{finding}");
    }
    let said: Vec<_> = found.iter().map(ToString::to_string).collect();
    for part in ["20 states: T1 to T20;", "T5 = 10, ", "(and 17 more states)", "transmission zeros"]
    {
        assert!(said.iter().any(|text| text.contains(part)), "no {part} in {}", said.join("\n"));
    }
}

#[test]
fn a_kink_triggers_a_warning_until_it_is_smooth() {
    let open = "control.initial_input=[0.5]";
    let found = trap("valve.toml", &[open]);
    // The kink, and the dead zone below it.
    let [kink, dead] = &warnings(&found)[..] else { panic!("{found:?}") };
    for part in ["the derivative of x' jumps at", "u = 0.3", "let.open", "smooth"] {
        assert!(kink.contains(part), "{kink}");
    }
    assert!(dead.contains("u has no effect below 0.3"), "{dead}");
    // From a closed valve no gradient shows that more would open it.
    let stuck = warnings(&trap("valve.toml", &[]));
    let missed = "in the closed loop with RK4 x does not reach its reference";
    assert!(stuck.len() == 3 && stuck[2].contains(missed), "{stuck:?}");
    let smooth = "plant.expression.let.open=\"(u - 0.3 + sqrt((u - 0.3)^2 + 0.02^2))/2\"";
    assert_eq!(warnings(&trap("valve.toml", &[smooth])), [""; 0]);
}

#[test]
fn the_end_of_a_root_triggers_a_warning_until_it_has_a_slope() {
    let found = trap("outflow.toml", &[]);
    assert_warns(&found, &["sqrt(h) is not defined beyond h = 0", "write max(h, 0.02) for h"]);
    let level =
        |text: &str| trap("outflow.toml", &[&format!("plant.expression.let.level=\"{text}\"")]);
    for guarded in ["max(h, 0)", "max(h, 0.02)"] {
        assert_eq!(warnings(&level(guarded)), [""; 0], "{guarded}");
    }
    // Defined on both sides of h = 0.5, with a kink there.
    assert_warns(&level("(h - 0.5)^2"), &["the derivative of h' jumps at h = 0.5"]);
}

#[test]
fn a_net_trained_all_the_same_triggers_a_warning_with_place_and_size() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("crates/pinc/tests/data/traps/chemostat.toml");
    let train = |name: &str, sets: &[&str]| {
        let out = dir.path().join(name);
        let mut command = pinc(&["train".as_ref(), config.as_os_str()]);
        for set in sets {
            command.args(["--set", set]);
        }
        let outcome = outcome(command.arg("--out").arg(&out));
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        let read = |file: &str| std::fs::read_to_string(out.join(file)).unwrap();
        let metrics: serde_json::Value = serde_json::from_str(&read("metrics.json")).unwrap();
        let points = read("domain-error.csv").lines().count();
        (outcome.stdout, read("report.html"), metrics["validation"]["domain_error"].clone(), points)
    };
    let (table, report, error, points) = train("trap", &[]);
    let number = |of: &serde_json::Value, key: &str| of[key].as_f64().unwrap();
    assert!(number(&error, "max") > 0.1 && number(&error, "share_off") > 0.01, "{error}");
    assert!(number(&error, "rms") <= number(&error, "max"), "{error}");
    // Where the substrate nearly runs out.
    assert!(error["max_at"]["x"][1].as_f64().unwrap() < 0.6, "{error}");
    assert_eq!(error["max_at"]["u"].as_array().unwrap().len(), 1);
    for substeps in ["1", "2", "4"] {
        assert!(number(&error["rk4"], substeps) > 0.0, "{error}");
    }
    for said in ["warning: The net is wrong in a part of its domain", "worst at X = ", "; D = "] {
        assert!(table.contains(said), "no {said} in {table}");
    }
    assert!(
        table.contains("one step in validation.domain") && table.contains("one step in [domain]")
    );
    assert!(report.contains("The net is wrong in a part of its domain"));
    assert!(report.contains("<section id=\"domain-error\">"));
    assert_eq!(points, 1 + 1024);
    let (table, report, error, _) = train("guarded", &[GUARDED]);
    assert!(number(&error, "max") < 1e-2, "{error}");
    assert!(!table.contains("warning") && !report.contains("is wrong in a part"), "{table}");
}

/// A magnet that holds a ball; lengths in units of 1/`per_m` m, times in units of 1/`per_s` s.
fn maglev(per_m: f64, per_s: f64) -> Vec<Finding> {
    let gap = |m: f64| m * per_m;
    let speed = |m: f64| m * per_m / per_s;
    let text = format!(
        r#"
        name = "maglev"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["gap", "v", "i"]
        inputs = ["u"]
        [plant.expression.parameters]
        m = {per_m:?}
        s = {per_s:?}
        [plant.expression.derivatives]
        gap = "v"
        v = "(9.81 - 6.53e-5/0.068*(i*m/gap)^2)*m/s^2"
        i = "(u - 10*i)/(0.41*s)"
        [domain]
        state_low = [{:?}, {:?}, 0.2]
        state_high = [{:?}, {:?}, 3.0]
        input_low = [0.0]
        input_high = [30.0]
        [control]
        models = ["rk4"]
        step_s = {:?}
        duration_s = {:?}
        initial_state = [{:?}, 0.0, 1.314]
        controlled = ["gap", "v", "i"]
        q = [{:?}, {:?}, 0.01]
        r = [0.01]
        n2 = 10
        nu = 10
        state_low = [{:?}, {:?}, 0.2]
        state_high = [{:?}, {:?}, 3.0]
        input_low = [0.0]
        input_high = [30.0]
        references = [
            {{ start_s = 0.0, value = [{:?}, 0.0, 1.314] }},
            {{ start_s = {:?}, value = [{:?}, 0.0, 1.0107] }},
        ]
        "#,
        gap(0.007),
        speed(-0.3),
        gap(0.02),
        speed(0.3),
        0.005 * per_s,
        0.2 * per_s,
        gap(0.013),
        1e6 / (per_m * per_m),
        10.0 * (per_s / per_m).powi(2),
        gap(0.007),
        speed(-0.3),
        gap(0.02),
        speed(0.3),
        gap(0.013),
        0.1 * per_s,
        gap(0.01),
    );
    check(&Experiment::parse("maglev.toml".as_ref(), &text, &[], &Plants::built_in()).unwrap())
}

/// Two tanks, one below the other; levels in units of 1/`scale` cm.
fn tanks(scale: f64) -> Vec<Finding> {
    let text = format!(
        r#"
        name = "tanks"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["a", "b"]
        inputs = ["u"]
        [plant.expression.parameters]
        cm = {scale:?}
        [plant.expression.derivatives]
        a = "(0.3*u - 0.2*sqrt(a/cm))*cm"
        b = "(0.2*sqrt(a/cm) - 0.2*sqrt(b/cm))*cm"
        [domain]
        state_low = [{:?}, {:?}]
        state_high = [{:?}, {:?}]
        input_low = [0.0]
        input_high = [5.0]
        [control]
        models = ["rk4"]
        step_s = 5.0
        duration_s = 200.0
        initial_state = [{:?}, {:?}]
        controlled = ["b"]
        q = [{:?}]
        r = [0.1]
        n2 = 10
        nu = 5
        state_low = [{:?}, {:?}]
        state_high = [{:?}, {:?}]
        input_low = [0.0]
        input_high = [5.0]
        references = [
            {{ start_s = 0.0, value = [{:?}] }},
            {{ start_s = 100.0, value = [{:?}] }},
        ]
        "#,
        4.0 * scale,
        4.0 * scale,
        30.0 * scale,
        30.0 * scale,
        9.0 * scale,
        9.0 * scale,
        1.0 / (scale * scale),
        4.0 * scale,
        4.0 * scale,
        30.0 * scale,
        30.0 * scale,
        9.0 * scale,
        16.0 * scale,
    );
    check(&Experiment::parse("tanks.toml".as_ref(), &text, &[], &Plants::built_in()).unwrap())
}

#[test]
fn what_is_found_does_not_depend_on_units() {
    let kinds = |findings: &[Finding]| -> Vec<(Severity, String)> {
        let place = |f: &Finding| f.place.split(',').next().unwrap_or_default().to_owned();
        // Whether a proof comes within its budget depends on rounding, and so on the units.
        let kept = findings.iter().filter(|f| !f.what.contains("is proven to be wrong"));
        kept.map(|f| (f.severity, place(f))).collect()
    };
    let steps = |findings: &[Finding]| {
        let rehearsal = findings.iter().find(|f| f.what.contains("steps of the closed loop"));
        rehearsal.unwrap().what.clone()
    };
    let metres = maglev(1.0, 1.0);
    assert_eq!(warnings(&metres), [""; 0]);
    assert_eq!(steps(&metres), "all 40 steps of the closed loop with RK4 succeed");
    // Held at the gap's references by currents that are rounded in the config.
    let held = metres.iter().filter(|f| f.what.contains("is held at gap = ")).count();
    assert_eq!(held, 2, "{metres:?}");
    for (per_m, per_s) in [(1e3, 1.0), (1e6, 1e3), (1e-3, 1.0 / 3600.0)] {
        let found = maglev(per_m, per_s);
        assert_eq!(kinds(&found), kinds(&metres), "{per_m} {per_s}: {found:?}");
        assert_eq!(steps(&found), steps(&metres));
    }
    let centimetres = tanks(1.0);
    assert_eq!(warnings(&centimetres), [""; 0]);
    assert_eq!(steps(&centimetres), "all 40 steps of the closed loop with RK4 succeed");
    for scale in [1e7, 1e-6] {
        let found = tanks(scale);
        assert_eq!(kinds(&found), kinds(&centimetres), "{scale}: {found:?}");
        assert_eq!(steps(&found), steps(&centimetres));
    }
}

#[test]
fn a_motor_whose_substeps_are_unstable_fails_in_the_rehearsal() {
    let found = trap("motor.toml", &[]);
    let text = warnings(&found);
    assert!(
        text.iter()
            .any(|w| w.contains("4 substeps are unstable") && w.contains("rk4_substeps = 8"))
    );
    let failed = text.iter().find(|w| w.contains("steps of the closed loop with RK4 fail"));
    assert!(failed.is_some_and(|w| w.starts_with("warn  control: ")), "{text:?}");
    let stable = trap("motor.toml", &["control.rk4_substeps=16"]);
    assert!(warnings(&stable).iter().all(|w| !w.contains("unstable") && !w.contains("fail")));
}

/// x^2 is a product; with an exponent that varies there is a logarithm.
#[test]
fn a_power_that_varies_is_an_error_below_0() {
    let power = |state_low: &str| {
        findings_of(
            r#"plant.expression = { states = ["v"], inputs = ["u"], parameters = { n = 2.0 }, derivatives = { v = "u - v^n" } }"#,
            &[
                "model={ horizon_s = 0.2, hidden_layers = 1, neurons = 4 }",
                &format!(
                    "domain={{ state_low = [{state_low}], state_high = [1.0], input_low = [0.0], \
                  input_high = [1.0], parameters = {{ n = [1.5, 2.5] }} }}"
                ),
            ],
        )
    };
    let words = "with n as a variable the equation or a derivative is not finite";
    let says = |findings: &[Finding]| {
        findings.iter().any(|of| of.severity == Severity::Error && of.what.contains(words))
    };
    assert!(says(&power("-0.5")) && !says(&power("0.0")));
}

/// An output of a state that is measured does not get the disturbance of the measurement.
#[test]
fn bounds_on_outputs_beside_output_disturbances_trigger_a_warning() {
    let plant = r#"plant.expression = { states = ["v"], inputs = ["u"], derivatives = { v = "u - v" }, outputs = { z = "2*v" } }"#;
    let of = |measured: &str, disturbance: &str| {
        findings_of(
            plant,
            &[
                "control.output_high={ z = 1.6 }",
                &format!("control.measurement={{ measured = [{measured:?}] }}"),
                &format!(
                    "control.estimator={{ kind = \"ekf\", process_sd = [0.01], measurement_sd = [0.01], \
              initial_estimate = [0.0], initial_sd = [0.1], disturbance = \"{disturbance}\", \
              disturbance_sd = [0.1], disturbance_initial_sd = [0.1] }}"
                ),
            ],
        )
    };
    let words = "z has bounds, but is not measured";
    let warns = |measured: &str, disturbance: &str| {
        of(measured, disturbance)
            .iter()
            .any(|found| found.severity == Severity::Warning && found.what.contains(words))
    };
    assert!(warns("v", "output") && !warns("z", "output") && !warns("v", "input"));
}

/// The findings on a short loop of a plant with the state v and the input u.
fn findings_of(plant: &str, sets: &[&str]) -> Vec<Finding> {
    let text = format!(
        r#"
        name = "short"
        preset = "ours"
        seed = 1
        {plant}
        [control]
        step_s = 0.2
        n2 = 5
        nu = 5
        input_low = [0.0]
        input_high = [1.0]
        controlled = ["v"]
        q = [1.0]
        r = [0.1]
        initial_state = [0.0]
        references = [{{ start_s = 0.0, value = [0.7] }}]
        models = ["rk4"]
        duration_s = 4.0
        "#
    );
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    check(&Experiment::parse("short.toml".as_ref(), &text, &sets, &Plants::built_in()).unwrap())
}

/// The controller of a check has the tube and the scenarios of that of `pinc control`, and what its loop
/// does without is named.
#[test]
fn a_rehearsal_has_the_controller_that_is_configured() {
    let tank = |more: &str| {
        let text = format!(
            r#"
            name = "mixed"
            preset = "ours"
            seed = 1
            [plant.expression]
            states = ["h", "c"]
            inputs = ["q", "f"]
            parameters = {{ a = 0.5, k = 0.2 }}
            derivatives = {{ h = "q - a*sqrt(h)", c = "(f*q - c*q)/h - k*c" }}
            [control]
            models = ["rk4"]
            step_s = 0.5
            duration_s = 2.5
            initial_state = [1.0, 0.4]
            initial_input = [0.5, 0.7]
            controlled = ["h", "c"]
            q = [3.0, 5.0]
            r = [0.3, 0.1]
            n2 = 6
            state_low = [0.2, 0.0]
            state_high = [0.95, 0.9]
            input_low = [0.0, 0.0]
            input_high = [2.0, 2.0]
            references = [{{ start_s = 0.0, value = [1.5, 0.85] }}]
            repetitions = 1
            max_failed_share = 1.0
            {more}
            "#
        );
        let dir = tempfile::tempdir().unwrap();
        let config = dir.path().join("tank.toml");
        std::fs::write(&config, &text).unwrap();
        let run = dir.path().join("run");
        let mut command = pinc(&["control", "--quiet", "--out"]);
        let ended = outcome(command.arg(&run).arg(&config));
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let control = Metrics::read(&run).unwrap().unwrap().control.remove(0);
        (check(&Experiment::load(&config, &[], &Plants::built_in()).unwrap()), control)
    };
    let says = |found: &[Finding], part: &str| found.iter().any(|f| f.what.contains(part));
    let mut broken = Vec::new();
    for more in [
        "",
        "scenarios = { values = { a = [0.5, 0.4, 0.6], k = [0.2, 0.3] }, robust_horizon = 2 }",
        "uncertainty = { probability = 0.99, process_sd = [0.02, 0.01] }",
        "uncertainty = { probability = \"worst-case\", parameters = { a = [0.45, 0.55] } }",
    ] {
        let (found, control) = tank(more);
        let note = control.violations[0].note(None).0;
        assert!(says(&found, note.trim_end_matches('.')), "{more}: {note} {found:?}");
        assert!(!says(&found, "the rehearsed loop has"), "{found:?}");
        broken.push(control.violations[0].amount);
    }
    broken.sort_by(f64::total_cmp);
    broken.dedup();
    assert_eq!(broken.len(), 4, "{broken:?}");
    let (found, control) = tank("uncertainty = { probability = 0.9, process_sd = [10.0, 10.0] }");
    assert_eq!(control.failed_steps(), 5);
    assert!(says(&found, "5 of 5 steps of the closed loop with RK4 fail"), "{found:?}");
    let loads = "loads = [{ start_s = 0.5, rates = { h = 0.2 } }]\n\
                 plant_schedule = [{ start_s = 1.0, values = { a = 0.3 } }]";
    let (found, _) = tank(loads);
    assert!(says(&found, "it leaves out control.plant_schedule, control.loads"), "{found:?}");
}

/// What a sensor tells is judged by the plant, not by an unstable step of RK4: a fast actuator hides
/// nothing. Inputs that are controlled are known, and with targets give way to the others.
#[test]
fn neither_a_fast_actuator_nor_a_tracked_input_is_unseen() {
    let text = r#"
        name = "lag"
        preset = "ours"
        seed = 1
        [plant.expression]
        states = ["x1", "x2"]
        inputs = ["u"]
        derivatives = { x1 = "-0.5*x1 + x2", x2 = "500*(u - x2)" }
        [control]
        models = ["rk4"]
        step_s = 0.4
        duration_s = 8.0
        n2 = 10
        initial_state = [0.0, 0.0]
        controlled = ["x1", "u"]
        q = [1.0, 0.1]
        r = [0.1]
        input_low = [-2.0]
        input_high = [2.0]
        references = [{ start_s = 0.0, value = [1.0, 0.0] }]
        target = true
        [control.measurement]
        measured = ["x1"]
        [control.estimator]
        kind = "ekf"
        process_sd = [0.01, 0.01]
        measurement_sd = [0.01]
        initial_estimate = [0.0, 0.0]
        initial_sd = [0.1, 0.1]
        disturbance = "input"
        disturbance_sd = [0.05]
        disturbance_initial_sd = [0.3]
    "#;
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("lag.toml");
    std::fs::write(&config, text).unwrap();
    let found = outcome(pinc(&["check"]).arg(&config));
    assert!(found.stdout.contains("x1, x2, d_u estimated from x1"), "{found:?}");
    assert!(found.stdout.contains("RK4 is unstable"), "{found:?}");
    for wrong in ["apart", "not measured", "u does not reach"] {
        assert!(!found.stdout.contains(wrong), "{wrong}: {found:?}");
    }
    let watched = text.replace("controlled = [\"x1\", \"u\"]", "controlled = [\"x1\", \"x2\"]");
    std::fs::write(&config, watched.replace("target = true", "target = false")).unwrap();
    let found = outcome(pinc(&["check"]).arg(&config));
    assert!(found.stdout.contains("x2 is controlled, but not measured"), "{found:?}");
}
