//! The time scales of eigenvalues, for the choice of steps and horizons.

use crate::Complex;

/// How a mode evolves by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Growth {
    /// It falls to 1/e in this time, in s.
    Decays {
        /// The time constant.
        time_constant_s: f64,
    },
    /// It doubles in this time, in s.
    Grows {
        /// The doubling time.
        doubling_s: f64,
    },
    /// It does neither: an integrator, or an undamped oscillation.
    Neutral,
}

/// The time scales of a linear plant.
///
/// ```
/// use pinc_analysis::{Complex, TimeScales};
///
/// let modes = [-100.0, -1.0, 0.5, 0.0].map(|re| Complex { re, im: 0.0 });
/// let scales = TimeScales::of(&modes);
/// assert_eq!((scales.fastest, scales.slowest), (100.0, Some(0.5)));
/// assert_eq!(scales.doubling_s, Some(std::f64::consts::LN_2 / 0.5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeScales {
    /// The largest |lambda|, in 1/s.
    pub fastest: f64,
    /// The smallest |lambda| that is not 0; `None` for a plant that only integrates.
    pub slowest: Option<f64>,
    /// Whether some mode neither grows nor decays: the plant does not settle.
    pub is_neutral: bool,
    /// How soon the fastest growing mode doubles; `None` for a plant none of whose modes grows.
    pub doubling_s: Option<f64>,
}

impl Growth {
    /// Says how a mode evolves.
    #[must_use]
    pub fn of(mode: Complex) -> Self {
        if mode.re < 0.0 {
            Self::Decays { time_constant_s: -1.0 / mode.re }
        } else if mode.re > 0.0 {
            Self::Grows { doubling_s: std::f64::consts::LN_2 / mode.re }
        } else {
            Self::Neutral
        }
    }
}

impl TimeScales {
    /// Returns the time scales of a plant with these eigenvalues.
    #[must_use]
    pub fn of(modes: &[Complex]) -> Self {
        let fastest = modes.iter().map(|mode| mode.abs()).fold(0.0, f64::max);
        let rates = modes.iter().map(|mode| mode.abs());
        let slowest = rates.filter(|rate| *rate > 0.0).min_by(f64::total_cmp);
        let doubling = modes.iter().filter_map(|mode| match Growth::of(*mode) {
            Growth::Grows { doubling_s } => Some(doubling_s),
            _ => None,
        });
        let is_neutral = modes.iter().any(|mode| Growth::of(*mode) == Growth::Neutral);
        Self { fastest, slowest, is_neutral, doubling_s: doubling.min_by(f64::total_cmp) }
    }
}
