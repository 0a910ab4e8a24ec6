//! `checkpoint.bin`: a training that can be resumed.
//!
//! ```text
//! "PINCCKPT" | format version, u32 | SHA-256 of the rest, 32 bytes | postcard of [`Saved`]
//! ```

use crate::error::{CheckpointProblem, RecordError};
use crate::files::read_file;
use pinc_net::Checkpoint;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::Path;

const MAGIC: &[u8; 8] = b"PINCCKPT";
const VERSION: u32 = 2;
const HEADER: usize = MAGIC.len() + 4 + 32;

/// The content of a checkpoint, `C` being the trainer's.
#[derive(Debug, Serialize, Deserialize)]
pub struct Saved<C> {
    /// [`fingerprint`](pinc_config::Experiment::fingerprint) of the config.
    pub fingerprint: String,
    /// The last iteration that is in.
    pub iteration: u64,
    /// Wall time of the optimizer so far, in s.
    pub optimizer_s: f64,
    /// Wall time of the stage so far, in s.
    pub wall_s: f64,
    /// The trainer.
    pub trainer: C,
}

/// The bytes of the file.
///
/// # Panics
///
/// Never: a checkpoint is plain data.
#[must_use]
pub fn save_checkpoint(saved: &Saved<&Checkpoint>) -> Vec<u8> {
    let header = vec![0; HEADER];
    let mut bytes =
        postcard::to_extend(saved, header).expect("writing plain data to memory does not fail");
    let digest = Sha256::digest(&bytes[HEADER..]);
    bytes[..8].copy_from_slice(MAGIC);
    bytes[8..12].copy_from_slice(&VERSION.to_le_bytes());
    bytes[12..HEADER].copy_from_slice(&digest);
    bytes
}

/// Reads the file, checks it, and that it is of the config with this fingerprint.
///
/// # Errors
///
/// [`RecordError::Checkpoint`], or [`RecordError::Unreadable`].
pub fn load_checkpoint(path: &Path, fingerprint: &str) -> Result<Saved<Checkpoint>, RecordError> {
    let bytes = read_file(path)?;
    let saved = parse(&bytes).and_then(|saved| {
        let same = saved.fingerprint == fingerprint;
        if same { Ok(saved) } else { Err(CheckpointProblem::OtherConfig) }
    });
    saved.map_err(|problem| RecordError::Checkpoint { path: path.to_owned(), problem })
}

fn parse(bytes: &[u8]) -> Result<Saved<Checkpoint>, CheckpointProblem> {
    let rest = bytes.strip_prefix(MAGIC).ok_or(CheckpointProblem::Foreign)?;
    let (version, rest) = rest.split_first_chunk().ok_or(CheckpointProblem::Damaged)?;
    match u32::from_le_bytes(*version) {
        VERSION => {}
        other => return Err(CheckpointProblem::Version(other)),
    }
    let (digest, body) = rest.split_first_chunk::<32>().ok_or(CheckpointProblem::Damaged)?;
    if Sha256::digest(body).as_slice() != digest {
        return Err(CheckpointProblem::Damaged);
    }
    postcard::from_bytes(body).map_err(|_| CheckpointProblem::Damaged)
}
