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

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: &str = "resources/a";

    /// An archive with one deflated file of the text, which it says is so long; before it stands a
    /// field that nobody knows.
    fn archive(text: &[u8], said: u32) -> Vec<u8> {
        let length = u16::try_from(text.len()).unwrap();
        // One block that is stored.
        let mut packed = vec![1];
        packed.extend(length.to_le_bytes());
        packed.extend((!length).to_le_bytes());
        packed.extend(text);
        let mut sizes = u32::try_from(packed.len()).unwrap().to_le_bytes().to_vec();
        sizes.extend(said.to_le_bytes());
        let name = u16::try_from(NAME.len()).unwrap().to_le_bytes();
        let mut bytes = b"PK\x03\x04\x14\0\0\0\x08\0".to_vec();
        bytes.extend([0; 8]);
        bytes.extend(&sizes);
        bytes.extend(name);
        bytes.extend([3, 0]);
        bytes.extend(NAME.as_bytes());
        bytes.extend(b"any");
        bytes.extend(&packed);
        let entry = u32::try_from(bytes.len()).unwrap();
        bytes.extend(ENTRY);
        bytes.extend(b"\x14\0\x14\0\0\0\x08\0");
        bytes.extend([0; 8]);
        bytes.extend(&sizes);
        bytes.extend(name);
        bytes.extend([0; 16]);
        bytes.extend(NAME.as_bytes());
        bytes.extend(END);
        bytes.extend([0, 0, 0, 0, 1, 0, 1, 0]);
        bytes.extend([0; 4]);
        bytes.extend(entry.to_le_bytes());
        bytes.extend([0; 2]);
        bytes
    }

    /// What a file says of its size is kept, and all together is limited.
    #[test]
    fn nothing_unpacks_to_more_than_it_says_or_may() {
        let dir = tempfile::tempdir().unwrap();
        let text = [b'a'; 1000];
        unpack(&archive(&text, 1000), dir.path()).unwrap();
        assert_eq!(fs::read(dir.path().join(NAME)).unwrap(), text);
        let error = unpack(&archive(&text, 999), dir.path()).unwrap_err();
        assert_eq!(error, "it is no ZIP file, or damaged");
        // A stored block takes five bytes more than the file.
        assert!(unpack_within(&archive(&text, 1000), dir.path(), 1005).is_ok());
        assert!(unpack_within(&archive(&text, 1000), dir.path(), 1004).is_err());
        unpack(&archive(&text, 1 << 31), dir.path()).unwrap();
        let error = unpack(&archive(&text, (1 << 31) + 1), dir.path()).unwrap_err();
        assert_eq!(error, "it unpacks to more than 2048 MiB");
    }
}
