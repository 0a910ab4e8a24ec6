//! The report of a run: one HTML page that stands alone, made from the files of its directory, and
//! the pictures in it as files of their own.
//!
//! Each section says what is shown as a `chart::Figure`, plain data that `chart` draws. Sections
//! whose files are missing are left out.

mod control;
mod data;
mod error;
mod html;
mod number_tables;
mod picture;
mod prediction;
mod steps;
mod summary_text;
mod sweep;
mod table;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod training;
mod variables;

pub use error::ReportError;

use data::Run;
use picture::{Drawn, Picture};
use std::path::Path;
use variables::Variables;

/// A run's report.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Report {
    /// An HTML page with its pictures and its style inside, to be opened without anything else.
    pub html: String,
    /// The pictures, in the order of the page.
    pub figures: Vec<FigureFiles>,
}

/// One of the report's pictures, by itself.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct FigureFiles {
    /// What its files are called, without their endings.
    pub name: String,
    /// The picture, as a document of its own.
    pub svg: String,
    /// What it shows, with the columns `panel`, `series`, `x`, `x_to`, `y`, `y_to`, `value`. A point
    /// has `x` and `y`; a bar or a cell of a map both ends of its sides, or a name instead, and perhaps
    /// the value that it stands for; an interval `x`, `y` and `y_to`.
    pub csv: Vec<u8>,
}

/// Makes the report of the run in `dir`. A section whose files are missing is left out, and the page
/// says so.
///
/// # Errors
///
/// [`ReportError`] if `dir` is no directory, or a file in it cannot be read or is damaged.
pub fn build(dir: &Path) -> Result<Report, ReportError> {
    let run = Run::read(dir)?;
    let drawn: Vec<Drawn> = pictures(&run)?.into_iter().filter_map(Picture::drawn).collect();
    let html = html::page(&run, &drawn)?;
    Ok(Report { html, figures: drawn.into_iter().map(Drawn::into_files).collect() })
}

fn pictures(run: &Run) -> Result<Vec<Picture>, ReportError> {
    if let Some(trials) = &run.trials {
        return sweep::pictures(run, trials);
    }
    let variables = Variables::of(run);
    let mut pictures = Vec::new();
    pictures.extend(training::picture(run)?);
    pictures.extend(prediction::picture(run, &variables)?);
    pictures.extend(control::pictures(run, &variables)?);
    pictures.extend(steps::picture(run)?);
    Ok(pictures)
}
