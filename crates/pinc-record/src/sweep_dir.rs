//! The directory of a sweep: what its trials leave there.
//!
//! ```text
//! nets/<hash of a training>/    a run directory as of `pinc train`, shared by all trials of that
//! net trials/<hash of a trial>/     metrics.json, traces, and last of all result.json
//! ```

use crate::error::RecordError;
use crate::files::{file, is_unfinished, json, read_file, read_json, write_atomically};
use crate::lock::LOCK;
use crate::metrics::Metrics;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const NETS: &str = "nets";
const TRIALS: &str = "trials";
const RESULT: &str = "result.json";

/// How a trial ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "kebab-case")]
pub enum Ending {
    /// As it should.
    Done,
    /// With an error, which the same trial has every time.
    Failed {
        /// What went wrong.
        error: String,
    },
}

/// The results of a trial that is over.
#[derive(Clone, Debug)]
pub struct Finished {
    /// How it ended.
    pub ending: Ending,
    /// As far as the trial got.
    pub metrics: Option<Metrics>,
}

/// The directory of a sweep.
#[derive(Clone, Debug)]
pub struct SweepDir {
    dir: PathBuf,
}

impl SweepDir {
    /// The sweep whose run directory is `dir`.
    #[must_use]
    pub fn of(dir: &Path) -> Self {
        Self { dir: dir.to_owned() }
    }

    /// The run directory of a training.
    #[must_use]
    pub fn net(&self, id: &str) -> PathBuf {
        self.dir.join(NETS).join(id)
    }

    /// Whether a training is finished: its metrics are written last.
    #[must_use]
    pub fn is_trained(&self, id: &str) -> bool {
        self.net(id).join(file::METRICS).exists()
    }

    /// The directory of a trial.
    #[must_use]
    pub fn trial(&self, id: &str) -> PathBuf {
        self.dir.join(TRIALS).join(id)
    }

    /// Removes all trials and nets.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read or written.
    pub fn clear(&self) -> Result<(), RecordError> {
        for name in [TRIALS, NETS] {
            remove_all(&self.dir.join(name))?;
        }
        Ok(())
    }

    /// Makes a trial's directory, and empties it of what an unfinished attempt left.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read or written.
    pub fn begin(&self, id: &str) -> Result<PathBuf, RecordError> {
        let dir = self.trial(id);
        remove_all(&dir)?;
        fs::create_dir_all(&dir).map_err(RecordError::unwritable(&dir))?;
        Ok(dir)
    }

    /// Notes that a trial is over.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read or written.
    pub fn finish(&self, id: &str, ending: &Ending) -> Result<(), RecordError> {
        write_atomically(&self.trial(id).join(RESULT), json(ending).as_bytes())
    }

    /// The results of a trial, if it is over.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read or written.
    pub fn finished(&self, id: &str) -> Result<Option<Finished>, RecordError> {
        let dir = self.trial(id);
        let Some(ending) = read_json(&dir.join(RESULT))? else { return Ok(None) };
        Ok(Some(Finished { ending, metrics: read_json(&dir.join(file::METRICS))? }))
    }

    /// Takes over a finished trial, with its net, from another sweep directory.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read or written.
    pub fn import_trial(
        &self,
        other: &Self,
        trial: &str,
        net: Option<&str>,
    ) -> Result<(), RecordError> {
        if let Some(net) = net
            && !self.net(net).join(file::MODEL).exists()
            && other.net(net).join(file::MODEL).exists()
        {
            copy_files(&other.net(net), &self.net(net), file::METRICS)?;
        }
        copy_files(&other.trial(trial), &self.trial(trial), RESULT)
    }
}

/// Copies the files of a directory, `last` last: it says that the others are there.
fn copy_files(from: &Path, to: &Path, last: &str) -> Result<(), RecordError> {
    fs::create_dir_all(to).map_err(RecordError::unwritable(to))?;
    let mut names = Vec::new();
    for entry in fs::read_dir(from).map_err(RecordError::unreadable(from))? {
        let entry = entry.map_err(RecordError::unreadable(from))?;
        if !is_unfinished(&entry) && entry.file_name() != LOCK {
            names.push(entry.file_name());
        }
    }
    names.sort_by_key(|name| name == last);
    for name in names {
        let path = from.join(&name);
        write_atomically(&to.join(&name), &read_file(&path)?)?;
    }
    Ok(())
}

fn remove_all(dir: &Path) -> Result<(), RecordError> {
    match fs::remove_dir_all(dir) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(RecordError::unwritable(dir)(error))
        }
        _ => Ok(()),
    }
}
