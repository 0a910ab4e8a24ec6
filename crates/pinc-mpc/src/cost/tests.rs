use super::*;
use crate::Weights;
use crate::outputs::OutputRows;
use pinc_ad::check_gradient;
use pinc_ode::Dims;

fn problem() -> NmpcProblem {
    let q = Weight::Full(vec![vec![3.0, 0.2], vec![0.2, 0.5]]);
    let r = Weight::Full(vec![vec![1.0, -0.3], vec![-0.3, 2.0]]);
    let weights = Weights::scaled(q, r, &[1.5, 1.0, 0.5], &[1.5, 1.0])
        .with_terminal(vec![4.0, 7.0])
        .with_input_sequence(vec![0.0, 3.0, 0.0, 1.0, 2.0, 0.0]);
    NmpcProblem {
        n1: 2,
        control_horizon: 2,
        tracked: Tracked::states([2, 0]),
        ..NmpcProblem::new(Dims::new(3, 2), 3, weights)
    }
}

fn cost_of(problem: &NmpcProblem) -> Cost {
    let dims = problem.ocp_dims(Dims::new(3, 2), &OutputRows::default());
    Cost::new(problem, dims, &Nodes::new(problem, dims))
}

/// J by its definition, for the problem above.
fn value(z: &[f64], targets: Targets<'_>) -> f64 {
    let error = |j: usize| {
        let (x, y) = (&z[(j - 1) * 3..j * 3], &targets.reference[(j - 1) * 2..j * 2]);
        [x[2] - y[0], x[0] - y[1]]
    };
    let [e, f] = error(2);
    let mut sum = 3.0 * e * e + 0.4 * e * f + 0.5 * f * f;
    let [e, f] = error(3);
    sum += 4.0 * e * e + 7.0 * f * f;
    let u = [targets.previous, &z[9..11], &z[11..13]];
    for (i, v) in [(1, 1.5), (2, 1.0)] {
        let [a, b] = [u[i][0] - u[i - 1][0], u[i][1] - u[i - 1][1]];
        sum += v * (a * a - 0.6 * a * b + 2.0 * b * b);
    }
    sum + 3.0 * u[0][1].powi(2) + u[1][1].powi(2) + 2.0 * u[2][0].powi(2)
}

#[test]
fn each_increment_is_from_the_input_before() {
    let weights = Weights::scaled(
        Weight::Full(vec![vec![0.0; 2]; 2]),
        Weight::Full(vec![vec![1.0, -0.3], vec![-0.3, 2.0]]),
        &[1.0; 3],
        &[1.5, 1.0, 0.5],
    );
    let problem = NmpcProblem { control_horizon: 3, weights, ..problem() };
    let cost = cost_of(&problem);
    let targets = Targets { reference: &[0.0; 6], previous: &[0.5, -1.0] };
    let z = [[0.0; 9].as_slice(), &[1.5, 0.0, 1.0, 2.0, 4.0, -1.0]].concat();
    // The increments are (1, 1), (-0.5, 2) and (3, -3).
    let expected = 1.5 * 2.4 + (0.25 + 0.6 + 8.0) + 0.5 * (9.0 + 5.4 + 18.0);
    let mut gradient = vec![f64::NAN; 15];
    let found = cost.gradient(&z, targets, &mut gradient);
    assert!((found - expected).abs() < 1e-13 * expected, "{found} {expected}");
    let value = |z: &[f64]| cost.gradient(z, targets, &mut [0.0; 15]);
    check_gradient(value, &z, &gradient, 1e-8).unwrap();
}

#[test]
fn the_tracking_weight_belongs_to_its_stage() {
    let problem = problem();
    let cost = cost_of(&problem);
    // Before N1, then twice Q, then the terminal weight.
    assert_eq!(cost.tracking_weight(1).to_vec(), vec![0.0; 4]);
    assert_eq!(cost.tracking_weight(2).to_vec(), vec![6.0, 0.4, 0.4, 1.0]);
    assert_eq!(cost.tracking_weight(3).to_vec(), vec![8.0, 0.0, 0.0, 14.0]);
}

#[test]
fn the_derivatives_match_the_definition() {
    let problem = problem();
    let dims = problem.ocp_dims(Dims::new(3, 2), &OutputRows::default());
    let cost = Cost::new(&problem, dims, &Nodes::new(&problem, dims));
    let targets = Targets { reference: &[0.3, -0.2, 0.1, 0.7, -0.4, 0.9], previous: &[0.6, -1.1] };
    let z: Vec<f64> = (0..13).map(|i| f64::from(i * i % 7) - 2.0).collect();
    let mut gradient = vec![f64::NAN; 13];
    let found = cost.gradient(&z, targets, &mut gradient);
    assert!((found - value(&z, targets)).abs() < 1e-13 * found);
    // J is quadratic: central differences are exact up to rounding, 1e-16/1e-5 of J's 1e2.
    check_gradient(|z| value(z, targets), &z, &gradient, 1e-8).unwrap();

    // Its Hessian, block by block, as a difference of gradients.
    let (q, r) = (cost.state_hessians(), cost.increment_hessians());
    let w = cost.input_hessian();
    for v in 0..13 {
        let mut moved = z.clone();
        moved[v] += 1.0;
        let mut there = vec![f64::NAN; 13];
        cost.gradient(&moved, targets, &mut there);
        for row in 0..13 {
            let block = |matrix: &[f64], i: usize, size: usize, row: usize, column: usize| {
                matrix[(i * size + row % size) * size + column % size]
            };
            let expected = match (row, v) {
                (0..9, 0..9) if row / 3 == v / 3 => block(&q, v / 3, 3, row, v),
                (9..11, 9..11) => block(&r, 0, 2, row - 9, v - 9) + block(&r, 1, 2, row - 9, v - 9),
                (11..13, 11..13) => block(&r, 1, 2, row - 9, v - 9),
                (9..13, 9..13) => -block(&r, 1, 2, row - 9, v - 9),
                _ => 0.0,
            };
            let inputs = row.min(v) >= 9;
            let expected = expected + if inputs { w[(row - 9) * 4 + v - 9] } else { 0.0 };
            let difference = there[row] - gradient[row];
            assert!((expected - difference).abs() < 1e-13 * 100.0, "{row}, {v}");
        }
    }
}
