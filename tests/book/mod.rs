//! The book's pages as readers see them: the files of `docs/` with their tables, and with what is made
//! from the types of the code.
//!
//! - A line that is a link to a CSV file below `docs/tables/` stands for the table in it. What
//!   `.ci/numbers` has to know of the table is in a file beside it with the ending `numbers`.
//! - The line `<!-- config keys -->` stands for the sections of a config.
//! - The line `<!-- metrics -->` stands for the table of metrics, `<!-- crates -->` for a table of the
//!   crates with their descriptions, `<!-- modules -->` for tables of their modules.

mod defaults;
mod keys;
mod metrics;
mod modules;
mod tables;
mod types;

pub use keys::undescribed_keys;
pub use tables::{cells, moved_to_files, place};

use std::fs;
use std::path::{Path, PathBuf};

/// Returns the top of the tree.
#[must_use]
pub fn root() -> PathBuf {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().unwrap_or(tests).to_path_buf()
}

/// Returns a page with its tables and generated sections in place.
///
/// # Errors
///
/// If the page or one of its tables cannot be read.
pub fn page(path: &Path) -> Result<String, String> {
    let folder = path.parent().unwrap_or(path);
    let mut page = String::new();
    for line in read(path)?.lines() {
        page += &match (line, tables::link(line)) {
            ("<!-- config keys -->", _) => keys::sections(),
            ("<!-- metrics -->", _) => metrics::table(),
            ("<!-- crates -->", _) => crates()?,
            ("<!-- modules -->", _) => modules::tables()?,
            (_, Some(link)) => tables::unfolded(folder, line, link)?,
            _ => format!("{line}\n"),
        };
    }
    Ok(page)
}

/// A table of the crates.
fn crates() -> Result<String, String> {
    let folder = root().join("crates");
    let fault = |error: &dyn std::fmt::Display| format!("{}: {error}", folder.display());
    let mut rows = Vec::new();
    for entry in fs::read_dir(&folder).map_err(|error| fault(&error))? {
        let manifest = entry.map_err(|error| fault(&error))?.path().join("Cargo.toml");
        let manifest: toml::Table = read(&manifest)?.parse().map_err(|error| fault(&error))?;
        let of = |key| Some(manifest.get("package")?.get(key)?.as_str()?.to_owned());
        let (name, job) =
            of("name").zip(of("description")).ok_or_else(|| fault(&"no description"))?;
        rows.push(format!("| {name} | {job} |\n"));
    }
    rows.sort();
    Ok(format!("| crate | its job |\n|---|---|\n{}", rows.concat()))
}

/// Writes a page whose tables are in place: those that have a file go into it.
///
/// # Errors
///
/// If a file cannot be written.
pub fn write(path: &Path, text: &str) -> Result<(), String> {
    let (page, files) = tables::folded(text)?;
    let folder = path.parent().unwrap_or(path);
    for (name, content) in files {
        save(&folder.join(name), &content)?;
    }
    save(path, &page)
}

/// Writes the book's sources into an empty folder: all files of `docs/`, with the pages as readers see
/// them.
///
/// # Errors
///
/// If a file cannot be read or written.
pub fn write_sources(into: &Path) -> Result<(), String> {
    copy(&root().join("docs"), into)
}

fn copy(from: &Path, into: &Path) -> Result<(), String> {
    let fault = |error| format!("{}: {error}", from.display());
    for entry in fs::read_dir(from).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        let target = into.join(path.file_name().unwrap_or_default());
        match path.extension() {
            _ if path.is_dir() => copy(&path, &target)?,
            Some(ending) if ending == "md" => save(&target, &page(&path)?)?,
            _ => duplicate(&path, &target)?,
        }
    }
    Ok(())
}

fn duplicate(path: &Path, target: &Path) -> Result<(), String> {
    let folder = target.parent().unwrap_or(target);
    let done = fs::create_dir_all(folder).and_then(|()| fs::copy(path, target));
    done.map(|_| ()).map_err(|error| format!("{}: {error}", path.display()))
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn save(path: &Path, text: &str) -> Result<(), String> {
    let folder = path.parent().unwrap_or(path);
    let saved = fs::create_dir_all(folder).and_then(|()| fs::write(path, text));
    saved.map_err(|error| format!("{}: {error}", path.display()))
}
