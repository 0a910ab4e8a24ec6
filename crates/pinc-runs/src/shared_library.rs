//! The binaries of an FMU, by the machine's C compiler and by a cross compiler that is there.

use crate::RunError;
use pinc_export::{FmiVersion, GeneratedFile, Name};
use pinc_record::{RecordError, read_file};
use std::fs;
use std::io::ErrorKind;
use std::process::Command;

/// A platform with the folder that it has in each version of FMI, if it has one, and its cross compiler.
struct Platform {
    is_this: bool,
    folders: [Option<&'static str>; 2],
    cross: &'static str,
}

const PLATFORMS: [Platform; 2] = [
    Platform {
        is_this: cfg!(all(target_os = "linux", target_arch = "x86_64")),
        folders: [Some("linux64"), Some("x86_64-linux")],
        cross: "x86_64-linux-gnu-gcc",
    },
    Platform {
        is_this: cfg!(all(target_os = "linux", target_arch = "aarch64")),
        folders: [None, Some("aarch64-linux")],
        cross: "aarch64-linux-gnu-gcc",
    },
];

/// The shared libraries of the C files among the content of an FMU, for this machine and for those whose cross
/// compiler is installed; none on other machines than these, where the FMU has its sources only.
///
/// # Errors
///
/// [`RunError::Usage`] if there is no compiler `cc` for this machine, or a compiler fails.
pub(super) fn shared_libraries(
    content: &[GeneratedFile],
    name: &Name,
    version: FmiVersion,
) -> Result<Vec<GeneratedFile>, RunError> {
    let place = match version {
        FmiVersion::Two => 0,
        FmiVersion::Three => 1,
    };
    let mut libraries = Vec::new();
    for Platform { is_this, folders, cross } in PLATFORMS {
        let Some(folder) = folders[place] else { continue };
        let compiler = if is_this { "cc" } else { cross };
        if let Some(bytes) = compiled(content, name, (compiler, is_this))? {
            let path = format!("binaries/{folder}/{}.so", name.as_str());
            libraries.push(GeneratedFile { path, bytes });
        }
    }
    if libraries.is_empty() {
        tracing::warn!("the FMU has sources only: binaries are made on 64-bit Linux");
    }
    Ok(libraries)
}

/// The shared library by a compiler; none if there is no such compiler or it fails, unless it is `needed`.
fn compiled(
    content: &[GeneratedFile],
    name: &Name,
    (compiler, needed): (&str, bool),
) -> Result<Option<Vec<u8>>, RunError> {
    let dir = tempfile::tempdir().map_err(RecordError::unwritable(&std::env::temp_dir()))?;
    let dir = dir.path();
    let mut command = Command::new(compiler);
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
            "the FMU was not written, since the C compiler `{compiler}` failed: {reason}; install a \
             C compiler, such as the package `gcc`"
        );
        RunError::usage("export", problem)
    };
    let output = match ended {
        Err(error) if error.kind() == ErrorKind::NotFound && !needed => return Ok(None),
        ended => ended.map_err(|error| failed(error.to_string()))?,
    };
    if !output.status.success() && !needed {
        tracing::warn!("the FMU has no binary by `{compiler}`, which failed: {}", output.status);
        return Ok(None);
    }
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let first = said.lines().find(|line| line.contains("error")).unwrap_or_default();
        return Err(failed(format!("{}: {first}", output.status)));
    }
    Ok(Some(read_file(&dir.join(&binary))?))
}
