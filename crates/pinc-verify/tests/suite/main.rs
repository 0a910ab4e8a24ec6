//! Brackets of the errors of nets and integrators against sampled truths.

mod brackets;
mod estimates;
mod points;
mod soundness;
mod support;
