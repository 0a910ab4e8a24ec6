//! The binary of an FMU, by the machine's C compiler.

use crate::RunError;
use pinc_export::{FmiVersion, GeneratedFile, Name};
use pinc_record::{RecordError, read_file};
use std::fs;
use std::process::Command;

/// Whether this machine is one that binaries are made for.
const KNOWN: bool = cfg!(all(target_os = "linux", target_arch = "x86_64"));

/// The shared library of the C files among the content of an FMU; none on other machines, where the
/// FMU has its sources only.
///
/// # Errors
///
/// [`RunError::Usage`] if there is no compiler `cc`, or it fails.
pub(super) fn shared_library(
    content: &[GeneratedFile],
    name: &Name,
    version: FmiVersion,
) -> Result<Option<GeneratedFile>, RunError> {
    if !KNOWN {
        tracing::warn!("the FMU has sources only: binaries are made on 64-bit Linux");
        return Ok(None);
    }
    let platform = match version {
        FmiVersion::Two => "linux64",
        FmiVersion::Three => "x86_64-linux",
    };
    let dir = tempfile::tempdir().map_err(RecordError::unwritable(&std::env::temp_dir()))?;
    let dir = dir.path();
    let mut command = Command::new("cc");
    command.args(["-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden"]);
    for file in content.iter().filter_map(|file| Some((file.path.strip_prefix("sources/")?, file)))
    {
        let path = dir.join(file.0);
        fs::write(&path, &file.1.bytes).map_err(RecordError::unwritable(&path))?;
        if file.0.ends_with(".c") {
            command.arg(file.0);
        }
    }
    let binary = format!("{}.so", name.as_str());
    let ended = command.args(["-lm", "-o", &binary]).current_dir(dir).output();
    let failed = |reason: String| {
        let problem = format!(
            "the FMU was not written, since the C compiler `cc` failed: {reason}; install a C \
             compiler, such as the package `gcc`"
        );
        RunError::usage("export", problem)
    };
    let output = ended.map_err(|error| failed(error.to_string()))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let first = said.lines().find(|line| line.contains("error")).unwrap_or_default();
        return Err(failed(format!("{}: {first}", output.status)));
    }
    let bytes = read_file(&dir.join(&binary))?;
    Ok(Some(GeneratedFile { path: format!("binaries/{platform}/{binary}"), bytes }))
}
