//! Who works on a run directory: one process, or several that share its work.

use crate::error::RecordError;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The name of the file that is locked. A killed process leaves it behind, unlocked.
pub(crate) const LOCK: &str = ".pinc-lock";

/// A lock that no other process has, or that is shared by those that work together, until this is
/// dropped.
#[derive(Debug)]
pub(crate) struct Lock {
    /// The system unlocks it when the process ends, however that is.
    file: File,
    path: PathBuf,
    shared: bool,
    /// Whether the file system has locks.
    real: bool,
}

impl Lock {
    /// Locks the directory `dir` for this process, whose id is `id`.
    ///
    /// # Errors
    ///
    /// [`RecordError::Locked`] if another process has it; [`RecordError::Unwritable`].
    pub(crate) fn of_dir(dir: &Path, id: u32) -> Result<Self, RecordError> {
        let path = dir.join(LOCK);
        let holder = match Self::take(&path, id, false)? {
            Ok(lock) => return Ok(lock),
            Err(holder) => holder,
        };
        Err(RecordError::Locked { dir: dir.to_owned(), holder })
    }

    /// Locks the directory `dir` together with others that share it.
    ///
    /// # Errors
    ///
    /// [`RecordError::Locked`] if another process has it alone; [`RecordError::Unwritable`].
    pub(crate) fn shared(dir: &Path, id: u32) -> Result<Self, RecordError> {
        match Self::take(&dir.join(LOCK), id, true)? {
            Ok(lock) => Ok(lock),
            Err(holder) => Err(RecordError::Locked { dir: dir.to_owned(), holder }),
        }
    }

    /// Locks the file `path`, which is made if it is not there, or says which process has it, if
    /// that is known.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub(crate) fn take(
        path: &Path,
        id: u32,
        shared: bool,
    ) -> Result<Result<Self, Option<u32>>, RecordError> {
        let unwritable = || RecordError::unwritable(path);
        loop {
            let mut options = File::options();
            options.read(true).write(true).create(true).truncate(false);
            let mut file = options.open(path).map_err(unwritable())?;
            let locked = if shared { file.try_lock_shared() } else { file.try_lock() };
            let real = locked.is_ok();
            match locked {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut text = String::new();
                    let read = file.read_to_string(&mut text);
                    return Ok(Err(read.ok().and_then(|_| text.trim().parse().ok())));
                }
                // A file system without locks.
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(error)) => return Err(unwritable()(error)),
            }
            // It may have been removed, by the process that had it, after it was opened here.
            if !is_at(&file, path) {
                continue;
            }
            write_id(&mut file, id).map_err(unwritable())?;
            return Ok(Ok(Self { file, path: path.to_owned(), shared, real }));
        }
    }

    /// This lock for this process alone; none if others share it. Of all that share a lock and let
    /// it go, the last one gets it.
    pub(crate) fn alone(mut self) -> Option<Self> {
        (!self.shared || self.becomes_exclusive()).then_some(self)
    }

    /// Whether it keeps others out: some file systems have no locks.
    pub(crate) fn is_real(&self) -> bool {
        self.real
    }

    /// Given up first, so that one succeeds if two do this at once.
    fn becomes_exclusive(&mut self) -> bool {
        let _ = self.file.unlock();
        let alone = match self.file.try_lock() {
            Ok(()) => true,
            Err(TryLockError::Error(error)) => error.kind() == io::ErrorKind::Unsupported,
            Err(TryLockError::WouldBlock) => false,
        };
        self.shared = !alone;
        alone && is_at(&self.file, &self.path)
    }
}

/// Whether some process has the lock file `path`.
pub(crate) fn is_taken(path: &Path) -> bool {
    let Ok(file) = File::options().read(true).write(true).open(path) else { return false };
    matches!(file.try_lock(), Err(TryLockError::WouldBlock))
}

/// Writes the id, for those that are refused.
fn write_id(file: &mut File, id: u32) -> io::Result<()> {
    file.set_len(0)?;
    file.seek(SeekFrom::Start(0))?;
    writeln!(file, "{id}")
}

/// Whether `path` is still this file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same = |a: &fs::Metadata, b: &fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    file.metadata().is_ok_and(|a| fs::metadata(path).is_ok_and(|b| same(&a, &b)))
}

/// A file that is open cannot be removed.
#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> bool {
    true
}

impl Drop for Lock {
    fn drop(&mut self) {
        // First removed, then unlocked: whoever opened it before looks whether it is still there.
        // What others share is left to them.
        if !self.shared && is_at(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directory_is_locked_once_and_a_file_left_behind_locks_nothing() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(LOCK), "1\n").unwrap();
        let lock = Lock::of_dir(dir.path(), 17).unwrap();
        let refused = Lock::of_dir(dir.path(), 17).unwrap_err();
        let RecordError::Locked { holder, .. } = refused else { panic!("{refused}") };
        assert_eq!(holder, Some(17));
        drop(lock);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        Lock::of_dir(dir.path(), 17).unwrap();
    }

    #[test]
    fn the_last_of_those_that_share_a_directory_is_alone() {
        let dir = tempfile::tempdir().unwrap();
        let share = || Lock::shared(dir.path(), 1).unwrap();
        let (first, second, third) = (share(), share(), share());
        assert!(is_taken(&dir.path().join(LOCK)));
        assert!(matches!(Lock::of_dir(dir.path(), 2), Err(RecordError::Locked { .. })));
        assert!(second.alone().is_none());
        drop(first);
        let alone = third.alone().unwrap();
        assert!(matches!(Lock::shared(dir.path(), 2), Err(RecordError::Locked { .. })));
        drop(alone);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
