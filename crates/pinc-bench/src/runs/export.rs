//! `pinc export`: nets and controllers for other programs.

use super::{chainable, parse_model};
use crate::BenchError;
use pinc_export::{GeneratedFile, Name, Origin};
use pinc_record::{RecordError, read_file, write_atomically};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

/// What a net or a controller is exported to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// C99 without dependencies.
    C,
}

impl Target {
    fn name(self) -> &'static str {
        match self {
            Self::C => "c",
        }
    }
}

/// Exports the net of the file `model` into the directory `out`, by default `exports/`, the name
/// and the target. All names begin with `name`, by default the model file's. Returns the directory.
///
/// # Errors
///
/// [`BenchError`] if the file holds no net that can be exported, or files cannot be written.
pub fn export_net(
    model: &Path,
    to: Target,
    name: Option<&str>,
    out: Option<&Path>,
) -> Result<PathBuf, BenchError> {
    let bytes = read_file(model)?;
    let net = chainable(model, parse_model(model, &bytes)?)?;
    let stem = model.file_stem().unwrap_or_default().to_string_lossy();
    let name = name.map_or_else(|| Ok(Name::nearest(&stem)), Name::new)?;
    let origin = Origin::of_net(&net, env!("CARGO_PKG_VERSION"), &hash(&bytes));
    let files = match to {
        Target::C => pinc_export::net_to_c(&net, &name, &origin)?,
    };
    write(&files, to, &name, out)
}

/// SHA-256 in hexadecimal digits.
fn hash(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().fold(String::new(), |mut text, byte| {
        // Writing to a String does not fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

fn write(
    files: &[GeneratedFile],
    to: Target,
    name: &Name,
    out: Option<&Path>,
) -> Result<PathBuf, BenchError> {
    let default = || Path::new("exports").join(format!("{}-{}", name.as_str(), to.name()));
    let dir = out.map_or_else(default, Path::to_owned);
    for file in files {
        let path = dir.join(&file.path);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(RecordError::unwritable(parent))?;
        }
        write_atomically(&path, &file.bytes)?;
    }
    Ok(dir)
}
