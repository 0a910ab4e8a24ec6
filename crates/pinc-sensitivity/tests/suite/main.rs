//! Derivatives of plans against central differences of the solver, and against formulas.

mod differences;
mod formulas;
mod problems;
mod refusals;
mod stream;
