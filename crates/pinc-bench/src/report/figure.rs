//! What a picture shows: panels above one another over a common horizontal axis.

use super::canvas::{BLACK, GREY, Shape, Style};
use super::curve::Point;
use super::scale::{Kind, Scale};

/// A picture.
#[derive(Clone, Debug)]
pub(super) struct Figure {
    /// What a screen reader says.
    pub(super) name: String,
    /// The horizontal axis: what it is, and its range.
    pub(super) x_label: String,
    pub(super) x: (f64, f64),
    /// Moments marked through all panels.
    pub(super) events: Vec<Event>,
    pub(super) panels: Vec<Panel>,
}

/// A vertical line with a word at its top.
#[derive(Clone, Debug)]
pub(super) struct Event {
    pub(super) x: f64,
    pub(super) label: String,
    pub(super) style: Style,
}

impl Event {
    /// A beginning.
    pub(super) fn major(x: f64, label: String) -> Self {
        let style = Style::new(BLACK, Shape::Line(1.0)).faint(0.55);
        Self { x, label, style }
    }

    /// A lesser change.
    pub(super) fn minor(x: f64, label: String) -> Self {
        let style = Style::new(GREY, Shape::Dashes(1.0));
        Self { x, label, style }
    }
}

/// A panel with a vertical axis of its own.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) title: String,
    pub(super) y_label: String,
    pub(super) kind: Kind,
    pub(super) height: f64,
    pub(super) series: Vec<Series>,
    pub(super) keys: Vec<Key>,
    /// Levels drawn as thin lines from side to side.
    pub(super) limits: Vec<f64>,
}

/// A curve or a set of marks, in data units. Points that are not finite are gaps.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) points: Vec<Point>,
    pub(super) style: Style,
}

/// A line of a panel's legend.
#[derive(Clone, Debug)]
pub(super) struct Key {
    pub(super) label: String,
    pub(super) style: Style,
}

/// The look of [`Panel::limits`].
pub(super) fn limit_style() -> Style {
    Style::new(GREY, Shape::Line(1.0))
}

impl Panel {
    /// An empty panel of `height` pixels.
    pub(super) fn new(title: &str, y_label: &str, kind: Kind, height: f64) -> Self {
        Self {
            title: title.to_owned(),
            y_label: y_label.to_owned(),
            kind,
            height,
            series: Vec::new(),
            keys: Vec::new(),
            limits: Vec::new(),
        }
    }

    /// Adds a series above those that are there.
    pub(super) fn add(&mut self, points: Vec<Point>, style: Style) {
        self.series.push(Series { points, style });
    }

    /// Adds a series with a line in the legend, unless none of its points can be shown.
    pub(super) fn add_named(&mut self, label: &str, points: Vec<Point>, style: Style) {
        if self.shows_any(&points) {
            self.key(label, style);
            self.add(points, style);
        }
    }

    /// Like [`Panel::add_named`], but beneath the series that are there.
    pub(super) fn add_named_beneath(&mut self, label: &str, points: Vec<Point>, style: Style) {
        if self.shows_any(&points) {
            self.key(label, style);
            self.series.insert(0, Series { points, style });
        }
    }

    /// Adds a line to the legend, once.
    pub(super) fn key(&mut self, label: &str, style: Style) {
        if self.keys.iter().all(|key| key.label != label) {
            let label = label.to_owned();
            self.keys.push(Key { label, style });
        }
    }

    /// Adds limits and their line in the legend, leaving out those that lie so far away that the
    /// curves would be squeezed.
    pub(super) fn add_limits(&mut self, label: &str, limits: &[f64]) {
        let Some(curves) = self.range_of_curves((f64::NEG_INFINITY, f64::INFINITY)) else {
            return;
        };
        let near = |v: &f64| curves.fraction(*v).is_some_and(|f| (-1.5..=2.5).contains(&f));
        for &limit in limits.iter().filter(|v| near(v)) {
            if !self.limits.iter().any(|v| v.total_cmp(&limit).is_eq()) {
                self.limits.push(limit);
            }
            self.key(label, limit_style());
        }
    }

    /// The vertical axis for what lies between two horizontal positions; `None` if nothing does.
    pub(super) fn scale(&self, x: (f64, f64)) -> Option<Scale> {
        self.range_of_curves(x)?;
        let curves = self.values(x);
        Scale::around(self.kind, curves.chain(self.limits.iter().copied()))
    }

    fn range_of_curves(&self, x: (f64, f64)) -> Option<Scale> {
        Scale::around(self.kind, self.values(x))
    }

    fn values(&self, (from, to): (f64, f64)) -> impl Iterator<Item = f64> {
        let points = self.series.iter().flat_map(|s| &s.points);
        let inside = points.filter(move |p| (from..=to).contains(&p.0));
        inside.map(|p| p.1)
    }

    fn shows_any(&self, points: &[Point]) -> bool {
        Scale::around(self.kind, points.iter().map(|p| p.1)).is_some()
    }
}

/// The range of the finite numbers, or (0, 1) without any.
pub(super) fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let finite = values.filter(|v| v.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}
