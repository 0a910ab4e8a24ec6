//! Zooming into the pictures of a page: uPlot and the script that passes it the curves, both inside
//! the page.

/// The style of pictures that can be zoomed.
pub(crate) const STYLE: &str =
    concat!(include_str!("../assets/uPlot.min.css"), "\n", include_str!("../assets/zoom.css"));

/// uPlot 1.6.32, minified as its authors publish it.
const UPLOT: &str = include_str!("../assets/uPlot.iife.min.js");
/// Its licence, which stands in every copy.
const LICENCE: &str = include_str!("../assets/uPlot.LICENSE");
const ZOOM: &str = include_str!("../assets/zoom.js");

/// The scripts of a page, at its end. Without them, and in print, there are the static pictures.
pub(crate) fn script() -> String {
    format!("<script>\n/*! uPlot\n\n{LICENCE}\n*/\n{UPLOT}</script>\n<script>\n{ZOOM}</script>\n")
}

/// The curves of a picture, as JSON.
pub(crate) fn data(json: &str) -> String {
    // Nothing in it may end the element.
    let json = json.replace('<', "\\u003c");
    format!("<script type=\"application/json\">{json}</script>\n")
}
