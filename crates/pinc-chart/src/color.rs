//! Colors that differ for color-blind readers too.

/// A color in sRGB: red, green, blue, from 0 to 255.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

/// Black.
pub const BLACK: Color = Color(0, 0, 0);
pub(crate) const WHITE: Color = Color(255, 255, 255);
/// The dark grey of texts and of what stands for all variables.
pub const INK: Color = Color(0x33, 0x33, 0x33);
/// The grey of limits and of what is of less weight.
pub const GREY: Color = Color(0x8C, 0x8C, 0x8C);
pub(crate) const GRID: Color = Color(0xE4, 0xE4, 0xE4);

// The palette of Okabe and Ito, "Color Universal Design" (2008), without its yellow.
/// Amber, beneath a darker curve.
pub const AMBER: Color = Color(0xE6, 0x9F, 0x00);
/// Light blue.
pub const SKY: Color = Color(0x56, 0xB4, 0xE9);
/// Bluish green.
pub const GREEN: Color = Color(0x00, 0x9E, 0x73);
/// Blue, the color of the first state.
pub const BLUE: Color = Color(0x00, 0x72, 0xB2);
/// Red, the color of the second state.
pub const VERMILLION: Color = Color(0xD5, 0x5E, 0x00);
/// Reddish purple.
pub const PURPLE: Color = Color(0xCC, 0x79, 0xA7);

/// Nine colors of viridis (matplotlib), evenly spaced: their lightness rises evenly, so that a
/// grey print keeps the order.
const VIRIDIS: [Color; 9] = [
    Color(68, 1, 84),
    Color(71, 44, 122),
    Color(59, 81, 139),
    Color(44, 113, 142),
    Color(33, 144, 141),
    Color(39, 173, 129),
    Color(92, 200, 99),
    Color(170, 220, 50),
    Color(253, 231, 37),
];

impl Color {
    /// The color as SVG writes it.
    pub(crate) fn hex(self) -> String {
        format!("#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }

    /// Black or white, whichever stands out more against this color (contrast as in WCAG 2.1).
    pub(crate) fn contrary(self) -> Self {
        let linear = |channel: u8| match f64::from(channel) / 255.0 {
            c if c <= 0.04045 => c / 12.92,
            c => ((c + 0.055) / 1.055).powf(2.4),
        };
        let luminance = 0.2126 * linear(self.0) + 0.7152 * linear(self.1) + 0.0722 * linear(self.2);
        // Both contrasts are equal where (l + 0.05)^2 = 1.05 * 0.05.
        if luminance > 0.179 { BLACK } else { WHITE }
    }
}

/// The color of the i-th state, the same in every picture.
pub fn state_color(i: usize) -> Color {
    [BLUE, VERMILLION, GREEN, PURPLE, SKY, AMBER][i % 6]
}

/// The color of the i-th input.
pub fn input_color(i: usize) -> Color {
    [INK, SKY, PURPLE, GREEN, VERMILLION, BLUE][i % 6]
}

/// The color at `fraction` of the way from the darkest (0) to the lightest (1) of a scale.
pub fn graded(fraction: f64) -> Color {
    let place = fraction.clamp(0.0, 1.0) * 8.0;
    let i = (1..8u8).rfind(|i| f64::from(*i) <= place).unwrap_or(0);
    let s = place - f64::from(i);
    let (Color(r, g, b), Color(r1, g1, b1)) =
        (VIRIDIS[usize::from(i)], VIRIDIS[usize::from(i) + 1]);
    Color(mixed(r, r1, s), mixed(g, g1, s), mixed(b, b1, s))
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "between two colours' channels, and a cast saturates"
)]
fn mixed(a: u8, b: u8, s: f64) -> u8 {
    (f64::from(a) + s * (f64::from(b) - f64::from(a))).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn graded_colours_pass_through_the_table_and_grow_lighter() {
        for (i, color) in (0u8..).zip(VIRIDIS) {
            assert_eq!(graded(f64::from(i) / 8.0), color);
        }
        assert_eq!(graded(-1.0), VIRIDIS[0]);
        assert_eq!(graded(2.0), VIRIDIS[8]);
        let light = |Color(r, g, b): Color| 2 * u32::from(r) + 7 * u32::from(g) + u32::from(b);
        let steps: Vec<u32> = (0..=100).map(|i| light(graded(f64::from(i) / 100.0))).collect();
        assert!(steps.is_sorted(), "{steps:?}");
    }

    #[test]
    fn letters_stand_out_from_their_ground() {
        assert_eq!(WHITE.contrary(), BLACK);
        assert_eq!(BLACK.contrary(), WHITE);
        assert_eq!(graded(0.0).contrary(), WHITE);
        assert_eq!(graded(1.0).contrary(), BLACK);
    }

    /// Both contrasts are equal at a luminance of 0.179: that of the grey 118.
    #[test]
    fn letters_have_the_colour_of_the_greater_contrast() {
        let grey = |channel: u8| Color(channel, channel, channel);
        assert_eq!([grey(115), grey(121)].map(Color::contrary), [WHITE, BLACK]);
        // Green is lighter than red, and red than blue.
        assert_eq!(Color(0, 150, 0).contrary(), BLACK);
        assert_eq!([Color(150, 0, 0), Color(0, 0, 255)].map(Color::contrary), [WHITE; 2]);
    }
}
