//! The origin of results: version, processor, command.

use crate::error::RecordError;
use crate::files::{file, read_json};
use pinc_config::Experiment;
use serde::{Deserialize, Serialize};
use std::path::Path;

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
