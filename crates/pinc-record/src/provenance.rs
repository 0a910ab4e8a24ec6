//! The origin of results: version, processor, command.

use crate::error::RecordError;
use crate::files::{file, read_json};
use pinc_config::Experiment;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

/// Everything needed to reproduce a result: `provenance.json`.
///
/// It names neither the machine nor its user: of paths outside the working directory only the last
/// part is kept, after `.../`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// When and with what the run began.
    #[serde(flatten)]
    pub begun: Invocation,
    /// The experiment's seed.
    pub seed: u64,
    /// SHA-256 of the resolved config.
    pub config_sha256: String,
    /// When and with what it was resumed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub resumed: Vec<Invocation>,
}

/// One call of the program that worked on a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Invocation {
    /// When it began, in UTC, RFC 3339.
    pub started: String,
    /// The command line.
    pub command: Vec<String>,
    /// Version of pinc.
    pub version: String,
    /// Commit of the source, if it was built from a git repository.
    pub git_commit: Option<String>,
    /// Whether the source differed from the commit.
    pub git_dirty: Option<bool>,
    /// Version of the compiler.
    pub rustc: String,
    /// Target triple.
    pub target: String,
    /// Whether it was built with optimization for releases or as a development build.
    pub profile: String,
    /// Name of the processor.
    pub cpu: String,
    /// Threads that the machine runs at once.
    pub cores: usize,
    /// Operating system.
    pub os: String,
}

impl Provenance {
    /// The provenance of the run in `dir`; `None` if it has none.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if the file cannot be read or is damaged.
    pub fn read(dir: &Path) -> Result<Option<Self>, RecordError> {
        read_json(&dir.join(file::PROVENANCE))
    }

    /// The provenance of a run of `experiment` that `begun` begins.
    #[must_use]
    pub fn of(experiment: &Experiment, begun: Invocation) -> Self {
        Self {
            begun,
            seed: experiment.seed,
            config_sha256: experiment.fingerprint(),
            resumed: Vec::new(),
        }
    }

    /// This provenance of a run that `later` resumes.
    #[must_use]
    pub fn resumed_by(mut self, later: &Self) -> Self {
        self.resumed.push(later.begun.clone());
        self
    }

    /// All invocations that worked on the run, in their order.
    pub fn invocations(&self) -> impl Iterator<Item = &Invocation> {
        std::iter::once(&self.begun).chain(&self.resumed)
    }
}

impl Invocation {
    /// The commit as a reader likes it: its first twelve digits, and whether there were changes.
    #[must_use]
    pub fn source(&self) -> String {
        let commit = self.git_commit.as_deref().unwrap_or("unknown");
        let dirty = if self.git_dirty == Some(true) { " and changes" } else { "" };
        format!("{}{dirty}", commit.get(..12).unwrap_or(commit))
    }
}

/// A time since 1970-01-01, in UTC, as `2026-01-31T12:00:00Z`.
#[must_use]
pub fn rfc3339(since_1970: Duration) -> String {
    let seconds = since_1970.as_secs();
    let (days, second) = (seconds / 86400, seconds % 86400);
    let (year, month, day) = civil(days);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Year, month and day of a number of days since 1970-01-01. In a year that begins in March the
/// leap day is the last, and the months' lengths are (153 m + 2)/5 apart.
fn civil(days: u64) -> (u64, u64, u64) {
    let days = days + 719_468; // since 0000-03-01
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (year, month) = (400 * era + year_of_era, if month < 10 { month + 3 } else { month - 9 });
    (if month <= 2 { year + 1 } else { year }, month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates() {
        // From `date -u -d @N --rfc-3339=seconds`.
        for (seconds, expected) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_767_225_600, "2026-01-01T00:00:00Z"),
            (4_107_542_399, "2100-02-28T23:59:59Z"),
        ] {
            assert_eq!(rfc3339(Duration::from_secs(seconds)), expected);
        }
    }
}
