//! The dense solver against the conditions of Karush, Kuhn and Tucker, which for a convex program
//! are necessary and sufficient.

use super::{ActiveSet, DenseQp, DenseStatus};
use proptest::prelude::*;

/// The largest violation of the optimality conditions by a point and its multipliers, stationarity
/// relative to the multipliers.
fn kkt_residual(qp: &DenseQp, x: &[f64], mu: &[f64]) -> f64 {
    let n = qp.unknowns;
    let h = |i: usize, j: usize| qp.hessian[i.min(j) * n + i.max(j)];
    let size = mu.iter().fold(1.0, |size: f64, mu| size.max(mu.abs()));
    let mut worst = 0.0_f64;
    for i in 0..n {
        let mut slope = qp.gradient[i] + mu[i];
        slope += (0..n).map(|j| h(i, j) * x[j]).sum::<f64>();
        slope += (0..qp.rows).map(|r| qp.matrix[i * qp.rows + r] * mu[n + r]).sum::<f64>();
        worst = worst.max(slope.abs() / size);
    }
    for row in 0..n + qp.rows {
        let value = match row.checked_sub(n) {
            None => x[row],
            Some(r) => (0..n).map(|i| qp.matrix[i * qp.rows + r] * x[i]).sum(),
        };
        let (below, above) = (qp.low[row] - value, value - qp.high[row]);
        // A violation is paid for by a multiplier at its penalty.
        worst = worst
            .max(below.min(qp.penalty[row] + mu[row]))
            .max(above.min(qp.penalty[row] - mu[row]));
        worst = worst.max(mu[row].abs() - qp.penalty[row]);
        // A positive multiplier belongs to an upper bound that is reached.
        worst = worst.max(mu[row].min(-above)).max((-mu[row]).min(-below));
    }
    worst
}

/// Numbers from -4 to 4 in quarters, so that ties and dependent rows are frequent.
fn coarse() -> impl Strategy<Value = f64> {
    (-16..=16_i32).prop_map(|quarter| f64::from(quarter) / 4.0)
}

/// The duality gap is the product of x and the slope that the proximal term leaves, which is large where
/// x is.
#[test]
fn solutions_far_from_0_of_programs_with_a_singular_hessian_have_no_duality_gap() {
    let (n, rows) = (30, 4);
    let mut qp = DenseQp::new(n, rows);
    qp.gradient[0] = -1.0;
    for i in 0..n {
        let first = i == 0;
        qp.hessian[i * n + i] = if first { 0.0 } else { 1.0 };
        qp.low[i] = if first { f64::NEG_INFINITY } else { 0.0 };
        for row in 0..rows {
            let number = i32::try_from((i * rows + row) * 7919 % 1009).unwrap();
            qp.matrix[i * rows + row] = if first { 1.0 } else { 2.0 * f64::from(number) - 1009.0 };
        }
    }
    qp.high[n..].fill(0.0);
    let mut solver = ActiveSet::new(n, rows);
    assert_eq!(solver.solve(&qp, &mut || false), DenseStatus::Solved);
    let x = solver.x();
    assert!(x[0] > 1e5, "{x:?}");
    // All bounds are 0, so that the dual cost is -x'H x / 2.
    let gap = x[1..].iter().map(|x| x * x).sum::<f64>() - x[0];
    assert!(gap.abs() < 1e-9, "{gap:e}");
}

/// Two rows that nearly coincide fix the cost, with multipliers of 1e7 whose rounding tilts it.
#[test]
fn a_constant_cost_ends_where_rounding_of_large_multipliers_tilts_it() {
    let (n, near) = (6, 1e-7);
    let number = |i: usize| f64::from(u32::try_from(i * 7919 % 1009).unwrap()) / 1009.0;
    let mut qp = DenseQp::new(n, 2);
    for i in 0..n {
        qp.gradient[i] = number(3 * i + 50) - 0.5;
        qp.matrix[2 * i] = number(i + 1);
        qp.matrix[2 * i + 1] = number(i + 1) + near * qp.gradient[i];
    }
    for side in [&mut qp.low, &mut qp.high] {
        side[n..].copy_from_slice(&[1.0, 1.0 + near]);
    }
    let mut solver = ActiveSet::new(n, 2);
    assert_eq!(solver.solve(&qp, &mut || false), DenseStatus::Solved);
    let cost: f64 = solver.x().iter().zip(&qp.gradient).map(|(x, g)| x * g).sum();
    assert!((cost - 1.0).abs() < 1e-6, "{cost}");
}

/// What a violation costs is no part of how far working rows are off: here 1e6 times coefficients of 80.
#[test]
fn rows_are_met_however_much_violations_cost() {
    // Two hard rows, and a combination of them that cannot be met.
    let (n, hard) = (3, [[1.0, 0.7, -0.3], [0.2, -0.5, 0.9]]);
    let mut qp = DenseQp::new(n, 3);
    qp.hessian.copy_from_slice(&[1.3, 0.4, 0.2, 0.4, 0.9, -0.3, 0.2, -0.3, 1.7]);
    for (column, (one, other)) in
        qp.matrix.chunks_exact_mut(3).zip(hard[0].into_iter().zip(hard[1]))
    {
        column.copy_from_slice(&[one, other, 80.0 * one + 33.0 * other]);
    }
    (qp.high[3], qp.high[4], qp.low[5], qp.penalty[5]) = (0.1, 0.3, 1e3, 1e6);
    let mut solver = ActiveSet::new(n, 3);
    assert_eq!(solver.solve(&qp, &mut || false), DenseStatus::Solved);
    for (row, high) in hard.iter().zip([0.1, 0.3]) {
        let value: f64 = row.iter().zip(solver.x()).map(|(c, x)| c * x).sum();
        assert!((value - high).abs() < 1e-12, "{value} {high}");
    }
}

/// A program with H = M'M + I/10 and a point in the middle of the rows' bounds.
fn programs(number: BoxedStrategy<f64>) -> impl Strategy<Value = DenseQp> {
    (1..=8_usize, 0..=12_usize).prop_flat_map(move |(n, rows)| {
        let numbers = |count| prop::collection::vec(number.clone(), count);
        let kinds = prop::collection::vec((0..6_u8, 0.0..1.0_f64, 0.01..3.0_f64), n + rows);
        (numbers(n * n), numbers(n), numbers(n * rows), numbers(n), kinds).prop_map(
            move |(m, gradient, matrix, middle, kinds)| {
                let mut qp = DenseQp::new(n, rows);
                for i in 0..n {
                    for j in 0..n {
                        let product = (0..n).map(|k| m[k * n + i] * m[k * n + j]).sum::<f64>();
                        qp.hessian[i * n + j] = product + if i == j { 0.1 } else { 0.0 };
                    }
                }
                qp.gradient = gradient.iter().map(|g| 4.0 * g).collect();
                qp.matrix = matrix;
                let mut values = vec![0.0; n + rows];
                qp.values(&middle, &mut values);
                for (row, (&value, (kind, width, penalty))) in values.iter().zip(kinds).enumerate()
                {
                    let (low, high) = match kind {
                        0 => (value, value),
                        1 => (value - width, f64::INFINITY),
                        2 => (f64::NEG_INFINITY, value + width),
                        3 => (value, value + width),
                        4 => (value - width, value + width),
                        _ => (f64::NEG_INFINITY, f64::INFINITY),
                    };
                    // Not as many equalities as there are unknowns, mostly.
                    let low = if kind == 0 && row % 3 != 0 { value - width } else { low };
                    (qp.low[row], qp.high[row]) = (low, high);
                    if width < 0.4 {
                        qp.penalty[row] = penalty;
                    }
                }
                qp
            },
        )
    })
}

fn solved(qp: &DenseQp, solver: &mut ActiveSet) -> Result<(), TestCaseError> {
    prop_assert_eq!(solver.solve(qp, &mut || false), DenseStatus::Solved);
    let residual = kkt_residual(qp, solver.x(), solver.multipliers());
    // Unknowns are up to some 1e3, H's condition up to some 1e4.
    prop_assert!(residual < 1e-8, "{:e}", residual);
    Ok(())
}

/// Rows that contradict each other by less than counts: x <= 1 and x >= 1 + gap, beside others.
#[test]
fn contradictions_within_rounding_are_solved_at_once() {
    for exponent in 0..60 {
        let gap = 9e-9 * 10.0_f64.powf(-0.1 * f64::from(exponent));
        let mut qp = DenseQp::new(2, 2);
        qp.hessian = vec![2.0, 0.3, 0.3, 1.0];
        qp.gradient = vec![-4.0, 1.0];
        // Rows 3 x1 and x1 + x2.
        qp.matrix = vec![3.0, 1.0, 0.0, 1.0];
        (qp.high[0], qp.low[2], qp.high[3]) = (1.0, 3.0 * (1.0 + gap), 0.5);
        let mut solver = ActiveSet::new(2, 2);
        assert_eq!(solver.solve(&qp, &mut || false), DenseStatus::Solved, "{gap:e}");
        assert!(solver.changes() <= 8, "{gap:e}: {}", solver.changes());
        assert!((solver.x()[0] - 1.0).abs() < 1e-7 && (solver.x()[1] + 0.5).abs() < 1.0);
    }
}

/// The rows x1 = 1 and x2 <= 1 hold x, and x1 + x2 <= 1.5 makes the second of them yield, in
/// whatever units they are.
#[test]
fn rows_in_other_units_yield_too() {
    for unit in [1.0, 1e4, 1e8] {
        let mut qp = DenseQp::new(2, 3);
        qp.hessian = vec![1.0, 0.0, 0.0, 1.0];
        qp.gradient = vec![0.0, -5.0];
        qp.matrix = vec![1.0 / unit, 0.0, 1.0, 0.0, unit, 1.0];
        (qp.low[2], qp.high[2]) = (1.0 / unit, 1.0 / unit);
        (qp.high[3], qp.high[4]) = (unit, 1.5);
        let mut solver = ActiveSet::new(2, 3);
        solver.guess()[2..4].fill(1.0);
        assert_eq!(solver.solve(&qp, &mut || false), DenseStatus::Solved, "{unit:e}");
        assert!((solver.x()[0] - 1.0).abs() < 1e-12 && (solver.x()[1] - 0.5).abs() < 1e-12);
    }
}

proptest! {
    #![proptest_config(crate::tests::cases(3000))]

    #[test]
    fn feasible_programs_are_solved(qp in programs((-4.0..4.0_f64).boxed())) {
        solved(&qp, &mut ActiveSet::new(qp.unknowns, qp.rows))?;
    }

    #[test]
    fn degenerate_programs_are_solved(qp in programs(coarse().boxed())) {
        solved(&qp, &mut ActiveSet::new(qp.unknowns, qp.rows))?;
    }

    /// Any guess ends at the solution; the solution as the guess ends at once.
    #[test]
    fn the_guess_only_saves_work(
        qp in programs(coarse().boxed()),
        guess in prop::collection::vec(-1..=1_i8, 20),
    ) {
        let mut cold = ActiveSet::new(qp.unknowns, qp.rows);
        solved(&qp, &mut cold)?;
        let mut warm = ActiveSet::new(qp.unknowns, qp.rows);
        for (mu, guess) in warm.guess().iter_mut().zip(&guess) {
            *mu = f64::from(*guess);
        }
        solved(&qp, &mut warm)?;
        for (cold, warm) in cold.x().iter().zip(warm.x()) {
            prop_assert!((cold - warm).abs() < 1e-7);
        }
        solved(&qp, &mut warm)?;
        prop_assert!(warm.changes() <= 1, "{}", warm.changes());
    }

    /// Bounds moved apart, so that rows contradict each other: the multipliers prove it.
    #[test]
    fn contradictions_are_proved(
        mut qp in programs(coarse().boxed()),
        moves in prop::collection::vec(-3.0..3.0_f64, 20),
    ) {
        for (row, by) in moves.iter().enumerate().take(qp.low.len()) {
            qp.low[row] += by;
            qp.high[row] += by;
            qp.penalty[row] = f64::INFINITY;
        }
        let mut solver = ActiveSet::new(qp.unknowns, qp.rows);
        match solver.solve(&qp, &mut || false) {
            DenseStatus::Solved => {
                let residual = kkt_residual(&qp, solver.x(), solver.multipliers());
                prop_assert!(residual < 1e-8, "{:e}", residual);
            }
            DenseStatus::Infeasible(named) => {
                // sum_i mu_i c_i = 0 but sum_i mu_i (bound of i) < 0
                let mu = solver.multipliers();
                prop_assert!(mu[named].abs() > 0.9);
                let size = mu.iter().fold(0.0, |size: f64, mu| size.max(mu.abs()));
                for i in 0..qp.unknowns {
                    let column = &qp.matrix[i * qp.rows..(i + 1) * qp.rows];
                    let rows = column.iter().zip(&mu[qp.unknowns..]).map(|(c, mu)| c * mu);
                    prop_assert!((mu[i] + rows.sum::<f64>()).abs() < 1e-10 * size);
                }
                let bounds = mu.iter().zip(qp.low.iter().zip(&qp.high)).map(|(&mu, (low, high))| {
                    if mu > 0.0 { mu * high } else if mu < 0.0 { mu * low } else { 0.0 }
                });
                prop_assert!(bounds.sum::<f64>() < -1e-9);
            }
            other => prop_assert!(false, "{:?}", other),
        }
    }
}
