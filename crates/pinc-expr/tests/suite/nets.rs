//! Nets inside the equations.

use pinc_expr::{Equations, ExpressionProblem, NetExpression, PlantEquations};
use pinc_ode::{Plant, Variable};

fn texts<const N: usize>(of: [&str; N]) -> Vec<String> {
    of.map(str::to_owned).to_vec()
}

/// x' = v, v' = u - drag(v, u), with a net of two layers.
fn hybrid() -> Equations {
    let drag = NetExpression {
        inputs: texts(["v/2", "u*scale"]),
        outputs: texts(["force", "other"]),
        layers: vec![3, 2],
        weights: None,
    };
    Equations {
        states: vec![Variable::new("x", "m"), Variable::new("v", "m/s")],
        inputs: vec![Variable::new("u", "N")],
        parameters: [("scale".to_owned(), 0.25)].into(),
        derivatives: [
            ("x".to_owned(), "v + other".to_owned()),
            ("v".to_owned(), "u - force".to_owned()),
        ]
        .into(),
        nets: [("drag".to_owned(), drag)].into(),
        ..Equations::default()
    }
}

/// Weights that differ, with which no neuron is saturated.
fn weights(count: u32) -> Vec<f64> {
    (1..=count).map(|k| (1.7 * f64::from(k)).sin()).collect()
}

/// The net's outputs, by its formulas.
fn reference(w: &[f64], inputs: [f64; 2]) -> [f64; 2] {
    let layer = |w: &[f64], x: &[f64]| -> Vec<f64> {
        let neuron = |w: &[f64]| w[0] + w[1..].iter().zip(x).map(|(w, x)| w * x).sum::<f64>();
        w.chunks(x.len() + 1).map(neuron).collect()
    };
    let tanh = |z: Vec<f64>| -> Vec<f64> { z.into_iter().map(f64::tanh).collect() };
    let first = tanh(layer(&w[..9], &inputs));
    let second = tanh(layer(&w[9..17], &first));
    let last = layer(&w[17..], &second);
    [last[0], last[1]]
}

fn rhs(plant: &impl Plant, p: &[f64]) -> [f64; 2] {
    let mut dx = [0.0; 2];
    plant.rhs(&[0.3, 0.8], &[1.5], p, &mut dx);
    dx
}

#[test]
fn a_net_is_its_formulas_with_its_weights_as_parameters() {
    let mut equations = hybrid();
    assert_eq!(equations.nets["drag"].weight_count(), 23);
    let w = weights(23);
    let names = equations.net_weights("drag");
    equations.parameters.extend(names.iter().cloned().zip(w.iter().copied()));
    let [force, other] = reference(&w, [0.4, 0.375]);
    let expected = [0.8 + other, 1.5 - force];
    let close = |found: [f64; 2], expected: [f64; 2]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-13), "{found:?}");
    };
    close(rhs(&equations.compile().unwrap(), &[]), expected);
    // Weights that vary are the p of a family, also of equations that changed elsewhere.
    let varying: Vec<&str> = names.iter().map(String::as_str).collect();
    let other_w: Vec<f64> = w.iter().map(|w| 0.5 * w).collect();
    let [force, other] = reference(&other_w, [0.4, 0.375]);
    let family = PlantEquations::from(equations.clone()).compile_with(&varying).unwrap();
    close(rhs(&family, &other_w), [0.8 + other, 1.5 - force]);
}

#[test]
fn a_net_without_weights_gives_0_and_its_neurons_differ() {
    let mut equations = hybrid();
    assert_eq!(
        rhs(&equations.compile().unwrap(), &[]).map(f64::to_bits),
        [0.8, 1.5].map(f64::to_bits)
    );
    equations.add_net_weights();
    assert_eq!(equations.parameters.len(), 24);
    let hidden: Vec<u64> =
        (1..=9).map(|i| equations.parameters[&format!("drag[{i}]")].to_bits()).collect();
    assert!((1..9).all(|i| !hidden[..i].contains(&hidden[i])));
    assert!((18..=23).all(|i| equations.parameters[&format!("drag[{i}]")] == 0.0));
    let all = equations.clone();
    equations.add_net_weights();
    assert_eq!(equations, all);
}

#[test]
fn faults_of_a_net_are_reported_for_the_net() {
    let said = |change: &dyn Fn(&mut Equations)| {
        let mut equations = hybrid();
        change(&mut equations);
        let error = equations.compile().unwrap_err();
        (error.key, error.problem)
    };
    let (key, problem) =
        said(&|of| of.nets.get_mut("drag").unwrap().inputs[1] = "u*scal".to_owned());
    assert_eq!(key, "nets.drag.inputs[1]");
    assert!(matches!(problem, ExpressionProblem::UnknownName { .. }), "{problem:?}");
    let (key, problem) = said(&|of| of.nets.get_mut("drag").unwrap().outputs[1] = "x".to_owned());
    assert_eq!(key, "nets.drag.outputs[1]", "{problem:?}");
    let (key, problem) =
        said(&|of| of.nets.get_mut("drag").unwrap().outputs.push("none".to_owned()));
    assert_eq!((key.as_str(), problem), ("nets.drag.outputs[2]", ExpressionProblem::UnusedOutput));
    let (key, problem) = said(&|of| of.nets.get_mut("drag").unwrap().layers = vec![]);
    assert_eq!((key.as_str(), problem), ("nets.drag.layers", ExpressionProblem::Empty));
    let (key, problem) = said(&|of| of.nets.get_mut("drag").unwrap().layers[1] = 0);
    assert_eq!((key.as_str(), problem), ("nets.drag.layers[1]", ExpressionProblem::Size(0)));
    let (key, problem) = said(&|of| {
        of.parameters.insert("drag[1]".to_owned(), 1.0);
    });
    let few = ExpressionProblem::Weights { found: 1, expected: 23 };
    assert_eq!((key.as_str(), problem), ("parameters.drag", few));
}
