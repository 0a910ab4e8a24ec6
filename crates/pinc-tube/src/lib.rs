#![doc = include_str!("../README.md")]

mod along;
mod ellipsoids;
mod error;
mod gains;
mod matrix;
mod quantile;
mod sources;
mod tightening;

pub use along::{AlongPlan, BackOffs, Tube};
pub use ellipsoids::EllipsoidTube;
pub use error::TubeError;
pub use quantile::normal_quantile;
pub use sources::{Feedback, Interval, Sources, StageError, TubeModel};
pub use tightening::{Sides, Tightened, Tightening};
