#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod branch_and_bound;
mod rounding;

pub use branch_and_bound::BranchAndBound;
pub use rounding::sum_up;
