//! A figure with the words around it.

use super::FigureFiles;
use pinc_chart::Figure;

/// A picture of the report.
#[derive(Clone, Debug)]
pub(super) struct Picture {
    /// Stem of the files it is written to, and its anchor in the report.
    pub(super) stem: String,
    pub(super) title: String,
    pub(super) figure: Figure,
    /// What is seen, and from which files.
    pub(super) caption: String,
}

/// A picture with its SVG document.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    pub(super) picture: Picture,
    pub(super) svg: String,
}

impl Picture {
    /// Draws the picture; `None` if it would be empty.
    pub(super) fn drawn(self) -> Option<Drawn> {
        let svg = self.figure.svg()?;
        Some(Drawn { picture: self, svg })
    }
}

impl Drawn {
    /// The picture as files.
    pub(super) fn into_files(self) -> FigureFiles {
        FigureFiles { name: self.picture.stem, svg: self.svg, csv: self.picture.figure.csv() }
    }
}
