//! What is said of an identification.

use super::*;

fn metrics() -> IdentificationMetrics {
    let text = r#"{ "experiment": "e", "model": "rk4", "parameters": {}, "cost": 2.0,
        "outputs": [], "measurement_sd": [], "initial_states": [], "status": "",
        "method": "", "reason": "", "measurements": 9, "degrees_of_freedom": 7,
        "residuals": {}, "correlation": { "names": [], "matrix": [] }, "singular_values": [],
        "findings": [],
        "work": { "iterations": 1, "steps": 1, "linearized": 1, "wall_s": 1.0 } }"#;
    serde_json::from_str(text).unwrap()
}

#[test]
fn estimates_have_the_digits_of_their_intervals() {
    for (value, half_width, text) in [
        (1.300_17e-9, Some(4.08e-13), "1.300170e-9"),
        (0.001_200_12, Some(4.44e-7), "0.001200120"),
        (0.3, Some(0.01), "0.300000"),
        (2.5e-7, None, "2.50e-7"),
        (0.0, Some(1e-30), "0.000000000000000"),
        (-5.627e-8, Some(8.64e-7), "-5.63e-8"),
    ] {
        assert_eq!(as_precise(value, half_width), text);
    }
}

#[test]
fn correlations_that_are_not_known_are_not_said() {
    let of = |chance| InputCorrelationMetrics { correlation: 0.25, lag: 3, chance };
    let unknown = InputCorrelationMetrics { correlation: f64::NAN, ..of(None) };
    let text = serde_json::to_string(&unknown).unwrap();
    assert_eq!(text, r#"{"correlation":null,"lag":3,"chance":null}"#);
    let read: InputCorrelationMetrics = serde_json::from_str(&text).unwrap();
    assert!(read.correlation.is_nan());
    let inputs = [("u".to_owned(), of(Some(0.5))), ("v".to_owned(), of(None))].into();
    let left = ResidualMetrics { measurements: 9, rms: 1.0, correlation: 0.0, inputs };
    assert_eq!(left.with_inputs(), "u: 0.25 at 3 steps (0.50), v: constant, or too few rows");
}

#[test]
fn a_weight_is_of_the_net_of_its_name() {
    let nets = ["law2", "law"].map(str::to_owned).to_vec();
    let metrics = IdentificationMetrics { nets, ..metrics() };
    assert_eq!(metrics.net_of("law[3]").unwrap(), "law");
    assert_eq!(metrics.net_of("law2[1]").unwrap(), "law2");
    assert_eq!([metrics.net_of("law"), metrics.net_of("la[1]")], [None; 2]);
}

/// The errors are 0 and 3, and 4 where there is a measurement; an output without one has none.
#[test]
fn errors_on_held_out_data_are_root_mean_squares() {
    let names = ["a", "b", "c"].map(str::to_owned);
    let none = f64::NAN;
    let (y, simulated) = ([2.0, none, none, 4.0, 12.0, none], [2.0, 5.0, 1.0, 1.0, 8.0, 1.0]);
    let found = HeldOutMetrics::of(String::new(), 1, (&names, [&y, &simulated]));
    assert!((found.rms["a"] - 4.5_f64.sqrt()).abs() < 1e-12, "{found:?}");
    assert!((found.rms["b"] - 4.0).abs() < 1e-12, "{found:?}");
    assert_eq!(found.rms.len(), 2);
}

/// JSON has no infinity, and the file is read back.
#[test]
fn fits_without_a_finite_cost_end_at_no_minimum() {
    let minima = MinimumMetrics::of([f64::INFINITY, 2.0, f64::NAN, 2.001]);
    assert_eq!(minima, [MinimumMetrics { cost: 2.0, starts: 2 }]);
    let costs = [Some(2.0), None];
    let start = |cost| StartMetrics { cost, parameters: BTreeMap::new(), status: String::new() };
    let starts = costs.map(start).to_vec();
    let written = IdentificationMetrics { minima, starts, ..metrics() };
    let read: IdentificationMetrics = serde_json::from_str(&written.to_json()).unwrap();
    assert_eq!(read, written);
}

fn of(status: &str, starts: &[(Option<f64>, &str)]) -> String {
    let start = |(cost, status): &(Option<f64>, &str)| StartMetrics {
        cost: *cost,
        parameters: BTreeMap::new(),
        status: (*status).to_owned(),
    };
    let (status, starts) = (status.to_owned(), starts.iter().map(start).collect());
    IdentificationMetrics { status, starts, ..metrics() }.ended()
}

#[test]
fn the_number_of_starts_per_end_is_reported() {
    let one = of("converged", &[(Some(2.0), "converged")]);
    assert!(one.starts_with("converged from a single start ("), "{one}");
    let several = [
        (Some(2.0), "converged"),
        (Some(2.001), "stalled"),
        (Some(5.25), "converged"),
        (Some(7.5), "converged"),
        (None, "not finite"),
        (Some(3.0), "set aside"),
    ];
    assert_eq!(
        of("converged", &several),
        "converged from 6 starts: 2 of 5 that were fitted to the end ended here, 1 at the cost \
         5.250000, 1 at the cost 7.500000; set aside after a short fit: 1"
    );
    let alone = of("converged", &[(Some(2.0), "converged"), (Some(2.1), "converged")]);
    assert!(alone.ends_with("more of them may find a better minimum"), "{alone}");
}

/// Parameters have their intervals, weights of a net are summed up, states at the beginning have
/// their file where there are several.
#[test]
fn a_result_is_said_in_a_few_lines() {
    let estimate = |value, half_width_95| EstimateMetrics { value, half_width_95 };
    let parameter = |name: &str, value, width| {
        let estimate = estimate(value, width);
        let of = ParameterMetrics { estimate, initial: 0.0, low: None, high: None, at_bound: None };
        (name.to_owned(), of)
    };
    let parameters = [
        parameter("k", 2.0, Some(0.125)),
        parameter("m", 3.0, None),
        parameter("law[1]", 3.0, None),
        parameter("law[2]", 4.0, None),
    ];
    let state = |file: &str| InitialStateMetrics {
        file: file.to_owned(),
        states: [("h".to_owned(), estimate(5.0, Some(0.5)))].into(),
    };
    let rms = [("h".to_owned(), 0.25)].into();
    let held_out = HeldOutMetrics { file: "c.csv".to_owned(), fitted_rows: 3, rms };
    let result = IdentificationMetrics {
        parameters: parameters.into(),
        nets: vec!["law".to_owned()],
        initial_states: vec![state("a.csv")],
        held_out: vec![held_out],
        status: "converged".to_owned(),
        method: "single shooting".to_owned(),
        reason: "short".to_owned(),
        findings: vec!["one".to_owned()],
        ..metrics()
    };
    let said = result.to_string();
    assert!(said.starts_with("rk4: converged from a single start ("), "{said}");
    let lines: Vec<&str> = said.lines().skip(1).collect();
    let expected = [
        "  k = 2.000000 +- 1.25e-1",
        "  m = 3.000000, without an interval",
        "  h(0) = 5.000000 +- 5.00e-1",
        "  law: 2 weights of 3.536 rms",
        "  h of c.csv, held out: error 0.2500 rms",
        "note: one",
    ];
    assert_eq!(lines, expected);
    let several =
        IdentificationMetrics { initial_states: vec![state("a.csv"), state("b.csv")], ..result };
    assert!(several.to_string().contains("\n  h(0) of b.csv = 5.000000 +- 5.00e-1"));
}
