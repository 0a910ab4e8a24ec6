//! A car with slipping tyres.

use pinc_ad::Scalar;
use pinc_ode::{Over, Plant, Variable};

/// Slips below this are as good as none: it makes the direction of a tyre's force smooth where
/// there is no slip.
const SLIP: f64 = 0.01;

/// Gravitational acceleration in m/s^2.
const GRAVITY: f64 = 9.81;

/// A single-track car with a driven rear wheel, whose tyres may slip beyond the peak of their
/// force:
///
/// ```text
/// m (vx' - vy r) = X - Yf sin d                      slip of the rear tyre    (k, (vy - lr r) / vx)
/// m (vy' + vx r) = Y + Yf cos d                      slip of the front tyre   (0, vt / vl)
/// J r' = lf Yf cos d - lr Y                          vl = vx cos d + (vy + lf r) sin d
/// k' = (R w' - (1 + k) vx') / vx,  I w' = M - R X    vt = (vy + lf r) cos d - vx sin d
/// ```
///
/// vx and vy are the speeds of the centre of gravity along and across the car, r is the yaw rate, k
/// the rear wheel's slip, R w = (1 + k) vx. The inputs are the steering angle d and the torque M on
/// the rear axle. X and Y are the rear tyre's forces along and across it, Yf the front tyre's
/// across it, which rolls freely. A tyre with the slip (a, b) gives the force
///
/// ```text
/// mu F sin(C atan(B s)) / s (a, -b),    s^2 = a^2 + b^2 + 0.01^2
/// ```
///
/// under its static load F: greatest near s = 0.21, less beyond. The wheel's slip is stiff below
/// the peak, where the force brakes it, and unstable beyond. Valid for vx > 0.
///
/// Equations: Velenis, Frazzoli and Tsiotras, "Steady-state cornering equilibria and stabilization
/// for a vehicle during extreme operating conditions", Int. J. Vehicle Autonomous Systems 8 (2010),
/// without the transfer of load and with slips relative to the speed of the car; the tyre is
/// Pacejka's formula without its curvature. The numbers, for a car on gravel, are this project's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SingleTrackCar<K = f64> {
    /// The mass m, in kg.
    pub mass: K,
    /// The moment of inertia J about the vertical, in kg m^2.
    pub inertia: K,
    /// From the centre of gravity to the front and the rear axle, lf and lr, in m.
    pub axles: [K; 2],
    /// The wheel's radius R, in m.
    pub radius: K,
    /// The moment of inertia I of the rear wheels, in kg m^2.
    pub wheel_inertia: K,
    /// The tyre's stiffness factor B.
    pub stiffness: K,
    /// The tyre's shape factor C.
    pub shape: K,
    /// The friction mu.
    pub friction: K,
}

impl Default for SingleTrackCar {
    /// 1450 kg on gravel.
    fn default() -> Self {
        Self {
            mass: 1450.0,
            inertia: 2740.0,
            axles: [1.1, 1.6],
            radius: 0.3,
            wheel_inertia: 1.8,
            stiffness: 7.0,
            shape: 1.6,
            friction: 0.6,
        }
    }
}

impl<K: Scalar> SingleTrackCar<K> {
    /// With these [`Plant::constants`].
    #[inline(always)]
    fn of(constants: &[K]) -> Self {
        Self {
            mass: constants[0],
            inertia: constants[1],
            axles: [constants[2], constants[3]],
            radius: constants[4],
            wheel_inertia: constants[5],
            stiffness: constants[6],
            shape: constants[7],
            friction: constants[8],
        }
    }

    /// The force of a tyre under the load `load`, in N per unit of slip, at the slip (a, b).
    #[inline(always)]
    fn grip<S: Over<K>>(&self, load: K, a: S, b: S) -> S {
        let s = a.mul_add(a, b * b + SLIP * SLIP).sqrt();
        ((s * self.stiffness).atan() * self.shape).sin() / s * (self.friction * load)
    }

    #[inline(always)]
    fn rates<S: Over<K>>(&self, x: &[S], u: &[S], dx: &mut [S]) {
        let [vx, vy, r, k] = [x[0], x[1], x[2], x[3]];
        let [front, rear] = self.axles;
        let weight = self.mass * GRAVITY / (front + rear);
        let (sin, cos) = (u[0].sin(), u[0].cos());

        let vy_front = vy + r * front;
        let along = vx * cos + vy_front * sin;
        let across = (vy_front * cos - vx * sin) / along;
        let y_front = -(self.grip(weight * rear, across.constant(0.0), across) * across);

        let across = (vy - r * rear) / vx;
        let grip = self.grip(weight * front, k, across);
        let (x_rear, y_rear) = (grip * k, -(grip * across));

        let acceleration = (x_rear - y_front * sin) / self.mass + vy * r;
        let wheel = (u[1] - x_rear * self.radius) * (self.radius / self.wheel_inertia);
        dx[0] = acceleration;
        dx[1] = (y_rear + y_front * cos) / self.mass - vx * r;
        dx[2] = (y_front * cos * front - y_rear * rear) / self.inertia;
        dx[3] = (wheel - (k + 1.0) * acceleration) / vx;
    }
}

impl Plant for SingleTrackCar {
    const LONG: bool = true;
    const COLUMNS: Option<usize> = Some(6);

    fn states(&self) -> &[Variable] {
        const {
            &[
                Variable::new("vx", "m/s"),
                Variable::new("vy", "m/s"),
                Variable::new("r", "rad/s"),
                Variable::new("k", ""),
            ]
        }
    }

    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("d", "rad"), Variable::new("M", "N m")] }
    }

    fn constants(&self) -> Vec<(String, f64)> {
        let numbers = [
            ("mass", self.mass),
            ("inertia", self.inertia),
            ("front", self.axles[0]),
            ("rear", self.axles[1]),
            ("radius", self.radius),
            ("wheel_inertia", self.wheel_inertia),
            ("stiffness", self.stiffness),
            ("shape", self.shape),
            ("friction", self.friction),
        ];
        numbers.map(|(name, value)| (name.to_owned(), value)).into()
    }

    by_rates!(SingleTrackCar);
}
