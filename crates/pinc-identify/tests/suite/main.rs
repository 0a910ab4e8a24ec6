//! Identification against answers of another program, and against what theory says of it.

mod diagnosis;
mod hybrid;
mod noise;
mod outputs;
mod prediction;
mod recorded;
mod shooting;
mod starts;
mod support;
