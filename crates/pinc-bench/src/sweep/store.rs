//! The directory of a sweep: what its trials leave there.
//!
//! ```text
//! nets/<hash of a training>/    a run directory as of `pinc train`, shared by all trials of that net
//! trials/<hash of a trial>/     metrics.json, traces, and last of all result.json
//! ```

use crate::record::{file, write_atomically};
use crate::{BenchError, Metrics};
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
pub(crate) enum Ending {
    /// As it should.
    Done,
    /// With an error, which the same trial has every time.
    Failed {
        /// What went wrong.
        error: String,
    },
}

/// What a trial came to.
#[derive(Clone, Debug)]
pub(crate) struct Finished {
    pub(crate) ending: Ending,
    /// As far as the trial got.
    pub(crate) metrics: Option<Metrics>,
}

/// Where trials and nets are kept.
#[derive(Clone, Debug)]
pub(crate) struct Store {
    dir: PathBuf,
}

impl Store {
    /// The store in a run directory.
    pub(crate) fn of(dir: &Path) -> Self {
        Self { dir: dir.to_owned() }
    }

    /// The run directory of a training.
    pub(crate) fn net(&self, id: &str) -> PathBuf {
        self.dir.join(NETS).join(id)
    }

    /// Whether a training came to its end: its metrics are written last.
    pub(crate) fn is_trained(&self, id: &str) -> bool {
        self.net(id).join(file::METRICS).exists()
    }

    /// The directory of a trial.
    pub(crate) fn trial(&self, id: &str) -> PathBuf {
        self.dir.join(TRIALS).join(id)
    }

    /// Removes all trials and nets.
    pub(crate) fn clear(&self) -> Result<(), BenchError> {
        for name in [TRIALS, NETS] {
            remove_all(&self.dir.join(name))?;
        }
        Ok(())
    }

    /// Makes a trial's directory, and empties it of what an unfinished attempt left.
    pub(crate) fn begin(&self, id: &str) -> Result<PathBuf, BenchError> {
        let dir = self.trial(id);
        remove_all(&dir)?;
        fs::create_dir_all(&dir).map_err(BenchError::unwritable(&dir))?;
        Ok(dir)
    }

    /// Notes that a trial is over.
    pub(crate) fn finish(&self, id: &str, ending: &Ending) -> Result<(), BenchError> {
        let text = serde_json::to_string_pretty(ending);
        let text = text.expect("an ending is plain data") + "\n";
        write_atomically(&self.trial(id).join(RESULT), text.as_bytes())
    }

    /// What a trial came to, if it is over.
    pub(crate) fn finished(&self, id: &str) -> Result<Option<Finished>, BenchError> {
        let dir = self.trial(id);
        let Some(ending) = read(&dir.join(RESULT))? else { return Ok(None) };
        Ok(Some(Finished { ending, metrics: read(&dir.join(file::METRICS))? }))
    }

    /// Takes over a finished trial, with its net, from another sweep directory.
    pub(crate) fn import_trial(
        &self,
        other: &Self,
        trial: &str,
        net: Option<&str>,
    ) -> Result<(), BenchError> {
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
fn copy_files(from: &Path, to: &Path, last: &str) -> Result<(), BenchError> {
    fs::create_dir_all(to).map_err(BenchError::unwritable(to))?;
    let mut names = Vec::new();
    for entry in fs::read_dir(from).map_err(BenchError::unreadable(from))? {
        names.push(entry.map_err(BenchError::unreadable(from))?.file_name());
    }
    names.sort_by_key(|name| name == last);
    for name in names {
        let path = from.join(&name);
        let bytes = fs::read(&path).map_err(BenchError::unreadable(&path))?;
        write_atomically(&to.join(&name), &bytes)?;
    }
    Ok(())
}

fn remove_all(dir: &Path) -> Result<(), BenchError> {
    match fs::remove_dir_all(dir) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(BenchError::unwritable(dir)(error))
        }
        _ => Ok(()),
    }
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<Option<T>, BenchError> {
    match fs::read(path) {
        Ok(bytes) => serde_json::from_slice(&bytes)
            .map(Some)
            .map_err(|problem| BenchError::Results { path: path.to_owned(), problem }),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(BenchError::unreadable(path)(error)),
    }
}
