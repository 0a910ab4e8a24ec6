//! A [`Figure`] drawn as laid out: frames, ticks, legends, areas, curves, words.

use crate::color::{GRID, INK};
use crate::curve::{Frame, Point, pieces, simplified, thinned};
use crate::figure::{Area, Figure, Look, Panel, Series, Span, limit_style};
use crate::flags::Flag;
use crate::layout::{
    LABEL, LANE, LINE, Layout, Placed, PlacedKey, SWATCH, Scales, TICK, TITLE, WIDTH,
    label_distance, label_lines, names_below, small, ticks, ticks_across, ticks_upwards,
};
use crate::scale::{Scale, Tick};
use crate::svg::{self, Anchor, Canvas, Shape, Style, Word};
use crate::{labels, text};

/// Marks are thinned only where there are more than anyone could see.
const MOST_MARKS: usize = 4000;
/// Half the width of the bars at the ends of a span.
const CAP: f64 = 4.0;

impl Figure {
    /// Draws the figure as an SVG document; `None` if no panel has anything to show.
    pub fn svg(&self) -> Option<String> {
        let layout = Layout::of(self)?;
        Some(svg::page((WIDTH, layout.height), (&self.name, &about(&layout)), |canvas| {
            for key in &layout.keys {
                draw_key(canvas, key);
            }
            for placed in &layout.panels {
                placed.draw(canvas, &layout.flags);
            }
            draw_flags(canvas, &layout.flags, layout.panels[0].frame.top);
        }))
    }
}

/// The panels in words: their titles, their axes, the names of their curves.
fn about(layout: &Layout<'_>) -> String {
    let one = |placed: &Placed<'_>| {
        let panel = placed.panel;
        let title = if panel.title.is_empty() { "Panel" } else { &panel.title };
        if placed.scales.is_none() {
            return format!("{title}: {}", panel.note.as_deref().unwrap_or_default());
        }
        let names: Vec<String> = panel.keys.iter().map(|key| key.label.clone()).collect();
        let names =
            if names.is_empty() { String::new() } else { format!(": {}", text::listed(&names)) };
        format!("{title}, {} over {}{names}.", panel.y.label, placed.x.label)
    };
    layout.panels.iter().map(one).collect::<Vec<_>>().join(" ")
}

impl Placed<'_> {
    fn draw(&self, canvas: &mut Canvas, flags: &[Flag<'_>]) {
        let title = svg::fitted(&self.panel.title, 1.08 * TITLE.size, self.frame.width);
        canvas.word(&title, (self.frame.left, self.title), &TITLE);
        for key in &self.keys {
            draw_key(canvas, key);
        }
        match self.scales {
            Some(scales) => self.draw_content(canvas, &scales, flags),
            None => self.draw_note(canvas),
        }
    }

    fn draw_note(&self, canvas: &mut Canvas) {
        let Frame { left, top, width, height } = self.frame;
        let (right, bottom) = (self.frame.right(), self.frame.bottom());
        let edge = Style::new(GRID, Shape::Line(1.0));
        canvas.line(
            &[(left, top), (right, top), (right, bottom), (left, bottom), (left, top)],
            &edge,
        );
        let note = self.panel.note.as_deref().unwrap_or_default();
        let lines = svg::wrapped(note, LABEL.size, width - 16.0, 4);
        let first = top + 0.5 * (height - LINE * small(lines.len().saturating_sub(1)));
        for (i, line) in lines.iter().enumerate() {
            let y = first + LINE * small(i);
            canvas.word(line, (left + 0.5 * width, y), &LABEL.anchored(Anchor::Middle));
        }
    }

    fn draw_content(&self, canvas: &mut Canvas, scales: &Scales, flags: &[Flag<'_>]) {
        let across = ticks(self.x, &scales.x, ticks_across(self.frame.width));
        let upwards = ticks(&self.panel.y, &scales.y, ticks_upwards(self.panel.height));
        self.draw_grid(canvas, &across, &upwards);
        for area in &self.panel.areas {
            self.draw_area(canvas, scales, area);
        }
        for flag in flags.iter().filter(|_| self.eventful) {
            self.upright(canvas, flag.x, &flag.event.style);
        }
        for x in self.panel.uprights.iter().filter_map(|x| self.across(&scales.x, *x)) {
            self.upright(canvas, x, &Style { shape: Shape::Dashes(1.0), ..limit_style() });
        }
        for limit in &self.panel.limits {
            let fraction = scales.y.fraction(*limit).filter(|f| (0.0..=1.0).contains(f));
            if let Some(fraction) = fraction {
                self.level(canvas, fraction, &limit_style());
            }
        }
        for span in &self.panel.spans {
            self.draw_span(canvas, scales, span);
        }
        for series in &self.panel.series {
            self.draw_series(canvas, scales, series);
        }
        self.draw_labels(canvas, scales);
        self.draw_axes(canvas, &across, &upwards);
    }

    fn draw_grid(&self, canvas: &mut Canvas, across: &[Tick], upwards: &[Tick]) {
        let grid = Style::new(GRID, Shape::Line(1.0));
        let faded = |tick: &Tick| if tick.label.is_some() { grid } else { grid.faint(0.5) };
        for tick in across.iter().filter(|_| !self.x.named) {
            self.upright(canvas, self.frame.left + tick.fraction * self.frame.width, &faded(tick));
        }
        // Minor lines nearer to one another than this would make a grey ground.
        let fine = small(upwards.len()) * 6.0 < self.frame.height;
        let upwards = upwards.iter().filter(|tick| fine || tick.label.is_some());
        for tick in upwards.filter(|_| !self.panel.y.named) {
            self.level(canvas, tick.fraction, &faded(tick));
        }
    }

    /// The axes: their lines, their ticks' labels and what they show.
    fn draw_axes(&self, canvas: &mut Canvas, across: &[Tick], upwards: &[Tick]) {
        let Frame { left, top, .. } = self.frame;
        let (right, bottom) = (self.frame.right(), self.frame.bottom());
        let ink = Style::new(INK, Shape::Line(1.0));
        canvas.line(&[(left, top), (left, bottom), (right, bottom)], &ink);
        let y = &self.panel.y;
        for tick in upwards {
            let at = self.height_of(tick.fraction);
            let length = if tick.label.is_some() { 5.0 } else { 3.0 };
            if !y.named {
                canvas.line(&[(left - length, at), (left, at)], &ink);
            }
            if let Some(label) = tick.label.as_ref().filter(|_| !y.silent) {
                let label = svg::fitted(label, TICK.size, 0.25 * WIDTH);
                canvas.word(&label, (left - 8.0, at), &TICK.anchored(Anchor::End));
            }
        }
        if !y.silent {
            let lines = label_lines(y, self.frame.height);
            let nearest = left - label_distance(upwards);
            for (i, line) in lines.iter().rev().enumerate() {
                let middle = (nearest - LINE * small(i), top + 0.5 * self.frame.height);
                canvas.word(line, middle, &LABEL.anchored(Anchor::Upwards));
            }
        }
        if self.foot {
            self.draw_foot(canvas, across);
        }
    }

    fn draw_foot(&self, canvas: &mut Canvas, across: &[Tick]) {
        let Frame { left, width, .. } = self.frame;
        let first = self.frame.bottom() + 14.0;
        let word = TICK.anchored(Anchor::Middle);
        let names = names_below(self.x, width);
        let mut end = f64::NEG_INFINITY;
        for (i, tick) in across.iter().enumerate() {
            let Some(label) = &tick.label else { continue };
            let x = left + tick.fraction * width;
            if let Some(lines) = names.get(i) {
                for (line, row) in lines.iter().zip(0..) {
                    canvas.word(line, (x, first + LINE * small(row)), &word);
                }
                continue;
            }
            let half = 0.5 * svg::width_of(label, TICK.size);
            if x - half > end {
                canvas.word(label, (x, first), &word);
                end = x + half + 4.0;
            }
        }
        let lines = names.iter().map(Vec::len).max().unwrap_or(1);
        let middle = (left + 0.5 * width, first + LINE * small(lines) + 5.0);
        let label = svg::fitted(&self.x.label, LABEL.size, width);
        canvas.word(&label, middle, &LABEL.anchored(Anchor::Middle));
    }

    fn draw_area(&self, canvas: &mut Canvas, scales: &Scales, area: &Area) {
        let Frame { left, width, top, height } = self.frame;
        let ends = |scale: &Scale, (from, to): (f64, f64)| {
            let from = scale.fraction(from).unwrap_or(0.0).clamp(0.0, 1.0);
            let to = scale.fraction(to).unwrap_or(0.0).clamp(0.0, 1.0);
            (from.min(to), from.max(to))
        };
        let (x, y) = (ends(&scales.x, area.x), ends(&scales.y, area.y));
        let place = Frame {
            left: left + x.0 * width,
            top: top + (1.0 - y.1) * height,
            width: (x.1 - x.0) * width,
            height: (y.1 - y.0) * height,
        };
        canvas.area(&place, &area.fill);
        draw_text(canvas, area, &place);
    }

    fn draw_span(&self, canvas: &mut Canvas, scales: &Scales, span: &Span) {
        let Some(x) = self.across(&scales.x, span.x) else { return };
        let inside = |value| Some(scales.y.fraction(value)?.clamp(0.0, 1.0));
        let (Some(low), Some(high)) = (inside(span.y.0), inside(span.y.1)) else { return };
        let (low, high) = (self.height_of(low), self.height_of(high));
        let style = Style::new(span.color, Shape::Line(1.4));
        canvas.line(&[(x, low), (x, high)], &style);
        for y in [low, high] {
            canvas.line(&[(x - CAP, y), (x + CAP, y)], &style);
        }
    }

    fn draw_series(&self, canvas: &mut Canvas, scales: &Scales, series: &Series) {
        let Series { points, style, .. } = series;
        let places: Vec<Option<Point>> = points.iter().map(|p| self.place(scales, *p)).collect();
        if style.shape.is_line() {
            for piece in pieces(&places, &self.frame) {
                match piece[..] {
                    [only] => canvas.mark(only, style),
                    _ => canvas.line(&simplified(&piece), style),
                }
            }
            return;
        }
        let inside = places.into_iter().flatten();
        let mut inside: Vec<Point> = inside.filter(|p| self.frame.contains(*p)).collect();
        match style.shape {
            Shape::Dots(radius) if inside.len() > MOST_MARKS => {
                canvas.dots(&thinned(&inside, 1.0), radius, style);
            }
            _ => {
                if inside.len() > MOST_MARKS {
                    inside = thinned(&inside, 1.0);
                }
                inside.into_iter().for_each(|p| canvas.mark(p, style));
            }
        }
    }

    fn draw_labels(&self, canvas: &mut Canvas, scales: &Scales) {
        let Panel { labels, series, spans, .. } = self.panel;
        if labels.is_empty() {
            return;
        }
        let seen = |p: &Point| self.place(scales, *p).filter(|p| self.frame.contains(*p));
        let dots: Vec<Point> = series.iter().flat_map(|s| &s.points).filter_map(seen).collect();
        let curve = |s: &Series| s.points.iter().filter_map(seen).collect();
        let span = |span: &Span| {
            let ends = [span.y.0, span.y.1].map(|y| self.place(scales, (span.x, y)));
            ends.into_iter().flatten().collect()
        };
        let curves = series.iter().filter(|s| s.style.shape.is_line()).map(curve);
        let curves: Vec<Vec<Point>> = curves.chain(spans.iter().map(span)).collect();
        let words = labels.iter().filter_map(|label| Some((seen(&label.at)?, label)));
        for (place, label) in labels::placed(words, &dots, &curves, &self.frame, TICK.size) {
            let word = Word { color: label.color, rim: true, ..TICK };
            canvas.word(&label.text, place, &word);
        }
    }

    fn place(&self, scales: &Scales, p: Point) -> Option<Point> {
        let (x, y) = (scales.x.fraction(p.0)?, scales.y.fraction(p.1)?);
        Some((self.frame.left + x * self.frame.width, self.height_of(y)))
    }

    /// Where a value of the horizontal axis lies, if it lies inside.
    fn across(&self, scale: &Scale, value: f64) -> Option<f64> {
        let fraction = scale.fraction(value).filter(|f| (0.0..=1.0).contains(f))?;
        Some(self.frame.left + fraction * self.frame.width)
    }

    fn height_of(&self, fraction: f64) -> f64 {
        self.frame.bottom() - fraction * self.frame.height
    }

    fn level(&self, canvas: &mut Canvas, fraction: f64, style: &Style) {
        let y = self.height_of(fraction);
        canvas.line(&[(self.frame.left, y), (self.frame.right(), y)], style);
    }

    fn upright(&self, canvas: &mut Canvas, x: f64, style: &Style) {
        canvas.line(&[(x, self.frame.top), (x, self.frame.bottom())], style);
    }
}

/// The words in an area's middle.
fn draw_text(canvas: &mut Canvas, area: &Area, place: &Frame) {
    let lines: Vec<&str> = area.text.lines().filter(|line| !line.is_empty()).collect();
    let height = LINE * small(lines.len());
    let fits = height <= place.height;
    let (color, rim) = match fits && !area.fill.hatched {
        true => (area.fill.color.contrary(), false),
        false => (INK, true),
    };
    let x = place.left + 0.5 * place.width;
    // Words too high for a low bar stand on it.
    let above = if fits { 0.5 * (place.height - height) } else { -height };
    let first = place.top + above + 0.5 * LINE;
    for (i, line) in lines.into_iter().enumerate() {
        let size = if i == 0 { TICK.size } else { 0.86 * TICK.size };
        let word = Word { size, color, rim, anchor: Anchor::Middle, ..TICK };
        let line = svg::fitted(line, size, place.width - 2.0);
        canvas.word(&line, (x, first + LINE * small(i)), &word);
    }
}

fn draw_flags(canvas: &mut Canvas, flags: &[Flag<'_>], top: f64) {
    for Flag { event, x, span, lane } in flags {
        let Some(lane) = lane else { continue };
        let y = top - LANE * (small(*lane) + 0.5);
        canvas.line(&[(*x, top), (*x, y - 0.5 * LANE)], &event.style);
        let (anchor, offset) = match span.0 < *x {
            true => (Anchor::End, -4.0),
            false => (Anchor::Start, 4.0),
        };
        canvas.word(&event.label, (x + offset, y), &TICK.anchored(anchor));
    }
}

fn draw_key(canvas: &mut Canvas, PlacedKey { key, left, y }: &PlacedKey<'_>) {
    match &key.look {
        Look::Curve(style) if style.shape.is_line() => {
            canvas.line(&[(*left, *y), (left + SWATCH, *y)], style);
        }
        Look::Curve(style) => canvas.mark((left + 0.5 * SWATCH, *y), style),
        Look::Area(fill) => {
            let place = Frame { left: *left, top: y - 6.0, width: SWATCH, height: 12.0 };
            canvas.area(&place, fill);
        }
    }
    canvas.word(&key.label, (left + SWATCH + 6.0, *y), &LABEL);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{AMBER, BLUE, Color, GREEN, GREY, PURPLE};
    use crate::figure::{Axis, Event};
    use crate::scale::Kind;
    use crate::svg::Fill;

    /// A figure with one panel from 0 to 10 across and from 0 to 100 upwards, its frame, and what is
    /// drawn.
    fn drawn(change: impl FnOnce(&mut Figure)) -> (Frame, String) {
        let y = Axis::ranged("height", Kind::Linear, (0.0, 100.0));
        let x = Axis::ranged("time", Kind::Linear, (0.0, 10.0));
        let mut panel = Panel::new("", y, 200.0);
        panel.add("diagonal", vec![(0.0, 0.0), (5.0, 50.0), (10.0, 100.0)], line(BLUE));
        let mut figure = Figure::stack("figure", x, vec![panel]);
        change(&mut figure);
        let frame = Layout::of(&figure).unwrap().panels[0].frame;
        (frame, figure.svg().unwrap())
    }

    fn line(color: Color) -> Style {
        Style::new(color, Shape::Line(1.8))
    }

    fn attribute<'a>(element: &'a str, name: &str) -> &'a str {
        let from = element.find(&format!(" {name}=\"")).expect(name) + name.len() + 3;
        element[from..].split('"').next().unwrap()
    }

    fn number(element: &str, name: &str) -> f64 {
        attribute(element, name).parse().unwrap()
    }

    /// The elements of a kind and colour.
    fn elements<'a>(svg: &'a str, kind: &str, color: Color) -> Vec<&'a str> {
        let (begin, color) = (format!("<{kind} "), color.hex());
        svg.lines().filter(|of| of.starts_with(&begin) && of.contains(&color)).collect()
    }

    /// The corners of the lines of a colour.
    fn lines(svg: &str, color: Color) -> Vec<Vec<Point>> {
        let corner = |text: &str| {
            let (x, y) = text.split_once(',').unwrap();
            (x.parse().unwrap(), y.parse().unwrap())
        };
        let of = |element: &&str| attribute(element, "points").split(' ').map(corner).collect();
        elements(svg, "polyline", color).iter().map(of).collect()
    }

    /// The place of a word.
    fn word(svg: &str, text: &str) -> Point {
        let end = format!(">{text}</text>");
        let found: Vec<&str> = svg.lines().filter(|of| of.ends_with(&end)).collect();
        let [element] = found[..] else { panic!("{text}: {found:?}") };
        (number(element, "x"), number(element, "y"))
    }

    /// Pixels are rounded to tenths.
    fn assert_near(found: &[Point], expected: &[Point]) {
        let is_near = |(a, b): (&Point, &Point)| (a.0 - b.0).abs() + (a.1 - b.1).abs() < 0.11;
        let are_near = found.len() == expected.len() && found.iter().zip(expected).all(is_near);
        assert!(are_near, "{found:?}, not {expected:?}");
    }

    /// Small values are on the left and below, large ones on the right and above; so are the labels
    /// of the ticks. The line between needs no corner.
    #[test]
    fn values_grow_to_the_right_and_upwards() {
        let (frame, svg) = drawn(|_| {});
        let [curve] = &lines(&svg, BLUE)[..] else { panic!("{svg}") };
        assert_near(curve, &[(frame.left, frame.bottom()), (frame.right(), frame.top)]);
        let (low, high) = (word(&svg, "20"), word(&svg, "80"));
        // Words stand by 0.35 of their size below their middle.
        let below = 0.35 * TICK.size;
        let at = |part: f64| frame.bottom() - part * frame.height + below;
        assert_near(&[low, high], &[(frame.left - 8.0, at(0.2)), (frame.left - 8.0, at(0.8))]);
        let (left, right) = (word(&svg, "2"), word(&svg, "8"));
        assert!((left.0 - (frame.left + 0.2 * frame.width)).abs() < 0.11, "{left:?}");
        assert!((right.0 - (frame.left + 0.8 * frame.width)).abs() < 0.11, "{right:?}");
        assert!(left.1 > frame.bottom() && svg.contains("<desc>Panel, height over time.</desc>"));
    }

    /// A limit within the panel is a line over its whole width; one beyond is not there.
    #[test]
    fn limits_are_drawn_where_they_are() {
        let (frame, svg) = drawn(|figure| {
            figure.panels[0].limits = vec![25.0, 150.0, -10.0];
            figure.panels[0].uprights = vec![7.5, 11.0];
        });
        let y = frame.bottom() - 0.25 * frame.height;
        let x = frame.left + 0.75 * frame.width;
        let found = lines(&svg, GREY);
        assert_eq!(found.len(), 2, "{found:?}");
        assert_near(&found[0], &[(x, frame.top), (x, frame.bottom())]);
        assert_near(&found[1], &[(frame.left, y), (frame.right(), y)]);
    }

    /// An area lies between its ends, as far as they are in the panel; words too high for it stand on
    /// it.
    #[test]
    fn areas_lie_between_their_ends() {
        let area = |y: (f64, f64), color| Area {
            name: String::new(),
            x: (8.0, 2.0),
            y,
            fill: Fill::solid(color),
            value: None,
            text: format!("{:?}", y.0),
        };
        let (frame, svg) = drawn(|figure| {
            let areas =
                [area((20.0, 60.0), AMBER), area((0.0, 1.0), GREEN), area((90.0, 300.0), PURPLE)];
            figure.panels[0].areas = areas.to_vec();
        });
        let rect = |color| {
            let [of] = elements(&svg, "rect", color)[..] else { panic!("{svg}") };
            let [x, y, width, height] = ["x", "y", "width", "height"].map(|name| number(of, name));
            [(x, y), (x + width, y + height)]
        };
        let corner = |x: f64, y: f64| {
            (frame.left + 0.1 * x * frame.width, frame.bottom() - 0.01 * y * frame.height)
        };
        let ends = |low, high| [corner(2.0, high), corner(8.0, low)];
        for (color, low, high) in [(AMBER, 20.0, 60.0), (GREEN, 0.0, 1.0), (PURPLE, 90.0, 100.0)] {
            let (found, expected) = (rect(color), ends(low, high));
            let off =
                found.iter().zip(expected).map(|(a, b)| (a.0 - b.0).abs().max((a.1 - b.1).abs()));
            assert!(off.fold(0.0, f64::max) < 0.21, "{found:?}, not {expected:?}");
        }
        let middle = corner(5.0, 40.0);
        assert_near(&[word(&svg, "20.0")], &[(middle.0, middle.1 + 0.35 * TICK.size)]);
        let on = corner(5.0, 1.0).1 - 0.5 * LINE + 0.35 * TICK.size;
        assert!((word(&svg, "0.0").1 - on).abs() < 0.11, "{:?}", word(&svg, "0.0"));
    }

    /// A span is a line with a bar at each end, which ends at the frame.
    #[test]
    fn spans_have_bars_at_their_ends() {
        let (frame, svg) = drawn(|figure| {
            let span = |x| Span { name: String::new(), x, y: (30.0, 140.0), color: GREEN };
            figure.panels[0].spans = vec![span(5.0), span(12.0)];
        });
        let x = frame.left + 0.5 * frame.width;
        let (low, high) = (frame.bottom() - 0.3 * frame.height, frame.top);
        let found = lines(&svg, GREEN);
        assert_eq!(found.len(), 3, "{found:?}");
        assert_near(&found[0], &[(x, low), (x, high)]);
        assert_near(&found[1], &[(x - CAP, low), (x + CAP, low)]);
        assert_near(&found[2], &[(x - CAP, high), (x + CAP, high)]);
    }

    /// The word of an event stands beside its line, above the panel; near the right edge on the left
    /// of it.
    #[test]
    fn events_are_named_beside_their_lines() {
        let (frame, svg) = drawn(|figure| {
            let event = |x: f64, label: &str| Event::minor(x, label.to_owned());
            figure.events =
                vec![event(4.0, "begin"), event(9.9, "the long end"), event(20.0, "never")];
        });
        let at = |part: f64| frame.left + part * frame.width;
        let (begin, end) = (word(&svg, "begin"), word(&svg, "the long end"));
        assert!((begin.0 - at(0.4) - 4.0).abs() < 0.11 && (end.0 - at(0.99) + 4.0).abs() < 0.11);
        assert!(begin.1 < frame.top && end.1 < frame.top);
        assert!(svg.contains("text-anchor=\"end\"") && !svg.contains("never"));
    }
}
