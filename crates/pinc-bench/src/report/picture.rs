//! A figure with the words around it.

use super::ReportError;
use super::figure::Figure;

/// A picture of the report.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    /// Stem of the file it is written to, and its anchor in the report.
    pub(super) stem: &'static str,
    pub(super) title: String,
    pub(super) figure: Figure,
    /// What is seen, and from which files.
    pub(super) caption: String,
}

impl Picture {
    /// Draws the picture; `None` if it would be empty.
    pub(super) fn svg(&self) -> Result<Option<String>, ReportError> {
        self.figure
            .svg()
            .map_err(|source| ReportError::Draw { figure: self.stem.to_owned(), source })
    }
}
