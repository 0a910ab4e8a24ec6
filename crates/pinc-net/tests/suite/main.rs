//! Nets, their losses, optimizers, training and files.

mod examples;
mod kernel;
mod measurements;
mod model;
mod model_file;
mod optimizers;
mod training;
