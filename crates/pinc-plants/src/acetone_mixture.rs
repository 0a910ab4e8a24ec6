//! Acetone, methanol and water in equilibrium with their vapour.

use pinc_ad::simd::Work;
use pinc_ad::{Dual, Scalar};

/// Acetone, methanol, water.
pub(crate) const COMPONENTS: usize = 3;

/// Newton steps on plain numbers for the boiling point. From the start below three leave an error
/// of 1e-11 K at the worst composition, pure water. The fourth is for the slope there, which the
/// derivatives need as exact; the last step, on the full kind of number, comes on top.
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

/// A boiling liquid.
///
/// The vapour is in equilibrium with the liquid at the boiling point T:
///
/// ```text
/// y_i P = x_i gamma_i(x, T) p_i(T),    sum_i y_i = 1
/// ln gamma_i = C_i + sum_j x_j G_ij / S_j (tau_ij - C_j)
/// S_j = sum_k x_k G_kj    C_j = sum_k x_k tau_kj G_kj / S_j
/// tau_ij = b_ij / (R T)    G_ij = exp(-alpha_ij tau_ij)
/// ```
///
/// (gamma by the NRTL equation, p by Antoine's.) The equation for T is solved at every call, by
/// Newton's method in 1/T, in which it is nearly linear; the derivatives are those of the implicit
/// function theorem, exact to first order.
///
/// Data: Smith, Van Ness and Abbott, *Introduction to Chemical Engineering Thermodynamics*, 7th
/// edition, table 12.5 (NRTL) and table B.2 (Antoine, heats of vaporization).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Boiling<S> {
    /// Mole fractions in the vapour.
    pub(crate) vapour: [S; COMPONENTS],
    /// 1/T, in 1/K.
    pub(crate) inverse_temperature: S,
}

impl<S: Scalar> Boiling<S> {
    /// The heat of vaporization of the vapour, in kJ/mol.
    #[inline(always)]
    pub(crate) fn heat(&self) -> S {
        let [a, m, w] = self.vapour;
        a * VAPORIZATION[0] + m * VAPORIZATION[1] + w * VAPORIZATION[2]
    }
}

/// The liquid of mole fractions x at its boiling point under a pressure in kPa. Too long to be
/// inlined wherever a plant's equation is.
#[inline(always)]
pub(crate) fn boil<S: Scalar>(x: [S; COMPONENTS], pressure: f64) -> Boiling<S> {
    x[0].vectorize(Boil { x, pressure })
}

struct Boil<S> {
    x: [S; COMPONENTS],
    pressure: f64,
}

impl<S: Scalar> Work for Boil<S> {
    type Output = Boiling<S>;

    #[inline(always)]
    fn run(self) -> Boiling<S> {
        let Self { x, pressure } = self;
        let mut z = x[0].plain().constant(1.0 / START_K);
        let mut lifted = [Dual::<S::Plain>::lift(z); COMPONENTS];
        for (lifted, x) in lifted.iter_mut().zip(x) {
            *lifted = Dual::lift(x.plain());
        }
        let mut slope = z;
        let mut pressure_slopes = [z; COMPONENTS];
        for _ in 0..NEWTON_STEPS {
            let pressures = partial_pressures(lifted, Dual::variable(z, 0));
            let excess = ((pressures[0] + pressures[1] + pressures[2]) / pressure).ln();
            for (slope, pressure) in pressure_slopes.iter_mut().zip(pressures) {
                *slope = pressure.eps[0];
            }
            slope = excess.eps[0];
            z = z - excess.re / slope;
        }
        // One more step, with derivatives: dz = - g(x, z) / g_z, and along it y.
        let z = x[0].constants(z);
        let pressures = partial_pressures(x, z);
        let excess = ((pressures[0] + pressures[1] + pressures[2]) / pressure).ln();
        let step = -(excess / z.constants(slope));
        let mut vapour = pressures;
        for (y, slope) in vapour.iter_mut().zip(pressure_slopes) {
            *y = z.constants(slope).mul_add(step, *y) / pressure;
        }
        Boiling { vapour, inverse_temperature: z + step }
    }
}

/// The partial pressures in kPa over a liquid x at the temperature 1/z. (Loops, since `array::map`,
/// `from_fn` and closures are not sure to be inlined into SIMD code.)
#[inline(always)]
fn partial_pressures<S: Scalar>(x: [S; COMPONENTS], z: S) -> [S; COMPONENTS] {
    let mut g = [[z.constant(1.0); COMPONENTS]; COMPONENTS];
    let mut tau = [[z.constant(0.0); COMPONENTS]; COMPONENTS];
    for i in 0..COMPONENTS {
        for j in (0..COMPONENTS).filter(|&j| j != i) {
            tau[i][j] = z * (INTERACTION[i][j] / GAS_CONSTANT);
            g[i][j] = (z * (-NONRANDOMNESS[i][j] * INTERACTION[i][j] / GAS_CONSTANT)).exp();
        }
    }
    let zero = z.constant(0.0);
    let mut share = [zero; COMPONENTS];
    let mut mean = [zero; COMPONENTS];
    for j in 0..COMPONENTS {
        let (mut s, mut t) = (zero, zero);
        for k in 0..COMPONENTS {
            let weight = x[k] * g[k][j];
            s = s + weight;
            if k != j {
                t = tau[k][j].mul_add(weight, t);
            }
        }
        share[j] = x[j] / s;
        mean[j] = t / s;
    }
    let celsius = z.constant(1.0) / z - CELSIUS;
    let mut pressures = x;
    for i in 0..COMPONENTS {
        let mut ln_gamma = mean[i];
        for j in 0..COMPONENTS {
            ln_gamma = (share[j] * g[i][j]).mul_add(tau[i][j] - mean[j], ln_gamma);
        }
        let [a, b, c] = ANTOINE[i];
        let ln_vapour_pressure = -(z.constant(b) / (celsius + c)) + a;
        pressures[i] = x[i] * (ln_gamma + ln_vapour_pressure).exp();
    }
    pressures
}
