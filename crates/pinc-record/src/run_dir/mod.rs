//! The directory of a run, and its metrics.

use crate::error::RecordError;
use crate::files::{file, is_unfinished, json, remove_unfinished, write_atomically};
use crate::lock::{LOCK, Lock, is_taken};
use crate::metrics::{FileNote, Metrics};
use crate::provenance::Provenance;
use pinc_config::{Experiment, sha256};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The results of a run: its directory, and the numbers in its `metrics.json`.
#[derive(Clone, Debug)]
pub struct RunDir {
    dir: PathBuf,
    metrics: Metrics,
    keeps_traces: bool,
    /// Held while results are written.
    lock: Option<Arc<Lock>>,
    /// Whether the metrics are not written.
    in_memory: bool,
}

impl RunDir {
    /// The directory `dir`, made if it is not there, for the results of `experiment`. What it holds
    /// of the same experiment stays until it is replaced. Nobody else can open it until the value
    /// and its clones are dropped or [released](RunDir::released); `id` says to others which
    /// process has it.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if it cannot be read or written, or holds something else.
    pub fn open(dir: &Path, experiment: &Experiment, id: u32) -> Result<Self, RecordError> {
        fs::create_dir_all(dir).map_err(RecordError::unwritable(dir))?;
        // Before the lock is taken, which is a file: nothing is changed in a directory of others.
        check_owner(dir, experiment)?;
        let lock = Lock::of_dir(dir, id)?;
        check_owner(dir, experiment)?;
        remove_unfinished(dir)?;
        remove_unfinished(&dir.join(file::FIGURES))?;
        let run = Self::locked(dir, experiment, lock);
        run.write(file::CONFIG, config_text(experiment).as_bytes())?;
        Ok(run)
    }

    /// Like [`RunDir::open`], together with other processes that open it like this and work on the
    /// same run.
    ///
    /// # Errors
    ///
    /// As [`RunDir::open`].
    pub fn open_shared(dir: &Path, experiment: &Experiment, id: u32) -> Result<Self, RecordError> {
        fs::create_dir_all(dir).map_err(RecordError::unwritable(dir))?;
        check_owner(dir, experiment)?;
        let lock = Lock::shared(dir, id)?;
        check_owner(dir, experiment)?;
        let run = Self::locked(dir, experiment, lock);
        if !run.path(file::CONFIG).exists() {
            run.write(file::CONFIG, config_text(experiment).as_bytes())?;
        }
        Ok(run)
    }

    fn locked(dir: &Path, experiment: &Experiment, lock: Lock) -> Self {
        // Damaged metrics are made anew, like those that are missing.
        let metrics = Metrics::read(dir).ok().flatten();
        let metrics = metrics.unwrap_or_else(|| Metrics::new(experiment));
        let lock = Some(Arc::new(lock));
        Self { dir: dir.to_owned(), metrics, keeps_traces: true, lock, in_memory: false }
    }

    /// The directory for this process alone; `None` while others share it.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn alone(mut self) -> Result<Option<Self>, RecordError> {
        let Some(lock) = self.lock.take() else { return Ok(Some(self)) };
        // A clone that is still in use keeps it.
        let Some(lock) = Arc::into_inner(lock).and_then(Lock::alone) else { return Ok(None) };
        remove_unfinished(&self.dir)?;
        remove_unfinished(&self.dir.join(file::FIGURES))?;
        self.lock = Some(Arc::new(lock));
        Ok(Some(self))
    }

    /// Whether other processes are kept out of what this one works on: some file systems have no
    /// locks.
    #[must_use]
    pub fn keeps_others_out(&self) -> bool {
        self.lock.as_ref().is_some_and(|lock| lock.is_real())
    }

    /// Checks that `dir` is the directory of some run or sweep.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if there is no such directory, or no config in it.
    pub fn expect(dir: &Path) -> Result<(), RecordError> {
        match (dir.is_dir(), dir.join(file::CONFIG).exists()) {
            (true, true) => Ok(()),
            (true, false) => Err(RecordError::NoRunDirectory { dir: dir.to_owned() }),
            (false, _) => Err(RecordError::NotADirectory { path: dir.to_owned() }),
        }
    }

    /// Whether `dir` is the directory of a run of `experiment`.
    #[must_use]
    pub fn is_of(dir: &Path, experiment: &Experiment) -> bool {
        fs::read_to_string(dir.join(file::CONFIG)).is_ok_and(|text| text == config_text(experiment))
    }

    /// Whether some process works in `dir`, as far as the file system tells.
    #[must_use]
    pub fn is_in_use(dir: &Path) -> bool {
        is_taken(&dir.join(LOCK))
    }

    /// The directory of a trial, which is there and empty. What the trial was is said by the sweep
    /// that it belongs to; its metrics stay in memory, for [`SweepDir::finish`] to write.
    ///
    /// [`SweepDir::finish`]: crate::SweepDir::finish
    #[must_use]
    pub fn of_trial(dir: &Path, experiment: &Experiment, keeps_traces: bool) -> Self {
        let (dir, metrics) = (dir.to_owned(), Metrics::new(experiment));
        Self { dir, metrics, keeps_traces, lock: None, in_memory: true }
    }

    /// The directory of a run that has been made.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if its metrics are missing or damaged.
    pub fn existing(dir: &Path) -> Result<Self, RecordError> {
        let path = dir.join(file::METRICS);
        let missing = || RecordError::unreadable(&path)(ErrorKind::NotFound.into());
        let metrics = Metrics::read(dir)?.ok_or_else(missing)?;
        Ok(Self { dir: dir.to_owned(), metrics, keeps_traces: true, lock: None, in_memory: false })
    }

    /// The directory, in which no more traces are written.
    #[must_use]
    pub fn without_traces(self) -> Self {
        Self { keeps_traces: false, ..self }
    }

    /// The directory, for others to open.
    #[must_use]
    pub fn released(self) -> Self {
        Self { lock: None, ..self }
    }

    /// Writes where the results to come are from. A resumed run keeps what is said of those that
    /// are there.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn write_provenance(
        &self,
        provenance: &Provenance,
        resume: bool,
    ) -> Result<(), RecordError> {
        let earlier = Provenance::read(&self.dir).ok().flatten();
        let provenance = match earlier.filter(|_| resume) {
            Some(earlier) => earlier.resumed_by(provenance),
            None => provenance.clone(),
        };
        self.write(file::PROVENANCE, json(&provenance).as_bytes())
    }

    /// The directory.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// The numbers in `metrics.json`.
    #[must_use]
    pub fn metrics(&self) -> &Metrics {
        &self.metrics
    }

    /// Where the file `name` of this run is.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }

    /// Changes the metrics, in memory and in the directory.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn update(&mut self, change: impl FnOnce(&mut Metrics)) -> Result<(), RecordError> {
        change(&mut self.metrics);
        if self.in_memory {
            return Ok(());
        }
        self.write(file::METRICS, json(&self.metrics).as_bytes())
    }

    /// Notes what files with results are, now that they are finished; see [`RunDir::is_as_noted`].
    pub fn note(&mut self, names: &[&str]) {
        for name in names {
            match note_of(&self.path(name)) {
                Some(note) => self.metrics.files.insert((*name).to_owned(), note),
                None => self.metrics.files.remove(*name),
            };
        }
    }

    /// Whether a file is what was noted; of one without a note, whether it is there.
    #[must_use]
    pub fn is_as_noted(&self, name: &str) -> bool {
        let found = note_of(&self.path(name));
        match self.metrics.files.get(name) {
            Some(noted) => found.as_ref() == Some(noted),
            None => found.is_some(),
        }
    }

    /// Writes a file, which is there either whole or not at all, also if the machine stops.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RecordError> {
        write_atomically(&self.path(name), bytes)
    }

    /// Whether the traces of closed loops and the errors of nets point by point are written.
    #[must_use]
    pub fn keeps_traces(&self) -> bool {
        self.keeps_traces
    }

    /// Removes what closed loops have written.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn remove_loops(&mut self) -> Result<(), RecordError> {
        // A trial begins in an empty directory.
        let in_memory = self.in_memory;
        for name in file::of_loops().filter(|_| !in_memory) {
            self.remove(&name)?;
        }
        Ok(())
    }

    /// Removes a file, if there is one, and what was noted of it.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn remove(&mut self, name: &str) -> Result<(), RecordError> {
        self.metrics.files.remove(name);
        let path = self.path(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(RecordError::unwritable(&path)(error))
            }
            _ => Ok(()),
        }
    }
}

/// Files up to this size, in bytes, are told apart by more than their size.
const DIGESTED: u64 = 1 << 26;

/// What a file is, if it is there.
fn note_of(path: &Path) -> Option<FileNote> {
    let bytes = fs::metadata(path).ok()?.len();
    let digest = || fs::read(path).ok().map(sha256);
    let sha256 = if bytes > DIGESTED { None } else { Some(digest()?) };
    Some(FileNote { bytes, sha256 })
}

/// Whether `dir` is empty or belongs to `experiment`.
fn check_owner(dir: &Path, experiment: &Experiment) -> Result<(), RecordError> {
    // Listed before the config is read, which is the first file of a run: of one that another
    // process begins meanwhile, either nothing is seen or the config too.
    let entries = fs::read_dir(dir).map_err(RecordError::unreadable(dir))?;
    let is_ours = |e: &fs::DirEntry| is_unfinished(e) || e.file_name() == LOCK;
    let others = entries.into_iter().any(|e| !e.as_ref().is_ok_and(is_ours));
    match fs::read_to_string(dir.join(file::CONFIG)) {
        Ok(text) if text == config_text(experiment) => Ok(()),
        Ok(_) => Err(RecordError::OtherConfig { dir: dir.to_owned() }),
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(RecordError::unreadable(dir)(error))
        }
        Err(_) if others => Err(RecordError::NoRunDirectory { dir: dir.to_owned() }),
        Err(_) => Ok(()),
    }
}

fn config_text(experiment: &Experiment) -> String {
    let heading = "# What was run, every value spelled out. With all of them here, another \
    `preset` would change\n\
                   # nothing but the name: choose it in the file this was made from.\n\n";
    format!("{heading}{}", experiment.to_toml())
}

#[cfg(test)]
mod tests;
