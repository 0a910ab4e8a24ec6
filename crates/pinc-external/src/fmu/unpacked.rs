//! The directory that an FMU is unpacked into, which is not left behind.

use std::fs::{self, File};
use std::path::Path;
use tempfile::TempDir;

/// What the directories' names begin with.
const PREFIX: &str = "pinc-fmu-";

/// The file in each that its process has locked.
const LOCK: &str = ".lock";

/// Directories that others took away, before it is given up to make one.
const MOST_TRIES: usize = 100;

/// A directory that is removed when this is dropped. Directories of processes that ended without that, as
/// one does in which a binary crashes, are removed when the next is made.
#[derive(Debug)]
pub(super) struct Unpacked {
    dir: TempDir,
    /// The system unlocks it when the process ends, however that is.
    _lock: File,
}

impl Unpacked {
    /// A new directory; in words, why there is none.
    pub(super) fn new() -> Result<Self, String> {
        let place = std::env::temp_dir();
        remove_abandoned(&place);
        let failed = |error| format!("no directory to unpack it in: {error}");
        for _ in 0..MOST_TRIES {
            let dir = tempfile::Builder::new().prefix(PREFIX).tempdir_in(&place).map_err(failed)?;
            // Another process may take it for abandoned until it is locked.
            if let Some(lock) = locked(dir.path()) {
                return Ok(Self { dir, _lock: lock });
            }
        }
        Err(format!("no directory to unpack it in {} can be locked", place.display()))
    }

    pub(super) fn path(&self) -> &Path {
        self.dir.path()
    }
}

/// The lock of a new directory, which has none yet.
fn locked(dir: &Path) -> Option<File> {
    let path = dir.join(LOCK);
    let file = File::create_new(&path).ok()?;
    let is_ours = file.try_lock().is_ok() && path.exists();
    is_ours.then_some(file)
}

/// Removes the directories in `place` that no process has locked. What cannot be removed is somebody
/// else's.
fn remove_abandoned(place: &Path) {
    for entry in fs::read_dir(place).into_iter().flatten().flatten() {
        if !entry.file_name().to_string_lossy().starts_with(PREFIX) {
            continue;
        }
        let dir = entry.path();
        match File::open(dir.join(LOCK)) {
            Ok(lock) if lock.try_lock().is_ok() => drop(fs::remove_dir_all(&dir)),
            Ok(_) => {}
            // Only an empty one, in which a lock is not made yet.
            Err(_) => drop(fs::remove_dir(&dir)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directories_without_a_process_are_removed_and_those_with_one_stay() {
        let place = tempfile::tempdir().unwrap();
        let of = |name: &str| place.path().join(name);
        for name in ["pinc-fmu-dead", "pinc-fmu-alive", "pinc-fmu-empty", "other"] {
            fs::create_dir(of(name)).unwrap();
            if name != "pinc-fmu-empty" {
                fs::write(of(name).join(LOCK), "").unwrap();
                fs::write(of(name).join("binary.so"), "").unwrap();
            }
        }
        let alive = File::open(of("pinc-fmu-alive").join(LOCK)).unwrap();
        alive.lock().unwrap();
        remove_abandoned(place.path());
        let left = |name| of(name).exists();
        let names = ["pinc-fmu-dead", "pinc-fmu-alive", "pinc-fmu-empty", "other"];
        assert_eq!(names.map(left), [false, true, false, true]);
        drop(alive);
        remove_abandoned(place.path());
        assert!(!left("pinc-fmu-alive") && left("other"));
    }

    #[test]
    fn a_new_directory_is_locked_and_goes_with_its_owner() {
        let unpacked = Unpacked::new().unwrap();
        let path = unpacked.path().to_owned();
        drop(Unpacked::new().unwrap());
        assert!(path.exists(), "taken away by the next");
        assert!(locked(&path).is_none());
        drop(unpacked);
        assert!(!path.exists());
    }
}
