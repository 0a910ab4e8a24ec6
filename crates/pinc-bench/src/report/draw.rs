//! A [`Figure`] laid out and drawn: frames, ticks, legends above the panels, curves.

use super::canvas::{self, Anchor, BLACK, Canvas, Color, GRID, INK, Shape, Style, Word};
use super::curve::{Frame, Point, pieces, thinned};
use super::error::DrawError;
use super::figure::{Event, Figure, Key, Panel, Series, limit_style};
use super::scale::{Scale, Tick};

const WIDTH: f64 = 1100.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 20.0;
/// A row of a panel's title and legend.
const ROW: f64 = 21.0;
/// A row of the events' words.
const LANE: f64 = 16.0;
const MOST_LANES: usize = 4;
/// Between two panels, and below the last one for ticks and label.
const GAP: f64 = 14.0;
const FOOT: f64 = 46.0;
const SWATCH: f64 = 28.0;
/// Marks are thinned only where there are more than anyone could see.
const MOST_MARKS: usize = 4000;

const TITLE: Word = Word { size: 14.0, color: BLACK, bold: true, anchor: Anchor::Start };
const LABEL: Word = Word { size: 13.0, color: INK, bold: false, anchor: Anchor::Start };
const TICK: Word = Word { size: 12.0, ..LABEL };

/// A panel with its place on the page.
struct Placed<'a> {
    panel: &'a Panel,
    scale: Scale,
    header: f64,
    frame: Frame,
}

/// An event's word with its place: a lane counted from the panel upwards.
#[derive(Clone, Copy)]
struct Flag<'a> {
    event: &'a Event,
    x: f64,
    /// The ends of the word.
    span: (f64, f64),
    lane: Option<usize>,
}

impl<'a> Flag<'a> {
    fn new(event: &'a Event, x: f64) -> Self {
        let width = canvas::width_of(&event.label, TICK.size) + 10.0;
        let span = match x + width > WIDTH - RIGHT {
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

impl Figure {
    /// Draws the figure as an SVG document; `None` if no panel has anything to show.
    pub(super) fn svg(&self) -> Result<Option<String>, DrawError> {
        let x = Scale::exact(self.x.0, self.x.1);
        let flags = self.flags(&x);
        let lanes = flags.iter().filter_map(|f| f.lane).max();
        let (panels, height) = self.layout(&x, lanes.map_or(0, |lane| lane + 1));
        if panels.is_empty() {
            return Ok(None);
        }
        let svg = canvas::page((WIDTH, height), &self.name, |canvas| {
            for (i, placed) in panels.iter().enumerate() {
                placed.draw(canvas, &x, &flags)?;
                if i == 0 {
                    draw_flags(canvas, &flags, placed.frame.top)?;
                }
            }
            let last = &panels[panels.len() - 1];
            self.draw_foot(canvas, &x, &last.frame)
        })?;
        Ok(Some(svg))
    }

    /// Gives each panel that shows something its place; also the height of the page.
    fn layout(&self, x: &Scale, lanes: usize) -> (Vec<Placed<'_>>, f64) {
        let mut top = 4.0;
        let mut placed = Vec::new();
        for panel in &self.panels {
            let Some(scale) = panel.scale(x.range()) else {
                continue;
            };
            let header = top;
            top += ROW * rows(panel) + 4.0;
            if placed.is_empty() {
                top += LANE * small(lanes);
            }
            let frame =
                Frame { left: LEFT, top, width: WIDTH - LEFT - RIGHT, height: panel.height };
            top = frame.bottom() + GAP;
            placed.push(Placed { panel, scale, header, frame });
        }
        (placed, top - GAP + FOOT)
    }

    /// The events inside the picture, each word in the lowest lane where nothing touches it.
    fn flags(&self, x: &Scale) -> Vec<Flag<'_>> {
        let mut flags = Vec::new();
        for event in &self.events {
            let fraction = x.fraction(event.x).filter(|f| (0.0..=1.0).contains(f));
            flags.extend(fraction.map(|f| Flag::new(event, LEFT + f * (WIDTH - LEFT - RIGHT))));
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

    fn draw_foot(&self, canvas: &Canvas<'_>, x: &Scale, frame: &Frame) -> Result<(), DrawError> {
        for Tick { fraction, label } in x.ticks(12) {
            let at = frame.left + fraction * frame.width;
            if let Some(label) = label {
                let anchor = Anchor::Middle;
                canvas.word(&label, (at, frame.bottom() + 14.0), &Word { anchor, ..TICK })?;
            }
        }
        let middle = (frame.left + 0.5 * frame.width, frame.bottom() + 34.0);
        let anchor = Anchor::Middle;
        canvas.word(&self.x_label, middle, &Word { anchor, ..LABEL })
    }
}

impl Placed<'_> {
    fn draw(&self, canvas: &Canvas<'_>, x: &Scale, flags: &[Flag<'_>]) -> Result<(), DrawError> {
        self.draw_header(canvas)?;
        self.draw_grid(canvas, x)?;
        for flag in flags {
            let ends = [(flag.x, self.frame.top), (flag.x, self.frame.bottom())];
            canvas.line(&ends, &flag.event.style)?;
        }
        for limit in &self.panel.limits {
            if let Some(fraction) = self.scale.fraction(*limit) {
                self.level(canvas, fraction, &limit_style())?;
            }
        }
        for series in &self.panel.series {
            self.draw_series(canvas, x, series)?;
        }
        self.draw_axis(canvas)
    }

    fn draw_header(&self, canvas: &Canvas<'_>) -> Result<(), DrawError> {
        let middle = self.header + 0.5 * ROW;
        canvas.word(&self.panel.title, (LEFT, middle), &TITLE)?;
        for (key, (left, row)) in self.panel.keys.iter().zip(key_places(self.panel)) {
            let y = middle + ROW * row;
            draw_swatch(canvas, key, (left, y))?;
            canvas.word(&key.label, (left + SWATCH + 6.0, y), &LABEL)?;
        }
        Ok(())
    }

    fn draw_grid(&self, canvas: &Canvas<'_>, x: &Scale) -> Result<(), DrawError> {
        let grid = Style::new(GRID, Shape::Line(1.0));
        for tick in x.ticks(12) {
            let at = self.frame.left + tick.fraction * self.frame.width;
            canvas.line(&[(at, self.frame.top), (at, self.frame.bottom())], &grid)?;
        }
        for tick in self.ticks() {
            let grid = match tick.label {
                Some(_) => grid,
                None => grid.faint(0.4),
            };
            self.level(canvas, tick.fraction, &grid)?;
        }
        Ok(())
    }

    /// The vertical axis: its line, its ticks' labels and what it shows.
    fn draw_axis(&self, canvas: &Canvas<'_>) -> Result<(), DrawError> {
        let Frame { left, top, .. } = self.frame;
        let (right, bottom) = (self.frame.right(), self.frame.bottom());
        let axis = Style::new(INK, Shape::Line(1.0));
        canvas.line(&[(left, top), (left, bottom), (right, bottom)], &axis)?;
        for tick in self.ticks() {
            let y = self.y(tick.fraction);
            let length = if tick.label.is_some() { 5.0 } else { 3.0 };
            canvas.line(&[(left - length, y), (left, y)], &axis)?;
            if let Some(label) = tick.label {
                let anchor = Anchor::End;
                canvas.word(&label, (left - 8.0, y), &Word { anchor, ..TICK })?;
            }
        }
        let middle = (16.0, top + 0.5 * self.frame.height);
        let anchor = Anchor::Upwards;
        canvas.word(&self.panel.y_label, middle, &Word { anchor, ..LABEL })
    }

    fn draw_series(
        &self,
        canvas: &Canvas<'_>,
        x: &Scale,
        Series { points, style }: &Series,
    ) -> Result<(), DrawError> {
        let place = |p: &Point| {
            let (x, y) = (x.fraction(p.0)?, self.scale.fraction(p.1)?);
            Some((self.frame.left + x * self.frame.width, self.y(y)))
        };
        let places: Vec<Option<Point>> = points.iter().map(place).collect();
        if let Shape::Line(_) | Shape::Dashes(_) = style.shape {
            for piece in pieces(&places, &self.frame) {
                match piece[..] {
                    [only] => canvas.mark(only, style)?,
                    _ => canvas.line(&thinned(&piece), style)?,
                }
            }
            return Ok(());
        }
        let inside = places.into_iter().flatten();
        let mut inside: Vec<Point> = inside.filter(|p| self.frame.contains(*p)).collect();
        if inside.len() > MOST_MARKS {
            inside = thinned(&inside);
        }
        inside.into_iter().try_for_each(|p| canvas.mark(p, style))
    }

    fn ticks(&self) -> Vec<Tick> {
        let wanted = (self.frame.height / 32.0).clamp(2.0, 8.0);
        let wanted = (2..=8).rfind(|n| small(*n) <= wanted).unwrap_or(2);
        self.scale.ticks(wanted)
    }

    fn level(&self, canvas: &Canvas<'_>, fraction: f64, style: &Style) -> Result<(), DrawError> {
        let y = self.y(fraction);
        canvas.line(&[(self.frame.left, y), (self.frame.right(), y)], style)
    }

    fn y(&self, fraction: f64) -> f64 {
        self.frame.bottom() - fraction * self.frame.height
    }
}

fn draw_flags(canvas: &Canvas<'_>, flags: &[Flag<'_>], top: f64) -> Result<(), DrawError> {
    for Flag { event, x, span, lane } in flags {
        let Some(lane) = lane else { continue };
        let y = top - LANE * (small(*lane) + 0.5);
        canvas.line(&[(*x, top), (*x, y - 0.5 * LANE)], &event.style)?;
        let (anchor, offset) = match span.0 < *x {
            true => (Anchor::End, -4.0),
            false => (Anchor::Start, 4.0),
        };
        canvas.word(&event.label, (x + offset, y), &Word { anchor, ..TICK })?;
    }
    Ok(())
}

fn draw_swatch(canvas: &Canvas<'_>, key: &Key, (left, y): Point) -> Result<(), DrawError> {
    match key.style.shape {
        Shape::Line(_) | Shape::Dashes(_) => {
            canvas.line(&[(left, y), (left + SWATCH, y)], &key.style)
        }
        Shape::Dots(_) | Shape::Rings(_) | Shape::Crosses(_) => {
            canvas.mark((left + 0.5 * SWATCH, y), &key.style)
        }
    }
}

/// Where the legend's lines begin, flowing in rows to the right of the panel's title.
fn key_places(panel: &Panel) -> Vec<(f64, f64)> {
    let mut left = LEFT + canvas::width_of(&panel.title, 1.08 * TITLE.size) + 26.0;
    let mut row = 0.0;
    let mut places = Vec::new();
    for key in &panel.keys {
        let width = SWATCH + 6.0 + canvas::width_of(&key.label, LABEL.size);
        if left + width > WIDTH - RIGHT {
            left = LEFT;
            row += 1.0;
        }
        places.push((left, row));
        left += width + 20.0;
    }
    places
}

fn rows(panel: &Panel) -> f64 {
    key_places(panel).last().map_or(1.0, |place| place.1 + 1.0)
}

#[expect(clippy::cast_precision_loss, reason = "counts rows and ticks")]
fn small(count: usize) -> f64 {
    count as f64
}

/// The colour of the i-th state, the same in every picture.
pub(super) fn state_color(i: usize) -> Color {
    use canvas::{AMBER, BLUE, GREEN, PURPLE, SKY, VERMILLION};
    [BLUE, VERMILLION, GREEN, PURPLE, SKY, AMBER][i % 6]
}

/// The colour of the i-th input.
pub(super) fn input_color(i: usize) -> Color {
    use canvas::{BLUE, GREEN, PURPLE, SKY, VERMILLION};
    [INK, SKY, PURPLE, GREEN, VERMILLION, BLUE][i % 6]
}
