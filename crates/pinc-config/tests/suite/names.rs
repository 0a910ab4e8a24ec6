//! Lists that are written by name.

use crate::common::parse;
use pinc_config::Experiment;
use pinc_mpc::Weight;

const CONFIG: &str = r#"
name = "names"
preset = "ours"
seed = 1

[plant.expression]
states = ["h1", "h2", "T[2]"]
inputs = ["pump", "heat"]

[plant.expression.derivatives]
h1 = "pump - h1"
h2 = "h1 - h2"
"T[1]" = "heat - T[1]"
"T[2]" = "T[1] - T[2]"

[plant.expression.outputs]
level = "h1 + h2"
flow = "h1 - h2"

[control]
models = ["rk4"]
step_s = 1.0
duration_s = 10.0
initial_state = { h1 = 1.0, h2 = 2.0, T = 300.0 }
controlled = ["h2", "level"]
q = { level = 3.0 }
r = { heat = 0.5 }
state_low = { h2 = 0.1 }
output_high = { flow = 4.0 }
input_low = { pump = 0.0, heat = -1.0 }
input_high = { heat = 1.0, pump = 2.0 }
references = [{ start_s = 0.0, value = { level = 5.0, h2 = 1.0 } }]
"#;

/// The config with another value for a key.
fn with(set: &str) -> Result<Experiment, String> {
    parse(CONFIG, &[set]).map_err(|error| error.to_string())
}

#[test]
fn a_table_by_name_is_the_list_in_order() {
    let experiment = parse(CONFIG, &[]).unwrap();
    let control = experiment.control.as_ref().unwrap();
    let none = f64::NEG_INFINITY;
    assert_eq!(format!("{:?}", control.initial_state), "[1.0, 2.0, 300.0, 300.0]");
    assert_eq!(control.q, Weight::Diagonal(vec![0.0, 3.0]));
    assert_eq!(control.r, Weight::Diagonal(vec![0.0, 0.5]));
    assert_eq!(format!("{:?}", control.state_low), format!("{:?}", Some([none, 0.1, none, none])));
    // Outputs are in the order of their names.
    assert_eq!(format!("{:?}", control.output_high), "Some([4.0, inf])");
    assert_eq!(
        format!("{:?} {:?}", control.input_low, control.input_high),
        "[0.0, -1.0] [2.0, 1.0]"
    );
    assert_eq!(format!("{:?}", control.references[0].value), "[1.0, 5.0]");
    // The resolved config has the lists, and can be read again.
    let again = parse(&experiment.to_toml(), &[]).unwrap();
    assert_eq!(again, experiment);
    let lists = with("control.state_low=[-inf, 0.1, -inf, -inf]").unwrap();
    assert_eq!(lists, experiment);
}

/// The file has `level` before `flow`, and the plant the other way round.
#[test]
fn different_numbers_for_outputs_in_another_order_are_refused() {
    for set in ["output_low=[-1.0, -4.0]", "output_softness={ penalty = [1.0, 4.0] }"] {
        let (key, error) = (set.split('=').next().unwrap(), with(&format!("control.{set}")));
        let error = error.unwrap_err();
        assert!(error.contains(&format!("`control.{key}")), "{error}");
    }
    let error = with("control.output_high=[1, inf]").unwrap_err();
    let expected = "[1, inf] given, expected a table by name, as { level = 1, flow = inf } in the \
        order of the file: the plant's is flow, level";
    assert!(error.contains(expected), "{error}");
    // Equal numbers have no order, and an override of the plant's outputs is in none.
    with("control.output_low=[-1, -1.0]").unwrap();
    let outputs = "plant.expression.outputs={ level = \"h1\", flow = \"h2\" }";
    parse(CONFIG, &[outputs, "control.output_high=[4.0, 5.0]"]).unwrap();
}

#[test]
fn different_numbers_for_outputs_in_the_order_of_the_plant_are_taken() {
    let own = "[plant.expression.outputs]\nlevel = \"h1 + h2\"\nflow = \"h1 - h2\"\n";
    let config = |from: &str, to: &str| {
        let text = CONFIG.replace("{ flow = 4.0 }", "[4.0, 5.0]");
        assert!(text.contains(own) && text.contains(from));
        text.replace(own, "").replace(from, &format!("{from}{to}"))
    };
    let (plant, last) = ("[plant.expression]\n", "\"T[2]\" = \"T[1] - T[2]\"\n");
    let inline = config(plant, "outputs = { flow = \"h1 - h2\", level = \"h1 + h2\" }\n");
    // Elements of an array are one output.
    let elements = "\"flow[2]\" = \"h1\"\n\"flow[1]\" = \"h2\"\nlevel = \"h1 + h2\"\n";
    let elements = config(last, &format!("[plant.expression.outputs]\n{elements}"));
    // A resolved config has the algebraic variables before the other outputs.
    let two = "[plant.expression.outputs]\nflow = \"h1 - h2\"\n[plant.expression.algebraic]\n\
        level = { equation = \"level - h1 - h2\", low = -9.0, high = 9.0 }\n";
    let two = config(last, two);
    let resolved = parse(&two, &[]).unwrap().to_toml();
    let high = |text: &str| parse(text, &[]).unwrap().control.unwrap().output_high.unwrap();
    for text in [&inline, &two, &resolved] {
        assert_eq!(high(text), [4.0, 5.0], "{text}");
    }
    assert_eq!(high(&elements), [4.0, 4.0, 5.0]);
}

#[test]
fn names_that_are_unknown_or_missing_are_reported() {
    for (set, parts) in [
        (
            "control.state_low={ h3 = 0.1 }",
            ["control.state_low", "`h3` is not known", "did you mean `h"],
        ),
        (
            "control.initial_state={ h1 = 1.0 }",
            ["control.initial_state", "without `h2`", "h1, h2, T[1], T[2]"],
        ),
        ("control.input_low={ pump = 0.0 }", ["control.input_low", "without `heat`", "pump, heat"]),
        ("control.q={ h1 = 1.0 }", ["control.q", "`h1`", "h2, level"]),
        ("control.state_low={ h1 = inf }", ["control.state_low.h1", "inf", "a finite number"]),
        (
            "control.state_high=[nan, 1.0, 1.0, 1.0]",
            ["control.state_high[0]", "NaN", "a finite number"],
        ),
        ("control.input_high=[inf, 1.0]", ["control.input_high[0]", "inf", "a finite number"]),
        // Without a plant there are no names, and the plant is what is wrong.
        (
            "plant.expression.outputs.level={ unit = \"m\", equation = \"h1\" }",
            [
                "plant.expression.outputs.level",
                "expected an expression, or a table",
                "{ expression, unit }",
            ],
        ),
        (
            "plant.expression.stats=[\"h1\"]",
            ["plant.expression.stats", "unknown key", "did you mean `states`"],
        ),
    ] {
        let message = with(set).unwrap_err();
        for part in parts {
            assert!(message.contains(part), "{set}: no `{part}` in {message}");
        }
    }
}

#[test]
fn values_that_make_no_sense_are_shown_as_they_are_written() {
    for (set, part) in [
        ("control.duration_s=-1e300", "`control.duration_s`: -1e300 given, expected"),
        ("control.step_s=1e-300", "10000000 steps of T = 1e-300 s"),
        ("control.n1=1e-300", "floating point `1e-300`, expected a whole number"),
        ("control.n1=1234567890123", "1234567890123 given, expected"),
        (
            "control.output_softness=\"penalty\"",
            "softness.penalty`: a word given, expected a table",
        ),
    ] {
        let message = with(set).unwrap_err();
        assert!(message.contains(part), "{set}: no `{part}` in {message}");
    }
}

/// Plants that are no text have names too.
#[test]
fn built_in_plants_have_names() {
    let tanks = crate::common::read("configs/four-tanks/control.toml");
    let by_list = parse(&tanks, &["control.state_low=[-inf, -inf, 0.6, 0.6]"]).unwrap();
    let by_name = parse(&tanks, &["control.state_low={ h3 = 0.6, h4 = 0.6 }"]).unwrap();
    assert_eq!(by_list, by_name);
}
