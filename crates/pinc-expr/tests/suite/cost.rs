//! Costs beside the equations of a plant.

use pinc_expr::{CostExpressions, Equations, OutputExpression, PlantEquations, TimeUnit};
use pinc_ode::{Plant, Variable};
use std::collections::BTreeMap;

fn vessels() -> PlantEquations {
    vessels_in(TimeUnit::S)
}

/// A row of vessels, with the mass in all of them as an output, and rates per `unit`.
fn vessels_in(unit: TimeUnit) -> PlantEquations {
    let text = |name: &str, text: &str| (name.to_owned(), text.to_owned());
    let expression = "sum(i=1..2, c[i])*V".to_owned();
    Equations {
        time_unit: Some(unit),
        sizes: [("n".to_owned(), 2)].into(),
        states: vec![Variable::new("c[n]", "g/L"), Variable::new("V", "L")],
        inputs: vec![Variable::new("F", "L/h")],
        parameters: [("k".to_owned(), 0.5)].into(),
        intermediates: [text("r", "k*c[1]")].into(),
        derivatives: [text("c[1]", "F - r"), text("c[2]", "r"), text("V", "F")].into(),
        outputs: [("mass".to_owned(), OutputExpression { expression, unit: "g".to_owned() })]
            .into(),
        ..Equations::default()
    }
    .into()
}

fn cost<'a>(
    stage: &'a str,
    terminal: &'a str,
    parameters: &'a BTreeMap<String, f64>,
) -> CostExpressions<'a> {
    CostExpressions { stage, terminal, parameters }
}

#[test]
fn a_cost_has_all_that_the_plant_has() {
    let prices = [("price".to_owned(), 3.0)].into();
    let costs = cost("price*F*t - mass + r + k", "-sum(i=1..2, c[i]^2)", &prices);
    for varying in [&["k"][..], &[]] {
        let plant = vessels().compile_with_cost(varying, costs).unwrap();
        let names: Vec<_> = plant.states().iter().map(|state| state.name.to_string()).collect();
        assert_eq!(names, ["c[1]", "c[2]", "V", "t", "cost"]);
        let p = if varying.is_empty() { &[][..] } else { &[0.5] };
        let (x, u) = ([0.4, 0.3, 10.0, 2.0, 7.0], [1.5]);
        let (mut dx, mut y) = ([0.0; 5], [0.0; 3]);
        plant.rhs(&x, &u, p, &mut dx);
        plant.output(&x, &u, p, &mut y);
        // 3 * 1.5 * 2 - 0.7 * 10 + 0.2 + 0.5
        let expected = [1.3, 0.2, 1.5, 1.0, 2.7];
        for (found, expected) in dx.iter().chain(&y).zip(expected.iter().chain(&[7.0, 2.7, -0.25]))
        {
            assert!((found - expected).abs() < 1e-14, "{dx:?} {y:?}");
        }
    }
}

/// The time of the cost stays in seconds.
#[test]
fn a_cost_per_hour_is_integrated_as_the_rates_are() {
    let none = BTreeMap::new();
    let costs = cost("2*F", "V", &none);
    let plant = vessels_in(TimeUnit::H).compile_with_cost(&[], costs).unwrap();
    let mut dx = [0.0; 5];
    plant.rhs(&[0.4, 0.3, 10.0, 2.0, 7.0], &[1.8], &[], &mut dx);
    for (found, expected) in dx[2..].iter().zip([1.8 / 3600.0, 1.0, 3.6 / 3600.0]) {
        assert!((found - expected).abs() < 1e-14, "{dx:?}");
    }
}

#[test]
fn what_is_wrong_is_named_with_its_expression() {
    let none = BTreeMap::new();
    for (costs, key) in [
        (cost("c[1] +", "0", &none), "stage"),
        (cost("0", "mas", &none), "terminal"),
        (cost("c[3]", "0", &none), "stage"),
        (cost("price*F", "0", &none), "stage"),
    ] {
        let error = vessels().compile_with_cost(&[], costs).unwrap_err();
        assert_eq!(error.key, key, "{error}");
        assert!(error.text.is_some(), "{error}");
    }
}
