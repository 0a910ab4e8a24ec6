//! The report of a run: one HTML page that stands alone, made from the files of its directory.
//!
//! Each section says what is drawn as a `figure::Figure`; `draw` lays it out, `canvas` puts it on an
//! SVG page. Sections whose files are missing are left out.

mod canvas;
mod control;
mod curve;
mod data;
mod draw;
mod error;
mod figure;
mod html;
mod picture;
mod prediction;
mod scale;
mod sheets;
mod steps;
mod table;
#[cfg(test)]
mod tests;
mod text;
mod training;
mod variables;
mod words;

pub use error::{DrawError, ReportError};

use data::Run;
use picture::Picture;
use std::path::Path;
use variables::Variables;

/// Makes the report of the run in `dir`: an HTML page with its pictures and its style inside, to be
/// opened without anything else. A section whose files are missing is left out, and the page says so.
///
/// # Errors
///
/// [`ReportError`] if `dir` is no directory, or a file in it cannot be read or is damaged.
pub fn build(dir: &Path) -> Result<String, ReportError> {
    let run = Run::read(dir)?;
    let drawn = draw_all(&run)?;
    Ok(html::page(&run, &drawn))
}

/// The report's pictures, each as the stem of a file name and a standalone SVG document.
///
/// # Errors
///
/// Like [`build`].
pub fn figures(dir: &Path) -> Result<Vec<(String, String)>, ReportError> {
    let drawn = draw_all(&Run::read(dir)?)?;
    let named = |(picture, svg): (Picture, String)| (picture.stem.to_owned(), svg);
    Ok(drawn.into_iter().map(named).collect())
}

fn draw_all(run: &Run) -> Result<Vec<(Picture, String)>, ReportError> {
    let variables = Variables::of(run);
    let mut pictures = Vec::new();
    pictures.extend(training::picture(run)?);
    pictures.extend(prediction::picture(run, &variables)?);
    pictures.extend(control::pictures(run, &variables)?);
    pictures.extend(steps::picture(run)?);
    let mut drawn = Vec::new();
    for picture in pictures {
        if let Some(svg) = picture.svg()? {
            drawn.push((picture, svg));
        }
    }
    Ok(drawn)
}
