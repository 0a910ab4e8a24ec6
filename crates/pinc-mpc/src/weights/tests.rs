use super::*;
use proptest::prelude::*;

fn is_valid(rows: &[Vec<f64>]) -> bool {
    match Weight::Full(rows.to_vec()).validate("weights.q", rows.len()) {
        Ok(()) => true,
        Err(MpcError::NotSemidefinite { field: "weights.q" }) => false,
        Err(other) => panic!("{other}"),
    }
}

/// `shift` I + `factor` G'G, which has the least eigenvalue `shift` where G has fewer rows than
/// columns.
fn matrix(g: &[[f64; 3]], factor: f64, shift: f64) -> Vec<Vec<f64>> {
    let product = |i: usize, k: usize| g.iter().map(|row| row[i] * row[k]).sum::<f64>();
    let entry = |i: usize, k: usize| factor * product(i, k) + if i == k { shift } else { 0.0 };
    (0..3).map(|i| (0..3).map(|k| entry(i, k)).collect()).collect()
}

proptest! {
    #[test]
    fn costs_that_may_be_negative_are_refused(
        g in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 1..=2),
        exponent in -6..=6,
    ) {
        let scale = 10.0_f64.powi(exponent);
        prop_assert!(is_valid(&matrix(&g, scale, 0.0)));
        prop_assert!(is_valid(&matrix(&g, scale, 1e-3 * scale)));
        prop_assert!(!is_valid(&matrix(&g, scale, -1e-6 * scale)));
    }
}

/// A product of matrices is symmetric up to rounding, and counts as symmetric in any units.
#[test]
fn halves_that_differ_by_rounding_are_averaged() {
    for unit in [1e-9, 1.0, 1e9] {
        let coupling = |ulps: f64| 0.471_550_456_063_179_1 * unit * (1.0 + ulps * f64::EPSILON);
        let rows =
            |ulps: f64| vec![vec![1.9, coupling(0.0)], vec![coupling(ulps), 12.2 * unit * unit]];
        let exact = Weight::Full(rows(0.0));
        assert_eq!(exact.entry(0, 1).to_bits(), coupling(0.0).to_bits());
        let close = Weight::Full(rows(8.0));
        close.validate("weights.q", 2).unwrap();
        assert_eq!(close.entry(0, 1).to_bits(), close.entry(1, 0).to_bits());
        let middle = coupling(4.0);
        assert!((close.entry(0, 1) - middle).abs() <= f64::EPSILON * middle);
        let different = Weight::Full(rows(1e4));
        let refused = MpcError::NotSymmetric { field: "weights.q", row: 1, column: 0 };
        assert_eq!(
            different.validate("weights.q", 2).unwrap_err().to_string(),
            refused.to_string()
        );
    }
    // A negative weight is called that.
    assert!(!is_valid(&[vec![-1.0, 0.1], vec![0.2, 1.0]]));
}

#[test]
fn a_coupling_without_weights_is_refused() {
    assert!(is_valid(&[vec![0.0, 0.0], vec![0.0, 0.0]]));
    assert!(is_valid(&[vec![1.0, 1.0], vec![1.0, 1.0]]));
    assert!(!is_valid(&[vec![1.0, 1.1], vec![1.1, 1.0]]));
    assert!(!is_valid(&[vec![0.0, 1.0], vec![1.0, 0.0]]));
    assert!(!is_valid(&[vec![1.0, 0.0], vec![0.0, -1e-6]]));
}

#[test]
fn units_do_not_hide_a_negative_cost() {
    for unit in [1e-150, 1e-12, 1e-7, 1.0, 1e7, 1e150] {
        let costs = |coupling: f64, last: f64| {
            let [coupling, last] = [coupling * unit, last * unit * unit];
            vec![vec![1.0, 0.0, coupling], vec![0.0, 2.0, 0.0], vec![coupling, 0.0, last]]
        };
        assert!(is_valid(&costs(0.9, 1.0)), "{unit}");
        assert!(is_valid(&costs(1.0, 1.0)), "{unit}");
        assert!(!is_valid(&costs(1.1, 1.0)), "{unit}");
        assert!(!is_valid(&costs(0.0, -1.0)), "{unit}");
    }
}
