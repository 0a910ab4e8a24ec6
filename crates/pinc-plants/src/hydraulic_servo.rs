//! An electro-hydraulic servo axis: a stiff plant.

use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

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
/// Equations: Merritt, *Hydraulic Control Systems* (1967), sections 6.1 and 7.1. The numbers, for a
/// short axis with a heavy load, are this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HydraulicServo<K = f64> {
    /// The mass m, in kg.
    pub mass: K,
    /// The piston's area A, in m^2.
    pub area: K,
    /// The volume V of oil in both chambers, in m^3.
    pub volume: K,
    /// The bulk modulus beta, in MPa.
    pub bulk_modulus: K,
    /// The supply pressure ps, in MPa.
    pub supply: K,
    /// The valve's coefficient K, in m^3/s per sqrt(MPa).
    pub valve: K,
    /// The pressure difference d0 of the change from laminar to turbulent flow, in MPa.
    pub transition: K,
    /// The leakage c, in m^3/s per MPa.
    pub leakage: K,
    /// Viscous friction b, in N s/m.
    pub viscous: K,
    /// Coulomb friction Fc, in N.
    pub coulomb: K,
    /// The speed vc over which Coulomb friction turns round, in m/s.
    pub turn: K,
    /// The spool's time constant tau, in s.
    pub lag: K,
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

impl<K: Scalar> HydraulicServo<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K]) -> Self {
        Self {
            mass: constants[0],
            area: constants[1],
            volume: constants[2],
            bulk_modulus: constants[3],
            supply: constants[4],
            valve: constants[5],
            transition: constants[6],
            leakage: constants[7],
            viscous: constants[8],
            coulomb: constants[9],
            turn: constants[10],
            lag: constants[11],
        }
    }

    /// The flow in m^3/s into the cylinder, less what comes back, at the opening `s` and the load
    /// pressure `p`.
    #[inline(always)]
    fn flow<S: Over<K>>(&self, s: S, p: S) -> S {
        let magnitude = (s * s + OPENING * OPENING).sqrt();
        let forward = (magnitude + s) * self.orifice(-p + self.supply);
        let backward = (magnitude - s) * self.orifice(p + self.supply);
        (forward - backward) * (self.valve * 0.5)
    }

    /// The orifice law r(d).
    #[inline(always)]
    fn orifice<S: Over<K>>(&self, d: S) -> S {
        d / (d * d + self.transition * self.transition).sqrt().sqrt()
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        let (v, p, s) = (x[1], x[2], x[3]);
        let friction = v * self.viscous + (v / self.turn).tanh() * self.coulomb;
        let stiffness = self.bulk_modulus * 4.0 / self.volume;
        dx[0] = v;
        dx[1] = (p * (self.area * MEGA) - friction) / self.mass;
        dx[2] = (self.flow(s, p) - v * self.area - p * self.leakage) * stiffness;
        dx[3] = (u[0] - s) / self.lag;
    }
}

impl Plant for HydraulicServo {
    const COLUMNS: Option<usize> = Some(5);

    fn states(&self) -> &[Variable] {
        const {
            &[
                Variable::new("x", "m"),
                Variable::new("v", "m/s"),
                Variable::new("p", "MPa"),
                Variable::new("s", ""),
            ]
        }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u", "")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let numbers = [
            ("mass", self.mass),
            ("area", self.area),
            ("volume", self.volume),
            ("bulk_modulus", self.bulk_modulus),
            ("supply", self.supply),
            ("valve", self.valve),
            ("transition", self.transition),
            ("leakage", self.leakage),
            ("viscous", self.viscous),
            ("coulomb", self.coulomb),
            ("turn", self.turn),
            ("lag", self.lag),
        ];
        numbers.map(|(name, value)| (name.to_owned(), value)).into()
    }

    by_rates!(HydraulicServo);
}
