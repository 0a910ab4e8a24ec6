//! Every kind of number against the others, against differences and against digits computed
//! elsewhere.

mod common;
mod conformance;
mod digits;
mod edges;
mod examples;
mod finite;
mod guard;
mod implicit;
mod jacobians;
mod nesting;
mod tape;
