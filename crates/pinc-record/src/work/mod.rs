//! Work on a sweep: who does what next, what is known of it, and how long it will take.

mod estimate;
mod ledger;
mod queue;

pub use estimate::{Estimate, effort, expected};
pub use ledger::Ledger;
pub use queue::{Job, Outcome, Queue};
