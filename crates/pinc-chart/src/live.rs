//! Figures as data for a page that draws them anew wherever a reader zooms.

use crate::curve::{Point, held, simplified_to};
use crate::figure::{Axis, Event, Figure, Label, Panel, Series, Span};
use crate::layout::{Shown, shown};
use crate::scale::{Kind, Scale};
use crate::svg::{Shape, Style};
use serde_json::{Value, json};

/// A figure whose curves can be drawn anew for any part of its axes.
#[derive(Debug)]
pub struct Live<'a> {
    figure: &'a Figure,
    panels: Vec<LivePanel<'a>>,
}

#[derive(Debug)]
struct LivePanel<'a> {
    shown: Shown<'a>,
    curves: Vec<Curve<'a>>,
    /// Lines that do not run from left to right.
    paths: Vec<&'a Series>,
}

/// A series by its columns.
#[derive(Debug)]
struct Curve<'a> {
    series: &'a Series,
    /// 1 if a value holds until the next point, -1 if it has held since the previous one.
    held: i8,
    points: Vec<Point>,
}

impl Figure {
    /// The figure for a page that zooms; `None` if it has nothing to zoom into: bars, maps, names
    /// on axes, or nothing at all.
    pub fn live(&self) -> Option<Live<'_>> {
        let plain = |shown: &Shown<'_>| {
            shown.panel.areas.is_empty() && !shown.x.named && !shown.panel.y.named
        };
        let panels = shown(self);
        let any = panels.iter().any(|shown| shown.scales.is_some());
        (any && panels.iter().all(plain))
            .then(|| Live { figure: self, panels: panels.into_iter().map(LivePanel::of).collect() })
    }
}

impl Live<'_> {
    /// How many points each of its curves has.
    pub fn lengths(&self) -> impl Iterator<Item = usize> {
        self.panels.iter().flat_map(|panel| &panel.curves).map(|curve| curve.points.len())
    }

    /// The figure as JSON, with at most about `most` points a curve: of more, those stay where the
    /// curve is at its highest or lowest. A column of numbers is the Base64 of 32-bit floats,
    /// little end first; NaN is a gap. Columns of horizontal places are written once.
    pub fn json(&self, most: usize) -> String {
        let mut columns = Vec::new();
        let panels: Vec<Value> =
            self.panels.iter().map(|panel| panel.json(most, &mut columns)).collect();
        let events: Vec<Value> = self.figure.events.iter().map(event).collect();
        json!({
            "name": self.figure.name, "columns": self.figure.columns, "events": events,
            "panels": panels, "xs": columns,
        })
        .to_string()
    }
}

impl<'a> LivePanel<'a> {
    fn of(shown: Shown<'a>) -> Self {
        let (mut curves, mut paths) = (Vec::new(), Vec::new());
        for series in shown.scales.iter().flat_map(|_| &shown.panel.series) {
            if series.style.shape.is_line() && !series.points.is_sorted_by(|a, b| a.0 <= b.0) {
                paths.push(series);
            } else {
                curves.extend(Curve::of(series, &shown));
            }
        }
        Self { shown, curves, paths }
    }

    fn json(&self, most: usize, columns: &mut Vec<String>) -> Value {
        let Panel { title, height, note, labels, keys, limits, uprights, spans, .. } =
            self.shown.panel;
        let mut series = Vec::new();
        for curve in &self.curves {
            let (x, y) = curve.columns(most, &self.shown);
            let x = base64(&x);
            let place = columns.iter().position(|known| *known == x).unwrap_or(columns.len());
            if place == columns.len() {
                columns.push(x);
            }
            let mut one = look(&curve.series.style);
            one["name"] = json!(curve.series.name);
            (one["x"], one["y"]) = (json!(place), json!(base64(&y)));
            one["held"] = json!(curve.held);
            series.push(one);
        }
        let scales = self.shown.scales.as_ref();
        let rank = |i: &usize| {
            let name = &self.curves[*i].series.name;
            keys.iter().position(|key| key.label == *name).unwrap_or(keys.len())
        };
        let mut legend: Vec<usize> = (0..self.curves.len()).collect();
        legend.sort_by_key(rank);
        json!({
            "title": title,
            "height": height,
            "note": note,
            // Panels with the figure's horizontal axis are zoomed together.
            "together": self.shown.panel.x.is_none(),
            "x": axis(self.shown.x, scales.map(|scales| &scales.x)),
            "y": axis(&self.shown.panel.y, scales.map(|scales| &scales.y)),
            "series": series,
            // The curves as the legend names them, which is not the order in which they are drawn.
            "legend": legend,
            "paths": self.paths.iter().map(|series| path(series)).collect::<Vec<_>>(),
            "spans": spans.iter().map(span).collect::<Vec<_>>(),
            "labels": labels.iter().map(label).collect::<Vec<_>>(),
            "limits": limits,
            "uprights": uprights,
        })
    }
}

impl<'a> Curve<'a> {
    /// The points of a series inside the horizontal axis and the next ones outside; `None` without
    /// any.
    fn of(series: &'a Series, shown: &Shown<'_>) -> Option<Self> {
        let (from, to) = shown.scales.as_ref()?.x.range();
        let positive = shown.x.kind != Kind::Log;
        let has_place = |p: &&Point| p.0.is_finite() && (positive || p.0 > 0.0);
        let mut points: Vec<Point> = series.points.iter().filter(has_place).copied().collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let first = points.partition_point(|p| p.0 < from).saturating_sub(1);
        let last = (points.partition_point(|p| p.0 <= to) + 1).min(points.len());
        let points = points.get(first..last)?;
        let (held, points) = match series.style.shape.is_line() {
            true => held(points),
            false => (0, points.to_vec()),
        };
        (!points.is_empty()).then_some(Self { series, held, points })
    }

    /// Places, which rise, and values, which are NaN where there are none.
    fn columns(&self, most: usize, shown: &Shown<'_>) -> (Vec<f32>, Vec<f32>) {
        let positive = shown.panel.y.kind == Kind::Log;
        let (mut xs, mut ys): (Vec<f32>, Vec<f32>) = (Vec::new(), Vec::new());
        for (x, y) in simplified_to(&self.points, most) {
            // Two points at one place stand side by side.
            let least = xs.last().map_or(f32::MIN, |last| last.next_up());
            xs.push(single(x).max(least));
            let y = single(y);
            ys.push(if y.is_finite() && (!positive || y > 0.0) { y } else { f32::NAN });
        }
        (xs, ys)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "seven digits are more than a reader sees")]
fn single(value: f64) -> f32 {
    value as f32
}

fn look(style: &Style) -> Value {
    let (shape, size) = match style.shape {
        Shape::Line(width) => ("line", width),
        Shape::Dashes(width) => ("dashes", width),
        Shape::Dots(radius) => ("dots", radius),
        Shape::Rings(radius) => ("rings", radius),
        Shape::Crosses(half) => ("crosses", half),
        Shape::Squares(half) => ("squares", half),
        Shape::Triangles(radius) => ("triangles", radius),
        Shape::Diamonds(radius) => ("diamonds", radius),
    };
    json!({ "color": style.color.hex(), "opacity": style.opacity, "shape": shape, "size": size })
}

fn axis(axis: &Axis, scale: Option<&Scale>) -> Value {
    json!({
        "label": axis.label, "log": axis.kind == Kind::Log, "count": axis.kind == Kind::Count,
        "range": scale.map(Scale::range), "marks": axis.marks, "silent": axis.silent,
    })
}

fn path(series: &Series) -> Value {
    let mut path = look(&series.style);
    (path["name"], path["points"]) = (json!(series.name), json!(series.points));
    path
}

fn event(event: &Event) -> Value {
    let mut line = look(&event.style);
    (line["x"], line["label"]) = (json!(event.x), json!(event.label));
    line
}

fn span(span: &Span) -> Value {
    json!({ "x": span.x, "y": span.y, "color": span.color.hex() })
}

fn label(label: &Label) -> Value {
    json!({ "at": label.at, "text": label.text, "color": label.color.hex() })
}

/// The Base64 of numbers, little end first (RFC 4648, section 4).
fn base64(numbers: &[f32]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    let mut text = String::with_capacity(4 * bytes.len().div_ceil(3));
    for three in bytes.chunks(3) {
        let byte = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= three.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::BLUE;
    use crate::curve::held_until_next;
    use crate::figure::Area;
    use crate::svg::Fill;

    fn line() -> Style {
        Style::new(BLUE, Shape::Line(1.5))
    }

    fn figure(kind: Kind, points: Vec<Point>) -> Figure {
        let mut panel = Panel::new("P", Axis::new("y", kind), 100.0);
        panel.add("curve", points, line());
        Figure::stack("f", Axis::ranged("x", Kind::Linear, (0.0, 10.0)), vec![panel])
    }

    fn parsed(figure: &Figure, most: usize) -> Value {
        serde_json::from_str(&figure.live().unwrap().json(most)).unwrap()
    }

    /// The numbers of a column; what a browser does.
    fn numbers(text: &Value) -> Vec<f32> {
        let digit = |c: u8| match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            _ => 63,
        };
        let (mut bytes, mut bits, mut held) = (Vec::new(), 0_u32, 0);
        for c in text.as_str().unwrap().bytes().filter(|c| *c != b'=') {
            (bits, held) = (bits << 6 | u32::from(digit(c)), held + 6);
            if held >= 8 {
                held -= 8;
                bytes.push(u8::try_from(bits >> held & 255).unwrap());
            }
        }
        bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
    }

    #[test]
    fn base64_matches_the_standard() {
        // 1.0 is 00 00 80 3f; 0.0 is 00 00 00 00.
        assert_eq!(base64(&[1.0]), "AACAPw==");
        assert_eq!(base64(&[1.0, 0.0]), "AACAPwAAAAA=");
        assert_eq!(base64(&[1.0, 0.0, 1.0]), "AACAPwAAAAAAAIA/");
        assert_eq!(numbers(&json!(base64(&[1.5, -2.25e-7]))), [1.5, -2.25e-7]);
    }

    #[test]
    fn curves_are_columns_and_what_has_no_place_is_a_gap() {
        let points = vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, -1.0), (2.0, 1e300), (3.0, 4.0)];
        let json = parsed(&figure(Kind::Log, points), 100);
        let x = numbers(&json["xs"][0]);
        assert!(x.is_sorted_by(|a, b| a < b), "{x:?}");
        assert_eq!(x.len(), 5);
        let y = numbers(&json["panels"][0]["series"][0]["y"]);
        let shown: Vec<Option<f32>> = y.iter().map(|v| Some(*v).filter(|v| !v.is_nan())).collect();
        assert_eq!(shown, [Some(1.0), None, None, None, Some(4.0)]);
        assert_eq!(json["panels"][0]["y"]["log"], true);
        assert_eq!(json["panels"][0]["x"]["range"], json!([0.0, 10.0]));
    }

    #[test]
    fn columns_that_are_the_same_are_written_once_and_steps_have_no_corners() {
        let values = vec![(0.0, 1.0), (1.0, 2.0), (2.0, 2.0), (3.0, 5.0)];
        let mut figure = figure(Kind::Linear, values.clone());
        figure.panels[0].add("steps", held_until_next(&values), line());
        let json = parsed(&figure, 100);
        let series = &json["panels"][0]["series"];
        assert_eq!((&series[0]["held"], &series[1]["held"]), (&json!(0), &json!(1)));
        // The value at 2 is that at 1, and left out.
        assert_eq!(numbers(&json["xs"][1]), [0.0, 1.0, 3.0]);
        figure.panels[0].add("again", values, line());
        assert_eq!(parsed(&figure, 100)["xs"].as_array().unwrap().len(), 2);
    }

    #[test]
    fn the_legend_begins_with_the_curves_that_have_keys() {
        let rises = || vec![(0.0, 1.0), (1.0, 2.0)];
        let mut figure = figure(Kind::Linear, rises());
        let panel = &mut figure.panels[0];
        panel.add_named("b", rises(), line());
        panel.add_beneath("others", "beneath b", rises(), line());
        // Drawn: beneath b, curve, b.
        assert_eq!(parsed(&figure, 100)["panels"][0]["legend"], json!([2, 0, 1]));
    }

    #[test]
    fn long_curves_are_thinned_and_keep_their_extremes() {
        let mut points: Vec<Point> =
            (0..100_000).map(|i| 1e-4 * f64::from(i)).map(|x| (x, x.sin())).collect();
        points[54_321].1 = 9.0;
        points[54_322].1 = f64::NAN;
        let json = parsed(&figure(Kind::Linear, points), 1000);
        let y = numbers(&json["panels"][0]["series"][0]["y"]);
        assert!(y.len() <= 1001 && y.len() > 490, "{}", y.len());
        assert!(y.contains(&9.0) && y.iter().any(|v| v.is_nan()));
        assert_eq!(numbers(&json["xs"][0]).len(), y.len());
    }

    #[test]
    fn a_line_that_turns_back_is_a_path_and_bars_are_not_zoomed() {
        let mut turning = figure(Kind::Linear, vec![(1.0, 1.0), (3.0, 2.0), (2.0, 3.0)]);
        let json = parsed(&turning, 100);
        assert_eq!(json["panels"][0]["paths"][0]["points"][2], json!([2.0, 3.0]));
        assert!(json["panels"][0]["series"].as_array().unwrap().is_empty());
        turning.panels[0].areas.push(Area {
            name: String::new(),
            x: (0.0, 1.0),
            y: (0.0, 1.0),
            fill: Fill::solid(BLUE),
            value: None,
            text: String::new(),
        });
        assert!(turning.live().is_none());
        assert!(figure(Kind::Linear, Vec::new()).live().is_none());
    }
}
