//! Figures as plain data, drawn as SVG and exported as CSV.
//!
//! A [`Figure`] says what is shown: panels with axes, series and limits. `layout` gives the panels their
//! places, `draw` puts them on an SVG page, `export` writes the data as CSV. [`text`] has numbers and times
//! as a reader likes them.

#![allow(missing_docs)]
mod color;
mod curve;
mod draw;
mod export;
mod figure;
mod flags;
mod labels;
mod layout;
mod scale;
mod svg;
pub mod text;

pub use color::{
    AMBER, BLACK, BLUE, Color, GREEN, GREY, INK, PURPLE, SKY, VERMILLION, graded, input_color,
    state_color,
};
pub use curve::{Point, held_since_previous, held_until_next, present};
pub use figure::{Area, Axis, Event, Figure, Key, Label, Look, Panel, Span, extent, places};
pub use scale::Kind;
pub use svg::width_of;
pub use svg::{Fill, Shape, Style, state_mark};
