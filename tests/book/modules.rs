//! The modules of all crates, each with the first paragraph of its own documentation.

use super::{read, root};
use std::fs;
use std::path::{Path, PathBuf};

/// Returns a table for each crate, below a heading.
///
/// # Errors
///
/// If a folder cannot be read, or a module says nothing about itself.
pub(super) fn tables() -> Result<String, String> {
    let mut text = String::new();
    for folder in entries(&root().join("crates"))? {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut rows = String::new();
        for (module, file) in modules(&folder.join("src"))? {
            rows += &format!("| `{module}` | {} |\n", purpose(&file)?);
        }
        text += &format!("## {name}\n\n| module | what |\n|---|---|\n{rows}\n");
    }
    Ok(text.trim_end().to_owned() + "\n")
}

/// The modules of a crate with the files that begin them; a name that ends in `/` is a folder. The root
/// and tests are left out.
fn modules(source: &Path) -> Result<Vec<(String, PathBuf)>, String> {
    let mut modules = Vec::new();
    for path in entries(source)? {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        match path.extension() {
            _ if ["lib", "main", "tests"].contains(&stem.as_str()) => {}
            _ if path.is_dir() && path.join("mod.rs").exists() => {
                modules.push((stem + "/", path.join("mod.rs")));
            }
            Some(ending) if ending == "rs" => modules.push((stem, path)),
            _ => {}
        }
    }
    Ok(modules)
}

/// The first paragraph of a module's documentation, as the cell of a table.
fn purpose(file: &Path) -> Result<String, String> {
    let text = read(file)?;
    let lines = text.lines().map_while(|line| line.strip_prefix("//!"));
    let lines: Vec<&str> = lines.map(str::trim).take_while(|line| !line.is_empty()).collect();
    if lines.is_empty() {
        return Err(format!("{}: expected a first line with //!", file.display()));
    }
    // Names in brackets are links in rustdoc only.
    let plain = lines.join(" ").replace("[`", "`").replace("`]", "`");
    Ok(plain.replace('|', "\\|"))
}

/// What lies in a folder, sorted.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let fault = |error| format!("{}: {error}", folder.display());
    let entries = fs::read_dir(folder).map_err(fault)?;
    let paths: Result<Vec<_>, _> = entries.map(|entry| entry.map(|entry| entry.path())).collect();
    let mut paths = paths.map_err(fault)?;
    paths.sort();
    Ok(paths)
}
