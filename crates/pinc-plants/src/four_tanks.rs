//! The quadruple-tank process.

use crate::outflow;
use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// The four tanks, Section 4.2 of the paper, after Johansson, "The quadruple-tank process", IEEE
/// Trans. Control Systems Technology 8 (2000):
///
/// ```text
/// w_i = a_i sqrt(2 g h_i)
/// h1' = (gamma1 k1 u1       + w3 - w1) / A1
/// h2' = (gamma2 k2 u2       + w4 - w2) / A2
/// h3' = ((1 - gamma2) k2 u2      - w3) / A3
/// h4' = ((1 - gamma1) k1 u1      - w4) / A4
/// ```
///
/// Pump 1 feeds tanks 1 and 4, pump 2 feeds tanks 2 and 3; tank 3 drains into 1, tank 4 into 2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FourTanks<K = f64> {
    /// Cross-sections `A_i` of the tanks, in cm^2.
    pub area: [K; 4],
    /// Cross-sections `a_i` of the outlets, in cm^2.
    pub outlet: [K; 4],
    /// Valve openings gamma1, gamma2: the share of a pump's flow that goes to its lower tank.
    pub gamma: [K; 2],
    /// Pump constants k1, k2, in cm^3/(V s).
    pub pump: [K; 2],
}

impl FourTanks {
    const fn new(gamma: [f64; 2], pump: [f64; 2]) -> Self {
        let area = [28.0, 32.0, 28.0, 32.0];
        let outlet = [0.071, 0.057, 0.071, 0.057];
        Self { area, outlet, gamma, pump }
    }

    /// The parameters behind the paper's published results, from the authors' code.
    ///
    /// gamma1 + gamma2 = 1 puts a transmission zero at 0: the static gain has rank 1, and every
    /// steady state has h2/h1 = (a1/a2)^2.
    #[must_use]
    pub const fn antonelo() -> Self {
        Self::new([0.5, 0.5], [3.33, 3.35])
    }

    /// Johansson's nonminimum-phase setting, which the paper's text names. Operating point:
    /// h = (12.6, 13.0, 4.8, 4.9) cm at u = (3.15, 3.15) V.
    #[must_use]
    #[expect(clippy::approx_constant, reason = "a pump constant of 3.14, not pi")]
    pub const fn johansson_nonminimum() -> Self {
        Self::new([0.43, 0.34], [3.14, 3.29])
    }

    /// Johansson's minimum-phase setting. Operating point: h = (12.4, 12.7, 1.8, 1.4) cm at
    /// u = (3.00, 3.00) V.
    #[must_use]
    pub const fn johansson_minimum() -> Self {
        Self::new([0.70, 0.60], [3.33, 3.35])
    }
}

impl<K: Scalar> FourTanks<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K]) -> Self {
        let four = |first: usize| [0, 1, 2, 3].map(|i| constants[first + i]);
        let two = |first: usize| [0, 1].map(|i| constants[first + i]);
        Self { area: four(0), outlet: four(4), gamma: two(8), pump: two(10) }
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, h: &[S], u: &[S], dh: &mut [S]) {
        let [gamma1, gamma2] = self.gamma;
        let one = gamma1.constant(1.0);
        let (flow1, flow2) = (u[0] * self.pump[0], u[1] * self.pump[1]);
        let w1 = outflow(self.outlet[0], h[0]);
        let w2 = outflow(self.outlet[1], h[1]);
        let w3 = outflow(self.outlet[2], h[2]);
        let w4 = outflow(self.outlet[3], h[3]);
        dh[0] = (flow1 * gamma1 + w3 - w1) * (one / self.area[0]);
        dh[1] = (flow2 * gamma2 + w4 - w2) * (one / self.area[1]);
        dh[2] = (flow2 * (one - gamma2) - w3) * (one / self.area[2]);
        dh[3] = (flow1 * (one - gamma1) - w4) * (one / self.area[3]);
    }
}

impl Plant for FourTanks {
    const COLUMNS: Option<usize> = Some(6);

    fn states(&self) -> &[Variable] {
        const {
            &[
                Variable::new("h1", "cm"),
                Variable::new("h2", "cm"),
                Variable::new("h3", "cm"),
                Variable::new("h4", "cm"),
            ]
        }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u1", "V"), Variable::new("u2", "V")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let numbers = [
            ("A", &self.area[..]),
            ("a", &self.outlet[..]),
            ("gamma", &self.gamma[..]),
            ("k", &self.pump[..]),
        ];
        let named = |(name, values): (&str, &[f64])| -> Vec<(String, f64)> {
            let each = values.iter().enumerate();
            each.map(|(i, &value)| (format!("{name}{}", i + 1), value)).collect()
        };
        numbers.into_iter().flat_map(named).collect()
    }

    by_rates!(FourTanks);
}
