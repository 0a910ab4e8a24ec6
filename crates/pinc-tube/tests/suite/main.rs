//! Tubes against numpy, and against many drawn plants.

mod drawn;
mod drive;
mod outputs;
mod refusals;
