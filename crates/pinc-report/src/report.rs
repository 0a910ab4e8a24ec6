//! The report of a run: its pictures, and the page around them.

use crate::data::Run;
use crate::error::ReportError;
use crate::picture::{Drawn, Picture, drawn};
use crate::variables::Variables;
use crate::{
    control, domain_error, estimates, html, identification, model_error, prediction, profile,
    steps, sweep, training,
};
use std::path::Path;

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
    /// The name of its files, without their endings.
    pub name: String,
    /// The picture, as a document of its own.
    pub svg: String,
    /// Its data, with the columns `panel`, `series`, `x`, `x_to`, `y`, `y_to`, `value`. A point has
    /// `x` and `y`; a bar or a cell of a map both ends of its sides, or a name instead, and perhaps
    /// the value that it stands for; an interval `x`, `y` and `y_to`.
    pub csv: Vec<u8>,
}

impl FigureFiles {
    fn of(Drawn { picture, svg, .. }: Drawn) -> Self {
        Self { name: picture.stem, svg, csv: picture.figure.csv() }
    }
}

/// Makes the report of the run in `dir`. A section whose files are missing is left out, and the
/// page says so.
///
/// # Errors
///
/// [`ReportError`] if `dir` is no directory or has no `config.toml`, or if a file in it cannot be
/// read or is damaged.
pub fn build(dir: &Path) -> Result<Report, ReportError> {
    let run = Run::read(dir)?;
    let drawn = drawn(pictures(&run)?);
    let html = html::page(&run, &drawn);
    Ok(Report { html, figures: drawn.into_iter().map(FigureFiles::of).collect() })
}

/// The closed loop first, then what else there is of it, last how the net came about.
fn pictures(run: &Run) -> Result<Vec<Picture>, ReportError> {
    if let Some(trials) = &run.trials {
        return sweep::pictures(run, trials);
    }
    let variables = Variables::of(run);
    let mut pictures = Vec::new();
    pictures.extend(control::pictures(run, &variables));
    pictures.extend(estimates::pictures(run));
    pictures.extend(profile::picture(run, &variables));
    pictures.extend(steps::picture(run));
    pictures.extend(model_error::picture(run, &variables));
    pictures.extend(identification::picture(run));
    pictures.extend(prediction::picture(run, &variables));
    pictures.extend(domain_error::picture(run));
    pictures.extend(training::picture(run));
    Ok(pictures)
}
