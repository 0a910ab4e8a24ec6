//! Figures as plain data, drawn as SVG, exported as CSV, and as JSON for pages that zoom.
//!
//! A [`Figure`] says what is shown, in data units: panels with axes, series and limits.
//! [`Figure::svg`] draws it, [`Figure::csv`] writes its data, [`Figure::live`] is what a page needs
//! that zooms. Sizes are in pixels of the SVG page.
//! [`text`] has numbers and times as a reader likes them.
//!
//! `layout` gives the panels their places, `draw` puts them on the page, `export` writes the table.
//!
//! ```
//! use pinc_chart::{Axis, BLUE, Figure, Kind, Panel, Shape, Style};
//!
//! let mut panel = Panel::new("Speed", Axis::new("v (m/s)", Kind::Linear), 200.0);
//! panel.add_named("v", vec![(0.0, 0.0), (1.0, 2.0)], Style::new(BLUE, Shape::Line(1.5)));
//! let figure = Figure::stack("Speed over time", Axis::new("t (s)", Kind::Linear), vec![panel]);
//! assert!(figure.svg().is_some_and(|svg| svg.contains("v (m/s)")));
//! ```

mod color;
mod curve;
mod draw;
mod export;
mod figure;
mod flags;
mod labels;
mod layout;
mod live;
mod scale;
mod svg;
pub mod text;

pub use color::{
    AMBER, BLACK, BLUE, Color, GREEN, GREY, INK, PURPLE, SKY, VERMILLION, graded, input_color,
    state_color,
};
pub use curve::{Point, held_since_previous, held_until_next, present};
pub use figure::{
    Area, Axis, Event, Figure, Key, Label, Look, Panel, Series, Span, extent, places,
};
pub use live::Live;
pub use scale::Kind;
pub use svg::{Fill, Shape, Style, state_mark, width_of};
