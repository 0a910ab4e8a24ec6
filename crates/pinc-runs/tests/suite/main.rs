//! Closed loops of configs, from the text to the files.

mod batch;
mod loops;
