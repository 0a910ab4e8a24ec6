//! Plants, integrators and what the rest of PINC says about dynamical systems.
//!
//! - [`Plant`]: an ordinary differential equation x' = f(x, u), written once over
//!   [`pinc_ad::Scalar`]; [`VanDerPol`], [`FourTanks`] and [`OneTank`] are the paper's,
//!   and [`Equations`] makes one from text.
//! - [`Predictor`]: a discrete-time model x\[k+1\] = f(x\[k\], u\[k\]) with its Jacobians; this is all that a
//!   controller knows of a model. [`Rk4`] and [`Rk5`] are such, [`Rosenbrock`], for stiff plants, another, a trained net a third.
//! - [`Adaptive`]: an accurate integrator, for the truth.
//! - [`Signal`], [`Trajectory`], [`metrics`]: what goes in, what comes out, how good it is.
//!
//! ```
//! use pinc_ode::{Adaptive, Predictor, Rk4, VanDerPol};
//!
//! let plant = VanDerPol::default();
//! let mut truth = vec![1.0, 0.0];
//! Adaptive::new(plant, 1e-12).integrate(&mut truth, &[0.5], 0.5)?;
//!
//! let mut next = [0.0; 2];
//! Rk4::new(plant, 0.5, 4).predict(&[1.0, 0.0], &[0.5], &mut next);
//! assert!((next[0] - truth[0]).abs() < 1e-5);
//! # Ok::<(), pinc_ode::OdeError>(())
//! ```

mod adaptive;
mod error;
mod expression;
pub mod metrics;
mod plant;
mod plants;
mod predictor;
mod rosenbrock;
mod runge_kutta;
mod signal;
mod trajectory;
mod variable;

pub use adaptive::Adaptive;
pub use error::OdeError;
pub use expression::{Equations, Excerpt, ExpressionError, ExpressionPlant, ExpressionProblem};
pub use plant::Plant;
pub use plants::{
    AcetoneColumn, AcetoneStill, FourTanks, HydraulicServo, OneTank, SingleTrackCar, TwoLinkArm,
    VanDerPol,
};
pub use predictor::{Dims, Predictor};
pub use rosenbrock::Rosenbrock;
pub use runge_kutta::{Classical, DormandPrince, Method, Rk4, Rk5, RungeKutta};
pub use signal::Signal;
pub use trajectory::Trajectory;
pub use variable::Variable;
