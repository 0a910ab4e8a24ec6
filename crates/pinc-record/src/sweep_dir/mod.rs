//! The directory of a sweep: what its trials leave there.
//!
//! ```text
//! nets/<hash of a training>/    a run directory as of `pinc train`, shared by all trials of that net
//! trials/<hash of a trial>/     traces, if they are kept, and last of all result.json
//! workers/                      while it is worked on: locks of what is being done, and how far
//!                               each process is
//! ```

use crate::error::RecordError;
use crate::files::{
    file, is_unfinished, json, read_file, read_json, read_text, remove_unfinished,
    write_atomically, write_unflushed,
};
use crate::lock::{LOCK, Lock};
use crate::metrics::Metrics;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

const NETS: &str = "nets";
const TRIALS: &str = "trials";
const WORKERS: &str = "workers";
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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// How it ended.
    #[serde(flatten)]
    pub ending: Ending,
    /// As far as the trial got.
    pub metrics: Metrics,
}

/// Part of a sweep that no other process works on until this is dropped.
#[derive(Debug)]
pub struct Claim {
    _lock: Lock,
}

/// How far a process is that works on a sweep, for others to read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorkerNote {
    /// When this was written, in s since 1970.
    pub at_s: f64,
    /// How many things it does at a time.
    pub lanes: usize,
    /// The effort of the trainings that it has done.
    pub trained: f64,
    /// The time that these took one after the other, in s.
    pub trained_s: f64,
    /// How many trials it has done.
    pub trials: f64,
    /// The time that these took one after the other, in s.
    pub trials_s: f64,
}

/// A process that says nothing for so long, in s, is not at work.
const SILENCE_S: f64 = 60.0;

impl WorkerNote {
    /// Whether its process is at work, as far as it tells.
    #[must_use]
    pub fn is_fresh(&self, now_s: f64) -> bool {
        now_s - self.at_s < SILENCE_S
    }
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
        for name in [TRIALS, NETS, WORKERS] {
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

    /// Notes that a trial is over. If the machine stops soon after, that may be lost, and the trial
    /// is then not [finished](SweepDir::finished).
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read or written.
    pub fn finish(&self, id: &str, finished: &Finished) -> Result<(), RecordError> {
        write_unflushed(&self.trial(id).join(RESULT), json(finished).as_bytes())
    }

    /// The results of a trial, if it is over.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be read.
    pub fn finished(&self, id: &str) -> Result<Option<Finished>, RecordError> {
        match read_json(&self.trial(id).join(RESULT)) {
            // Damaged when the machine stopped.
            Err(RecordError::Json { .. }) => Ok(None),
            read => read,
        }
    }

    /// How many trials are over and how many nets trained, at most: results of other configs in
    /// this directory count too.
    #[must_use]
    pub fn results(&self) -> (usize, usize) {
        let count = |folder: &str, file: &str| {
            let entries = fs::read_dir(self.dir.join(folder)).into_iter().flatten().flatten();
            entries.filter(|entry| entry.path().join(file).exists()).count()
        };
        (count(TRIALS, RESULT), count(NETS, file::METRICS))
    }

    /// Claims part of the sweep for this process, whose id is `id`; none if another one works on
    /// it.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be written.
    pub fn claim(&self, part: &str, id: u32) -> Result<Option<Claim>, RecordError> {
        let path = self.workers()?.join(format!("{part}.lock"));
        Ok(Lock::take(&path, id, false)?.ok().map(|lock| Claim { _lock: lock }))
    }

    /// Says how far the process `name` is.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be written.
    pub fn write_note(&self, name: &str, note: &WorkerNote) -> Result<(), RecordError> {
        write_unflushed(&self.workers()?.join(format!("{name}.json")), json(note).as_bytes())
    }

    /// Removes what [`SweepDir::write_note`] wrote.
    pub fn remove_note(&self, name: &str) {
        let _ = fs::remove_file(self.dir.join(WORKERS).join(format!("{name}.json")));
    }

    /// How far all processes are, those included that were killed.
    #[must_use]
    pub fn notes(&self) -> Vec<WorkerNote> {
        let entries = fs::read_dir(self.dir.join(WORKERS)).into_iter().flatten().flatten();
        let texts = entries
            .filter(|entry| entry.path().extension().is_some_and(|ending| ending == "json"))
            .filter_map(|entry| read_text(&entry.path()).ok().flatten());
        texts.filter_map(|text| serde_json::from_str(&text).ok()).collect()
    }

    /// Removes what processes that were killed have left: notes, locks and unfinished files. No
    /// other process may work in the directory.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if a file cannot be removed.
    pub fn remove_leftovers(&self) -> Result<(), RecordError> {
        remove_all(&self.dir.join(WORKERS))?;
        for folder in [NETS, TRIALS] {
            for part in fs::read_dir(self.dir.join(folder)).into_iter().flatten().flatten() {
                let dir = part.path();
                remove_unfinished(&dir)?;
                remove_unfinished(&dir.join(file::FIGURES))?;
                let lock = dir.join(LOCK);
                if lock.exists() {
                    fs::remove_file(&lock).map_err(RecordError::unwritable(&lock))?;
                }
            }
        }
        Ok(())
    }

    fn workers(&self) -> Result<PathBuf, RecordError> {
        let dir = self.dir.join(WORKERS);
        fs::create_dir_all(&dir).map_err(RecordError::unwritable(&dir))?;
        Ok(dir)
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
            && !self.is_trained(net)
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

#[cfg(test)]
mod tests;
