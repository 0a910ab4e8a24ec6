//! A manipulator with two links.

use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// Gravitational acceleration in m/s^2.
const GRAVITY: f64 = 9.81;

/// A manipulator of two uniform rods in a vertical plane, with a torque at each joint:
///
/// ```text
/// H(q2) q'' + c(q2, q') + g(q) = u
/// H = [ a1 + 2 a3 cos q2   a2 + a3 cos q2 ]    c = a3 sin q2 [ -2 w1 w2 - w2^2 ]
///     [ a2 + a3 cos q2     a2             ]                  [  w1^2           ]
/// ```
///
/// q1 is the angle of the first link above the horizontal, q2 the angle of the second against the
/// first, w = q'. The plant is smooth and cheap to integrate.
///
/// Source: Spong, Hutchinson and Vidyasagar, *Robot Modeling and Control*, section on the planar
/// elbow manipulator. The numbers are this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLinkArm<K = f64> {
    /// The links' masses, in kg.
    pub masses: [K; 2],
    /// The links' lengths, in m.
    pub lengths: [K; 2],
}

impl Default for TwoLinkArm {
    /// Links of 1 kg and 0.5 m.
    fn default() -> Self {
        Self { masses: [1.0, 1.0], lengths: [0.5, 0.5] }
    }
}

impl<K: Scalar> TwoLinkArm<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K]) -> Self {
        Self { masses: [constants[0], constants[1]], lengths: [constants[2], constants[3]] }
    }

    /// a1, a2, a3 in kg m^2: moments of inertia of rods, m l^2 / 3 about an end.
    #[inline(always)]
    fn inertias(&self) -> [K; 3] {
        let ([m1, m2], [l1, l2]) = (self.masses, self.lengths);
        let second = m2 * l2 * l2 / 3.0;
        [m1 * l1 * l1 / 3.0 + m2 * l1 * l1 + second, second, m2 * l1 * l2 / 2.0]
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        let [q1, q2, w1, w2] = [x[0], x[1], x[2], x[3]];
        let [a1, a2, a3] = self.inertias();
        let ([m1, m2], [l1, l2]) = (self.masses, self.lengths);
        let (h, k) = (q2.cos() * a3, q2.sin() * a3);
        let (h11, h12) = (h * 2.0 + a1, h + a2);
        let g2 = (q1 + q2).cos() * (m2 * GRAVITY * l2 / 2.0);
        let g1 = q1.cos() * ((m1 / 2.0 + m2) * GRAVITY * l1) + g2;
        let t1 = u[0] + k * w2 * (w1 * 2.0 + w2) - g1;
        let t2 = u[1] - k * w1 * w1 - g2;
        let determinant = h11 * a2 - h12 * h12;
        dx[0] = w1;
        dx[1] = w2;
        dx[2] = (t1 * a2 - h12 * t2) / determinant;
        dx[3] = (h11 * t2 - h12 * t1) / determinant;
    }
}

impl Plant for TwoLinkArm {
    const LONG: bool = true;
    const COLUMNS: Option<usize> = Some(6);

    fn states(&self) -> &[Variable] {
        const {
            &[
                Variable::new("q1", "rad"),
                Variable::new("q2", "rad"),
                Variable::new("w1", "rad/s"),
                Variable::new("w2", "rad/s"),
            ]
        }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u1", "N m"), Variable::new("u2", "N m")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let ([m1, m2], [l1, l2]) = (self.masses, self.lengths);
        let numbers = [("m1", m1), ("m2", m2), ("l1", l1), ("l2", l2)];
        numbers.map(|(name, value)| (name.to_owned(), value)).into()
    }

    by_rates!(TwoLinkArm);
}
