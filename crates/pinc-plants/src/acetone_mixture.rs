//! Acetone, methanol and water in equilibrium with their vapour.

use pinc_ad::simd::Work;
use pinc_ad::{Dual, ImplicitEquations, Scalar};

/// Acetone, methanol, water.
pub(crate) const COMPONENTS: usize = 3;

/// Newton steps on plain numbers for the boiling point at a pressure near [`NORMAL_KPA`]. From a
/// start that is wrong by 0.14 K they leave an error of 1e-13 K, so that the derivatives are exact
/// there. A last step, which carries the derivatives, comes on top.
const NEWTON_STEPS: usize = 2;

/// Newton steps at other pressures, where the start is wrong by some K.
const FAR_STEPS: usize = 4;

/// The pressure of [`START`], in kPa.
const NORMAL_KPA: f64 = 101.325;

/// Pressures whose logarithm differs by less than this from the logarithm of [`NORMAL_KPA`] are
/// near it.
const NEAR_NORMAL: f64 = 0.01;

/// How 1/T in 1/K goes down with the logarithm of the pressure, nearly: the heat of vaporization of
/// the mixture's components over the gas constant, in K.
const CLAUSIUS_CLAPEYRON: f64 = 4300.0;

/// 1/T of the boiling liquid at [`NORMAL_KPA`], to 0.14 K, is a quotient of two cubic forms in the
/// mole fractions. Of each monomial the powers of acetone, methanol and water, and its
/// coefficients in both forms. `tests/data/start.py` fits them.
const START: [([usize; COMPONENTS], [f64; 2]); 10] = [
    ([0, 0, 3], [0.002_679_06, 1.0]),
    ([0, 1, 2], [0.025_131_1, 8.883_43]),
    ([0, 2, 1], [0.051_931, 18.020_4]),
    ([0, 3, 0], [0.029_103_8, 9.832_72]),
    ([1, 0, 2], [0.057_546_8, 19.041_4]),
    ([1, 1, 1], [0.239_433, 82.483_6]),
    ([1, 2, 0], [0.279_05, 93.051_2]),
    ([2, 0, 1], [0.243_44, 82.826_8]),
    ([2, 1, 0], [0.364_367, 118.816]),
    ([3, 0, 0], [0.312_743, 102.96]),
];

/// Where 1/T is looked for, in 1/K: from 600 K to 200 K.
const INVERSE_TEMPERATURES: [f64; 2] = [1.0 / 600.0, 1.0 / 200.0];

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
/// Newton's method in 1/T, in which it is nearly linear; the derivatives follow from the implicit
/// function theorem.
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
    /// At the boiling point 1/z.
    #[inline(always)]
    fn at(x: [S; COMPONENTS], z: S, pressure: f64) -> Self {
        let mut vapour = partial_pressures(x, &Volatility::new(z));
        for y in &mut vapour {
            *y = *y / pressure;
        }
        Self { vapour, inverse_temperature: z }
    }

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
        let mut plain = [x[0].plain(); COMPONENTS];
        for (plain, x) in plain.iter_mut().zip(x) {
            *plain = x.plain();
        }
        let change = (pressure / NORMAL_KPA).ln();
        let mut z = start(plain) - change / CLAUSIUS_CLAPEYRON;
        if let Some([z]) = S::declare(&BoilingPoint { pressure }, &x, [z], &[INVERSE_TEMPERATURES])
        {
            return Boiling::at(x, z, pressure);
        }
        let steps = if change.abs() < NEAR_NORMAL { NEWTON_STEPS } else { FAR_STEPS };
        // The last step, to first order, is exact enough for values.
        let steps = if const { S::ORDER == 0 } { steps - 1 } else { steps };
        for _ in 0..steps {
            let sum =
                sum(&partial_pressures(lifted(plain), &Volatility::new(Dual::variable(z, 0))));
            z = z - newton_step(sum.re, sum.eps[0], pressure);
        }
        if const { S::ORDER == 1 } {
            first_order(x, plain, z, pressure)
        } else {
            any_order(x, plain, z, pressure)
        }
    }
}

/// 0 = 2 (s - P)/(s + P) for 1/T, where s is the sum of the partial pressures.
struct BoilingPoint {
    pressure: f64,
}

impl ImplicitEquations<COMPONENTS, 1> for BoilingPoint {
    #[inline(always)]
    fn residuals<S: Scalar>(&self, x: &[S; COMPONENTS], [z]: &[S; 1], [g]: &mut [S; 1]) {
        let sum = sum(&partial_pressures(*x, &Volatility::new(*z)));
        *g = (sum - self.pressure) * 2.0 / (sum + self.pressure);
    }
}

/// An approximate 1/T. Fractions below 0 count as 0.
#[inline(always)]
fn start<V: Scalar>(x: [V; COMPONENTS]) -> V {
    let zero = x[0].constant(0.0);
    let mut powers = [[zero.constant(1.0); 4]; COMPONENTS];
    for (powers, x) in powers.iter_mut().zip(x) {
        let fraction = x.where_nonpositive(zero, x);
        for i in 1..powers.len() {
            powers[i] = powers[i - 1] * fraction;
        }
    }
    let mut forms = [zero; 2];
    for ([a, m, w], coefficients) in START {
        let monomial = powers[0][a] * powers[1][m] * powers[2][w];
        for (form, coefficient) in forms.iter_mut().zip(coefficients) {
            *form = monomial.mul_add(zero.constant(coefficient), *form);
        }
    }
    forms[0] / forms[1]
}

/// A step of Newton's method for 2 (s - P)/(s + P) = 0, where s is the sum of the partial
/// pressures: nearly ln(s/P), which is nearly linear in z.
#[inline(always)]
fn newton_step<V: Scalar>(sum: V, slope: V, pressure: f64) -> V {
    sum.mul_add(sum, sum.constant(-pressure * pressure)) / (slope * (2.0 * pressure))
}

#[inline(always)]
fn sum<S: Scalar>([a, m, w]: &[S; COMPONENTS]) -> S {
    *a + *m + *w
}

/// Fractions as constants.
#[inline(always)]
fn lifted<V: Scalar>(x: [V; COMPONENTS]) -> [Dual<V>; COMPONENTS] {
    let mut lifted = [Dual::lift(x[0]); COMPONENTS];
    for (lifted, x) in lifted.iter_mut().zip(x) {
        *lifted = Dual::lift(x);
    }
    lifted
}

/// The last step for numbers with first derivatives: the derivatives of the step's result by the
/// fractions, on plain numbers, times the derivatives of the fractions.
#[inline(always)]
fn first_order<S: Scalar>(
    x: [S; COMPONENTS],
    plain: [S::Plain; COMPONENTS],
    z: S::Plain,
    pressure: f64,
) -> Boiling<S> {
    // Direction 0 is z, those after it are the fractions.
    let mut fractions = [Dual::<S::Plain, 4>::lift(z); COMPONENTS];
    for (i, (to, x)) in fractions.iter_mut().zip(plain).enumerate() {
        *to = Dual::variable(x, 1 + i);
    }
    let volatility = Volatility::new(Dual::<S::Plain>::variable(z, 0)).lifted();
    let pressures = partial_pressures(fractions, &volatility);
    let sum = sum(&pressures);
    let step = -newton_step(sum.re, sum.eps[0], pressure);
    let inverse = -(z.constant(1.0) / sum.eps[0]);
    let mut slopes = sum.eps;
    for slope in &mut slopes {
        *slope = *slope * inverse;
    }
    let mut changes = x;
    for (change, plain) in changes.iter_mut().zip(plain) {
        *change = *change - change.constants(plain);
    }
    let mut inverse_temperature = x[0].constants(z + step);
    for (change, slope) in changes.iter().zip(&slopes[1..]) {
        inverse_temperature = change.constants(*slope).mul_add(*change, inverse_temperature);
    }
    let mut vapour = x;
    for (y, p) in vapour.iter_mut().zip(pressures) {
        *y = y.constants(p.eps[0].mul_add(step, p.re) * (1.0 / pressure));
        for j in 0..COMPONENTS {
            let slope = p.eps[0].mul_add(slopes[1 + j], p.eps[1 + j]) * (1.0 / pressure);
            *y = y.constants(slope).mul_add(changes[j], *y);
        }
    }
    Boiling { vapour, inverse_temperature }
}

/// The last step, or as many as the kind of number has orders of derivatives: of each, the first
/// order that was wrong before it becomes right.
#[inline(always)]
fn any_order<S: Scalar>(
    x: [S; COMPONENTS],
    plain: [S::Plain; COMPONENTS],
    z: S::Plain,
    pressure: f64,
) -> Boiling<S> {
    let along = partial_pressures(lifted(plain), &Volatility::new(Dual::variable(z, 0)));
    let along_z = sum(&along);
    let mut vapour = x;
    if S::ORDER == 0 {
        let step = -newton_step(along_z.re, along_z.eps[0], pressure);
        for (y, p) in vapour.iter_mut().zip(along) {
            *y = y.constants(p.eps[0].mul_add(step, p.re) * (1.0 / pressure));
        }
        return Boiling { vapour, inverse_temperature: x[0].constants(z + step) };
    }
    let slope = x[0].constants(along_z.eps[0]);
    let mut z = x[0].constants(z);
    for _ in 0..S::ORDER {
        z = z - newton_step(sum(&partial_pressures(x, &Volatility::new(z))), slope, pressure);
    }
    Boiling::at(x, z, pressure)
}

/// What depends on the temperature alone. (Loops, since `array::map`, `from_fn` and closures are
/// not sure to be inlined into SIMD code.)
struct Volatility<S> {
    tau: [[S; COMPONENTS]; COMPONENTS],
    g: [[S; COMPONENTS]; COMPONENTS],
    /// The logarithm of the components' vapour pressures in kPa.
    ln_pressure: [S; COMPONENTS],
}

impl<S: Scalar> Volatility<S> {
    /// At the temperature 1/z.
    #[inline(always)]
    fn new(z: S) -> Self {
        let mut tau = [[z.constant(0.0); COMPONENTS]; COMPONENTS];
        let mut g = [[z.constant(1.0); COMPONENTS]; COMPONENTS];
        for i in 0..COMPONENTS {
            for j in (0..COMPONENTS).filter(|&j| j != i) {
                tau[i][j] = z * (INTERACTION[i][j] / GAS_CONSTANT);
                g[i][j] = (z * (-NONRANDOMNESS[i][j] * INTERACTION[i][j] / GAS_CONSTANT)).exp();
            }
        }
        let mut ln_pressure = [z; COMPONENTS];
        for (ln_pressure, [a, b, c]) in ln_pressure.iter_mut().zip(ANTOINE) {
            // B/(t + C) = B z/(1 + (C - 273.15) z), with t = 1/z - 273.15
            let share = b / (c - CELSIUS);
            let inverse = z.constant(1.0) / (z * (c - CELSIUS) + 1.0);
            *ln_pressure = inverse * share + (a - share);
        }
        Self { tau, g, ln_pressure }
    }
}

impl<V: Scalar> Volatility<Dual<V>> {
    /// With room for more derivatives.
    #[inline(always)]
    fn lifted<const N: usize>(&self) -> Volatility<Dual<V, N>> {
        let mut lifted = Volatility {
            tau: [[lifted_number(self.tau[0][0]); COMPONENTS]; COMPONENTS],
            g: [[lifted_number(self.g[0][0]); COMPONENTS]; COMPONENTS],
            ln_pressure: [lifted_number(self.ln_pressure[0]); COMPONENTS],
        };
        for i in 0..COMPONENTS {
            for j in 0..COMPONENTS {
                lifted.tau[i][j] = lifted_number(self.tau[i][j]);
                lifted.g[i][j] = lifted_number(self.g[i][j]);
            }
            lifted.ln_pressure[i] = lifted_number(self.ln_pressure[i]);
        }
        lifted
    }
}

/// A derivative in one direction as the first of several.
#[inline(always)]
fn lifted_number<V: Scalar, const N: usize>(number: Dual<V>) -> Dual<V, N> {
    let mut lifted = Dual::lift(number.re);
    lifted.eps[0] = number.eps[0];
    lifted
}

/// The partial pressures in kPa over a liquid x.
#[inline(always)]
fn partial_pressures<S: Scalar>(x: [S; COMPONENTS], at: &Volatility<S>) -> [S; COMPONENTS] {
    let Volatility { tau, g, ln_pressure } = at;
    let zero = x[0].constant(0.0);
    let mut share = [zero; COMPONENTS];
    let mut mean = [zero; COMPONENTS];
    for j in 0..COMPONENTS {
        let (mut s, mut t) = (x[j], zero);
        for k in (0..COMPONENTS).filter(|&k| k != j) {
            let weight = x[k] * g[k][j];
            s = s + weight;
            t = tau[k][j].mul_add(weight, t);
        }
        let inverse = zero.constant(1.0) / s;
        share[j] = x[j] * inverse;
        mean[j] = t * inverse;
    }
    let mut pressures = x;
    for i in 0..COMPONENTS {
        let mut ln_gamma = mean[i];
        for j in 0..COMPONENTS {
            if j == i {
                ln_gamma = ln_gamma - share[j] * mean[j];
            } else {
                ln_gamma = (share[j] * g[i][j]).mul_add(tau[i][j] - mean[j], ln_gamma);
            }
        }
        pressures[i] = x[i] * (ln_gamma + ln_pressure[i]).exp();
    }
    pressures
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Liquids all over the triangle of compositions, its edges and corners included.
    fn liquids() -> impl Iterator<Item = [f64; COMPONENTS]> {
        let part = |i: i32| 0.5 * (1.0 - (f64::from(i) * std::f64::consts::PI / 20.0).cos());
        (0..=20).flat_map(move |i| {
            (0..=20).map(move |j| {
                let (acetone, rest) = (part(i), 1.0 - part(i));
                [acetone, rest * part(j), rest * (1.0 - part(j))]
            })
        })
    }

    #[test]
    fn the_start_is_near() {
        for x in liquids() {
            let boiling = 1.0 / boil(x, NORMAL_KPA).inverse_temperature;
            let error = 1.0 / start(x) - boiling;
            assert!(error.abs() < 0.14, "{x:?}: {error} K at {boiling} K");
        }
    }

    /// The fractions in the vapour sum to 1 at any pressure, and their derivatives of first order
    /// are those that numbers with derivatives of second order have. Values alone, which take a
    /// step less, are the same.
    #[test]
    fn solved_exactly() {
        for pressure in [NORMAL_KPA, 101.0, 50.0, 200.0] {
            for x in liquids() {
                let mut once = [Dual::<f64, 3>::lift(0.0); COMPONENTS];
                let mut twice = [Dual::<Dual<f64, 3>, 1>::lift(once[0]); COMPONENTS];
                for (i, &x) in x.iter().enumerate() {
                    once[i] = Dual::variable(x, i);
                    twice[i] = Dual::lift(once[i]);
                }
                let (once, twice) = (boil(once, pressure), boil(twice, pressure));
                let plain = boil(x, pressure);
                let error = plain.inverse_temperature / once.inverse_temperature.re - 1.0;
                assert!(error.abs() < 1e-14, "{x:?}, {pressure}: {error:e}");
                for (y, expected) in plain.vapour.iter().zip(once.vapour) {
                    let error = y - expected.re;
                    assert!(error.abs() < 1e-13, "{x:?}, {pressure}: {error:e}");
                }
                let total = sum(&once.vapour).re;
                assert!((total - 1.0).abs() < 1e-13, "{x:?}, {pressure}: {total}");
                for (y, expected) in once.vapour.iter().zip(twice.vapour) {
                    for (slope, expected) in y.eps.iter().zip(expected.re.eps) {
                        let error = slope - expected;
                        assert!(error.abs() < 1e-11 * (1.0 + expected.abs()), "{x:?}: {error}");
                    }
                }
            }
        }
    }
}
