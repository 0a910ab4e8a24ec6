//! Sweeps on a Slurm that is there: scripts, their submission, and how far the jobs are.

use crate::sweep::{Status, status, units_left};
use pinc_config::{Experiment, Plants, Problem, SlurmSpec};
use pinc_record::{RecordError, RunDir, read_text, write_atomically};
use pinc_runs::progress::Stage;
use pinc_runs::{Options, RunError};
use std::fmt::{self, Write as _};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use toml::{Table, Value};

const WORK: &str = include_str!("work.sh");
const MERGE: &str = include_str!("merge.sh");
const SUBMIT: &str = include_str!("submit.sh");

/// The folder of the scripts in the run directory.
const FOLDER: &str = "slurm";
/// The file in it with the numbers of the jobs.
const JOBS: &str = "jobs";
/// The most jobs if nothing is said.
const FEW: usize = 16;
/// Time between two looks at the jobs.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// How a sweep is given to Slurm.
#[derive(Clone, Debug, Default)]
pub struct OnSlurm {
    /// How many jobs share it; if absent, what the config says, or one for each unit of work, 16 at
    /// most.
    pub jobs: Option<usize>,
    /// Options that override the config's, each as `key=value`.
    pub options: Vec<String>,
    /// Whether the scripts are written only.
    pub dry_run: bool,
    /// Whether to wait until the jobs are over.
    pub wait: bool,
}

/// A submitted sweep.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Submitted {
    /// The folder of the scripts.
    pub folder: PathBuf,
    /// How many jobs share the sweep; none if nothing is left to do.
    pub jobs: usize,
    /// Slurm's numbers of the jobs; empty if the scripts were written only.
    pub numbers: Vec<String>,
}

impl fmt::Display for Submitted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (folder, jobs) = (self.folder.display(), self.jobs);
        let dir = self.folder.parent().unwrap_or(&self.folder).display();
        match (&self.numbers[..], jobs) {
            (_, 0) => write!(f, "all trials are over: there is nothing to submit"),
            ([], _) => write!(
                f,
                "{folder}/work.sh: one of {jobs} jobs\n{folder}/merge.sh: tables and report, after \
                 them\n{folder}/submit.sh: submits both"
            ),
            (numbers, _) => write!(
                f,
                "submitted: {} ({jobs} jobs, and the merge after them); `pinc status {dir}` shows \
                 their progress",
                numbers.join(", ")
            ),
        }
    }
}

/// Writes the scripts that run a sweep in `dir`, and submits them. What the directory holds is gone
/// on with.
///
/// # Errors
///
/// [`RunError`] if the experiment has no sweep, an option cannot be used, jobs of this sweep are
/// still there, or Slurm refuses.
pub fn submit(experiment: &Experiment, dir: &Path, slurm: &OnSlurm) -> Result<Submitted, RunError> {
    let units = units_left(experiment, dir)?;
    let spec = spec(experiment, slurm)?;
    let folder = dir.join(FOLDER);
    refuse_while_queued(&folder)?;
    let jobs = slurm.jobs.or(spec.jobs).unwrap_or(FEW).min(units);
    let mut submitted = Submitted { folder: folder.clone(), jobs, numbers: Vec::new() };
    if jobs == 0 {
        return Ok(submitted);
    }
    {
        let _alone = RunDir::open(dir, experiment, std::process::id())?;
        fs::create_dir_all(&folder).map_err(RecordError::unwritable(&folder))?;
        for (name, text) in scripts(experiment, dir, &spec, jobs)? {
            write_atomically(&folder.join(name), text.as_bytes())?;
        }
    }
    if !slurm.dry_run {
        let said = said_by("sh", &[folder.join("submit.sh").as_os_str()])?;
        submitted.numbers = said.split_whitespace().map(str::to_owned).collect();
    }
    Ok(submitted)
}

/// Shows how far the jobs are until they are over, or the user has seen enough.
///
/// # Errors
///
/// [`RunError`] if the run directory cannot be read, or the user stopped the waiting; the jobs go
/// on.
pub fn wait(dir: &Path, plants: &Plants, options: &Options<'_>) -> Result<(), RunError> {
    let first = status(dir, plants)?;
    let mut stage = Stage::begin(options.verbosity, "trials", first.counts.trials as u64);
    while !queued(&dir.join(FOLDER))?.is_empty() {
        if options.interrupt.load(std::sync::atomic::Ordering::Relaxed) {
            return Err(RunError::Failed(format!(
                "the jobs continue; `pinc status {}` shows their progress",
                dir.display()
            )));
        }
        let now: Status = status(dir, plants)?;
        let over = now.counts.done + now.counts.failed;
        stage.advance(over as u64, || now.at_work());
        std::thread::sleep(LOOK_EVERY);
    }
    let counts = status(dir, plants)?.counts;
    stage.end(&format!("{} done, {} failed", counts.done, counts.failed));
    Ok(())
}

/// What the config and the command line ask for.
fn spec(experiment: &Experiment, slurm: &OnSlurm) -> Result<SlurmSpec, RunError> {
    let mut table: Table =
        experiment.sweep.as_ref().map(|sweep| sweep.slurm.clone()).unwrap_or_default();
    for option in &slurm.options {
        let wrong =
            |problem: Problem| RunError::usage(format!("--slurm {option}"), problem.to_string());
        let Some((key, value)) = option.split_once('=') else {
            let (found, expected) = ("no `=`".to_owned(), "key=value".to_owned());
            return Err(wrong(Problem::Value { found, expected }));
        };
        let one = Table::from_iter([(key.to_owned(), Value::String(value.to_owned()))]);
        SlurmSpec::of(&one).map_err(|(_, problem)| wrong(problem))?;
        table.extend(one);
    }
    Ok(SlurmSpec::of(&table).expect("both were checked"))
}

/// The scripts by their names.
fn scripts(
    experiment: &Experiment,
    dir: &Path,
    spec: &SlurmSpec,
    jobs: usize,
) -> Result<[(&'static str, String); 3], RunError> {
    let here = PathBuf::from(".");
    let place = std::env::current_dir().map_err(RecordError::unreadable(&here))?;
    let program = std::env::current_exe().map_err(RecordError::unreadable(&here))?;
    let mut options = String::new();
    for (key, value) in &spec.options {
        let _ = writeln!(options, "#SBATCH --{key}={value}");
    }
    let has_threads = spec.options.iter().any(|(key, _)| key == "cpus-per-task");
    let threads = if has_threads { "" } else { "#SBATCH --cpus-per-task=1\n" };
    let modules = match &spec.modules[..] {
        [] => String::new(),
        modules => format!("module load {}\n", modules.join(" ")),
    };
    let config = dir.join(pinc_record::file::CONFIG);
    let filled = |text: &str, threads: &str| {
        let options = format!("{threads}{options}");
        let places = [
            ("{name}", experiment.name.clone()),
            ("{jobs}", jobs.to_string()),
            ("{options}\n", options),
            ("{modules}", modules.clone()),
            ("{place}", quoted(&place)),
            ("{program}", quoted(&program)),
            ("{config}", quoted(&config)),
            ("{folder}", quoted(&dir.join(FOLDER))),
            ("{dir}", quoted(dir)),
        ];
        places.into_iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, &to))
    };
    Ok([
        ("work.sh", filled(WORK, threads)),
        ("merge.sh", filled(MERGE, "")),
        ("submit.sh", filled(SUBMIT, "")),
    ])
}

/// A path as one word of a shell.
fn quoted(path: &Path) -> String {
    format!("'{}'", path.display().to_string().replace('\'', r"'\''"))
}

/// Refuses to do twice what is being done.
fn refuse_while_queued(folder: &Path) -> Result<(), RunError> {
    match &queued(folder)?[..] {
        [] => Ok(()),
        numbers => {
            let numbers = numbers.join(" ");
            Err(RunError::Failed(format!(
                "jobs of this sweep are still in Slurm's queue: {numbers}; wait for them, or run \
                 `scancel {numbers}` first; finished trials are kept"
            )))
        }
    }
}

/// The jobs of the last submission, as far as they are not over.
fn queued(folder: &Path) -> Result<Vec<String>, RunError> {
    let Some(numbers) = read_text(&folder.join(JOBS))? else { return Ok(Vec::new()) };
    let is_there = |number: &&str| {
        let asked = ["--noheader", "--format=%T", "--jobs", number].map(std::ffi::OsStr::new);
        // Slurm forgets finished jobs after a while.
        said_by("squeue", &asked).is_ok_and(|said| !said.trim().is_empty())
    };
    Ok(numbers.split_whitespace().filter(is_there).map(str::to_owned).collect())
}

/// How far the jobs of the last submission are, in words; none if they are over.
pub(crate) fn queue_in_words(dir: &Path) -> Result<Option<String>, RunError> {
    let numbers = queued(&dir.join(FOLDER))?;
    Ok((!numbers.is_empty()).then(|| format!("in Slurm's queue: {}", numbers.join(", "))))
}

/// What a program says.
fn said_by(program: &str, arguments: &[&std::ffi::OsStr]) -> Result<String, RunError> {
    let failed = |said: String| {
        RunError::Failed(format!(
            "{program}: {said}; --dry-run writes the scripts without submitting them"
        ))
    };
    let output = Command::new(program).args(arguments).output();
    let output = output.map_err(|error| failed(error.to_string()))?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    match output.status.success() {
        true => Ok(text(&output.stdout)),
        false => Err(failed(text(&output.stderr))),
    }
}

#[cfg(test)]
mod tests;
