//! Units of time: of the rates of equations, and in which times are shown.

use serde::{Deserialize, Serialize};

/// A unit of time.
///
/// Keys of a config and columns of tables are in seconds whatever it is: it says what the rates of
/// equations are per, and how times are shown.
///
/// ```
/// use pinc_expr::TimeUnit;
///
/// assert_eq!(TimeUnit::shown(18000.0, Some(TimeUnit::Min)), "300 min");
/// // Without one, that in which the time is a small number.
/// assert_eq!(TimeUnit::shown(18000.0, None), "5 h");
/// assert_eq!(TimeUnit::shown(2.5e-7, None), "0.25 us");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// Microseconds.
    Us,
    /// Milliseconds.
    Ms,
    /// Seconds.
    S,
    /// Minutes.
    Min,
    /// Hours.
    H,
    /// Days.
    D,
}

impl TimeUnit {
    /// How long it is, in s.
    #[must_use]
    pub fn seconds(self) -> f64 {
        match self {
            Self::Us => 1e-6,
            Self::Ms => 1e-3,
            Self::S => 1.0,
            Self::Min => 60.0,
            Self::H => 3600.0,
            Self::D => 86400.0,
        }
    }

    /// Its symbol, which is also its name in configs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Us => "us",
            Self::Ms => "ms",
            Self::S => "s",
            Self::Min => "min",
            Self::H => "h",
            Self::D => "d",
        }
    }

    /// The unit in which a time in s is a small number.
    #[must_use]
    pub fn of(seconds: f64) -> Self {
        match seconds.abs() {
            0.0 => Self::S,
            t if t < 1e-4 => Self::Us,
            t if t < 0.1 => Self::Ms,
            t if t < 120.0 => Self::S,
            t if t < 7200.0 => Self::Min,
            t if t < 2e5 => Self::H,
            _ => Self::D,
        }
    }

    /// A time in s with three digits, in this unit, or that in which it is a small number.
    #[must_use]
    pub fn shown(seconds: f64, unit: Option<Self>) -> String {
        let unit = unit.unwrap_or_else(|| Self::of(seconds));
        let value = seconds / unit.seconds();
        let rounded: f64 = format!("{value:.2e}").parse().unwrap_or(value);
        match rounded.abs() {
            0.0 => format!("0 {}", unit.name()),
            size if (1e-4..1e6).contains(&size) => format!("{rounded} {}", unit.name()),
            _ => format!("{rounded:e} {}", unit.name()),
        }
    }
}
