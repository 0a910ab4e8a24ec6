//! Nets, their losses, optimizers, training and files.

mod distillation;
mod domain_error;
mod examples;
mod family;
mod growth;
mod kernel;
mod levenberg_marquardt;
mod line_search;
mod measurements;
mod model;
mod model_file;
mod optimizers;
mod refinement;
mod sampling;
mod training;
mod trainings;
