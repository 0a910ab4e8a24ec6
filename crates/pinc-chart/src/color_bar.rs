//! The colours of a map as a panel with a scale.

use crate::{Area, Axis, Fill, Kind, Panel, graded, places};

const COLOR_STEPS: usize = 64;

/// The colours from one end of a quantity to the other, `height` pixels high.
#[must_use]
pub fn color_bar(label: &str, ends: (f64, f64), height: f64) -> Panel {
    let (low, high) = match ends.1 > ends.0 {
        true => ends,
        false => (ends.0 - 0.5, ends.1 + 0.5),
    };
    let axis = Axis::ranged(label, Kind::Linear, (low, high));
    let mut panel = Panel::new("", axis, height);
    panel.x = Some(Axis::named("", &[String::new()]));
    let steps = places(COLOR_STEPS + 1);
    let last = steps[COLOR_STEPS];
    for pair in steps.windows(2) {
        let at = |step: f64| low + step / last * (high - low);
        panel.areas.push(Area {
            name: String::new(),
            x: (-0.5, 0.5),
            // Into the next step, so that no rounding leaves a gap.
            y: (at(pair[0]), at((pair[1] + 0.5).min(last))),
            fill: Fill::solid(graded(0.5 * (pair[0] + pair[1]) / last)),
            value: None,
            text: String::new(),
        });
    }
    panel
}
