//! One process at a time works on a run directory.

use crate::error::RecordError;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// The name of the file that is locked. A killed process leaves it behind, unlocked.
pub(crate) const LOCK: &str = ".pinc-lock";

/// A run directory that no other process works on, until this is dropped.
#[derive(Debug)]
pub(crate) struct DirLock {
    /// The system unlocks it when the process ends, however that is.
    file: File,
    path: PathBuf,
}

impl DirLock {
    /// Locks the directory `dir` for this process, whose id is `id`.
    ///
    /// # Errors
    ///
    /// [`RecordError::Locked`] if another process has it; [`RecordError::Unwritable`].
    pub(crate) fn take(dir: &Path, id: u32) -> Result<Self, RecordError> {
        let path = dir.join(LOCK);
        let unwritable = || RecordError::unwritable(&path);
        loop {
            let mut options = File::options();
            options.read(true).write(true).create(true).truncate(false);
            let mut file = options.open(&path).map_err(unwritable())?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut text = String::new();
                    let read = file.read_to_string(&mut text);
                    let holder = read.ok().and_then(|_| text.trim().parse().ok());
                    return Err(RecordError::Locked { dir: dir.to_owned(), holder });
                }
                // A file system without locks.
                Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(error)) => return Err(unwritable()(error)),
            }
            // It may have been removed, by the process that had it, after it was opened here.
            if !is_at(&file, &path) {
                continue;
            }
            write_id(&mut file, id).map_err(unwritable())?;
            return Ok(Self { file, path });
        }
    }
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

impl Drop for DirLock {
    fn drop(&mut self) {
        // First removed, then unlocked: whoever opened it before looks whether it is still there.
        if is_at(&self.file, &self.path) {
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
        let lock = DirLock::take(dir.path(), 17).unwrap();
        let refused = DirLock::take(dir.path(), 17).unwrap_err();
        let RecordError::Locked { holder, .. } = refused else { panic!("{refused}") };
        assert_eq!(holder, Some(17));
        drop(lock);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
        DirLock::take(dir.path(), 17).unwrap();
    }
}
