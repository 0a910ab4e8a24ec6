//! The places of a figure's event labels, above its first panel.

use crate::figure::Event;
use crate::scale::Scale;
use crate::svg;

const MOST_LANES: usize = 4;

/// An event's word with its place: a lane counted from the panel upwards.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Flag<'a> {
    pub event: &'a Event,
    pub x: f64,
    /// The ends of the word.
    pub span: (f64, f64),
    /// `None` if there is no room for the word.
    pub lane: Option<usize>,
}

impl<'a> Flag<'a> {
    /// The word stands to the right of its line, or to the left where it would pass `right`.
    fn new(event: &'a Event, x: f64, size: f64, right: f64) -> Self {
        let width = svg::width_of(&event.label, size) + 10.0;
        let span = match x + width > right {
            true => (x - width, x),
            false => (x, x + width),
        };
        Self { event, x, span, lane: None }
    }

    /// Whether the words, or a word and the other's stem, are in each other's way.
    fn touches(&self, other: &Self) -> bool {
        let (Some(lane), Some(other_lane)) = (self.lane, other.lane) else {
            return false;
        };
        let crosses = |word: &Self, stem: &Self| word.span.0 < stem.x && stem.x < word.span.1;
        let apart = self.span.1 <= other.span.0 || other.span.1 <= self.span.0;
        (lane == other_lane && !apart)
            || (lane <= other_lane && crosses(self, other))
            || (other_lane <= lane && crosses(other, self))
    }
}

/// The events on the scale `x` that reaches from `left` to `right`, each word of `size` in the
/// lowest lane where nothing touches it.
pub(crate) fn flags<'a>(
    events: &'a [Event],
    x: &Scale,
    (left, right): (f64, f64),
    size: f64,
) -> Vec<Flag<'a>> {
    let mut flags = Vec::new();
    for event in events {
        let fraction = x.fraction(event.x).filter(|f| (0.0..=1.0).contains(f));
        flags.extend(fraction.map(|f| Flag::new(event, left + f * (right - left), size, right)));
    }
    // From right to left: a long word then passes above the flags to its right.
    flags.sort_by(|a, b| b.x.total_cmp(&a.x));
    for i in 0..flags.len() {
        let (placed, rest) = flags.split_at_mut(i);
        let flag = &mut rest[0];
        flag.lane = (0..MOST_LANES).find(|lane| {
            let trial = Flag { lane: Some(*lane), ..*flag };
            placed.iter().all(|other| !other.touches(&trial))
        });
    }
    flags
}
