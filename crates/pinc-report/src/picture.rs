//! A figure with its title and caption, and what a page needs to draw it.

use pinc_chart::{Figure, Live};

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
    /// Its curves as JSON, if they can be zoomed.
    pub(crate) live: Option<String>,
}

/// A page has about as many points at most in the curves that can be zoomed: half a megabyte of
/// text.
const MOST_POINTS: usize = 50_000;
/// More points are of no use in a curve.
const MOST_IN_CURVE: usize = 10_000;

impl Picture {
    pub(crate) fn new(
        stem: impl Into<String>,
        title: impl Into<String>,
        figure: Figure,
        caption: impl Into<String>,
    ) -> Self {
        Self { stem: stem.into(), title: title.into(), figure, caption: caption.into() }
    }

    /// Draws the picture; `None` if it would be empty.
    fn drawn(self) -> Option<Drawn> {
        let svg = self.figure.svg()?;
        Some(Drawn { picture: self, svg, live: None })
    }
}

/// Draws the pictures of one page, without those that would be empty, and makes curves that can be
/// zoomed.
pub(crate) fn drawn(pictures: Vec<Picture>) -> Vec<Drawn> {
    let mut drawn: Vec<Drawn> = pictures.into_iter().filter_map(Picture::drawn).collect();
    let live = drawn.iter().map(|of| of.picture.figure.live()).collect::<Vec<_>>();
    let lengths = live.iter().flatten().flat_map(Live::lengths).collect();
    let most = longest(lengths);
    let live: Vec<_> = live.iter().map(|of| of.as_ref().map(|of| of.json(most))).collect();
    for (of, live) in drawn.iter_mut().zip(live) {
        of.live = live;
    }
    drawn
}

/// How long curves of these lengths may be so that there are not too many points.
fn longest(mut lengths: Vec<usize>) -> usize {
    lengths.sort_unstable();
    let (mut left, mut curves) = (MOST_POINTS, lengths.len());
    for length in lengths {
        let share = left / curves;
        if length > share {
            return share.min(MOST_IN_CURVE);
        }
        (left, curves) = (left - length, curves - 1);
    }
    MOST_IN_CURVE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_curves_share_what_short_ones_leave() {
        assert_eq!(longest(Vec::new()), MOST_IN_CURVE);
        assert_eq!(longest(vec![100; 10]), MOST_IN_CURVE);
        assert_eq!(longest(vec![1_000_000]), MOST_IN_CURVE);
        // 49 000 points are left for 49 curves.
        let lengths = [vec![1000], vec![90_000; 49]].concat();
        assert_eq!(longest(lengths), 1000);
    }
}
