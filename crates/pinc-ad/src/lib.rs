//! Differentiation by operator overloading, in four kinds of number behind one trait.
//!
//! An equation is written once, over [`Scalar`], and evaluated as
//!
//! - `f64`: its value;
//! - [`Dual`]: its value and directional derivatives (forward mode);
//! - [`Lanes`]: several points at once, in a form that the compiler turns into SIMD instructions;
//!   [`simd`] has the vectors of this machine;
//! - [`Var`]: its value, recorded on a [`Tape`] for the gradient (reverse mode).
//!
//! The kinds nest. `Dual<Var>` is what a physics-informed net needs: forward in time for dy/dt,
//! inside reverse in the weights for the gradient of a loss that contains dy/dt.
//!
//! ```
//! use pinc_ad::{Scalar, derivative, gradient, jacobian};
//!
//! // d/dx (x^3) at 2
//! assert_eq!(derivative(|x| x * x * x, 2.0), 12.0);
//!
//! // gradient of x*y + tanh(x)
//! let (value, g) = gradient(|v| v[0] * v[1] + v[0].tanh(), &[0.0, 3.0]);
//! assert_eq!((value, g), (0.0, vec![4.0, 0.0]));
//!
//! // Jacobian of (x*y, x + 2y), row by row
//! let j = jacobian(|v, out| { out[0] = v[0] * v[1]; out[1] = v[0] + v[1] * 2.0 }, &[3.0, 4.0], 2);
//! assert_eq!(j, [4.0, 3.0, 1.0, 2.0]);
//! ```
//!
//! The crate depends on nothing.

mod directions;
mod drivers;
mod dual;
mod finite;
mod implicit;
mod lanes;
mod scalar;
pub mod simd;
mod tape;

pub use directions::Directions;
pub use drivers::{derivative, gradient, jacobian};
pub use dual::{Derivative, Dual};
pub use finite::{GradientMismatch, central_difference, check_gradient};
pub use implicit::{ImplicitEquations, NewtonRoot, NewtonSystem, correct, newton, solve_implicit};
pub use lanes::Lanes;
pub use scalar::Scalar;
pub use tape::{Tape, Var};
