//! A still for acetone, methanol and water: a boiling point is solved for at every call.

use crate::acetone_mixture::boil;
use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// A still that strips acetone and methanol from water, continuously, at constant pressure:
///
/// ```text
/// M xa' = F (za - xa) + W (0 - xa) - V (ya - xa)
/// M xm' = F (zm - xm) + W (0 - xm) - V (ym - xm)        V = Q / sum_i y_i dH_i
/// ```
///
/// x are mole fractions in the boiling liquid (xw = 1 - xa - xm), y those in the vapour above it.
/// The feed F is of composition z, the stream W of pure water; the level, and with it M, is held by
/// the bottoms F + W - V. The vapour is in equilibrium with the liquid at its boiling point:
/// activity coefficients by the NRTL equation, vapour pressures by Antoine's, with data from Smith,
/// Van Ness and Abbott, *Introduction to Chemical Engineering Thermodynamics*, 7th edition, tables
/// 12.5 and B.2. The boiling point is solved for at every call; the derivatives follow from the
/// implicit function theorem.
///
/// This makes the plant expensive, as plants with property calculations are: a call costs some
/// forty times as much as for the Van der Pol oscillator.
///
/// The still, of pilot size, is this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcetoneStill<K = f64> {
    /// The holdup M, in mol.
    pub holdup: K,
    /// Mole fractions of acetone and methanol in the feed.
    pub feed: [K; 2],
    /// The stream of water W, in mol/s.
    pub water: K,
    /// The pressure P, in kPa.
    pub pressure: f64,
}

impl Default for AcetoneStill {
    /// 1 kmol under atmospheric pressure, fed with as much acetone as methanol.
    fn default() -> Self {
        Self { holdup: 1000.0, feed: [0.5, 0.5], water: 3.0, pressure: 101.325 }
    }
}

impl AcetoneStill {
    /// The boiling point in K of a liquid with the mole fractions `acetone` and `methanol`.
    #[must_use]
    pub fn boiling_point(&self, acetone: f64, methanol: f64) -> f64 {
        let liquid = [acetone, methanol, 1.0 - acetone - methanol];
        1.0 / boil(liquid, self.pressure).inverse_temperature
    }
}

impl<K: Scalar> AcetoneStill<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K], pressure: f64) -> Self {
        let feed = [constants[1], constants[2]];
        Self { holdup: constants[0], feed, water: constants[3], pressure }
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        let [acetone, methanol] = [x[0], x[1]];
        let water = -(acetone + methanol) + 1.0;
        let boiling = boil([acetone, methanol, water], self.pressure);
        let (feed, vapour, y) = (u[0], u[1] / boiling.heat(), boiling.vapour);
        let inverse = self.holdup.constant(1.0) / self.holdup;
        for i in 0..2 {
            let gain = feed * (-x[i] + self.feed[i]) - x[i] * self.water - vapour * (y[i] - x[i]);
            dx[i] = gain * inverse;
        }
    }
}

impl Plant for AcetoneStill {
    const LONG: bool = true;
    const COLUMNS: Option<usize> = Some(4);

    fn states(&self) -> &[Variable] {
        const { &[Variable::new("xa", ""), Variable::new("xm", "")] }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("F", "mol/s"), Variable::new("Q", "kW")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let [za, zm] = self.feed;
        let numbers = [("M", self.holdup), ("za", za), ("zm", zm), ("W", self.water)];
        numbers.map(|(name, value)| (name.to_owned(), value)).into()
    }

    by_rates!(AcetoneStill, pressure);
}
