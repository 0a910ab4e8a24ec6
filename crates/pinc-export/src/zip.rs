//! ZIP archives without compression.

use crate::{ExportError, GeneratedFile};

/// 1 January 1980: archives of the same files are the same.
const DATE: u16 = 0x21;

/// The files as a ZIP archive, stored as they are: what an FMU is.
///
/// # Errors
///
/// [`ExportError::Archive`] if they do not fit into one of 4 GB.
pub fn archive(files: &[GeneratedFile]) -> Result<Vec<u8>, ExportError> {
    let (mut body, mut directory) = (Vec::new(), Vec::new());
    for file in files {
        let offset = size(body.len())?;
        let entry = entry(file)?;
        body.extend(b"PK\x03\x04");
        body.extend_from_slice(&entry);
        body.extend_from_slice(file.path.as_bytes());
        body.extend_from_slice(&file.bytes);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend_from_slice(&entry);
        // No comment, first disk, no attributes.
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend_from_slice(file.path.as_bytes());
    }
    let (count, begin) = (count(files.len())?, size(body.len())?);
    let length = size(directory.len())?;
    body.append(&mut directory);
    body.extend(b"PK\x05\x06\x00\x00\x00\x00");
    body.extend(count.to_le_bytes());
    body.extend(count.to_le_bytes());
    body.extend(length.to_le_bytes());
    body.extend(begin.to_le_bytes());
    body.extend([0; 2]);
    Ok(body)
}

/// What both headers of a file say.
fn entry(file: &GeneratedFile) -> Result<Vec<u8>, ExportError> {
    let length = size(file.bytes.len())?;
    let mut entry = Vec::new();
    // Version 2.0, names in UTF-8, stored, midnight.
    for word in [0x14, 0x800, 0, 0, DATE] {
        entry.extend(u16::to_le_bytes(word));
    }
    for word in [checksum(&file.bytes), length, length] {
        entry.extend(word.to_le_bytes());
    }
    entry.extend(count(file.path.len())?.to_le_bytes());
    entry.extend([0; 2]);
    Ok(entry)
}

fn size(length: usize) -> Result<u32, ExportError> {
    u32::try_from(length).map_err(|_| ExportError::Archive)
}

fn count(length: usize) -> Result<u16, ExportError> {
    u16::try_from(length).map_err(|_| ExportError::Archive)
}

/// CRC-32.
fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    !crc
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_matches_the_standard() {
        assert_eq!(checksum(b"123456789"), 0xcbf4_3926);
    }

    /// Headers, names and content lie where the directory says.
    #[test]
    fn an_archive_has_its_files() {
        let file = |path: &str, text: &str| GeneratedFile::text(path.to_owned(), text.to_owned());
        let bytes = archive(&[file("a.txt", "hello"), file("b/c.txt", "")]).unwrap();
        assert_eq!(&bytes[..4], b"PK\x03\x04");
        assert_eq!(&bytes[30..40], b"a.txthello");
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        assert_eq!(bytes[end + 10], 2);
        let begin = u32::from_le_bytes(bytes[end + 16..end + 20].try_into().unwrap()) as usize;
        assert_eq!(&bytes[begin..begin + 4], b"PK\x01\x02");
        assert_eq!(&bytes[begin + 46..begin + 51], b"a.txt");
        let second = begin + 46 + 5;
        assert_eq!(&bytes[second..second + 4], b"PK\x01\x02");
        let offset = u32::from_le_bytes(bytes[second + 42..second + 46].try_into().unwrap());
        assert_eq!(offset, 40);
    }
}
