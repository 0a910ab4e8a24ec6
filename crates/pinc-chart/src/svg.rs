//! Lines, marks, areas and words on an SVG page, in pixels.

use crate::color::{Color, WHITE};
use crate::curve::{Frame, Point};
use crate::text;
use std::fmt::Write as _;

const FONTS: &str =
    "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";

/// The form of a mark; sizes in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A line of this width.
    Line(f64),
    /// A dashed line of this width.
    Dashes(f64),
    /// A dot of this radius at each point.
    Dots(f64),
    /// A circle of this radius around each point.
    Rings(f64),
    /// A cross of this half width at each point.
    Crosses(f64),
    /// A square of this half width at each point.
    Squares(f64),
    /// A triangle of this radius at each point.
    Triangles(f64),
    /// A square that stands on a corner, of this radius, at each point.
    Diamonds(f64),
}

impl Shape {
    /// Whether the points are joined.
    pub(crate) fn is_line(self) -> bool {
        matches!(self, Self::Line(_) | Self::Dashes(_))
    }
}

/// The mark of the i-th state or curve, the same in every picture.
pub fn state_mark(i: usize) -> Shape {
    let marks =
        [Shape::Dots(3.6), Shape::Squares(3.3), Shape::Triangles(4.8), Shape::Diamonds(4.6)];
    marks[i % marks.len()]
}

/// How a curve or a set of points looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// The color.
    pub color: Color,
    /// From 0, which cannot be seen, to 1.
    pub opacity: f64,
    /// The form of the marks, or the width of the line.
    pub shape: Shape,
}

impl Style {
    /// An opaque style.
    pub fn new(color: Color, shape: Shape) -> Self {
        let opacity = 1.0;
        Self { color, opacity, shape }
    }

    /// This style with less opacity.
    pub fn faint(mut self, opacity: f64) -> Self {
        self.opacity = opacity;
        self
    }

    /// The attributes of a line of `width`.
    fn stroke(&self, width: f64) -> String {
        let color = self.color.hex();
        format!("stroke=\"{color}\" stroke-width=\"{}\"{}", Pixels(width), opacity("stroke", self))
    }

    fn fill(&self) -> String {
        format!("fill=\"{}\"{}", self.color.hex(), opacity("fill", self))
    }
}

fn opacity(what: &str, style: &Style) -> String {
    match style.opacity < 1.0 {
        true => format!(" {what}-opacity=\"{}\"", style.opacity),
        false => String::new(),
    }
}

/// How an area looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// The color.
    pub color: Color,
    /// From 0, which cannot be seen, to 1.
    pub opacity: f64,
    /// Drawn as slanting lines.
    pub hatched: bool,
}

impl Fill {
    /// An opaque area.
    pub fn solid(color: Color) -> Self {
        Self { color, opacity: 1.0, hatched: false }
    }

    /// An area of slanting lines.
    pub fn hatched(color: Color) -> Self {
        Self { hatched: true, ..Self::solid(color) }
    }
}

/// Where a word stands with respect to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
    /// Centred, and turned to be read from the right.
    Upwards,
}

/// How a word looks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Word {
    pub size: f64,
    pub color: Color,
    pub bold: bool,
    pub anchor: Anchor,
    /// A white rim, for a word over curves.
    pub rim: bool,
}

impl Word {
    /// This word elsewhere with respect to its point.
    pub(crate) fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }
}

/// A page being drawn.
#[derive(Debug)]
pub(crate) struct Canvas {
    body: String,
}

/// Draws a page of `width` by `height` pixels and returns it as an SVG document; `name` and `about`
/// are what a screen reader says.
pub(crate) fn page(
    (width, height): (f64, f64),
    (name, about): (&str, &str),
    draw: impl FnOnce(&mut Canvas),
) -> String {
    let mut canvas = Canvas { body: String::new() };
    draw(&mut canvas);
    let (width, height) = (Pixels(width), Pixels(height));
    let (name, about) = (text::escape(name), text::escape(about));
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{name}\" \
         stroke-linejoin=\"round\" \
         font-family=\"{FONTS}\">\n<title>{name}</title>\n<desc>{about}</desc>\n<rect width=\"100%\" height=\"100%\" \
         fill=\"#fff\"/>\n{}</svg>\n",
        canvas.body
    )
}

impl Canvas {
    /// A line through the points, dashed if the style says so.
    pub(crate) fn line(&mut self, points: &[Point], style: &Style) {
        let (width, dashes) = match style.shape {
            Shape::Line(width) => (width, ""),
            Shape::Dashes(width) => (width, " stroke-dasharray=\"6 4\""),
            _ => (1.0, ""),
        };
        let points = joined(points);
        self.put(format_args!(
            "<polyline points=\"{points}\" fill=\"none\" {}{dashes}/>",
            style.stroke(width)
        ));
    }

    /// The style's mark at a point; of a line, a dot as wide as the line.
    pub(crate) fn mark(&mut self, (x, y): Point, style: &Style) {
        let polygon = |corners: &[Point]| {
            let corners: Vec<Point> = corners.iter().map(|c| (x + c.0, y + c.1)).collect();
            joined(&corners)
        };
        match style.shape {
            Shape::Line(r) | Shape::Dashes(r) | Shape::Dots(r) => {
                self.circle((x, y), r, &style.fill());
            }
            Shape::Rings(r) => {
                self.circle((x, y), r, &format!("fill=\"none\" {}", style.stroke(1.6)));
            }
            Shape::Crosses(r) => {
                let line = Style { shape: Shape::Line(1.8), ..*style };
                self.line(&[(x - r, y - r), (x + r, y + r)], &line);
                self.line(&[(x - r, y + r), (x + r, y - r)], &line);
            }
            Shape::Squares(r) => {
                self.polygon(&polygon(&[(-r, -r), (r, -r), (r, r), (-r, r)]), style)
            }
            Shape::Triangles(r) => {
                let (w, h) = (0.87 * r, 0.5 * r);
                self.polygon(&polygon(&[(0.0, -r), (w, h), (-w, h)]), style);
            }
            Shape::Diamonds(r) => {
                self.polygon(&polygon(&[(0.0, -r), (r, 0.0), (0.0, r), (-r, 0.0)]), style);
            }
        }
    }

    /// Very many dots, as one element: strokes of no length with round ends.
    pub(crate) fn dots(&mut self, points: &[Point], radius: f64, style: &Style) {
        let moves = points.iter().map(|p| format!("M{},{}h0", Pixels(p.0), Pixels(p.1)));
        let moves: String = moves.collect();
        let look = style.stroke(2.0 * radius);
        self.put(format_args!("<path d=\"{moves}\" stroke-linecap=\"round\" {look}/>"));
    }

    /// A filled rectangle.
    pub(crate) fn area(&mut self, frame: &Frame, fill: &Fill) {
        let Frame { left, top, width, height } = *frame;
        let style = Style::new(fill.color, Shape::Line(1.0)).faint(fill.opacity);
        if !fill.hatched {
            let (x, y) = (Pixels(left), Pixels(top));
            self.put(format_args!(
                "<rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" {}/>",
                Pixels(width),
                Pixels(height),
                style.fill()
            ));
            return;
        }
        // Lines x + y = c, 6 pixels apart, between the rectangle's sides.
        let mut c = 6.0;
        while c < width + height {
            let from = (c.min(width), (c - width).max(0.0));
            let to = ((c - height).max(0.0), c.min(height));
            self.line(&[(left + from.0, top + from.1), (left + to.0, top + to.1)], &style);
            c += 6.0;
        }
    }

    /// A word whose middle line runs through the point.
    pub(crate) fn word(&mut self, text: &str, (x, y): Point, word: &Word) {
        if text.is_empty() {
            return;
        }
        let anchor = match word.anchor {
            Anchor::Start => "start",
            Anchor::Middle | Anchor::Upwards => "middle",
            Anchor::End => "end",
        };
        // The middle of digits and capitals lies 0.35 of the size above their feet.
        let below = 0.35 * word.size;
        let (x, y, turn) = match word.anchor {
            Anchor::Upwards => {
                let (x, y) = (Pixels(x + below), Pixels(y));
                (x, y, format!(" transform=\"rotate(-90 {x} {y})\""))
            }
            _ => (Pixels(x), Pixels(y + below), String::new()),
        };
        let weight = if word.bold { " font-weight=\"600\"" } else { "" };
        let rim = match word.rim {
            true => {
                let white = WHITE.hex();
                format!(" paint-order=\"stroke\" stroke=\"{white}\" stroke-width=\"3\"")
            }
            false => String::new(),
        };
        self.put(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" text-anchor=\"{anchor}\" \
            fill=\"{}\"{weight}{rim}{turn}>{}</text>",
            Pixels(word.size),
            word.color.hex(),
            text::escape(text)
        ));
    }

    fn circle(&mut self, (x, y): Point, radius: f64, look: &str) {
        let (x, y, r) = (Pixels(x), Pixels(y), Pixels(radius));
        self.put(format_args!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\" {look}/>"));
    }

    fn polygon(&mut self, points: &str, style: &Style) {
        self.put(format_args!("<polygon points=\"{points}\" {}/>", style.fill()));
    }

    fn put(&mut self, element: std::fmt::Arguments<'_>) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.body, "{element}");
    }
}

fn joined(points: &[Point]) -> String {
    let points: Vec<String> =
        points.iter().map(|p| format!("{},{}", Pixels(p.0), Pixels(p.1))).collect();
    points.join(" ")
}

/// A length, written to a tenth of a pixel.
#[derive(Clone, Copy)]
struct Pixels(f64);

impl std::fmt::Display for Pixels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let tenths = (10.0 * self.0).round();
        // Adding 0 turns -0 into 0.
        write!(f, "{}", tenths / 10.0 + 0.0)
    }
}

/// About how wide a text is; generous, so that what stands beside it keeps clear.
pub fn width_of(text: &str, size: f64) -> f64 {
    let ems = text.chars().map(|c| match c {
        'i' | 'j' | 'l' | '|' | '.' | ',' | '\'' | ':' | ' ' | '\u{2009}' => 0.32,
        'm' | 'w' | 'M' | 'W' | '@' => 0.9,
        '⁰' | '¹' | '²' | '³' | '⁴' | '⁵' | '⁶' | '⁷' | '⁸' | '⁹' | '⁻' => 0.42,
        c if c.is_uppercase() => 0.7,
        _ => 0.62,
    });
    size * ems.sum::<f64>()
}

/// The text, or as much of its beginning as fits into `width` with an ellipsis.
pub(crate) fn fitted(text: &str, size: f64, width: f64) -> String {
    if width_of(text, size) <= width {
        return text.to_owned();
    }
    let mut short = text.to_owned();
    while short.pop().is_some() {
        let shown = format!("{}…", short.trim_end());
        if width_of(&shown, size) <= width {
            return shown;
        }
    }
    String::new()
}

/// The text in at most `most` lines of `width`, broken at spaces; what is too long is cut.
pub(crate) fn wrapped(text: &str, size: f64, width: f64, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width_of(&format!("{line} {word}"), size) <= width => {
                line.extend([" ", word]);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    if lines.len() > most {
        let rest = lines.split_off(most - 1).join(" ");
        lines.push(rest);
    }
    lines.iter().map(|line| fitted(line, size, width)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::BLACK;

    #[test]
    fn a_page_is_one_svg_element_that_scales() {
        let style = Style::new(BLACK, Shape::Line(1.5));
        let line = [(0.0, 0.0), (99.9, 49.94)];
        let svg = page((100.0, 50.0), ("a <b>", "c & d"), |c| c.line(&line, &style));
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("viewBox=\"0 0 100 50\""));
        assert!(svg.contains("aria-label=\"a &lt;b&gt;\""));
        assert!(svg.contains("<title>a &lt;b&gt;</title>\n<desc>c &amp; d</desc>"));
        assert!(svg.contains("\"0,0 99.9,49.9\""), "{svg}");
        assert!(svg.contains("stroke-width=\"1.5\""));
    }

    #[test]
    fn hatching_stays_inside_its_rectangle() {
        let frame = Frame { left: 10.0, top: 20.0, width: 30.0, height: 12.0 };
        let svg = page((99.0, 99.0), ("", ""), |c| c.area(&frame, &Fill::hatched(BLACK)));
        let lines: Vec<&str> = svg.split("points=\"").skip(1).collect();
        // c = 6, 12, .., 36 below 30 + 12.
        assert_eq!(lines.len(), 6);
        for line in lines {
            for point in line.split('"').next().unwrap().split(' ') {
                let (x, y) = point.split_once(',').unwrap();
                assert!(frame.contains((x.parse().unwrap(), y.parse().unwrap())), "{point}");
            }
        }
    }

    #[test]
    fn long_texts_are_broken_and_cut() {
        assert_eq!(wrapped("four tanks", 10.0, 500.0, 3), ["four tanks"]);
        assert_eq!(wrapped("four tanks", 10.0, 40.0, 3), ["four", "tanks"]);
        let lines = wrapped("one two three four and more", 10.0, 40.0, 2);
        assert_eq!(lines.len(), 2);
        assert!(lines[1].ends_with('…') && width_of(&lines[1], 10.0) <= 40.0, "{lines:?}");
        assert_eq!(fitted("long", 10.0, 0.0), "");
    }
}
