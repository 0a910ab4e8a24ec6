//! The archive that an FMU is, unpacked into a directory.

use std::fs;
use std::path::{Component, Path};

/// The most bytes that an FMU may have when it is unpacked.
const MOST: usize = 2 << 30;

/// Signatures of the records of ZIP files.
const END: [u8; 4] = *b"PK\x05\x06";
const ENTRY: [u8; 4] = *b"PK\x01\x02";

/// Unpacks the ZIP file `bytes` into the directory `dir`. In words, what is wrong with it, if
/// something is.
pub(super) fn unpack(bytes: &[u8], dir: &Path) -> Result<(), String> {
    unpack_within(bytes, dir, MOST)
}

/// Unpacks at most `most` bytes.
fn unpack_within(bytes: &[u8], dir: &Path, most: usize) -> Result<(), String> {
    let mut left = most;
    let damaged = || "it is no ZIP file, or damaged".to_owned();
    let end = bytes.windows(4).rposition(|four| four == END).ok_or_else(damaged)?;
    let count = number(bytes, end + 10, 2).ok_or_else(damaged)?;
    let mut at = number(bytes, end + 16, 4).ok_or_else(damaged)?;
    for _ in 0..count {
        let entry = bytes.get(at..).filter(|rest| rest.starts_with(&ENTRY)).ok_or_else(damaged)?;
        let read = |place, width| number(entry, place, width).ok_or_else(damaged);
        let (method, packed, size) = (read(10, 2)?, read(20, 4)?, read(24, 4)?);
        let [name, extra, comment] = [read(28, 2)?, read(30, 2)?, read(32, 2)?];
        let local = read(42, 4)?;
        let too_large = || format!("it unpacks to more than {} MiB", most >> 20);
        left = left.checked_sub(size.max(packed)).ok_or_else(too_large)?;
        let path = entry.get(46..46 + name).ok_or_else(damaged)?;
        let path = std::str::from_utf8(path).map_err(|_| damaged())?;
        let lengths = (number(bytes, local + 26, 2), number(bytes, local + 28, 2));
        let (Some(local_name), Some(local_extra)) = lengths else { return Err(damaged()) };
        let begin = local + 30 + local_name + local_extra;
        let content = bytes.get(begin..begin + packed).ok_or_else(damaged)?;
        write(dir, path, &inflated(content, method, size).ok_or_else(damaged)?)?;
        at += 46 + name + extra + comment;
    }
    Ok(())
}

fn number(bytes: &[u8], at: usize, width: usize) -> Option<usize> {
    let digits = bytes.get(at..at + width)?;
    Some(digits.iter().rev().fold(0, |value, byte| 256 * value + usize::from(*byte)))
}

fn inflated(content: &[u8], method: usize, size: usize) -> Option<Vec<u8>> {
    match method {
        0 => Some(content.to_vec()),
        8 => miniz_oxide::inflate::decompress_to_vec_with_limit(content, size).ok(),
        _ => None,
    }
}

/// Writes one entry below `dir`, and nowhere else.
fn write(dir: &Path, name: &str, content: &[u8]) -> Result<(), String> {
    let is_below = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    if !is_below {
        return Err(format!("its entry {name:?} would be written elsewhere"));
    }
    let path = dir.join(name);
    let failed = |error| format!("{name} cannot be unpacked: {error}");
    if name.ends_with('/') {
        return fs::create_dir_all(&path).map_err(failed);
    }
    path.parent().map_or(Ok(()), fs::create_dir_all).map_err(failed)?;
    fs::write(&path, content).map_err(failed)
}
