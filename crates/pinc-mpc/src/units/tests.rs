use super::*;
use crate::Weights;

/// The unit of the cost of one state and one input of ordinary size, by their weights.
fn cost(q: f64, r: f64) -> f64 {
    let dims = Dims::new(1, 1);
    let problem = NmpcProblem::new(dims, 1, Weights::uniform(vec![1.0], vec![1.0]));
    let rows = OutputRows::default();
    let mut units = Units::new(&problem, problem.ocp_dims(dims, &rows), &rows);
    units.choose_cost(&[q], &[r]);
    units.cost
}

#[test]
fn what_has_no_weight_says_nothing_of_the_cost() {
    let large = cost(1e12, 1e12);
    assert!(large > 1e10, "{large}");
    for (q, r) in [(1e12, 0.0), (0.0, 1e12)] {
        assert!((cost(q, r) / large - 1.0).abs() < 1e-12, "{q} {r}");
    }
    assert!((cost(0.0, 0.0) - 1.0).abs() < 1e-12);
}

#[test]
fn no_weight_is_so_large_that_rounding_is_above_the_tolerance() {
    for (q, r) in [(1.0_f64, 1e8), (1e-2, 1e9), (1e9, 0.1)] {
        assert!(q.max(r) / cost(q, r) <= LARGEST_WEIGHT, "{q} {r}");
    }
    // Nor is the least one so small that its gradient is within the tolerance.
    for (q, r) in [(1.0_f64, 1e17), (1e-3, 1e9), (1e20, 1e-6)] {
        assert!(q.min(r) / cost(q, r) >= 1e-5 || cost(q, r) <= 1.0, "{q} {r}");
    }
    assert!((cost(1.0, 1e7) - 1.0).abs() < 1e-12);
}

#[test]
fn a_unit_follows_what_is_large_and_stays_where_it_fits() {
    let sized = |unit: f64, size: f64, referred: bool| {
        let mut unit = unit;
        let changed = fit(&mut unit, size, referred);
        (changed, unit.log2())
    };
    let after = |unit: f64, size: f64| sized(unit, size, false);
    // 2^20 is 8 times 2^17.
    let large = f64::from(1 << 20);
    assert_eq!(after(1.0, large), (true, 17.0));
    assert_eq!(after(f64::from(1 << 17), large), (false, 17.0));
    assert_eq!(after(f64::from(1 << 30), large), (true, 17.0));
    assert_eq!(after(f64::from(1 << 30), 0.0), (true, 0.0));
    for (unit, size) in [(1.0, 0.0), (1.0, 1024.0), (1.0, f64::INFINITY), (1.0, f64::NAN)] {
        assert_eq!(after(unit, size), (false, 0.0), "{size}");
    }
    // 2^-20 is 8 times 2^-23, and small only where a reference is, too; 0.1 is ordinary.
    let small = f64::exp2(-20.0);
    assert_eq!(after(1.0, small), (false, 0.0));
    assert_eq!(sized(1.0, small, true), (true, -23.0));
    assert_eq!(sized(f64::exp2(-23.0), small, true), (false, -23.0));
    assert_eq!(after(f64::exp2(-23.0), 0.0), (false, -23.0));
    assert_eq!(after(f64::exp2(-23.0), 1.0), (true, 0.0));
    assert_eq!(sized(1.0, 0.1, true), (false, 0.0));
}
