//! A figure with its title and caption.

use pinc_chart::Figure;

/// A picture of the report.
#[derive(Clone, Debug)]
pub(crate) struct Picture {
    /// Stem of the files it is written to, and its anchor in the report.
    pub(crate) stem: String,
    pub(crate) title: String,
    pub(crate) figure: Figure,
    /// What is seen, and from which files.
    pub(crate) caption: String,
}

/// A picture with its SVG document.
#[derive(Clone, Debug)]
pub(crate) struct Drawn {
    pub(crate) picture: Picture,
    pub(crate) svg: String,
}

impl Picture {
    /// Draws the picture; `None` if it would be empty.
    pub(crate) fn drawn(self) -> Option<Drawn> {
        let svg = self.figure.svg()?;
        Some(Drawn { picture: self, svg })
    }
}
