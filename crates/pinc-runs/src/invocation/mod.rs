//! The invocation of the program that is running: when, with what and on what.

use pinc_record::Invocation;
use std::path::{Component, Path};
use std::time::{SystemTime, UNIX_EPOCH};

/// The invocation that begins now, by the command line `arguments` (without the program's name).
pub fn invocation(arguments: &[String]) -> Invocation {
    let command = std::iter::once("pinc".to_owned());
    Invocation {
        started: rfc3339(SystemTime::now()),
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

/// A time as `2026-01-31T12:00:00Z`.
pub fn rfc3339(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
    let (days, second) = (seconds / 86400, seconds % 86400);
    let (year, month, day) = civil(days);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Year, month and day of a number of days since 1970-01-01. In a year that begins in March the
/// leap day is the last, and the months' lengths are (153 m + 2)/5 apart.
fn civil(days: u64) -> (u64, u64, u64) {
    let days = days + 719_468; // since 0000-03-01
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let (year, month) = (400 * era + year_of_era, if month < 10 { month + 3 } else { month - 9 });
    (if month <= 2 { year + 1 } else { year }, month, day)
}

#[cfg(test)]
mod tests;
