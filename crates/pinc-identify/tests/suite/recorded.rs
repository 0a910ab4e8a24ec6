//! The four tanks, from recorded data, against `scipy.optimize.least_squares`.

use crate::support::{problem, tanks};
use pinc_identify::{FitStatus, Identified, InitialState, Measured, Method, Recording, identify};
use pinc_ode::Integrator;

const NEAR: [f64; 8] = [3.33, 3.35, 0.6, 0.5, 0.071, 0.057, 0.071, 0.057];
const FAR: [f64; 8] = [5.0, 2.0, 0.3, 0.7, 0.1, 0.1, 0.1, 0.1];
const STATE: [f64; 4] = [8.0, 10.0, 3.0, 4.0];

/// Estimates and half widths, with as many digits as are known.
type Answer = [(f64, f64); 8];

const FOUR: Answer = [
    (3.203_255, 0.0129),
    (3.480_243, 0.0124),
    (0.620_629, 0.0019),
    (0.469_768, 0.0018),
    (0.073_985, 0.0003),
    (0.054_876, 0.0003),
    (0.067_979, 0.0003),
    (0.059_779, 0.0003),
];
const TWO: Answer = [
    (3.206_407, 0.0187),
    (3.484_454, 0.0202),
    (0.620_251, 0.003),
    (0.469_716, 0.003),
    (0.074_042, 0.0005),
    (0.054_958, 0.0005),
    (0.067_939, 0.0005),
    (0.059_647, 0.0005),
];

/// Inputs and the four measurements.
fn data() -> (Vec<f64>, Vec<f64>) {
    let text = include_str!("../data/ident-tanks.csv");
    let (mut u, mut y) = (Vec::new(), Vec::new());
    for line in text.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        u.extend(&row[1..3]);
        y.extend(&row[3..7]);
    }
    (u, y)
}

fn fit(measured: &[usize], start: &[f64; 8], state: [f64; 4]) -> Identified {
    let (u, y) = data();
    let plant = tanks();
    let unknown = start.map(|initial| (initial, 0.01, 10.0));
    let free = InitialState::Free(state.to_vec());
    let problem = problem(&*plant, measured, Some(0.05), &unknown, free);
    let y: Vec<f64> = y.chunks(4).flat_map(|row| measured.iter().map(|&i| row[i])).collect();
    let mut model = plant.model(Integrator::Rk4, 10.0, 4).unwrap();
    identify(&mut *model, &problem, &[Recording { name: "tanks", before: None, u: &u, y: &y }])
        .unwrap()
}

fn assert_answer(found: &Identified, answer: &Answer, cost: f64) {
    assert_eq!(found.status, FitStatus::Converged);
    assert!((found.cost - cost).abs() < 1e-6 * cost, "{}", found.cost);
    for (estimate, (value, half_width)) in found.parameters.iter().zip(answer) {
        // Half of the last digit that is known, beside 1e-6.
        let close = (estimate.value - value).abs() <= 0.51e-6 + 1e-6 * value;
        assert!(close, "{}: {} instead of {value}", estimate.name, estimate.value);
        let width = estimate.half_width.unwrap();
        let digit = if (half_width - 0.003).abs() < 1e-9 { 0.5e-3 } else { 0.5e-4 };
        let close = (width - half_width).abs() <= digit + 0.01 * half_width;
        assert!(close, "{}: +- {width} instead of {half_width}", estimate.name);
    }
}

#[test]
fn four_outputs_give_the_answer_of_scipy_from_near() {
    let found = fit(&[0, 1, 2, 3], &NEAR, STATE);
    assert_answer(&found, &FOUR, 409.761_095);
    assert!(matches!(found.method, Method::SingleShooting { .. }));
    assert_eq!((found.measurements, found.degrees_of_freedom), (804, 792));
    assert_eq!(found.findings, []);
    // The truth is within four standard deviations.
    let truth = [3.21, 3.48, 0.62, 0.47, 0.074, 0.055, 0.068, 0.060, 8.0, 10.0, 3.0, 4.0];
    for (estimate, truth) in found.estimates().zip(truth) {
        let width = estimate.half_width.unwrap();
        assert!((estimate.value - truth).abs() < 2.0 * width, "{estimate:?}");
    }
}

#[test]
fn four_outputs_give_the_answer_of_scipy_from_far() {
    assert_answer(&fit(&[0, 1, 2, 3], &FAR, STATE), &FOUR, 409.761_095);
}

#[test]
fn two_outputs_give_the_answer_of_scipy_from_near_and_far() {
    assert_answer(&fit(&[0, 1], &NEAR, STATE), &TWO, 207.618_614);
    assert_answer(&fit(&[0, 1], &FAR, STATE), &TWO, 207.618_614);
}

/// From wherever it starts, it ends in the same place to 1e-6, initial states included.
#[test]
fn near_and_far_starts_end_in_the_same_place() {
    for measured in [&[0, 1, 2, 3][..], &[0, 1]] {
        let near = fit(measured, &NEAR, STATE);
        let far = fit(measured, &FAR, [5.0, 5.0, 5.0, 5.0]);
        for (near, far) in near.estimates().zip(far.estimates()) {
            let close = (near.value - far.value).abs() <= 1e-6 * near.value.abs();
            assert!(close, "{near:?} {far:?}");
            let (a, b) = (near.half_width.unwrap(), far.half_width.unwrap());
            assert!((a - b).abs() <= 1e-5 * a);
        }
    }
}

/// What a fit costs is counted: steps and linearizations of the model.
#[test]
fn the_fit_takes_few_evaluations_of_the_model() {
    let near = fit(&[0, 1, 2, 3], &NEAR, STATE);
    assert!(near.work.iterations <= 7, "{:?}", near.work);
    assert!(near.work.linearized <= 201 * 9, "{:?}", near.work);
    assert!(near.work.steps <= 200 * 9, "{:?}", near.work);
    let far = fit(&[0, 1, 2, 3], &FAR, STATE);
    assert!(far.work.iterations <= 25 && far.work.steps <= 199 * 45, "{:?}", far.work);
}

/// Half widths agree with the formula, with a Jacobian of differences of the model and the inverse
/// of its normal equations.
#[test]
fn half_widths_match_the_formula() {
    let found = fit(&[0, 1, 2, 3], &NEAR, STATE);
    let (u, y) = data();
    let mut model = tanks().model(Integrator::Rk4, 10.0, 4).unwrap();
    let at: Vec<f64> = found.estimates().map(|estimate| estimate.value).collect();
    let mut residuals = |at: &[f64]| -> Vec<f64> {
        let x = crate::support::simulated(&mut *model, &at[8..], &u, &at[..8]);
        x.iter().zip(&y).map(|(x, y)| x - y).collect()
    };
    let column = |i: usize| -> Vec<f64> {
        let step = 1e-5 * at[i];
        let mut side = |sign: f64| {
            let mut at = at.clone();
            at[i] += sign * step;
            residuals(&at)
        };
        side(1.0).iter().zip(side(-1.0)).map(|(a, b)| (a - b) / (2.0 * step)).collect()
    };
    let columns: Vec<Vec<f64>> = (0..12).map(column).collect();
    let left = residuals_squared(&found, &y);
    let inverse = inverse_of_products(&columns);
    // t of 792 degrees of freedom is 1.962 97.
    for (i, estimate) in found.estimates().enumerate() {
        let expected = 1.962_97 * (left / 792.0 * inverse[i][i]).sqrt();
        let width = estimate.half_width.unwrap();
        assert!((width / expected - 1.0).abs() < 1e-4, "{estimate:?} {expected}");
        for (j, other) in inverse.iter().enumerate() {
            let expected = inverse[i][j] / (inverse[i][i] * other[j]).sqrt();
            assert!((found.correlation[12 * i + j] - expected).abs() < 1e-4);
        }
    }
}

fn residuals_squared(found: &Identified, y: &[f64]) -> f64 {
    found.fitted[0].iter().zip(y).map(|(fitted, y)| (fitted - y).powi(2)).sum()
}

/// (J'J)^-1 of the columns of J, by elimination.
fn inverse_of_products(columns: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = columns.len();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let row = |i: usize| -> Vec<f64> {
        let products = columns.iter().map(|column| product(&columns[i], column));
        products.chain((0..n).map(|j| if i == j { 1.0 } else { 0.0 })).collect()
    };
    let mut rows: Vec<Vec<f64>> = (0..n).map(row).collect();
    for i in 0..n {
        let pivot: Vec<f64> = rows[i].iter().map(|v| v / rows[i][i]).collect();
        for (_, row) in rows.iter_mut().enumerate().filter(|(k, _)| *k != i) {
            let factor = row[i];
            row.iter_mut().zip(&pivot).for_each(|(a, b)| *a -= factor * b);
        }
        rows[i] = pivot;
    }
    rows.into_iter().map(|row| row[n..].to_vec()).collect()
}

/// With every third value missing the intervals grow.
#[test]
fn missing_values_are_left_out() {
    let (u, y) = data();
    let plant = tanks();
    let unknown = NEAR.map(|initial| (initial, 0.01, 10.0));
    let problem =
        problem(&*plant, &[0, 1, 2, 3], Some(0.05), &unknown, InitialState::Free(STATE.to_vec()));
    let gappy: Vec<f64> =
        y.iter().enumerate().map(|(i, y)| if i % 3 == 0 { f64::NAN } else { *y }).collect();
    let mut model = plant.model(Integrator::Rk4, 10.0, 4).unwrap();
    let recording = Recording { name: "gappy", before: None, u: &u, y: &gappy };
    let found = identify(&mut *model, &problem, &[recording]).unwrap();
    assert_eq!(found.measurements, 536);
    // Values that are missing weigh nothing: as if their noise were without end.
    let whole = fit(&[0, 1, 2, 3], &NEAR, STATE);
    for (estimate, whole) in found.parameters.iter().zip(&whole.parameters) {
        let [width, whole_width] = [estimate, whole].map(|of| of.half_width.unwrap());
        // A third of the data is gone: widths grow by sqrt(3/2), except for s, whose standard
        // deviation is 1/sqrt(2*524) of it, less what the same values say of both.
        let ratio = width / whole_width / 1.5_f64.sqrt();
        eprintln!("RATIO {ratio} {}", (estimate.value - whole.value) / width);
        assert!((ratio - 1.0).abs() < 0.04, "{estimate:?} {whole:?}");
        // The estimate moves by what the missing third said: sqrt(w^2 - w0^2), in standard
        // deviations of which there are two in a width.
        let moved = (width * width - whole_width * whole_width).sqrt();
        assert!((estimate.value - whole.value).abs() < 1.5 * moved, "{estimate:?} {whole:?}");
    }
}

/// Two recordings have one set of parameters and an initial state each.
#[test]
fn several_recordings_share_their_parameters() {
    let (u, y) = data();
    let plant = tanks();
    let unknown = NEAR.map(|initial| (initial, 0.01, 10.0));
    let free = InitialState::Free(STATE.to_vec());
    let problem = problem(&*plant, &[0, 1, 2, 3], Some(0.05), &unknown, free);
    let part = |name, rows: std::ops::Range<usize>| Recording {
        name,
        before: None,
        u: &u[2 * rows.start..2 * rows.end],
        y: &y[4 * rows.start..4 * rows.end],
    };
    let mut model = plant.model(Integrator::Rk4, 10.0, 4).unwrap();
    let parts = [part("first", 0..90), part("second", 90..201)];
    let found = identify(&mut *model, &problem, &parts).unwrap();
    assert_eq!(found.status, FitStatus::Converged);
    assert_eq!((found.parameters.len(), found.initial_states.len()), (8, 2));
    assert_eq!(found.degrees_of_freedom, 804 - 16);
    assert_eq!(found.initial_states[1][0].name, "h1(0) of second");
    assert_eq!(found.correlation.len(), 16 * 16);
    for (estimate, (value, half_width)) in found.parameters.iter().zip(FOUR) {
        assert!((estimate.value - value).abs() < estimate.half_width.unwrap());
        assert!(estimate.half_width.unwrap() > half_width - 0.00005);
    }
    // The second one begins where the first one ends.
    let plant_state = |recording: usize, row: usize, i: usize| found.fitted[recording][4 * row + i];
    for i in 0..4 {
        let gap = plant_state(1, 0, i) - plant_state(0, 89, i);
        assert!(gap.abs() < 0.5, "{gap}");
    }
}

/// An output that is no state is measured as well as a state is.
#[test]
fn outputs_are_measured_as_states_are() {
    use pinc_expr::Equations;
    use pinc_ode::Variable;
    let text = |pairs: &[(&str, &str)]| crate::support::texts(pairs).into_iter().collect();
    let output = |expression: &str| pinc_expr::OutputExpression {
        expression: expression.to_owned(),
        unit: String::new(),
    };
    let plant = Equations {
        states: vec![Variable::new("pA", ""), Variable::new("pB", "")],
        inputs: vec![Variable::new("u", "")],
        parameters: [("c".to_owned(), 1.0), ("k".to_owned(), 0.16)].into(),
        derivatives: text(&[("pA", "-2*k*pA^2 + u"), ("pB", "k*pA^2")]),
        outputs: [("total".to_owned(), output("c*(pA + pB)"))].into(),
        ..Equations::default()
    };
    let plant = plant.compile_with(&["c", "k"]).unwrap().into_dyn();
    let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
    let u = crate::support::steps(3, 100, 10, (0.0, 2.0));
    let x = crate::support::simulated(&mut *model, &[3.0, 1.0], &u, &[1.5, 0.16]);
    let y: Vec<f64> = x.chunks(2).map(|x| 1.5 * (x[0] + x[1])).collect();
    let mut problem = problem(
        &*plant,
        &[0],
        None,
        &[(1.2, 0.1, 5.0), (0.3, 0.01, 5.0)],
        InitialState::Fixed(vec![3.0, 1.0]),
    );
    problem.channels[0].measured = Measured::Output(0);
    let recording = Recording { name: "batch", before: None, u: &u, y: &y };
    let found = identify(&mut *model, &problem, &[recording]).unwrap();
    assert_eq!(found.status, FitStatus::Converged);
    assert!(found.initial_states.is_empty());
    for (estimate, truth) in found.parameters.iter().zip([1.5, 0.16]) {
        assert!((estimate.value - truth).abs() < 1e-9, "{estimate:?}");
    }
}

/// A state and an output that is the same, measured as 0 and 1: the estimate is their mean, each
/// weighted by the square of one over its noise.
#[test]
fn a_state_and_an_output_are_weighted_by_their_noise() {
    use pinc_expr::{Equations, OutputExpression};
    use pinc_ode::Variable;
    let output = OutputExpression { expression: "x".to_owned(), unit: String::new() };
    let plant = Equations {
        states: vec![Variable::new("x", "")],
        inputs: vec![Variable::new("u", "")],
        derivatives: crate::support::texts(&[("x", "0*u")]).into_iter().collect(),
        outputs: [("y".to_owned(), output)].into(),
        ..Equations::default()
    };
    let plant = plant.compile().unwrap().into_dyn();
    let mut model = plant.model(Integrator::Rk4, 1.0, 1).unwrap();
    let mut problem = problem(&*plant, &[0, 0], None, &[], InitialState::Free(vec![0.3]));
    problem.channels[1].measured = Measured::Output(0);
    let (u, y) = ([0.0; 5], [0.0, 1.0].repeat(5));
    for sd in [[1.0, 100.0], [100.0, 1.0], [2.0, 3.0]] {
        for (channel, sd) in problem.channels.iter_mut().zip(sd) {
            channel.sd = Some(sd);
        }
        let recording = Recording { name: "constant", before: None, u: &u, y: &y };
        let found = identify(&mut *model, &problem, &[recording]).unwrap();
        let [of_state, of_output] = sd.map(|sd: f64| sd.powi(-2));
        let expected = of_output / (of_state + of_output);
        let value = found.initial_states[0][0].value;
        assert!((value - expected).abs() < 1e-9, "{sd:?}: {value} instead of {expected}");
        let cost = 2.5 * (of_state * expected.powi(2) + of_output * (1.0 - expected).powi(2));
        assert!((found.cost - cost).abs() < 1e-9 * cost, "{sd:?}: {} {cost}", found.cost);
    }
}
