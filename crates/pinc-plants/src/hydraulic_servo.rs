//! An electro-hydraulic servo axis: a stiff plant.

use pinc_ad::Scalar;
use pinc_ode::{Plant, Variable};

/// Below this opening the spool counts as closed half-way: it makes the change from one pair of
/// control edges to the other smooth.
const OPENING: f64 = 1e-3;

/// Pa per MPa.
const MEGA: f64 = 1e6;

/// A mass moved by a double-rod cylinder, under a four-way servo valve:
///
/// ```text
/// x' = v
/// m v' = A p - b v - Fc tanh(v / vc)
/// V / (4 beta) p' = q(s, p) - A v - c p          q = s+ K r(ps - p) - s- K r(ps + p)
/// tau s' = u - s                                 r(d) = d / (d^2 + d0^2)^(1/4)
/// ```
///
/// x is the position, v the speed, p the load pressure (the difference between the chambers), s the
/// opening of the valve as a share of the full one, u the opening commanded; s+ and s- are the
/// positive and the negative part of s, rounded off at 0. The orifice law r is the turbulent one,
/// sqrt(d), above the pressure difference d0 and laminar below.
///
/// It is stiff: an open valve and a small volume of oil make the pressure follow the speed within
/// some 0.2 ms (an eigenvalue of down to -5000/s), while the mass on the oil's spring swings with
/// 300 rad/s.
///
/// Equations: Merritt, *Hydraulic Control Systems* (1967), sections 6.1 and 7.1. The numbers, those
/// of a short axis with a heavy load, are this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HydraulicServo {
    /// The mass m, in kg.
    pub mass: f64,
    /// The piston's area A, in m^2.
    pub area: f64,
    /// The volume V of oil in both chambers, in m^3.
    pub volume: f64,
    /// The bulk modulus beta, in MPa.
    pub bulk_modulus: f64,
    /// The supply pressure ps, in MPa.
    pub supply: f64,
    /// The valve's coefficient K, in m^3/s per sqrt(MPa).
    pub valve: f64,
    /// The pressure difference d0 of the change from laminar to turbulent flow, in MPa.
    pub transition: f64,
    /// The leakage c, in m^3/s per MPa.
    pub leakage: f64,
    /// Viscous friction b, in N s/m.
    pub viscous: f64,
    /// Coulomb friction Fc, in N.
    pub coulomb: f64,
    /// The speed vc over which Coulomb friction turns round, in m/s.
    pub turn: f64,
    /// The spool's time constant tau, in s.
    pub lag: f64,
}

impl Default for HydraulicServo {
    /// 1 t on a piston of 10 cm^2 at 21 MPa, under a large valve.
    fn default() -> Self {
        Self {
            mass: 1000.0,
            area: 1e-3,
            volume: 6e-5,
            bulk_modulus: 1400.0,
            supply: 21.0,
            valve: 3e-4,
            transition: 0.5,
            leakage: 4e-7,
            viscous: 2000.0,
            coulomb: 400.0,
            turn: 0.02,
            lag: 2e-3,
        }
    }
}

impl HydraulicServo {
    /// The flow in m^3/s into the cylinder, less what comes back, at the opening `s` and the load
    /// pressure `p`.
    #[inline(always)]
    fn flow<S: Scalar>(&self, s: S, p: S) -> S {
        let magnitude = (s * s + OPENING * OPENING).sqrt();
        let forward = (magnitude + s) * self.orifice(-p + self.supply);
        let backward = (magnitude - s) * self.orifice(p + self.supply);
        (forward - backward) * (0.5 * self.valve)
    }

    /// The orifice law r(d).
    #[inline(always)]
    fn orifice<S: Scalar>(&self, d: S) -> S {
        d / (d * d + self.transition * self.transition).sqrt().sqrt()
    }
}

impl Plant for HydraulicServo {
    const COLUMNS: Option<usize> = Some(5);

    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 4] = [
            Variable::new("x", "m"),
            Variable::new("v", "m/s"),
            Variable::new("p", "MPa"),
            Variable::new("s", ""),
        ];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let (v, p, s) = (x[1], x[2], x[3]);
        let friction = v * self.viscous + (v / self.turn).tanh() * self.coulomb;
        let stiffness = 4.0 * self.bulk_modulus / self.volume;
        dx[0] = v;
        dx[1] = (p * (MEGA * self.area) - friction) / self.mass;
        dx[2] = (self.flow(s, p) - v * self.area - p * self.leakage) * stiffness;
        dx[3] = (u[0] - s) / self.lag;
    }
}
