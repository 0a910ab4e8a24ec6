//! Lines, marks and words on an SVG page, in pixels with fractions.
//!
//! The SVG backend of plotters knows whole units only. The page is therefore drawn [`UNITS`] times
//! larger and its view box brings it back, so that a thin line can lie between two pixels.

use super::curve::Point;
use super::error::DrawError;
use super::text;
use plotters::coord::Shift;
use plotters::prelude::{
    Circle, DrawingArea, FontFamily, FontStyle, FontTransform, IntoDrawingArea, PathElement,
    SVGBackend, Text,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, RGBColor, ShapeStyle, TextStyle};

/// Drawing units per pixel.
const UNITS: u32 = 10;

/// The page's font; the report's style sheet prefers the reader's own interface font.
const FONT: FontFamily<'static> = FontFamily::SansSerif;

/// A colour that differs from its neighbours for colour-blind readers too (Okabe and Ito).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Color(pub(super) u8, pub(super) u8, pub(super) u8);

pub(super) const BLACK: Color = Color(0, 0, 0);
pub(super) const INK: Color = Color(0x33, 0x33, 0x33);
pub(super) const GREY: Color = Color(0x8C, 0x8C, 0x8C);
pub(super) const GRID: Color = Color(0xE4, 0xE4, 0xE4);
pub(super) const AMBER: Color = Color(0xE6, 0x9F, 0x00);
pub(super) const SKY: Color = Color(0x56, 0xB4, 0xE9);
pub(super) const GREEN: Color = Color(0x00, 0x9E, 0x73);
pub(super) const BLUE: Color = Color(0x00, 0x72, 0xB2);
pub(super) const VERMILLION: Color = Color(0xD5, 0x5E, 0x00);
pub(super) const PURPLE: Color = Color(0xCC, 0x79, 0xA7);

/// The form of a mark; sizes in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
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
}

/// How a curve or a set of points looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Style {
    pub(super) color: Color,
    pub(super) opacity: f64,
    pub(super) shape: Shape,
}

impl Style {
    /// An opaque style.
    pub(super) fn new(color: Color, shape: Shape) -> Self {
        let opacity = 1.0;
        Self { color, opacity, shape }
    }

    /// The same, lighter.
    pub(super) fn faint(mut self, opacity: f64) -> Self {
        self.opacity = opacity;
        self
    }

    fn stroke(&self, width: f64) -> ShapeStyle {
        let Color(r, g, b) = self.color;
        ShapeStyle {
            color: RGBColor(r, g, b).mix(self.opacity),
            filled: false,
            stroke_width: units(width).unsigned_abs(),
        }
    }
}

/// Where a word stands with respect to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
    /// Centred, and turned to be read from the right.
    Upwards,
}

/// How a word looks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Word {
    pub(super) size: f64,
    pub(super) color: Color,
    pub(super) bold: bool,
    pub(super) anchor: Anchor,
}

/// A page being drawn.
pub(super) struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

/// Draws a page of `width` by `height` pixels and returns it as an SVG document; `name` is what a
/// screen reader says.
pub(super) fn page(
    (width, height): (f64, f64),
    name: &str,
    draw: impl FnOnce(&Canvas<'_>) -> Result<(), DrawError>,
) -> Result<String, DrawError> {
    let mut raw = String::new();
    {
        let size = (units(width).unsigned_abs(), units(height).unsigned_abs());
        let area = SVGBackend::with_string(&mut raw, size).into_drawing_area();
        let canvas = Canvas { area };
        draw(&canvas)?;
        canvas.area.present()?;
    }
    let body = raw.split_once('\n').map_or("", |(_, body)| body);
    // Full opacity is the default; leaving it out saves a tenth of the text.
    let body = body.replace(" opacity=\"1\"", "");
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\" stroke-linejoin=\"round\">\n{body}",
        units(width),
        units(height),
        text::escape(name)
    ))
}

impl Canvas<'_> {
    /// A line through the points, dashed if the style says so.
    pub(super) fn line(&self, points: &[Point], style: &Style) -> Result<(), DrawError> {
        match style.shape {
            Shape::Dashes(width) => {
                for dash in dashes(points, 6.0, 4.0) {
                    self.path(&dash, style.stroke(width))?;
                }
                Ok(())
            }
            Shape::Line(width)
            | Shape::Dots(width)
            | Shape::Rings(width)
            | Shape::Crosses(width) => self.path(points, style.stroke(width)),
        }
    }

    /// The style's mark at a point; of a line, a dot as wide as the line.
    pub(super) fn mark(&self, (x, y): Point, style: &Style) -> Result<(), DrawError> {
        let circle = |radius: f64, stroke| Circle::new(at((x, y)), units(radius), stroke);
        match style.shape {
            Shape::Line(width) | Shape::Dashes(width) => {
                self.area.draw(&circle(width, style.stroke(1.0).filled()))
            }
            Shape::Dots(radius) => self.area.draw(&circle(radius, style.stroke(1.0).filled())),
            Shape::Rings(radius) => self.area.draw(&circle(radius, style.stroke(1.6))),
            Shape::Crosses(r) => {
                self.path(&[(x - r, y - r), (x + r, y + r)], style.stroke(1.8))?;
                self.path(&[(x - r, y + r), (x + r, y - r)], style.stroke(1.8))
            }
        }
    }

    /// A word whose middle line runs through the point.
    pub(super) fn word(&self, text: &str, (x, y): Point, word: &Word) -> Result<(), DrawError> {
        let (horizontal, transform) = match word.anchor {
            Anchor::Start => (HPos::Left, FontTransform::None),
            Anchor::Middle => (HPos::Center, FontTransform::None),
            Anchor::End => (HPos::Right, FontTransform::None),
            Anchor::Upwards => (HPos::Center, FontTransform::Rotate270),
        };
        let weight = match word.bold {
            true => FontStyle::Bold,
            false => FontStyle::Normal,
        };
        let Color(r, g, b) = word.color;
        let color = RGBColor(r, g, b);
        // The backend divides sizes by 1.24, and centres by the letters' x-height: a tenth of the
        // size brings digits and capitals to the middle.
        let size = word.size * f64::from(UNITS) * 1.24;
        let style = TextStyle::from((FONT, size, weight))
            .color(&color)
            .transform(transform)
            .pos(Pos::new(horizontal, VPos::Center));
        let nudge = 0.1 * word.size;
        let place = match word.anchor {
            Anchor::Upwards => at((x + nudge, y)),
            Anchor::Start | Anchor::Middle | Anchor::End => at((x, y + nudge)),
        };
        self.area.draw(&Text::new(text, place, style))
    }

    fn path(&self, points: &[Point], style: ShapeStyle) -> Result<(), DrawError> {
        let points: Vec<_> = points.iter().map(|p| at(*p)).collect();
        self.area.draw(&PathElement::new(points, style))
    }
}

/// About how wide a text is; generous, so that what stands beside it keeps clear.
pub(super) fn width_of(text: &str, size: f64) -> f64 {
    let ems = text.chars().map(|c| match c {
        'i' | 'j' | 'l' | '|' | '.' | ',' | '\'' | ':' | ' ' | '\u{2009}' => 0.32,
        'm' | 'w' | 'M' | 'W' | '@' => 0.9,
        c if c.is_uppercase() => 0.7,
        _ => 0.58,
    });
    size * ems.sum::<f64>()
}

/// Cuts a line into dashes of `on` pixels with spaces of `off`, measured along the line.
fn dashes(points: &[Point], on: f64, off: f64) -> Vec<Vec<Point>> {
    let mut dashes = Vec::new();
    let mut dash: Vec<Point> = points.first().copied().into_iter().collect();
    let (mut inked, mut left) = (true, on);
    for pair in points.windows(2) {
        let (mut a, b) = (pair[0], pair[1]);
        let mut rest = (b.0 - a.0).hypot(b.1 - a.1);
        while rest > left {
            let s = left / rest;
            a = (a.0 + s * (b.0 - a.0), a.1 + s * (b.1 - a.1));
            rest -= left;
            if inked {
                dash.push(a);
                dashes.push(std::mem::take(&mut dash));
            } else {
                dash = vec![a];
            }
            inked = !inked;
            left = if inked { on } else { off };
        }
        left -= rest;
        if inked {
            dash.push(b);
        }
    }
    if dash.len() > 1 {
        dashes.push(dash);
    }
    dashes
}

fn at((x, y): Point) -> (i32, i32) {
    (units(x), units(y))
}

/// Pixels in drawing units.
#[expect(clippy::cast_possible_truncation, reason = "a cast of a number out of range saturates")]
fn units(pixels: f64) -> i32 {
    (pixels * f64::from(UNITS)).round() as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_cover_three_fifths_of_a_line_around_its_corners() {
        let corner = [(0.0, 0.0), (50.0, 0.0), (50.0, 50.0)];
        let dashes = dashes(&corner, 6.0, 4.0);
        let length = |d: &Vec<Point>| {
            let steps = d.windows(2);
            steps.map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).sum::<f64>()
        };
        assert_eq!(dashes.len(), 10);
        // Rounding: a hundred additions of numbers up to 100.
        let total: f64 = dashes.iter().map(length).sum();
        assert!((total - 60.0).abs() < 1e-10, "{total} pixels of ink");
        assert!(super::dashes(&[], 6.0, 4.0).is_empty());
    }

    #[test]
    fn a_page_is_one_svg_element_that_scales() {
        let style = Style::new(BLACK, Shape::Line(1.5));
        let line = [(0.0, 0.0), (99.9, 49.9)];
        let svg = page((100.0, 50.0), "a <b>", |c| c.line(&line, &style)).unwrap();
        assert!(svg.starts_with("<svg "));
        assert!(svg.trim_end().ends_with("</svg>"));
        assert!(svg.contains("viewBox=\"0 0 1000 500\""));
        assert!(svg.contains("aria-label=\"a &lt;b&gt;\""));
        assert!(svg.contains("0,0 999,499"), "{svg}");
        assert!(svg.contains("stroke-width=\"15\""));
    }
}
