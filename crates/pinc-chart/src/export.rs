//! The data of a figure as CSV, one row per point, area or span.

use crate::figure::{Axis, Figure, Panel};

/// The columns: a point has `x` and `y`, an area all four ends and perhaps a value, a span `x`,
/// `y` and `y_to`. On an axis with names `x` or `y` is the name.
const HEADER: [&str; 7] = ["panel", "series", "x", "x_to", "y", "y_to", "value"];

impl Figure {
    /// The data that the figure shows, in full, as CSV with the columns `panel`, `series`, `x`,
    /// `x_to`, `y`, `y_to`, `value`.
    pub fn csv(&self) -> Vec<u8> {
        let mut rows = Rows { writer: csv::Writer::from_writer(Vec::new()) };
        rows.add(&HEADER.map(str::to_owned));
        for panel in &self.panels {
            rows.add_panel(panel, panel.x.as_ref().unwrap_or(&self.x));
        }
        rows.writer.into_inner().unwrap_or_default()
    }
}

struct Rows {
    writer: csv::Writer<Vec<u8>>,
}

impl Rows {
    fn add_panel(&mut self, panel: &Panel, x: &Axis) {
        let start = |series: &str| [panel.title.clone(), series.to_owned()];
        let inside = |at: f64| x.range.is_none_or(|(low, high)| (low..=high).contains(&at));
        for series in panel.series.iter().filter(|s| !s.name.is_empty()) {
            let seen = series.points.iter().filter(|p| p.1.is_finite() && inside(p.0));
            for &(at, height) in seen {
                let [x, y] = [one(x, at), one(&panel.y, height)];
                let [title, name] = start(&series.name);
                self.add(&[title, name, x, String::new(), y, String::new(), String::new()]);
            }
        }
        for area in &panel.areas {
            let (x, x_to) = both(x, area.x);
            let (y, y_to) = both(&panel.y, area.y);
            let [title, name] = start(&area.name);
            let value = area.value.map_or(String::new(), cell);
            self.add(&[title, name, x, x_to, y, y_to, value]);
        }
        for span in &panel.spans {
            let [title, name] = start(&span.name);
            let (y, y_to) = both(&panel.y, span.y);
            self.add(&[title, name, one(x, span.x), String::new(), y, y_to, String::new()]);
        }
    }

    fn add(&mut self, row: &[String; 7]) {
        // Writing to memory cannot fail.
        let _ = self.writer.write_record(row);
    }
}

fn one(axis: &Axis, at: f64) -> String {
    axis.name_between(at, at).map_or_else(|| cell(at), str::to_owned)
}

fn both(axis: &Axis, (from, to): (f64, f64)) -> (String, String) {
    match axis.name_between(from, to) {
        Some(name) => (name.to_owned(), String::new()),
        None => (cell(from), cell(to)),
    }
}

/// A cell with a number; empty if it is none.
fn cell(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::BLUE;
    use crate::figure::{Area, Span};
    use crate::scale::Kind;
    use crate::svg::{Fill, Shape, Style};

    #[test]
    fn all_that_is_shown_is_written() {
        let names = ["a, b".to_owned(), "c".to_owned()];
        let mut panel = Panel::new("P", Axis::new("y", Kind::Linear), 100.0);
        let points = vec![(0.0, 0.1), (0.5, f64::NAN), (1.0, 2.0)];
        panel.add("curve", points, Style::new(BLUE, Shape::Line(1.0)));
        panel.areas.push(Area {
            name: "bar".to_owned(),
            x: (0.75, 1.25),
            y: (0.0, 3.0),
            fill: Fill::solid(BLUE),
            value: Some(4.5),
            text: String::new(),
        });
        panel.spans.push(Span { name: "spread".to_owned(), x: 1.0, y: (1.0, 2.0), color: BLUE });
        let figure = Figure::stack("f", Axis::named("x", &names), vec![panel]);
        let expected = "panel,series,x,x_to,y,y_to,value\n\
                        P,curve,\"a, b\",,0.1,,\n\
                        P,curve,c,,2.0,,\n\
                        P,bar,c,,0.0,3.0,4.5\n\
                        P,spread,c,,1.0,2.0,\n";
        assert_eq!(String::from_utf8(figure.csv()).unwrap(), expected);
    }
}
