//! One tank: the smallest plant.

use crate::outflow;
use pinc_ad::Scalar;
use pinc_ode::{Plant, Variable};

/// A tank with a pump and a hole, one of the four tanks by itself:
///
/// ```text
/// h' = (k u - a sqrt(2 g h)) / A
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneTank {
    /// Cross-section A of the tank, in cm^2.
    pub area: f64,
    /// Cross-section a of the outlet, in cm^2.
    pub outlet: f64,
    /// Pump constant k, in cm^3/(V s).
    pub pump: f64,
}

impl Default for OneTank {
    /// The parameters of the authors' code.
    #[expect(clippy::approx_constant, reason = "a pump constant of 3.14, not pi")]
    fn default() -> Self {
        Self { area: 28.0, outlet: 0.071, pump: 3.14 }
    }
}

impl Plant for OneTank {
    const COLUMNS: Option<usize> = Some(2);

    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("h", "cm")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "V")];
        &VARIABLES
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, h: &[S], u: &[S], _p: &[S], dh: &mut [S]) {
        dh[0] = (u[0] * self.pump - outflow(self.outlet, h[0])) * (1.0 / self.area);
    }
}
