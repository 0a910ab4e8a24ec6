//! Outputs that depend on the input: each row is read under the input that led there.

use crate::support::{steps, texts};
use pinc_expr::{Equations, OutputExpression};
use pinc_identify::{
    Channel, Criterion, FitStatus, Identified, InitialState, Measured, Method, Problem, Recording,
    Unknown, identify, simulate_held_out,
};
use pinc_ode::{DynPlant, Integrator, Model, Variable};

/// x' = a (v - x) with the outputs b v + x + 0.1 w and 2 x.
fn lag() -> Box<dyn DynPlant> {
    let output = |text: &str| OutputExpression { expression: text.to_owned(), unit: String::new() };
    let equations = Equations {
        states: vec![Variable::new("x", "")],
        inputs: vec![Variable::new("v", ""), Variable::new("w", "")],
        parameters: [("a".to_owned(), 1.0), ("b".to_owned(), 1.0)].into(),
        derivatives: texts(&[("x", "a*(v - x)")]).into_iter().collect(),
        outputs: [
            ("direct".to_owned(), output("b*v + x + 0.1*w")),
            ("double".to_owned(), output("2*x")),
        ]
        .into(),
        ..Equations::default()
    };
    equations.compile_with(&["a", "b"]).unwrap().into_dyn()
}

const ROWS: usize = 150;

/// Rows of both outputs, the first under its own input and each later one under that before it,
/// of which those in `missing` have none.
fn recorded(model: &mut dyn Model, u: &[f64], missing: &[usize]) -> Vec<f64> {
    let (mut x, mut y) = (vec![0.7], Vec::new());
    for k in 0..ROWS {
        let read = &u[2 * k.saturating_sub(1)..][..2];
        let rows = [0.5 * read[0] + x[0] + 0.1 * read[1], 2.0 * x[0]];
        y.extend(rows.map(|y| if missing.contains(&k) { f64::NAN } else { y }));
        let mut next = [0.0];
        model.step(&x, &u[2 * k..2 * k + 2], &[0.4, 0.5], &mut next);
        x = next.to_vec();
    }
    y
}

fn problem(a: f64, channels: &[usize]) -> Problem {
    let unknown = |name: &str, place, initial| Unknown {
        name: name.to_owned(),
        place,
        initial,
        low: 0.0,
        high: 5.0,
        prior: None,
    };
    let channel = |&output: &usize| Channel {
        name: ["direct", "double"][output].to_owned(),
        measured: Measured::Output(output),
        sd: Some(0.01),
        is_estimated: false,
    };
    Problem {
        channels: channels.iter().map(channel).collect(),
        parameters: vec![0.0; 2],
        unknown: vec![unknown("a", 0, a), unknown("b", 1, 1.5)],
        initial_state: InitialState::Free(vec![0.0]),
        states: vec!["x".to_owned()],
        inputs: vec!["v".to_owned(), "w".to_owned()],
        criterion: Criterion::Chosen,
    }
}

#[track_caller]
fn assert_exact(found: &Identified, y: &[f64]) {
    let estimates: Vec<f64> = found.estimates().map(|estimate| estimate.value).collect();
    for (found, truth) in estimates.iter().zip([0.4, 0.5, 0.7]) {
        assert!((found - truth).abs() < 1e-9, "{estimates:?}");
    }
    assert!(found.cost < 1e-12, "{}", found.cost);
    for (k, (fitted, y)) in found.fitted[0].iter().zip(y).enumerate() {
        assert!(y.is_nan() || (fitted - y).abs() < 1e-9, "{k}: {fitted} {y}");
    }
}

/// The inputs change in most rows, and the rows are more than are linearized at a time.
#[test]
fn a_row_is_read_under_the_input_that_led_there() {
    let plant = lag();
    let mut model = plant.model(Integrator::Rk4, 0.5, 2).unwrap();
    let (v, w) = (steps(3, ROWS, 1, (-2.0, 2.0)), steps(4, ROWS, 2, (-1.0, 1.0)));
    let u: Vec<f64> = v.iter().zip(&w).flat_map(|(v, w)| [*v, *w]).collect();
    for missing in [&[][..], &[0, 64, 65, 127]] {
        let y = recorded(&mut *model, &u, missing);
        let recording = [Recording { name: "lag", before: None, u: &u, y: &y }];
        let found = identify(&mut *model, &problem(2.0, &[0, 1]), &recording).unwrap();
        assert!(matches!(found.method, Method::SingleShooting { .. }), "{:?}", found.method);
        assert_eq!(found.status, FitStatus::Converged);
        assert_exact(&found, &y);
    }
}

/// The first row is read under an input that no row has: with it known the fit is exact, in one
/// piece and in segments, and so is the prediction of rows that are held out.
#[test]
fn the_first_row_is_read_under_the_input_before_it() {
    let plant = lag();
    let mut model = plant.model(Integrator::Rk4, 0.5, 2).unwrap();
    let (v, w) = (steps(3, ROWS, 1, (-2.0, 2.0)), steps(4, ROWS, 2, (-1.0, 1.0)));
    let u: Vec<f64> = v.iter().zip(&w).flat_map(|(v, w)| [*v, *w]).collect();
    let mut y = recorded(&mut *model, &u, &[]);
    let before = [u[0] + 1.5, u[1] - 0.5];
    y[0] += 0.5 * 1.5 - 0.1 * 0.5;
    let known = Recording { name: "lag", before: Some(&before), u: &u, y: &y };
    for criterion in [Criterion::Chosen, Criterion::MultipleShooting] {
        let problem = Problem { criterion, ..problem(2.0, &[0, 1]) };
        assert_exact(&identify(&mut *model, &problem, &[known]).unwrap(), &y);
    }
    let unknown = Recording { before: None, ..known };
    let found = identify(&mut *model, &problem(2.0, &[0, 1]), &[unknown]).unwrap();
    assert!(found.cost > 1.0, "{}", found.cost);
    let found = simulate_held_out(&mut *model, &problem(2.0, &[0, 1]), &[0.4, 0.5], known, 5);
    for (k, (found, y)) in found.unwrap().iter().zip(&y).enumerate() {
        assert!((found - y).abs() < 1e-9, "{k}: {found} {y}");
    }
    let short = Recording { before: Some(&before[..1]), ..known };
    let refused = identify(&mut *model, &problem(2.0, &[0, 1]), &[short]).unwrap_err();
    assert!(refused.to_string().contains("before"), "{refused}");
}

/// What is measured is the state, once as such and once as an output: the fits have the same bits
/// where the output has no input in it, whatever the input.
#[test]
fn outputs_without_the_input_are_read_as_states_are() {
    let plant = lag();
    let mut model = plant.model(Integrator::Rk4, 0.5, 2).unwrap();
    let u = steps(3, 2 * ROWS, 1, (-2.0, 2.0));
    let y: Vec<f64> = recorded(&mut *model, &u, &[]).chunks(2).map(|y| y[1] + 0.01).collect();
    let fit = |model: &mut dyn Model, measured, scale: f64| {
        let mut problem = problem(2.0, &[1]);
        problem.channels[0].measured = measured;
        problem.channels[0].sd = Some(0.01 * scale);
        // Nothing that is measured depends on b.
        problem.unknown.pop();
        let y: Vec<f64> = y.iter().map(|y| y * scale).collect();
        let found =
            identify(model, &problem, &[Recording { name: "lag", before: None, u: &u, y: &y }])
                .unwrap();
        found.estimates().map(|estimate| estimate.value).collect::<Vec<_>>()
    };
    let (by_output, by_state) =
        (fit(&mut *model, Measured::Output(1), 1.0), fit(&mut *model, Measured::State(0), 0.5));
    for (output, state) in by_output.iter().zip(&by_state) {
        assert_eq!(output.to_bits(), state.to_bits(), "{by_output:?} {by_state:?}");
    }
}
