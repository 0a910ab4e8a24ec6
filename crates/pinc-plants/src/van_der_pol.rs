//! The Van der Pol oscillator.

use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// The Van der Pol oscillator, Section 4.1 of the paper:
///
/// ```text
/// x1' = x2
/// x2' = mu (1 - x1^2) x2 - x1 + u
/// ```
///
/// Its equilibrium for a constant input is (u, 0), stable where mu (1 - u^2) < 0, that is |u| > 1.
/// All quantities but time (s) are without dimension.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VanDerPol<K = f64> {
    /// The damping parameter mu; 1 in the paper.
    pub mu: K,
}

impl Default for VanDerPol {
    fn default() -> Self {
        Self { mu: 1.0 }
    }
}

impl<K: Scalar> VanDerPol<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K]) -> Self {
        Self { mu: constants[0] }
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        let (x1, x2, u) = (x[0], x[1], u[0]);
        dx[0] = x2;
        dx[1] = (-(x1 * x1) + 1.0) * x2 * self.mu - x1 + u;
    }
}

impl Plant for VanDerPol {
    const COLUMNS: Option<usize> = Some(3);

    fn states(&self) -> &[Variable] {
        const { &[Variable::new("x1", ""), Variable::new("x2", "")] }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u", "")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        vec![("mu".to_owned(), self.mu)]
    }

    by_rates!(VanDerPol);
}
