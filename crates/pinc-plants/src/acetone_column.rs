//! A distillation column for acetone, methanol and water: three boiling points at every call.

use crate::acetone_mixture::{Boiling, COMPONENTS, boil};
use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// The pot and the trays.
const STAGES: usize = 3;

/// A column that takes acetone out of a feed with methanol and water: a pot, two trays above it and
/// a total condenser, from which the reflux L returns to the upper tray:
///
/// ```text
/// M  x0' = F (z - x0) + L (x1 - x0) - V (y0 - x0)        V = Q / sum_i y0_i dH_i
/// Mt x1' = L (x2 - x1) + V (y0 - y1)
/// Mt x2' = L (y2 - x2) + V (y1 - y2)
/// ```
///
/// for the mole fractions x of acetone and of water (methanol is the rest). The vapour y of a stage
/// is in equilibrium with its liquid, as in [`AcetoneStill`](crate::AcetoneStill), where the
/// sources are. Vapour and liquid flows are the same on all stages (constant molar overflow);
/// levels are held by the bottoms F + L - V and the distillate V - L.
///
/// Three boiling points are solved for in each call. The column, of pilot size, is this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcetoneColumn<K = f64> {
    /// The holdup M of the pot, in mol.
    pub pot: K,
    /// The holdup Mt of a tray, in mol.
    pub tray: K,
    /// The feed F, in mol/s.
    pub feed: K,
    /// Mole fractions of acetone and water in the feed.
    pub composition: [K; 2],
    /// The pressure, in kPa.
    pub pressure: f64,
}

impl Default for AcetoneColumn {
    /// 1 kmol in the pot, a fifth of it on each tray, under atmospheric pressure; half of the feed
    /// is water.
    fn default() -> Self {
        Self { pot: 1000.0, tray: 200.0, feed: 4.0, composition: [0.25, 0.5], pressure: 101.325 }
    }
}

impl<K: Scalar> AcetoneColumn<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K], pressure: f64) -> Self {
        let composition = [constants[3], constants[4]];
        Self { pot: constants[0], tray: constants[1], feed: constants[2], composition, pressure }
    }

    /// The liquid of the pot (0) or a tray, as it boils.
    #[inline(always)]
    fn boiling<S: Scalar>(&self, x: &[S], i: usize) -> Boiling<S> {
        let [acetone, water] = [x[2 * i], x[2 * i + 1]];
        boil([acetone, -(acetone + water) + 1.0, water], self.pressure)
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        // A loop, which does not repeat the code of the boiling point three times.
        let mut stage = [Boiling { vapour: [x[0]; COMPONENTS], inverse_temperature: x[0] }; STAGES];
        for (i, stage) in stage.iter_mut().enumerate() {
            *stage = self.boiling(x, i);
        }
        let (reflux, vapour) = (u[0], u[1] / stage[0].heat());
        let one = self.pot.constant(1.0);
        // Acetone is component 0 of the mixture, water component 2.
        for (i, component) in [0, 2].into_iter().enumerate() {
            let [x0, x1, x2] = [x[i], x[2 + i], x[4 + i]];
            let [y0, y1, y2] = [
                stage[0].vapour[component],
                stage[1].vapour[component],
                stage[2].vapour[component],
            ];
            let fed = -(x0 - self.composition[i]) * self.feed;
            let pot = fed + reflux * (x1 - x0) - vapour * (y0 - x0);
            let lower = reflux * (x2 - x1) + vapour * (y0 - y1);
            let upper = reflux * (y2 - x2) + vapour * (y1 - y2);
            dx[i] = pot * (one / self.pot);
            dx[2 + i] = lower * (one / self.tray);
            dx[4 + i] = upper * (one / self.tray);
        }
    }
}

impl Plant for AcetoneColumn {
    const LONG: bool = true;
    const COLUMNS: Option<usize> = Some(2 * STAGES + 2);

    fn states(&self) -> &[Variable] {
        const {
            &[
                Variable::new("xa0", ""),
                Variable::new("xw0", ""),
                Variable::new("xa1", ""),
                Variable::new("xw1", ""),
                Variable::new("xa2", ""),
                Variable::new("xw2", ""),
            ]
        }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("L", "mol/s"), Variable::new("Q", "kW")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let [za, zw] = self.composition;
        let numbers =
            [("M", self.pot), ("Mt", self.tray), ("F", self.feed), ("za", za), ("zw", zw)];
        numbers.map(|(name, value)| (name.to_owned(), value)).into()
    }

    by_rates!(AcetoneColumn, pressure);
}
