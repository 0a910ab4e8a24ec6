//! Arrays: an array plant is the one written out by hand, and what is said of one that is none.

use pinc_expr::{Equations, ExpressionError};
use pinc_ode::{Plant, Variable};
use proptest::prelude::*;
use std::collections::BTreeMap;

fn read(json: &str) -> Equations {
    serde_json::from_str(json).unwrap_or_else(|error| panic!("{error}: {json}"))
}

/// A rod with n nodes: heated at its first one, cooled by radiation everywhere.
fn rod(n: usize) -> Equations {
    let mut rod = read(
        r#"{"sizes": {"n": 20}, "states": [{"name": "T[n]", "unit": "K"}, "E"],
            "inputs": ["P"],
            "parameters": {"k": 50.0, "L": 0.2, "w": [0.5, 2, 0.25]},
            "let": {"dx": "L/n", "q[0]": "P", "q[i=1..n-1]": "k*(T[i] - T[i+1])/dx", "q[n]": "0"},
            "derivatives": {"T[i]": "(q[i-1] - q[i])/dx - 1e-8*T[i]^4 + i*w[1]*w[n/n]",
                            "E": "sum(i = 1..n, T[i]^2) - 2*sum(j=2..n-1, w[2]*T[j+1] - j)"},
            "outputs": {"top": "T[n]", "y[i=1..n]": "T[i] + w[3]", "mean": "sum(i=1..n, T[i])/n"}}"#,
    );
    rod.sizes.insert("n".to_owned(), n);
    rod
}

/// The rod written out by hand.
fn rod_by_hand(n: usize) -> Equations {
    let text = |text: String| text;
    let state = |i| Variable { name: format!("T{i}").into(), unit: "K".into() };
    let mut derivatives = BTreeMap::new();
    let mut intermediates: BTreeMap<String, String> =
        [("dx".to_owned(), format!("L/{n}")), ("q0".to_owned(), "P".to_owned())].into();
    for i in 1..=n {
        let flux = format!("k*(T{i} - T{})/dx", i + 1);
        intermediates.insert(format!("q{i}"), if i == n { "0".to_owned() } else { flux });
        let rate = format!("(q{} - q{i})/dx - 1e-8*T{i}^4 + {i}*w1*w1", i - 1);
        derivatives.insert(format!("T{i}"), rate);
    }
    let squares: Vec<_> = (1..=n).map(|i| text(format!("T{i}^2"))).collect();
    let others: Vec<_> = (2..n).map(|j| format!("(w2*T{} - {j})", j + 1)).collect();
    let others = if others.is_empty() { "0".to_owned() } else { others.join(" + ") };
    derivatives.insert("E".to_owned(), format!("({}) - 2*({others})", squares.join(" + ")));
    let mut outputs = BTreeMap::new();
    let mut output = |name: String, text: String| {
        let y = serde_json::from_value(serde_json::Value::String(text)).unwrap();
        outputs.insert(name, y)
    };
    let all: Vec<_> = (1..=n).map(|i| format!("T{i}")).collect();
    output("mean".to_owned(), format!("({})/{n}", all.join(" + ")));
    output("top".to_owned(), format!("T{n}"));
    (1..=n).for_each(|i| drop(output(format!("y{i:04}"), format!("T{i} + w3"))));
    let numbers = [("k", 50.0), ("L", 0.2), ("w1", 0.5), ("w2", 2.0), ("w3", 0.25)];
    Equations {
        states: (1..=n).map(state).chain([Variable::new("E", "")]).collect(),
        inputs: vec![Variable::new("P", "")],
        parameters: numbers.map(|(name, value)| (name.to_owned(), value)).into(),
        intermediates,
        derivatives,
        outputs,
        ..Equations::default()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// f, h and the Jacobian have the same bits.
    #[test]
    fn an_array_is_the_plant_written_out_by_hand(
        n in 3_usize..60,
        values in prop::collection::vec(-500.0..500.0, 61),
    ) {
        let (rod, hand) = (rod(n).compile().unwrap(), rod_by_hand(n).compile().unwrap());
        let (x, u) = (&values[..=n], &[values[60]][..]);
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let results = |plant: &pinc_expr::ExpressionPlant| {
            let (mut dx, mut y) = (vec![0.0; n + 1], vec![0.0; n + 2]);
            Plant::rhs(plant, x, u, &[], &mut dx);
            Plant::output(plant, x, u, &[], &mut y);
            let jacobian = plant.clone().into_dyn().jacobian(x, u, &[]);
            [bits(&dx), bits(&y), bits(&jacobian)]
        };
        prop_assert_eq!(results(&rod), results(&hand));
        let names: Vec<_> = Plant::states(&rod).iter().map(|v| v.name.to_string()).collect();
        let expected = (1..=n).map(|i| format!("T[{i}]")).chain(["E".to_owned()]);
        prop_assert_eq!(names, expected.collect::<Vec<_>>());
    }
}

#[test]
fn outputs_are_in_the_order_of_their_indices() {
    let plant = rod(12).compile().unwrap();
    let names: Vec<_> = Plant::outputs(&plant).iter().map(|v| v.name.to_string()).collect();
    let elements = (1..=12).map(|i| format!("y[{i}]"));
    let expected: Vec<_> = ["mean", "top"].map(str::to_owned).into_iter().chain(elements).collect();
    assert_eq!(names, expected);
    let [states, inputs, outputs] = rod(12).variables().unwrap();
    assert_eq!(states, Plant::states(&plant));
    assert_eq!((inputs, outputs), (vec![Variable::new("P", "")], Plant::outputs(&plant).to_vec()));
}

#[test]
fn a_range_may_be_empty() {
    // Two nodes have no inner one.
    let plant = rod(2).compile().unwrap();
    assert_eq!(Plant::states(&plant).len(), 3);
    // A range that ends one before its beginning is empty, and its sum 0.
    let mut empty = rod(3);
    empty.derivatives.insert("E".to_owned(), "7 + sum(i = 2..1, T[i])".to_owned());
    let mut dx = [f64::NAN; 4];
    Plant::rhs(&empty.compile().unwrap(), &[1.0; 4], &[0.0], &[], &mut dx);
    assert_eq!(dx[3].to_bits(), 7.0_f64.to_bits());
}

#[test]
fn elements_of_a_parameter_vary() {
    let plant = rod(3).compile_with(&["w[3]", "k"]).unwrap();
    let mut y = [0.0; 5];
    Plant::output(&plant, &[1.0, 2.0, 3.0, 0.0], &[0.0], &[7.0, 50.0], &mut y);
    assert_eq!(y.map(f64::to_bits), [2.0_f64, 3.0, 8.0, 9.0, 10.0].map(f64::to_bits));
}

#[test]
fn terms_and_instructions_match_the_elements() {
    let mut rod = rod(4);
    rod.derivatives.insert("T[i]".to_owned(), "w[1]/T[i] + 0*q[i]".to_owned());
    rod.outputs.clear();
    let terms = rod.critical_terms().unwrap();
    let keys: Vec<_> = terms.list().iter().map(|t| (t.key.as_str(), t.text.as_str())).collect();
    let expected = [1, 2, 3, 4].map(|i| (format!("derivatives.T[{i}]"), format!("T[{i}]")));
    assert_eq!(keys, expected.each_ref().map(|(k, t)| (k.as_str(), t.as_str())));
    assert_eq!(rod.listing(&[]).unwrap().results.len(), 5);
}

fn error(change: impl Fn(&mut Equations)) -> ExpressionError {
    let mut rod = rod(5);
    change(&mut rod);
    match rod.compile() {
        Ok(_) => panic!("{rod:?} is valid"),
        Err(error) => error,
    }
}

/// What is said of another expression for `T[i]`.
fn said_of(text: &str) -> String {
    error(|rod| drop(rod.derivatives.insert("T[i]".to_owned(), text.to_owned()))).to_string()
}

#[test]
fn errors_name_the_index_and_the_place() {
    for (text, column, message) in [
        ("q[i] + T[i+1]", 8, "`T[6]` does not exist, expected an index from 1 to 5 (at i = 5)"),
        ("T[i-1]", 1, "`T[0]` does not exist, expected an index from 1 to 5 (at i = 1)"),
        ("q[i-2]", 3, "`-1` is no index, expected a whole number from 0 to 10000 (at i = 1)"),
        ("T[n + 1] + P", 1, "`T[6]` does not exist, expected an index from 1 to 5 (at i = 1)"),
        ("k*T", 3, "`T` is an array, expected one of its elements, as T[1] (at i = 1)"),
        ("k[1]*T[i]", 1, "`k` is not an array (at i = 1)"),
        ("T[j]", 3, "unknown index `j`; expected a whole number or one of i, n (at i = 1)"),
        ("T[k]", 3, "unknown index `k`; expected a whole number or one of i, n (at i = 1)"),
        ("T[i/2]", 3, "`i/2` is no index, expected a whole number from 0 to 10000 (at i = 1)"),
        ("T[i", 4, "the text ends here, expected `]`"),
        ("T[]", 3, "`]`, expected a whole number, an index or a size"),
        (
            "T[i]*U",
            6,
            "unknown name `U`; expected one of E, L, P, T[1..5], dx, k, pi, q[0..5], w[2..3]",
        ),
        ("T[i]*U[2]", 6, "unknown name `U`"),
        ("T[i] + + ", 10, "the expression ends here, expected a number"),
        ("2*(T[i] + k", 12, "the expression ends here, expected an operator or `)` (at i = 1)"),
        ("T[i] % 2", 6, "unexpected character `%` (at i = 1)"),
        ("sum(T[i])", 5, "`T`, expected an index with a range"),
        ("sum(i = 1..n, T[i])", 5, "the index `i` has the name of something else"),
        ("sum(k = 1..n, T[k])", 5, "the index `k` has the name of something else"),
        ("sum(n = 1..3, T[n])", 5, "the index `n` has the name of something else"),
        ("sum(j = 1, T[j])", 10, "`,`, expected `..` and the last value of the index"),
        ("sum(j = 1..n T[j])", 14, "`T`, expected `,` and what is to be added up"),
        ("sum(j = 1..n, T[j]", 19, "the text ends here, expected `)`"),
        ("sum(j = n..1, T[j])", 9, "the range 5..1 runs backwards, expected one like 1..n"),
        ("sum(j = 3..1, T[j])", 9, "the range 3..1 runs backwards, expected one like 1..n"),
        (
            "sum(j = 1..n, T[j+1])",
            15,
            "`T[6]` does not exist, expected an index from 1 to 5 (at i = 1, j = 5)",
        ),
        ("sum(j = 1..n, T[j]*u)", 20, "unknown name `u`"),
    ] {
        let shown = said_of(text);
        assert!(shown.starts_with("`derivatives.T[i]`: "), "{shown}");
        assert!(shown.contains(message), "{text}: {shown}");
        assert!(shown.ends_with(&format!("^ column {column}")), "{text}: {shown}");
        assert!(shown.contains(text.trim_end()), "{text}: {shown}");
    }
}

#[test]
fn every_element_has_one_equation() {
    let key = |key: &'static str| {
        move |rod: &mut Equations| {
            rod.derivatives.remove("T[i]");
            rod.derivatives.insert(key.to_owned(), "1".to_owned());
        }
    };
    for (name, shown) in [
        (
            "T[i=1..n-1]",
            "`derivatives.T[5]`: missing; expected the time derivative of the state `T[5]`",
        ),
        (
            "T[i=1..n+1]",
            "`derivatives.T[i=1..n+1]`: `T[6]` does not exist, expected an index from 1 to 5",
        ),
        ("T[0]", "`derivatives.T[0]`: `T[0]` does not exist, expected an index from 1 to 5"),
        (
            "T[i=1..m]",
            "`derivatives.T[i=1..m]`: unknown index `m`; expected a whole number or one of n",
        ),
        ("T", "`derivatives.T`: `T` is an array, expected one of its elements, as T[1]"),
        ("U[i=1..n]", "`derivatives.U[i=1..n]`: `U[1]` is not a state; expected one of E, T[1..5]"),
        ("T[i=1..n", "`]` and the end"),
        ("T[n=1..3]", "the index `n` has the name of something else"),
        ("T[sin=1..n]", "the index `sin` has the name of something else"),
        ("T[i=1..99999]", "`99999` is no index"),
    ] {
        let found = error(key(name)).to_string();
        assert!(found.contains(shown), "{name}: {found}");
    }
    let twice = error(|rod| {
        rod.derivatives.insert("T[3]".to_owned(), "0".to_owned());
    });
    let said = "`derivatives.T[i]`: the name `T[3]` is taken by `derivatives.T[3]`";
    assert_eq!(twice.to_string(), said);
    let unsaid = error(|rod| drop(rod.intermediates.insert("r[i]".to_owned(), "T[i]".to_owned())));
    let expected = "`let.r[i]`: no range of elements given; expected one, as r[i=1..n]";
    assert!(unsaid.to_string().starts_with(expected), "{unsaid}");
}

#[test]
fn sizes_and_names_are_checked() {
    let state = |name: &'static str| move |rod: &mut Equations| rod.states[0].name = name.into();
    for (name, shown) in [
        ("T[0]", "`states[0]`: a size of 0, expected 1 to 10000"),
        ("T[n-n]", "`states[0]`: a size of 0, expected 1 to 10000"),
        ("T[m]", "`states[0]`: unknown index `m`; expected a whole number or one of n"),
        ("T[n", "`states[0]`: the text ends here, expected `]` and the end"),
        ("T[1]x", "`states[0]`: `x`, expected `]` and the end"),
        ("2T[n]", "`states[0]`: `2T` is not a name"),
        ("sin[n]", "`states[0]`: the name `sin` is taken: a function"),
        ("k[n]", "`parameters.k`: the name `k` is taken by `states[0]`"),
        ("E[n]", "`states[1]`: the name `E` is taken by `states[0]`"),
        ("n", "`sizes.n`: the name `n` is taken by `states[0]`"),
    ] {
        let found = error(state(name)).to_string();
        assert!(found.starts_with(shown), "{name}: {found}");
    }
    let none = error(|rod| rod.sizes = [("n".to_owned(), 0)].into());
    assert_eq!(none.to_string(), "`sizes.n`: a size of 0, expected 1 to 10000");
    let unused = error(|rod| rod.parameters.extend([("v[1]".to_owned(), 1.0)]));
    assert_eq!(
        unused.to_string(),
        "`parameters.v[1]`: no expression uses this parameter; remove it"
    );
    let cycle =
        error(|rod| drop(rod.intermediates.insert("q[0]".to_owned(), "q[1]*0 + r[2]".to_owned())));
    assert!(cycle.to_string().starts_with("`let.q[0]`: unknown name `r`"), "{cycle}");
    let cycle = error(|rod| drop(rod.intermediates.insert("q[0]".to_owned(), "q[0]".to_owned())));
    assert!(cycle.to_string().contains("defined by itself: q[0] needs q[0]"), "{cycle}");
}

#[test]
fn too_much_text_is_refused() {
    let long = "sum(a = 1..9999, sum(b = 1..9999, P))";
    assert!(said_of(long).contains("written out, the equations have more than 4000000 characters"));
    let empty = "sum(a = 1..9999, sum(b = 1..9999, ))";
    assert!(said_of(empty).contains("written out"), "{}", said_of(empty));
    let deep: String = (0..200).map(|k| format!("sum(a{k} = 1..1, ")).collect();
    let deep = format!("{deep}P{}", ")".repeat(200));
    assert!(said_of(&deep).contains("nested more than 100 deep"));
    let many = error(|rod| {
        for k in 0..20 {
            rod.intermediates.insert(format!("z{k}[i=1..9999]"), "P".to_owned());
        }
    });
    assert!(many.to_string().contains("the arrays have more than 100000 elements"), "{many}");
}

#[test]
fn a_name_with_an_index_is_unknown_to_a_plant_without_arrays() {
    let equations = read(r#"{"states": ["x"], "inputs": ["u"], "derivatives": {"x": "u*x[1]"}}"#);
    let shown = equations.compile().unwrap_err().to_string();
    assert!(shown.starts_with("`derivatives.x`: `x` is not an array"), "{shown}");
}

/// A chain of which all elements are computed before the first equation: they are not all kept.
#[test]
fn what_an_equation_needs_is_computed_when_it_is_needed() {
    let mut chain = read(
        r#"{"sizes": {"n": 90}, "states": ["T[n]"], "inputs": ["u"],
            "let": {"k[i=1..n]": "exp(-T[i])", "p[0]": "u", "p[i=1..n]": "p[i-1]/(1 + k[i])",
                    "r[i=1..n]": "k[i]*p[i]"},
            "derivatives": {"T[i]": "r[i] - T[i]"}}"#,
    );
    let mut rates = |n: usize| {
        chain.sizes.insert("n".to_owned(), n);
        let mut dx = vec![0.0; n];
        Plant::rhs(&chain.compile().unwrap(), &vec![0.25; n], &[2.0], &[], &mut dx);
        dx
    };
    let (few, many) = (rates(5), rates(200));
    assert_eq!(few[..], many[..5]);
    let (k, mut p) = ((-0.25_f64).exp(), 2.0);
    for rate in many {
        p /= 1.0 + k;
        assert!((rate - (k * p - 0.25)).abs() < 1e-15);
    }
}

#[test]
fn algebraic_variables_may_be_arrays() {
    let array = read(
        r#"{"sizes": {"n": 3}, "states": ["h[n]"], "inputs": ["u"], "parameters": {"r": 0.5},
            "algebraic": {"q[i=1..n]": {"equation": "q[i]^2*r - h[i]/i", "start": "sqrt(h[i]) + i",
                                       "low": 0.0, "high": 50.0}},
            "derivatives": {"h[1]": "u - q[1]", "h[i=2..n]": "q[i-1] - q[i]"}}"#,
    );
    let by_hand = read(
        r#"{"states": ["h1", "h2", "h3"], "inputs": ["u"], "parameters": {"r": 0.5},
            "algebraic": {
                "q1": {"equation": "q1^2*r - h1/1", "start": "sqrt(h1) + 1", "low": 0.0, "high": 50.0},
                "q2": {"equation": "q2^2*r - h2/2", "start": "sqrt(h2) + 2", "low": 0.0, "high": 50.0},
                "q3": {"equation": "q3^2*r - h3/3", "start": "sqrt(h3) + 3", "low": 0.0, "high": 50.0}},
            "derivatives": {"h1": "u - q1", "h2": "q1 - q2", "h3": "q2 - q3"}}"#,
    );
    let [array, by_hand] = [array, by_hand].map(|equations| equations.compile().unwrap());
    let names: Vec<_> = Plant::outputs(&array).iter().map(|y| y.name.as_ref()).collect();
    assert_eq!(names, ["q[1]", "q[2]", "q[3]"]);
    let rates = |plant: &pinc_expr::ExpressionPlant| {
        let mut rates = [0.0; 3];
        Plant::rhs(plant, &[2.0, 3.5, 0.7], &[0.4], &[], &mut rates);
        rates.map(f64::to_bits)
    };
    assert_eq!(rates(&array), rates(&by_hand));
}
