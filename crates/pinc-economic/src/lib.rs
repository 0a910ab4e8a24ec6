#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod integrated_cost;
mod quadrature;

pub use integrated_cost::IntegratedCost;
pub use quadrature::Quadrature;
