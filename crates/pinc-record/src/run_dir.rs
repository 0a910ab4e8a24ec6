//! The directory of a run, and its metrics.

use crate::csv::CsvText;
use crate::error::RecordError;
use crate::files::{file, is_unfinished, json, remove_unfinished, write_atomically};
use crate::metrics::Metrics;
use crate::provenance::Provenance;
use pinc_config::Experiment;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The results of a run: its directory, and the numbers in its `metrics.json`.
#[derive(Clone, Debug)]
pub struct RunDir {
    dir: PathBuf,
    metrics: Metrics,
    keeps_traces: bool,
}

impl RunDir {
    /// The directory `dir`, made if it is not there, for the results of `experiment`. What it holds
    /// of the same experiment stays until it is replaced.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if it cannot be read or written, or holds something else.
    pub fn open(dir: &Path, experiment: &Experiment) -> Result<Self, RecordError> {
        fs::create_dir_all(dir).map_err(RecordError::unwritable(dir))?;
        check_owner(dir, experiment)?;
        remove_unfinished(dir).map_err(RecordError::unwritable(dir))?;
        // Damaged metrics are made anew, like those that are missing.
        let metrics = Metrics::read(dir).ok().flatten();
        let metrics = metrics.unwrap_or_else(|| Metrics::new(experiment));
        let run = Self { dir: dir.to_owned(), metrics, keeps_traces: true };
        run.write(file::CONFIG, config_text(experiment).as_bytes())?;
        Ok(run)
    }

    /// The directory of a trial, which is there and empty. What the trial was is said by the sweep
    /// that it belongs to.
    #[must_use]
    pub fn of_trial(dir: &Path, experiment: &Experiment, keeps_traces: bool) -> Self {
        Self { dir: dir.to_owned(), metrics: Metrics::new(experiment), keeps_traces }
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
        Ok(Self { dir: dir.to_owned(), metrics, keeps_traces: true })
    }

    /// The same directory, in which no more traces are written.
    #[must_use]
    pub fn without_traces(self) -> Self {
        Self { keeps_traces: false, ..self }
    }

    /// Writes where the results to come are from. A resumed run keeps what is said of those that are
    /// there.
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
        self.write(file::METRICS, json(&self.metrics).as_bytes())
    }

    /// Writes a file, which is there either whole or not at all, also if the machine stops.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RecordError> {
        write_atomically(&self.path(name), bytes)
    }

    /// Writes the trace of a closed loop or the errors of a net point by point, if this run keeps traces.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn write_trace(
        &self,
        name: &str,
        table: impl FnOnce() -> CsvText,
    ) -> Result<(), RecordError> {
        if self.keeps_traces { self.write(name, table().as_bytes()) } else { Ok(()) }
    }

    /// Removes what closed loops have written.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn remove_loops(&self) -> Result<(), RecordError> {
        for name in file::of_loops() {
            self.remove(&name)?;
        }
        Ok(())
    }

    /// Removes a file, if there is one.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn remove(&self, name: &str) -> Result<(), RecordError> {
        let path = self.path(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                Err(RecordError::unwritable(&path)(error))
            }
            _ => Ok(()),
        }
    }
}

/// Whether `dir` is empty or belongs to `experiment`.
fn check_owner(dir: &Path, experiment: &Experiment) -> Result<(), RecordError> {
    match fs::read_to_string(dir.join(file::CONFIG)) {
        Ok(text) if text == config_text(experiment) => Ok(()),
        Ok(_) => Err(RecordError::OtherConfig { dir: dir.to_owned() }),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let mut entries = fs::read_dir(dir).map_err(RecordError::unreadable(dir))?;
            match entries.find(|e| !e.as_ref().is_ok_and(is_unfinished)) {
                None => Ok(()),
                Some(_) => Err(RecordError::NoRunDirectory { dir: dir.to_owned() }),
            }
        }
        Err(error) => Err(RecordError::unreadable(dir)(error)),
    }
}

fn config_text(experiment: &Experiment) -> String {
    let heading = "# What was run, every value spelled out. With all of them here, another \
    `preset` would change\n\
                   # nothing but the name: choose it in the file this was made from.\n\n";
    format!("{heading}{}", experiment.to_toml())
}
