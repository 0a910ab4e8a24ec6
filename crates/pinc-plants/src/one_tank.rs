//! One tank: the smallest plant.

use crate::outflow;
use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// A tank with a pump and a hole, one of the four tanks by itself:
///
/// ```text
/// h' = (k u - a sqrt(2 g h)) / A
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneTank<K = f64> {
    /// Cross-section A of the tank, in cm^2.
    pub area: K,
    /// Cross-section a of the outlet, in cm^2.
    pub outlet: K,
    /// Pump constant k, in cm^3/(V s).
    pub pump: K,
}

impl Default for OneTank {
    /// The parameters of the authors' code.
    #[expect(clippy::approx_constant, reason = "a pump constant of 3.14, not pi")]
    fn default() -> Self {
        Self { area: 28.0, outlet: 0.071, pump: 3.14 }
    }
}

impl<K: Scalar> OneTank<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K]) -> Self {
        Self { area: constants[0], outlet: constants[1], pump: constants[2] }
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, h: &[S], u: &[S], dh: &mut [S]) {
        let inverse = self.area.constant(1.0) / self.area;
        dh[0] = (u[0] * self.pump - outflow(self.outlet, h[0])) * inverse;
    }
}

impl Plant for OneTank {
    const COLUMNS: Option<usize> = Some(2);

    fn states(&self) -> &[Variable] {
        const { &[Variable::new("h", "cm")] }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u", "V")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        ["A", "a", "k"]
            .map(str::to_owned)
            .into_iter()
            .zip([self.area, self.outlet, self.pump])
            .collect()
    }

    by_rates!(OneTank);
}
