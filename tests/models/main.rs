//! One suite for every model that a controller may be given: what [`Model`](pinc_ode::Model)
//! promises.
//!
//! To add a model, add a line to [`candidates::candidates`]: a name, how it is built, and the box
//! of states, inputs and parameters in which it is tried. All checks run on it then.

mod allocations;
mod candidates;
mod harness;
mod jacobians;
mod promises;
mod user_models;
