//! The places of a figure's parts on its page.

use crate::color::{BLACK, INK};
use crate::curve::Frame;
use crate::figure::{Axis, Figure, Key, Panel};
use crate::flags::{Flag, flags};
use crate::scale::{Scale, Tick};
use crate::svg::{self, Anchor, Word};

pub(crate) const WIDTH: f64 = 960.0;
const TOP: f64 = 4.0;
const RIGHT: f64 = 20.0;
/// Left of a figure's first panel, at least, so that figures above one another are in line.
const LEFT: f64 = 76.0;
/// Between two columns, at least.
const GUTTER: f64 = 28.0;
/// A row of a panel's title and legend.
pub(crate) const ROW: f64 = 21.0;
/// A row of the events' words.
pub(crate) const LANE: f64 = 16.0;
/// Between a panel and the one below.
const GAP: f64 = 14.0;
pub(crate) const SWATCH: f64 = 28.0;
/// A line of the words below a horizontal axis.
pub(crate) const LINE: f64 = 15.0;

const BASE: Word = Word { size: 13.0, color: INK, bold: false, anchor: Anchor::Start, rim: false };
pub(crate) const TITLE: Word = Word { size: 14.0, color: BLACK, bold: true, ..BASE };
pub(crate) const LABEL: Word = BASE;
pub(crate) const TICK: Word = Word { size: 12.0, ..BASE };

/// A figure with a place for everything.
#[derive(Debug)]
pub(crate) struct Layout<'a> {
    pub keys: Vec<PlacedKey<'a>>,
    pub panels: Vec<Placed<'a>>,
    pub flags: Vec<Flag<'a>>,
    pub height: f64,
}

/// A panel with its place on the page.
#[derive(Debug)]
pub(crate) struct Placed<'a> {
    pub panel: &'a Panel,
    pub x: &'a Axis,
    /// Both axes; `None` if the panel has nothing to show but its note.
    pub scales: Option<Scales>,
    /// The middle of the row with the title.
    pub title: f64,
    pub keys: Vec<PlacedKey<'a>>,
    pub frame: Frame,
    /// Whether the words of the horizontal axis stand below.
    pub foot: bool,
    /// Whether the figure's events pass through it.
    pub eventful: bool,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Scales {
    pub x: Scale,
    pub y: Scale,
}

/// A line of a legend, with its left end and its middle line.
#[derive(Debug)]
pub(crate) struct PlacedKey<'a> {
    pub key: &'a Key,
    pub left: f64,
    pub y: f64,
}

/// A panel that will be seen.
#[derive(Debug)]
pub(crate) struct Shown<'a> {
    pub panel: &'a Panel,
    pub x: &'a Axis,
    /// As in [`Placed`].
    pub scales: Option<Scales>,
}

/// The panels that have something to show or to say.
pub(crate) fn shown(figure: &Figure) -> Vec<Shown<'_>> {
    let x = common_scale(figure);
    figure.panels.iter().filter_map(|panel| Shown::of(panel, &figure.x, x)).collect()
}

/// The scale of the panels that have no horizontal axis of their own.
fn common_scale(figure: &Figure) -> Option<Scale> {
    let together = figure.panels.iter().filter(|p| p.x.is_none());
    figure.x.scale(together.flat_map(Panel::positions))
}

impl<'a> Layout<'a> {
    /// Finds the places; `None` if no panel has anything to show or to say.
    pub(crate) fn of(figure: &'a Figure) -> Option<Self> {
        let shown = shown(figure);
        if shown.is_empty() {
            return None;
        }
        let columns = columns(figure, &shown);
        let flags = common_scale(figure).map_or_else(Vec::new, |x| {
            flags(&figure.events, &x, (columns[0].left, columns[0].right()), TICK.size)
        });
        let lanes = flags.iter().filter_map(|f| f.lane).max().map_or(0, |lane| lane + 1);
        let (keys, rows) = placed_keys(&figure.keys, columns[0].left, (LEFT, WIDTH - RIGHT), TOP);
        let mut layout = Self { keys, panels: Vec::new(), flags, height: TOP };
        if !layout.keys.is_empty() {
            layout.height += rows * ROW + 6.0;
        }
        let rows = shown.chunks(columns.len());
        // Below it there are only notes, which have no axes.
        let last = rows.clone().rposition(|row| row.iter().any(|shown| shown.scales.is_some()));
        for (i, row) in rows.enumerate() {
            let words = if i == 0 { LANE * small(lanes) } else { 0.0 };
            layout.add_row(row, &columns, words, Some(i) == last);
        }
        Some(layout)
    }

    /// Places a row of panels below what is there; `words` is the height of the events' words.
    fn add_row(&mut self, row: &[Shown<'a>], columns: &[Column], words: f64, last: bool) {
        let top = self.height;
        let headers: Vec<_> = row.iter().zip(columns).map(|(s, c)| s.header(c, top)).collect();
        let header = headers.iter().map(|h| h.1).fold(0.0, f64::max);
        let frame_top = top + header + 4.0 + words;
        let mut below: f64 = GAP;
        let mut bottom = frame_top;
        for (i, (shown, (keys, _))) in row.iter().zip(headers).enumerate() {
            let column = &columns[i];
            let foot = shown.scales.is_some() && (last || shown.panel.x.is_some());
            let frame = Frame {
                left: column.left,
                top: frame_top,
                width: column.width,
                height: shown.panel.height,
            };
            if foot {
                below = below.max(foot_height(shown.x, column.width));
            }
            bottom = bottom.max(frame.bottom());
            self.panels.push(Placed {
                panel: shown.panel,
                x: shown.x,
                scales: shown.scales,
                title: top + 0.5 * ROW,
                keys,
                frame,
                foot,
                eventful: i == 0 && shown.panel.x.is_none(),
            });
        }
        self.height = bottom + below;
    }
}

impl<'a> Shown<'a> {
    fn of(panel: &'a Panel, common: &'a Axis, scale: Option<Scale>) -> Option<Self> {
        let (x, scale) = match &panel.x {
            Some(own) => (own, own.scale(panel.positions())),
            None => (common, scale),
        };
        let scales = scale.and_then(|x| Some(Scales { x, y: panel.y_scale(x.range())? }));
        (scales.is_some() || panel.note.is_some()).then_some(Self { panel, x, scales })
    }

    /// The places of the legend's lines, and the height of title and legend.
    fn header(&self, column: &Column, top: f64) -> (Vec<PlacedKey<'a>>, f64) {
        let title = match self.panel.title.is_empty() {
            true => 0.0,
            false => svg::width_of(&self.panel.title, 1.08 * TITLE.size) + 26.0,
        };
        let ends = (column.left, column.right());
        let (keys, rows) = placed_keys(&self.panel.keys, column.left + title, ends, top);
        let empty = keys.is_empty() && self.panel.title.is_empty();
        (keys, if empty { 0.0 } else { rows * ROW })
    }

    /// The room that the vertical axis' words need.
    fn margin(&self) -> f64 {
        let Some(scales) = &self.scales else { return GUTTER };
        if self.panel.y.silent {
            return GUTTER;
        }
        let labels = ticks(&self.panel.y, &scales.y, ticks_upwards(self.panel.height));
        let lines = label_lines(&self.panel.y, self.panel.height).len().max(1);
        label_distance(&labels) + LINE * small(lines - 1) + 0.5 * LABEL.size + 8.0
    }
}

/// A column of panels on the page.
struct Column {
    left: f64,
    width: f64,
}

impl Column {
    fn right(&self) -> f64 {
        self.left + self.width
    }
}

fn columns(figure: &Figure, shown: &[Shown<'_>]) -> Vec<Column> {
    let count = figure.columns.len().max(1);
    let mut margins = vec![GUTTER; count];
    margins[0] = LEFT;
    for (i, shown) in shown.iter().enumerate() {
        margins[i % count] = shown.margin().max(margins[i % count]);
    }
    let free = WIDTH - RIGHT - margins.iter().sum::<f64>();
    let all: f64 = figure.columns.iter().sum();
    let mut columns: Vec<Column> = Vec::new();
    for (i, margin) in margins.into_iter().enumerate() {
        let left = margin + columns.last().map_or(0.0, Column::right);
        let width = free * figure.columns.get(i).map_or(1.0, |share| share / all);
        columns.push(Column { left, width });
    }
    columns
}

/// The places of a legend's lines, flowing in rows from `start` on between two ends; also the
/// number of rows.
fn placed_keys<'a>(
    keys: &'a [Key],
    start: f64,
    (left, right): (f64, f64),
    top: f64,
) -> (Vec<PlacedKey<'a>>, f64) {
    let (mut at, mut row) = (start, 0.0);
    let mut placed = Vec::new();
    for key in keys {
        let width = SWATCH + 6.0 + svg::width_of(&key.label, LABEL.size);
        if at + width > right && at > left {
            at = left;
            row += 1.0;
        }
        placed.push(PlacedKey { key, left: at, y: top + ROW * (row + 0.5) });
        at += width + 20.0;
    }
    (placed, row + 1.0)
}

/// How far from a panel the label of its vertical axis stands, beyond the ticks' labels.
pub(crate) fn label_distance(ticks: &[Tick]) -> f64 {
    let labels = ticks.iter().filter_map(|t| t.label.as_ref());
    let widest = labels.map(|l| svg::width_of(l, TICK.size)).fold(0.0, f64::max);
    (widest.min(0.25 * WIDTH) + 22.0).max(52.0)
}

/// The label of a vertical axis in lines that fit beside a panel of `height` pixels.
pub(crate) fn label_lines(axis: &Axis, height: f64) -> Vec<String> {
    svg::wrapped(&axis.label, LABEL.size, height + 16.0, 2)
}

/// The height of the words below a horizontal axis.
fn foot_height(axis: &Axis, width: f64) -> f64 {
    let names = names_below(axis, width);
    let lines = names.iter().map(Vec::len).max().unwrap_or(1);
    let label = if axis.label.is_empty() { 0.0 } else { 20.0 };
    LINE * small(lines) + label + 12.0
}

/// The names of an axis in lines that fit below it.
pub(crate) fn names_below(axis: &Axis, width: f64) -> Vec<Vec<String>> {
    if !axis.named {
        return Vec::new();
    }
    let room = width / small(axis.marks.len().max(1)) - 4.0;
    axis.marks.iter().map(|(_, name)| svg::wrapped(name, TICK.size, room, 3)).collect()
}

/// The ticks of an axis: its marks, or about `wanted` round values.
pub(crate) fn ticks(axis: &Axis, scale: &Scale, wanted: usize) -> Vec<Tick> {
    if axis.marks.is_empty() {
        return scale.ticks(wanted);
    }
    let tick = |(at, label): &(f64, String)| {
        let fraction = scale.fraction(*at).filter(|f| (-1e-9..=1.0 + 1e-9).contains(f))?;
        Some(Tick { fraction, label: Some(label.clone()) })
    };
    axis.marks.iter().filter_map(tick).collect()
}

/// How many ticks suit a vertical axis of `height` pixels.
pub(crate) fn ticks_upwards(height: f64) -> usize {
    (2..=8).rfind(|n| small(*n) <= height / 32.0).unwrap_or(2)
}

/// How many ticks suit a horizontal axis of `width` pixels.
pub(crate) fn ticks_across(width: f64) -> usize {
    (2..=12).rfind(|n| small(*n) <= width / 56.0).unwrap_or(2)
}

pub(crate) fn small(count: usize) -> f64 {
    count as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::BLUE;
    use crate::figure::Look;
    use crate::scale::Kind;
    use crate::svg::{Shape, Style};

    fn panel(title: &str, height: f64) -> Panel {
        let mut panel = Panel::new(title, Axis::new("y", Kind::Linear), height);
        panel.add("curve", vec![(0.0, 1.0), (1.0, 2.0)], Style::new(BLUE, Shape::Line(1.0)));
        panel
    }

    fn own_axis(title: &str) -> Panel {
        Panel { x: Some(Axis::new("own", Kind::Linear)), ..panel(title, 50.0) }
    }

    /// Columns have their shares of what the margins leave, and end where the page does.
    #[test]
    fn columns_share_the_width() {
        let x = Axis::new("x", Kind::Linear);
        let panels = ["a", "b", "c"].map(|title| panel(title, 100.0)).to_vec();
        let figure = Figure::grid("grid", x, vec![3.0, 1.0], panels);
        let layout = Layout::of(&figure).unwrap();
        let frames: Vec<Frame> = layout.panels.iter().map(|placed| placed.frame).collect();
        assert!((frames[0].width - 3.0 * frames[1].width).abs() < 1e-9, "{frames:?}");
        assert!((frames[1].right() - (WIDTH - RIGHT)).abs() < 1e-9, "{frames:?}");
        assert!(frames[1].left > frames[0].right() + 50.0, "{frames:?}");
        assert!((frames[2].left - frames[0].left).abs() < 1e-9);
        assert!((frames[2].width - frames[0].width).abs() < 1e-9);
        assert!((frames[1].top - frames[0].top).abs() < 1e-9 && frames[2].top > frames[0].bottom());
        assert!(layout.height > frames[2].bottom() + 20.0);
    }

    /// The axis below is drawn once for the panels that share it, and for each that has its own; below
    /// a note there is none.
    #[test]
    fn the_last_panel_has_the_axis_below() {
        let note =
            Panel { note: Some("nothing".to_owned()), series: Vec::new(), ..panel("note", 30.0) };
        let panels = vec![panel("a", 50.0), own_axis("b"), panel("c", 50.0), note];
        let figure = Figure::stack("stack", Axis::new("x", Kind::Linear), panels);
        let layout = Layout::of(&figure).unwrap();
        let feet: Vec<bool> = layout.panels.iter().map(|placed| placed.foot).collect();
        assert_eq!(feet, [false, true, true, false]);
        let between = |i: usize| layout.panels[i + 1].frame.top - layout.panels[i].frame.bottom();
        assert!(between(1) > between(0) + 10.0, "room for the axis of b");
        let heights: Vec<f64> = layout.panels.iter().map(|placed| placed.frame.height).collect();
        assert_eq!(format!("{heights:?}"), "[50.0, 50.0, 50.0, 30.0]");
    }

    /// Keys stand in rows that end before the right edge; a row begins on the left.
    #[test]
    fn keys_stand_within_the_page() {
        let key = |i: usize| Key {
            label: format!("a key with a long name {i}"),
            look: Look::Curve(Style::new(BLUE, Shape::Line(1.0))),
        };
        let keys: Vec<Key> = (0..12).map(key).collect();
        let (placed, rows) = placed_keys(&keys, 100.0, (50.0, 900.0), 4.0);
        let width = SWATCH + 6.0 + svg::width_of(&keys[0].label, LABEL.size);
        let mut expected = 100.0;
        let mut row = 0.0;
        for of in &placed {
            if expected + width > 900.0 {
                (expected, row) = (50.0, row + 1.0);
            }
            let slack = 1.5 * LABEL.size;
            assert!((of.left - expected).abs() < slack, "{} {expected}", of.left);
            assert!(of.left + width <= 900.0 + slack);
            assert!((of.y - (4.0 + ROW * (row + 0.5))).abs() < 1e-9);
            expected = of.left + svg::width_of(&of.key.label, LABEL.size) + SWATCH + 26.0;
        }
        assert!(row > 2.0 && (rows - (row + 1.0)).abs() < 1e-12, "{rows}");
        // One that is wider than the page has a row for itself.
        let (placed, rows) = placed_keys(&keys[..2], 50.0, (50.0, 60.0), 0.0);
        assert!(
            (rows - 2.0).abs() < 1e-12 && placed.iter().all(|of| (of.left - 50.0).abs() < 1e-9)
        );
    }
}
