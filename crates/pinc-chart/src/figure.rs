//! The content of a picture: panels in a grid, each with marks over two axes. Plain data, in the
//! units of the shown quantities.

use crate::color::{BLACK, Color, GREY};
use crate::curve::Point;
use crate::scale::{Kind, Scale};
use crate::svg::{Fill, Shape, Style};

/// A picture.
#[derive(Clone, Debug)]
pub struct Figure {
    /// The name for screen readers.
    pub name: String,
    /// The horizontal axis of the panels that have none of their own.
    pub x: Axis,
    /// The legend of the whole picture, above it.
    pub keys: Vec<Key>,
    /// Moments marked through all panels of the first column.
    pub events: Vec<Event>,
    /// The columns, by their relative widths.
    pub columns: Vec<f64>,
    /// The panels, row by row.
    pub panels: Vec<Panel>,
}

impl Figure {
    /// Panels above one another over a common horizontal axis.
    pub fn stack(name: &str, x: Axis, panels: Vec<Panel>) -> Self {
        Self::grid(name, x, vec![1.0], panels)
    }

    /// Panels in rows and columns.
    pub fn grid(name: &str, x: Axis, columns: Vec<f64>, panels: Vec<Panel>) -> Self {
        let (keys, events) = (Vec::new(), Vec::new());
        Self { name: name.to_owned(), x, keys, events, columns, panels }
    }
}

/// An axis: what it is and how it is divided.
#[derive(Clone, Debug)]
pub struct Axis {
    /// The quantity, with its unit in brackets.
    pub label: String,
    /// How it is divided.
    pub kind: Kind,
    /// The ends; without them the axis reaches around what is shown.
    pub range: Option<(f64, f64)>,
    /// Ticks at these places instead of round ones.
    pub marks: Vec<(f64, String)>,
    /// Whether the marks are names of things rather than numbers: then there is no grid.
    pub named: bool,
    /// Whether label and numbers are left out, since a neighbour has the same axis.
    pub silent: bool,
}

impl Axis {
    /// An axis around what is shown.
    pub fn new(label: &str, kind: Kind) -> Self {
        let label = label.to_owned();
        Self { label, kind, range: None, marks: Vec::new(), named: false, silent: false }
    }

    /// An axis from one end to the other.
    pub fn ranged(label: &str, kind: Kind, range: (f64, f64)) -> Self {
        Self { range: Some(range), ..Self::new(label, kind) }
    }

    /// An axis with the names of things at 0, 1, 2 and so on.
    pub fn named(label: &str, names: &[String]) -> Self {
        let end = 0.5 + extent(places(names.len()).into_iter()).1;
        let marks = places(names.len()).into_iter().zip(names.iter().cloned()).collect();
        Self { marks, named: true, ..Self::ranged(label, Kind::Linear, (-0.5, end)) }
    }

    /// The name of the thing that lies between two places of an axis with names.
    pub(crate) fn name_between(&self, from: f64, to: f64) -> Option<&str> {
        let mark = self.marks.iter().find(|m| self.named && from <= m.0 && m.0 <= to)?;
        Some(&mark.1)
    }

    /// The scale of the axis, for what is shown; `None` if nothing has a place on it.
    pub(crate) fn scale(&self, values: impl Iterator<Item = f64>) -> Option<Scale> {
        match self.range {
            Some((low, high)) => Scale::exact(self.kind, low, high),
            None => Scale::around(self.kind, values),
        }
    }
}

/// 0, 1, 2 and so on, as numbers of an axis.
pub fn places(count: usize) -> Vec<f64> {
    (0..u32::try_from(count).unwrap_or(u32::MAX)).map(f64::from).collect()
}

/// A vertical line with a text at its top.
#[derive(Clone, Debug)]
pub struct Event {
    /// Its place, in the unit of the horizontal axis.
    pub x: f64,
    /// The text at its top.
    pub label: String,
    /// How the line is drawn.
    pub style: Style,
}

impl Event {
    /// A beginning.
    pub fn major(x: f64, label: String) -> Self {
        let style = Style::new(BLACK, Shape::Line(1.0)).faint(0.55);
        Self { x, label, style }
    }

    /// A lesser change.
    pub fn minor(x: f64, label: String) -> Self {
        let style = Style::new(GREY, Shape::Dashes(1.0));
        Self { x, label, style }
    }
}

/// A panel with a vertical axis of its own.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The text above it.
    pub title: String,
    /// The horizontal axis, if it is not the figure's.
    pub x: Option<Axis>,
    /// The vertical axis.
    pub y: Axis,
    /// Its height in pixels, without title and legend.
    pub height: f64,
    /// Rectangles, at the very bottom.
    pub areas: Vec<Area>,
    /// Curves and marks, from the bottom up.
    pub series: Vec<Series>,
    /// Vertical intervals.
    pub spans: Vec<Span>,
    /// Texts beside points.
    pub labels: Vec<Label>,
    /// The legend.
    pub keys: Vec<Key>,
    /// Levels drawn as thin lines from side to side, in the unit of the vertical axis.
    pub limits: Vec<f64>,
    /// Places marked from top to bottom, in the unit of the horizontal axis.
    pub uprights: Vec<f64>,
    /// Said in the panel's place if it has nothing to show; without it the panel is left out.
    pub note: Option<String>,
}

/// A curve or a set of marks, in data units. Points that are not finite are gaps. Without a name it
/// shows again what another series shows, and is not exported.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the exported table.
    pub name: String,
    /// The points, from left to right for a curve.
    pub points: Vec<Point>,
    /// How they are drawn.
    pub style: Style,
}

/// A rectangle, in data units: a bar, a cell, a band. An end without a place on its axis, as 0 on
/// a logarithmic one, lies at the panel's side.
#[derive(Clone, Debug)]
pub struct Area {
    /// Its name in the exported table.
    pub name: String,
    /// Its left and right ends.
    pub x: (f64, f64),
    /// Its lower and upper ends.
    pub y: (f64, f64),
    /// How it is filled.
    pub fill: Fill,
    /// The number that the color or the text stands for.
    pub value: Option<f64>,
    /// The text in its middle: a line, and perhaps a smaller one below.
    pub text: String,
}

/// A vertical interval at a place, as of a spread.
#[derive(Clone, Debug)]
pub struct Span {
    /// Its name in the exported table.
    pub name: String,
    /// Its place, in data units.
    pub x: f64,
    /// Its lower and upper ends, in data units.
    pub y: (f64, f64),
    /// Its color.
    pub color: Color,
}

/// A text beside a point, where there is room.
#[derive(Clone, Debug)]
pub struct Label {
    /// The point, in data units.
    pub at: Point,
    /// The text.
    pub text: String,
    /// Its color.
    pub color: Color,
}

/// A line of a legend.
#[derive(Clone, Debug)]
pub struct Key {
    /// The text.
    pub label: String,
    /// The mark in front of it.
    pub look: Look,
}

/// The mark of an entry in a legend.
#[derive(Clone, Copy, Debug)]
pub enum Look {
    /// A piece of a curve, or a mark.
    Curve(Style),
    /// A filled rectangle.
    Area(Fill),
}

/// The look of [`Panel::limits`].
pub(crate) fn limit_style() -> Style {
    Style::new(GREY, Shape::Line(1.0))
}

impl Panel {
    /// An empty panel of `height` pixels.
    pub fn new(title: &str, y: Axis, height: f64) -> Self {
        Self {
            title: title.to_owned(),
            x: None,
            y,
            height,
            areas: Vec::new(),
            series: Vec::new(),
            spans: Vec::new(),
            labels: Vec::new(),
            keys: Vec::new(),
            limits: Vec::new(),
            uprights: Vec::new(),
            note: None,
        }
    }

    /// Adds a series above those that are there, without a line in the legend.
    pub fn add(&mut self, name: &str, points: Vec<Point>, style: Style) {
        self.series.push(Series { name: name.to_owned(), points, style });
    }

    /// Adds a series with a line in the legend, unless none of its points can be shown.
    pub fn add_named(&mut self, name: &str, points: Vec<Point>, style: Style) {
        if self.shows_any(&points) {
            self.key(name, Look::Curve(style));
            self.add(name, points, style);
        }
    }

    /// Like [`Panel::add_named`], but beneath the series that are there, and with a text of its own
    /// in the legend.
    pub fn add_beneath(&mut self, key: &str, name: &str, points: Vec<Point>, style: Style) {
        if self.shows_any(&points) {
            self.key(key, Look::Curve(style));
            self.series.insert(0, Series { name: name.to_owned(), points, style });
        }
    }

    /// Writes a curve's name beside its end, so that it can be told apart without colors.
    pub fn tag(&mut self, text: &str, points: &[Point], color: Color) {
        let end = points.iter().rfind(|p| p.0.is_finite() && p.1.is_finite());
        self.labels.extend(end.map(|at| Label { at: *at, text: text.to_owned(), color }));
    }

    /// Adds a line to the legend, once.
    pub fn key(&mut self, label: &str, look: Look) {
        if self.keys.iter().all(|key| key.label != label) {
            let label = label.to_owned();
            self.keys.push(Key { label, look });
        }
    }

    /// Adds limits and their line in the legend, leaving out those that lie so far away that the
    /// curves would be squeezed.
    pub fn add_limits(&mut self, label: &str, limits: &[f64]) {
        let near: Vec<f64> = limits.iter().copied().filter(|v| self.is_near(*v)).collect();
        for limit in near {
            if !self.limits.iter().any(|v| v.total_cmp(&limit).is_eq()) {
                self.limits.push(limit);
            }
            self.key(label, Look::Curve(limit_style()));
        }
    }

    /// Adds a limit that changes, beneath the series that are there. Where it lies so far away that
    /// the curves would be squeezed, it has a gap.
    pub fn add_changing_limit(&mut self, label: &str, name: &str, mut points: Vec<Point>) {
        let seen = |p: &Point| if self.is_near(p.1) { p.1 } else { f64::NAN };
        let seen: Vec<f64> = points.iter().map(seen).collect();
        points.iter_mut().zip(seen).for_each(|(point, y)| point.1 = y);
        self.add_beneath(label, name, points, limit_style());
    }

    /// Whether a height lies within reach of the curves.
    fn is_near(&self, height: f64) -> bool {
        let everywhere = (f64::NEG_INFINITY, f64::INFINITY);
        let curves = Scale::around(self.y.kind, self.heights(everywhere));
        let fraction = curves.and_then(|curves| curves.fraction(height));
        fraction.is_some_and(|f| (-1.5..=2.5).contains(&f))
    }

    /// The vertical axis for what lies between two horizontal positions; `None` if nothing does.
    pub(crate) fn y_scale(&self, x: (f64, f64)) -> Option<Scale> {
        Scale::around(self.y.kind, self.heights(x))?;
        self.y.scale(self.heights(x).chain(self.limits.iter().copied()))
    }

    /// The horizontal positions of all that is shown.
    pub(crate) fn positions(&self) -> impl Iterator<Item = f64> {
        let points = self.series.iter().flat_map(|s| &s.points).map(|p| p.0);
        let areas = self.areas.iter().flat_map(|a| [a.x.0, a.x.1]);
        points.chain(areas).chain(self.spans.iter().map(|s| s.x))
    }

    /// The heights of all that is shown between two horizontal positions.
    fn heights(&self, (from, to): (f64, f64)) -> impl Iterator<Item = f64> {
        let inside = move |x: f64| (from..=to).contains(&x);
        let points = self.series.iter().flat_map(|s| &s.points);
        let points = points.filter(move |p| inside(p.0)).map(|p| p.1);
        let areas = self.areas.iter().filter(move |a| inside(a.x.0) || inside(a.x.1));
        let areas = areas.flat_map(|a| [a.y.0, a.y.1]);
        let spans = self.spans.iter().filter(move |s| inside(s.x)).flat_map(|s| [s.y.0, s.y.1]);
        points.chain(areas).chain(spans)
    }

    fn shows_any(&self, points: &[Point]) -> bool {
        Scale::around(self.y.kind, points.iter().map(|p| p.1)).is_some()
    }
}

/// The range of the finite numbers, or (0, 1) without any.
pub fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}
