//! Single or multiple shooting, and the reason.

use crate::fit::FitStatus;
use std::fmt;

/// The growth from which on its size alone is printed.
const HUGE: f64 = 1e4;

/// How the model was led along the recordings, and why so.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// From the initial state to the end.
    SingleShooting {
        /// By how much of its scale a state changes along the fit where the initial one is changed by
        /// its scale, at most.
        growth: f64,
    },
    /// In segments whose gaps were closed.
    MultipleShooting(Why),
}

/// Why recordings were cut into segments.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Why {
    /// From the start of the fit the model has no finite values to the end of a recording.
    NotFinite,
    /// The model depends too much on its initial state.
    Sensitive {
        /// By how much.
        growth: f64,
    },
    /// The problem asks for it.
    Asked,
    /// Single shooting did not converge.
    SingleEnded {
        /// How it ended.
        status: FitStatus,
    },
    /// Single shooting ended in a minimum that fits worse.
    BetterThanSingle {
        /// The correlation of neighbouring residuals there, the largest.
        correlation: f64,
    },
}

impl Method {
    /// The name in results.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::SingleShooting { .. } => "single shooting",
            Self::MultipleShooting(_) => "multiple shooting",
        }
    }
}

/// The reason in words.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SingleShooting { growth } if *growth < HUGE => {
                write!(f, "the states depend on the initial one at most {growth:.3}-fold")
            }
            Self::SingleShooting { growth } => {
                write!(f, "the states depend on the initial one at most {growth:.1e}-fold")
            }
            Self::MultipleShooting(Why::Asked) => write!(f, "as asked for"),
            Self::MultipleShooting(Why::NotFinite) => {
                write!(f, "from the start the model is not finite to the end of the data")
            }
            Self::MultipleShooting(Why::Sensitive { growth }) => {
                write!(f, "the states depend on the initial one up to {growth:.1e}-fold")
            }
            Self::MultipleShooting(Why::SingleEnded { status }) => {
                write!(f, "single shooting ended as {status}")
            }
            Self::MultipleShooting(Why::BetterThanSingle { correlation }) => write!(
                f,
                "single shooting ended in a minimum that fits worse, with a correlation of \
                 neighbouring residuals of {correlation:.2}"
            ),
        }
    }
}

/// The length of a segment in rows: a tenth of a recording of `rows`, and shorter where the model
/// grows more than tenfold in that.
pub(crate) fn segments(rows: usize, growth: f64) -> usize {
    let longest = rows.div_ceil(10).max(2);
    let tenfolds = growth.max(1.0).log10();
    let too_long = |length: usize| length as f64 * tenfolds > rows as f64;
    (2..=longest).rev().find(|&length| !too_long(length)).unwrap_or(2)
}
