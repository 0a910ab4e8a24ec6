//! Pictures: a [`Figure`] is plain data, `layout` gives its panels their places, `draw` puts them on
//! an SVG page, `export` writes the data as CSV.

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

pub(super) use color::{
    AMBER, BLACK, BLUE, Color, GREEN, GREY, INK, PURPLE, SKY, VERMILLION, graded, input_color,
    state_color,
};
pub(super) use curve::{Point, held_since_previous, held_until_next, present};
pub(super) use figure::{Area, Axis, Event, Figure, Key, Label, Look, Panel, Span, extent, places};
pub(super) use scale::Kind;
#[cfg(test)]
pub(super) use svg::width_of;
pub(super) use svg::{Fill, Shape, Style, state_mark};
