//! The meaning of an equation's text, and messages about texts without meaning.

use pinc_expr::{Equations, ExpressionError, ExpressionProblem};
use pinc_ode::{Plant, Variable};

/// The plant x' = `text` with the parameters a = 2, b = 3 and the input u.
fn equations(text: &str) -> Equations {
    Equations {
        states: vec![Variable::new("x", "")],
        inputs: vec![Variable::new("u", "")],
        parameters: [("a".to_owned(), 2.0), ("b".to_owned(), 3.0)].into(),
        // So that no parameter is unused.
        intermediates: [("sum".to_owned(), "a + b".to_owned())].into(),
        derivatives: [("x".to_owned(), text.to_owned())].into(),
        ..Equations::default()
    }
}

/// Its value at x = 5, u = 7.
fn value(text: &str) -> f64 {
    let plant = equations(text).compile().unwrap_or_else(|error| panic!("{text}: {error}"));
    let mut dx = [f64::NAN];
    plant.rhs(&[5.0], &[7.0], &[], &mut dx);
    dx[0]
}

fn error(text: &str) -> ExpressionError {
    match equations(text).compile() {
        Ok(_) => panic!("{text} is valid"),
        Err(error) => error,
    }
}

#[test]
fn precedence_and_associativity() {
    for (text, expected) in [
        ("x - u - 1", -3.0),
        ("x - (u - 1)", -1.0),
        ("x/u/7", 5.0 / 49.0),
        ("x + u*2", 19.0),
        ("-x^2", -25.0),
        ("(-x)^2", 25.0),
        ("-x*u", -35.0),
        ("2^-1*x", 2.5),
        ("a^b^2 + 0*x", 512.0),
        ("x*-u", -35.0),
        ("--x", 5.0),
        ("+x - -u", 12.0),
        ("2*x^3/5", 50.0),
        ("x^-2", 0.04),
        ("x^0", 1.0),
        ("sum*x", 25.0),
        (" a\n* ( x\t+ b ) ", 16.0),
    ] {
        let found = value(text);
        assert!((found - expected).abs() <= 1e-15 * expected.abs(), "{text} is {found}");
    }
}

#[test]
fn numbers_and_functions() {
    for (text, expected) in [
        ("1.5e-3*x", 0.0075),
        (".5 + 2. + 0*x", 2.5),
        ("1E2 - x", 95.0),
        ("pi*x", 5.0 * std::f64::consts::PI),
        ("sqrt(x)", 5.0_f64.sqrt()),
        ("x^0.5", 5.0_f64.sqrt()),
        ("x^1.5", 5.0_f64.powf(1.5)),
        ("x^u", 5.0_f64.powi(7)),
        ("2^x", 32.0),
        ("x^40", 5.0_f64.powi(40)),
        ("exp(-x)", (-5.0_f64).exp()),
        ("log(x)", 5.0_f64.ln()),
        ("sin(x)", 5.0_f64.sin()),
        ("cos(x)", 5.0_f64.cos()),
        ("tan(x)", 5.0_f64.tan()),
        ("tanh(x/5)", 1.0_f64.tanh()),
        ("atan(x)", 5.0_f64.atan()),
        ("abs(-x)", 5.0),
        ("sign(-x)", -1.0),
        ("min(x, u)", 5.0),
        ("max(x, u)", 7.0),
        ("max(-x, 0)", 0.0),
        ("min(x, 0.5)", 0.5),
        ("sin(1) + 0*x", 1.0_f64.sin()),
    ] {
        let found = value(text);
        // e^(u log x) is the least accurate: 11 times the rounding of the logarithm.
        assert!((found - expected).abs() <= 1e-14 * expected.abs(), "{text} is {found}");
    }
}

#[test]
fn a_chain_of_ten_thousand_operations() {
    let text = format!("x{}", " + u".repeat(10_000));
    assert!((value(&text) - 70_005.0).abs() < 1e-9);
}

#[test]
fn a_chain_of_ten_thousand_names() {
    let mut equations = equations("n9999");
    equations.intermediates.insert("n0".to_owned(), "x".to_owned());
    for i in 1..10_000 {
        equations.intermediates.insert(format!("n{i}"), format!("n{} + u", i - 1));
    }
    let mut dx = [0.0];
    equations.compile().expect("valid equations").rhs(&[5.0], &[7.0], &[], &mut dx);
    assert!((dx[0] - (5.0 + 9_999.0 * 7.0)).abs() < 1e-9);
}

/// The message about a text, with the column that its caret points at.
#[test]
fn errors_point_at_the_character() {
    for (text, column, message) in [
        ("a*(1 - x^2)*y + u", 13, "unknown name `y`; expected one of a, b, sum, u, x, pi"),
        ("x + t", 5, "the time may not stand in an equation"),
        ("x + ", 5, "the expression ends here, expected a number, a name or `(`"),
        ("", 1, "the expression ends here, expected a number, a name or `(`"),
        ("x u", 3, "`u`, expected an operator or the end"),
        ("2x", 2, "`x`, expected an operator or the end"),
        ("(x + u", 7, "the expression ends here, expected an operator or `)`"),
        ("x + u)", 6, "`)`, expected an operator or the end"),
        ("x * / u", 5, "`/`, expected a number, a name or `(`"),
        ("x**2", 2, "a power is written `^`"),
        ("x % 2", 3, "unexpected character `%`"),
        ("x·u", 2, "unexpected character `·`"),
        ("x + 1.2.3", 8, "the number 0.3, expected an operator or the end"),
        ("x + 1e999", 5, "`1e999` is not a finite number"),
        ("x + .", 5, "`.` is not a finite number"),
        ("sin x", 5, "`x`, expected `(` after a function"),
        ("sin(x, u)", 1, "`sin` with 2 arguments, expected 1"),
        ("x + min(x)", 5, "`min` with 1 arguments, expected 2"),
        ("u + sinus(x)", 5, "unknown function `sinus`; expected one of sqrt, exp, log"),
        ("sin()", 5, "`)`, expected a number, a name or `(`"),
        ("max(x; u)", 6, "unexpected character `;`"),
        ("a(x)", 1, "unknown function `a`"),
    ] {
        let error = error(text);
        assert_eq!(error.key, "derivatives.x", "{text}");
        let shown = error.to_string();
        assert!(shown.contains(message), "{text}: {shown}");
        assert!(shown.ends_with(&format!("^ column {column}")), "{text}: {shown}");
        let caret = shown.lines().last().and_then(|line| line.find('^'));
        assert_eq!(caret, Some(4 + column - 1), "{text}: {shown}");
    }
}

#[test]
fn the_excerpt_is_the_line_with_the_error() {
    let shown = error("x +\n  u*w +\n a").to_string();
    assert!(shown.ends_with("\n      u*w +\n        ^ column 5"), "{shown}");
}

#[test]
fn nesting_has_a_limit() {
    let nested = |depth: usize| format!("{}x{}", "(".repeat(depth), ")".repeat(depth));
    assert!((value(&nested(90)) - 5.0).abs() < f64::EPSILON);
    for text in [nested(100_000), "-".repeat(100_000), format!("{}x", "2^".repeat(100_000))] {
        assert_eq!(error(&text).problem, ExpressionProblem::TooDeep);
    }
}

fn problem(change: impl Fn(&mut Equations)) -> (String, ExpressionProblem) {
    let mut equations = equations("x*sum");
    change(&mut equations);
    match equations.compile() {
        Ok(_) => panic!("{equations:?} is valid"),
        Err(error) => (error.key, error.problem),
    }
}

#[test]
fn names_that_clash() {
    let duplicate = |name: &str, first: &str| ExpressionProblem::Duplicate {
        name: name.to_owned(),
        first: first.to_owned(),
    };
    let found = problem(|e| e.inputs.push(Variable::new("x", "")));
    assert_eq!(found, ("inputs[1]".to_owned(), duplicate("x", "states[0]")));
    let found = problem(|e| {
        _ = e.parameters.insert("u".to_owned(), 1.0);
    });
    assert_eq!(found, ("parameters.u".to_owned(), duplicate("u", "inputs[0]")));
    let found = problem(|e| drop(e.intermediates.insert("a".to_owned(), "1".to_owned())));
    assert_eq!(found, ("let.a".to_owned(), duplicate("a", "parameters.a")));
    for name in ["sin", "min", "pi", "t", "scenario"] {
        let (key, found) = problem(|e| {
            _ = e.parameters.insert(name.to_owned(), 1.0);
        });
        assert_eq!(key, format!("parameters.{name}"));
        assert!(matches!(found, ExpressionProblem::Reserved { .. }), "{name}: {found}");
    }
    for name in ["", "2a", "a-b", "x'", "höhe"] {
        let (_, found) = problem(|e| {
            _ = e.parameters.insert(name.to_owned(), 1.0);
        });
        assert_eq!(found, ExpressionProblem::Name(name.to_owned()));
    }
}

#[test]
fn states_and_derivatives_belong_together() {
    let found = problem(|e| e.states.push(Variable::new("v", "")));
    assert_eq!(found.0, "derivatives.v");
    assert_eq!(found.1, ExpressionProblem::MissingDerivative("v".to_owned()));
    let found = problem(|e| drop(e.derivatives.insert("v".to_owned(), "x".to_owned())));
    let known = vec!["x".to_owned()];
    assert_eq!(found.1, ExpressionProblem::UnknownState { found: "v".to_owned(), known });
    assert_eq!(problem(|e| e.states.clear()).1, ExpressionProblem::Empty);
    assert_eq!(problem(|e| e.inputs.clear()).1, ExpressionProblem::Empty);
}

#[test]
fn parameters_are_used_and_finite() {
    let found = problem(|e| {
        _ = e.parameters.insert("c".to_owned(), 1.0);
    });
    assert_eq!(found, ("parameters.c".to_owned(), ExpressionProblem::UnusedParameter));
    let found = problem(|e| {
        _ = e.parameters.insert("c".to_owned(), 1.0);
        e.compile_beside(&["2*b", "c[1] + x"]).unwrap();
        let error = e.compile_beside(&["2*cc"]).unwrap_err();
        assert_eq!(error.problem, ExpressionProblem::UnusedParameter);
    });
    assert_eq!(found.1, ExpressionProblem::UnusedParameter);
    let found = problem(|e| {
        _ = e.parameters.insert("a".to_owned(), f64::INFINITY);
    });
    assert_eq!(found.1, ExpressionProblem::NotFinite(f64::INFINITY));
}

#[test]
fn cycles_of_intermediates() {
    let insert = |e: &mut Equations, name: &str, text: &str| {
        e.intermediates.insert(name.to_owned(), text.to_owned());
    };
    let found = problem(|e| insert(e, "own", "2*own"));
    assert_eq!(found.1, ExpressionProblem::Cycle(vec!["own".to_owned(), "own".to_owned()]));
    let (key, found) = problem(|e| {
        insert(e, "p", "q + 1");
        insert(e, "q", "x*r");
        insert(e, "r", "q");
    });
    assert_eq!(key, "let.q");
    assert_eq!(found.to_string(), "defined by itself: q needs r needs q");
}

#[test]
fn too_many_values_at_once() {
    let mut equations = equations("0*x");
    // All are needed for the second factor when the first one has been computed.
    for i in 0..400 {
        equations.intermediates.insert(format!("p{i:03}"), format!("sin(x + {i})"));
    }
    let sum = |power: &str| {
        let terms: Vec<_> = (0..400).rev().map(|i| format!("p{i:03}{power}")).collect();
        terms.join(" + ")
    };
    let text = format!("({})*({})", sum(""), sum("^2"));
    equations.derivatives.insert("x".to_owned(), text);
    let found = equations.compile().expect_err("400 values at once").problem;
    let ExpressionProblem::TooLarge(needed) = found else { panic!("{found}") };
    assert!(needed > 256, "{found}");
    let said = found.to_string();
    assert!(said.contains(&format!("{needed} values at once, expected 256 at most")), "{said}");
    assert!(said.contains("Make arrays shorter, or write the plant in Rust"), "{said}");
}
