#![doc = include_str!("../README.md")]
//! # Tour
//!
//! Each plant has a file with its equation, its source and its published parameters:
//! [`VanDerPol`], [`FourTanks`], [`OneTank`], [`HydraulicServo`], [`SingleTrackCar`],
//! [`TwoLinkArm`], [`AcetoneStill`] and [`AcetoneColumn`].

#![forbid(unsafe_code)]

/// What a plant is by its `rates` and its constants, from which `of` makes it; and by fields that
/// are no constants.
macro_rules! by_rates {
    ($plant:ident $(, $field:ident)*) => {
        fn with_constants(&self, constants: &[f64]) -> Self {
            Self::of(constants $(, self.$field)*)
        }

        #[inline(always)]
        fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
            self.rates(x, u, dx);
        }

        fn rhs_with<S: Scalar>(&self, constants: &[S], x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
            $plant::of(constants $(, self.$field)*).rates(x, u, dx);
        }
    };
}

mod acetone_column;
mod acetone_mixture;
mod acetone_still;
mod four_tanks;
mod hydraulic_servo;
mod one_tank;
mod single_track_car;
mod two_link_arm;
mod van_der_pol;

pub use acetone_column::AcetoneColumn;
pub use acetone_still::AcetoneStill;
pub use four_tanks::FourTanks;
pub use hydraulic_servo::HydraulicServo;
pub use one_tank::OneTank;
pub use single_track_car::SingleTrackCar;
pub use two_link_arm::TwoLinkArm;
pub use van_der_pol::VanDerPol;

use pinc_expr::PlantEquations;
use pinc_ode::{DynPlant, Over};

/// Plants with their type erased. The equation of a plant is compiled into its integrators and
/// derivatives wherever its type is erased: here, once, and not in each program that uses it.
macro_rules! erased {
    ($($plant:ident)*) => {$(
        impl $plant {
            /// The plant with its type erased.
            #[must_use]
            #[inline(never)]
            pub fn into_dyn(self) -> Box<dyn DynPlant> {
                pinc_expr::into_dyn(self)
            }

            /// The equations, for all that reads them as a graph.
            #[must_use]
            #[inline(never)]
            pub fn equations(self) -> PlantEquations {
                PlantEquations::traced(self)
            }
        }
    )*};
}

erased!(VanDerPol OneTank FourTanks AcetoneStill AcetoneColumn);
erased!(HydraulicServo SingleTrackCar TwoLinkArm);

/// Gravitational acceleration in cm/s^2, as Johansson (2000) has it.
const GRAVITY: f64 = 981.0;

/// Torricelli's law: the flow a sqrt(2 g h) in cm^3/s out of a hole of `a` cm^2 below `h` cm of
/// water.
///
/// An empty tank has no outflow: for h <= 0 the flow and its derivative are 0 (the one-sided
/// derivative at 0 from above is infinite). A NaN level gives a NaN flow.
#[inline(always)]
fn outflow<K, S: Over<K>>(a: K, h: S) -> S {
    let level = h.where_nonpositive(h.constant(0.0), h);
    (level * (2.0 * GRAVITY)).sqrt() * a
}
