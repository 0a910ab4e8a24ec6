//! Outputs and varying parameters of text plants.

use pinc_expr::{Equations, ExpressionPlant, ExpressionProblem, OutputExpression};
use pinc_ode::{Plant, Variable};

/// A reaction of second order; the total pressure and the rate are measured.
fn reaction() -> Equations {
    let text = |name: &str, text: &str| (name.to_owned(), text.to_owned());
    let output = |name: &str, expression: &str, unit: &str| {
        let (expression, unit) = (expression.to_owned(), unit.to_owned());
        (name.to_owned(), OutputExpression { expression, unit })
    };
    Equations {
        states: vec![Variable::new("pA", "kPa"), Variable::new("pB", "kPa")],
        inputs: vec![Variable::new("feed", "kPa/s")],
        parameters: [("k".to_owned(), 0.5), ("order".to_owned(), 2.0)].into(),
        intermediates: [text("r", "k*pA^order")].into(),
        derivatives: [text("pA", "feed - r"), text("pB", "r")].into(),
        outputs: [output("total", "pA + pB", "kPa"), output("speed", "r + 0*feed", "")].into(),
        ..Equations::default()
    }
}

fn rhs(plant: &ExpressionPlant, p: &[f64]) -> Vec<f64> {
    let mut dx = vec![f64::NAN; 2];
    plant.rhs(&[3.0, 1.0], &[0.25], p, &mut dx);
    dx
}

fn output(plant: &ExpressionPlant, p: &[f64]) -> Vec<f64> {
    let mut y = vec![f64::NAN; plant.dims().ny];
    plant.output(&[3.0, 1.0], &[0.25], p, &mut y);
    y
}

#[test]
fn outputs_are_expressions_in_alphabetical_order() {
    let plant = reaction().compile().unwrap();
    assert_eq!(plant.outputs(), [Variable::new("speed", ""), Variable::new("total", "kPa")]);
    assert_eq!((plant.dims().ny, plant.dims().np), (2, 0));
    assert_eq!(output(&plant, &[]), [4.5, 4.0]);
    assert_eq!(rhs(&plant, &[]), [-4.25, 4.5]);
}

#[test]
fn outputs_are_the_states_by_default() {
    let equations = Equations { outputs: Default::default(), ..reaction() };
    let plant = equations.compile().unwrap();
    assert_eq!(plant.outputs(), plant.states());
    assert_eq!(output(&plant, &[]), [3.0, 1.0]);
}

/// A parameter that varies is what it would be as a constant, in the order asked for.
#[test]
fn parameters_that_vary() {
    let mut equations = reaction();
    let plant = equations.compile_with(&["order", "k"]).unwrap();
    assert_eq!(plant.parameters(), [Variable::new("order", ""), Variable::new("k", "")]);
    for (order, k) in [(2.0, 0.5), (1.5, 0.25)] {
        equations.parameters.insert("order".to_owned(), order);
        equations.parameters.insert("k".to_owned(), k);
        let fixed = equations.compile().unwrap();
        // A power is multiplications, a root or e^(b log a): some roundings apart.
        let found = [&rhs(&plant, &[order, k])[..], &output(&plant, &[order, k])].concat();
        let expected = [&rhs(&fixed, &[])[..], &output(&fixed, &[])].concat();
        for (a, b) in found.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-14, "{found:?} {expected:?}");
        }
    }
    let one = reaction().compile_with(&["k"]).unwrap();
    assert_eq!(rhs(&one, &[1.0]), [-8.75, 9.0]);
    assert_eq!(output(&one, &[1.0]), [9.0, 4.0]);
}

#[test]
fn parameters_that_cannot_vary() {
    let error = reaction().compile_with(&["k", "K"]).unwrap_err();
    assert_eq!(error.key, "varying[1]");
    assert_eq!(error.to_string(), "`varying[1]`: `K` is not a parameter; expected one of k, order");
    assert_eq!(error.problem.misspelt().unwrap().0, "K");
    let error = reaction().compile_with(&["k", "order", "k"]).unwrap_err();
    assert_eq!(error.to_string(), "`varying[2]`: the name `k` is taken by `varying[0]`");
}

#[test]
fn outputs_that_are_wrong() {
    let with = |name: &str, expression: &str| {
        let (expression, unit) = (expression.to_owned(), String::new());
        let mut equations = reaction();
        equations.outputs.insert(name.to_owned(), OutputExpression { expression, unit });
        equations.compile().unwrap_err()
    };
    let names = [("pA", "states[0]"), ("feed", "inputs[0]"), ("k", "parameters.k"), ("r", "let.r")];
    for (name, first) in names {
        let error = with(name, "pA");
        assert_eq!(error.key, format!("outputs.{name}"));
        let (name, first) = (name.to_owned(), first.to_owned());
        assert_eq!(error.problem, ExpressionProblem::Duplicate { name, first });
    }
    assert!(matches!(with("pi", "pA").problem, ExpressionProblem::Reserved { .. }));
    assert!(matches!(with("2y", "pA").problem, ExpressionProblem::Name(_)));
    // Outputs are not made of one another.
    let error = with("twice", "2*total");
    assert_eq!(error.key, "outputs.twice");
    assert!(matches!(error.problem, ExpressionProblem::UnknownName { .. }), "{error}");
}

/// A parameter that only an output has is used.
#[test]
fn outputs_use_parameters() {
    let mut equations = reaction();
    equations.parameters.insert("gain".to_owned(), 10.0);
    assert_eq!(equations.compile().unwrap_err().key, "parameters.gain");
    let output = OutputExpression { expression: "gain*pA".to_owned(), unit: "V".to_owned() };
    equations.outputs.insert("signal".to_owned(), output);
    assert_eq!(output_of(&equations, "signal"), 30.0_f64.to_bits());
}

fn output_of(equations: &Equations, name: &str) -> u64 {
    let plant = equations.compile().unwrap();
    let index = plant.outputs().iter().position(|output| output.name == name).unwrap();
    output(&plant, &[])[index].to_bits()
}

/// In files an output is an expression, or a table with its unit.
#[test]
fn outputs_in_files() {
    let text = r#"
        states = [{ name = "pA", unit = "kPa" }, { name = "pB", unit = "kPa" }]
        inputs = [{ name = "feed", unit = "kPa/s" }]
        parameters = { k = 0.5, order = 2.0 }
        let = { r = "k*pA^order" }
        derivatives = { pA = "feed - r", pB = "r" }
        [outputs]
        total = { expression = "pA + pB", unit = "kPa" }
        speed = "r + 0*feed"
    "#;
    let equations: Equations = toml::from_str(text).unwrap();
    assert_eq!(equations, reaction());
    let written = toml::to_string(&equations).unwrap();
    assert_eq!(toml::from_str::<Equations>(&written).unwrap(), equations);
    let wrong = text.replace("unit = \"kPa\" }\n        speed", "units = \"kPa\" }\n        speed");
    let error = toml::from_str::<Equations>(&wrong).unwrap_err();
    assert!(error.message().contains("an expression, or a table"), "{error}");
}
