use super::*;

/// Two earlier steps remove two components of the error at once, of the multipliers too, whether steps are
/// too short or too long, and whatever part of them is taken.
#[test]
fn components_of_the_error_are_removed_at_once() {
    let dims = OcpDims::new(1, 1, 1);
    for parts in [[0.1, 0.1], [0.9, 0.2], [1.9, 0.5], [4.0, 1.05]] {
        let mut error = [1.0, -3.0];
        let mut acceleration = Anderson::new(dims);
        let mut step = QpStep::new(dims);
        for taken in 0..3 {
            let next = |k: usize| -parts[k] * error[k];
            step.d.copy_from_slice(&[next(0), next(1)]);
            // The multipliers of a program are off by what its plan is off.
            step.multipliers.dynamics[0] = 5.0 + 0.4 * error[0] - 0.3 * error[1];
            let accelerated = acceleration.accelerate(&mut step, 1);
            assert_eq!(accelerated, taken > 0);
            if taken == 2 {
                break;
            }
            acceleration.take_back(&mut step);
            acceleration.advance(&step.d, 0.7);
            error.iter_mut().zip(&step.d).for_each(|(error, d)| *error += 0.7 * d);
        }
        let left = [error[0] + step.d[0], error[1] + step.d[1]];
        assert!(left.iter().all(|left| left.abs() < 1e-12), "{left:?} {parts:?}");
        let multiplier = step.multipliers.dynamics[0];
        assert!((multiplier - 5.0).abs() < 1e-12, "{multiplier} {parts:?}");
    }
}
