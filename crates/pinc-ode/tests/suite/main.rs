//! The tests of pinc-ode, as one program.

mod accurate;
mod common;
mod dopri5;
mod dopri5_limits;
mod examples;
mod integrators;
mod loaded;
mod metrics;
mod piecewise_constant;
mod recent;
mod rosenbrock;
mod runge_kutta;
mod tangent;
