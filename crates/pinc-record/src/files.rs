//! The names of a run's files, and how a file is read and written.

use crate::error::RecordError;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::io::{BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Names of the files of a run directory.
pub mod file {
    use pinc_config::ModelKind;

    /// The resolved config.
    pub const CONFIG: &str = "config.toml";
    /// Where the results come from.
    pub const PROVENANCE: &str = "provenance.json";
    /// A training to be resumed.
    pub const CHECKPOINT: &str = "checkpoint.bin";
    /// The training log.
    pub const TRAINING: &str = "training.csv";
    /// The net.
    pub const MODEL: &str = "model.safetensors";
    /// The errors of one step of the net over its domain.
    pub const DOMAIN_ERROR: &str = "domain-error.csv";
    /// The errors of the net along the closed loop.
    pub const MODEL_ERROR: &str = "model-error.csv";
    /// The free run.
    pub const PREDICTION: &str = "prediction.csv";
    /// The numbers that the run gave.
    pub const METRICS: &str = "metrics.json";
    /// The results of an identification.
    pub const IDENTIFY: &str = "identify.json";
    /// The data that it was identified from, beside the fit.
    pub const RESIDUALS: &str = "residuals.csv";
    /// The config with the plant that was identified.
    pub const IDENTIFIED: &str = "identified.toml";
    /// The certificate of the errors of one step.
    pub const CERTIFY: &str = "certify.json";
    /// The errors of one step, point by point.
    pub const CERTIFY_POINTS: &str = "certify.csv";
    /// The map of what is proven over a domain.
    pub const CERTIFY_MAP: &str = "certify-map.svg";
    /// A search for the largest error over a domain, to be resumed.
    pub const CERTIFY_SEARCH: &str = "certify-search.json";
    /// The report.
    pub const REPORT: &str = "report.html";
    /// The directory of the report's pictures.
    pub const FIGURES: &str = "figures";
    /// The trials of a sweep.
    pub const SWEEP: &str = "sweep.csv";
    /// The config of the best candidate of a sweep with a search.
    pub const BEST: &str = "best.toml";
    /// The spread of the trials in each cell of a sweep.
    pub const SUMMARY: &str = "summary.csv";
    /// The times of the trials of a sweep.
    pub const TIMINGS: &str = "timings.csv";

    /// The dense trace of the closed loop with one of `models` models.
    #[must_use]
    pub fn control(model: ModelKind, models: usize) -> String {
        of_model("control", model, models)
    }

    /// The control steps of the closed loop with one of `models` models.
    #[must_use]
    pub fn steps(model: ModelKind, models: usize) -> String {
        of_model("steps", model, models)
    }

    /// What plans of the closed loop with one of `models` models expected.
    #[must_use]
    pub fn plans(model: ModelKind, models: usize) -> String {
        of_model("plans", model, models)
    }

    /// The estimates in the closed loop with one of `models` models.
    #[must_use]
    pub fn estimates(model: ModelKind, models: usize) -> String {
        of_model("estimates", model, models)
    }

    /// A run with one model has one file of a kind, with several a file for each.
    fn of_model(kind: &str, model: ModelKind, models: usize) -> String {
        match models {
            1 => format!("{kind}.csv"),
            _ => format!("{kind}-{model}.csv"),
        }
    }

    /// All names that closed loops may have written under.
    pub(crate) fn of_loops() -> impl Iterator<Item = String> {
        let models = ModelKind::ALL.into_iter().flat_map(|model| [(model, 1), (model, 2)]);
        let loops = models.flat_map(|(model, count)| {
            [control, steps, plans, estimates].map(|name| name(model, count))
        });
        loops.chain([MODEL_ERROR.to_owned()])
    }
}

/// How the name of an unfinished file begins; a killed run can leave one behind.
const UNFINISHED: &str = ".pinc-unfinished-";

/// The bytes of a file.
///
/// # Errors
///
/// [`RecordError::Unreadable`].
pub fn read_file(path: &Path) -> Result<Vec<u8>, RecordError> {
    fs::read(path).map_err(RecordError::unreadable(path))
}

/// The text of a file; `None` if it does not exist.
///
/// # Errors
///
/// [`RecordError::Unreadable`].
pub fn read_text(path: &Path) -> Result<Option<String>, RecordError> {
    match fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(RecordError::unreadable(path)(error)),
    }
}

/// The content of a JSON file; `None` if it does not exist.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, RecordError> {
    let Some(text) = read_text(path)? else { return Ok(None) };
    let value = serde_json::from_str(&text);
    value.map(Some).map_err(|source| RecordError::Json { path: path.to_owned(), source })
}

/// The text of a JSON file.
pub(crate) fn json(value: &impl Serialize) -> String {
    let text = serde_json::to_string_pretty(value);
    let mut text = text.expect("results have string keys, so that they can be JSON");
    text.push('\n');
    text
}

/// Writes a file, which is there either whole or not at all, also if the machine stops: it is
/// written under another name beside its place, flushed to the disk, and renamed.
///
/// # Errors
///
/// [`RecordError::Unwritable`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let mut file = AtomicFile::create(path)?;
    file.write(bytes)?;
    file.finish()
}

/// Like [`write_atomically`], but not flushed to the disk: if the machine stops, the file may be
/// missing or damaged afterwards. A hundred times as fast.
pub(crate) fn write_unflushed(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let mut file = AtomicFile::create(path)?;
    file.write(bytes)?;
    file.put(false)
}

/// Refuses to write the file that `option` asks for over one that is read: `inputs`, each with what it
/// is read as.
///
/// # Errors
///
/// [`RecordError::AlsoRead`].
pub fn check_output<'p>(
    (option, output): (&'static str, &Path),
    inputs: impl IntoIterator<Item = (&'p str, &'p Path)>,
) -> Result<(), RecordError> {
    let mut inputs = inputs.into_iter();
    let found = inputs.find(|(_, input)| is_same_file(input, output));
    found.map_or(Ok(()), |(input, _)| {
        Err(RecordError::AlsoRead { option, path: output.to_owned(), input: input.to_owned() })
    })
}

/// Refuses to write the page that `option` asks for over a file of the run in `dir`: its report, or
/// anything that is no page.
///
/// # Errors
///
/// [`RecordError::AlsoRead`], or [`RecordError::Unreadable`] for the directory.
pub fn check_page((option, page): (&'static str, &Path), dir: &Path) -> Result<(), RecordError> {
    for entry in fs::read_dir(dir).map_err(RecordError::unreadable(dir))? {
        let path = entry.map_err(RecordError::unreadable(dir))?.path();
        let is_page = path.extension().is_some_and(|ending| ending == "html");
        if !is_page || path.ends_with(file::REPORT) {
            let input = format!("a file of the run {}", dir.display());
            check_output((option, page), [(&*input, &*path)])?;
        }
    }
    Ok(())
}

/// Whether two paths lead to one file, also by links.
fn is_same_file(one: &Path, two: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let id = |path: &Path| fs::metadata(path).ok().map(|m| (m.dev(), m.ino()));
        id(one).is_some() && id(one) == id(two)
    }
    #[cfg(not(unix))]
    {
        let place = |path: &Path| fs::canonicalize(path).ok();
        place(one).is_some() && place(one) == place(two)
    }
}

/// Writes what a user has named: a file like [`write_atomically`], that which a link leads to, and
/// straight into pipes and devices.
///
/// # Errors
///
/// [`RecordError::Unwritable`].
pub fn write_output(path: &Path, bytes: &[u8]) -> Result<(), RecordError> {
    let unwritable = || RecordError::unwritable(path);
    match fs::metadata(path) {
        Ok(found) if found.is_file() => {
            let place = fs::canonicalize(path).map_err(unwritable())?;
            write_atomically(&place, bytes)
        }
        Err(error) if error.kind() == ErrorKind::NotFound && !path.is_symlink() => {
            write_atomically(path, bytes)
        }
        _ => {
            let mut options = fs::OpenOptions::new();
            // A link that leads to no file yet.
            options.write(true).create(path.is_symlink());
            let written = options.open(path).and_then(|mut file| file.write_all(bytes));
            written.map_err(unwritable())
        }
    }
}

/// A file being written, which is at its place once it is finished: written under another name
/// beside it, flushed to the disk, and renamed. If this is dropped before, there is no trace of it.
#[derive(Debug)]
pub(crate) struct AtomicFile {
    path: PathBuf,
    file: BufWriter<NamedTempFile>,
}

impl AtomicFile {
    /// Begins the file `path`.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`], as of the other methods.
    pub(crate) fn create(path: &Path) -> Result<Self, RecordError> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(UNFINISHED);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // As for any new file, less what the user's umask takes away.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let file = builder.tempfile_in(parent(path)).map_err(RecordError::unwritable(path))?;
        Ok(Self { path: path.to_owned(), file: BufWriter::new(file) })
    }

    /// Adds bytes.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> Result<(), RecordError> {
        self.file.write_all(bytes).map_err(RecordError::unwritable(&self.path))
    }

    /// Puts the file at its place, without waiting for the disk.
    fn put(self, is_flushed: bool) -> Result<(), RecordError> {
        let Self { path, file } = self;
        let put = || {
            let file = file.into_inner()?;
            if is_flushed {
                file.as_file().sync_all()?;
            }
            file.persist(&path).map_err(|error| error.error)?;
            #[cfg(unix)]
            if is_flushed {
                fs::File::open(parent(&path))?.sync_all()?;
            }
            Ok(())
        };
        put().map_err(RecordError::unwritable(&path))
    }

    /// Puts the file at its place.
    pub(crate) fn finish(self) -> Result<(), RecordError> {
        self.put(true)
    }
}

/// The directory of a file.
fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(dir) if dir != Path::new("") => dir,
        _ => Path::new("."),
    }
}

/// Whether a file is one that a killed run has left unfinished.
pub(crate) fn is_unfinished(entry: &fs::DirEntry) -> bool {
    entry.file_name().to_string_lossy().starts_with(UNFINISHED)
}

/// Removes the files in `dir`, if there is one, that a killed run has left unfinished.
///
/// # Errors
///
/// [`RecordError::Unwritable`].
pub fn remove_unfinished(dir: &Path) -> Result<(), RecordError> {
    let remove = || {
        let entries = match fs::read_dir(dir) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            entries => entries?,
        };
        for entry in entries {
            let entry = entry?;
            if is_unfinished(&entry) {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    };
    remove().map_err(RecordError::unwritable(dir))
}
