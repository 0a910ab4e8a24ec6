//! The run directory: which files a run has, and how they come to be there.

mod checkpoint;
mod csv;
mod metrics;

pub(crate) use checkpoint::{Saved, load as load_checkpoint, save as save_checkpoint};
pub(crate) use csv::{Table, lines_up_to, number};
pub(crate) use metrics::number_or_null;
pub use metrics::{
    ControlMetrics, Excess, Metrics, OneStepMetrics, OutsideDomain, PredictionMetrics, StepTimes,
    SweepMetrics, TrainingMetrics, ValidationMetrics, WallTimes,
};

use crate::spec::{Experiment, ModelKind};
use crate::{BenchError, Provenance};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Names of the files of a run directory.
pub(crate) mod file {
    pub(crate) const CONFIG: &str = "config.toml";
    pub(crate) const PROVENANCE: &str = "provenance.json";
    pub(crate) const CHECKPOINT: &str = "checkpoint.bin";
    pub(crate) const TRAINING: &str = "training.csv";
    pub(crate) const MODEL: &str = "model.safetensors";
    pub(crate) const PREDICTION: &str = "prediction.csv";
    pub(crate) const METRICS: &str = "metrics.json";
    pub(crate) const REPORT: &str = "report.html";
    /// The directory of the report's pictures.
    pub(crate) const FIGURES: &str = "figures";
    pub(crate) const SWEEP: &str = "sweep.csv";
    pub(crate) const SUMMARY: &str = "summary.csv";
    pub(crate) const TIMINGS: &str = "timings.csv";
    /// What the closed loops write with one model; with several, a file for each.
    pub(crate) const LOOPS: [&str; 2] = ["control", "steps"];
}

/// How the name of an unfinished file begins; a killed run can leave one behind.
const UNFINISHED: &str = ".pinc-unfinished-";

/// The results of a run: its directory, and the numbers in its `metrics.json`.
#[derive(Clone, Debug)]
pub struct RunDir {
    dir: PathBuf,
    metrics: Metrics,
    keeps_traces: bool,
}

impl RunDir {
    /// A record in `dir`, made if it is not there, for the results of `experiment`. What the
    /// directory holds of the same experiment stays until it is replaced.
    pub(crate) fn open(dir: &Path, experiment: &Experiment) -> Result<Self, BenchError> {
        fs::create_dir_all(dir).map_err(BenchError::unwritable(dir))?;
        check_owner(dir, experiment)?;
        remove_unfinished(dir).map_err(BenchError::unwritable(dir))?;
        let metrics = match fs::read(dir.join(file::METRICS)) {
            Ok(bytes) => serde_json::from_slice(&bytes).ok(),
            Err(_) => None,
        };
        let metrics = metrics.unwrap_or_else(|| Metrics::new(experiment));
        let record = Self { dir: dir.to_owned(), metrics, keeps_traces: true };
        record.write(file::CONFIG, config_text(experiment).as_bytes())?;
        Ok(record)
    }

    /// A record for the results of a trial, in a directory that is there and empty. What the trial was
    /// is said by the sweep that it belongs to.
    pub(crate) fn of_trial(dir: &Path, experiment: &Experiment, keeps_traces: bool) -> Self {
        Self { dir: dir.to_owned(), metrics: Metrics::new(experiment), keeps_traces }
    }

    /// The record of a run that has been made.
    pub(crate) fn existing(dir: &Path) -> Result<Self, BenchError> {
        let path = dir.join(file::METRICS);
        let bytes = fs::read(&path).map_err(BenchError::unreadable(&path))?;
        let metrics = serde_json::from_slice(&bytes);
        let metrics = metrics.map_err(|problem| BenchError::Results { path, problem })?;
        Ok(Self { dir: dir.to_owned(), metrics, keeps_traces: true })
    }

    /// Says where the results to come are from. A run that is gone on with (`resume`) keeps what is
    /// said of those that are there.
    pub(crate) fn write_provenance(
        &self,
        provenance: &Provenance,
        resume: bool,
    ) -> Result<(), BenchError> {
        let earlier = fs::read(self.path(file::PROVENANCE)).ok().filter(|_| resume);
        let earlier = earlier.and_then(|bytes| serde_json::from_slice::<Provenance>(&bytes).ok());
        let provenance = match earlier {
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
    pub(crate) fn update(&mut self, change: impl FnOnce(&mut Metrics)) -> Result<(), BenchError> {
        change(&mut self.metrics);
        self.write(file::METRICS, json(&self.metrics).as_bytes())
    }

    /// Writes a file, which is there either whole or not at all, also if the machine stops.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), BenchError> {
        write_atomically(&self.path(name), bytes)
    }

    /// Writes the trace of a closed loop, if this record keeps such.
    pub(crate) fn write_trace(
        &self,
        name: &str,
        table: impl FnOnce() -> Table,
    ) -> Result<(), BenchError> {
        if self.keeps_traces { self.write(name, table().as_bytes()) } else { Ok(()) }
    }

    /// Removes what closed loops have written.
    pub(crate) fn remove_loops(&self) -> Result<(), BenchError> {
        for table in file::LOOPS {
            self.remove(&format!("{table}.csv"))?;
            for model in ModelKind::ALL {
                self.remove(&format!("{table}-{model}.csv"))?;
            }
        }
        Ok(())
    }

    /// Removes a file, if there is one.
    pub(crate) fn remove(&self, name: &str) -> Result<(), BenchError> {
        let path = self.path(name);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                Err(BenchError::unwritable(&path)(error))
            }
            _ => Ok(()),
        }
    }
}

/// Writes a file, which is there either whole or not at all: it is written under another name beside
/// its place, flushed to the disk, and renamed.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), BenchError> {
    let write = || {
        let dir = match path.parent() {
            Some(dir) if dir != Path::new("") => dir,
            _ => Path::new("."),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(UNFINISHED);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As for any new file, less what the user's umask takes away.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(dir)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(path).map_err(|error| error.error)?;
        #[cfg(unix)]
        fs::File::open(dir)?.sync_all()?;
        Ok(())
    };
    write().map_err(BenchError::unwritable(path))
}

/// Whether `dir` is empty or belongs to `experiment`.
fn check_owner(dir: &Path, experiment: &Experiment) -> Result<(), BenchError> {
    match fs::read_to_string(dir.join(file::CONFIG)) {
        Ok(text) if text == config_text(experiment) => Ok(()),
        Ok(_) => Err(BenchError::OtherConfig { dir: dir.to_owned() }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let mut entries = fs::read_dir(dir).map_err(BenchError::unreadable(dir))?;
            match entries.find(|e| !e.as_ref().is_ok_and(is_unfinished)) {
                None => Ok(()),
                Some(_) => Err(BenchError::NoRunDirectory { dir: dir.to_owned() }),
            }
        }
        Err(error) => Err(BenchError::unreadable(dir)(error)),
    }
}

fn is_unfinished(entry: &fs::DirEntry) -> bool {
    entry.file_name().to_string_lossy().starts_with(UNFINISHED)
}

fn remove_unfinished(dir: &Path) -> io::Result<()> {
    for entry in fs::read_dir(dir)? {
        let entry = entry?;
        if is_unfinished(&entry) {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

fn config_text(experiment: &Experiment) -> String {
    let heading = "# What was run, every value spelled out. With all of them here, another `preset` would change\n\
                   # nothing but the name: choose it in the file this was made from.\n\n";
    format!("{heading}{}", experiment.to_toml())
}

fn json(value: &impl serde::Serialize) -> String {
    let text = serde_json::to_string_pretty(value);
    let mut text = text.expect("results have string keys, so that they can be JSON");
    text.push('\n');
    text
}
