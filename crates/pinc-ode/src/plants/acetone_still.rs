//! A still for acetone, methanol and water: a boiling point is solved for at every call.

use crate::{Plant, Variable};
use pinc_ad::{Dual, Scalar};

/// Acetone, methanol, water.
const COMPONENTS: usize = 3;

/// Newton steps on plain numbers for the boiling point. From the start below three leave an error of
/// 1e-11 K at the worst composition, pure water. The fourth is for the slope there, which the derivatives
/// need as exact; the last step, on the full kind of number, comes on top.
const NEWTON_STEPS: usize = 4;

/// The Newton iteration starts from this temperature, in K, whatever the composition.
const START_K: f64 = 340.0;

/// The gas constant, in cal/(mol K), the unit of the interaction energies.
const GAS_CONSTANT: f64 = 1.987_21;

/// 0 degrees Celsius, in K.
const CELSIUS: f64 = 273.15;

/// NRTL interaction energies `b_ij`, in cal/mol.
const INTERACTION: [[f64; COMPONENTS]; COMPONENTS] =
    [[0.0, 184.70, 631.05], [222.64, 0.0, -253.88], [1197.41, 845.21, 0.0]];

/// NRTL nonrandomness `alpha_ij`.
const NONRANDOMNESS: [[f64; COMPONENTS]; COMPONENTS] =
    [[0.0, 0.3084, 0.5343], [0.3084, 0.0, 0.2994], [0.5343, 0.2994, 0.0]];

/// Antoine's A, B, C for ln(p/kPa) = A - B / (t + C), t in degrees Celsius.
const ANTOINE: [[f64; 3]; COMPONENTS] =
    [[14.3145, 2756.22, 228.060], [16.5785, 3638.27, 239.500], [16.3872, 3885.70, 230.170]];

/// Heats of vaporization at the normal boiling points, in kJ/mol.
const VAPORIZATION: [f64; COMPONENTS] = [29.10, 35.21, 40.66];

/// A still that strips acetone and methanol from water, continuously, at constant pressure:
///
/// ```text
/// M xa' = F (za - xa) + W (0 - xa) - V (ya - xa)
/// M xm' = F (zm - xm) + W (0 - xm) - V (ym - xm)        V = Q / sum_i y_i dH_i
/// ```
///
/// x are mole fractions in the boiling liquid (xw = 1 - xa - xm), y those in the vapour above it. The
/// feed F is of composition z, the stream W of pure water; the level, and with it M, is held by the
/// bottoms F + W - V. The vapour is in equilibrium with the liquid at the boiling point T:
///
/// ```text
/// y_i P = x_i gamma_i(x, T) p_i(T),    sum_i y_i = 1
/// ln gamma_i = C_i + sum_j x_j G_ij / S_j (tau_ij - C_j)
/// S_j = sum_k x_k G_kj    C_j = sum_k x_k tau_kj G_kj / S_j    tau_ij = b_ij / (R T)    G_ij = exp(-alpha_ij tau_ij)
/// ```
///
/// (gamma by the NRTL equation, p by Antoine's.) The equation for T is solved at every call, by Newton's
/// method in 1/T, in which it is nearly linear; the derivatives are those of the implicit function theorem, exact to
/// first order. This makes the plant expensive, as plants with property calculations are: a call costs
/// some hundred times that of the Van der Pol oscillator.
///
/// Thermodynamic data: Smith, Van Ness and Abbott, *Introduction to Chemical Engineering
/// Thermodynamics*, 7th edition, table 12.5 (NRTL) and table B.2 (Antoine, heats of vaporization). The still, of pilot
/// size, is this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AcetoneStill {
    /// The holdup M, in mol.
    pub holdup: f64,
    /// Mole fractions of acetone and methanol in the feed.
    pub feed: [f64; 2],
    /// The stream of water W, in mol/s.
    pub water: f64,
    /// The pressure P, in kPa.
    pub pressure: f64,
}

impl Default for AcetoneStill {
    /// 1 kmol under atmospheric pressure, fed with as much acetone as methanol.
    fn default() -> Self {
        Self { holdup: 1000.0, feed: [0.5, 0.5], water: 3.0, pressure: 101.325 }
    }
}

/// A boiling liquid.
#[derive(Clone, Copy, Debug)]
struct Boiling<S> {
    /// Mole fractions in the vapour.
    vapour: [S; COMPONENTS],
    /// 1/T, in 1/K.
    inverse_temperature: S,
}

impl AcetoneStill {
    /// The boiling point in K of a liquid with the mole fractions `acetone` and `methanol`.
    #[must_use]
    pub fn boiling_point(&self, acetone: f64, methanol: f64) -> f64 {
        1.0 / self.boil([acetone, methanol, 1.0 - acetone - methanol]).inverse_temperature
    }

    /// The liquid x at its boiling point.
    #[inline(always)]
    fn boil<S: Scalar>(&self, x: [S; COMPONENTS]) -> Boiling<S> {
        let plain = x.map(S::plain);
        let lifted = plain.map(Dual::<S::Plain>::lift);
        let mut z = plain[0].constant(1.0 / START_K);
        let mut slope = z;
        let mut pressure_slopes = plain;
        for _ in 0..NEWTON_STEPS {
            let pressures = partial_pressures(lifted, Dual::variable(z, 0));
            let excess = ((pressures[0] + pressures[1] + pressures[2]) / self.pressure).ln();
            pressure_slopes = pressures.map(|p| p.eps[0]);
            slope = excess.eps[0];
            z = z - excess.re / slope;
        }
        // One more step, with derivatives: dz = - g(x, z) / g_z, and along it y.
        let z = x[0].constants(z);
        let pressures = partial_pressures(x, z);
        let excess = ((pressures[0] + pressures[1] + pressures[2]) / self.pressure).ln();
        let step = -(excess / z.constants(slope));
        let vapour = std::array::from_fn(|i| {
            z.constants(pressure_slopes[i]).mul_add(step, pressures[i]) / self.pressure
        });
        Boiling { vapour, inverse_temperature: z + step }
    }
}

/// The partial pressures in kPa over a liquid x at the temperature 1/z.
#[inline(always)]
fn partial_pressures<S: Scalar>(x: [S; COMPONENTS], z: S) -> [S; COMPONENTS] {
    let tau = |i: usize, j: usize| z * (INTERACTION[i][j] / GAS_CONSTANT);
    let g: [[S; COMPONENTS]; COMPONENTS] = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            if i == j {
                z.constant(1.0)
            } else {
                (z * (-NONRANDOMNESS[i][j] * INTERACTION[i][j] / GAS_CONSTANT)).exp()
            }
        })
    });
    let zero = z.constant(0.0);
    let mut share = [zero; COMPONENTS];
    let mut mean = [zero; COMPONENTS];
    for j in 0..COMPONENTS {
        let (mut s, mut t) = (zero, zero);
        for k in 0..COMPONENTS {
            let weight = x[k] * g[k][j];
            s = s + weight;
            if k != j {
                t = tau(k, j).mul_add(weight, t);
            }
        }
        share[j] = x[j] / s;
        mean[j] = t / s;
    }
    let celsius = z.constant(1.0) / z - CELSIUS;
    std::array::from_fn(|i| {
        let mut ln_gamma = mean[i];
        for j in 0..COMPONENTS {
            ln_gamma = (share[j] * g[i][j]).mul_add(tau(i, j) - mean[j], ln_gamma);
        }
        let [a, b, c] = ANTOINE[i];
        let ln_vapour_pressure = -(z.constant(b) / (celsius + c)) + a;
        x[i] * (ln_gamma + ln_vapour_pressure).exp()
    })
}

impl Plant for AcetoneStill {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("xa", ""), Variable::new("xm", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("F", "mol/s"), Variable::new("Q", "kW")];
        &VARIABLES
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        let [acetone, methanol] = [x[0], x[1]];
        let water = -(acetone + methanol) + 1.0;
        let y = self.boil([acetone, methanol, water]).vapour;
        let heat = y[0] * VAPORIZATION[0] + y[1] * VAPORIZATION[1] + y[2] * VAPORIZATION[2];
        let (feed, vapour) = (u[0], u[1] / heat);
        for i in 0..2 {
            let gain = feed * (-x[i] + self.feed[i]) - x[i] * self.water - vapour * (y[i] - x[i]);
            dx[i] = gain * (1.0 / self.holdup);
        }
    }
}
