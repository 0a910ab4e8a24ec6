//! Central differences, to check derivatives against.

/// A derivative that does not agree with its central difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GradientMismatch {
    /// Which input.
    pub index: usize,
    /// The derivative given.
    pub given: f64,
    /// Its central difference.
    pub difference: f64,
}

impl std::fmt::Display for GradientMismatch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { index, given, difference } = self;
        write!(f, "derivative {index} is {given:e}, its central difference {difference:e}")
    }
}

impl std::error::Error for GradientMismatch {}

/// `(f(x + h e_i) - f(x - h e_i)) / 2h` with `h = cbrt(machine epsilon) max(1, |x_i|)`, the step
/// that balances truncation (h^2 f'''/6) against rounding (eps |f| / h): about 1e-10 of the scale
/// of f.
///
/// # Panics
///
/// If `i` is not an index of `x`.
pub fn central_difference(mut f: impl FnMut(&[f64]) -> f64, x: &[f64], i: usize) -> f64 {
    let h = f64::EPSILON.cbrt() * x[i].abs().max(1.0);
    let mut at = x.to_vec();
    at[i] = x[i] + h;
    let above = f(&at);
    at[i] = x[i] - h;
    (above - f(&at)) / (2.0 * h)
}

/// Compares `gradient` with central differences of `f` at `x`, each to within
/// `tolerance * max(1, |difference|)`.
///
/// # Errors
///
/// The first derivative that disagrees; one that is NaN or infinite on either side always does.
///
/// # Panics
///
/// If `gradient` and `x` differ in length.
pub fn check_gradient(
    mut f: impl FnMut(&[f64]) -> f64,
    x: &[f64],
    gradient: &[f64],
    tolerance: f64,
) -> Result<(), GradientMismatch> {
    assert_eq!(gradient.len(), x.len(), "one derivative per input");
    for (index, &given) in gradient.iter().enumerate() {
        let difference = central_difference(&mut f, x, index);
        let close = (given - difference).abs() <= tolerance * difference.abs().max(1.0);
        // An infinite difference would make the right side infinite, and anything close.
        if !close || !difference.is_finite() {
            return Err(GradientMismatch { index, given, difference });
        }
    }
    Ok(())
}
