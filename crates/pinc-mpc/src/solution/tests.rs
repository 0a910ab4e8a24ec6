//! Plans that are shifted, resampled and turned.

use super::*;

/// One input and one inequality, from the node `n1` on, over a chain of `horizon` stages.
fn dims(nx: usize, [horizon, n_controls]: [usize; 2], n1: usize) -> OcpDims {
    OcpDims { n_controls, n1, inequalities: 1, ..OcpDims::new(nx, 1, horizon) }
}

/// Steps of 1 s, 1 s and 4 s: the plan moves by 1 s.
#[test]
fn a_plan_on_stages_of_different_lengths_is_interpolated() {
    let dims = dims(1, [3, 3], 1);
    let mut from = Solution::new(dims);
    from.z = vec![1.0, 2.0, 10.0, 5.0, 6.0, 7.0];
    from.multipliers.dynamics = vec![0.1, 0.2, 0.3];
    from.multipliers.bounds = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    from.multipliers.increments = vec![-1.0, -2.0, -3.0];
    from.multipliers.rows = vec![11.0, 12.0, 13.0];
    let mut to = Solution::new(dims);
    to.resample(&from, &[0.0, 1.0, 2.0, 6.0]);
    // At 1, 2 and 6 s it is what was planned for 2, 3 and 7 s.
    assert_eq!(to.states(), [2.0, 4.0, 10.0]);
    assert_eq!(to.inputs(), [6.0, 7.0, 7.0]);
    assert_eq!(to.dynamics_multipliers(), [0.2, 0.3, 0.3]);
    assert_eq!(to.state_multipliers(), [2.0, 3.0, 3.0]);
    assert_eq!(to.input_multipliers(), [5.0, 6.0, 6.0]);
    assert_eq!(to.increment_multipliers(), [-2.0, -3.0, -3.0]);
    assert_eq!(to.constraint_multipliers(), [12.0, 13.0, 13.0]);
}

#[test]
fn one_value_that_is_not_a_number_is_noticed() {
    let dims = dims(1, [2, 2], 1);
    assert!(Solution::new(dims).is_finite());
    let with = |change: fn(&mut Solution)| {
        let mut solution = Solution::new(dims);
        change(&mut solution);
        solution.is_finite()
    };
    assert!(!with(|solution| solution.z[3] = f64::NAN));
    assert!(!with(|solution| solution.multipliers.dynamics[1] = f64::INFINITY));
    assert!(!with(|solution| solution.multipliers.bounds[0] = f64::NAN));
    assert!(!with(|solution| solution.multipliers.increments[1] = f64::NEG_INFINITY));
    assert!(!with(|solution| solution.multipliers.rows[1] = f64::NAN));
}

#[test]
fn shifting_keeps_the_last_stage() {
    let dims = dims(2, [3, 1], 2);
    let mut solution = Solution::new(dims);
    solution.z = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    solution.multipliers.dynamics = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    solution.multipliers.rows = vec![1.0, 2.0];
    solution.multipliers.bounds = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
    solution.shift(false);
    assert_eq!(solution.states(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
    assert_eq!(solution.inputs(), [7.0]);
    assert_eq!(solution.dynamics_multipliers(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
    assert_eq!(solution.constraint_multipliers(), [2.0, 2.0]);
    assert_eq!(solution.state_multipliers(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
    assert_eq!(solution.input_multipliers(), [7.0]);
}

#[test]
fn an_orbit_is_turned() {
    let dims = dims(2, [3, 3], 1);
    let mut solution = Solution::new(dims);
    solution.z = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0];
    solution.multipliers.dynamics = vec![10.0, 20.0, 30.0, 40.0, 50.0, 60.0];
    solution.multipliers.rows = vec![1.0, 2.0, 3.0];
    solution.multipliers.increments = vec![4.0, 5.0, 6.0];
    solution.multipliers.bounds = solution.z.clone();
    solution.shift(true);
    assert_eq!(solution.states(), [3.0, 4.0, 5.0, 6.0, 1.0, 2.0]);
    assert_eq!(solution.inputs(), [8.0, 9.0, 7.0]);
    assert_eq!(solution.dynamics_multipliers(), [30.0, 40.0, 50.0, 60.0, 10.0, 20.0]);
    assert_eq!(solution.constraint_multipliers(), [2.0, 3.0, 1.0]);
    assert_eq!(solution.multipliers.increments, [5.0, 6.0, 4.0]);
    // The end of the plan before is inside now; what closes the orbit is lambda there.
    assert_eq!(solution.state_multipliers(), [3.0, 4.0, 0.0, 0.0, 10.0, 20.0]);
    assert_eq!(solution.input_multipliers(), [8.0, 9.0, 7.0]);
}
