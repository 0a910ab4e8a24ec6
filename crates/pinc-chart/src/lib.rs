#![doc = include_str!("../README.md")]
//! # Tour
//!
//! A [`Figure`] says what is shown, in data units: panels with axes, series and limits.
//! [`Figure::svg`] draws it, [`Figure::csv`] writes its data, [`Figure::live`] is what a page needs
//! that zooms. Sizes are in pixels of the SVG page.
//! [`BoxMap`] draws values in boxes of several variables.
//! [`text`] has numbers and times as a reader likes them.
//!
//! `layout` gives the panels their places, `draw` puts them on the page, `export` writes the table.

#![forbid(unsafe_code)]

mod box_map;
mod color;
mod color_bar;
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

pub use box_map::{BoxMap, MapLabels, ValuedBox};
pub use color::{
    AMBER, BLACK, BLUE, Color, GREEN, GREY, INK, PURPLE, SKY, VERMILLION, graded, input_color,
    state_color,
};
pub use color_bar::color_bar;
pub use curve::{Point, difference, held_since_previous, held_until_next, present};
pub use figure::{
    Area, Axis, Event, Figure, Key, Label, Look, Panel, Series, Span, extent, places,
};
pub use live::Live;
pub use scale::Kind;
pub use svg::{Fill, Shape, Style, state_mark, width_of};
