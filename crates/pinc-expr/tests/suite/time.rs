//! Equations in another unit of time, and functions of the time.

use crate::numbers::texts;
use pinc_expr::{Equations, TimeFunction, TimeUnit};
use pinc_ode::{Dims, Integrator, Linearization, Plant, Stages, Variable};

/// A chemostat: its rates are per unit of time, its output has none.
fn chemostat(time_unit: Option<TimeUnit>, divided_by: &str) -> Equations {
    Equations {
        states: vec![Variable::new("S", "g/l"), Variable::new("X", "g/l")],
        inputs: vec![Variable::new("D", "")],
        intermediates: texts(&[("mu", "0.5*S/(S + 0.1)")]),
        time_unit,
        derivatives: texts(&[
            ("S", &format!("(D*(5 - S) - mu*X/0.4)/{divided_by}")),
            ("X", &format!("(mu - D)*X/{divided_by}")),
        ]),
        outputs: [("rate".to_owned(), output("mu*X"))].into(),
        ..Equations::default()
    }
}

fn output(expression: &str) -> pinc_expr::OutputExpression {
    pinc_expr::OutputExpression { expression: expression.to_owned(), unit: String::new() }
}

#[test]
fn rates_are_per_unit_of_time() {
    let (x, u) = ([0.7, 1.6], [0.3]);
    for (unit, seconds) in [(TimeUnit::H, "3600"), (TimeUnit::Min, "60"), (TimeUnit::Ms, "0.001")] {
        let own = chemostat(Some(unit), "1").compile().unwrap();
        let divided = chemostat(None, seconds).compile().unwrap();
        let (mut found, mut expected) = ([0.0; 2], [0.0; 2]);
        own.rhs(&x, &u, &[], &mut found);
        divided.rhs(&x, &u, &[], &mut expected);
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() <= 1e-14 * expected.abs(), "{found} {expected}");
        }
        let (mut y, mut same) = ([0.0], [0.0]);
        own.output(&x, &u, &[], &mut y);
        chemostat(None, "1").compile().unwrap().output(&x, &u, &[], &mut same);
        assert_eq!(y.to_vec(), same, "an output is no rate");
    }
}

/// So do integrators, whose derivatives come from other code.
#[test]
fn models_are_in_seconds() {
    let step = |equations: Equations| {
        let plant = equations.compile().unwrap().into_dyn();
        let mut model = plant.model(Integrator::Rk4, 900.0, 4).unwrap();
        let dims = Dims::new(2, 1);
        let (mut next, mut a, mut b) = (vec![0.0; 2], vec![0.0; 4], vec![0.0; 2]);
        assert_eq!((model.dims().nx, model.dims().nu), (dims.nx, dims.nu));
        model.linearize(
            Stages { x: &[0.7, 1.6], u: &[0.3], p: &[] },
            Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
        );
        [next, a, b].concat()
    };
    let found = step(chemostat(Some(TimeUnit::H), "1"));
    let expected = step(chemostat(None, "3600"));
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() <= 1e-13 * (1.0 + expected.abs()), "{found} {expected}");
    }
}

#[test]
fn arrays_keep_the_unit() {
    let rod: Equations = serde_json::from_str(
        r#"{"sizes": {"n": 3}, "states": ["T[n]"], "inputs": ["P"], "time_unit": "min",
            "derivatives": {"T[i]": "i*P - T[i]"}}"#,
    )
    .unwrap();
    let mut dx = [0.0; 3];
    rod.compile().unwrap().rhs(&[0.0; 3], &[2.0], &[], &mut dx);
    assert_eq!(dx.map(|rate| (rate * 60.0).round()).to_vec(), [2.0, 4.0, 6.0]);
}

#[test]
fn functions_of_t_are_expressions() {
    let value = |text: &str, t: f64| TimeFunction::parse(text).unwrap().at(t);
    assert!((value("2*sin(pi*t) + t^2", 0.5) - 2.25).abs() < 1e-15);
    let values = [value("max(min(t, 3), 1)", 7.0), value("4.5", 7.0)];
    assert_eq!(values.to_vec(), [3.0, 4.5]);
    let unknown = TimeFunction::parse("1 + x").unwrap_err().to_string();
    assert!(unknown.contains("`x`") && unknown.contains('t'), "{unknown}");
    assert!(TimeFunction::parse("2*(t").is_err());
    assert!(TimeFunction::parse("").is_err());
}

/// Minutes and hours from two of them on.
#[test]
fn a_time_is_shown_in_the_unit_that_suits_it() {
    for (seconds, shown) in [
        (0.0, "0 s"),
        (9e-5, "90 us"),
        (0.09, "90 ms"),
        (0.1, "0.1 s"),
        (119.0, "119 s"),
        (120.0, "2 min"),
        (7140.0, "119 min"),
        (7200.0, "2 h"),
        (1.8e5, "50 h"),
        (2.16e5, "2.5 d"),
    ] {
        assert_eq!(TimeUnit::shown(seconds, None), shown);
    }
    assert_eq!(TimeUnit::shown(5400.0, Some(TimeUnit::H)), "1.5 h");
}
