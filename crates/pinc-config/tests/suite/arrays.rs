//! Configs of plants with arrays.

use crate::common::parse;
use pinc_config::trials;
use pinc_mpc::Weight;

/// A rod with three nodes, a drum of two and a lamp.
const PLANT: &str = r#"
name = "arrays"
preset = "ours"
seed = 1

[plant.expression]
sizes = { n = 3, m = 2 }
states = [{ name = "T[n]", unit = "K" }, "E", "z[m]"]
inputs = ["P", "v[m]"]
parameters = { k = 2.0, w = [1.0, 2.0, 4.0] }

[plant.expression.derivatives]
"T[1]" = "P - k*(T[1] - T[2])"
"T[i=2..n-1]" = "k*(T[i-1] - 2*T[i] + T[i+1])"
"T[n]" = "k*(T[n-1] - T[n])"
E = "sum(i = 1..n, w[i]*T[i]^2)"
"z[i]" = "v[i] - z[i]"

[plant.expression.outputs]
"y[i=1..m]" = "z[i] + E"
"#;

const SECTIONS: &str = r#"
[model]
horizon_s = 1.0
hidden_layers = 1
neurons = 4

[domain]
state_low = [0.0, 1.0, [2.0, 3.0]]
state_high = [9.0, 9.0, [8.0, 7.0]]
input_low = [-1.0, -2.0]
input_high = [1.0, 1.0, 2.0]

[control]
models = ["rk4"]
duration_s = 10.0
initial_state = [5, 0, [1, 2]]
controlled = ["T", "T[n]", "z[1..m]"]
q = [1.0, 2.0, [3.0, 4.0]]
r = [[1.0], [2.0, 3.0]]
input_low = [-1.0, -1.0]
input_high = [1.0, 1.0]
output_low = [0.5]
references = [{ start_s = 0.0, value = [5.0, 6.0, 7.0] }]
"#;

/// The config with other lines for these keys.
fn with(changes: &[(&str, &str)]) -> String {
    let mut text = format!("{PLANT}{SECTIONS}");
    for (key, line) in changes {
        let from = text.find(&format!("\n{key} = ")).unwrap() + 1;
        let to = from + text[from..].find('\n').unwrap();
        text.replace_range(from..to, line);
    }
    text
}

/// Lists for the controlled quantities, each once.
const CONTROLLED: (&str, &str) = ("controlled", "controlled = [\"T\", \"z[1..m]\", \"y\"]");

#[test]
fn an_entry_of_a_list_is_for_an_array_or_for_each_of_its_elements() {
    let text = with(&[CONTROLLED]);
    let experiment = parse(&text, &[]).unwrap();
    let domain = experiment.domain.as_ref().unwrap();
    assert_eq!(domain.state_low, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    assert_eq!(domain.state_high, [9.0, 9.0, 9.0, 9.0, 8.0, 7.0]);
    assert_eq!(domain.input_low, [-1.0, -2.0, -2.0]);
    assert_eq!(domain.input_high, [1.0, 1.0, 2.0]);
    let control = experiment.control.as_ref().unwrap();
    assert_eq!(control.initial_state, [5.0, 5.0, 5.0, 0.0, 1.0, 2.0]);
    assert_eq!(control.controlled, ["T[1]", "T[2]", "T[3]", "z[1]", "z[2]", "y[1]", "y[2]"]);
    assert_eq!(control.q, Weight::Diagonal(vec![1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0]));
    assert_eq!(control.r, Weight::Diagonal(vec![1.0, 2.0, 3.0]));
    assert_eq!(control.references[0].value, [5.0, 5.0, 5.0, 6.0, 6.0, 7.0, 7.0]);
    assert_eq!(control.output_low, Some(vec![0.5, 0.5]));
    // Written out, it is the same experiment.
    assert_eq!(parse(&experiment.to_toml(), &[]).unwrap(), experiment);
}

const IDENTIFY: &str = r#"
[identify]
measured = ["T[2..n]", "E"]
measurement_sd = [0.1, 0.2]
initial_state = { T = 1.0, E = 2.0, z = 3.0 }
parameters = [{ name = "k", initial = 1.0 }]
"#;

/// The config with more lines, as written out.
fn control_with(line: &str) -> toml::Table {
    let controlled = ("controlled", "controlled = [\"E\", \"v\", \"P\"]");
    let text = with(&[controlled, ("q", "q = [2.0, 3.0, 1.0]")]) + line;
    let experiment = parse(&text, &[]).unwrap_or_else(|error| panic!("{line}: {error}"));
    let text = experiment.to_toml();
    assert_eq!(parse(&text, &[]).unwrap(), experiment, "{line}");
    text.parse().unwrap()
}

#[test]
fn an_array_stands_for_its_elements_wherever_variables_are_named() {
    for (line, key, expected) in [
        ("", "controlled", r#"["E", "v[1]", "v[2]", "P"]"#),
        ("", "q", "[2.0, 3.0, 3.0, 1.0]"),
        ("periodic = [\"z\"]", "periodic", r#"["z[1]", "z[2]"]"#),
        ("integer = [\"v\"]", "integer", r#"["v[1]", "v[2]"]"#),
        (
            "end_state = { T = 4.0, \"T[2]\" = 5.0 }",
            "end_state",
            r#"{ "T[1]" = 4.0, "T[2]" = 5.0, "T[3]" = 4.0 }"#,
        ),
        (
            "state_low = { z = 0.0 }\nbound_schedule = [{ start_s = 1.0, state_low = { z = 0.5 }, input_high = { v = 0.2 }, output_low = { y = 1.0 } }]",
            "bound_schedule",
            r#"[{ start_s = 1.0, state_low = { "z[1]" = 0.5, "z[2]" = 0.5 },
                  input_high = { "v[1]" = 0.2, "v[2]" = 0.2 },
                  output_low = { "y[1]" = 1.0, "y[2]" = 1.0 } }]"#,
        ),
        (
            "uncertainty = { probability = 0.9, process_sd = [0.1, 0.2, 0.3] }",
            "uncertainty.process_sd",
            "[0.1, 0.1, 0.1, 0.2, 0.3, 0.3]",
        ),
        (
            "uncertainty = { probability = \"worst-case\", boxes = { z = 0.4 } }",
            "uncertainty.boxes",
            r#"{ "z[1]" = 0.4, "z[2]" = 0.4 }"#,
        ),
        (
            "loads = [{ start_s = 1.0, rates = { z = 0.1 }, inputs = { v = 0.2 } }]",
            "loads",
            r#"[{ start_s = 1.0, rates = { "z[1]" = 0.1, "z[2]" = 0.1 },
                  inputs = { "v[1]" = 0.2, "v[2]" = 0.2 } }]"#,
        ),
        ("first_plan = { input = [0.5, 1.0] }", "first_plan.input", "[0.5, 1.0, 1.0]"),
        (IDENTIFY, "../identify.measured", r#"["T[2]", "T[3]", "E"]"#),
        (IDENTIFY, "../identify.measurement_sd", "[0.1, 0.1, 0.2]"),
        (IDENTIFY, "../identify.initial_state", "[1.0, 1.0, 1.0, 2.0, 3.0, 3.0]"),
    ] {
        let table = toml::Value::Table(control_with(line));
        let key = key.strip_prefix("../").map_or(format!("control.{key}"), str::to_owned);
        let found = key.split('.').fold(&table, |value, key| &value[key]);
        let expected: toml::Table = format!("expected = {expected}").parse().unwrap();
        assert_eq!(found, &expected["expected"], "{key}");
    }
}

#[test]
fn names_have_the_sizes_in_their_brackets() {
    let text = with(&[("controlled", "controlled = [\"T[n]\", \"T[2*m - 3]\", \"E\"]")]);
    let control = parse(&text, &[]).err();
    assert!(control.unwrap().contains("control.q[2]"));
    let text = text.replace("q = [1.0, 2.0, [3.0, 4.0]]", "q = [1.0, 2.0, 3.0]");
    let control = parse(&text, &[]).unwrap().control.unwrap();
    assert_eq!(control.controlled, ["T[3]", "T[1]", "E"]);
}

#[test]
fn lists_of_another_length_are_refused() {
    let low = |list: &str| {
        let line = format!("state_low = {list}");
        parse(&with(&[CONTROLLED, ("state_low", &line)]), &[]).unwrap_err()
    };
    let nested = low("[0.0, 1.0, [2.0]]");
    let expected =
        "`domain.state_low[2]`: 1 values given, expected 2, one per element of the array";
    assert!(nested.contains(expected) && nested.starts_with("test.toml:28:"), "{nested}");
    let two = "2 values given, expected 6: T[1..3], E, z[1..2]";
    assert!(low("[0.0, 1.0]").contains(two), "{}", low("[0.0, 1.0]"));
    for beyond in ["T[4]", "T[2..4]", "T[0..n]", "T[1..0]"] {
        let line = format!("controlled = [\"{beyond}\"]");
        let unknown = parse(&with(&[("controlled", &line)]), &[]).unwrap_err();
        let known = "is not known; expected one of T[1..3], E, z[1..2], y[1..2]";
        assert!(unknown.contains(&format!("`{beyond}` {known}")), "{unknown}");
    }
}

#[test]
fn another_size_is_set_like_any_value() {
    let text = with(&[CONTROLLED]);
    let experiment = parse(&text, &["plant.expression.sizes.n=50"]);
    // Three weights w are not enough for 50 elements.
    let shown = experiment.unwrap_err();
    assert!(shown.contains("`w[4]` does not exist"), "{shown}");
    let weights = format!("plant.expression.parameters.w={:?}", [1.0; 50]);
    let experiment = parse(&text, &["plant.expression.sizes.n=50", &weights]).unwrap();
    assert_eq!(experiment.control.unwrap().initial_state.len(), 53);
    let none = parse(&text, &["plant.expression.sizes.n=0"]).unwrap_err();
    let expected = "`plant.expression.sizes.n`: a size of 0, expected 1 to 10000";
    assert!(none.contains(expected), "{none}");
}

#[test]
fn a_sweep_has_sizes_on_an_axis() {
    let text = with(&[CONTROLLED]);
    let text = text.replace("w[i]*T[i]^2", "w[1]*T[i]^2 + w[2]*w[3]");
    let sweep = "\n[sweep]\ngrid = [{ key = \"plant.expression.sizes.n\", values = [2, 3, 7] }]\n";
    let experiment = parse(&format!("{text}{sweep}"), &[]).unwrap();
    let trials = trials(&experiment).unwrap();
    let states: Vec<_> =
        trials.iter().map(|t| t.experiment.control.as_ref().unwrap().initial_state.len()).collect();
    assert_eq!(states, [5, 6, 10]);
}

/// An error in an equation for many elements is shown in the line where it stands.
#[test]
fn errors_have_the_line_of_the_equation() {
    let text = with(&[CONTROLLED]).replace("2*T[i] + T[i+1]", "2*T[i] + T[i+2]");
    let shown = parse(&text, &[]).unwrap_err();
    let expected = "test.toml:14: `plant.expression.derivatives.T[i=2..n-1]`: `T[4]` does not exist, \
                    expected an index from 1 to 3 (at i = 2)";
    assert!(shown.starts_with(expected), "{shown}");
}

/// The plant in the loop may have no array where the equations have a number.
#[test]
fn an_array_in_place_of_a_number_is_refused_in_both_plants() {
    for key in ["plant", "control.plant"] {
        let set = format!("{key}.expression.parameters.k=[2.0]");
        let error = parse(&with(&[]), &[&set]).unwrap_err();
        assert!(error.contains(&format!("`{key}.expression.derivatives.T[1]`")), "{error}");
        assert!(error.contains("`k` is an array"), "{error}");
    }
}
