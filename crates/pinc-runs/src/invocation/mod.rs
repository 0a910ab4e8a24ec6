//! The invocation of the program that is running: when, with what and on what.

use pinc_record::{Invocation, rfc3339};
use std::path::{Component, Path};
use std::time::{SystemTime, UNIX_EPOCH};

/// The invocation that begins now, by the command line `arguments` (without the program's name).
pub fn invocation(arguments: &[String]) -> Invocation {
    let command = std::iter::once("pinc".to_owned());
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Invocation {
        started: rfc3339(now),
        command: command.chain(arguments.iter().map(|a| without_places(a))).collect(),
        version: crate::VERSION.to_owned(),
        git_commit: option_env!("PINC_GIT_COMMIT").map(str::to_owned),
        git_dirty: option_env!("PINC_GIT_DIRTY").map(|dirty| dirty == "true"),
        rustc: env!("PINC_RUSTC").to_owned(),
        target: env!("PINC_TARGET").to_owned(),
        profile: env!("PINC_PROFILE").to_owned(),
        cpu: cpu_model(),
        cores: cores(),
        os: std::env::consts::OS.to_owned(),
    }
}

/// How many threads may work at a time: what Slurm gave to this task, or what the machine has.
pub fn cores() -> usize {
    let given = std::env::var("SLURM_CPUS_PER_TASK").ok().and_then(|text| text.parse().ok());
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    given.filter(|cores| *cores > 0).unwrap_or_else(all)
}

/// What a path begins with whose directories are left out.
const CUT: &str = ".../";

/// An argument in which a path says nothing of where its user keeps things: relative to the working
/// directory if it is below, else its last part behind `CUT`.
fn without_places(argument: &str) -> String {
    let (key, value) = match argument.split_once('=') {
        Some((key, value)) if key.starts_with("--") => (Some(key), value),
        _ => (None, argument),
    };
    let path = Path::new(value);
    if is_below(path) {
        return argument.to_owned();
    }
    let here = std::env::current_dir().ok();
    let below = here.and_then(|here| path.strip_prefix(here).ok().map(Path::to_owned));
    let short = match below.filter(|below| is_below(below)) {
        Some(below) => below.to_string_lossy().into_owned(),
        None => CUT.to_owned() + &path.file_name().unwrap_or_default().to_string_lossy(),
    };
    match key {
        Some(key) => format!("{key}={short}"),
        None => short,
    }
}

/// Whether a path leads to something in the working directory.
fn is_below(path: &Path) -> bool {
    !path.has_root() && path.components().all(|c| c != Component::ParentDir)
}

/// The processor's name as Linux has it; the architecture elsewhere.
fn cpu_model() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == "model name").then(|| value.trim().to_owned())
    });
    name.unwrap_or_else(|| std::env::consts::ARCH.to_owned())
}

#[cfg(test)]
mod tests;
