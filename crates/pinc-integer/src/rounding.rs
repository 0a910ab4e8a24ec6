//! Sum-up rounding.

/// Rounds the inputs at the places `whole` of `inputs`, `[stages, m]` for stages of these `lengths`:
/// each to the whole number that keeps the integral of what was rounded so far as near as possible
/// to the integral of the input itself. For on/off inputs the two differ by half a stage at most.
///
/// S. Sager, "Numerical methods for mixed-integer optimal control problems" (2005).
///
/// ```
/// let mut pump = [0.3, 0.3, 0.3, 0.3, 0.5];
/// pinc_integer::sum_up(&mut pump, &[0], &[1.0; 5]);
/// assert_eq!(pump, [0.0, 1.0, 0.0, 0.0, 1.0]);
/// ```
///
/// # Panics
///
/// If there are not as many inputs in each stage, or no such place.
pub fn sum_up(inputs: &mut [f64], whole: &[usize], lengths: &[f64]) {
    let m = inputs.len() / lengths.len();
    assert!(inputs.len() == m * lengths.len(), "as many inputs in each stage");
    for &place in whole {
        let mut left = 0.0;
        for (input, length) in inputs.iter_mut().skip(place).step_by(m).zip(lengths) {
            left += *input * length;
            *input = (left / length).round();
            left -= *input * length;
        }
    }
}
