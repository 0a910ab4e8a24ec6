//! Bounds, domains, references, and the ends of what is defined.

use super::{experiment, findings, findings_beside, findings_of, only};
use crate::Severity::{Fact, Warning};
use crate::{Finding, bounds, irregularities};

/// Two lags one after the other.
const LAGS: [&str; 2] = ["u - x1", "x1 - x2"];

/// Both states controlled, to 0.5.
const BOTH: [&str; 3] = [
    "control.controlled=[\"x1\", \"x2\"]",
    "control.q=[1.0, 1.0]",
    "control.references=[{ start_s = 0.0, value = [0.5, 0.5] }]",
];

fn with(sets: &[&[&'static str]]) -> Vec<Finding> {
    findings_of(bounds::examine, LAGS, &sets.concat())
}

/// Whether there is a finding with these words.
fn is_said(findings: &[Finding], words: &str) -> bool {
    findings.iter().any(|of| of.what.contains(words))
}

/// A reference is compared with the bounds of its own state, on both sides, and so is the start.
#[test]
fn references_and_starts_lie_within_their_own_bounds() {
    let bounds = |low, high| [low, high];
    let found =
        with(&[&BOTH, &bounds("control.state_low=[-1.0, -1.0]", "control.state_high=[1.0, 0.4]")]);
    let (severity, change) = only(&found, "x2 = 0.5 is outside its bounds");
    assert_eq!(severity, Warning);
    assert!(change.starts_with("move the reference"), "{change}");
    assert!(!is_said(&found, "x1 = 0.5 is outside"), "{found:#?}");
    let low = bounds("control.state_low=[0.6, -1.0]", "control.state_high=[1.0, 1.0]");
    let found = with(&[&BOTH, &low]);
    only(&found, "x1 = 0.5 is outside its bounds");
    // The start is 0.
    let found: Vec<_> =
        found.into_iter().filter(|of| of.place == "control.initial_state").collect();
    only(&found, "x1 = 0 is outside its bounds");
    let alone = ["control.controlled=[\"x2\"]"];
    let wide = bounds("control.state_low=[-1.0, -1.0]", "control.state_high=[0.3, 1.0]");
    assert!(!is_said(&with(&[&alone, &wide]), "outside its bounds"));
}

/// An output is compared with both of its bounds where a reference is held.
#[test]
fn outputs_at_a_reference_lie_within_their_bounds() {
    let outputs = |low: &str, high: &str| {
        let output = "plant.expression.outputs.twice=\"2*x1 - 0.25\"";
        let low = format!("control.output_low=[{low}]");
        let high = format!("control.output_high=[{high}]");
        findings_of(bounds::examine, LAGS, &[output, &low, &high])
    };
    let found = outputs("-1.0", "0.7");
    let words = "twice is 0.75 where the reference is held, outside its bounds -1 to 0.7";
    assert_eq!(only(&found, words).0, Warning);
    let found = outputs("0.8", "1.0");
    let words = "twice is 0.75 where the reference is held, outside its bounds 0.8 to 1";
    assert_eq!(only(&found, words).0, Warning);
    for (low, high) in [("-1.0", "0.8"), ("0.7", "0.8"), ("0.75", "1.0")] {
        assert!(
            !is_said(&outputs(low, high), "where the reference is held, outside"),
            "{low} {high}"
        );
    }
}

/// An output is compared with its bounds at the start, unless an input can bring it back at once, and in units
/// of any size.
#[test]
fn outputs_at_the_start_lie_within_their_bounds() {
    let found = |output: &str, low: &str, high: &str| {
        let sets = [
            format!("plant.expression.outputs.y=\"{output}\""),
            format!("control.output_low=[{low}]"),
            format!("control.output_high=[{high}]"),
        ];
        findings_of(bounds::examine, LAGS, &sets.each_ref().map(String::as_str))
    };
    for unit in [1.0, 1e-9, 1e9] {
        let [some, less, wide] = [0.2 * unit, 0.1 * unit, 2.0 * unit].map(|v| format!("{v:e}"));
        let all = found(&format!("{unit:e}*(x1 + 0.2)"), "-inf", &less);
        let at: Vec<_> = all.into_iter().filter(|of| of.place == "control.initial_state").collect();
        let (severity, change) = only(&at, "outside its bounds");
        assert_eq!(severity, Warning);
        assert!(change.contains("control.output_low"), "{change}");
        let moved = found(&format!("{unit:e}*(x1 + 0.2 - u)"), &format!("-{less}"), &less);
        assert!(!moved.iter().any(|of| of.place == "control.initial_state"), "{moved:#?}");
        assert!(!is_said(&found(&format!("{unit:e}*(x1 + 0.2)"), &some, &wide), "outside its"));
        let held = found(&format!("{unit:e}*x1"), "-inf", &some);
        only(&held, "where the reference is held, outside its bounds");
    }
}

/// Bounds that reach outside the domain on one side are named with the domain that would hold them.
#[test]
fn bounds_lie_within_the_domain() {
    let words = "the bounds of x1 reach outside the training domain";
    for (low, high) in [("-3.0", "1.0"), ("-1.0", "2.5")] {
        let bounds = [
            format!("control.state_low=[{low}, -1.0]"),
            format!("control.state_high=[{high}, 1.0]"),
        ];
        let found = findings_of(bounds::examine, LAGS, &[&bounds[0], &bounds[1]]);
        let (severity, change) = only(&found, words);
        assert_eq!(severity, Warning);
        let [low, high] = [low, high].map(|end| end.trim_end_matches(".0"));
        assert!(
            change.starts_with(&format!("a domain of x1 that holds {low} to {high},")),
            "{change}"
        );
        assert!(!is_said(&found, "the bounds of x2 reach"), "{found:#?}");
    }
    // States without bounds, and an input with wide ones.
    let found = findings_of(bounds::examine, LAGS, &["control.input_high=[1.5]"]);
    assert_eq!(only(&found, words).1, "bounds of x1 in [control], within -2 to 2");
    let (_, change) = only(&found, "the bounds of u reach outside the training domain");
    assert!(change.starts_with("a domain of u that holds -1 to 1.5,"), "{change}");
    let bounds = ["control.state_low=[-2.0, -2.0]", "control.state_high=[2.0, 2.0]"];
    let found = findings_of(bounds::examine, LAGS, &bounds);
    assert_eq!(only(&found, "start and references are within the bounds").0, Fact);
}

/// A reference is named once, with how often it comes again.
#[test]
fn equal_references_are_looked_at_once() {
    let step = |k: usize, value: f64| format!("{{ start_s = {k}.0, value = [{value}] }}");
    let values = [0.5, 0.25, 0.5, 0.25, 0.5];
    let steps: Vec<String> = values.iter().enumerate().map(|(k, v)| step(k, *v)).collect();
    let found = findings(LAGS, &[&format!("control.references=[{}]", steps.join(", "))]);
    only(&found, "x1 = 0.5 (and 2 times more) is held at x1 = 0.5, x2 = 0.5 by u = 0.5");
    only(&found, "x1 = 0.25 (and once more) is held at x1 = 0.25, x2 = 0.25 by u = 0.25");
    let found = findings(LAGS, &["control.references=[{ start_s = 0.0, value = [1.5] }]"]);
    let (severity, _) =
        only(&found, "x1 = 1.5 cannot be held within bounds: it needs u = 1.5 (bounds -1 to 1)");
    assert_eq!(severity, Warning);
}

/// Of a function that ends just outside the box, the guard is 0 where it is defined there, since 0 is
/// a physical limit; or else the end of the box.
#[test]
fn a_guard_is_zero_where_that_is_defined() {
    let guard = |term: &str, low: f64| {
        let domain = format!("domain.state_low=[{low}, -2.0]");
        let start = format!("control.initial_state=[{}, 0.0]", low + 0.5);
        let plant = [&*format!("u - {term}"), "x1 - x2"];
        let found = findings_of(irregularities::examine, plant, &[&domain, &start]);
        let found: Vec<_> =
            found.into_iter().filter(|of| of.what.contains("is not defined")).collect();
        let (severity, change) = only(&found, "just outside the training domain");
        assert_eq!(severity, Warning);
        change.to_owned()
    };
    assert_eq!(guard("sqrt(x1 + 0.05)", 0.1), "write max(x1, 0) for x1 in it");
    assert_eq!(guard("sqrt(x1)", 0.1), "write max(x1, 0.1) for x1 in it");
    assert_eq!(guard("sqrt(x1 + 2.05)", -2.0), "write max(x1, -2) for x1 in it");
    assert_eq!(guard("log(x1 - 0.95)", 1.0), "write max(x1, 1) for x1 in it");
}

/// Rates are said by the unit of time: 4 per second is 240 per minute at most.
#[test]
fn rates_are_said_in_the_unit_of_time() {
    let found = findings(["4*u - 0*x1", "x1 - x2"], &["time_unit=\"min\""]);
    let words = "values and derivatives are finite at 1000 random points";
    let what = &found.iter().find(|of| of.what.contains(words)).unwrap().what;
    let rate = what.split("|x1'| <= ").nth(1).unwrap().split(" per min").next().unwrap();
    let rate: f64 = rate.parse().unwrap();
    assert!((230.0..=240.0).contains(&rate), "{what}");
}

/// A net is used with values of a parameter beyond those it was trained with: the one that goes
/// farthest is named.
#[test]
fn parameters_beyond_the_training_are_named() {
    let sets = |schedule: &str| {
        let net = [
            "control.models=[\"pinc\"]",
            "training={}",
            "model={ horizon_s = 0.5, hidden_layers = 1, neurons = 4 }",
            "validation.duration_s=1.0",
            "validation.domain={ state_low = [-1.0, -1.0], state_high = [1.0, 1.0], \
             input_low = [-1.0], input_high = [1.0] }",
            "plant.expression.parameters={ k = 1.0 }",
            "domain.parameters={ k = [0.5, 2.0] }",
            "control.step_s=0.5",
        ];
        let mut sets: Vec<String> = net.iter().map(|&set| set.to_owned()).collect();
        sets.push(format!("control.parameter_schedule=[{schedule}]"));
        sets.push("--unset control.step_s".to_owned());
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        findings(["k*(u - x1)", "x1 - x2"], &sets)
    };
    let at = |(i, k): (usize, &f64)| format!("{{ start_s = {i}, values = {{ k = {k:?} }} }}");
    let said = |values: &[f64]| {
        let found = sets(&values.iter().enumerate().map(at).collect::<Vec<_>>().join(", "));
        let found = found.into_iter().find(|of| of.place == "domain.parameters");
        found.map(|of| of.what)
    };
    let trained = "but trained from 0.5 to 2";
    for (values, expected) in [
        (&[0.25, 1.5][..], Some("k down to 0.25")),
        (&[1.5, 3.0], Some("k up to 3")),
        (&[0.25, 3.0], Some("k from 0.25 to 3")),
        (&[0.5, 2.0], None),
    ] {
        let expected = expected.map(|said| format!("the net is used with {said}, {trained}"));
        assert_eq!(said(values), expected);
    }
}

/// Measurements that cannot be read are an error at their key, and a training without any that are
/// held out is warned of.
#[test]
fn measurements_that_cannot_be_read_are_an_error() {
    let sets = [
        "data.files=[\"a.csv\"]",
        "training={}",
        "model={ horizon_s = 0.5, hidden_layers = 1, neurons = 4 }",
        "validation.duration_s=1.0",
        "validation.domain={ state_low = [-1.0, -1.0], state_high = [1.0, 1.0], \
         input_low = [-1.0], input_high = [1.0] }",
    ];
    let found = findings_beside(LAGS, &sets, &|_| Err("a.csv:3: too short".to_owned()));
    let finding = found.iter().find(|of| of.place == "data.files").unwrap();
    assert_eq!((finding.severity, &*finding.what), (crate::Severity::Error, "a.csv:3: too short"));
    assert_eq!(only(&found, "no measurements are held out").0, Warning);
    assert!(experiment(LAGS, &sets).data.is_some());
}
